"""The output-error likelihood of several logs at once, with coupling losses and a contact point per log.

Every move is simulated open loop from the rest before it (`experiment.py`). A log may lose its coupling at a free
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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn.gauss_newton import Free, inflation
from observer_fi.learn.kinematic_breaks import Breaks, speed_of
from observer_fi.learn.move_data import Experiment, commands, cut_moves, prepare, run, simulate_each
from observer_fi.numerics import along, gram, self_gram, square
from observer_fi.physics import Model, Rig, override
from observer_fi.physics import simulation as s
from observer_fi.records import Array, Log, Segment

_ITERATIONS = 30
_HALVINGS = 8
_DONE = 0.01  # nats that a step must gain to be worth another one
_CONDITION = 1e-12
_NUISANCE = np.array([1e-4, 1e-6])  # A, m: steps of the two free numbers of a move
_STILL = 30.0  # rad/s: below this a stop is left out
# s: doubt in the timing of a sampled servo that two delays leave, since saturation ends at a tick. Standard errors of
# J and Ki on the independent truth (8 kHz) are a fifth too small without it.
_TIMING = 5e-6
_NEAR = 5e-5  # m: four standard deviations of a position sample, and of a rough stop
_PIECES = 4  # of a sampling interval in a transient, of two integration steps each
_GAP = 1.5  # sampling intervals: a move with a longer one is left out
Z95 = 1.959964
_QUADRATIC = 0.3  # share by which a profile may differ from the parabola before it is followed


class Part(NamedTuple):
    """One log: its moves, the log's number, and whether it loses its coupling (values["onset@number"], s).

    silent: parameters that this log says nothing about, so that they need no simulation of it.
    """

    experiment: Experiment
    number: int
    loses: bool
    silent: frozenset[str]


@dataclass(frozen=True)
class JointFit:
    """values and covariance (k, k) of `free`; per part residuals (N, 3) (z - y) / std and nuisance (M, 2) A, m.

    columns per part (k, N, 3) and around (2, N, 3): changes of the normalised readings for one step of a parameter, and
    of the two numbers of a move. objective [nats].
    """

    values: dict[str, float]
    free: tuple[Free, ...]
    covariance: Array
    residuals: list[Array]
    nuisance: list[Array]
    objective: float
    inflation: float
    columns: list[Array]
    around: list[Array]
    plant: Model
    converged: bool

    @property
    def std(self) -> dict[str, float]:
        """Standard errors by name, corrected for correlated residuals."""
        return {f.name: float(math.sqrt(v)) for f, v in zip(self.free, np.diag(self.covariance), strict=True)}


def part_of(log: Log, rig: Rig, number: int, breaks: Breaks) -> Part | None:
    """A log ready to be fitted, or None where it holds no move that can be simulated from a rest."""
    moves = [m for m in cut_moves(log) if not _has_gap(log, m)]
    try:
        experiment = prepare([log], rig, [moves])
    except ValueError:
        return None
    ends = [_still_from(log, _move_at(moves, experiment, m), rig.model) for m in range(experiment.moves)]
    silent = set() if breaks.loss is not None else {"A_decoupled", "J_decoupled"}
    if breaks.stop_high is None and breaks.stop_low is None:
        silent |= {"C", "E"}
    experiment = replace(experiment, fine=experiment.fine | _near_stop(experiment, breaks))
    experiment = _refined(_trimmed(_with_timing(experiment), ends))
    return Part(experiment, number, breaks.loss is not None, frozenset(silent))


def _has_gap(log: Log, move: Segment) -> bool:
    dt = np.diff(log.t[max(move.start - 3, 0) : min(move.stop + 3, log.t.size)])
    return bool(dt.size and dt.max() > _GAP / log.rate_hz)


def _move_at(moves: Sequence[Segment], experiment: Experiment, m: int) -> Segment:
    begin = int(experiment.start[m] + experiment.moving[m])
    return next(move for move in moves if move.start == begin)


def _still_from(log: Log, move: Segment, model: Model) -> int:
    """First row of a stop that is left out: the motor is nearly still there."""
    brake = move.stop - int(abs(move.peak) / model["accel_cmd"] * log.rate_hz) - 2
    speed = np.sign(move.peak) * speed_of(log, model)[max(brake, move.start) : move.end]
    slow = np.flatnonzero(speed < min(_STILL, 0.2 * abs(move.peak)))
    return max(brake, move.start) + int(slow[0]) if slow.size else move.end


def _trimmed(experiment: Experiment, ends: Sequence[int]) -> Experiment:
    """The experiment with each rest as one weighted mean, and each stop without weight from its end row on."""
    keep = np.zeros(experiment.t.size, dtype=bool)
    z, weight = experiment.z.copy(), experiment.weight.copy()
    for m, end in enumerate(ends):
        rows = experiment.rows(m)
        begin = rows.start + int(experiment.moving[m])
        last = min(rows.start + max(end - int(experiment.start[m]), 1), rows.stop)
        keep[begin:last] = True
        squared = weight[rows.start : begin + 1] ** 2
        total = squared.sum(axis=0)
        z[begin] = (squared * z[rows.start : begin + 1]).sum(axis=0) / np.maximum(total, 1e-300)
        weight[begin] = np.sqrt(total)
    sizes = [int(keep[experiment.rows(m)].sum()) for m in range(experiment.moves)]
    return replace(
        experiment,
        t=experiment.t[keep],
        theta=experiment.theta[keep],
        z=z[keep],
        weight=weight[keep],
        fine=experiment.fine[keep],
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
        bounds=np.append(first, origin.size)[np.append(experiment.bounds[:-1], experiment.t.size)],
    )


def model_of(plant: Model, values: Mapping[str, float], number: int) -> Model:
    """The plant of one log: shared values, and those named for it."""
    own = {
        n.split("@")[0]: v
        for n, v in values.items()
        if n.endswith(f"@{number}") and n.split("@")[0] != "onset"
    }
    return override(plant, plant.name, **{n: v for n, v in values.items() if "@" not in n}, **own)


def predict(part: Part, plant: Model, values: Mapping[str, float], nuisance: Array) -> Array:
    """Readings (N, 3) of one log; nuisance (M, 2) what to add to the measured rest current [A] and position [m]."""
    model = model_of(plant, values, part.number)
    ready = commands(part.experiment, model.vector)
    states, y = run(part.experiment, model, nuisance, ready)
    if part.loses:
        _run_loose(part, model, values[f"onset@{part.number}"], ready, states, y)
    return y


def _predict_each(
    part: Part, plant: Model, trials: Sequence[tuple[Mapping[str, float], Array]]
) -> list[Array]:
    """As `predict` for several values, with a nuisance each; side by side but for a log that loses its coupling."""
    if part.loses:
        return [predict(part, plant, values, nuisance) for values, nuisance in trials]
    models = [model_of(plant, values, part.number) for values, _ in trials]
    return list(simulate_each(part.experiment, models, [nuisance for _, nuisance in trials]))


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
        s.readings(e.t[part_rows], states[part_rows], loose, y[part_rows])


def _two(e: Experiment, begin: int, ready: tuple[Array, Array], p: Array, start: Array) -> Array:
    """States one sample after `begin`, with the parameters p."""
    rows = slice(begin, begin + 2)
    out = np.empty((2, s.COLUMNS))
    s.run(e.t[rows], ready[0][rows], ready[1][rows], e.fine[rows], e.theta[rows], p, start, out)
    return out[1, : len(s.STATES)]


def residuals_of(part: Part, plant: Model, values: Mapping[str, float], nuisance: Array) -> Array:
    """(N, 3) normalised residuals, 0 where missing."""
    return (part.experiment.z - predict(part, plant, values, nuisance)) * part.experiment.weight


def fit_parts(
    parts: Sequence[Part], plant: Model, free: Sequence[Free], values: Mapping[str, float]
) -> JointFit:
    """Gauss-Newton with step halving from `values` on; a parameter at its bound stays there."""
    free, values = tuple(free), dict(values)
    nuisance = [np.zeros((p.experiment.moves, 2)) for p in parts]
    r = _all_residuals(parts, plant, values, nuisance)
    cost, converged = _objective(values, free, r), False
    for _ in range(_ITERATIONS):
        _, _, H, g, pulls, follows = _linearised(parts, plant, free, values, nuisance, r)
        step = _newton(free, values, H, g)
        trial = None
        for halving in range(_HALVINGS):
            trial = _moved(parts, plant, free, values, nuisance, 0.5**halving * step, pulls, follows)
            if trial[3] < cost:
                break
        else:
            converged = True
            break
        gain = cost - trial[3]
        values, nuisance, r, cost = trial
        if gain < _DONE:
            converged = True
            break
    columns, around, H, _, _, _ = _linearised(parts, plant, free, values, nuisance, r)
    factor = max(inflation(p.experiment, e) for p, e in zip(parts, r, strict=True))
    covariance = _inverse(H, free) * factor
    return JointFit(values, free, covariance, r, nuisance, cost, factor, columns, around, plant, converged)


def _all_residuals(
    parts: Sequence[Part], plant: Model, values: Mapping[str, float], nuisance: Sequence[Array]
) -> list[Array]:
    return [residuals_of(p, plant, values, n) for p, n in zip(parts, nuisance, strict=True)]


def _objective(values: Mapping[str, float], free: Sequence[Free], r: Sequence[Array]) -> float:
    """Half the sum of squares, priors included [nats]."""
    total = sum(0.5 * square(e) for e in r)
    if not math.isfinite(total):
        return math.inf
    return total + 0.5 * sum(((values[f.name] - f.prior) / f.prior_std) ** 2 for f in free)


def _touches(name: str, part: Part) -> bool:
    return name not in part.silent and ("@" not in name or name.endswith(f"@{part.number}"))


def _columns(
    part: Part, plant: Model, free: Sequence[Free], values: Mapping[str, float], nuisance: Array, r: Array
) -> tuple[Array, Array]:
    """(k, N, 3) and (2, N, 3): change of the normalised readings for one step of each parameter and nuisance."""
    columns = np.zeros((len(free), *r.shape))
    touched = [(j, f, f.step if values[f.name] + f.step <= f.high else -f.step) for j, f in enumerate(free)
               if _touches(f.name, part)]  # fmt: skip
    there = [({**values, f.name: values[f.name] + step}, nuisance) for _, f, step in touched]
    off = [(values, nuisance + row) for row in np.diag(_NUISANCE)]
    changes = [
        r - (part.experiment.z - y) * part.experiment.weight for y in _predict_each(part, plant, there + off)
    ]
    for (j, f, step), change in zip(touched, changes, strict=False):
        columns[j] = change * (f.step / step)
    return columns, np.array(changes[len(touched) :])


def _linearised(
    parts: Sequence[Part],
    plant: Model,
    free: Sequence[Free],
    values: Mapping[str, float],
    nuisance: Sequence[Array],
    r: Sequence[Array],
) -> tuple[list[Array], list[Array], Array, Array, list[Array], list[Array]]:
    """Columns and nuisance columns per part, the normal equations without priors, and how the nuisances follow."""
    k = len(free)
    H, g = np.zeros((k, k)), np.zeros(k)
    all_columns, all_around, pulls, follows = [], [], [], []
    for part, n, e in zip(parts, nuisance, r, strict=True):
        columns, around = _columns(part, plant, free, values, n, e)
        part_H, part_g, pull, follow = _projected(part.experiment, columns, around, e)
        H += part_H
        g += part_g
        all_columns.append(columns)
        all_around.append(around)
        pulls.append(pull)
        follows.append(follow)
    return all_columns, all_around, H, g, pulls, follows


def _projected(e: Experiment, columns: Array, around: Array, r: Array) -> tuple[Array, Array, Array, Array]:
    """Normal equations H (k, k), g (k,) with the two numbers of every move projected out, and how these follow.

    pull (M, 2) of the residual on the two numbers, follow (M, 2, k) of each parameter's step, in units of the steps.
    """
    k = columns.shape[0]
    H, g = np.zeros((k, k)), np.zeros(k)
    pull, follow = np.empty((e.moves, 2)), np.empty((e.moves, 2, k))
    for m in range(e.moves):
        rows = e.rows(m)
        G, N, residual = columns[:, rows].reshape(k, -1), around[:, rows].reshape(2, -1), r[rows].ravel()
        block = np.linalg.pinv(self_gram(N), rcond=_CONDITION)
        cross = gram(N, G)
        pull[m], follow[m] = block @ along(N, residual), block @ cross
        H += self_gram(G) - cross.T @ follow[m]
        g += along(G, residual) - cross.T @ pull[m]
    return H, g, pull, follow


def _prior(free: Sequence[Free]) -> Array:
    return np.array([(f.step / f.prior_std) ** 2 for f in free])


def _newton(free: Sequence[Free], values: Mapping[str, float], H: Array, g: Array) -> Array:
    """(k,) step in units of the parameters' steps; a parameter that would leave its bounds is held."""
    weight = _prior(free)
    at = np.array([values[f.name] for f in free])
    unit = np.array([f.step for f in free])
    g = g + weight * np.array([f.prior - v for f, v in zip(free, at, strict=True)]) / unit
    H = H + np.diag(weight)
    low, high = np.array([f.low for f in free]), np.array([f.high for f in free])
    held, step = np.zeros(len(free), dtype=bool), np.zeros(len(free))
    for _ in free:
        step[:] = 0.0
        step[~held] = _solve(H[np.ix_(~held, ~held)], g[~held])
        out = ~held & (((step < 0.0) & (at <= low)) | ((step > 0.0) & (at >= high)))
        if not out.any():
            break
        held |= out
    return step


