"""Lines of a logger taken out of its readings: all of a line that holds its phase, nothing of one that does not."""

from collections.abc import Sequence

import hidden
import numpy as np
import pytest
from campaigns import RIG, log_of
from logged_signals import ACCEL, SIGMA, SPEED, clock

from observer_fi.learn.fit_readings import readings_to_fit
from observer_fi.logs import Hum, acquisition_of, without_lines
from observer_fi.records import Acquisition, ChannelTraits, Clock, Line, Log

MOVES, EVERY_S, MOVING_S = 4, 1.5, 0.5
SIZES = np.array([40e-3, 2e-3, 60e-6])  # V, A, m: four to seven times the noise
HARMONICS = {1: 1.0, 3: 0.4}
LEFT = 0.2  # standard deviations of the noise: phases of rests of a thousand samples are known to a tenth


def quiet(rate: float, moves: int = MOVES, seed: int | None = None) -> Log:
    """Moves between rests, with noise where a seed is given; the servo holds the mass from the first of them on."""
    t = clock(0.8 + moves * EVERY_S, rate)
    start = 0.8 + EVERY_S * np.arange(moves)[:, None]
    ramp = SPEED / ACCEL
    knots = (start + [0.0, ramp, MOVING_S, MOVING_S + ramp]).ravel()
    w = np.interp(t, knots, np.tile([0.0, SPEED, SPEED, 0.0], moves))
    held = np.maximum.accumulate(w != 0.0)
    z = np.column_stack((0.02 * w + 0.1 * held, 6e-5 * w + 5e-3 * held, 3e-6 * np.cumsum(w) / rate))
    if seed is not None:
        z += SIGMA * np.random.default_rng(seed).standard_normal(z.shape)
    return Log("hum", t, z, w, np.zeros(t.size))


def hum(t: np.ndarray, hz: float, seed: int, sizes: np.ndarray = SIZES) -> np.ndarray:
    """(n, 3) mains hum with its third harmonic; each channel has its own phases."""
    rng = np.random.default_rng([seed, 1])
    total = np.zeros((t.size, 3))
    for order, share in HARMONICS.items():
        total += share * sizes * np.sin(2.0 * np.pi * order * hz * t[:, None] + rng.uniform(0.0, 6.3, 3))
    return total


def with_z(log: Log, z: np.ndarray) -> Log:
    return Log(log.path, log.t, z, log.w_cmd, log.pitch)


def lines(hz: Sequence[float], channels: Sequence[int] = (0, 1, 2)) -> Acquisition:
    """A logger that is known to have lines of these frequencies on some channels."""
    found = tuple(Line(f, 1.0) for f in hz)
    every = [ChannelTraits(1.0, 1.0, lines=found if c in channels else ()) for c in range(3)]
    return Acquisition(*every, Clock(0.0, None, 1e-3))


def left(log: Log, hummed: np.ndarray, acquisition: Acquisition) -> np.ndarray:
    """(n, 3) what is left of the hum that was added [standard deviations of the noise]."""
    return (without_lines(with_z(log, log.z + hummed), acquisition).z - log.z) / SIGMA


def rms(y: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(y**2, axis=0))


# --- what is taken out ---------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [400.0, 1000.0, 1600.0])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.first(6)
def test_hum_is_gone_from_rests_and_moves(rate: float, seed: int) -> None:
    hz = 50.0 * np.random.default_rng(seed).uniform(0.999, 1.001)
    log = quiet(rate, seed=seed)
    hummed = hum(log.t, hz, seed)
    found = acquisition_of(with_z(log, log.z + hummed), SIGMA)
    assert [len(channel.lines) for channel in found[:3]] == [2, 2, 2]
    off = left(log, hummed, found)
    for moving in (log.w_cmd != 0.0, log.w_cmd == 0.0):
        assert (rms(hummed[moving] / SIGMA) > 2.5).all()
        assert (rms(off[moving]) < LEFT * np.sqrt(1600.0 / rate)).all()


@pytest.mark.parametrize("moves", [1, 2, 5])
@pytest.mark.parametrize("hz", [49.95, 50.0, 60.03, 137.0])
@pytest.mark.first(6)
def test_without_noise_nothing_at_all_is_left(moves: int, hz: float) -> None:
    """Frequencies that are told a little wrong: between rests the phase says them better."""
    log = quiet(1600.0, moves)
    told = lines([hz + 0.02, 3.0 * hz - 0.03])
    assert np.abs(left(log, hum(log.t, hz, moves), told)).max() < 1e-2
    exact = lines([hz, 3.0 * hz])
    assert np.abs(left(log, hum(log.t, hz, moves), exact)).max() < 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_hum_that_grows_slowly_is_followed(seed: int) -> None:
    """Twice as large at the end of the log as it was at its begin."""
    log = quiet(1600.0, seed=seed)
    growing = hum(log.t, 50.02, seed) * (1.0 + log.t[:, None] / log.t[-1])
    off = left(log, growing, acquisition_of(with_z(log, log.z + growing), SIGMA))
    assert (rms(off) < 2.0 * LEFT).all()  # the ends, beyond the middle of the outer rests, keep a twentieth


