"""A simulation that the measured current drives, held near the measured position: it leaves white noise of a right model."""

from dataclasses import replace
from functools import cache

import hidden
import numpy as np
import pytest
from drawn_sheets import drawn_sheet
from hidden.effects import Effect, effect
from scipy.fft import dct
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from observer_fi.errors import UsageError
from observer_fi.improve.moves.simulated_moves import SimulatedMoves, simulated_moves
from observer_fi.learn.gauss_newton import Free
from observer_fi.learn.output_error import fit, residuals
from observer_fi.learn.reversal_doubt import subtract_doubt
from observer_fi.learn.servo.tracking_doubt import DAMPING, SMOOTH, Loop, _around_a_step, tracking_doubt
from observer_fi.learn.servo.tracking_loop import followed
from observer_fi.logs import log_from_frame, on_its_clock, thinned, with_command
from observer_fi.physics import rig_of_sheet, with_values

TRUE = ("Km", "D", "J", "A", "B")
WINDING = ("Rm",)
VISCOUS = 0.3  # of the Coulomb friction, at full speed
CASES = [(drive, seed) for seed in (853001, 853002, 853003) for drive in ("voltage", "current")]
SHORT = (
    "voltage",
    860010,
)  # moves of half a period of the loop; the voltage's noise is the current's for 90 %


@cache
def problem(
    drive: str, seed: int, effects: tuple[Effect, ...] = (), held: tuple[tuple[str, int], ...] = ()
) -> SimulatedMoves:
    """Moves of a drawn actuator with `effects` that nobody knows, simulated with its true constants.

    held: columns whose readings stay for so many rows.
    """
    actuator = hidden.draw_actuator(seed, drive)
    frame, _ = hidden.actuator_log(actuator, replace(hidden.healthy_spec(actuator), effects=effects), seed)
    for column, rows in held:
        frame[column] = frame[column].to_numpy()[np.arange(len(frame)) // rows * rows]
    rig = rig_of_sheet(drawn_sheet(actuator, drive)).rig
    names = (*TRUE, *(WINDING if drive == "voltage" else ()))
    rig = with_values(rig, {name: getattr(actuator.rig, name) for name in names}, {}, "identified")
    log = on_its_clock(thinned(log_from_frame(frame), rig), rig)
    return simulated_moves([with_command(log, rig)], rig)


def left(one: SimulatedMoves, **values: float) -> tuple[float, float]:
    """Root mean square of the normalised residuals of voltage and position, and that of their means over 32 samples."""
    e = one.experiment
    model = with_values(one.rig, values).model
    r = residuals(e, model, np.zeros((e.moves, 2)))
    seen = [r[e.weight[:, c] > 0.0, c] for c in (0, 2)]
    blocks = [y[: y.size // 32 * 32].reshape(-1, 32).mean(axis=1) * 32**0.5 for y in seen]
    rms = [float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for parts in (seen, blocks)]
    return rms[0], rms[1]


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "seed"), [*CASES, SHORT])
@pytest.mark.first(1)
def test_true_constants_leave_the_noise(drive: str, seed: int) -> None:
    """Of moves longer and shorter than the loop is slow, and whatever share of the voltage's noise the current's is."""
    rough, slow = left(problem(drive, seed))
    assert rough < 1.1 and slow < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "held",
    [
        (("position_m", 8),),
        (("current_a", 4),),
        (("voltage_v", 4),),
        (("current_a", 4), ("voltage_v", 4)),
        (("current_a", 3), ("position_m", 5)),
    ],
    ids=lambda held: "+".join(column for column, _ in held),
)
@pytest.mark.first(1)
def test_readings_that_are_held_leave_the_noise_too(held: tuple[tuple[str, int], ...]) -> None:
    """A current held beside a voltage that is not left three times the noise: it jumps between two of its readings."""
    rough, slow = left(problem("voltage", 853001, held=held))
    assert rough < 1.1 and slow < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "seed"), CASES)
@pytest.mark.first(2)
def test_a_friction_that_is_missing_shows(drive: str, seed: int) -> None:
    """Behind a loop that followed the position at any rate it would not."""
    actuator = hidden.draw_actuator(seed, drive)
    more = VISCOUS * actuator.rig.A / actuator.speed
    one = problem(drive, seed, (effect("viscous_friction", plus=more, minus=more),))
    without = left(one)[1]
    known = left(one, viscous_positive=more, viscous_negative=more)[1]
    assert without > 3.0 and known < 0.5 * without


def shown_elsewhere(drive: str, seed: int) -> dict[str, tuple[Effect, dict[str, float]]]:
    """Effects between a motor and its position: what is hidden, and what a model has that knows it."""
    play = 0.002 * hidden.draw_actuator(seed, drive).travel
    return {
        "lag": (effect("position_lag", lag=0.02), {"position_lag": 0.02}),
        "delay": (effect("position_delay", delay=0.01), {"position_delay": 0.01}),
        "gain": (effect("position_gain", gain=0.05), {"position_gain": 1.05}),
        "play": (effect("backlash", width=play, start=1.0), {"backlash": play}),
    }


