"""Series of samples: runs of a mask, missing values filled, autocorrelation, the step they change by."""

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics.compile import uncounted
from observer_fi.records import Array

Rows = NDArray[np.int64]
MULTIPLE, MOSTLY = 0.05, 0.98  # a number is a multiple of a step within this share of it, and so many are


def runs(mask: NDArray[np.bool_]) -> tuple[Rows, Rows]:
    """First row of every run of True, and the row after its last, (k,) each."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return edges[::2], edges[1::2]


def count_in_rows(mask: NDArray[np.bool_]) -> Rows:
    """How many of each row of mask (n, k) are True, (n,): column by column, a tenth of the time of a sum over short rows."""
    found = np.zeros(len(mask), dtype=np.int64)
    for column in mask.T:
        found += column
    return found


def constant_runs(values: NDArray[np.generic]) -> list[tuple[int, int]]:
    """(first row, row after the last) of every stretch of equal values, in order; together they cover all rows."""
    changes = np.flatnonzero(values[1:] != values[:-1]) + 1
    bounds = [0, *changes.tolist(), values.size]
    return [(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True) if a < b]


def filled(y: Array, at: Array | None = None) -> Array:
    """y (n,) with what is not finite interpolated over `at` (n,), by default the row; as it is where nothing is finite."""
    known = np.isfinite(y)
    if known.all() or not known.any():
        return y
    x = np.arange(y.size) if at is None else at
    return np.interp(x, x[known], y[known])


def between_near(t: Array, known: NDArray[np.bool_], most: float) -> NDArray[np.bool_]:
    """(n,) whether times t (n,) lie between two `known` (n,) ones that are no farther apart than `most` times the usual."""
    at = t[known]
    if at.size < 2:
        return np.zeros(t.size, dtype=np.bool_)
    apart = np.diff(at)
    far = np.append(np.inf, np.append(apart, np.inf))[np.searchsorted(at, t)]
    return np.asarray(far < most * float(np.median(apart)), dtype=np.bool_)


def autocorrelation(y: Array, lags: int) -> Array:
    """(lags,) autocorrelation of y at the lags 1 to `lags`, lags < n; 0 for a constant."""
    room = 1 << (y.size + lags).bit_length()  # zeros behind it, so that its end does not meet its beginning
    both = np.fft.irfft(np.abs(np.fft.rfft(y - y.mean(), room)) ** 2, room)[: lags + 1]
    return both[1:] / both[0] if both[0] > 0.0 else np.zeros(lags)


def correlation_time(y: Array, lags: int) -> float:
    """1 + 2 sum of the autocorrelation of y (n,), up to where it is within its error 2 / sqrt(n) of zero: 1 if white."""
    rho = autocorrelation(y, lags)
    below = np.flatnonzero(rho < 2.0 / np.sqrt(y.size))
    return 1.0 + 2.0 * float(rho[: int(below[0]) if below.size else rho.size].sum())


def weighted_means(y: Array, weight: float, mean: Array) -> Array:
    """(n, k) exponentially weighted means of the rows of y (n, k) up to each: m <- m + weight (y - m).

    mean (k,): before the first row, updated in place. The filter of scipy.signal would take longer to import than a log to judge.
    """
    out = np.empty(y.shape)
    _follow(np.ascontiguousarray(y), weight, mean, out)
    return out


@uncounted
def _follow(y: Array, weight: float, mean: Array, out: Array) -> None:
    for k in range(y.shape[0]):
        for c in range(y.shape[1]):
            mean[c] = weight * y[k, c] + (1.0 - weight) * mean[c]
            out[k, c] = mean[c]


def first_beyond(y: Array, weight: float, mean: Array, variance: Array, limit: float) -> int:
    """First row of y (n, k) whose exponentially weighted mean is beyond `limit` standard deviations of it, n where there is none.

    y: standard normal where nothing is wrong, NaN where there is none, which counts as nothing seen; mean, variance (k,): of what
    went before, 0 where nothing did, updated in place. Of a mean of r rows in a row the variance is
    w / (2 - w) (1 - (1 - w)^2r) (Roberts 1959).
    """
    return int(_first_beyond(np.ascontiguousarray(y), weight, mean, variance, limit))


@uncounted
def _first_beyond(y: Array, weight: float, mean: Array, variance: Array, limit: float) -> int:
    first, kept = y.shape[0], 1.0 - weight
    for k in range(y.shape[0]):
        for c in range(y.shape[1]):
            mean[c], variance[c] = kept * mean[c], kept * kept * variance[c]
            if y[k, c] == y[k, c]:
                mean[c], variance[c] = mean[c] + weight * y[k, c], variance[c] + weight * weight
            if mean[c] * mean[c] > limit * limit * variance[c]:
                first = min(first, k)
    return first


def resolution_of(changes: Array) -> float | None:
    """The step of which all changes of a reading, (n,), are multiples, None where there is none."""
    sizes = np.abs(changes[np.isfinite(changes)])
    sizes = sizes[sizes > 0.0]
    if sizes.size < 8:
        return None
    step = float(np.quantile(sizes, 0.002))
    small = sizes[sizes < 30.0 * step]
    for _ in range(3):
        times = np.round(small / step)
        whole = (np.abs(small - times * step) < MULTIPLE * step) & (times > 0)
        if whole.mean() < MOSTLY or small.size < 8:
            return None
        step = float((small[whole] * times[whole]).sum() / (times[whole] ** 2).sum())
    return step
