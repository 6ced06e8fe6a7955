"""How a logger holds readings: at which pace they are fresh, and how long one may stand."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import resolution_of
from observer_fi.records import Array

Rows = NDArray[np.int64]
HELD = 0.3  # share of repeated readings from which a channel may be held
SAME_PACE = 0.15  # relative: as often as steps of the reading at its speed
IN_TURN = 0.8  # of a period: changes that come sooner after another are none of ticks
OUT_OF_TURN = 0.02  # share of changes that may come sooner than a tick after another
TICKS = 12  # changes that tell an update rate
MISSED = 1.5  # times the usual time between two updates: one was missed
# Of readings that are held unevenly: times the usual time between two changes that hardly any exceeds, and steps of the
# readings by which they change.
UNEVEN, MANY_STEPS = 3.0, 5.0


class Hold(NamedTuple):
    """every: samples between two updates; longest: that a reading stands for, None where that is a whole number of `every`."""

    every: float
    longest: float | None


def hold_of(row: Rows, z: Array, w_cmd: Array) -> Hold | None:
    """How a logger holds the readings z (n,) of a channel, None where it does not. row: (n,) counts missing samples too.

    w_cmd: (n,) commanded speed.
    """
    same = np.append(True, np.diff(z) == 0.0)
    at = np.flatnonzero(~same & np.isfinite(z))
    if same.mean() < HELD or at.size < TICKS:
        return None
    steady = np.append(False, np.diff(w_cmd) == 0.0) & (w_cmd != 0.0)
    elsewhere = at[~steady[at]]
    apart = np.diff(row[at])
    every, uneven = _regular_pace(row, z, w_cmd, at, steady, elsewhere), _uneven_pace(row, z, at, elsewhere)
    if every is None or (uneven is not None and np.median(apart) > MISSED * every):  # a comb that is too fine
        every = uneven
    if every is None:
        return None
    in_turn = apart < (MISSED if uneven is None else UNEVEN) * every
    longest = float(apart[in_turn].max(initial=0))
    return Hold(every, longest if longest > math.ceil(every) else None)


def _uneven_pace(row: Rows, z: Array, at: Rows, elsewhere: Rows) -> float | None:
    """Samples between two updates that come when they may: readings of noise, which no sensor repeats to the last digit."""
    changes, apart = np.diff(z), np.diff(row[at])
    step, usual = resolution_of(changes), float(np.median(apart))
    if elsewhere.size < TICKS // 2 or (step and np.median(np.abs(changes[at - 1])) < MANY_STEPS * step):
        return None
    in_turn = np.mean(apart == 1) < OUT_OF_TURN and np.quantile(apart, 0.95) < UNEVEN * usual
    return float(np.mean(apart)) if in_turn else None


def _regular_pace(
    row: Rows, z: Array, w_cmd: Array, at: Rows, steady: NDArray[np.bool_], elsewhere: Rows
) -> float | None:
    """Samples between two updates that come at regular times.

    A step of coarse readings at constant speed does too: the updates of a hold are regular at rest and while the speed
    changes as well.
    """
    period = _period(row[at], int(row[-1]) + 1)
    if period is None:
        return None
    if elsewhere.size < TICKS // 2 and _of_steps(z, w_cmd, period):
        return None
    groups = [g for g in (at[steady[at]], elsewhere) if g.size >= TICKS // 2]
    return period if all(_regular(row[g], period) > 0.8 * np.sinc(1.0 / period) for g in groups) else None


def _of_steps(z: Array, w_cmd: Array, period: float) -> bool:
    """Whether changes come as often as a reading in steps makes them at constant speed."""
    step = resolution_of(np.diff(z))
    steady = np.append(False, np.diff(w_cmd) == 0.0) & (w_cmd != 0.0)
    speed = abs(float(np.mean(np.diff(z)[steady[1:]]))) if steady[1:].any() else 0.0
    return step is not None and abs(speed * period / step - 1.0) < SAME_PACE


def _regular(at: NDArray[np.int64], period: float) -> float:
    """How regular times are with a period: 1 where they are all at the same phase, 0 where anywhere."""
    return float(abs(np.exp(2j * np.pi * at / period).mean()))


def _period(at: NDArray[np.int64], n: int) -> float | None:
    """The longest period, 2 samples at least, at whose ticks all times are."""
    marks = np.zeros(1 << (4 * n - 1).bit_length())
    marks[at] = 1.0
    spectrum = np.abs(np.fft.rfft(marks)) / at.size
    lowest = int(8 * marks.size / (at[-1] - at[0] + 1))
    found = np.flatnonzero(spectrum[lowest : marks.size // 2] > 0.75)
    if not found.size:
        return None
    k = lowest + int(found[0])
    k += int(np.argmax(spectrum[k : k + 8]))
    around = marks.size / np.linspace(k - 1.0, k + 1.0, 81)
    period = float(max(around, key=lambda period: _regular(at, period)))
    if (
        np.mean(np.diff(at) < IN_TURN * period - 1.0) > OUT_OF_TURN
    ):  # many steps at once, none of them at a tick of its own
        return None
    return float(np.polyfit(np.round((at - at[0]) / period), at, 1)[0])