@pytest.mark.slow
@pytest.mark.parametrize("what", ["lag", "delay", "gain", "play"])
@pytest.mark.parametrize(("drive", "seed"), [("voltage", 853001), ("current", 853002), SHORT])
@pytest.mark.first(1)
def test_a_loop_that_knows_the_sensor_leaves_the_noise(drive: str, seed: int, what: str) -> None:
    """It follows where the motor is, and not where its position shows it; what it left was told of other equations."""
    hidden_one, known = shown_elsewhere(drive, seed)[what]
    one = problem(drive, seed, (hidden_one,))
    without = left(one)[1]
    near = replace(one, experiment=followed(one.experiment, with_values(one.rig, known).model))
    rough, slow = left(near, **known)
    assert rough < 1.1 and slow < 1.5
    assert without > 1.5 * slow


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "seed"), [*CASES, SHORT])
@pytest.mark.parametrize("what", ["lag", "delay", "gain"])
@pytest.mark.first(1)
def test_a_loop_that_does_not_know_the_sensor_scores_it_with_its_size(
    drive: str, seed: int, what: str
) -> None:
    """Within a factor of two: a loop goes along with most of what a sensor shows, and what it leaves looks far smaller."""
    hidden_one, known = shown_elsewhere(drive, seed)[what]
    one = problem(drive, seed, (hidden_one,))
    ((name, value),) = known.items()
    neutral, still = one.rig.model[name], np.zeros((one.experiment.moves, 2))
    tenth = with_values(one.rig, {name: neutral + 0.1 * (value - neutral)})
    r, near = (residuals(one.experiment, rig.model, still) for rig in (one.rig, tenth))
    column = 10.0 * (r - near)
    assert 0.5 < float(np.sum(r * column) / np.sum(column**2)) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "seed"), [("current", 853001), ("voltage", 853002), ("voltage", 853003)])
@pytest.mark.parametrize("begun", [0.05, 5.0])
@pytest.mark.first(1)
def test_play_that_is_fitted_behind_itself_again_and_again_is_the_true_one(
    drive: str, seed: int, begun: float
) -> None:
    """From a twentieth of it as from five times it: a first fit alone is off by up to a half."""
    play = 0.005 * hidden.draw_actuator(seed, drive).travel
    one = problem(drive, seed, (effect("backlash", width=play, start=1.0),))
    width = begun * play
    for _ in range(8):
        model = with_values(one.rig, {"backlash": width}).model
        width = fit(followed(one.experiment, model), model, [Free("backlash", 0.1 * width, 0.0)]).model[
            "backlash"
        ]
    assert width == pytest.approx(play, rel=0.02)


@pytest.mark.slow
def test_the_current_counts_no_more_and_is_in_the_noise_of_the_voltage() -> None:
    drive, seed = CASES[0]
    one = problem(drive, seed)
    assert not one.experiment.weight[:, 1].any()
    assert one.experiment.noise[0] > one.rig.model["Rm"] * one.experiment.noise[1]
    assert one.experiment.silent == ("servo", "sensor:current")
    current_only = problem("current", seed).experiment
    assert {"electrical", "sensor:voltage"} < set(current_only.silent)


def test_an_inertia_of_another_machine_is_one_line() -> None:
    drive, seed = CASES[1]
    one = problem(drive, seed)
    light = with_values(one.written, {"J": 1e-5 * one.written.model["J"]})
    with pytest.raises(UsageError, match="runs away: inertia J and friction A"):
        simulated_moves(one.logs, light)


def test_a_stop_that_rings_is_no_simulation_that_runs_away() -> None:
    """The last way of every move is a ring then, a quarter as fast as the move."""
    actuator = hidden.draw_actuator(856000, "current")
    peaks = np.abs(problem("current", 856000).experiment.peak)
    assert peaks.max() < 0.5 * actuator.speed


@pytest.mark.slow
def test_a_loop_is_as_slow_as_the_position_is_noisy() -> None:
    """Ten times the noise of the position, and the Kalman gain's fourth root falls by its square root."""
    drive, seed = CASES[1]
    frame, _ = hidden.actuator_log(
        hidden.draw_actuator(seed, drive), hidden.healthy_spec(hidden.draw_actuator(seed, drive)), seed
    )
    rings = []
    for times in (1.0, 10.0):
        noise = problem(drive, seed).experiment.noise[2] * np.sqrt(times**2 - 1.0)
        noisy = frame.assign(
            position_m=frame["position_m"] + noise * np.random.default_rng(1).normal(size=len(frame))
        )
        rig = problem(drive, seed).written
        log = with_command(on_its_clock(thinned(log_from_frame(noisy), rig), rig), rig)
        model = simulated_moves([log], rig).rig.model
        rings.append(float(np.sqrt(model["Ki"] * model["Km"] / model["J"])))
    assert rings[0] / rings[1] == pytest.approx(10.0**0.5, rel=0.1)


