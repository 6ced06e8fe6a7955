"""The output-error likelihood of several logs at once, with coupling losses and a contact point per log.

Every move is simulated open loop from the rest before it (`move_data.py`). A log may lose its coupling at a free
time; from there on the plant runs decoupled (equation 12). A parameter named "x_stop_high@2" belongs to the log with
index 2 only; all others are shared. Gauss-Newton; two free numbers of every move, the current and the position of
its rest, are projected out.

What is known to mislead is left out: the rest before a move counts as one sample of its mean, since a mass that rests
at the edge of its friction would creep in a simulation of it; and a stop counts until the motor is nearly still,
since where friction catches it lies between two ticks of the servo.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn.contacts_and_losses import Breaks, speed_of
from observer_fi.learn.gauss_newton import (
    NUISANCE_STEP,
    Free,
    Point,
    covariance_of,
    moved,
    newton_step,
    point_at,
    project,
    scales,
    scatter,
    search,
    stepped,
)
from observer_fi.learn.logger.filtered_readings import NAMES, Through
from observer_fi.learn.move_data import Experiment, commands, prepare, run, show, simulate_each
from observer_fi.learn.output_error import inflation
from observer_fi.learn.servo.command_timing import doubtful
from observer_fi.logs import is_recovered, moves_from_rest
from observer_fi.physics import Model, Rig, override
from observer_fi.physics import simulation as s
from observer_fi.records import Array, Log, Segment

_STILL = 30.0  # rad/s: below this a stop is left out
# s: doubt in the timing of a sampled servo that two delays leave, since saturation ends at a tick. Standard errors of
# J and Ki on the independent truth (8 kHz) are a fifth too small without it.
_TIMING = 5e-6
_NEAR = 5e-5  # m: four standard deviations of a position sample, and of a rough stop
_PIECES = 4  # of a sampling interval in a transient, of two integration steps each
_CRAWLS = 0.01  # of the peak command: slower, and a position loop may still be at its last goal
_GAP = 1.5  # sampling intervals: a move with a longer one is left out
Z95 = 1.959964
_QUADRATIC = 0.3  # share by which a profile may differ from the parabola before it is followed


class Part(NamedTuple):
    """One log: its moves, the log's number, and whether it loses its coupling (values["onset@number"], s).

    silent: parameters that this log says nothing about, so that they need no simulation of it. through: a filter before readings.
    """

    experiment: Experiment
    number: int
    loses: bool
    silent: frozenset[str]
    through: Through | None = None


@dataclass(frozen=True)
class JointFit:
    """values and covariance (k, k) of `free`; per part residuals (N, 3) (z - y) / std and nuisance (M, 2) A, m.

    columns (k, N, 3) and around (2, N, 3) over the rows of all parts: changes of the normalised readings for one step of a
    parameter, and of the two numbers of a move. objective [nats]. inflation (k,) of the variances, for residuals that are not
    white or differ from move to move.
    """

    values: dict[str, float]
    free: tuple[Free, ...]
    covariance: Array
    residuals: list[Array]
    nuisance: list[Array]
    objective: float
    inflation: Array
    columns: Array
    around: Array
    plant: Model
    converged: bool

    @property
    def std(self) -> dict[str, float]:
        """Standard errors by name, corrected for correlated residuals."""
        return {f.name: float(math.sqrt(v)) for f, v in zip(self.free, np.diag(self.covariance), strict=True)}


def part_of(
    log: Log, rig: Rig, number: int, breaks: Breaks, share: float = 1.0, motion: Log | None = None
) -> Part | None:
    """A log ready to be fitted, or None where it holds no move that can be simulated from a rest.

    share: of its moves that is taken (`spread_moves`). motion: the same log as its motion is told from, without its filters.
    """
    moves = [_from_still(log, m) for m in moves_from_rest(log) if not _has_gap(log, m)]
    try:
        experiment = prepare([log], rig, [moves], share)
    except ValueError:
        return None
    cornered = doubtful(experiment, [is_recovered(log)]) if rig.driven.command is None else []
    if cornered:  # a ramp that begins in one interval and ends in the next is no softer one
        experiment = replace(experiment, knots=(cornered[0].knots,))
    w = speed_of(motion or log, rig.model)
    ends = [_still_from(log, w, _move_at(moves, experiment, m), rig.model) for m in range(experiment.moves)]
    silent = set() if breaks.loss is not None else {"A_decoupled", "J_decoupled"}
    if breaks.stop_high is None and breaks.stop_low is None:
        silent |= {"C", "E"}
    experiment = replace(experiment, fine=experiment.fine | _near_stop(experiment, breaks))
    experiment = _with_timing(experiment)
    if rig.driven.command is not None:
        experiment = _without_rests(experiment)
    experiment = _refined(_trimmed(experiment, ends))
    return Part(experiment, number, breaks.loss is not None, frozenset(silent))


def _from_still(log: Log, move: Segment) -> Segment:
    """The move from the last sample on at which its command stands: what is too slow to count as motion drives a servo."""
    speed, start = np.abs(log.w_cmd), move.start
    while start > move.rest and 0.0 <= speed[start - 1] < speed[start]:
        start -= 1
    return move._replace(start=start)


def _has_gap(log: Log, move: Segment) -> bool:
    dt = np.diff(log.t[max(move.start - 3, 0) : min(move.stop + 3, log.t.size)])
    return bool(dt.size and dt.max() > _GAP / log.rate_hz)


def _move_at(moves: Sequence[Segment], experiment: Experiment, m: int) -> Segment:
    begin = int(experiment.start[m] + experiment.moving[m])
    return next(move for move in moves if move.start == begin)


def _still_from(log: Log, w: Array, move: Segment, model: Model) -> int:
    """First row of a stop that is left out: the motor, whose speed is w (n,), is nearly still there."""
    brake = move.stop - int(abs(move.peak) / (model["accel_cmd"] or math.inf) * log.rate_hz) - 2
    speed = np.sign(move.peak) * w[max(brake, move.start) : move.end]
    slow = np.flatnonzero(speed < min(_STILL, 0.2 * abs(move.peak)))
    return max(brake, move.start) + int(slow[0]) if slow.size else move.end


def _without_rests(experiment: Experiment) -> Experiment:
    """The experiment of a position servo, whose loop goes on in a rest: it integrates what is left to the goal, and crawls.

    A mean of it is not what a move begins with then, and the voltage tells of a speed that no simulation from rest has until the
    command is faster than a crawl.
    """
    weight = experiment.weight.copy()
    for m in range(experiment.moves):
        rows, own = experiment.rows(m), weight[experiment.rows(m)]
        own[: experiment.moving[m]] = 0.0
        fast = np.abs(experiment.w_cmd(m)) > _CRAWLS * abs(experiment.peak[m])
        own[: max(int(np.argmax(fast)), int(experiment.moving[m]) + 1), 0] = 0.0
        weight[rows] = own
    return replace(experiment, weight=weight)


def _trimmed(experiment: Experiment, ends: Sequence[int]) -> Experiment:
    """The experiment with each rest as one weighted mean, and each stop without weight from its end row on."""
    used = np.zeros(experiment.t.size, dtype=bool)
    z, weight = experiment.z.copy(), experiment.weight.copy()
    for m, end in enumerate(ends):
        rows = experiment.rows(m)
        begin = rows.start + int(experiment.moving[m])
        last = min(rows.start + max(end - int(experiment.start[m]), 1), rows.stop)
        used[begin:last] = True
        squared = weight[rows.start : begin + 1] ** 2
        total = squared.sum(axis=0)
        z[begin] = (squared * z[rows.start : begin + 1]).sum(axis=0) / np.maximum(total, 1e-300)
        weight[begin] = np.sqrt(total)
    sizes = [int(used[experiment.rows(m)].sum()) for m in range(experiment.moves)]
    return replace(
        experiment,
        t=experiment.t[used],
        theta=experiment.theta[used],
        z=z[used],
        weight=weight[used],
        fine=experiment.fine[used],
        phase=experiment.phase[used],
        bounds=np.concatenate(([0], np.cumsum(sizes))).astype(np.int64),
        start=experiment.start + experiment.moving,
        moving=np.zeros_like(experiment.moving),
    )


def _with_timing(experiment: Experiment) -> Experiment:
    """The experiment with the noise of every sample widened by `_TIMING` times the slope of its channel."""
    weight = experiment.weight.copy()
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        doubt = _TIMING * np.abs(np.gradient(experiment.z[rows], experiment.t[rows], axis=0))
        weight[rows] = np.where(weight[rows] > 0.0, 1.0 / np.hypot(experiment.noise, doubt), 0.0)
    return replace(experiment, weight=weight)


def _near_stop(experiment: Experiment, breaks: Breaks) -> NDArray[np.bool_]:
    """(N,) samples close to a stop: the rate of x changes inside a step there, as much as the stop's standard error."""
    x = experiment.z[:, 2]
    stops = [stop for stop in (breaks.stop_high, breaks.stop_low) if stop is not None]
    return (
        np.any([np.abs(x - stop) < _NEAR for stop in stops], axis=0)
        if stops
        else np.zeros(x.size, dtype=np.bool_)
    )


