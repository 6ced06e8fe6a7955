"""What a logger does, against signals of known noise, steps, holds, colour, lines, spikes and clocks."""

from dataclasses import replace

import numpy as np
import pytest
from logged_signals import RATE, SIGMA, clean, clock, coloured, command, held, log_of, signal, stepped, white

from observer_fi.logs.logger.acquisition import (
    acquisition_of,
    rests_of,
    without_spikes,
)
from observer_fi.logs.logger.clock import clock_of
from observer_fi.logs.logger.lines import lines_of
from observer_fi.numerics import resolution_of
from observer_fi.physics import load_rig
from observer_fi.records import Acquisition, ChannelTraits, Log

CHANNELS = ("voltage", "current", "position")


def traits_of(log: Log) -> Acquisition:
    return acquisition_of(log, SIGMA)


def read(z: np.ndarray, c: int = 0, t: np.ndarray | None = None) -> ChannelTraits:
    """Traits of one channel whose readings are z (n,), the other two ideal."""
    log = signal(seed=99)
    t = log.t if t is None else t
    table = clean(t) + white(t, 99)
    table[:, c] = z
    return traits_of(log_of(t, table))[c]


def plain(traits: ChannelTraits) -> bool:
    return (
        traits.resolution is None
        and traits.update_hz is None
        and not traits.lines
        and traits.correlation_s is None
        and traits.averaged == 1
    )


# --- noise ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("times", [0.33, 1.0, 3.0])
def test_noise_is_measured_within_ten_percent(times: float) -> None:
    """A rest of 0.7 s and one of 1 s: 2700 readings, whose standard deviation is known to 1.4 %."""
    found = np.array([[c.noise_std for c in traits_of(signal(seed, times=times))[:3]] for seed in range(30)])
    ratio = found / (times * SIGMA)
    assert np.abs(ratio - 1.0).max() < 0.1 and np.abs(ratio.mean(axis=0) - 1.0).max() < 0.02
    white_alone = [c.as_white / c.noise_std for c in traits_of(signal(0, times=times))[:3]]
    assert white_alone == pytest.approx([1.0] * 3)


def test_an_ideal_log_shows_nothing_but_its_noise() -> None:
    """But for a line that is none, far below the noise, in at most one channel of sixty."""
    lines = 0
    for seed in range(60):
        found = traits_of(signal(seed))
        for c, std in zip(found[:3], SIGMA, strict=True):
            lines += len(c.lines)
            assert all(line.amplitude < 0.2 * std for line in c.lines)
            assert plain(c._replace(lines=())) and c.spikes == 0 and c.repeats == 0.0, seed
        assert found.clock.jitter_s == 0.0 and found.clock.resolution_s is None
        assert found.clock.interval_s == pytest.approx(1.0 / RATE)
    assert lines <= 3


def test_neighbours_differ_by_the_noise_alone() -> None:
    found = traits_of(signal(3))
    assert [c.neighbour_std for c in found[:3]] == pytest.approx(SIGMA, rel=0.1)


def test_a_log_without_any_rest_tells_its_noise_from_second_differences() -> None:
    log = signal(4)
    moving = (log.t > 0.8) & (log.t < 1.6)
    found = traits_of(
        replace(log, t=log.t[moving], z=log.z[moving], w_cmd=log.w_cmd[moving], pitch=log.pitch[moving])
    )
    assert [c.noise_std for c in found[:3]] == pytest.approx(SIGMA, rel=0.1)
    assert all(plain(c) for c in found[:3])


def test_a_sensor_that_fails_later_does_not_spoil_the_first_rest() -> None:
    log = signal(5)
    log.z[log.t > 2.0, 1] += 20.0 * white(log.t, 6)[log.t > 2.0, 1]
    log.z[log.t > 1.2, 2] = log.z[0, 2]
    found = traits_of(log)
    assert found.current.noise_std == pytest.approx(SIGMA[1], rel=0.1)
    assert found.position.noise_std == pytest.approx(SIGMA[2], rel=0.1)
    assert plain(found.current) and plain(found.position)


def test_offsets_are_the_mean_of_the_first_rest() -> None:
    log = signal(7)
    log.z[:, :2] += (30e-3, -2e-3)
    found = traits_of(log)
    error = 4.0 * SIGMA / np.sqrt(0.7 * RATE)
    assert found.voltage.offset == pytest.approx(30e-3, abs=error[0])
    assert found.current.offset == pytest.approx(-2e-3, abs=error[1])