def test_what_goes_with_a_step_of_the_speed_obeys_the_loop_that_follows_the_position() -> None:
    """w = step - integral of L e, e = integral of w, V = Km w - Rm (J / Km) L e, with the loop's own filter over samples, forward
    and back, in place of its spectrum.
    """
    m = problem(*CASES[0]).rig.model
    ring, dt = float(np.sqrt(m["Ki"] * m["Km"] / m["J"])), 2e-3
    since, shown = _around_a_step(dt, Loop(ring, m))
    e = shown[:, 2] / m["D"]
    slow = sosfiltfilt(butter(2, SMOOTH * ring * dt / np.pi, output="sos"), e)
    back = DAMPING * ring * np.gradient(slow, dt) + ring**2 * slow
    w = (since >= 0.0) - cumulative_trapezoid(back, dx=dt, initial=0.0)
    voltage = m["Km"] * w - m["Rm"] * m["J"] / m["Km"] * back
    assert np.abs(shown[:, 0] - voltage).max() < 0.02 * np.abs(voltage).max()
    assert np.abs(e - cumulative_trapezoid(w, dx=dt, initial=0.0)).max() < 0.02 * np.abs(e).max()
    assert not shown[:, 1].any()


@pytest.mark.parametrize("of", ["position", "current"])
@pytest.mark.parametrize(("ring_hz", "n"), [(0.2, 2000), (0.03, 700), (4.0, 3000)])
def test_the_wander_of_the_voltage_is_as_high_in_a_move_as_in_a_piece_of_an_endless_one(
    ring_hz: float, n: int, of: str
) -> None:
    """White noise at 1 kHz through e'' = a - L e, cut into moves: the variance of every cosine, but for Rm i of the current's."""
    m, ring, dt, pieces = problem(*CASES[0]).rig.model, 2.0 * np.pi * ring_hz, 1e-3, 4000
    loop, at = Loop(ring, m), 2.0 * np.pi * np.fft.rfftfreq(n * pieces, dt)
    size = 1e-4 if of == "position" else 1e-2
    white = np.fft.rfft(np.random.default_rng(5).normal(0.0, size, n * pieces))
    back = loop.back(at)
    driven = back / m["D"] if of == "position" else m["Km"] / m["J"]
    error = white * driven / (back - at**2)
    voltage = np.fft.irfft(m["Km"] * 1j * at * error + m["Rm"] * m["J"] / m["Km"] * (1j * at) ** 2 * error)
    at_once = 0.0 if of == "position" else m["Rm"] * size
    found = np.mean(dct(voltage.reshape(pieces, n), norm="ortho") ** 2, axis=0) - at_once**2
    noise = np.array([1e-3, size if of == "current" else 1e-9, size if of == "position" else 1e-9])
    weight = np.ones((n, 3)) / noise
    doubt = tracking_doubt(dt * np.arange(n), np.zeros(n), np.ones(n), weight, noise, np.ones(3), loop)
    assert doubt.waves is not None
    told = noise[0] ** 2 * (1.0 / (1.0 - doubt.waves.share) ** 2 - 1.0)
    shown = told > max(0.1 * noise[0] ** 2, 0.5 * at_once**2)
    assert shown.any()
    # Pieces side by side have what is slow in common: 15 % of the mean of four thousand.
    assert np.allclose(told[shown] / found[shown], 1.0, atol=0.15)


def test_a_step_of_the_speed_is_taken_and_noise_is_not() -> None:
    one = problem(*CASES[0])
    m, e = one.rig.model, one.experiment
    n, dt = 2000, 1e-3
    t = dt * np.arange(n)
    i = np.where(t < 1.0, 0.0, 50.0 * e.noise[1])
    loop = Loop(float(np.sqrt(m["Ki"] * m["Km"] / m["J"])), m)
    weight = np.ones((n, 3)) / e.noise
    doubt = tracking_doubt(t, i, np.ones(n), weight, e.noise, np.ones(3), loop)
    assert np.allclose(doubt.directions @ doubt.directions.T, np.eye(len(doubt.share)), atol=1e-9)
    white = np.random.default_rng(2).normal(size=(n, 3))
    since, shown = _around_a_step(dt, loop)
    of_step = np.column_stack([np.interp(t - 1.0, since, channel) for channel in shown.T]) * weight
    of_step *= 1e3 / np.linalg.norm(of_step)
    for readings, least, most in ((white, 0.9, 1.0), (of_step, 0.0, 0.3)):
        r = readings.copy()
        subtract_doubt(r, doubt)
        assert least < np.linalg.norm(r) / np.linalg.norm(readings) < most
