"""Which low-pass filter the logger of a campaign puts before its readings, told by fits of the starts of its first moves.

A current that comes through a clamp of 30 Hz makes constants 10 to 150 % wrong, with small standard errors. No constants are
known yet, so that each filter is tried with those that then fit best. Only what no other constants explain is a filter, and
only where readings then are explained about as well as their noise lets.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.learn.gauss_newton import Free, Point
from observer_fi.learn.joint_likelihood import JointFit, Part, best_point
from observer_fi.learn.logger.filtered_readings import DRIVE, LATE, TIME, Through
from observer_fi.learn.move_data import Experiment, select
from observer_fi.physics import Model
from observer_fi.records import Array

# Channels that may have the same filter: current, voltage and current. A filter before the position changes no constant, and
# one before all looks like a servo that is later.
CURRENT = (1,)
GROUPS = (CURRENT, DRIVE, (0,))
TIMES = (2.5, 16.0)  # time constants in samples from which fits begin
# Mean square of the normalised residuals of a channel, in starts, and in whole moves with their long steady parts: less leaves
# nothing for a filter.
LOOKED_AT, LOOKED_AT_WHOLE = 1.6, 1.15
NOTICED_NATS = 40.0  # that a filter must be better than none, and than a delay
FASTEST = 0.11  # samples of a time constant that is at its bound
SLOWEST = (
    99.0  # samples of one that is at its other bound: nothing comes through, as through a sensor that is dead
)
LEFT = 0.1  # of the misfit over that of noise, that a filter may leave of what there is without it
OFFSET = 3e-3  # of the supply, and of what it drives through the winding: one sigma of zero offsets beside a filter
_SPARE = (
    1.2  # times the objective of readings that are explained as well as that: priors have their part in it
)
CLIMBED = 2  # first fits that are looked at closer
MOVES, AFTER_S = 2, 0.25  # of a campaign, and of each from its start on


class Tried(NamedTuple):
    """A filter, None for no filter, and the fit with it."""

    through: Through | None
    point: Point


def needed(fitted: JointFit) -> bool:
    """Whether a fit leaves what a filter might explain."""
    return max(_misfit(r) for r in fitted.residuals) > LOOKED_AT_WHOLE


def filter_of(
    parts: Sequence[Part], plant: Model, free: Sequence[Free], values: Mapping[str, float]
) -> tuple[Through, dict[str, float]] | None:
    """The filter of a campaign and the values that fit with it, None where none is told. values: from which fits begin.

    Or the delay of its current, which nothing of a rig makes: a voltage that is late is a cause, and both are a servo's.
    """
    starts = _starts(parts)
    if not starts:
        return None
    trial = _Trial(
        starts, plant, [*free, *_offsets(plant)], {"voltage_offset": 0.0, "current_offset": 0.0, **values}
    )
    none = trial.tried(None, 0.0)
    before = _misfit(none.point.residuals)
    if before < LOOKED_AT:
        return None
    trial.goal = _SPARE * 0.5 * np.count_nonzero(none.point.residuals) * _allowed(before)
    delayed = [trial.tried(Through(channels, 0), 0.0) for channels in GROUPS]
    first = [trial.tried(Through(channels, 1), time) for channels in GROUPS for time in TIMES]
    first.sort(key=_cost)
    second = [trial.again(one, 2) for one in first[:CLIMBED]]
    best = min((one for one in first + second if not trial.is_none(one)), key=_cost, default=none)
    rival = min(none, *delayed, key=_cost)
    if _cost(best) > _cost(rival) - NOTICED_NATS:
        best = rival
    known = best.through is not None and (best.through.order > 0 or _is_late_current(best))
    if not known or best.through is None or _cost(best) > _cost(none) - NOTICED_NATS or trial.is_dead(best):
        return None
    told = _misfit(best.point.residuals) < _allowed(before)
    return (best.through, best.point.values) if told else None


def _allowed(before: float) -> float:
    """Mean square that a filter may leave where the fit without one leaves `before`."""
    return 1.0 + LEFT * (before - 1.0)


def _offsets(plant: Model) -> list[Free]:
    """Zero offsets of voltage and current, which a filter must not stand for, and whose misfit must not hide one."""
    volt = OFFSET * plant["Vmax"]
    ampere = volt / (plant["Rm"] + plant["Rs"])
    pairs = (("voltage_offset", volt), ("current_offset", ampere))
    known = plant.effects
    return [Free(name, 0.01 * std, prior_std=std) for name, std in pairs if name not in known]


def _is_late_current(one: Tried) -> bool:
    return one.through is not None and one.through.channels == CURRENT and one.point.values[LATE] > 0.0


def _cost(one: Tried) -> float:
    return one.point.objective


def _misfit(r: Array) -> float:
    """Largest mean square of a channel's normalised residuals (n, 3), of those that count."""
    counted = np.maximum((r != 0.0).sum(axis=0), 1)
    return float(((r**2).sum(axis=0) / counted).max())


class _Trial:
    """Fits of the same starts with one filter or another."""

    def __init__(
        self, starts: Sequence[Part], plant: Model, free: Sequence[Free], values: Mapping[str, float]
    ) -> None:
        self.starts, self.plant, self.free, self.values = starts, plant, free, values
        self.goal = math.inf  # objective that no fit needs to go on for that will not come there
        self.interval = float(np.median(np.diff(starts[0].experiment.t[starts[0].experiment.weight.any(1)])))

    def is_none(self, one: Tried) -> bool:
        """Whether a filter has gone as fast as it may: what is left of it is a delay."""
        return one.point.values[TIME] < FASTEST * self.interval

    def is_dead(self, one: Tried) -> bool:
        """Whether a filter has gone as slow as it may."""
        return one.point.values.get(TIME, 0.0) > SLOWEST * self.interval

    def tried(self, through: Through | None, samples: float) -> Tried:
        """The fit with a filter, from a time constant of so many samples on."""
        return self._from(through, {**self.values, TIME: samples * self.interval})

    def again(self, one: Tried, order: int) -> Tried:
        """The fit with a filter of the same channels, from where that of another one ended."""
        assert one.through is not None
        return self._from(one.through._replace(order=order), one.point.values)

    def _from(self, through: Through | None, values: Mapping[str, float]) -> Tried:
        parts = [part._replace(through=through) for part in self.starts]
        more = through.free(self.interval) if through else []
        begun = {**{f.name: f.prior for f in more}, **values}
        return Tried(through, best_point(parts, self.plant, [*self.free, *more], begun, self.goal))


def _starts(parts: Sequence[Part]) -> list[Part]:
    """The first moves of some logs that keep their coupling, from their starts until the loop has settled."""
    taken: list[Part] = []
    left = MOVES
    for part in parts:
        if part.loses:
            continue
        chosen = range(min(part.experiment.moves, left))
        left -= len(chosen)
        if chosen:
            taken.append(part._replace(experiment=_begin(select(part.experiment, list(chosen)))))
    return taken


def _begin(experiment: Experiment) -> Experiment:
    """Each move from its start until the loop has settled."""
    first = experiment.t[experiment.bounds[:-1]]
    kept = experiment.t - np.repeat(first, np.diff(experiment.bounds)) < AFTER_S
    sizes = np.add.reduceat(kept, experiment.bounds[:-1])
    return replace(
        experiment,
        **{name: getattr(experiment, name)[kept] for name in ("t", "theta", "z", "weight", "fine", "phase")},
        bounds=np.concatenate(([0], np.cumsum(sizes))).astype(np.int64),
    )
