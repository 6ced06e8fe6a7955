"""Logs of many samples a second, whose rows are judged several at once: nothing that a verdict needs is lost or made up."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import RIG

from observer_fi.logs import Thinner, acquisition_of, thinned
from observer_fi.records import Log

SIGMA = np.array([10e-3, 300e-6, 10e-6])  # V, A, m
SPEED = 120.0  # rad/s
START_S, RAMP_S = 0.5, 0.01


def fast(rate_hz: float, seed: int = 1, seconds: float = 1.0, noise: float = 1.0) -> Log:
    """A start from rest with white noise."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    w = SPEED * np.clip((t - START_S) / RAMP_S, 0.0, 1.0)
    z = np.column_stack((0.02 * w, 6e-5 * w, 5e-6 * np.cumsum(w) / rate_hz))
    z += noise * SIGMA * np.random.default_rng(seed).standard_normal(z.shape)
    return Log("fast", t, z, w, np.full(t.size, 3.0))


def with_channel(log: Log, c: int, y: np.ndarray) -> Log:
    z = log.z.copy()
    z[:, c] = y
    return replace(log, z=z)


def judged(log: Log) -> Log:
    """The rows that a verdict takes of a log."""
    return Thinner(log, RIG).of(log)


@pytest.mark.parametrize(
    ("rate_hz", "rows"),
    [(100.0, 1), (1600.0, 1), (3200.0, 1), (4799.0, 1), (4800.0, 3), (9600.0, 5), (20e3, 11), (50e3, 31)],
)
def test_rows_are_taken_together_where_there_are_many(rate_hz: float, rows: int) -> None:
    assert Thinner(fast(rate_hz), RIG).rows == rows


def test_a_log_of_few_samples_a_second_stays_as_it_is() -> None:
    log = fast(1600.0)
    assert judged(log) is log
    assert Thinner(log, RIG).told() == ()


@pytest.mark.parametrize("rate_hz", [4800.0, 10e3, 48e3])
def test_white_noise_averages_out_and_motion_stays(rate_hz: float) -> None:
    rows = Thinner(fast(rate_hz), RIG).rows
    few = judged(fast(rate_hz))
    exact = fast(rate_hz, noise=0.0)
    at = np.searchsorted(exact.t, few.t)
    assert (few.t == exact.t[at]).all()
    assert (few.w_cmd == exact.w_cmd[at]).all()
    steady = (few.t < START_S - 0.01) | (few.t > START_S + RAMP_S + 0.01)
    off = (few.z - exact.z[at])[steady]
    assert off.std(axis=0) == pytest.approx(SIGMA / np.sqrt(rows), rel=0.15)
    assert np.abs(off.mean(axis=0)) == pytest.approx(0.0, abs=4.0 * (SIGMA / np.sqrt(exact.t.size)).max())


@pytest.mark.parametrize("rate_hz", [4800.0, 9600.0, 48e3])
def test_a_thinned_log_is_not_thinned_again(rate_hz: float) -> None:
    few = judged(fast(rate_hz))
    assert judged(few) is few


def test_held_readings_and_coarse_steps_are_read_once() -> None:
    """A mean of them is a reading that no logger made: neither its hold nor its step would be found."""
    log = fast(9600.0)
    rows = np.arange(log.t.size)
    log = with_channel(log, 2, log.z[rows // 96 * 96, 2])
    log = with_channel(log, 1, np.round(log.z[:, 1] / 1e-3) * 1e-3)
    few, seen = judged(log), acquisition_of(judged(log), RIG.file_noise_std)
    assert np.isin(few.z[:, 1:], log.z[:, 1:]).all()
    assert not np.isin(few.z[:, 0], log.z[:, 0]).any()
    assert seen.position.update_hz == pytest.approx(100.0, rel=1e-3)
    assert seen.current.resolution == pytest.approx(1e-3)


def test_a_spike_is_in_no_mean() -> None:
    log = fast(9600.0)
    at = np.arange(40, 4000, 200)
    spiked = log.z.copy()
    spiked[at, 1] += 100.0 * SIGMA[1]
    few = judged(replace(log, z=spiked))
    assert np.abs(few.z[:, 1] - judged(log).z[:, 1]).max() < 3.0 * SIGMA[1]


def test_readings_that_are_missing_are_in_no_mean() -> None:
    log = fast(9600.0, noise=0.01)
    holes = log.z.copy()
    holes[2::5, 1] = np.nan
    holes[1000:1010] = np.nan
    few = judged(replace(log, z=holes))
    assert np.isnan(few.z).any(axis=1).sum() in (1, 2)
    rest = few.t < START_S - 0.01
    assert np.nanmax(np.abs(few.z[rest, 1])) < 0.1 * SIGMA[1]


@pytest.mark.parametrize("gap", [4, 100, 5000])
def test_no_row_goes_on_over_a_gap(gap: int) -> None:
    log = fast(9600.0, noise=0.0)
    kept = np.r_[0:5003, 5003 + gap : log.t.size]
    few = judged(log.part(kept))
    assert (np.diff(few.t) > 0.0).all()
    at = np.searchsorted(log.t, few.t)
    flat = np.abs(few.t - START_S - 0.5 * RAMP_S) > RAMP_S
    assert few.z[flat, 0] == pytest.approx(log.z[at, 0][flat], abs=1e-9)


def test_a_sensor_that_stands_still_stands_still() -> None:
    log = fast(9600.0)
    frozen = log.z.copy()
    frozen[6000:] = frozen[6000]
    few = judged(replace(log, z=frozen))
    assert (np.diff(few.z[few.t > log.t[6010]], axis=0) == 0.0).all()


def test_it_is_said_what_was_done() -> None:
    log = fast(9600.0)
    log = with_channel(log, 2, np.round(log.z[:, 2] / 1e-4) * 1e-4)
    (note,) = judged(log).notes
    assert note == (
        "9600 samples a second: 5 rows are judged as one (means of voltage_v, current_a; of other columns the middle one)"
    )


def test_a_rig_without_a_motor_is_read_as_it_is() -> None:
    log = fast(9600.0)
    assert thinned(log, replace(RIG, drive="force")) is log