def _solve(H: Array, g: Array) -> Array:
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.linalg.lstsq(H / np.outer(d, d), g / d, rcond=_CONDITION)[0] / d if g.size else g


def _moved(
    parts: Sequence[Part],
    plant: Model,
    free: Sequence[Free],
    values: Mapping[str, float],
    nuisance: Sequence[Array],
    step: Array,
    pulls: Sequence[Array],
    follows: Sequence[Array],
) -> tuple[dict[str, float], list[Array], list[Array], float]:
    """Values, nuisances, residuals and objective after a step (in units of the parameters' steps)."""
    trial = dict(values)
    for f, d in zip(free, step, strict=True):
        trial[f.name] = min(max(values[f.name] + d * f.step, f.low), f.high)
    actual = np.array([(trial[f.name] - values[f.name]) / f.step for f in free])
    followed = [
        n + (pull - np.einsum("mak,k->ma", follow, actual)) * _NUISANCE
        for n, pull, follow in zip(nuisance, pulls, follows, strict=True)
    ]
    r = _all_residuals(parts, plant, trial, followed)
    return trial, followed, r, _objective(trial, free, r)


def _inverse(H: Array, free: Sequence[Free]) -> Array:
    """(k, k) covariance [SI] from the normal equations in units of the steps, priors added."""
    unit = np.array([f.step for f in free])
    H = H + np.diag(_prior(free))
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.pinv(H / np.outer(d, d), rcond=_CONDITION, hermitian=True)
    return inverse / np.outer(d, d) * np.outer(unit, unit)


