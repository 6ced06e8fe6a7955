"""Series of samples: runs of a mask, missing values filled, autocorrelation."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from observer_fi.records import Array

Rows = NDArray[np.int64]


def runs(mask: NDArray[np.bool_]) -> tuple[Rows, Rows]:
    """First row of every run of True, and the row after its last, (k,) each."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return edges[::2], edges[1::2]


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


def autocorrelation(y: Array, lags: int) -> Array:
    """(lags,) autocorrelation of y at the lags 1 to `lags`, lags < n; 0 for a constant."""
    y = y - y.mean()
    both = _correlate()(y, y, mode="full", method="fft")[y.size - 1 : y.size + lags]
    return both[1:] / both[0] if both[0] > 0.0 else np.zeros(lags)


def correlation_time(y: Array, lags: int) -> float:
    """1 + 2 sum of the autocorrelation of y (n,), up to where it is within its error 2 / sqrt(n) of zero: 1 if white."""
    rho = autocorrelation(y, lags)
    below = np.flatnonzero(rho < 2.0 / np.sqrt(y.size))
    return 1.0 + 2.0 * float(rho[: int(below[0]) if below.size else rho.size].sum())


def _correlate() -> Callable[..., Array]:
    from scipy.signal import correlate  # takes longer to import than a short log to diagnose

    return correlate