# --- logs that tell little -----------------------------------------------------------------------


@pytest.mark.parametrize("sigmas", [20.0, 100.0])
def test_a_spike_is_no_offset_of_a_short_rest(sigmas: float) -> None:
    log = signal(seed=5)
    seen = [traits_of(replace(log, z=z)).voltage.offset for z in (log.z, _with_spike(log.z, sigmas))]
    assert abs(seen[1] - seen[0]) < 0.05 * SIGMA[0]


def _with_spike(z: np.ndarray, sigmas: float) -> np.ndarray:
    out = z.copy()
    out[7, 0] += sigmas * SIGMA[0]
    return out


@pytest.mark.parametrize("n", [2, 10, 99, 100, 101])
def test_short_logs_tell_little_but_do_not_fail(n: int) -> None:
    log = signal(8)
    found = traits_of(replace(log, t=log.t[:n], z=log.z[:n], w_cmd=log.w_cmd[:n], pitch=log.pitch[:n]))
    for c, std in zip(found[:3], SIGMA, strict=True):
        assert plain(c)
        assert np.isnan(c.noise_std) if n < 100 else c.noise_std == pytest.approx(std, rel=0.5)


def test_a_channel_that_is_not_there_has_no_noise() -> None:
    log = signal(9)
    log.z[:, 0] = np.nan
    found = traits_of(log)
    assert np.isnan(found.voltage.noise_std) and np.isnan(found.voltage.as_white) and plain(found.voltage)
    assert found.current.noise_std == pytest.approx(SIGMA[1], rel=0.1)


def test_a_constant_channel_is_finite() -> None:
    found = read(np.full(clock().size, 0.25), 2)
    assert (
        found.noise_std == 0.0 and np.isfinite(found.as_white) and found.update_hz is None and not found.lines
    )
    assert found.repeats == 1.0


def test_a_log_of_one_rest_and_no_move() -> None:
    log = signal(10, seconds=0.6)
    assert not log.w_cmd.any()
    assert traits_of(log).voltage.noise_std == pytest.approx(SIGMA[0], rel=0.1)


def test_rests_begin_when_the_loop_has_settled() -> None:
    t = clock()
    first, later = rests_of(t, command(t))
    assert first.start == 0 and t[first.stop] == pytest.approx(0.7, abs=3.0 / RATE)
    assert t[later.start] == pytest.approx(1.7375 + 0.3, abs=2.0 / RATE) and later.stop == t.size


@pytest.mark.parametrize("rate", [80.0, 100.0, 200.0])
def test_short_rests_of_a_slow_logger_tell_noise_and_zero(rate: float) -> None:
    """56 to 140 samples before the move; a rest of a hundred tells more, and shorter ones are left out beside it."""
    off = np.array([30e-3, 2e-3, 0.0])
    found = []
    for seed in range(40):
        log = signal(seed, times=3.0, rate=rate)
        told = acquisition_of(log_of(log.t, log.z + off), SIGMA)
        assert told.voltage.offset == pytest.approx(off[0], abs=1.5 * SIGMA[0])
        assert told.current.offset == pytest.approx(off[1], abs=1.5 * SIGMA[1])
        found.append([told[c].noise_std / SIGMA[c] for c in range(3)])
    assert np.mean(found, axis=0) == pytest.approx(np.full(3, 3.0), rel=0.05)


def test_few_readings_are_no_mean_of_several() -> None:
    """One rest of 56 samples in a hundred looks like the mean of two."""
    for seed in range(200):
        told = signal(seed, seconds=2.4, rate=80.0)
        assert [channel.averaged for channel in acquisition_of(told, SIGMA)[:3]] == [1, 1, 1], seed


def test_noise_that_wanders_shows_in_short_rests() -> None:
    """60 samples a rest, with a correlation of four."""
    t = clock(1.3, 200.0)
    seen = []
    for seed in range(20):
        wander = 2.0 * coloured(t.size, np.exp(-1.0 / 4.0), seed)
        told = acquisition_of(log_of(t, clean(t) + white(t, seed) + SIGMA * wander[:, None]), SIGMA)
        seen.append(told.voltage.as_white / SIGMA[0])
    assert np.median(seen) > 3.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [0.0, 2.0])