def _refined(experiment: Experiment) -> Experiment:
    """The experiment with rows of no weight between the samples of a transient and near a stop.

    Saturation and contact begin and end inside a step, which costs a step's error there: without these rows the likelihood has
    corners as high as a nat, and errors of a standard error.
    """
    last = np.zeros(experiment.t.size, dtype=bool)
    last[experiment.bounds[1:] - 1] = True
    count = np.where(experiment.fine & ~last, _PIECES, 1)
    origin = np.repeat(np.arange(experiment.t.size), count)
    first = np.cumsum(count) - count
    share = (np.arange(origin.size) - first[origin]) / count[origin]
    dt = np.append(np.diff(experiment.t), 0.0)
    sample = share == 0.0
    return replace(
        experiment,
        t=experiment.t[origin] + share * dt[origin],
        theta=experiment.theta[origin],
        z=np.where(sample[:, None], experiment.z[origin], 0.0),
        weight=np.where(sample[:, None], experiment.weight[origin], 0.0),
        fine=experiment.fine[origin],
        phase=experiment.phase[origin],
        bounds=np.append(first, origin.size)[np.append(experiment.bounds[:-1], experiment.t.size)],
    )


def model_of(plant: Model, values: Mapping[str, float], number: int) -> Model:
    """The plant of one log: shared values, and those named for it."""
    own = {
        n.split("@")[0]: v
        for n, v in values.items()
        if n.endswith(f"@{number}") and n.split("@")[0] != "onset"
    }
    shared = {n: v for n, v in values.items() if "@" not in n and n not in NAMES}
    return override(plant, plant.name, **(shared | own))


