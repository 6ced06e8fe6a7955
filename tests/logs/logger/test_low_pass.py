"""Readings without a filter are what went into it, chunk by chunk and as a whole log; a rig file carries its corner."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged_signals import RATE, log_of, signal
from scipy.signal import butter, lfilter, lfilter_zi

from observer_fi.logs.logger.acquisition import with_logger
from observer_fi.logs.logger.low_pass import (
    TIMED,
    LowPass,
    LowPasses,
    Unfiltered,
    earlier,
    filtered_logger,
    timing_doubt,
    told_filter,
    unfiltered,
)
from observer_fi.physics.rigs import load_rig, rig_toml
from observer_fi.records import Filter

NONE = LowPasses()


@given(st.floats(2.0, 300.0), st.sampled_from([1, 2]), st.lists(st.integers(1, 60), min_size=1, max_size=4))
def test_what_went_into_a_filter_comes_back_chunk_by_chunk(hz: float, order: int, cuts: list[int]) -> None:
    log = signal()
    now, once, twice = LowPass(hz, order).weights(1.0 / RATE)
    assert now + once + twice == pytest.approx(1.0)
    z = log.z.copy()
    poles = np.array([now, once, twice]) / now
    z[:, 1] = log.z[0, 1] + lfilter([1.0 / now], poles, log.z[:, 1] - log.z[0, 1])
    back = Unfiltered(NONE.of((1,), LowPass(hz, order)), 1.0 / RATE)
    through = replace(log, z=z)
    edges = [0, *np.cumsum(cuts).tolist(), log.t.size]
    parts = [
        back.take(through.part(slice(a, b))).z for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a
    ]
    np.testing.assert_allclose(np.concatenate(parts), log.z, rtol=1e-6, atol=1e-9)


def test_behind_a_gap_nothing_is_known() -> None:
    log = signal()
    kept = np.ones(log.t.size, dtype=bool)
    kept[100:110] = False
    gap = log_of(log.t[kept], log.z[kept])
    out = Unfiltered(NONE.of((1,), LowPass(30.0, 2)), 1.0 / RATE).take(gap).z
    assert np.flatnonzero(np.isnan(out[:, 1])).tolist() == [100, 101] and np.isfinite(out[:, [0, 2]]).all()


def test_without_a_filter_nothing_is_touched() -> None:
    log = signal()
    assert Unfiltered(NONE, 1.0 / RATE).take(log) is log
    assert unfiltered(log, ()) is log


@pytest.mark.parametrize("order", [1, 2])
def test_a_whole_log_is_set_right_in_time(order: int) -> None:
    """Behind a filter that is slow for its samples, such as an amplifier's, what is left is within a percent of the signal."""
    log = signal()
    b, a = butter(order, 30.0, fs=RATE)
    smooth = np.sin(2.0 * np.pi * 8.0 * log.t)
    z = log.z.copy()
    z[:, 1] = lfilter(b, a, smooth, zi=lfilter_zi(b, a) * smooth[0])[0]
    own = LowPass(30.0, order)
    back = unfiltered(replace(log, z=z), (Filter("current", 30.0, order, own.left(1.0 / RATE)),)).z[:, 1]
    inside = slice(100, -10)
    np.testing.assert_allclose(back[inside], smooth[inside], atol=0.01)
    np.testing.assert_array_equal(
        unfiltered(replace(log, z=z), (Filter("current", 30.0, order),)).z[:, [0, 2]], z[:, [0, 2]]
    )


def test_a_rig_file_carries_the_corner(tmp_path: Path) -> None:
    rig = load_rig()
    told = (Filter("current", 30.0, 1, 0.5),)
    assert filtered_logger(rig, told, RATE) is rig
    learned = filtered_logger(with_logger(rig, [signal()]), told, RATE)
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(learned))
    again = load_rig(path)
    assert again.logger is not None and again.logger.current.low_pass_hz == 30.0
    assert again.logger.voltage.low_pass_hz is None
    assert told_filter(told[0]).startswith("current_a comes through a low-pass filter of 30 Hz, of order 1")


