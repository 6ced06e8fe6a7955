"""When the ramps of a command began, where its samples do not say.

Of a slow log whole ramps lie between two samples, and a recovered command is as good as the motion shows it. What a
ramp sets in motion says it better than the command's own samples: each ramp is shifted until a simulation agrees.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn.gauss_newton import Free, Point, search
from observer_fi.learn.move_data import Experiment, select
from observer_fi.learn.output_error import ParameterFit, residuals
from observer_fi.physics import Model, override
from observer_fi.records import Array

RECOVERED_S = 3e-3  # by which a recovered ramp may be off
KINK = 1e-2  # of the steepest slope: knots between slopes that differ by less lie on one line
MOST_CORNERS = 12  # a move: a command with more is no trapezoid
_STEP = 0.02  # of the range that a ramp may be shifted in, for the derivative
_SHORTEST_S = 1e-6  # of such a range
_WORTH = 1.0  # nats that another step must gain

Knots = tuple[Array, Array]


class Ramp(NamedTuple):
    """A ramp of one log's command in a move, between its knots `first` and `first` + 1; it may be shifted by low to high [s]."""

    move: int
    first: int
    low: float
    high: float


class Command(NamedTuple):
    """The corners of one log's command, and its ramps whose time nobody knows; ended: whether one ends before its next sample."""

    knots: Knots
    ramps: tuple[Ramp, ...]
    ended: bool = False


def doubtful(experiment: Experiment, recovered: Sequence[bool]) -> list[Command]:
    """Each log's command as its corners, with the ramps to be timed; none at all where every ramp is known.

    recovered: whether a log's command was.
    """
    found = [_command(experiment, k, own) for k, own in enumerate(recovered)]
    return found if any(own.ramps or own.ended for own in found) else []


def _command(experiment: Experiment, log: int, recovered: bool) -> Command:
    cornered = _cornered(*experiment.knots[log])
    knots = _steepened(*cornered, experiment.accel, float(np.median(np.diff(experiment.t))))
    moves = np.flatnonzero(experiment.log == log).tolist()
    if len(knots[0]) > MOST_CORNERS * max(len(moves), 1):
        return Command(experiment.knots[log], ())
    ramps = tuple(ramp for m in moves for ramp in _ramps(experiment, m, knots, recovered))
    return Command(knots, ramps, knots[0] is not cornered[0])


def _cornered(t: Array, v: Array) -> Knots:
    """The knots (n,) of a piecewise linear command at which its slope changes, and its ends."""
    slope = np.diff(v) / np.diff(t)
    bends = np.abs(np.diff(slope)) > KINK * max(float(np.abs(slope).max(initial=0.0)), 1e-300)
    kept = np.concatenate(([True], bends, [True]))
    return t[kept], v[kept]


def _steepened(t: Array, v: Array, accel: float, interval: float) -> Knots:
    """Knots (n,) whose ramps go on as they began until they end: behind the only sample on a ramp its end is not in the samples.

    It is taken for a softer line to the next sample, or for a pause and another ramp within that `interval` [s].
    """
    slope = np.diff(v) / np.diff(t)
    steep, flat = np.abs(slope) > (1.0 - KINK) * accel, np.abs(slope) <= KINK * accel
    alike = slope[:-1] * slope[1:] > 0.0
    softer = np.flatnonzero(steep[:-1] & ~steep[1:] & ~flat[1:] & alike & np.append(flat[2:], True))
    again = steep[:-2] & flat[1:-1] & steep[2:] & (slope[:-2] * slope[2:] > 0.0)
    paused = np.flatnonzero(again & (np.diff(t)[1:-1] < interval))
    if not softer.size and not paused.size:
        return t, v
    t, v = t.copy(), v.copy()
    t[softer + 2] = t[softer + 1] + np.abs(v[softer + 2] - v[softer + 1]) / accel
    t[paused + 3] = t[paused + 1] + np.abs(v[paused + 3] - v[paused + 1]) / accel
    t[paused + 2], v[paused + 2] = (
        0.5 * (t[paused + 1] + t[paused + 3]),
        0.5 * (v[paused + 1] + v[paused + 3]),
    )
    return t, v