def predict(part: Part, plant: Model, values: Mapping[str, float], nuisance: Array) -> Array:
    """Readings (N, 3) of one log; nuisance (M, 2) what to add to the measured rest current [A] and position [m]."""
    model = model_of(plant, values, part.number)
    ready = commands(part.experiment, model.vector)
    states, y = run(part.experiment, model, nuisance, ready)
    if part.loses:
        _run_loose(part, model, values[f"onset@{part.number}"], ready, states, y)
    return _as_logged(part, values, y)


def _as_logged(part: Part, values: Mapping[str, float], y: Array) -> Array:
    """Readings (N, 3) behind the filter of a log."""
    if part.through is None:
        return y
    e = part.experiment
    rows = [e.rows(m) for m in range(e.moves)]
    return np.concatenate([part.through.taken(e.t[own], y[own], values) for own in rows])


def _predict_each(
    part: Part, plant: Model, trials: Sequence[tuple[Mapping[str, float], Array]]
) -> list[Array]:
    """As `predict` for several values, with a nuisance each; side by side but for a log that loses its coupling."""
    if part.loses:
        return [predict(part, plant, values, nuisance) for values, nuisance in trials]
    models = [model_of(plant, values, part.number) for values, _ in trials]
    readings = simulate_each(part.experiment, models, [nuisance for _, nuisance in trials])
    return [_as_logged(part, values, y) for (values, _), y in zip(trials, readings, strict=True)]