@pytest.mark.parametrize("rate, late", [(1600.0, 0.25), (200.0, 0.6), (1000.0, 15.5)])
def test_readings_are_taken_for_earlier_by_a_polynomial(rate: float, late: float) -> None:
    t = 3.0 + np.arange(400) / rate
    curve = np.polynomial.Polynomial([0.3, -2.0, 5.0, 40.0], domain=[t[0], t[-1]], window=[-1.0, 1.0])
    moved = earlier(t, curve(t), late / rate)
    within = t + late / rate <= t[-1]
    np.testing.assert_allclose(moved[within], curve(t + late / rate)[within], atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_corner_between_samples_is_left_out_and_noise_is_not(seed: int) -> None:
    t = np.arange(3000) / 1600.0
    noise = np.random.default_rng(seed).normal(0.0, 3e-4, t.size)
    y = np.maximum(t - 1.0003, 0.0) * 60.0
    moved = earlier(t, y + noise, 0.25 / 1600.0)
    assert np.isnan(moved[-1])  # nothing is known behind the last
    left_out = np.flatnonzero(np.isnan(moved[:-1]))
    assert left_out.size <= 6 and abs(t[left_out] - 1.0003).max() < 4.0 / 1600.0
    error = moved - np.maximum(t + 0.25 / 1600.0 - 1.0003, 0.0) * 60.0
    assert np.nanmax(np.abs(error)) < 6.0 * 3e-4


def test_missing_readings_stay_missing() -> None:
    t = np.arange(100) / 1600.0
    y = np.sin(t)
    y[40] = np.nan
    moved = earlier(t, y, 0.25 / 1600.0)
    assert set(np.flatnonzero(np.isnan(moved))) == {38, 39, 40, 41, 99}


def test_only_channels_behind_a_filter_may_be_off_in_time() -> None:
    np.testing.assert_array_equal(timing_doubt([Filter("current", 30.0, 1, 0.2)]), [0.0, TIMED, 0.0])
    np.testing.assert_array_equal(timing_doubt([]), np.zeros(3))


# --- readings that are only late -------------------------------------------------------------------


def late_only(samples: float, channel: str = "current") -> Filter:
    return Filter(channel, math.inf, 1, samples)


@pytest.mark.parametrize("rate", [400.0, 1600.0])
@pytest.mark.parametrize("samples", [0.25, 1.0, 2.6, 7.0])
@pytest.mark.parametrize("channel", ["voltage", "current", "position"])
def test_a_late_channel_is_set_right_in_time(rate: float, samples: float, channel: str) -> None:
    """At a twentieth of the sample rate interpolation is right to a few thousandths."""
    log = signal(seconds=1.0, rate=rate)
    c = ("voltage", "current", "position").index(channel)
    hz = 0.05 * rate
    z = log.z.copy()
    z[:, c] = np.sin(2.0 * np.pi * hz * (log.t - samples / rate))
    back = unfiltered(replace(log, z=z), (late_only(samples, channel),)).z
    inside = slice(2, -10)
    np.testing.assert_allclose(back[inside, c], np.sin(2.0 * np.pi * hz * log.t)[inside], atol=5e-3)
    others = [k for k in range(3) if k != c]
    np.testing.assert_array_equal(back[:, others], z[:, others])


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_three_readings_are_not_interpolated(n: int) -> None:
    y = np.array([1.0, 5.0, 2.0])[:n]
    np.testing.assert_array_equal(earlier(np.arange(float(n)), y, 0.5), y)


@pytest.mark.parametrize("samples", [0.4, 3.7])
def test_what_comes_after_the_log_nobody_knows(samples: float) -> None:
    t = np.arange(200) / RATE
    y = np.sin(30.0 * t)
    later = t + samples / RATE > t[-1]
    assert later.sum() == math.ceil(samples)
    np.testing.assert_array_equal(np.isnan(earlier(t, y, samples / RATE)), later)


def test_what_is_late_is_told_and_what_is_neither_is_not() -> None:
    own = LowPass(late=0.4)
    assert LowPass().is_none and not own.is_none and not LowPass(30.0).is_none
    told = NONE.of((1,), own).of((2,), LowPass(30.0, 2)).told
    assert told == (late_only(0.4), Filter("position", 30.0, 2, 0.0))
    assert NONE.told == ()


def test_a_delay_is_no_filter_that_diagnoses_take_out(tmp_path: Path) -> None:
    late = NONE.of((1,), LowPass(late=0.4))
    log = signal()
    assert not late.any and Unfiltered(late, 1.0 / RATE).take(log) is log
    learned = filtered_logger(
        with_logger(load_rig(), [log]), (late_only(0.4), Filter("voltage", 30.0, 1)), RATE
    )
    assert learned.logger is not None
    assert (learned.logger.current.low_pass_hz, learned.logger.voltage.low_pass_hz) == (None, 30.0)
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(learned))
    again = load_rig(path)
    assert again.logger is not None and again.logger.current.low_pass_hz is None
    assert again.logger.current.late_s == 0.0  # a start of a servo that is known tells it


def test_a_delay_beside_an_unknown_servo_is_in_the_rig_file(tmp_path: Path) -> None:
    rig = with_logger(replace(load_rig(), drive="voltage"), [signal()])
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(filtered_logger(rig, (late_only(0.4),), RATE)))
    again = load_rig(path)
    assert again.logger is not None
    assert [c.late_s for c in again.logger[:3]] == [0.0, pytest.approx(0.4 / RATE), 0.0]


def test_a_delay_is_told_in_samples_and_no_corner() -> None:
    said = told_filter(late_only(0.4))
    assert said.startswith("current_a is read 0.4 of a sample later than the other channels")
    assert "low-pass" not in said and "inf" not in said
