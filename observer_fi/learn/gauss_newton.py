"""Output-error fits: parameters that make the simulated moves agree with the measured ones.

Gauss-Newton over the parameters, with Gaussian priors, central or forward differences, and two free numbers per move
(rest current and rest position) that are projected out move by move:

    minimise  1/2 sum ((z - y(p)) / std)^2 + 1/2 sum ((p - prior) / prior_std)^2

Sums over moves of the projected normal equations also give the score of a parameter that is still at its neutral
value, and the estimate without some of the moves, without another simulation.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from observer_fi.learn.move_data import Experiment, commands, simulate, simulate_each, whitened
from observer_fi.numerics import along, gram, self_gram, square
from observer_fi.physics import Model, override
from observer_fi.records import Array

_ITERATIONS = 20
_WHITE_LAGS = 20
_HALVINGS = 6
_DONE = 0.02  # nats that a step must gain to be worth another one
_CONDITION = 1e-12
_NUISANCE_STEP = (1e-4, 1e-6)  # A, m
_FARTHEST = 4.0  # standard deviations that a rest may be off: farther out is another branch of stick and slip


class Free(NamedTuple):
    """One free parameter: bounds, a step for differences that the noise does not hide, and a Gaussian prior.

    prior_std may be infinite.
    """

    name: str
    step: float
    low: float = -math.inf
    high: float = math.inf
    prior: float = 0.0
    prior_std: float = math.inf


@dataclass(frozen=True)
class Normal:
    """Projected normal equations per move of the k free parameters: H (M, k, k), g (M, k), scaled by `scale` (k,).

    g is the gradient of the fit's half sum of squares to -parameter: at the optimum its sum balances the priors.
    """

    names: tuple[str, ...]
    H: Array
    g: Array
    scale: Array


@dataclass(frozen=True)
class FitResult:
    """What a fit found. free: in the order of `covariance` (k, k). residuals (N, 3): (z - y) / std, 0 where missing.

    objective: half the sum of squares, priors included [nats]. nuisance (M, 2) A, m.
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


def fit(
    experiment: Experiment,
    model: Model,
    free: Sequence[Free],
    nuisance: Array | None = None,
    known: Mapping[str, Array] | None = None,
    iterations: int = _ITERATIONS,
    worth: float = _DONE,
) -> FitResult:
    """Gauss-Newton with step halving from `model` on, until a step gains less than `worth` [nats].

    known: columns (N, 3) of some parameters from an earlier fit near by; they are kept as they are, so that a
    candidate costs a simulation per iteration and per new parameter only.
    """
    free = tuple(free)
    nuisance = np.zeros((experiment.moves, 2)) if nuisance is None else nuisance
    r = residuals(experiment, model, nuisance)
    cost = objective(model, free, r) + _doubt(experiment, nuisance)
    columns, converged, second_try = np.empty(0), False, False
    kept = (model, nuisance, r, math.inf)
    for _ in range(iterations):
        columns = jacobian(experiment, model, nuisance, r, free, known)
        around = nuisance_columns(experiment, model, nuisance, r)
        projected, pull, inverse = project(experiment, columns, around, r, nuisance)
        step = _newton_step(model, free, projected, r)
        moved = False
        for halving in range(_HALVINGS):
            share = 0.5**halving
            trial = _stepped(model, free, share * step)
            actual = np.array([trial[f.name] - model[f.name] for f in free]) / scales(free)
            shift = pull - np.einsum("mak,k->ma", inverse, actual)
            new_nuisance = nuisance + shift * np.array(_NUISANCE_STEP)
            new_r = residuals(experiment, trial, new_nuisance)
            new_cost = objective(trial, free, new_r) + _doubt(experiment, new_nuisance)
            if new_cost < cost:
                moved = True
                break
        gain = cost - new_cost if moved else 0.0
        if moved:
            model, nuisance, r, cost = trial, new_nuisance, new_r, new_cost
        if gain < worth:
            converged = True
            if second_try:
                break
            second_try = True
            far = np.abs(nuisance) > _FARTHEST * experiment.nuisance_std
            if not far.any():
                break
            # Rests dragged to another branch of stick and slip while the parameters were far off start anew.
            kept = (model, nuisance, r, cost)
            nuisance = np.where(far, 0.0, nuisance)
            r = residuals(experiment, model, nuisance)
            cost = objective(model, free, r) + _doubt(experiment, nuisance)
    if kept[3] < cost:
        model, nuisance, r, cost = kept
    return _result(experiment, model, free, r, nuisance, cost, columns, converged)


