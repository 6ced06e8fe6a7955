"""The speed and the command of a log that has no more than a current and a position."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from documented_rigs import lift
from hidden import actuator_log, draw_actuator, fault_spec, healthy_spec, true_motion

from observer_fi.logs import log_from_frame, position_speed, recover_command, with_command
from observer_fi.physics import DataSheet, Rig, load_rig, override, rig_of_sheet, with_values
from observer_fi.records import Log

ACTUATOR = lift()
MODEL = override(load_rig().model, "lift", Kp=0.0, Ki=0.0, D=ACTUATOR.rig.D, Km=ACTUATOR.rig.Km)


def test_the_slope_is_the_speed_within_its_noise() -> None:
    spec = healthy_spec(ACTUATOR)
    frame, _ = actuator_log(ACTUATOR, spec, 3)
    found = position_speed(frame["time_s"].to_numpy(), frame["position_m"].to_numpy(), ACTUATOR.rig.D)
    true = true_motion(spec).speed
    steady = np.convolve(np.abs(np.gradient(true)), np.ones(101), "same") < 1e-3
    assert np.std((found.w - true)[steady]) < 1.5 * found.std < 0.05 * np.abs(true).max()


@pytest.mark.parametrize("begins_s", [0.0, 1e6])
@pytest.mark.parametrize("every_s", [0.01, 0.025, 1 / 60])
@pytest.mark.first(3)
def test_of_readings_that_are_held_the_slope_is_that_of_the_updates(every_s: float, begins_s: float) -> None:
    spec = healthy_spec(ACTUATOR)
    frame, _ = actuator_log(ACTUATOR, spec, 3)
    t, true = frame["time_s"].to_numpy(), true_motion(spec).speed
    updated = np.searchsorted(t, t[0] + every_s * np.floor((t - t[0]) / every_s + 1e-9) - 1e-9)
    found = position_speed(begins_s + t, frame["position_m"].to_numpy()[updated], ACTUATOR.rig.D)
    steady = np.convolve(np.abs(np.gradient(true)), np.ones(round(0.2 / (t[1] - t[0]))), "same") < 1e-3
    moving = steady & (true != 0.0)
    assert moving.any() and np.quantile(np.abs(found.w - true)[moving], 0.95) < 0.05 * np.abs(true).max()
    assert np.quantile(np.abs(found.w)[steady & (true == 0.0)], 0.95) < 0.05 * np.abs(true).max()


@pytest.mark.parametrize("kept", [1.0, 0.95])
@pytest.mark.parametrize("share", [0.2, 0.4, 0.7])
@pytest.mark.parametrize("seed", [863900, 863901, 863903])
@pytest.mark.first(6)
def test_a_position_that_stands_to_the_last_digit_hides_no_motion_before_it(
    seed: int, share: float, kept: float
) -> None:
    """Readings without noise, in half of a log, left none to the others: all of these were motion."""
    actuator = draw_actuator(seed, "current")
    spec = healthy_spec(actuator)
    frame, _ = actuator_log(actuator, spec, seed)
    rows = np.sort(np.random.default_rng(seed).permutation(len(frame))[: round(kept * len(frame))])
    t, x = frame["time_s"].to_numpy()[rows], frame["position_m"].to_numpy()[rows]
    stands = round((1.0 - share) * t.size)
    usual = position_speed(t, x, actuator.rig.D)
    found = position_speed(t, np.append(x[:stands], np.full(t.size - stands, x[stands])), actuator.rig.D)
    before = t < t[stands] - 0.5
    assert found.std == pytest.approx(usual.std, rel=0.3)
    assert np.mean(found.moves[before] != usual.moves[before]) < 0.02
    assert not found.moves[t > t[stands] + 0.5].any()


@pytest.mark.parametrize("kept", [1.0, 0.95])
@pytest.mark.parametrize("sigmas", [1.0, 10.0, 50.0])
@pytest.mark.parametrize("hz", [16.7, 50.0, 100.0])
@pytest.mark.parametrize("seed", [863900, 863901, 863903])
@pytest.mark.first(12)
def test_hum_on_the_position_is_no_motion(seed: int, hz: float, sigmas: float, kept: float) -> None:
    """Of an eighth of the top speed at most: what is more hides moves."""
    actuator = draw_actuator(seed, "current")
    spec = healthy_spec(actuator)
    frame, _ = actuator_log(actuator, spec, seed)
    true = true_motion(spec).speed
    rows = np.sort(np.random.default_rng(seed).permutation(len(frame))[: round(kept * len(frame))])
    t, true = frame["time_s"].to_numpy()[rows], true[rows]
    noise = actuator.logger.position_noise_m
    size = min(sigmas * noise, 0.125 * actuator.rig.D * np.abs(true).max() / (2.0 * np.pi * hz))
    x = frame["position_m"].to_numpy()[rows] + size * np.sin(2.0 * np.pi * hz * t + seed)
    found = position_speed(t, x, actuator.rig.D)
    settled = np.convolve(true != 0.0, np.ones(round(0.5 / (t[1] - t[0])) | 1), "same") == 0.0
    assert settled.any() and found.moves[settled].mean() < 0.02
    assert found.moves[np.abs(true) > 0.5 * np.abs(true).max()].mean() > 0.98


@pytest.mark.parametrize("held", [1, 4])
def test_a_pause_of_days_takes_no_memory_and_changes_no_speed(held: int) -> None:
    """Two logs in one file: even times over all of it would be a billion."""
    t = np.arange(8000) / 2000.0
    x = 1e-3 * np.sin(0.5 * np.pi * t) + 1e-6 * np.random.default_rng(held).normal(size=t.size)
    x = x[np.arange(t.size) // held * held]
    paused = np.where(t < 2.0, t, t + 3.0 * 86400.0)
    whole, found = position_speed(t, x, 1e-5), position_speed(paused, x, 1e-5)
    away = np.abs(t - 2.0) > 0.6
    assert found.w[away] == pytest.approx(whole.w[away], abs=5.0 * found.std)
    assert found.std < 0.03 * np.abs(whole.w).max()


def test_readings_without_noise_and_a_mass_that_stands() -> None:
    t = np.arange(1000) / 500.0
    assert (position_speed(t, np.zeros(1000), 1e-5).w == 0.0).all()
    assert position_speed(t, 1e-3 * t, 1e-5).w == pytest.approx(100.0)


@pytest.mark.parametrize("rows", [*range(6, 60, 3), 97, 150])
def test_a_log_that_is_shorter_than_the_longest_stretches(rows: int) -> None:
    t = np.arange(rows) / 200.0
    noise = 1e-7 * np.random.default_rng(rows).normal(size=rows)
    found = position_speed(t, 1e-2 * np.clip(t - 0.5 * t[-1], 0.0, None) + noise, 1e-5)
    assert found.w.shape == found.moves.shape == t.shape and found.std > 0.0


def test_moves_are_where_the_mass_moves() -> None:
    spec = healthy_spec(ACTUATOR)
    log = recover_command(log_from_frame(actuator_log(ACTUATOR, spec, 3)[0]), MODEL)
    true = true_motion(spec).speed
    assert np.mean((log.w_cmd != 0.0) == (true != 0.0)) > 0.97
    assert "recovered from the position, 10 starts" in " ".join(log.notes)


@pytest.mark.parametrize("times", [10.0, 20.0, 40.0, 80.0])
def test_a_move_that_is_slow_beside_the_noise_of_the_position_is_seen(times: float) -> None:
    """A quarter of the top speed, within six standard deviations of what a stretch shows that suits the top speed, was a rest."""
    spec = healthy_spec(ACTUATOR)
    frame, _ = actuator_log(ACTUATOR, spec, 3)
    true, rng = true_motion(spec).speed, np.random.default_rng(round(times))
    noise = times * ACTUATOR.logger.position_noise_m * rng.normal(size=len(frame))
    log = recover_command(log_from_frame(frame.assign(position_m=frame["position_m"] + noise)), MODEL)
    assert np.mean((log.w_cmd != 0.0) == (true != 0.0)) > 0.95
    assert "recovered from the position, 10 starts" in " ".join(log.notes)


@pytest.mark.parametrize("held", [0.5, 0.9])
def test_a_current_that_holds_a_mass_that_it_has_stopped_is_a_rest(held: float) -> None:
    """An integral stays as it was when the motor stopped, at nearly all that moved it; a soft stop takes little of it away."""
    t, J, friction = np.arange(0.0, 4.0, 2e-3), MODEL["J"], MODEL["A"] / MODEL["Km"]
    stops = 2.0 + 100.0 * J / (0.4 * MODEL["A"])
    w = np.interp(t, [0.5, 0.6, 2.0, stops], [0.0, 100.0, 100.0, 0.0])
    i = np.where(t > 0.5, friction + J * np.gradient(w, t) / MODEL["Km"], 0.0)
    i = np.where((t >= stops) & (t < 3.0), held * friction, np.where(t >= 3.0, 0.0, i))
    x = np.cumsum(w) * 2e-3 * MODEL["D"] + 1e-6 * np.random.default_rng(3).normal(size=t.size)
    w_cmd = recover_command(position_only(t, i, x), MODEL).w_cmd
    assert (w_cmd[(t > 0.7) & (t < 1.9)] != 0.0).all() and (w_cmd[t > stops + 0.1] == 0.0).all()


def test_a_mass_that_is_lost_leaves_a_motor_that_is_told_to_move() -> None:
    spec = fault_spec(ACTUATOR, "coupling_loss", 1)
    frame, truth = actuator_log(ACTUATOR, spec, 3)
    log = recover_command(log_from_frame(frame), MODEL)
    brake = spec.profile.moves[0].brake_s
    after = (log.t > truth["onset_s"] + 0.2) & (log.t < brake - 0.05)
    assert after.any() and (log.w_cmd[after] != 0.0).all()
    assert (log.w_cmd[log.t > brake + 0.3] == 0.0).all()


def test_a_mass_that_stops_without_its_motor_is_no_stop_however_the_current_falls() -> None:
    """A current that drops to less than what held the friction, and that no braking explains."""
    t = np.arange(2000) / 500.0
    moving = (t > 0.5) & (t < 2.0)
    w, friction = 400.0, MODEL["A"] / MODEL["Km"]
    x = MODEL["D"] * w * np.clip(t - 0.5, 0.0, 1.5)
    i = np.where(moving, friction, np.where((t >= 2.0) & (t < 3.0), 0.3 * friction, 0.0))
    rng = np.random.default_rng(1)
    z = np.column_stack((np.full(t.size, np.nan), i + 1e-4 * rng.normal(size=t.size), x))
    log = Log("lost", t, z, np.zeros(t.size), np.full(t.size, np.nan))
    told = recover_command(log, MODEL).w_cmd
    assert (told[(t > 0.6) & (t < 2.9)] != 0.0).all() and (told[t > 3.2] == 0.0).all()
    braking = MODEL["J"] * w / MODEL["Km"] / 0.02
    braked = z.copy()
    braked[(t >= 1.98) & (t < 2.0), 1] = friction - braking
    told = recover_command(replace(log, z=braked), MODEL).w_cmd
    assert (told[t > 2.3] == 0.0).all()


def position_only(t: np.ndarray, i: np.ndarray, x: np.ndarray, voltage: np.ndarray | None = None) -> Log:
    """A log of columns, seconds, amperes, metres, volts."""
    columns = {"time_s": t, "current_a": i, "position_m": x}
    return log_from_frame(pd.DataFrame(columns if voltage is None else {**columns, "voltage_v": voltage}))


def test_a_mass_that_stops_at_once_is_no_stop_where_friction_stops_the_motor_soon() -> None:
    """What is left of the current lets the motor coast for 58 ms, which could have stopped the mass; but that went no farther."""
    t, w, left = np.arange(2000) / 1000.0, 40.0, 0.3
    friction = MODEL["A"] / MODEL["Km"]
    coast = w * MODEL["J"] / (1.0 - left) / MODEL["A"]
    i = np.select([t < 0.2, t < 1.0, t < 1.8], [0.0, friction, left * friction], 0.0)
    i += 1e-3 * friction * np.sin(1e3 * t)
    x = MODEL["D"] * w * np.clip(t - 0.2, 0.0, 0.8)
    lost = recover_command(position_only(t, i, x), MODEL).w_cmd
    assert (lost[(t > 1.05) & (t < 1.7)] != 0.0).all() and (lost[t > 1.85] == 0.0).all()
    since = np.clip(t - 1.0, 0.0, coast)
    followed = x + MODEL["D"] * w * (since - 0.5 * since**2 / coast)
    assert (recover_command(position_only(t, i, followed), MODEL).w_cmd[t > 1.2] == 0.0).all()


def test_a_slow_move_in_coarse_readings_is_seen() -> None:
    """Half a millimetre a second in steps of a tenth: no tenth of a second shows it."""
    t = np.arange(0.0, 6.0, 1e-3)
    x = 1.3e-4 * np.round(
        (np.clip(t - 1.0, 0.0, 4.0) * 2e-3 + 1e-4 * np.random.default_rng(4).normal(size=t.size)) / 1.3e-4
    )
    w = recover_command(position_only(t, np.where((t > 1.0) & (t < 5.0), 0.2, 0.0), x), MODEL).w_cmd
    assert (w[(t > 1.5) & (t < 4.5)] != 0.0).all() and (w[t < 0.5] == 0.0).all()


@pytest.mark.parametrize("rest_s", [0.3, 3.0])
def test_a_mass_that_its_motor_has_left_stands_however_long_the_log_goes_on(rest_s: float) -> None:
    """A short move: what comes behind the stand is longer than what was before it."""
    t = np.arange(0.0, 1.5 + rest_s, 1e-3)
    x = np.clip(t - 0.5, 0.0, 0.4) * 0.02
    drawn = MODEL["A"] / MODEL["Km"]
    i = np.select([t < 0.5, t < 0.9, t < 1.4], [0.0, drawn, 0.6 * drawn], -0.1 * drawn)
    w = recover_command(position_only(t, i + 1e-3 * drawn * np.sin(1e3 * t), x), MODEL).w_cmd
    assert (w[(t > 0.95) & (t < 1.35)] != 0.0).all() and (w[t > 1.45] == 0.0).all()


@pytest.mark.parametrize(("factor", "stalls"), [(3.0, True), (0.8, False)])
def test_a_motor_that_stands_and_is_driven_harder_is_not_at_rest(factor: float, stalls: bool) -> None:
    """With a voltage: an obstacle stops the motor itself, and its servo drives it with all that it has."""
    t, Rm, Km = np.arange(0.0, 2.5, 2e-3), MODEL["Rm"], MODEL["Km"]
    w = np.where((t > 0.5) & (t < 1.2), 200.0, 0.0)
    drawn = MODEL["A"] / Km
    i = np.select([t < 0.5, t < 1.2, t < 2.0], [0.0, drawn, factor * drawn], 0.0)
    log = position_only(t, i, np.cumsum(w) * 2e-3 * MODEL["D"], Rm * i + Km * w)
    w_cmd = recover_command(log, MODEL).w_cmd
    assert (w_cmd[(t > 0.6) & (t < 1.15)] != 0.0).all()
    assert bool((w_cmd[(t > 1.3) & (t < 1.9)] != 0.0).all()) is stalls and (w_cmd[t > 2.1] == 0.0).all()


@pytest.mark.parametrize("shown", [0.0, 0.05])
def test_what_the_current_did_not_drive_is_no_stall(shown: float) -> None:
    """A voltage that drops out shows a speed that the current contradicts; the rest after the stop is a rest."""
    t, Rm, Km = np.arange(0.0, 2.5, 2e-3), MODEL["Rm"], MODEL["Km"]
    w = np.where((t > 0.5) & (t < 1.5), 200.0, 0.0)
    i = np.where(w > 0.0, MODEL["A"] / Km, 1e-5 * np.sin(1e3 * t) - 1e-5)
    V = np.where(t < 1.0, Rm * i + Km * w, shown * Km * 200.0)
    w_cmd = recover_command(position_only(t, i, np.cumsum(w) * 2e-3 * MODEL["D"], V), MODEL).w_cmd
    assert (w_cmd[(t > 0.6) & (t < 0.95)] != 0.0).all() and (w_cmd[t > 1.7] == 0.0).all()


@pytest.mark.parametrize(("pull", "told"), [(3.0, True), (-3.0, True), (1.2, False)])
def test_a_motor_that_pulls_in_vain_is_told_to_move(pull: float, told: bool) -> None:
    """A mass that stands beside a motor turning to and fro was at rest, and a lost coupling no fault; not within friction."""
    t = np.arange(2000) / 1000.0
    moves, pulls = (t > 0.3) & (t < 0.8), (t > 1.4) & (t < 1.6)
    x = 0.05 * np.clip(t - 0.3, 0.0, 0.5) + 1e-5 * np.random.default_rng(1).normal(size=t.size)
    rig = learned_rig()
    amperes = rig.model["A"] / rig.model["Km"]
    i = amperes * np.where(moves, 1.0, np.where(pulls, pull, 0.0))
    log = log_from_frame(pd.DataFrame({"time_s": t, "current_a": i, "position_m": x}))
    command = with_command(log, rig).w_cmd[pulls]
    assert (command != 0.0).mean() == pytest.approx(1.0 if told else 0.0, abs=0.1)
    assert not told or np.sign(np.median(command)) == np.sign(pull)


def learned_rig() -> Rig:
    """A current drive whose friction a log has shown: 5 mm a turn, 0.1 N m."""
    values = {"J": 1e-4, "A": 0.1, "Km": 0.06, "D": 5e-3 / (2.0 * np.pi)}
    sheet = DataSheet(
        "lab", "current", lead=5e-3, torque_constant=0.06, rotor_inertia=5e-5, resistance=0.6, supply=24.0
    )
    rig = rig_of_sheet(sheet).rig
    return with_values(rig, values, {"A": 1e-3}, "identified")


def test_a_current_that_is_little_as_the_mass_stops_goes_on() -> None:
    """One sample of a change that fell below, at 25 Hz and where the stretch begins, was the end of the motor's move."""
    t = np.arange(150) / 25.0
    friction = MODEL["A"] / MODEL["Km"]
    x = MODEL["D"] * 400.0 * np.clip(t - 0.5, 0.0, 1.8)
    i = np.where(t > 0.5, friction, 0.0) * np.where(t > 2.3, 0.48, 1.0)
    i[np.searchsorted(t, 2.3)] = 0.39 * friction
    i[t > 5.0] = -0.2 * friction
    z = np.column_stack((np.full(t.size, np.nan), i + 1e-4 * np.random.default_rng(2).normal(size=t.size), x))
    log = recover_command(
        log_from_frame(pd.DataFrame({"time_s": t, "current_a": z[:, 1], "position_m": x})), MODEL
    )
    assert (log.w_cmd[(t > 2.4) & (t < 4.9)] != 0.0).all() and (log.w_cmd[t > 5.1] == 0.0).all()


@pytest.mark.parametrize("dead", [True, False])
def test_a_voltage_at_rest_turns_no_motor_where_the_current_sensor_died(dead: bool) -> None:
    """R i of the rest looked like a speed, 16 % of that of the move: a lost coupling for sure behind a current that was lost.

    Where the current is there, the motor turns without its mass.
    """
    rate, w = 250.0, 300.0
    t = np.arange(1000) / rate
    moving, model = (t > 0.5) & (t < 2.5), load_rig().model
    i = np.where(moving, model["A"], np.where(t >= 2.5, 0.6 * model["A"], 0.0)) / model["Km"]
    v = model["Rm"] * i + model["Km"] * np.where(moving, w, 0.0 if dead else 0.3 * w * (t > 1.0))
    x = model["D"] * w * np.clip(t - 0.5, 0.0, 2.0)
    seen = np.where(dead & (t > 1.5), 0.0, i) + 1e-4 * np.random.default_rng(5).normal(size=t.size)
    frame = pd.DataFrame({"time_s": t, "voltage_v": v, "current_a": seen, "position_m": x})
    log = recover_command(log_from_frame(frame), override(model, "servo", Kp=0.0, Ki=0.0))
    assert (log.w_cmd[t > 2.7] == 0.0).all() == dead
