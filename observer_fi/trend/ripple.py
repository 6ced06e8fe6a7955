"""Ripple and roughness along the travel, from what the smooth part of friction leaves of the torque.

The period of a ripple comes from the rig (the screw's lead) or from the baseline logs together; what a log says of
it, and how rough the rest is, is one more linear regression.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from observer_fi.records import Array
from observer_fi.trend.digests import Curve
from observer_fi.trend.travel import FEWEST, WAYS, Set, regression

LINE_STANDS_OUT = (
    12.0  # times the median of the spectrum around it; white residuals reach 9 once in 10 000 lines
)
FEWEST_TURNS = 4.0  # periods within the travel
BANDS = {
    "slow": (0.02, 0.15),
    "middle": (0.15, 0.4),
    "fast": (0.4, 1.0),
}  # of the highest frequency of the samples
MOST_LINES = 2


def lines_of(curves: Iterable[Curve], most: int = MOST_LINES) -> tuple[float, ...]:
    """Periods along the travel [m] at which the curves of many logs have ripple, the strongest first.

    The power of all logs is added: phases may differ from log to log.
    """
    kept = [c for c in curves if c.x.size >= FEWEST and np.ptp(c.x) > 0.0]
    if not kept:
        return ()
    span = float(np.median([np.ptp(c.x) for c in kept]))
    dense = float(np.median([_per_metre(c) for c in kept]))
    grid = np.arange(FEWEST_TURNS, 0.4 * dense * span, 0.25) / span  # per metre
    if grid.size < 20:
        return ()
    found: list[float] = []
    while len(found) < most:
        power = sum((_power(c, grid, found) for c in kept), np.zeros(grid.size))
        peak = int(np.argmax(power))
        if power[peak] < _stands_out(len(kept)) * float(np.median(power)):
            break
        found.append(1.0 / float(grid[peak]))
    return tuple(found)


def _stands_out(logs: int) -> float:
    """By how much a line must exceed the median: the mean of many logs scatters less."""
    return 1.0 + (LINE_STANDS_OUT - 1.0) / float(np.sqrt(logs))


def _per_metre(c: Curve) -> float:
    return float(np.median([np.count_nonzero(c.way == w) for w in set(c.way.tolist())])) / float(np.ptp(c.x))


def _power(c: Curve, grid: Array, without: Sequence[float]) -> Array:
    """Power at wave numbers (k,) per metre, relative to the variance, with ripple of these periods taken out."""
    total = np.zeros(grid.size)
    for w in WAYS:
        here = c.way == w
        if np.count_nonzero(here) >= FEWEST:
            y = c.torque[here] - c.torque[here].mean()
            if without:
                y = regression(_columns(c.x[here], without), y)[2]
            turns = np.exp(-2j * np.pi * np.outer(grid, c.x[here]))
            total += np.abs(turns @ y) ** 2 / y.size
    return total / float(np.var(c.torque))


def _columns(x: Array, periods: Sequence[float]) -> Array:
    """(n, 2 k) sine and cosine of each period."""
    return np.column_stack([f(2.0 * np.pi * x / p) for p in periods for f in (np.sin, np.cos)])


def quantities(curve: Curve, periods: Sequence[float]) -> list[Set]:
    """Ripple by direction and period as its sine and cosine at the travel's zero, and the roughness left, by bands."""
    found = []
    for w, name in WAYS.items():
        here = curve.way == w
        if np.count_nonzero(here) < FEWEST:
            continue
        x, y = curve.x[here], curve.torque[here]
        fits = [p for p in periods if np.ptp(x) > 2.0 * p]
        r = y
        if fits:
            theta, covariance, r = regression(_columns(x, fits), y)
            names = [f"ripple_{part}_{name}@{p:.6g}" for p in fits for part in ("sin", "cos")]
            found.append((tuple(names), ("N m",) * len(names), theta, covariance))
        found.append(_roughness(r, name))
    return found


def _roughness(r: Array, name: str) -> Set:
    """Logarithm of the amplitude in bands, and its standard error from the number of lines in each."""
    power = np.abs(np.fft.rfft(r * np.hanning(r.size))) ** 2
    at = np.linspace(0.0, 1.0, power.size)
    value, variance = [], []
    for low, high in BANDS.values():
        lines = power[(at >= low) & (at < high)]
        value.append(0.5 * float(np.log(max(lines.mean() / r.size, 1e-300))))
        variance.append(
            0.25 * 1.5 / max(lines.size, 1)
        )  # of a mean of exponentials; the window joins 1.5 lines
    names = tuple(f"roughness_{band}_{name}" for band in BANDS)
    return names, ("1",) * len(names), np.array(value), np.diag(variance)