def residuals(
    experiment: Experiment, model: Model, nuisance: Array, ready: tuple[Array, Array] | None = None
) -> Array:
    """(N, 3) normalised residuals, (z - y) / std, 0 where missing, less what reversals leave open."""
    return whitened(
        experiment, (experiment.z - simulate(experiment, model, nuisance, ready)) * experiment.weight
    )


def objective(model: Model, free: Sequence[Free], r: Array) -> float:
    """Half the sum of squares, priors included [nats]."""
    total = 0.5 * square(r)
    total = total if math.isfinite(total) else math.inf
    return total + 0.5 * sum(((model[f.name] - f.prior) / f.prior_std) ** 2 for f in free)


def _doubt(experiment: Experiment, nuisance: Array) -> float:
    """Prior of the rests [nats]."""
    return 0.5 * float(np.sum((nuisance / experiment.nuisance_std) ** 2))


def scales(free: Sequence[Free]) -> Array:
    """(k,) the unit of each parameter in the normal equations: its step."""
    return np.array([f.step for f in free])


def jacobian(
    experiment: Experiment,
    model: Model,
    nuisance: Array,
    r: Array,
    free: Sequence[Free],
    known: Mapping[str, Array] | None = None,
) -> Array:
    """(k, N, 3) change of the normalised readings for one step of each parameter."""
    known = known or {}
    open_ = [f for f in free if f.name not in known]
    step = {f.name: f.step if model[f.name] + f.step <= f.high else -f.step for f in open_}
    moved = [override(model, model.name, **{name: model[name] + by}) for name, by in step.items()]
    columns = dict(known)
    for f, y in zip(open_, simulate_each(experiment, moved, [nuisance] * len(moved)), strict=True):
        there = whitened(experiment, (experiment.z - y) * experiment.weight)
        columns[f.name] = (r - there) * (f.step / step[f.name])
    return np.array([columns[f.name] for f in free]).reshape(len(free), *r.shape)


def nuisance_columns(experiment: Experiment, model: Model, nuisance: Array, r: Array) -> Array:
    """(2, N, 3) change of the normalised readings for one step of the rest current and of the rest position."""
    ready = commands(experiment, model.vector)
    return np.array([
        r - residuals(experiment, model, nuisance + np.eye(2)[k] * _NUISANCE_STEP[k], ready) for k in range(2)
    ])  # fmt: skip


def project(
    experiment: Experiment, columns: Array, around: Array, r: Array, nuisance: Array
) -> tuple[Normal, Array, Array]:
    """Normal equations with the two numbers of every move projected out, and how these follow the parameters.

    Returns the equations (names empty, unit steps), the pull (M, 2) of the residual on them and (M, 2, k) of each
    parameter's step, both in units of `_NUISANCE_STEP`.
    """
    k, M = columns.shape[0], experiment.moves
    H, g = np.empty((M, k, k)), np.empty((M, k))
    pull, follow = np.empty((M, 2)), np.empty((M, 2, k))
    step = np.array(_NUISANCE_STEP)
    weight = (step / experiment.nuisance_std) ** 2
    for m in range(M):
        rows = experiment.rows(m)
        G = columns[:, rows].reshape(k, -1)
        N = around[:, rows].reshape(2, -1)
        residual = r[rows].ravel()
        block = np.linalg.inv(self_gram(N) + np.diag(weight[m]))
        cross = gram(N, G)
        pull[m] = block @ (along(N, residual) - weight[m] * nuisance[m] / step)
        follow[m] = block @ cross
        H[m] = self_gram(G) - cross.T @ follow[m]
        g[m] = along(G, residual) - cross.T @ pull[m]
    return Normal((), H, g, np.ones(k)), pull, follow


def _newton_step(model: Model, free: tuple[Free, ...], normal: Normal, r: Array) -> Array:
    """(k,) step in SI units that minimises the linearised objective; a parameter held at its bound stays there."""
    unit = scales(free)
    prior = np.array([(unit[j] / f.prior_std) ** 2 for j, f in enumerate(free)])
    off = np.array([(f.prior - model[f.name]) / unit[j] for j, f in enumerate(free)])
    H = normal.H.sum(axis=0) + np.diag(prior)
    g = normal.g.sum(axis=0) + prior * off
    held = np.zeros(len(free), dtype=bool)
    step = np.zeros(len(free))
    for _ in range(len(free) + 1):
        go = ~held
        step[:] = 0.0
        step[go] = _solve(H[np.ix_(go, go)], g[go])
        at = np.array([model[f.name] for f in free]) + step * unit
        low, high = np.array([f.low for f in free]), np.array([f.high for f in free])
        here = np.array([model[f.name] for f in free])
        out = go & (((at < low) & (here <= low)) | ((at > high) & (here >= high)))
        if not out.any():
            break
        held |= out
    return step * unit


