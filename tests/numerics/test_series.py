"""Series of samples against the definitions."""

import numpy as np
import pytest
from scipy.signal import lfilter

from observer_fi.numerics.series import (
    autocorrelation,
    constant_runs,
    correlation_time,
    count_in_rows,
    filled,
    first_beyond,
    runs,
    weighted_means,
)


@pytest.mark.parametrize(
    ("mask", "expected"),
    [("", []), ("0", []), ("1", [(0, 1)]), ("0110", [(1, 3)]), ("1101", [(0, 2), (3, 4)]), ("111", [(0, 3)])],
)
def test_runs_of_a_mask(mask: str, expected: list[tuple[int, int]]) -> None:
    starts, stops = runs(np.array([c == "1" for c in mask], dtype=bool))
    assert list(zip(starts, stops, strict=True)) == expected


def test_constant_runs_cover_all_rows() -> None:
    assert constant_runs(np.array([0, 0, 1, -1, -1])) == [(0, 2), (2, 3), (3, 5)]
    assert constant_runs(np.array([2.0])) == [(0, 1)]
    assert constant_runs(np.array([])) == []


def test_what_is_missing_is_interpolated_over_time_or_rows() -> None:
    y = np.array([np.nan, 1.0, np.nan, np.inf, 4.0, np.nan])
    np.testing.assert_allclose(filled(y), [1.0, 1.0, 2.0, 3.0, 4.0, 4.0])
    np.testing.assert_allclose(
        filled(y, np.array([0.0, 1.0, 3.0, 3.5, 4.0, 9.0])), [1.0, 1.0, 3.0, 3.5, 4.0, 4.0]
    )
    whole, empty = np.arange(3.0), np.full(3, np.nan)
    assert filled(whole) is whole and filled(empty) is empty


def test_autocorrelation_is_the_sum_of_products() -> None:
    y = np.random.default_rng(1).normal(size=300) + 5.0
    e = y - y.mean()
    expected = [float(e[k:] @ e[:-k] / (e @ e)) for k in range(1, 21)]
    np.testing.assert_allclose(autocorrelation(y, 20), expected, atol=1e-12)
    assert autocorrelation(np.ones(10), 3).tolist() == [0.0, 0.0, 0.0]


def test_correlation_time_of_white_noise_is_one_and_of_a_decay_its_sum() -> None:
    noise = np.random.default_rng(2).normal(size=40_000)
    assert correlation_time(noise, 400) == pytest.approx(1.0, abs=0.05)
    y = np.zeros(noise.size)
    for k in range(1, y.size):
        y[k] = 0.8 * y[k - 1] + noise[k]
    assert correlation_time(y, 400) == pytest.approx((1.0 + 0.8) / (1.0 - 0.8), rel=0.1)


def test_weighted_means_are_the_filter_of_one_pole_whole_or_in_pieces() -> None:
    y, weight = np.random.default_rng(3).normal(size=(500, 2)), 0.0125
    expected = lfilter([weight], [1.0, weight - 1.0], y, axis=0)
    whole, mean = weighted_means(y, weight, np.zeros(2)), np.zeros(2)
    np.testing.assert_allclose(whole, expected, atol=1e-15)
    pieces = [weighted_means(part, weight, mean) for part in np.split(y, [1, 170])]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
    np.testing.assert_array_equal(mean, whole[-1])


@pytest.mark.parametrize("cuts", [[], [1], [7, 8, 120, 333]])
@pytest.mark.parametrize("weight", [0.5, 0.01])
def test_a_mean_is_beyond_its_limit_where_the_formula_of_roberts_has_it(
    cuts: list[int], weight: float
) -> None:
    y = np.random.default_rng(2).normal(size=(400, 2))
    y[250:, 1] += 6.0
    k = np.arange(1, 401)
    before = weighted_means(y, weight, np.zeros(2))
    std = np.sqrt(weight / (2.0 - weight) * (1.0 - (1.0 - weight) ** (2 * k)))
    for limit in (2.0, 5.5, 1e3):
        beyond = np.flatnonzero((np.abs(before) > limit * std[:, None]).any(axis=1))
        mean, variance, seen, found = np.zeros(2), np.zeros(2), 0, []
        for part in np.split(y, cuts):
            first = first_beyond(part, weight, mean, variance, limit)
            found += [seen + first] if first < len(part) else []
            seen += len(part)
        assert found[:1] == beyond[:1].tolist()
        np.testing.assert_allclose(mean, before[-1], rtol=1e-12)


@pytest.mark.parametrize("every", [4, 16])
def test_readings_that_come_rarely_say_as_much_as_they_are(every: int) -> None:
    """A mean that took rows without a reading for zeros was beyond its limit for twice, or four times, as large a fault only."""
    weight, rng = 0.005, np.random.default_rng(4)
    beyond = np.zeros((200, 2))
    for trial in range(200):
        y = np.full((4000, 1), np.nan)
        y[::every, 0] = rng.normal(size=4000 // every)
        y[2000:] += 0.0 if trial % 2 else 7.0 * np.sqrt(0.5 * weight * every)
        mean, variance = np.zeros(1), np.zeros(1)
        beyond[trial // 2, trial % 2] = first_beyond(y, weight, mean, variance, 5.5) < 4000
        assert variance[0] == pytest.approx(weight / (2.0 - weight) / every, rel=0.1)
    assert beyond[:100, 0].mean() > 0.8 and not beyond[:100, 1].any()


def test_counts_in_rows_are_sums_over_rows() -> None:
    mask = np.random.default_rng(1).random((50, 3)) > 0.4
    np.testing.assert_array_equal(count_in_rows(mask), mask.sum(axis=1))
    assert count_in_rows(np.zeros((0, 3), dtype=np.bool_)).size == 0
