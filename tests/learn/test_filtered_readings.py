"""Readings of a model behind a filter, against scipy's digital Butterworth filter at a rate that makes it an analogue one."""

import math

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from observer_fi.learn.logger.filtered_readings import LATE, TIME, Through

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
