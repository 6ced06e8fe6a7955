"""How columns hang together: one is the rate of another, follows it, or drives it through a motor.

Differences are taken over windows, so that noise does not count; x' = D / Km (V - Rm i) is equation 16 with x' = D w.
"""

from typing import NamedTuple

import numpy as np

from observer_fi.records import Array

FEWEST = 40  # windows
SHORTEST, WINDOWS = 8, 400  # samples of a window at least; windows of a log
MOST_SAMPLES = 100_000


class DriveFit(NamedTuple):
    """x' = gain (V - resistance i): gain [m/s per V], resistance [ohm] with its standard error, in the units that were given.

    explained: share of the variance of x'.
    """

    gain: float
    resistance: float
    std: float
    explained: float


class Slope(NamedTuple):
    """y = slope x: with the share of the variance that it explains."""

    slope: float
    explained: float


def window_of(n: int) -> int:
    """Samples over which differences are taken."""
    return max(SHORTEST, n // WINDOWS)


def rates(t: Array, x: Array, *others: Array) -> tuple[Array, ...] | None:
    """Mean rate of x over windows (m,), and the means of others; None where there are too few windows."""
    n = min(t.size, MOST_SAMPLES)
    size = window_of(n)
    count = n // size
    if count < FEWEST:
        return None
    ends = np.arange(count + 1) * size
    ends[-1] = min(ends[-1], n - 1)
    dt = np.diff(t[ends])
    means = [
        np.add.reduceat(v[:n], ends[:-1])[:count] / np.diff(np.append(ends[:-1], n))[:count] for v in others
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (np.diff(x[ends]) / dt, *means)
    good = np.all([np.isfinite(f) for f in found], axis=0) & (dt > 0.0)
    return tuple(f[good] for f in found) if np.count_nonzero(good) >= FEWEST else None


def drive_fit(t: Array, voltage: Array, current: Array, position: Array) -> DriveFit | None:
    """The motor equation through voltage, current and position; None where nothing moves."""
    found = rates(t, position, voltage, current)
    if found is None:
        return None
    y, v, i = found
    basis = np.column_stack((v, i))
    if min(np.ptp(y), np.ptp(v), np.ptp(i)) <= 0.0:
        return None
    scale = np.abs(basis).max(axis=0)
    solution, *_ = np.linalg.lstsq(basis / scale, y, rcond=None)
    left = y - basis / scale @ solution
    variance = float(left @ left) / max(y.size - 2, 1)
    inverse = np.linalg.pinv((basis / scale).T @ (basis / scale))
    gain, slope = (solution / scale).tolist()
    if gain == 0.0:
        return None
    std = float(np.sqrt(variance * inverse[1, 1])) / scale[1] / abs(gain)
    return DriveFit(gain, -slope / gain, std, 1.0 - float(left @ left) / float(y @ y))


def rate_of(t: Array, x: Array, speed: Array) -> Slope | None:
    """How x' follows a speed; None where nothing moves."""
    found = rates(t, x, speed)
    if found is None or np.ptp(found[0]) <= 0.0 or not found[1].any():
        return None
    return _slope(found[1], found[0])


def follows(x: Array, y: Array) -> Slope | None:
    """How y follows x about their means."""
    good = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(good) < FEWEST:
        return None
    a, b = x[good] - x[good].mean(), y[good] - y[good].mean()
    return _slope(a, b) if np.ptp(a) > 0.0 and np.ptp(b) > 0.0 else None


def _slope(x: Array, y: Array) -> Slope:
    slope = float(x @ y) / float(x @ x)
    left = y - slope * x
    return Slope(slope, 1.0 - float(left @ left) / float(y @ y))


def roughness(x: Array) -> float:
    """Size of second differences relative to the range: what noise a reading has, and a command has not."""
    good = x[np.isfinite(x)]
    return (
        float(np.sqrt(np.mean(np.diff(good, 2) ** 2)) / np.ptp(good))
        if good.size > 3 and np.ptp(good) > 0.0
        else 0.0
    )


def prefix_of(ratio: float, near: float = 2.5) -> float | None:
    """The power of a thousand, or ten or a hundred, that a ratio is near; None where it is none."""
    if not ratio > 0.0 or not np.isfinite(ratio):
        return None
    for power in (0, 3, -3, 6, -6, 2, -2):
        if 1.0 / near < ratio / 10.0**power < near:
            return float(10.0**power)
    return None