def test_a_voltage_that_rises_before_friction_lets_go_is_no_noise(seed: int, step: float) -> None:
    """The rest lasts until something moves; a voltage drive ramps up in its last 60 ms."""
    log = signal(seed)
    z, rest = log.z.copy(), rests_of(log.t, log.w_cmd)[0]
    up = np.arange(round(0.06 * RATE))
    z[rest.stop - up.size : rest.stop, 0] += 3.0 * SIGMA[0] * up
    z[:, 0] = stepped(z[:, 0], step * SIGMA[0], 0.0) if step else z[:, 0]
    found = traits_of(log_of(log.t, z)).voltage
    assert found.noise_std == pytest.approx(SIGMA[0], rel=0.15)
    assert found.correlation_s is None and found.offset == pytest.approx(0.0, abs=0.5 * SIGMA[0])


@pytest.mark.parametrize("seed", range(5))
def test_a_rest_in_which_a_motor_settles_slowly_is_no_noise(seed: int) -> None:
    """Behind a soft stop what held the motor falls for long, by less at once than shows: that was taken for a filter's colour."""
    log = signal(seed)
    z = log.z.copy()
    for rest in rests_of(log.t, log.w_cmd)[1:]:
        z[rest, 0] += 8.0 * SIGMA[0] * np.linspace(0.5, -0.5, rest.stop - rest.start)
    found = traits_of(log_of(log.t, z)).voltage
    assert found.noise_std == pytest.approx(SIGMA[0], rel=0.15)
    assert found.correlation_s is None


@pytest.mark.parametrize("seed", range(5))
def test_a_rig_that_is_set_up_anew_as_it_stands_has_no_noise_of_that(seed: int) -> None:
    """The motor takes up the load of the new pitch within a few milliseconds."""
    log = signal(seed)
    k = rests_of(log.t, log.w_cmd)[0].stop // 2
    taken_up = 1.0 - np.exp(-np.maximum(log.t - log.t[k], 0.0) / 0.005)
    z, pitch = log.z.copy(), np.where(np.arange(log.t.size) < k, 0.0, 30.0)
    z[:, :2] += 200.0 * SIGMA[:2] * taken_up[:, None]
    found = acquisition_of(replace(log_of(log.t, z), pitch=pitch), SIGMA)
    for c in range(2):
        assert found[c].noise_std == pytest.approx(SIGMA[c], rel=0.15)
        assert found[c].as_white == pytest.approx(SIGMA[c], rel=0.15) and found[c].correlation_s is None


# --- steps ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigmas", [0.5, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("c", range(3))
def test_steps_are_measured_within_five_percent(sigmas: float, c: int) -> None:
    for seed in range(5):
        step = (1.0 + 0.1 * np.random.default_rng([seed, c]).uniform(-1.0, 1.0)) * sigmas * SIGMA[c]
        z = stepped(signal(seed).z[:, c], step, 0.3 * step)
        found = read(z, c)
        assert found.resolution == pytest.approx(step, rel=0.05)
        if sigmas <= 1.0:  # in coarser ones a rest does not show its noise
            assert found.noise_std == pytest.approx(SIGMA[c], rel=0.1)
            assert found.as_white == pytest.approx(np.hypot(SIGMA[c], step / np.sqrt(12.0)), rel=0.1)


def test_rounding_comes_on_top_of_the_usual_noise_wherever_in_a_step_a_rest_lies() -> None:
    """In motion readings go through all of a step: of 40 rests at chance some show four fifths of what they scatter by then."""
    step, usual = 2.44 * SIGMA[2], load_rig()
    least = np.hypot(SIGMA[2], step / np.sqrt(12.0))
    for seed in range(40):
        z = signal(seed).z.copy()
        z[:, 2] = stepped(z[:, 2], step, (seed % 7) / 7.0 * step)
        log = log_of(signal(seed).t, z)
        known = replace(usual, logger=acquisition_of(log, usual.file_noise_std))
        assert known.noise_std[2] == pytest.approx(least, rel=0.25) and known.noise_std[2] >= 0.999 * least


def test_steps_far_below_the_noise_are_not_told() -> None:
    assert read(stepped(signal(1).z[:, 0], 1e-3)).resolution is None