def _solve(H: Array, g: Array) -> Array:
    """H^-1 g for a positive semi-definite H of any scale: directions without information do not move."""
    if g.size == 0:
        return g
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.linalg.lstsq(H / np.outer(d, d), g / d, rcond=_CONDITION)[0] / d


def _stepped(model: Model, free: tuple[Free, ...], step: Array) -> Model:
    values = {f.name: min(max(model[f.name] + s, f.low), f.high) for f, s in zip(free, step, strict=True)}
    return override(model, model.name, **values)


def inflation(experiment: Experiment, r: Array) -> float:
    """Factor on variances for residuals that are correlated or larger than the noise; 1 for white ones, never less.

    Mean square times (1 + 2 sum of the autocorrelation up to its first zero), the largest of the channels.
    """
    worst = 1.0
    for c in range(3):
        seen = r[experiment.weight[:, c] > 0.0, c]
        if seen.size < 50:
            continue
        rho = autocorrelation(seen, min(400, seen.size // 4))
        below = np.flatnonzero(rho < 2.0 / math.sqrt(seen.size))
        until = int(below[0]) if below.size else rho.size
        worst = max(worst, float(np.mean(seen**2)) * (1.0 + 2.0 * float(rho[:until].sum())))
    return worst


def autocorrelation(y: Array, lags: int) -> Array:
    """(lags,) autocorrelation of y at the lags 1 to `lags`."""
    y = y - y.mean()
    size = 1 << (2 * y.size - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(y, size)) ** 2
    both = np.fft.irfft(spectrum, size)[: lags + 1]
    return both[1:] / both[0] if both[0] > 0.0 else np.zeros(lags)


def whiteness(r: Array) -> float:
    """p-value of Ljung and Box's test (1978) that a residual (n,) of any unit has no autocorrelation up to lag 20."""
    rho = autocorrelation(r, _WHITE_LAGS)
    n = r.size
    q = n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, _WHITE_LAGS + 1))))
    return float(chi2.sf(q, _WHITE_LAGS))


def nll_per_sample(experiment: Experiment, r: Array) -> float:
    """Mean over the samples of minus the log-likelihood of the measured channels [nats, SI densities]."""
    seen = experiment.weight > 0.0
    constant = np.log(experiment.noise * math.sqrt(2.0 * math.pi))
    total = 0.5 * square(r) + float((seen * constant).sum())
    return total / max(int(seen.any(axis=1).sum()), 1)


def _result(
    experiment: Experiment,
    model: Model,
    free: tuple[Free, ...],
    r: Array,
    nuisance: Array,
    cost: float,
    columns: Array,
    converged: bool,
) -> FitResult:
    if columns.size == 0 and free:
        columns = jacobian(experiment, model, nuisance, r, free)
    around = nuisance_columns(experiment, model, nuisance, r)
    normal, _, _ = project(experiment, columns, around, r, nuisance)
    unit = scales(free)
    normal = Normal(tuple(f.name for f in free), normal.H, normal.g, unit)
    covariance = covariance_of(free, normal) * inflation(experiment, r)
    return FitResult(
        model, free, covariance, r, nuisance, cost, columns, normal, nll_per_sample(experiment, r), converged
    )


def covariance_of(free: Sequence[Free], normal: Normal) -> Array:
    """(k, k) covariance for white residuals of unit size, priors included [SI]."""
    unit = scales(free)
    H = normal.H.sum(axis=0) + np.diag([(u / f.prior_std) ** 2 for u, f in zip(unit, free, strict=True)])
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.pinv(H / np.outer(d, d), rcond=_CONDITION, hermitian=True)
    return inverse / np.outer(d, d) * np.outer(unit, unit)


def without_moves(result: FitResult, moves: Sequence[int]) -> Model:
    """The model as fitted without some moves, by one Gauss-Newton step from the fit to all of them."""
    free, normal = result.free, result.normal
    unit = scales(free)
    keep = np.setdiff1d(np.arange(normal.g.shape[0]), moves)
    kept = Normal(normal.names, normal.H[keep], normal.g[keep], unit)
    return _stepped(result.model, free, _newton_step(result.model, free, kept, result.residuals))