def _run_loose(
    part: Part, model: Model, onset: float, ready: tuple[Array, Array], states: Array, y: Array
) -> None:
    """Overwrites states and readings from the onset on with those of the decoupled plant."""
    e = part.experiment
    loose = override(model, model.name, coupling=0.0).vector
    for m in range(e.moves):
        rows = e.rows(m)
        t = e.t[rows]
        if onset >= t[-1]:
            continue
        k = int(np.searchsorted(t, onset, side="right")) - 1
        begin = rows.start + max(k, 0)
        start = states[begin, : len(s.STATES)].copy()
        if k >= 0:  # one interval with and one without the mass, mixed: the onset lies between two samples
            share = (onset - t[k]) / (t[k + 1] - t[k])
            after = _two(e, begin, ready, loose, start)
            start = share * states[begin + 1, : len(s.STATES)] + (1.0 - share) * after
            begin += 1
        part_rows = slice(begin, rows.stop)
        s.run(
            e.t[part_rows],
            ready[0][part_rows],
            ready[1][part_rows],
            e.fine[part_rows],
            e.theta[part_rows],
            loose,
            start,
            states[part_rows],
        )
        show(e.t[part_rows], states[part_rows], ready[1][part_rows], loose, y[part_rows])


def _two(e: Experiment, begin: int, ready: tuple[Array, Array], p: Array, start: Array) -> Array:
    """States one sample after `begin`, with the parameters p."""
    rows = slice(begin, begin + 2)
    out = np.empty((2, s.COLUMNS))
    s.run(e.t[rows], ready[0][rows], ready[1][rows], e.fine[rows], e.theta[rows], p, start, out)
    return out[1, : len(s.STATES)]


def residuals_of(part: Part, plant: Model, values: Mapping[str, float], nuisance: Array) -> Array:
    """(N, 3) normalised residuals, 0 where missing; not finite where values far off end in no motion."""
    with np.errstate(invalid="ignore", over="ignore"):
        return (part.experiment.z - predict(part, plant, values, nuisance)) * part.experiment.weight


@dataclass(frozen=True)
class _Joint:
    """The problem that `fit_parts` solves (`gauss_newton.Problem`): the moves of all parts, one part behind the other."""

    parts: Sequence[Part]
    plant: Model
    free: tuple[Free, ...]

    @cached_property
    def rows(self) -> list[slice]:
        """Rows of the residuals that belong to each part."""
        ends = np.cumsum([0, *(p.experiment.t.size for p in self.parts)]).tolist()
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    @cached_property
    def moves(self) -> list[slice]:
        """Moves that belong to each part."""
        ends = np.cumsum([0, *(p.experiment.moves for p in self.parts)]).tolist()
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    @cached_property
    def bounds(self) -> NDArray[np.int64]:
        shifted = [
            rows.start + p.experiment.bounds[1:] for rows, p in zip(self.rows, self.parts, strict=True)
        ]
        return np.concatenate([[0], *shifted]).astype(np.int64)

    @cached_property
    def nuisance_std(self) -> Array:
        """No prior: the mean of a rest is a sample of its own (`_trimmed`)."""
        return np.full((self.bounds.size - 1, 2), np.inf)

    def residuals(self, values: Mapping[str, float], nuisance: Array) -> Array:
        return np.concatenate([
            residuals_of(p, self.plant, values, nuisance[moves])
            for p, moves in zip(self.parts, self.moves, strict=True)
        ])  # fmt: skip

    def columns(self, point: Point) -> tuple[Array, Array]:
        columns = np.zeros((len(self.free), *point.residuals.shape))
        around = np.zeros((2, *point.residuals.shape))
        for part, rows, moves in zip(self.parts, self.rows, self.moves, strict=True):
            self._fill(
                part,
                point.values,
                point.nuisance[moves],
                point.residuals[rows],
                columns[:, rows],
                around[:, rows],
            )
        return columns, around

    def _fill(
        self,
        part: Part,
        values: Mapping[str, float],
        nuisance: Array,
        r: Array,
        columns: Array,
        around: Array,
    ) -> None:
        """Columns (k, n, 3) and (2, n, 3) of one part, in place; a parameter that it does not know leaves zeros."""
        known = [j for j, f in enumerate(self.free) if _touches(f.name, part)]
        step = [f.step if values[f.name] + f.step <= f.high else -f.step for f in self.free]
        there = [
            ({**values, self.free[j].name: values[self.free[j].name] + step[j]}, nuisance) for j in known
        ]
        off = [(values, nuisance + by) for by in np.diag(NUISANCE_STEP)]
        readings = _predict_each(part, self.plant, there + off)
        places = [*(columns[j] for j in known), *around]
        for place, y in zip(places, readings, strict=True):
            place[:] = r - (part.experiment.z - y) * part.experiment.weight
        for j in known:
            columns[j] *= self.free[j].step / step[j]


