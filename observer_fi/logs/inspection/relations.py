"""How columns hang together: one is the rate of another, follows it, or drives it through a motor.

Differences are taken over windows, so that noise does not count; x' = D / Km (V - Rm i) is equation 16 with x' = D w.
"""

from typing import NamedTuple

import numpy as np

from observer_fi.numerics import filled
from observer_fi.records import Array

FEWEST = 30  # windows
SHORTEST, WINDOWS = 4, 400  # samples of a window at least; windows of a log
CLEAR_OF_NOISE = 0.1  # share of a change that may be noise
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


def _window(x: Array) -> int:
    """Samples over which differences of a position (n,) stand out of its noise, as far as there are windows enough."""
    size = max(SHORTEST, x.size // WINDOWS)
    noise = float(np.sqrt(np.median(np.diff(x, 2) ** 2) / 2.7))
    while 2 * size * FEWEST <= x.size:
        change = np.abs(x[size:] - x[:-size])
        if 2.0 * noise / np.sqrt(size) < CLEAR_OF_NOISE * float(np.quantile(change, 0.9)):
            break
        size *= 2
    return size


def rates(t: Array, x: Array, *others: Array) -> tuple[Array, ...] | None:
    """Mean rate of x over windows (m,), and the means of others; None where there are too few windows.

    All are smoothed alike first, which what is linear between them does not feel.
    """
    n = min(t.size, MOST_SAMPLES)
    t, x = t[:n], x[:n]
    if n < FEWEST * SHORTEST or not (np.isfinite(t).all() and np.isfinite(x).mean() > 0.5):
        return None
    x = filled(x)
    size = _window(x)
    ends = np.arange(0, n - 2 * size, size)
    if ends.size < FEWEST or not (np.diff(t[ends]) > 0.0).all():
        return None
    smooth = [_means(filled(v[:n]), size) for v in (x, *others)]
    dt = t[ends + size] - t[ends]
    sums = (np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1]))) for v in smooth[1:])
    found = (
        (smooth[0][ends + size] - smooth[0][ends]) / dt,
        *((s[ends + size] - s[ends]) / size for s in sums),
    )
    return found if all(np.isfinite(f).all() for f in found) else None


def _means(x: Array, size: int) -> Array:
    """(n - size + 1,) means of `size` neighbours."""
    total = np.append(0.0, np.cumsum(x - x[0]))
    return (total[size:] - total[:-size]) / size + x[0]


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


def leads(x: Array, y: Array) -> float:
    """How far x is ahead of y, which follows it: the correlation of x - y with the rate of x, from -1 to 1."""
    rate, off = np.gradient(x), x - y
    good = np.isfinite(rate) & np.isfinite(off)
    rate, off = rate[good], off[good] - off[good].mean()
    scale = float(np.sqrt((rate @ rate) * (off @ off)))
    return float(rate @ off) / scale if scale > 0.0 else 0.0


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
