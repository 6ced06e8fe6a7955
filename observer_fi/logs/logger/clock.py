"""A log on the clock that its logger meant: stamps as they were before they were rounded, and a row for each that is missing.

A row that a logger lost is one whose readings nobody knows, and no end of a move: its command follows from the rows around it.
"""

import math
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import resolution_of, weighted_means
from observer_fi.physics import Rig, corners
from observer_fi.records import SAMPLES, Array, Clock, Log

JITTER, JITTERING = 1e-3, 0.02  # of the sampling interval: less is none; of the samples: fewer are gaps
FEWEST = 100  # time stamps that tell an even clock
GAP = 1.5  # intervals between two samples from which one is missing
# Samples that tell an interval; share of a stamp's error that a clock follows, and of stretches that lack no row at least.
WINDOW, FOLLOWS, SURELY = 20, 0.3, 0.05
STAMPS_S, COARSE, ALIKE = (
    (1e-2, 1e-3, 1e-4, 1e-5),
    1000.0,
    0.02,
)  # steps of stamps [s], of which an interval is fewer; of one
FINER = 0.9  # of an interval: stamps that are rounded more coarsely tell no clock, and those of whole intervals are exact
ROUNDED = 0.6  # of a step, by which stamps are off an even clock at most: half of it, and what is left of the clock's own fit
LONGEST_S = 0.05  # of a gap over which the command is known
# Of the mean interval: stamps that are nearer than this came together; the share of such stamps of a clock that says when rows
# came, not when they were read; and times the usual time between two bunches, by which it is off an even clock at most.
TOGETHER, BUNCHED, ARRIVES = 0.2, 0.05, 1.0
FEWEST_BUNCHES, SLOWLY = 20, 1e-3  # that tell it; share of what a stamp is off its clock that this follows


def _evenly(t: Array, step: float) -> bool:
    """Whether time stamps are those of an even clock but for rounding: where rows are missing they are not."""
    row = np.arange(t.size)
    return bool(np.abs(t - np.polyval(np.polyfit(row, t, 1), row)).max() < ROUNDED * step)


def clock_of(t: Array) -> Clock:
    """Jitter of the time stamps about even ones, and their step [s]."""
    if t.size < FEWEST:
        return Clock(0.0, None, math.nan)
    dt = np.diff(t)
    interval = float(np.median(dt))
    off = np.abs(dt - interval)
    if np.mean(off > JITTER * interval) < JITTERING:  # a gap now and then is none
        return Clock(0.0, None, interval)
    step = resolution_of(dt)
    spread = 0.05 * interval, 4.0 * float(dt.std())
    rounded = (
        step is not None and spread[0] < step < spread[1] and (step < FINER * interval or _evenly(t, step))
    )
    return _meant(t, dt, step if rounded else None) or _jittering(dt, interval, step if rounded else None)


def _meant(t: Array, dt: Array, step: float | None) -> Clock | None:
    """An even clock whose stamps are rounded; where it lacks rows gaps look like rounding, and rounding like gaps."""
    usual = _usual(t)
    step = step or _step_of(t, usual)
    meant = even(t, usual, step) if step else t
    apart = np.diff(meant)
    interval = float(np.median(apart))
    exact = step is None or np.abs(t - meant).max() < ALIKE * step or step > FINER * interval
    return None if meant is t or exact else Clock(float(np.std(dt - apart)) / math.sqrt(2.0), step, interval)


def _jittering(dt: Array, interval: float, coarse: float | None) -> Clock:
    """Of stamps dt (n,) apart, rounded or not."""
    usual = dt[dt < 1.5 * interval + (coarse or 0.0)]
    jitter = float(np.std(usual)) / math.sqrt(2.0)
    if jitter < JITTER * interval:
        return Clock(0.0, None, interval)
    return Clock(jitter, coarse, float(usual.mean()) if coarse else interval)


def even(t: Array, interval: float, step: float) -> Array:
    """Time stamps (n,) as they were before they were rounded to multiples of `step`, where the clock was an even one.

    As they are where samples do not stand at multiples of an interval of about `interval` [s].
    """
    if t.size < FEWEST or step >= interval:
        return t
    for counted in (_every, _rounded, _tracked, partial(_tracked, share=SURELY)):
        count = counted(t, interval)
        fitted = np.asarray(np.polyval(np.polyfit(count, t, 1), count), dtype=np.float64)
        if np.abs(t - fitted).max() < step and (np.diff(count) >= 1.0).all():
            return fitted
    return t


class ByRows:
    """An even clock of rows whose stamps say when they came together, packet by packet or several with one stamp.

    interval: of rows [s]; `take` their stamps, chunk by chunk: the clock follows them slowly, and anew behind a gap.
    """

    def __init__(self, start: float, interval: float, apart: float) -> None:
        self.interval, self.apart = interval, apart
        self.rows, self.behind, self.last = 0, np.array([start]), start

    def take(self, t: Array) -> Array:
        """(n,) times of the next rows, whose stamps are t (n,) [s]."""
        late = t - self.interval * np.arange(self.rows, self.rows + t.size)
        jumps = np.flatnonzero(np.diff(t, prepend=self.last) > GAP * self.apart + self.interval)
        out = np.empty(t.size)
        for first, last in pairwise((0, *jumps.tolist(), t.size)):
            if first in jumps:
                self.behind[0] += max(late[first] - self.behind[0], 0.0)
            out[first:last] = weighted_means(late[first:last, None], SLOWLY, self.behind)[:, 0]
        out += self.interval * np.arange(self.rows, self.rows + t.size)
        self.rows, self.last = self.rows + t.size, float(t[-1]) if t.size else self.last
        return out


