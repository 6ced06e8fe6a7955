"""Readings that were put on another clock by interpolation, or repeated for a while: only those that were read are taken.

A tool that joins channels of several rates, or fills their gaps, draws straight lines from one reading to the next. Between two
readings of a real sensor there is its noise, and no three of them are on a line to the last digit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import resolution_of, runs
from observer_fi.records import Array

Mask = NDArray[np.bool_]
FEWEST, TELLING = 100, 1 << 13  # readings from which anything is told, and that tell their steps
# Rounding of a second difference: in steps of the readings where they have such, and relative to the largest reading.
ROUNDED, DIGITS = 2.1, 1e-9
EVEN = 1e-6  # relative: of the intervals of a clock of rows
MOVES = 0.4  # times that rounding, by which neighbours differ that do not stand still
# Times that rounding: what noise makes of a second difference between lines, and where it is far above its steps.
KINKED, FAR_KINKED = 4.0, 30.0
FEWEST_KINKS = 20
TURNS = 0.4  # share of the kinks that bend the other way than the one before: two of three by noise, none of a smooth signal
MOSTLY = (
    0.3  # share of straight readings among those that change, from which a channel is interpolated throughout
)
EVENLY, HARDLY = 6, 3  # times the usual distance of its readings: the longest line of one, and one of twenty
# Readings on a line from which a gap was filled in a channel that is not, on a short line, and the share of these.
GAP, SHORT, BY_CHANCE = 8, 3, 0.02


# Samples in which a channel that never does repeats itself to the last digit, as the latest value or a zero stands for readings
# that were lost; more of them are a sensor that got stuck. And the share of readings that repeat themselves by chance.
LOST, MOST_LOST, REPEATS = 3, 64, 0.01
ONE_SIDED = 0.02  # of the other end: a range that ends at zero
CUT_OFF = 4  # readings on either side of one at the end of a range
FAR_OFF = 10.0  # times the usual change of a reading: no end of a range is so far from the reading before it


class Lines(NamedTuple):
    """Which readings (n,) of a channel are its own, and how many a second: None where only gaps were filled."""

    own: Mask
    rate_hz: float | None


def interpolated(t: Array, y: Array) -> Lines | None:
    """The readings y (n,) at t (n,) [s] between which the others are on straight lines, None where no lines are seen.

    Missing readings, NaN, are none of its own.
    """
    there = np.flatnonzero(np.isfinite(y))
    if there.size < FEWEST:
        return None
    found = _lines(t[there], y[there])
    if found is None:
        return None
    own = np.zeros(y.size, dtype=np.bool_)
    own[there[found.own]] = True
    return found._replace(own=own)


def lost(y: Array) -> Mask | None:
    """Which readings y (n,) stand for some that were lost, None where none do."""
    there = np.flatnonzero(np.isfinite(y))
    same = np.diff(y[there]) == 0.0
    first, last = runs(same)
    lengths = last - first
    stands = (lengths >= LOST) & (lengths < MOST_LOST)
    if not stands.any() or lengths[~stands & (lengths < MOST_LOST)].sum() > REPEATS * there.size:
        return None
    if same.mean() > MOSTLY:  # held readings
        return None
    values = y[there]
    begins, usual = values[first], float(np.median(np.abs(np.diff(values))))
    beside = (values[np.maximum(first - 1, 0)], values[np.minimum(last + 1, values.size - 1)])
    near = np.min([np.abs(begins - other) for other in beside], axis=0) < FAR_OFF * usual
    for end in (values.max(), values.min()):
        if near[begins == end].any():  # a range that ends there
            stands &= begins != end
    out = np.zeros(y.size, dtype=np.bool_)
    for a, b in zip(first[stands], last[stands], strict=True):
        out[there[a : b + 1]] = True
    return out


def out_of_range(y: Array) -> Mask | None:
    """Which readings y (n,) are at an end of their range, None where none are: what is beyond reads the same.

    A reading goes there as fast as it came, stands to the last digit, and comes back: one that jumps there is that of a sensor
    that fails, one that stays a dead one's. A range reaches as far both ways, or ends at zero. The noise of those around is cut
    off.
    """
    there = np.flatnonzero(np.isfinite(y))
    values = y[there]
    changes = np.abs(np.diff(values))
    if there.size < FEWEST or not changes.any():
        return None
    steep = FAR_OFF * float(np.median(changes[changes > 0.0]))
    out = np.zeros(y.size, dtype=np.bool_)
    for sign in (1.0, -1.0):
        end, other = float((sign * values).max()), float(-(sign * values).min())
        if ONE_SIDED * other < abs(end) < other:  # a range that became smaller is that of a sensor that fails
            continue
        first, last = runs(sign * values == end)
        entered = first[(last - first > LOST) & (first > 1) & (last < values.size)]
        before, ahead = sign * values[entered - 1], sign * (values[entered - 1] - values[entered - 2])
        if np.any((ahead > steep) & (before + ahead > end) & (before < end)):
            for a, b in zip(first, last, strict=True):
                out[there[max(a - CUT_OFF, 0) : b + CUT_OFF]] = True
    return out if out.any() else None


def _lines(t: Array, y: Array) -> Lines | None:
    change = np.diff(y)
    bend = _bends(t, change)
    rounding = max(ROUNDED * (resolution_of(change[:TELLING]) or 0.0), DIGITS * float(np.abs(y).max()))
    on_line = bend <= rounding
    moves = np.maximum(np.abs(change[1:]), np.abs(change[:-1])) > MOVES * rounding
    straight = on_line & moves
    if not straight.any():
        return None
    bends = np.diff(change)
    first, last = runs(straight)
    lengths = last - first
    if straight.sum() > MOSTLY * moves.sum():
        kinks = np.stack(runs(~on_line), axis=1).ravel()
        kinked = _noise(np.add.reduceat(np.append(bends, 0.0), kinks)[::2]) > KINKED * rounding
        return _throughout(t, bend, on_line) if kinked and _even(lengths) else None
    long = lengths >= GAP
    by_chance = lengths[~long & (lengths >= SHORT)].sum()  # as of readings in steps of whatever size
    if (
        not long.any()
        or by_chance > BY_CHANCE * lengths[long].sum()
        or _noise(bends[~on_line]) < FAR_KINKED * rounding
    ):
        return None
    own = np.ones(y.size, dtype=np.bool_)
    for a, b in zip(first[long], last[long], strict=True):
        own[a + 1 : b + 1] = False
    return Lines(own, None)


def _bends(t: Array, change: Array) -> Array:
    """(n - 2,) by how much each reading is off the line through its neighbours, in rows or in time, whichever is less."""
    step = np.diff(t)
    of_rows = np.abs(np.diff(change))
    if np.ptp(step) <= EVEN * step[0]:
        return of_rows
    of_time = np.abs(change[1:] * step[:-1] - change[:-1] * step[1:]) / np.median(step)
    return np.minimum(of_rows, of_time)


def _even(lengths: NDArray[np.int64]) -> bool:
    """Whether lines from one reading to the next are about as long as each other."""
    usual = 1.0 + float(np.median(lengths))
    return bool(lengths.max() < EVENLY * usual and np.quantile(lengths, 0.95) < HARDLY * usual)


def _noise(bends: Array) -> float:
    """The usual size of the bends (k,) of noise, which turn one way as often as the other; 0 where they do not."""
    turned = np.sign(bends[1:]) != np.sign(bends[:-1])
    many = bends.size >= FEWEST_KINKS and float(np.mean(turned)) > TURNS
    return float(np.median(np.abs(bends))) if many else 0.0


def _throughout(t: Array, bend: Array, on_line: Mask) -> Lines:
    """Of a channel that is interpolated throughout: the reading next to each kink, and at its pace where it stands still."""
    own = np.zeros(t.size, dtype=np.bool_)
    first, last = runs(~on_line)
    for a, b in zip(first, last, strict=True):
        if b - a > 2:
            own[a + 1 : b + 1] = True
        else:
            own[a + 1 + int(np.argmax(bend[a:b]))] = True
    at = np.flatnonzero(own)
    pace = float(np.median(np.diff(at)))
    for a, b in zip(at[:-1], at[1:], strict=True):
        if b - a > 1.5 * pace:
            own[a + np.round(np.arange(1, int((b - a) / pace - 0.5) + 1) * pace).astype(np.int64)] = True
    own[[0, -1]] = True
    return Lines(own, float(own.sum() - 1) / float(t[-1] - t[0]))