def _touches(name: str, part: Part) -> bool:
    return name not in part.silent and ("@" not in name or name.endswith(f"@{part.number}"))


def best_point(
    parts: Sequence[Part],
    plant: Model,
    free: Sequence[Free],
    values: Mapping[str, float],
    goal: float = math.inf,
) -> Point:
    """Where Gauss-Newton from `values` ends, without what only a result needs. goal: see `search`."""
    problem = _Joint(parts, plant, tuple(free))
    return search(problem, values, np.zeros((problem.bounds.size - 1, 2)), goal=goal).point


def fit_parts(
    parts: Sequence[Part], plant: Model, free: Sequence[Free], values: Mapping[str, float]
) -> JointFit:
    """Gauss-Newton from `values` on; a parameter at its bound stays there."""
    problem = _Joint(parts, plant, tuple(free))
    found = search(problem, values, np.zeros((problem.bounds.size - 1, 2)))._replace(columns=np.empty(0))
    point = found.point
    columns, around = problem.columns(point)
    r = [point.residuals[rows] for rows in problem.rows]
    factor = max(inflation(p.experiment, e) for p, e in zip(parts, r, strict=True))
    normal = project(problem, columns, around, point)
    covariance = covariance_of(problem.free, normal) * factor
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    wider = np.maximum(scatter(problem.free, point.values, normal) / std, 1.0)
    return JointFit(
        point.values,
        problem.free,
        covariance * np.outer(wider, wider),
        r,
        [point.nuisance[moves] for moves in problem.moves],
        point.objective,
        factor * wider**2,
        columns,
        around,
        plant,
        found.converged,
    )


def profile_interval(parts: Sequence[Part], fitted: JointFit, name: str) -> tuple[float, float]:
    """95 % interval of one parameter: of the parabola, or of the profile likelihood where that differs by 30 %."""
    value, std = fitted.values[name], fitted.std[name]
    return _crossing(parts, fitted, name, value, -Z95 * std), _crossing(parts, fitted, name, value, Z95 * std)


def _crossing(parts: Sequence[Part], fitted: JointFit, name: str, value: float, reach: float) -> float:
    """Where the profile has risen by 1.92 nats (times the inflation), by secant on its square root."""
    goal = 0.5 * Z95**2 * float(fitted.inflation[[f.name for f in fitted.free].index(name)])
    for _ in range(4):
        rise = _profile(parts, fitted, name, value + reach) - fitted.objective
        if not math.isfinite(rise) or rise <= 0.0:
            break
        ratio = math.sqrt(goal / rise)
        if abs(ratio**2 - 1.0) < _QUADRATIC:
            break
        reach *= min(max(ratio, 0.3), 3.0)
    return value + reach


def _profile(parts: Sequence[Part], fitted: JointFit, name: str, at: float) -> float:
    """Least objective with one parameter fixed, by two chord steps with the columns of the fit."""
    j = next(k for k, f in enumerate(fitted.free) if f.name == name)
    others = [k for k in range(len(fitted.free)) if k != j]
    fixed, free = fitted.free[j], tuple(fitted.free[k] for k in others)
    linear = fitted.covariance[others, j] / fitted.covariance[j, j] * (at - fitted.values[name])
    start = stepped(free, {**fitted.values, name: at}, linear / scales(free))
    problem = _Joint(parts, fitted.plant, free)
    point = point_at(problem, start, np.concatenate(fitted.nuisance))
    best = math.inf
    for _ in range(2):
        normal = project(problem, fitted.columns[others], fitted.around, point)
        point = moved(problem, point, newton_step(free, point.values, normal), normal)
        best = min(best, point.objective)
    return best + 0.5 * ((at - fixed.prior) / fixed.prior_std) ** 2


def nll(parts: Sequence[Part], fitted: JointFit) -> float:
    """Mean over the samples of minus the log-likelihood of the measured channels [nats, SI densities]."""
    total, samples = 0.0, 0
    for part, r in zip(parts, fitted.residuals, strict=True):
        weight = part.experiment.weight
        seen = weight > 0.0
        total += 0.5 * float(np.vdot(r, r)) + float(
            np.sum(0.5 * math.log(2.0 * math.pi) - np.log(weight[seen]))
        )
        samples += int(seen.any(axis=1).sum())
    return total / max(samples, 1)