@pytest.mark.parametrize("seed", range(3))
def test_hum_of_the_independent_truth_goes_where_it_moves(seed: int) -> None:
    spec = hidden.TruthSpec(hidden.there_and_back((410.0, 300.0), (0.6, 0.6), (0.0, 8.0)))
    plain = log_of(spec.profile, seed=seed)
    hummed = hum(plain.t, 50.0 + 0.02 * (seed - 1), seed) * [1.0, 1.0, 0.0]
    off = left(plain, hummed, acquisition_of(with_z(plain, plain.z + hummed), SIGMA))
    assert (rms(off[plain.w_cmd != 0.0]) < 2.0 * LEFT).all()  # these rests are of 150 samples
    assert not off[:, 2].any()


# --- what stays ----------------------------------------------------------------------------------


def test_a_log_without_lines_is_the_very_log() -> None:
    log = quiet(1600.0, seed=1)
    assert without_lines(log, lines([])) is log
    assert without_lines(log, acquisition_of(log, SIGMA)) is log


@pytest.mark.parametrize("channel", range(3))
def test_only_a_channel_with_a_line_is_touched(channel: int) -> None:
    log = quiet(1600.0, seed=2)
    log.z[:] += hum(log.t, 50.0, 2)
    before = log.z.copy()
    out = without_lines(log, lines([50.0], [channel]))
    np.testing.assert_array_equal(log.z, before)
    for c in range(3):
        assert np.array_equal(out.z[:, c], before[:, c]) == (c != channel)


@pytest.mark.parametrize("seed", range(6))
def test_a_line_whose_phase_does_not_hold_stays(seed: int) -> None:
    """Of something that is switched on anew at each rest: now in one phase, now in another."""
    log = quiet(1600.0, seed=seed)
    rest = np.cumsum(np.append(0, np.diff((log.w_cmd != 0.0).astype(int)) == -1))
    phase = np.random.default_rng(seed).uniform(0.0, 6.3) + 2.2 * (rest % 2)
    own = SIZES * np.sin(2.0 * np.pi * 50.0 * log.t + phase)[:, None]
    logged = with_z(log, log.z + own)
    np.testing.assert_array_equal(without_lines(logged, lines([50.0])).z, logged.z)


@pytest.mark.parametrize("seed", range(4))
def test_a_line_that_holds_goes_and_one_that_does_not_stays(seed: int) -> None:
    log = quiet(1600.0)
    rest = np.cumsum(np.append(0, np.diff((log.w_cmd != 0.0).astype(int)) == -1))
    kept = SIZES * np.sin(2.0 * np.pi * 137.0 * log.t + seed + 2.2 * (rest % 2))[:, None]
    gone = SIZES * np.sin(2.0 * np.pi * 50.0 * log.t + seed)[:, None]
    out = without_lines(with_z(log, log.z + kept + gone), lines([50.0, 137.0])).z - log.z
    assert (rms(out - kept) < 0.02 * rms(kept)).all()


def test_one_rest_tells_no_phase_that_holds() -> None:
    log = quiet(1600.0, 1, seed=3).part(slice(0, 1900))
    logged = with_z(log, log.z + hum(log.t, 50.0, 3))
    np.testing.assert_array_equal(without_lines(logged, lines([50.0])).z, logged.z)


@pytest.mark.parametrize("seed", range(4))
def test_missing_readings_stay_missing_and_change_no_other(seed: int) -> None:
    log = quiet(1600.0, seed=seed)
    hummed = hum(log.t, 50.01, seed)
    lost = np.random.default_rng(seed).random(log.z.shape) < 0.1
    logged = with_z(log, np.where(lost, np.nan, log.z + hummed))
    out = without_lines(logged, lines([50.0, 150.0])).z
    np.testing.assert_array_equal(np.isnan(out), lost)
    assert (rms(np.where(lost, 0.0, out - log.z) / SIGMA) < LEFT).all()


# --- in a fit ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_readings_of_a_fit_have_the_noise_that_is_left(seed: int) -> None:
    log = quiet(1600.0, seed=seed)
    plain, hummed = (
        readings_to_fit([with_z(log, log.z + add)], RIG) for add in (0.0, hum(log.t, 50.0, seed))
    )
    assert plain.hum_hz == () and len(hummed.hum_hz) == 6
    assert sorted(hummed.hum_hz)[2] == pytest.approx(50.0, abs=0.1)
    np.testing.assert_allclose(hummed.noise, plain.noise, rtol=0.03)
    assert (rms((hummed.logs[0].z - plain.logs[0].z) / SIGMA) < LEFT).all()


# --- chunk by chunk ------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [700, 2500, 6000])
def test_chunks_go_on_where_the_ones_before_ended(rows: int) -> None:
    """Frequencies are those of the beginning; sizes and phases go on from rest to rest, and stand where a chunk has none."""
    log = quiet(1600.0, 8, seed=5)
    hummed = hum(log.t, 50.02, 5)
    logged = with_z(log, log.z + hummed)
    begun = logged.part(slice(0, 8000))
    known = Hum(begun, acquisition_of(begun, SIGMA), 3)
    assert known.any
    chunks = [known.take(logged.part(slice(k, k + rows))) for k in range(0, log.t.size, rows)]
    off = (np.concatenate([chunk.z for chunk in chunks]) - log.z) / SIGMA
    assert (rms(off) < 2.0 * LEFT).all()


def test_more_rests_can_be_asked_for() -> None:
    log = quiet(1600.0, 1, seed=6)
    logged = with_z(log, log.z + hum(log.t, 50.0, 6))
    told = acquisition_of(logged, SIGMA)
    assert Hum(logged, told).any and not Hum(logged, told, 3).any
