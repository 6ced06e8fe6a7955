"""What fits take of readings: all of them from an ideal logger, of others what is new, in time, and driven.

The loggers are those of the independent truth.
"""

import math
from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG, log_of
from logged_signals import SIGMA

from observer_fi.learn.fit_readings import (
    in_time,
    readings_to_fit,
    without_drive_off,
    without_late_updates,
)
from observer_fi.logs.ingest import log_from_frame
from observer_fi.records import Acquisition, ChannelTraits, Clock, Filter, Log

PROFILE = hidden.there_and_back((410.0, 200.0), (0.4, 0.4), (0.0, 8.0), first_start_s=0.4, rest_s=0.5)
PLAIN = ChannelTraits(0.0, 0.0)


def through(trait: str, seed: int, profile: hidden.Profile = PROFILE) -> Log:
    return log_from_frame(hidden.make_log_with(trait, hidden.TruthSpec(profile), seed)[0])


def truth_at(log: Log, profile: hidden.Profile = PROFILE) -> np.ndarray:
    """(n, 3) readings without noise at a log's own times."""
    fine = hidden.make_log(hidden.without_noise(hidden.TruthSpec(profile)), 0)[0]
    columns = ("voltage_v", "current_a", "position_m")
    return np.column_stack([np.interp(log.t, fine["time_s"], fine[name]) for name in columns])


def logger(**position: object) -> Acquisition:
    return Acquisition(PLAIN, PLAIN, PLAIN._replace(**position), Clock(0.0, None, 1.0 / 1600.0))


# --- as they are ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_of_an_ideal_logger_every_reading_is_taken(seed: int) -> None:
    logs = [log_of(PROFILE, seed=seed), log_of(PROFILE, seed=seed + 10)]
    found = readings_to_fit(logs, RIG)
    for log, taken in zip(logs, found.logs, strict=True):
        other = taken.z != log.z
        assert other.sum() <= 2 and np.isnan(taken.z[other]).all()  # noise now and then looks like a spike
        np.testing.assert_array_equal(taken.t, log.t)
    assert (found.hum_hz, found.older_s) == ((), 0.0)
    np.testing.assert_array_equal(found.jitter_s, np.zeros((2, 3)))
    np.testing.assert_allclose(found.noise, SIGMA, rtol=0.1)


def test_logs_are_not_written_to() -> None:
    log = through("hum_50hz+spikes+missing_rows+drive_off", 1)
    before = log.z.copy()
    readings_to_fit([log], RIG)
    np.testing.assert_array_equal(log.z, before)


# --- the clock -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_every_log_has_its_own_jitter(seed: int) -> None:
    spec = hidden.TruthSpec(PROFILE)
    frame, truth = hidden.make_log_with("jitter", spec, seed)
    logs = [log_of(PROFILE, seed=seed), log_from_frame(frame)]
    still, jitter = readings_to_fit(logs, RIG).jitter_s
    assert not still.any()
    np.testing.assert_allclose(jitter, truth["acquisition"]["clock"]["jitter_s"], rtol=0.1)


@pytest.mark.parametrize("trait", ["ideal", "jitter"])
def test_a_channel_that_was_behind_a_filter_is_off_in_time_besides(trait: str) -> None:
    """By a tenth of a sample, whatever the clock is off."""
    log = through(trait, 5)
    told = (Filter("current", 30.0, 1, 0.4), Filter("position", math.inf, 1, 2.0))
    plain, besides = (readings_to_fit([log], RIG, filters).jitter_s[0] for filters in ((), told))
    doubt = 0.1 / log.rate_hz
    np.testing.assert_allclose(besides, np.hypot(plain, [0.0, doubt, doubt]))


@pytest.mark.parametrize("seed", range(3))
def test_stamps_that_were_rounded_are_even_and_jitter_no_more(seed: int) -> None:
    log = through("milliseconds", seed)
    found = readings_to_fit([log], RIG)
    assert np.ptp(np.diff(log.t)) > 0.9e-3 and np.ptp(np.diff(found.logs[0].t)) < 1e-9
    assert np.abs(found.logs[0].t - np.arange(log.t.size) / 800.0).max() < 0.51e-3
    assert not found.jitter_s[0].any()


# --- held readings -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_one_converter_for_the_drive_makes_both_older(seed: int) -> None:
    found = readings_to_fit([log_of(PROFILE, seed=seed), through("drive_400hz", seed)], RIG)
    assert found.older_s == pytest.approx(1.0 / 1600.0)
    taken = np.isfinite(found.logs[1].z).mean(axis=0)
    assert taken[:2] == pytest.approx(0.25, abs=0.02) and taken[2] == 1.0


