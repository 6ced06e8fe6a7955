"""Readings of a model behind a filter, against scipy's digital Butterworth filter at a rate that makes it an analogue one."""

import math

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from observer_fi.learn.logger.filtered_readings import DRIVE, LATE, TIME, Through
from observer_fi.logs import LowPass, unfiltered
from observer_fi.records import Log

RATE, FAST = 1600.0, 1600 * 64
HZ = 30.0


def readings(t: np.ndarray) -> np.ndarray:
    """A start: nothing for 20 ms, then a current that jumps up and decays, in all three channels."""
    since = np.maximum(t - 0.02, 0.0)
    return np.column_stack([k * since * np.exp(-since / 0.01) for k in (1.0, 2.0, 3.0)])


def taken(order: int, late: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(400) / RATE
    values = {TIME: 1.0 / (2.0 * math.pi * HZ), LATE: late}
    return readings(t), Through((1,), order).taken(t, readings(t), values)


@pytest.mark.parametrize("order", [1, 2])
def test_the_filter_is_that_of_an_amplifier(order: int) -> None:
    before, after = taken(order)
    fine = np.arange(400 * 64) / FAST
    true = lfilter(*butter(order, HZ, fs=FAST), readings(fine)[:, 1])[::64]
    assert np.abs(after[:, 1] - true).max() < 0.01 * np.abs(before[:, 1]).max()
    np.testing.assert_array_equal(after[:, [0, 2]], before[:, [0, 2]])


def test_order_none_only_delays() -> None:
    before, after = taken(0, 3.0 / RATE)
    np.testing.assert_allclose(after[3:, 1], before[:-3, 1], atol=1e-9)


def test_a_rest_stays_what_it_is() -> None:
    t = np.arange(100) / RATE
    level = np.full((100, 3), 0.7)
    values = {TIME: 5e-3, LATE: 1e-4}
    np.testing.assert_allclose(Through((0, 1, 2), 2).taken(t, level, values), level, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_what_is_told_takes_it_out_again(order: int) -> None:
    """The corner and the delay of what `Unfiltered` takes out make the delay of the filter."""
    values = {TIME: 1.0 / (2.0 * math.pi * HZ), LATE: 2e-4}
    own = Through((1,), order).told(values, 1.0 / RATE).current
    _, once, twice = own.weights(1.0 / RATE)
    assert own.corner_hz == pytest.approx(HZ) and own.order == order
    assert own.late - once - 2.0 * twice == pytest.approx((own.delay_s + values[LATE]) * RATE)


def test_filters_in_turn_are_each_their_own() -> None:
    """Whatever is kept of one filter: another order, rate or corner is another filter."""
    every = [(order, rate, hz) for order in (1, 2) for rate in (800.0, RATE) for hz in (20.0, HZ, 60.0)]
    for order, rate, hz in [*every, *every[::-1]]:
        t, fine = np.arange(200) / rate, np.arange(200 * 64) / (64.0 * rate)
        out = Through((1,), order).taken(t, readings(t), {TIME: 1.0 / (2.0 * math.pi * hz)})[:, 1]
        true = lfilter(*butter(order, hz, fs=64.0 * rate), readings(fine)[:, 1])[::64]
        assert np.abs(out - true).max() < 0.02 * np.abs(readings(t)).max()


@pytest.mark.parametrize("channels", [(0,), (1,), DRIVE])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_delay_is_free_but_for_voltage_and_current_behind_a_filter(
    channels: tuple[int, ...], order: int
) -> None:
    """Behind one filter both are as late as a servo's ticks have them: `servo_delay` and `input_delay` say so already."""
    free = {f.name: f for f in Through(channels, order).free(1.0 / RATE)}
    names = {LATE} if not order else {TIME} if channels == DRIVE else {TIME, LATE}
    assert set(free) == names


@pytest.mark.parametrize("channels", [(0,), (1,), DRIVE])
def test_no_reading_is_early(channels: tuple[int, ...]) -> None:
    """An early voltage would be as good as a late current."""
    (late,) = Through(channels, 0).free(1.0 / RATE)
    assert late.low == 0.0 and late.high > 10.0 / RATE


@pytest.mark.parametrize("order", [0, 1, 2])
def test_without_a_delay_there_is_none(order: int) -> None:
    t = np.arange(400) / RATE
    values = {TIME: 1.0 / (2.0 * math.pi * HZ)}
    own = Through(DRIVE, order)
    np.testing.assert_array_equal(
        own.taken(t, readings(t), values), own.taken(t, readings(t), {**values, LATE: 0.0})
    )
    assert own.told(values, 1.0 / RATE) == own.told({**values, LATE: 0.0}, 1.0 / RATE)


@pytest.mark.parametrize("rate", [400.0, RATE])
@pytest.mark.parametrize("samples", [0.4, 1.0, 3.3])
def test_a_delay_that_is_told_takes_itself_out(rate: float, samples: float) -> None:
    """Of readings that are smooth for their rate."""
    t = np.arange(400) / rate
    y = np.column_stack([np.sin(2.0 * np.pi * 0.02 * rate * t + k) for k in range(3)])
    own, values = Through((1,), 0), {LATE: samples / rate}
    told = own.told(values, 1.0 / rate)
    assert told.current == LowPass(late=pytest.approx(samples))
    assert told.voltage.is_none and told.position.is_none
    log = Log("late", t, own.taken(t, y, values), np.zeros(t.size), np.zeros(t.size))
    inside = slice(5, -5)
    np.testing.assert_allclose(unfiltered(log, told.told).z[inside], y[inside], atol=5e-3)
