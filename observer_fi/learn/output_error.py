"""Output-error fits of the moves of an experiment: parameters that make the simulated readings agree with the measured ones."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ParamSpec

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc  # the tail of scipy.stats.chi2, which takes a second to import

from observer_fi.learn.gauss_newton import (
    NUISANCE_STEP,
    Free,
    Normal,
    Point,
    covariance_of,
    newton_step,
    project,
    search,
    stepped,
)
from observer_fi.learn.move_data import Experiment, commands, simulate, simulate_each, whitened
from observer_fi.numerics import autocorrelation, correlation_time, sum_of_squares
from observer_fi.physics import Model, override
from observer_fi.records import Array

P = ParamSpec("P")
_ITERATIONS = 20
_DONE = 0.02  # nats that a step must gain to be worth another one
_WHITE_LAGS = 20
_AT_ONCE = 64  # models whose readings are held at the same time
_FEWEST = 50  # samples of a channel that tell the correlation of its residual
_LONGEST = 400  # samples over which residuals may be correlated


@dataclass(frozen=True)
class FitResult:
    """What a fit found. free: in the order of `covariance` (k, k). residuals (N, 3): (z - y) / std, 0 where missing.

    objective: half the sum of squares, priors included [nats]. nuisance (M, 2) A, m. columns (k, N, 3): change of the
    normalised readings for one step of each parameter.
    """

    model: Model
    free: tuple[Free, ...]
    covariance: Array
    residuals: Array
    nuisance: Array
    objective: float
    columns: Array
    normal: Normal
    nll_per_sample: float
    converged: bool

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by name."""
        return {f.name: self.model[f.name] for f in self.free}

    @property
    def std(self) -> dict[str, float]:
        """Standard errors by name, corrected for the correlation of the residuals."""
        return {f.name: float(math.sqrt(v)) for f, v in zip(self.free, np.diag(self.covariance), strict=True)}

    @property
    def correlation(self) -> Array:
        """(k, k)."""
        d = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(d, d)


@dataclass(frozen=True)
class ParameterFit:
    """The problem that `fit` solves (`gauss_newton.Problem`). known: columns (N, 3) that are not made anew."""

    experiment: Experiment
    model: Model
    free: tuple[Free, ...]
    known: Mapping[str, Array] = field(default_factory=dict)

    @property
    def bounds(self) -> NDArray[np.int64]:
        return self.experiment.bounds

    @property
    def nuisance_std(self) -> Array:
        return self.experiment.nuisance_std

    def model_at(self, values: Mapping[str, float]) -> Model:
        return override(self.model, self.model.name, **values)

    def residuals(self, values: Mapping[str, float], nuisance: Array) -> Array:
        return residuals(self.experiment, self.model_at(values), nuisance)

    def columns(self, point: Point) -> tuple[Array, Array]:
        model, r = self.model_at(point.values), point.residuals
        open_ = [f for f in self.free if f.name not in self.known]
        step = {f.name: f.step if model[f.name] + f.step <= f.high else -f.step for f in open_}
        beside = [override(model, model.name, **{name: model[name] + by}) for name, by in step.items()]
        shifted = [point.nuisance + by for by in np.diag(NUISANCE_STEP)]
        rests = [*[point.nuisance] * len(beside), *shifted]
        made = residuals_each(self.experiment, [*beside, model, model], rests)
        columns = np.empty((len(self.free), *r.shape))
        for column, f in zip(columns, self.free, strict=True):
            if f.name in self.known:
                column[:] = self.known[f.name]
                continue
            column[:] = (r - next(made)) * (f.step / step[f.name])
        return columns, np.array([r - there for there in made])


def fit(
    experiment: Experiment,
    model: Model,
    free: Sequence[Free],
    nuisance: Array | None = None,
    known: Mapping[str, Array] | None = None,
    iterations: int = _ITERATIONS,
    worth: float = _DONE,
    goal: float = math.inf,
) -> FitResult:
    """Gauss-Newton from `model` on, until a step gains less than `worth` [nats].

    known: columns (N, 3) of some parameters from an earlier fit near by; they stay as they are, so that a
    candidate costs a simulation per iteration and per new parameter only. goal: see `search`.
    """
    problem = ParameterFit(experiment, model, tuple(free), known or {})
    nuisance = np.zeros((experiment.moves, 2)) if nuisance is None else nuisance
    found = search(problem, {f.name: model[f.name] for f in free}, nuisance, iterations, worth, goal)
    point, model = found.point, problem.model_at(found.point.values)
    columns = found.columns if found.columns.size else problem.columns(point)[0]
    around = nuisance_columns(experiment, model, point.nuisance, point.residuals)
    normal = project(problem, columns, around, point)
    return FitResult(
        model,
        problem.free,
        covariance_of(problem.free, normal) * inflation(experiment, point.residuals),
        point.residuals,
        point.nuisance,
        point.objective,
        columns,
        normal,
        nll_per_sample(experiment, point.residuals),
        found.converged,
    )


