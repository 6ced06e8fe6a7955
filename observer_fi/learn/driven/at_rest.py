"""The resistance of a winding from rests in which the servo still drives: V = Rm i + V0 while friction holds the motor.

No lateness and no inductance is in it, and no time between samples, which make Rm uncertain by a percent in the moves of a slow
log. A voltage that the brushes drop is in it, though, and larger beside a small current than in motion.
"""

from collections.abc import Sequence

import numpy as np

from observer_fi.learn.driven.windows import TURNS, Driven, speed_of
from observer_fi.numerics import constant_runs
from observer_fi.physics import Rig
from observer_fi.records import Array

_SETTLES_S, _LASTS_S = 0.05, 0.1  # after a motion; of a rest, behind that
_FEWEST, _ROWS = 4, 8  # rests; rows of one, and positions in it
_MOVED = 3.0  # standard errors by which the second half of a rest is elsewhere


def resistance_at_rest(each: Sequence[Driven], rig: Rig) -> tuple[float, float] | None:
    """Rm and its standard error [ohm], of the scatter between rests; None where there are too few, or of one current."""
    rests = np.array([pair for one in each for pair in _rests(one, rig)])
    if len(rests) < _FEWEST or np.ptp(rests[:, 0]) == 0.0:
        return None
    i, V = (rests - rests.mean(axis=0)).T
    Rm = float(i @ V / (i @ i))
    left = V - Rm * i
    return Rm, float(np.sqrt(left @ left / (len(rests) - 2) / (i @ i)))


def _rests(each: Driven, rig: Rig) -> list[Array]:
    """Mean current [A] and voltage [V] of every rest."""
    log, rows = each.log, np.arange(each.log.t.size)
    stands = np.abs(speed_of(log, rig.model)[1]) < TURNS
    stands &= np.isfinite(log.z[:, :2]).all(axis=1)
    found = []
    for first, last in constant_runs(stands.astype(np.int8)):
        if not stands[first]:
            continue
        start = log.t[first] + (_SETTLES_S if first else 0.0)
        own = rows[first:last][
            (log.t[first:last] >= start) & (log.t[first:last] < log.t[last - 1] - _SETTLES_S)
        ]
        if (
            own.size >= _ROWS
            and np.ptp(log.t[own]) > _LASTS_S
            and not _moves(each, log.t[own[0]], log.t[own[-1]])
        ):
            found.append(log.z[own][:, [1, 0]].mean(axis=0))
    return found


def _moves(each: Driven, start: float, end: float) -> bool:
    """Whether the position moves from one half of a rest to the other, or does not tell."""
    at, x = each.seen
    own = x[(at >= start) & (at <= end)]
    if own.size < _ROWS:
        return True
    halves = np.array_split(own, 2)
    std = float(np.hypot(*(half.std(ddof=1) / np.sqrt(half.size) for half in halves)))
    return abs(float(halves[1].mean() - halves[0].mean())) > _MOVED * std