def test_the_step_of_whole_multiples_is_found() -> None:
    rng = np.random.default_rng(1)
    assert resolution_of(0.25 * rng.integers(-6, 7, 400)) == pytest.approx(0.25)
    assert resolution_of(rng.standard_normal(4000)) is None
    assert resolution_of(np.zeros(100)) is None and resolution_of(np.array([np.nan, 1.0])) is None


# --- holds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", [400.0, 100.0, 50.0, 60.0, 33.0, 230.0])
@pytest.mark.parametrize("sigmas", [0.0, 1.0])
def test_the_rate_of_held_readings_is_exact(hz: float, sigmas: float) -> None:
    """Whole and broken numbers of samples a tick, on top of steps; one tick in a log of 4 s is 2e-3 of its rate at 100 Hz."""
    for seed in range(3):
        t = clock(4.0)
        z = clean(t) + white(t, seed)
        for c in (0, 2):
            kept = held(t.size, RATE / hz, seed / 3.0)
            z[:, c] = z[kept, c]
            z[:, c] = stepped(z[:, c], sigmas * SIGMA[c]) if sigmas else z[:, c]
        found = traits_of(log_of(t, z))
        assert found.voltage.update_hz == pytest.approx(hz, rel=1e-4)
        assert found.position.update_hz == pytest.approx(hz, rel=1e-4)
        assert found.current.update_hz is None


def test_missing_rows_do_not_change_the_rate() -> None:
    for seed in range(5):
        log = signal(seed, 4.0)
        log.z[:, 2] = log.z[held(log.t.size, RATE / 60.0), 2]
        kept = np.random.default_rng(seed).random(log.t.size) > 0.03
        found = traits_of(
            replace(log, t=log.t[kept], z=log.z[kept], w_cmd=log.w_cmd[kept], pitch=log.pitch[kept])
        )
        assert found.position.update_hz == pytest.approx(60.0, rel=1e-4)


def test_the_noise_of_a_held_channel_is_that_of_its_fresh_readings() -> None:
    log = signal(2, 6.0)
    log.z[:, 2] = log.z[held(log.t.size, 16.0), 2]
    assert traits_of(log).position.noise_std == pytest.approx(
        SIGMA[2], rel=0.25
    )  # 270 of them: 4.3 % is one sigma


@pytest.mark.parametrize("sigmas", [1.0, 3.0, 200.0])
def test_coarse_steps_are_no_hold(sigmas: float) -> None:
    for seed in range(5):
        z = stepped(signal(seed).z[:, 2], sigmas * SIGMA[2], 0.4 * sigmas * SIGMA[2])
        assert read(z, 2).update_hz is None


def test_nor_are_steps_that_come_regularly_at_constant_speed() -> None:
    """0.9 mm/s in steps of 0.3 mm: three a second, and none at rest, where a hold would still tick."""
    for seed in range(5):
        assert read(stepped(signal(seed).z[:, 2], 0.3e-3, 0.12e-3), 2).update_hz is None


# --- lines ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("hz", [16.7, 50.03, 60.0, 137.2, 400.4])
def test_a_line_is_measured(hz: float) -> None:
    for seed in range(5):
        size = 0.04 * (1.0 + 0.1 * seed)
        z = signal(seed).z[:, 0] + size * np.sin(2.0 * np.pi * hz * clock() + seed)
        found = read(z)
        (line,) = found.lines
        assert line.hz == pytest.approx(hz, abs=0.2) and line.amplitude == pytest.approx(size, rel=0.15)
        assert found.noise_std == pytest.approx(SIGMA[0], rel=0.1) and found.correlation_s is None


def test_harmonics_are_lines_of_their_own() -> None:
    for seed in range(5):
        angle = 2.0 * np.pi * 59.97 * clock() + seed
        z = signal(seed).z[:, 0] + 0.04 * np.sin(angle) + 0.016 * np.sin(3.0 * angle + 1.0)
        lines = sorted(read(z).lines)
        assert [line.hz for line in lines] == pytest.approx([59.97, 179.91], abs=0.2)
        assert [line.amplitude for line in lines] == pytest.approx([0.04, 0.016], rel=0.15)


def noise_of(kind: str, n: int, seed: int) -> np.ndarray:
    if kind == "white":
        return np.random.default_rng(seed).standard_normal(n)
    if kind == "averaged":
        return np.convolve(np.random.default_rng(seed).standard_normal(n + 31), np.ones(32), "valid") / 32
    return coloured(n, {"coloured": 0.75, "wandering": 0.97}[kind], seed)


