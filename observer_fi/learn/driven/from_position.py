"""Mechanics of a motor from its current and position alone: equation 1 integrated twice against the position, Km the maker's.

A position that is late is the speed besides. One sample made an inertia 20 % smaller at 500 Hz.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.learn.driven.least_squares import (
    SKEW,
    Solution,
    integral,
    load_integrals,
    of_maker,
    solve,
    without,
)
from observer_fi.learn.driven.windows import Window, interval_of
from observer_fi.physics import Rig
from observer_fi.records import Array

_OF_MOTION = ("J", "viscous_positive")  # of equation 1, what multiplies an acceleration or a speed
_PASSES = 3  # in which the speed that a late position shows settles


class FromPosition(NamedTuple):
    """What current and position tell. values, covariance: of `names`; late: the position against the current [s], with its
    standard error; sigma, n: of the position [rad].
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    late: tuple[float, float]
    sigma: float
    n: int


def from_position(windows: Sequence[Window], rig: Rig, names: tuple[str, ...]) -> FromPosition:
    """What `names` says of the mechanics, J first.

    All values are in proportion to the maker's Km, and what multiplies a speed or an acceleration to D as well (`left_open`). The
    covariance is for these two as they are: whoever takes the values takes them, too.
    """
    model = rig.model
    once = [
        np.column_stack([model["Km"] * integral(w.t, w.z[:, 1]), *load_integrals(w, names[1:])])
        for w in windows
    ]
    twice = [
        np.column_stack([integral(w.t, g) for g in each.T]) for w, each in zip(windows, once, strict=True)
    ]
    free = [np.column_stack([np.ones(at.size), at]) for at, _ in (w.positions for w in windows)]
    y = [
        without(w.positions[1][:, None] / model["D"], own)[:, 0] for w, own in zip(windows, free, strict=True)
    ]

    def solved(columns: Sequence[Array]) -> Solution:
        rows = [without(w.where_seen(G), own) for w, G, own in zip(windows, columns, free, strict=True)]
        return solve(rows, y, 2 * len(windows))

    s = solved(twice)
    for _ in range(_PASSES):
        speed = [each @ s.x[: len(names)] for each in once]
        s = solved([np.column_stack([G, -w]) for G, w in zip(twice, speed, strict=True)])
    alone = s.of(-1)
    s = s.knowing(len(names), 0.0, SKEW * interval_of(windows))
    values = np.concatenate(([1.0], s.x[1:-1])) / s.x[0]
    slope = np.eye(len(names), s.x.size) / s.x[0]
    slope[:, 0] = -values / s.x[0]
    return FromPosition(names, values, slope @ s.covariance @ slope.T, alone, s.sigma, s.n)


def left_open(names: Sequence[str], values: Array, rig: Rig) -> Array:
    """Standard deviations that the maker's Km and D leave of values from current and position."""
    moved = of_maker(rig, "D") * np.isin(names, _OF_MOTION)
    return np.asarray(np.abs(values) * np.hypot(of_maker(rig, "Km"), moved))
