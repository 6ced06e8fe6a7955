"""The speed of the motor where only the position tells it: the slope of a stretch as long as the position's noise needs."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.logger.acquisition import stuck_from
from observer_fi.logs.logger.holds import hold_of
from observer_fi.numerics import filled, runs
from observer_fi.records import Array

SURE = 0.02  # of the top speed: what noise may make of the slope
LONGEST_S = 0.1  # of a stretch: a longer one would smooth moves away
# Where the noise then is more than that share of the top speed, which hides moves, a stretch is as long as brings it down to the
# second one, and at most so.
HIDDEN, SEEN, FARTHEST_S = 0.12, 0.04, 0.5
FEWEST = 5  # samples of a stretch
# Standard deviations of its noise from which a speed is seen; of that of the fastest, below which a mass stands.
SIGMAS, SLOWEST, TOP = 6.0, 0.03, 0.98
# Rows by which a log is longer than it has rows, from which on some are missing; rows of a pause that are looked at.
MISSING, PAUSE = 0.5, 10.0
LONGER = 2  # times as long is the next stretch in which a slower move is looked for
# Times what white noise makes of the slopes, from which they scatter by more: by hum, or a baseline that wanders. Stretches are
# compared with those so many of their lengths away, of which a period can be but one.
MORE, APART = 1.5, (1.0, 0.6)
# Of those differences, the quietest, and the standard deviations below which a normal distribution has as many.
QUIET, QUIET_SIGMAS = 0.25, 0.3186


class PositionSpeed(NamedTuple):
    """(n,) speed of the motor [rad/s], where the mass is seen to move, and the standard deviation of the speed's noise.

    A slow move is seen in a stretch that is longer than those of the fast ones; its noise is then less.
    """

    w: Array
    moves: NDArray[np.bool_]
    std: float


def position_speed(t: Array, x: Array, D: float) -> PositionSpeed:
    """Speed of a motor whose mass is at x (n,) [m] at the times t (n,) [s]; D [m/rad].

    Of readings that are held the slope is that of the updates, with straight lines between them; so it is of rows some of which
    are missing.
    """
    t, x = _without_pauses(t), filled(x)
    updates = _updates(t, x) or _evenly(t, x)
    if updates is None:
        return _slope(t, x, D)
    slope = _slope(*updates, D)
    moves = np.interp(t, updates[0], slope.moves.astype(np.float64)) > 0.5
    return PositionSpeed(np.interp(t, updates[0], slope.w), moves, slope.std)


def _without_pauses(t: Array) -> Array:
    """Times t (n,) [s] whose pauses, of days where several logs are one, are no longer than tells that there is one."""
    apart = np.diff(t)
    longest = max(FARTHEST_S, PAUSE * float(np.median(apart)))
    return t if apart.max() <= longest else np.append(t[0], t[0] + np.cumsum(np.minimum(apart, longest)))


def _updates(t: Array, x: Array) -> tuple[Array, Array] | None:
    """Times [s] and readings (k,) of regular updates of x (n,) at the times t (n,) [s], None where it is not held."""
    hold = hold_of(np.arange(t.size), x, np.zeros(t.size))
    if hold is None:
        return None
    changed = np.flatnonzero(np.diff(x) != 0.0) + 1
    # A reading was fresh for the last time an update before the one that changed it.
    last = np.maximum(changed - round(hold.every), np.append(0, changed[:-1]))
    fresh = np.unique(np.concatenate(([0], changed, last, [t.size - 1])))
    interval = hold.every * float(np.median(np.diff(t)))
    at = np.arange(t[0] + (t[changed[0]] - t[0]) % interval, t[-1], interval)
    return (at, np.interp(at, t[fresh], x[fresh])) if at.size > FEWEST else None


def _evenly(t: Array, x: Array) -> tuple[Array, Array] | None:
    """Even times [s] and readings (k,) there, of x (n,) at times t (n,) [s] some of which are missing; None where none is."""
    interval = float(np.median(np.diff(t)))
    if t[-1] - t[0] < (t.size - 1 + MISSING) * interval:
        return None
    at = np.arange(t[0], t[-1] + 0.5 * interval, interval)
    return at, np.interp(at, t, x)


def _slope(t: Array, x: Array, D: float) -> PositionSpeed:
    from scipy.ndimage import maximum_filter1d
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(t)))
    live = x[: stuck_from(x)]  # a sensor that stands still to the last digit has no noise to tell
    live = live if live.size > 2 * FEWEST else x
    whole, longest_live = _odd(x.size), _odd(live.size)
    noise, size = _reading_std(live), FEWEST
    for worse, share, longest in ((SURE, SURE, LONGEST_S), (HIDDEN, SEEN, FARTHEST_S)):
        top = _top(x, step, longest)
        if _slope_noise(live, size, noise, step) <= worse * top:
            break
        most = max(FEWEST, min(round(longest / step) | 1, longest_live))
        while size < most and _slope_std(noise, size, step) > share * top:
            size += 2
        size = min(size, most)
        size = _past_scatter(live, size, most, noise, share * top, step)
    slope = savgol_filter(x, size, 1, deriv=1, delta=step)
    std = _scatter(slope[: live.size], size, noise, step)
    more = std / max(_slope_std(noise, size, step), 1e-300)  # which longer stretches have at most
    least = SLOWEST * float(np.quantile(np.abs(slope), TOP))
    moves = np.abs(slope) > max(SIGMAS * std, least)
    longer = LONGER * size | 1
    while longer * step <= FARTHEST_S and longer <= whole:
        slower = savgol_filter(x, longer, 1, deriv=1, delta=step)
        enough = max(SIGMAS * more * _slope_std(noise, longer, step), least)
        near = maximum_filter1d(moves, 2 * (longer // 2 + size // 2) + 1, mode="constant")
        found = _slow_moves(slower, enough, near, longer)
        slope, moves, longer = np.where(found, slower, slope), moves | found, LONGER * longer | 1
    return PositionSpeed(slope / D, moves, std / D)


def _slow_moves(slope: Array, enough: float, near: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """(n,) where a mass moves by a slope (n,) of more than `enough` [m/s], in stretches of `reach` rows that do not come `near`
    (n,) faster moves.

    A move begins and ends in the middle of a stretch that shows half of its speed.
    """
    found = np.zeros(slope.size, dtype=np.bool_)
    for a, b in zip(*runs((np.abs(slope) > enough) & ~near), strict=True):
        around = slice(max(int(a) - reach, 0), int(b) + reach)
        way = math.copysign(1.0, float(slope[(a + b) // 2]))
        half = (way * slope[around] > 0.5 * float(np.median(np.abs(slope[a:b])))) & ~near[around]
        for first, last in zip(*runs(half), strict=True):
            if around.start + first < b and around.start + last > a:
                found[around.start + first : around.start + last] = True
    return found


def _odd(size: int) -> int:
    """The largest odd number of readings among so many."""
    return size - 1 + size % 2


def _reading_std(x: Array) -> float:
    """Standard deviation of one reading [m], of its noise or of its steps, whichever is more."""
    change = np.abs(np.diff(x))
    steps = change[change > 0.0]
    if not steps.size:
        return 0.0
    second = np.abs(np.diff(x, 2))
    white = float(
        np.sqrt(np.mean(np.minimum(second, 6.0 * max(float(np.median(second)), 1e-300)) ** 2) / 6.0)
    )
    return max(white, float(np.quantile(steps, 0.05)) / math.sqrt(12.0) if _stepped(steps) else 0.0)


def _stepped(steps: Array) -> bool:
    """Whether changes are whole multiples of the smallest one."""
    least = float(steps.min())
    return bool(np.median(np.abs(steps / least - np.round(steps / least))) < 0.02)


def _slope_std(noise: float, size: int, step: float) -> float:
    """Standard deviation of the slope of a straight line through `size` readings."""
    return noise * math.sqrt(12.0 / (size * (size**2 - 1.0))) / step


def _slope_noise(x: Array, size: int, noise: float, step: float) -> float:
    """Standard deviation of the slopes of stretches of `size` readings, whose noise is white, or more besides."""
    from scipy.signal import savgol_filter

    return _scatter(savgol_filter(x, size, 1, deriv=1, delta=step), size, noise, step)


def _scatter(slope: Array, size: int, noise: float, step: float) -> float:
    """Standard deviation of the slopes (n,) of stretches of `size` readings: that of white noise, or by far more where they
    scatter by that.

    A motion that is steady, or over, for a quarter of a log leaves nothing there of the second differences of short stretches.
    """
    white = found = _slope_std(noise, size, step)
    if size * step > LONGEST_S:
        return white
    for share in APART:
        lag = max(round(share * size), 1)
        second = np.abs(slope[2 * lag :] - 2.0 * slope[lag:-lag] + slope[: -2 * lag])
        if second.size:
            found = max(found, float(np.quantile(second, QUIET)) / (QUIET_SIGMAS * math.sqrt(6.0)))
    return found if found > MORE * white else white


def _past_scatter(x: Array, size: int, most: int, noise: float, goal: float, step: float) -> int:
    """The length of stretches, from `size` to `most` readings, whose slopes scatter by no more than `goal` [m/s]."""
    while size < most and _slope_noise(x, size, noise, step) > goal:
        size = min(math.ceil(1.3 * size) | 1, most)
    return size


def _top(x: Array, step: float, longest: float) -> float:
    """The speed of the mass at its fastest [m/s], by stretches of `longest` [s]."""
    span = min(max(round(longest / step), 1), x.size - 1)
    return float(np.quantile(np.abs(x[span:] - x[:-span]), 0.98)) / (span * step)