@pytest.mark.parametrize("kind", ["white", "coloured", "wandering", "averaged"])
def test_noise_has_no_lines(kind: str) -> None:
    """200 rests of 0.7 s. One in a hundred shows a line that is none, of a mean of samples one in fifty; all are faint."""
    t = clock(0.7)
    found = [lines_of([(t, noise_of(kind, t.size, seed))])[0] for seed in range(200)]
    assert sum(bool(lines) for lines in found) <= (9 if kind == "averaged" else 6)  # 1 % chance of more
    assert all(line.amplitude < 0.2 for lines in found for line in lines)


# --- colour and averages -------------------------------------------------------------------------


@pytest.mark.parametrize("keep", [0.5, 0.75, 0.9])
def test_the_correlation_time_of_coloured_noise(keep: float) -> None:
    true, n = -1.0 / RATE / np.log(keep), clock().size
    times, factors = [], []
    for seed in range(10):
        found = read(clean(clock())[:, 0] + SIGMA[0] * coloured(n, keep, seed))
        assert found.correlation_s is not None
        times.append(found.correlation_s)
        factors.append((found.as_white / found.noise_std) ** 2)
    assert np.all(np.array(times) > true / 1.6) and np.all(np.array(times) < 1.6 * true)
    density = (1.0 + keep) / (1.0 - keep)  # at frequency zero, of noise of unit variance
    assert np.median(factors) == pytest.approx(density, rel=0.3)


def test_a_mean_of_samples_is_known_as_one() -> None:
    t = clock()
    for seed in range(10):
        noise = np.random.default_rng(seed).standard_normal(t.size + 31)
        found = read(clean(t)[:, 2] + SIGMA[2] * np.convolve(noise, np.ones(32) / 32, "valid"), 2)
        assert found.averaged == 32 and not found.lines
        assert found.correlation_s == pytest.approx(16.0 / RATE, rel=1.0)


# --- spikes --------------------------------------------------------------------------------------


def test_spikes_at_rest_are_counted_and_left_out() -> None:
    log = signal(11)
    at = np.flatnonzero(log.t < 0.64)[40::150]
    log.z[at, 0] += 50.0 * SIGMA[0]
    found = traits_of(log).voltage
    assert found.spikes == at.size and found.noise_std == pytest.approx(SIGMA[0], rel=0.1)
    assert plain(found)


# --- the clock -----------------------------------------------------------------------------------


def test_jitter_is_measured() -> None:
    t = clock()
    for seed in range(10):
        jitter = 0.05 / RATE
        found = clock_of(t + jitter * np.random.default_rng(seed).standard_normal(t.size))
        assert found.jitter_s == pytest.approx(jitter, rel=0.15) and found.resolution_s is None


def test_stamps_rounded_to_a_millisecond() -> None:
    found = clock_of(np.round(clock(3.0, 800.0), 3))
    assert found.resolution_s == pytest.approx(1e-3, rel=0.05)
    assert found.interval_s == pytest.approx(1.0 / 800.0, rel=1e-3)


@pytest.mark.parametrize("share", [0.005, 0.03])
@pytest.mark.parametrize("rate", [400.0, 640.0, 800.0])
def test_stamps_are_rounded_where_rows_are_missing_too(rate: float, share: float) -> None:
    """The median of what is left between stamps is a millisecond, and what is not looks like gaps."""
    for seed in range(4):
        t = np.round(clock(3.0, rate), 3)
        found = clock_of(t[np.random.default_rng(seed).random(t.size) >= share])
        assert found.resolution_s == pytest.approx(1e-3, rel=0.05), seed
        assert found.interval_s == pytest.approx(1.0 / rate, rel=1e-3)


@pytest.mark.parametrize("rate", [100.0, 200.0, 250.0, 500.0])
def test_exact_stamps_with_rows_missing_are_not_rounded(rate: float) -> None:
    """They are whole milliseconds, and no more than that."""
    for seed in range(6):
        t = clock(3.0, rate)
        for share in (0.01, 0.03, 0.1):
            found = clock_of(t[np.random.default_rng(seed).random(t.size) >= share])
            assert found.resolution_s is None and found.interval_s == pytest.approx(1.0 / rate), (seed, share)