def _ramps(experiment: Experiment, move: int, knots: Knots, recovered: bool) -> list[Ramp]:
    """The ramps of one move that its samples leave in doubt."""
    t, (at, v) = experiment.t[experiment.rows(move)], knots
    found = []
    for k in np.flatnonzero((at[:-1] >= t[0]) & (at[1:] <= t[-1]) & (np.abs(np.diff(v)) > 0.0)).tolist():
        if recovered:
            room = 0.5 * min(
                at[k] - at[k - 1] if k else np.inf, at[k + 2] - at[k + 1] if k + 2 < at.size else np.inf
            )
            reach = min(RECOVERED_S, room)
            found.append(Ramp(move, k, -reach, reach))
            continue
        before = int(np.searchsorted(t, at[k], side="right")) - 1
        after = int(np.searchsorted(t, at[k + 1], side="left"))
        if after - before == 1:
            found.append(Ramp(move, k, float(t[before] - at[k]), float(t[after] - at[k + 1])))
    return found


def timed(
    experiment: Experiment, commands: Sequence[Command], model: Model, free: Sequence[Free]
) -> Experiment:
    """The experiment with its doubtful ramps where its readings want them, whatever the free parameters of the model then are."""
    ramps = tuple((log, ramp) for log, own in enumerate(commands) for ramp in own.ramps)
    cornered = replace(experiment, knots=tuple(own.knots for own in commands))
    if not ramps:
        return cornered
    problem = _Timing(cornered, model, tuple(free), ramps)
    begun = {f.name: model[f.name] for f in free} | {f.name: 0.0 for f in problem.shifts}
    found = search(problem, begun, np.zeros((experiment.moves, 2)), worth=_WORTH)
    return problem.shifted(found.point.values)


@dataclass(frozen=True)
class _Timing:
    """The problem that `timed` solves (`gauss_newton.Problem`): parameters of the model, and by how much each ramp is shifted."""

    experiment: Experiment
    model: Model
    of_model: tuple[Free, ...]
    ramps: tuple[tuple[int, Ramp], ...]

    @cached_property
    def shifts(self) -> tuple[Free, ...]:
        """A parameter for each ramp [s]."""
        return tuple(
            Free(f"ramp {k}", _STEP * max(ramp.high - ramp.low, _SHORTEST_S), ramp.low, ramp.high)
            for k, (_, ramp) in enumerate(self.ramps)
        )

    @property
    def free(self) -> tuple[Free, ...]:
        return (*self.of_model, *self.shifts)

    @property
    def bounds(self) -> NDArray[np.int64]:
        return self.experiment.bounds

    @property
    def nuisance_std(self) -> Array:
        return self.experiment.nuisance_std

    def shifted(self, values: Mapping[str, float]) -> Experiment:
        """The experiment with its ramps where these values have them."""
        knots = [(at.copy(), v) for at, v in self.experiment.knots]
        for f, (log, ramp) in zip(self.shifts, self.ramps, strict=True):
            knots[log][0][ramp.first : ramp.first + 2] += values[f.name]
        return replace(self.experiment, knots=tuple(knots))

    def model_at(self, values: Mapping[str, float]) -> Model:
        return override(self.model, self.model.name, **{f.name: values[f.name] for f in self.of_model})

    def residuals(self, values: Mapping[str, float], nuisance: Array) -> Array:
        return residuals(self.shifted(values), self.model_at(values), nuisance)

    def columns(self, point: Point) -> tuple[Array, Array]:
        model, here = self.model_at(point.values), self.shifted(point.values)
        own = point._replace(values={f.name: point.values[f.name] for f in self.of_model})
        of_model, around = ParameterFit(here, model, self.of_model).columns(own)
        of_ramps = np.zeros((len(self.shifts), *point.residuals.shape))
        for column, f, (_, ramp) in zip(of_ramps, self.shifts, self.ramps, strict=True):
            by = f.step if point.values[f.name] + f.step <= f.high else -f.step
            beside = self.shifted({**point.values, f.name: point.values[f.name] + by})
            rows = here.rows(ramp.move)
            there = residuals(select(beside, [ramp.move]), model, point.nuisance[[ramp.move]])
            column[rows] = (point.residuals[rows] - there) * (f.step / by)
        return np.concatenate((of_model, of_ramps)), around