@pytest.mark.parametrize("held", ["position", "voltage", "current"])
def test_one_held_channel_alone_makes_none_older(held: str) -> None:
    log = log_of(PROFILE, seed=4)
    c = hidden.CHANNELS.index(held)
    z = log.z.copy()
    z[:, c] = z[np.arange(log.t.size) // 4 * 4, c]
    found = readings_to_fit([replace(log, z=z)], RIG)
    assert np.isnan(found.logs[0].z[:, c]).mean() == pytest.approx(0.75, abs=0.02)
    assert found.older_s == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_an_update_behind_an_unread_row_may_have_come_before_it(seed: int) -> None:
    log = log_of(PROFILE, seed=seed)
    unread = np.random.default_rng(seed).random(log.t.size) < 0.05
    fresh = replace(log, z=np.where(unread[:, None], np.nan, log.z))
    out = without_late_updates(fresh, fresh, logger(update_hz=100.0))
    behind = np.append(False, unread[:-1])
    np.testing.assert_array_equal(np.isnan(out.z[:, 2]), unread | behind)
    np.testing.assert_array_equal(out.z[:, :2], fresh.z[:, :2])
    kept = ~(unread | behind)
    np.testing.assert_array_equal(out.z[kept], log.z[kept])


def test_without_unread_rows_or_held_channels_no_update_is_late() -> None:
    log = log_of(PROFILE, seed=6)
    assert without_late_updates(log, log, logger(update_hz=100.0)) is log
    z = log.z.copy()
    z[::7] = np.nan
    holed = replace(log, z=z)
    assert without_late_updates(holed, holed, logger()) is holed
    z[::7, 0] = 1.0  # one channel was read: its row is none that is missing
    read = replace(log, z=z)
    assert without_late_updates(read, read, logger(update_hz=100.0)) is read


# --- means of samples ----------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [400.0, 1600.0])
@pytest.mark.parametrize("samples", [4, 5, 32])
def test_a_mean_of_samples_stands_at_their_middle(rate: float, samples: int) -> None:
    every = np.sin(0.03 * np.arange(400))
    means = np.convolve(every, np.ones(samples) / samples)[: every.size]
    t = np.arange(every.size) / rate
    log = Log("means", t, np.column_stack((every, every, means)), np.zeros(t.size), np.zeros(t.size))
    out = in_time(log, logger(averaged=samples))
    np.testing.assert_array_equal(out.z[:, :2], log.z[:, :2])
    inside = slice(samples + 3, t.size - samples)  # the mean begins with a kink
    smaller = np.sinc(0.015 * samples / np.pi) / np.sinc(0.015 / np.pi)  # what a mean leaves of a wave
    np.testing.assert_allclose(out.z[inside, 2], smaller * every[inside], atol=1e-5)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_nothing_averaged_is_the_very_log(samples: int) -> None:
    """Nor are means of a few, which are the colour of noise as often."""
    log = log_of(PROFILE, seed=5)
    assert in_time(log, logger(averaged=samples)) is log


@pytest.mark.parametrize("seed", range(4))
def test_an_averaged_position_is_where_the_mass_was(seed: int) -> None:
    """Half of 32 samples at 410 rad/s are 7.5 um."""
    log = through("position_averaged", seed)
    taken = readings_to_fit([log], RIG).logs[0].z[:, 2]
    true = truth_at(log)[:, 2]
    fast = log.w_cmd == 410.0
    late, left = np.mean(log.z[fast, 2] - true[fast]), np.mean(taken[fast] - true[fast])
    assert late < -6e-6
    assert abs(left) < 1.5e-6  # of 500 readings, of which a dozen are independent: 0.5 um


# --- a drive that is off -------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_that_is_off_says_nothing_of_voltage_and_current(seed: int) -> None:
    """Nor before the first move, where nothing is commanded yet and the servo may as well hold."""
    log = through("drive_off", seed)
    taken = readings_to_fit([log], RIG).logs[0]
    move = np.flatnonzero(log.w_cmd != 0.0)
    last = np.maximum.accumulate(np.where(log.w_cmd != 0.0, log.t, -np.inf))
    off = (log.w_cmd == 0.0) & (log.t - last > 0.06)  # 50 ms later, and the tick at which it happens
    assert off[: move[0] - 2].all()
    assert np.isnan(taken.z[off, :2]).mean() > 0.9  # noise of four standard deviations cuts a rest in two
    assert np.isfinite(taken.z[log.w_cmd != 0.0]).all()
    np.testing.assert_array_equal(taken.z[:, 2], log.z[:, 2])


@pytest.mark.parametrize("before_s", [0.01, 0.03])
def test_one_reading_far_off_does_not_switch_a_drive_on(before_s: float) -> None:
    """Of a rest what is left behind it is too short to be a rest: the start after it would begin from a current of zero."""
    log = through("drive_off", 1)
    starts = np.flatnonzero((log.w_cmd[1:] != 0.0) & (log.w_cmd[:-1] == 0.0))
    z = log.z.copy()
    z[starts - round(before_s * log.rate_hz), 1] = 5.0 * SIGMA[1]
    taken = readings_to_fit([replace(log, z=z)], RIG).logs[0]
    last = np.add.outer(starts, np.arange(-3, -round(0.05 * log.rate_hz), -1))
    assert np.isnan(taken.z[last, :2]).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_servo_that_holds_is_on_before_its_first_move_too(seed: int) -> None:
    """Its current is zero there, for nothing has moved yet."""
    profile = hidden.single_move(410.0, 0.5, pitch_deg=4.0)
    log = log_of(profile, seed=seed)
    assert abs(log.z[: round(0.3 * log.rate_hz), 1].mean()) < 1e-4
    np.testing.assert_array_equal(readings_to_fit([log], RIG).logs[0].z, log.z)


@pytest.mark.parametrize("seconds, off", [(0.04, False), (0.07, True)])
@pytest.mark.parametrize("rate", [400.0, 1600.0])
def test_short_zeros_are_no_drive_that_is_off(seconds: float, off: bool, rate: float) -> None:
    t = np.arange(round(0.6 * rate)) / rate
    w = np.where((t > 0.1) & (t < 0.3), 300.0, 0.0)
    z = np.ones((t.size, 3))
    z[(t > 0.4) & (t < 0.4 + seconds)] = 0.0
    log = Log("zeros", t, z, w, np.zeros(t.size))
    taken = without_drive_off(log, logger())
    assert np.isnan(taken.z[:, :2]).any() == off and np.isfinite(taken.z[:, 2]).all()
    assert (taken is log) != off
