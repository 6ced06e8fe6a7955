"""Noise that grows with the reading: of an amplifier's gain, of a voltage that is switched, of a sensor that scales.

Stretches at every level of a log tell it, whatever its command: noise of so much at nothing, and a share of the reading.
"""

import math

import numpy as np

from observer_fi.logs.logger.in_motion import of_stretches
from observer_fi.records import Array

STRETCH = 32  # readings whose noise is told together
FEWEST = 12  # such stretches
# Standard deviation of the logarithm of a stretch's variance by chance, and by how much more a fit may be off.
BY_CHANCE, WELL = 0.45, 1.6
TOO_LOW = 0.1  # mean of that logarithm below that of the variance itself
FAR = 3.0  # of these: no stretch counts for more
# Of the largest level, from where on noise that changes would show; by how much it changes by chance, looked at from so many on.
LARGE, CHANGED, SIDE = 0.5, 6.0, 4
TOLD = 20.0  # nats by which stretches must be told better with a share of the reading than without
MOST = 0.95  # of the readings, which are no larger
SHARES = np.geomspace(2e-4, 0.2, 61)


def grows_with_reading(z: Array, at_rest: float) -> tuple[float, float]:
    """The noise of readings z (n,) that is so much of the reading, and by what noise is more near their largest than at rest.

    0 and 1 where it does not grow. at_rest: standard deviation of the noise of readings near 0 [unit of z].
    """
    share = _share(z, at_rest)
    return share, math.hypot(1.0, share * float(np.nanquantile(np.abs(z), MOST)) / at_rest) if share else 1.0


def _share(z: Array, at_rest: float) -> float:
    if not at_rest > 0.0:
        return 0.0
    level, variance = _stretches(z)
    if level.size < FEWEST:
        return 0.0
    told = np.log(variance) + TOO_LOW
    off = [float(np.mean(_bounded(told - np.log(at_rest**2 + (share * level) ** 2)))) for share in SHARES]
    best = int(np.argmin(off))
    alone = _bounded(told - np.median(told)), _bounded(told - math.log(at_rest**2))
    without = min(float(np.mean(every)) for every in alone)
    gain = 0.5 * level.size * (without - off[best]) / BY_CHANCE**2
    most = level > LARGE * np.quantile(level, MOST)
    left = told[most] - np.log(at_rest**2 + (SHARES[best] * level[most]) ** 2)
    same = _changes(np.clip(left / BY_CHANCE, -FAR, FAR)) < CHANGED
    well = off[best] < (WELL * BY_CHANCE) ** 2
    return float(SHARES[best]) if same and well and gain > TOLD else 0.0


def _changes(left: Array) -> float:
    """By how many standard deviations what is left of stretches in order, (n,) of one each, differs before and behind some time.

    Noise that begins on the way, or ends there, is that of a sensor that fails.
    """
    before = np.arange(SIDE, left.size - SIDE + 1)
    if not before.size:
        return 0.0
    total = np.cumsum(left - left.mean())[before - 1]
    return float(np.max(np.abs(total) / np.sqrt(before * (left.size - before) / left.size)))


def _bounded(off: Array) -> Array:
    """Squares of what stretches are off [nats of their variance], of none more than a few by chance."""
    return np.minimum(off**2, (FAR * BY_CHANCE) ** 2)


def _stretches(z: Array) -> tuple[Array, Array]:
    """Root mean square of the readings of each stretch of z (n,), and the variance of its noise."""
    there = z[np.isfinite(z)]
    parts = there[: there.size // STRETCH * STRETCH].reshape(-1, STRETCH)
    variance = of_stretches(parts)
    return np.sqrt(np.mean(parts**2, axis=1))[variance > 0.0], variance[variance > 0.0]