def profile_interval(parts: Sequence[Part], fitted: JointFit, name: str) -> tuple[float, float]:
    """95 % interval of one parameter: of the parabola, or of the profile likelihood where that differs by 30 %."""
    value, std = fitted.values[name], fitted.std[name]
    return _crossing(parts, fitted, name, value, -Z95 * std), _crossing(parts, fitted, name, value, Z95 * std)


def _crossing(parts: Sequence[Part], fitted: JointFit, name: str, value: float, reach: float) -> float:
    """Where the profile has risen by 1.92 nats (times the inflation), by secant on its square root."""
    goal = 0.5 * Z95**2 * fitted.inflation
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
    """Least objective with one parameter held, by two chord steps with the columns of the fit."""
    free = tuple(f for f in fitted.free if f.name != name)
    j = next(k for k, f in enumerate(fitted.free) if f.name == name)
    keep = [k for k in range(len(fitted.free)) if k != j]
    linear = fitted.covariance[keep, j] / fitted.covariance[j, j] * (at - fitted.values[name])
    values = {**fitted.values, name: at}
    for f, d in zip(free, linear, strict=True):
        values[f.name] = min(max(values[f.name] + d, f.low), f.high)
    r = _all_residuals(parts, fitted.plant, values, fitted.nuisance)
    held = fitted.free[j]
    pull = 0.5 * ((at - held.prior) / held.prior_std) ** 2
    best = math.inf
    nuisance = fitted.nuisance
    for _ in range(2):
        H, g, pulls, follows = np.zeros((len(free), len(free))), np.zeros(len(free)), [], []
        for part, e, columns, around in zip(parts, r, fitted.columns, fitted.around, strict=True):
            part_H, part_g, pull_of, follow = _projected(part.experiment, columns[keep], around, e)
            H += part_H
            g += part_g
            pulls.append(pull_of)
            follows.append(follow)
        step = _newton(free, values, H, g)
        values, nuisance, r, cost = _moved(parts, fitted.plant, free, values, nuisance, step, pulls, follows)
        best = min(best, cost + pull)
    return best


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
