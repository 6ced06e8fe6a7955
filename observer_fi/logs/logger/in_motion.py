"""Noise of a logger that comes with the motion: of brushes, and of a converter that switches."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from observer_fi.logs.logger.lines import lines_of
from observer_fi.records import Array

SHORT = 24  # fourth differences from which noise is told
OUTLIER = 5.9  # times their median, which those of white noise do not reach: a corner of the motion
MORE = 1.5  # times the noise at rest, that is more in motion
# Of a start: its ramp at most, what follows until it is steady, how long is looked at, and samples of each half of that.
RAMP_S, RING_S, STEADY_S, FEWEST_STEADY = 0.25, 0.15, 0.3, 40
# A motor's turn and a servo's ring are no slower; how well a half tells a frequency.
SLOW_HZ, SAME_HZ = 80.0, 3.0
DEGREE = 12  # of a polynomial over a half, which follows up to 40 Hz
# Noise so many times that at rest comes with the motion if no two stretches of so many samples lack their share of what is more.
MUCH, STRETCH, SHARE, QUIET = 3.0, 32, 0.25, 0.5
FEWEST_QUIET = 4  # stretches from which the begin of a log tells its noise
GONE = 0.5  # of what is more in motion: so much is no longer there in the rest behind it


def more_in_motion(t: Array, z: Array, w_cmd: Array, rest: slice, least: float) -> float:
    """By what the noise of readings is more in the log's first steady motion than at rest, 1 where it is not.

    Brushes and a converter that switches make such noise, white or of single lines. What moves leaves nothing of fourth
    differences; where the noise begins on the way, or is not over with the motion, it is no logger's. least: noise [unit of z]
    that is no less at rest.
    """
    halves = _steady_halves(t, w_cmd)
    at_rest = fourth_differences(z[rest])
    if halves is None or not at_rest > 0.0:  # a rest without noise, or too short, tells nothing
        return 1.0
    usual = max(at_rest, least)
    white = min(fourth_differences(z[half]) for half in halves)
    ratio = max(
        white / usual, math.hypot(usual, _of_lines([_bent(t[half], z[half]) for half in halves])) / usual
    )
    much = white > MUCH * at_rest  # what is less, or of lines, both halves have
    if much and (not _throughout(t, z, w_cmd, white, at_rest) or _stays(t, z, w_cmd, white, at_rest)):
        return 1.0
    return ratio if ratio > MORE else 1.0


def _throughout(t: Array, z: Array, w_cmd: Array, steady: float, at_rest: float) -> bool:
    """Whether noise came with the motion and stayed with it: what begins later, or is over before, is a sensor that fails.

    Looked at from the end of the first ramp until the command changes. Stretches much quieter than rest are those of a
    sensor that stands still, which may begin within one, and tell nothing of the noise.
    steady, at_rest: noise in motion and at rest [unit of z].
    """
    first = int(np.searchsorted(t, _ramp_end(t, w_cmd)))
    turns = np.flatnonzero(w_cmd[first + 1 :] != w_cmd[first + 1])
    last = first + 1 + int(turns[0]) if turns.size else t.size
    levels = np.array([fourth_differences(z[k : k + STRETCH]) for k in range(first, last - STRETCH, STRETCH)])
    quiet = (levels > QUIET * at_rest) & (levels < at_rest + SHARE * (steady - at_rest))
    return not (quiet[1:] & quiet[:-1]).any()


def quiet_begin(z: Array, end: int, loud: float) -> slice:
    """The readings before sample `end` that have less than a noise `loud` [unit of z], from the first one on; none if few.

    So a log begins in motion whose sensor became noisy on the way: a rest behind that says nothing of its logger.
    """
    levels = np.array([fourth_differences(z[k : k + STRETCH]) for k in range(0, end - STRETCH + 1, STRETCH)])
    other = np.flatnonzero(~((levels > 0.0) & (levels < loud)))
    count = int(other[0]) if other.size else levels.size
    return slice(0, count * STRETCH if count >= FEWEST_QUIET else 0)


def _stays(t: Array, z: Array, w_cmd: Array, steady: float, at_rest: float) -> bool:
    """Whether much noise that came with the first motion stays in the rest behind it: it is none of the motion's.

    steady, at_rest: noise in motion and at the rest before it [unit of z].
    """
    first = int(np.flatnonzero(w_cmd != 0.0)[0])
    stops = np.flatnonzero(w_cmd[first:] == 0.0)
    if not stops.size:
        return False
    stop = first + int(stops[0])
    again = np.flatnonzero(w_cmd[stop:] != 0.0)
    end = stop + int(again[0]) if again.size else t.size
    after = fourth_differences(z[int(np.searchsorted(t, t[stop] + RING_S)) : end])
    return after > at_rest + GONE * (steady - at_rest)


def _steady_halves(t: Array, w_cmd: Array) -> tuple[slice, slice] | None:
    """The two halves of the first steady motion, None where there is none."""
    if not (w_cmd != 0.0).any():
        return None
    since = _ramp_end(t, w_cmd)
    first, last = np.searchsorted(t, [since + RING_S, since + RING_S + STEADY_S]).tolist()
    middle = (first + last) // 2
    if middle - first < FEWEST_STEADY or not (w_cmd[first:last] == w_cmd[first]).all():
        return None
    return slice(first, middle), slice(middle, last)


def _ramp_end(t: Array, w_cmd: Array) -> float:
    """When the first ramp of a command that is not 0 throughout is over [s]."""
    begun = float(t[np.flatnonzero(w_cmd != 0.0)[0]])
    turned = t[1:][np.diff(w_cmd) != 0.0]
    return float(turned[turned < begun + RAMP_S].max(initial=begun))


def _bent(t: Array, z: Array) -> tuple[Array, Array]:
    """Times and readings of a stretch about a polynomial, which takes what moves and a servo that still rings."""
    seen = np.isfinite(z)
    t, z = t[seen], z[seen]
    if z.size < FEWEST_STEADY:
        return t, np.zeros(z.size)
    u = np.linspace(-1.0, 1.0, z.size)
    return t, z - np.polynomial.chebyshev.chebval(u, np.polynomial.chebyshev.chebfit(u, z, DEGREE))


def _of_lines(halves: Sequence[tuple[Array, Array]]) -> float:
    """Amplitude of what is periodic in both halves, 0 where nothing is; faster than a motor turns or a servo rings."""
    both = [[line for line in lines_of([half])[0] if line.hz > SLOW_HZ] for half in halves]
    common = [min(a.amplitude, b.amplitude) for a, b in product(*both) if abs(a.hz - b.hz) < SAME_HZ]
    return math.hypot(*common)


def fourth_differences(z: Array) -> float:
    """Standard deviation of white noise from fourth differences, without outliers; NaN where there are too few."""
    there = z[np.isfinite(z)]
    return math.nan if there.size < SHORT + 4 else math.sqrt(float(of_stretches(there[None])[0]))


def of_stretches(z: Array) -> Array:
    """Variances of white noise (k,) from the fourth differences of k stretches of readings, z (k, n), without outliers.

    What moves leaves nothing of fourth differences, and those of white noise have 1 + 16 + 36 + 16 + 1 times its variance.
    """
    fourth = np.abs(np.diff(z, 4, axis=1))
    usual = fourth <= OUTLIER * np.median(fourth, axis=1, keepdims=True)
    return np.sum(np.where(usual, fourth, 0.0) ** 2, axis=1) / (70.0 * usual.sum(axis=1))