def _or_none(fitting: Callable[P, FitResult]) -> Callable[P, FitResult | None]:
    """As a fit; None where the simulation runs away from there until its numbers are none."""

    def fitted(*args: P.args, **kwargs: P.kwargs) -> FitResult | None:
        try:
            return fitting(*args, **kwargs)
        except np.linalg.LinAlgError:
            return None

    return fitted


fit_or_none = _or_none(fit)


def residuals(
    experiment: Experiment, model: Model, nuisance: Array, ready: tuple[Array, Array] | None = None
) -> Array:
    """(N, 3) normalised residuals, (z - y) / std, 0 where missing, less what reversals leave open."""
    return _normalised(experiment, simulate(experiment, model, nuisance, ready))


def _normalised(experiment: Experiment, readings: Array) -> Array:
    """Of simulated readings (N, 3) or (k, N, 3), in their place; not finite, and without a word, where a simulation runs away."""
    with np.errstate(invalid="ignore", over="ignore"):
        np.subtract(experiment.z, readings, out=readings)
        readings *= experiment.weight
        return whitened(experiment, readings)


def residuals_each(
    experiment: Experiment, models: Sequence[Model], nuisances: Sequence[Array]
) -> Iterator[Array]:
    """As `residuals` of k models with a nuisance each, simulated side by side: cheaper by far than one after another."""
    for first in range(0, len(models), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        yield from _normalised(experiment, simulate_each(experiment, models[some], nuisances[some]))


def nuisance_columns(experiment: Experiment, model: Model, nuisance: Array, r: Array) -> Array:
    """(2, N, 3) change of the normalised readings for one step of the rest current and of the rest position."""
    ready = commands(experiment, model.vector)
    return np.array([r - residuals(experiment, model, nuisance + by, ready) for by in np.diag(NUISANCE_STEP)])


def without_moves(result: FitResult, moves: Sequence[int]) -> Model:
    """The model as fitted without some moves, by one Gauss-Newton step from the fit to all of them."""
    rest = np.setdiff1d(np.arange(result.normal.g.shape[0]), moves)
    normal = Normal(*(part[rest] for part in result.normal))
    step = newton_step(result.free, result.values, normal)
    return override(result.model, result.model.name, **stepped(result.free, result.values, step))


def inflation(experiment: Experiment, r: Array) -> float:
    """Factor on variances for residuals that are correlated or larger than the noise; 1 for white ones, never less.

    The largest of the channels.
    """
    return max(1.0, *inflation_by_channel(experiment, r))


def inflation_by_channel(experiment: Experiment, r: Array) -> list[float]:
    """(3,) mean square of the normalised residuals times their correlation time, 0 of a channel that hardly has any."""
    found = [0.0, 0.0, 0.0]
    for c in range(3):
        seen = r[experiment.weight[:, c] > 0.0, c]
        if seen.size >= _FEWEST:
            time = correlation_time(seen, min(_LONGEST, seen.size // 4))
            found[c] = float(np.mean(seen**2)) * time
    return found


def whiteness(r: Array) -> float:
    """p-value of Ljung and Box's test (1978) that a residual (n,) of any unit has no autocorrelation up to lag 20."""
    rho = autocorrelation(r, _WHITE_LAGS)
    n = r.size
    q = n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, _WHITE_LAGS + 1))))
    return float(chdtrc(_WHITE_LAGS, q))


def noise_floor(experiment: Experiment) -> float:
    """What `nll_per_sample` is on average where only the noise is left [nats]."""
    seen = experiment.weight > 0.0
    return nll_per_sample(experiment, np.where(seen, 1.0, 0.0))


def nll_per_sample(experiment: Experiment, r: Array) -> float:
    """Mean over the samples of minus the log-likelihood of the measured channels [nats, SI densities]."""
    seen = experiment.weight > 0.0
    constant = np.log(experiment.noise * math.sqrt(2.0 * math.pi))
    total = 0.5 * sum_of_squares(r) + float((seen * constant).sum())
    return total / max(int(seen.any(axis=1).sum()), 1)