def by_rows(t: Array) -> ByRows | None:
    """The clock of a log whose first stamps t (n,) say when rows came, not when they were read.

    Packets of a bus or a line are stamped as they arrive, and clocks of few digits or slow ticks give several rows one stamp.
    None where stamps are single, or no even clock is within the time from one bunch to the next of all of them.
    """
    if t.size < FEWEST or not np.isfinite(t).all():
        return None
    dt = np.diff(t)
    together = dt < TOGETHER * dt.mean()
    if dt.min() < 0.0 or together.mean() < BUNCHED or np.count_nonzero(~together) < FEWEST_BUNCHES:
        return None
    apart, row = float(np.median(dt[~together])), _every(t, math.nan)
    interval, start = np.polyfit(row, t, 1).tolist()
    near = np.abs(t - start - interval * row).max() < ARRIVES * apart
    return ByRows(start, interval, apart) if near and apart < LONGEST_S else None


def _every(t: Array, interval: float) -> Array:
    """(n,) numbers of the samples where no row is missing."""
    return np.arange(t.size).astype(np.float64)


def _rounded(t: Array, interval: float) -> Array:
    """(n,) numbers of the samples of a clock whose interval is known."""
    return np.round((t - t[0]) / interval).astype(np.float64)


def _tracked(t: Array, interval: float, share: float = 0.5) -> Array:
    """(n,) numbers of the samples where rows are missing and the interval is known about: by a clock that follows the stamps.

    share: of the stretches of stamps, how many lack no row.
    """
    interval = _usual(t, share)
    count, number, at = np.zeros(t.size), 0.0, float(t[0])
    for k, stamp in enumerate(t[1:].tolist(), 1):
        ahead = max(round((stamp - at) / interval), 1)
        number, at = number + ahead, at + ahead * interval
        at += FOLLOWS * (stamp - at)
        count[k] = number
    return count


def on_its_clock(log: Log, rig: Rig) -> Log:
    """A whole log on an even clock where its stamps are those of one, with a row without readings for each that is missing.

    Gaps longer than `LONGEST_S` stay.
    """
    if log.t.size < 2:
        return log
    clock, usual = clock_of(log.t), _usual(log.t)
    step = clock.resolution_s or _step_of(log.t, usual, float(np.median(np.diff(log.t))))
    if step:
        t = even(log.t, clock.interval_s if clock.resolution_s else usual, step)
        if t is log.t:
            return log  # a gap may be of the rounding
        log = replace(log, t=t)
    missing = _missing(log.t)
    return _with_rows(log, missing, rig) if missing.size else log


def _usual(t: Array, share: float = 0.5) -> float:
    """The interval of a clock whose stamps are rounded [s]: the mean of a few, where such a share of these lacks no row."""
    window = min(WINDOW, t.size - 1)
    return float(np.quantile((t[window:] - t[:-window]) / window, share))


def _step_of(t: Array, *usual: float) -> float | None:
    """The power of ten to which the last stamps are rounded, so coarsely that intervals are no multiples of a usual one; None
    for finer ones.

    Stamps of so many digits have ten times the step from ten seconds on.
    """
    if t.size < FEWEST:
        return None
    interval, apart = usual[0], np.diff(t)
    for one in usual:
        if np.abs(apart / one - np.round(apart / one)).max() < JITTER:
            return None
    last = t[np.abs(t) >= 10.0 ** math.floor(math.log10(max(abs(t[-1]), 1e-300)))]
    for step in STAMPS_S:
        ticks = (last - last[0]) / step
        if step < interval < COARSE * step and np.abs(ticks - np.round(ticks)).max() < ALIKE:
            return step
    return None


def _missing(t: Array) -> Array:
    """Times of the rows that short gaps of a clock lack."""
    apart = np.diff(t)
    interval = float(np.median(apart)) if apart.size else 1.0
    short = np.flatnonzero((apart > GAP * interval) & (apart < LONGEST_S))
    lost = np.round(apart[short] / interval).astype(np.int64) - 1
    within = [t[k] + apart[k] * np.arange(1, n + 1) / (n + 1) for k, n in zip(short, lost, strict=True)]
    return np.concatenate(within) if within else np.empty(0)


def _with_rows(log: Log, missing: Array, rig: Rig) -> Log:
    """The log with more rows, in which no channel was read; what is commanded there follows from the rows around."""
    t = np.concatenate((log.t, missing))
    order = np.argsort(t, kind="stable")
    unread = np.full(missing.size, np.nan)
    filled: dict[str, Any] = {"t": missing, "z": np.full((missing.size, 3), np.nan), "force": unread}
    filled["w_cmd"] = np.interp(missing, *corners(log.t, log.w_cmd, rig.model["accel_cmd"]))
    every = {name: getattr(log, name) for name in SAMPLES}
    new: dict[str, Any] = {
        name: np.concatenate((old, _between(filled.get(name), log.t, old, missing)))[order]
        for name, old in every.items()
        if old is not None
    }
    return replace(log, **new)


def _between(known: NDArray[np.float64] | None, t: Array, old: Array, missing: Array) -> Array:
    """Values of a column at the missing times: known ones, else on the line between its rows."""
    return np.interp(missing, t, old) if known is None else known
