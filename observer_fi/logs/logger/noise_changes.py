"""Noise of a channel that changes while a motor runs steadily: another range, a burst, or a sensor at the end of its range."""

import math
from typing import NamedTuple

import numpy as np

from observer_fi.logs.logger.in_motion import RING_S, fourth_differences
from observer_fi.numerics import constant_runs
from observer_fi.records import Array

STRETCH = 64  # samples of which the noise is told at a time
# Stretches before and behind a change, and by how many times the noise of each before must differ from that of each behind: of
# white noise two such pairs in a thousand moves differ by 1.5, and six on either side by none.
SIDES = ((2, 3.0), (6, 1.3))
STANDS = 0.01  # of the loudest stretch: readings with less noise are taken to have so much, as they may have none at all


class NoiseChange(NamedTuple):
    """By how many times the noise of readings has grown, below 1 where it fell; when, and to how much that is known [s]."""

    factor: float
    at_s: float
    within_s: float


def noise_change(t: Array, z: Array, w_cmd: Array, floor: float = 0.0) -> NoiseChange | None:
    """The largest change of the noise of readings z (n,) within motion at one speed, None where it stays as it is.

    What moves leaves nothing of fourth differences, and noise that comes with a motion or goes with its speed is the same
    throughout such a stretch. Of held readings it tells how often they change, which is no noise. floor: noise below which
    readings do not show it, 0 where they do, and what `shown_by` says of those in steps.
    """
    found = [change for run in _steady_runs(t, w_cmd) if (change := _largest(t[run], z[run], floor))]
    return _most(found)


def _steady_runs(t: Array, w_cmd: Array) -> list[slice]:
    """Where a command other than 0 has stood still for the time of a start's ring, until it changes."""
    runs = []
    for first, last in constant_runs(w_cmd):
        begin = int(np.searchsorted(t, t[first] + RING_S))
        if w_cmd[first] != 0.0 and last - begin >= (2 * SIDES[0][0] + 1) * STRETCH:
            runs.append(slice(begin, last))
    return runs


def shown_by(step: float, moves: bool) -> float:
    """Noise that readings in steps show, whatever it is in truth, in their unit.

    moves: whether what is read goes from step to step.

    Of noise far below a step they show up to half a step, as the signal lies at the edge of one; of a signal that moves its
    rounding, which is up to a step in fourth differences.
    """
    return step if moves else 0.5 * step


def _largest(t: Array, z: Array, floor: float) -> NoiseChange | None:
    """The largest change of noise among readings z (n,) of one steady motion: between stretches on either side of one more, in
    which it changes.
    """
    count = z.size // STRETCH
    levels = np.array([fourth_differences(part) for part in z[: count * STRETCH].reshape(count, STRETCH)])
    if not np.isfinite(levels).all() or not levels.max() > 0.0:
        return None
    within = float(t[STRETCH] - t[0])
    logs = np.log(np.maximum(levels, max(STANDS * levels.max(), floor)))
    found = [
        NoiseChange(
            math.exp(float(behind.mean() - before.mean())), float(t[k * STRETCH + STRETCH // 2]), within
        )
        for side, times in SIDES
        for k in range(side, count - side)
        for before, behind in ((logs[k - side : k], logs[k + 1 : k + 1 + side]),)
        if max(behind.min() - before.max(), before.min() - behind.max()) > math.log(times)
    ]
    return _most(found)


def _most(found: list[NoiseChange]) -> NoiseChange | None:
    return max(found, key=lambda change: abs(math.log(change.factor)), default=None)