@pytest.mark.parametrize("every", [2.0, 8.0])
def test_a_hold_is_counted_in_rows_of_rounded_stamps(every: float) -> None:
    """Two rows of 800 Hz are 2 ms apart, or 3 ms."""
    t = clock(3.0, 800.0)
    for seed in range(4):
        z = (clean(t) + white(t, seed))[held(t.size, every)]
        told = traits_of(log_of(np.round(t, 3), z))
        assert [told[c].update_hz for c in range(3)] == pytest.approx([800.0 / every] * 3, rel=1e-3)
        assert told.voltage.averaged == 1


def test_another_range_is_no_motor_that_settles() -> None:
    """Six times the noise in the later rest, which is as short as the first: it counts all the same."""
    t = clock(2.4, 100.0)
    for seed in range(10):
        z = clean(t) + np.where(t > 1.2, 6.0, 1.0)[:, None] * white(t, seed)
        assert 4.0 < read(z[:, 1], 1, t).grown < 8.0, seed


@pytest.mark.parametrize(("hz", "sigmas"), [(50.0, 5.0), (60.0, 4.0), (137.0, 6.0)])
def test_hum_that_begins_midway_is_noise_and_a_drift_is_none(hz: float, sigmas: float) -> None:
    """Something beside the logger is switched on: every sample counts as if it were there from the first one on."""
    t = clock(2.4)
    for seed in range(8):
        noise = white(t, seed)[:, 1]
        sigma, late = float(noise.std()), t > 1.2
        hum = np.where(late, sigmas * sigma * np.sin(2.0 * np.pi * hz * t + seed), 0.0)
        found = read(clean(t)[:, 1] + noise + hum, 1, t)
        assert found.grown == pytest.approx(np.hypot(1.0, sigmas), rel=0.15), seed
        drift = np.where(late, sigmas * sigma * (t - 1.2), 0.0)
        assert read(clean(t)[:, 1] + noise + drift, 1, t).grown == 1.0, seed


@pytest.mark.parametrize(("rate", "seconds"), [(100.0, 3.0), (1600.0, 2.4)])
def test_another_range_of_a_held_reading_is_told(rate: float, seconds: float) -> None:
    """From 36 to 70 fresh readings a rest; none is told of the same logger without it."""
    t = clock(seconds)
    for seed in range(20):
        noise = white(t, seed)[:, 2]
        for later, told in ((4.0, True), (1.0, False)):
            z = (clean(t)[:, 2] + np.where(t > 1.2, later, 1.0) * noise)[held(t.size, RATE / rate)]
            found = read(z, 2, t).grown
            assert (2.0 < found < 8.0) if told else found == 1.0, (seed, found)


def without(share: float, seed: int) -> np.ndarray:
    """A clock with this share of the rows missing."""
    t = clock()
    return t[np.random.default_rng(seed).random(t.size) >= share]


def test_a_gap_now_and_then_is_neither_jitter_nor_rounding() -> None:
    for seed in range(10):
        found = clock_of(without(0.01, seed))
        assert found.jitter_s == 0.0 and found.resolution_s is None
        assert found.interval_s == pytest.approx(1.0 / RATE)


def test_nor_are_three_missing_rows_in_a_hundred() -> None:
    for seed in range(10):
        found = clock_of(without(0.03, seed))
        assert found.jitter_s == 0.0 and found.resolution_s is None
        assert found.interval_s == pytest.approx(1.0 / RATE)


def test_a_clock_of_few_samples_tells_nothing() -> None:
    assert clock_of(clock()[:50])[:2] == (0.0, None)
    assert Acquisition._fields[:3] == CHANNELS


@pytest.mark.parametrize("seed", range(4))
def test_rows_in_which_nothing_was_read_change_no_trait(seed: int) -> None:
    """A logger that leaves cells of a row empty holds its readings as long as one that leaves out the row."""
    log = signal(seed)
    log = replace(log, z=log.z[held(log.t.size, 4.0)])
    lost = np.flatnonzero(np.random.default_rng(seed).random(log.t.size) < 0.03)
    empty = log.z.copy()
    empty[lost] = np.nan
    rows = np.setdiff1d(np.arange(log.t.size), lost)
    told, without = traits_of(replace(log, z=empty)), traits_of(log.part(rows))
    assert told == without
    assert told.voltage.update_hz == pytest.approx(400.0, rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_spikes_on_slopes_are_left_out_too_and_corners_are_not(seed: int) -> None:
    """Of a current that rings by tens of its noise from one sample to the next, and that begins at once."""
    rng = np.random.default_rng(seed)
    t = clock(3.0)
    since = np.maximum(t - 0.7, 0.0)
    z = clean(t) + white(t, seed)
    z[:, 1] += 0.5 * np.sin(140.0 * since) * np.exp(-since / 0.3)
    at = np.sort(rng.choice(np.arange(1200, 2600, 40), 20, replace=False))
    spoiled = z.copy()
    spoiled[at, 1] += rng.choice([-1.0, 1.0], at.size) * rng.uniform(40.0, 100.0, at.size) * SIGMA[1]
    log = log_of(t, spoiled)
    told = traits_of(log)
    assert told.current.spikes > 0
    left_out = np.flatnonzero(np.isnan(without_spikes(log, told).z[:, 1]))
    assert set(at) <= set(left_out) and left_out.size <= at.size + 2
    assert np.isfinite(without_spikes(log_of(t, z), told).z[1118:1124, 1]).all()


def with_motion(seed: int, c: int, times: np.ndarray) -> Log:
    """A signal whose noise in channel c is `times` (n,) the usual."""
    log = signal(seed)
    extra = np.sqrt(np.maximum(times**2 - 1.0, 0.0)) * SIGMA[c]
    z = log.z.copy()
    z[:, c] += extra * np.random.default_rng([seed, 5]).normal(size=log.t.size)
    return replace(log, z=z)


@pytest.mark.parametrize("times", [2.0, 5.0, 15.0])
@pytest.mark.parametrize("c", range(3))
def test_noise_that_comes_with_the_motion_is_told(c: int, times: float) -> None:
    for seed in range(10):
        found = traits_of(with_motion(seed, c, np.where(np.abs(command(signal(seed).t)) > 0.0, times, 1.0)))
        assert found[c].moving == pytest.approx(times, rel=0.25)
        assert found[c].as_white == pytest.approx(times * SIGMA[c], rel=0.3)
        assert [traits.moving for k, traits in enumerate(found[:3]) if k != c] == [1.0, 1.0]


@pytest.mark.parametrize("hz", [137.0, 410.0])
def test_a_line_that_comes_with_the_motion_is_noise_of_its_size(hz: float) -> None:
    """What is left of a converter's pulses, three times the noise; a ring of the servo beside it is none of it."""
    for seed in range(5):
        log = signal(seed)
        moving, t = log.w_cmd > 0.0, log.t
        line = 3.0 * np.sin(2.0 * np.pi * hz * t + seed)
        ring = 20.0 * np.exp(-(t - 0.74) / 0.05) * np.sin(2.0 * np.pi * 22.0 * t)
        log.z[:, 1] += SIGMA[1] * np.where(moving, line + np.where(t > 0.74, ring, 0.0), 0.0)
        found = traits_of(log)
        assert found.current.moving == pytest.approx(np.hypot(1.0, 3.0), rel=0.2)
        assert found.voltage.moving == found.position.moving == 1.0
        log.z[t < 1.05, 1] -= SIGMA[1] * np.where(moving, line, 0.0)[t < 1.05]  # it begins on the way
        assert traits_of(log).current.moving == 1.0


def test_noise_that_begins_on_the_way_is_no_trait() -> None:
    for seed in range(20):
        t = signal(seed).t
        begun = t[np.flatnonzero(command(t))[0]] + 0.4
        assert traits_of(with_motion(seed, 1, np.where(t > begun, 8.0, 1.0))).current.moving == 1.0


def test_noise_that_stays_behind_the_motion_is_no_trait() -> None:
    for seed in range(20):
        t = signal(seed).t
        begun = t[np.flatnonzero(command(t))[0]] + 0.002
        assert traits_of(with_motion(seed, 1, np.where(t > begun, 8.0, 1.0))).current.moving == 1.0


def test_a_rest_without_noise_or_of_few_readings_tells_of_none_in_motion() -> None:
    log = with_motion(3, 2, np.full(signal(3).t.size, 3.0))
    rest = np.abs(command(log.t)) == 0.0
    still, few = log.z.copy(), log.z.copy()
    still[rest, 2] = 0.0
    few[rest & (np.arange(log.t.size) % 60 > 0), 2] = np.nan
    for z in (still, few):
        for usual in (SIGMA, np.zeros(3)):
            assert acquisition_of(replace(log, z=z), usual).position.moving == 1.0
