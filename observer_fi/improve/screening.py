"""Which cause would explain a residual: the score of every variant of the vocabulary, and the refit of its rivals.

The score of a candidate is the gain of its linearised term after the free parameters and the two numbers of every
move have done what they can: g' S^-1 g / 2, with S and g projected off the refit. No candidate is simulated more than
once per parameter.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from observer_fi.learn import Experiment, FitResult, Free, fit, nuisance_columns, residuals, run, scales
from observer_fi.numerics import matvec, orthonormal, self_gram, subtract_rows
from observer_fi.physics import CAUSES, Cause, Model, Term, Variant, override
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_SHAPE_STEP = 0.03  # relative step of a shape
_REFIT_ITERATIONS = 10
_REFIT_WORTH = 0.5  # nats: rivals differ by more, and the one that wins is fitted exactly


@dataclass(frozen=True)
class Candidate:
    """One variant with its score. gain: nats that the linearised term gains; size: its linear estimate by name.

    detectable: one standard error of each size beside the refit, for white residuals.
    """

    cause: Cause
    variant: Variant
    gain: float
    size: dict[str, float]
    detectable: dict[str, float]


def start_values(variant: Variant, reach: dict[str, float]) -> dict[str, float]:
    """Where a refit of this variant begins: shapes, fixed shapes, and limits just below what the log reached."""
    values = dict(variant.fixed)
    for term in variant.terms:
        values[term.parameter] = _start(term, reach)
    return values


def _start(term: Term, reach: dict[str, float]) -> float:
    return term.start * reach[term.parameter] if term.parameter in reach else term.start


def reach_of(experiment: Experiment, model: Model, nuisance: Array) -> dict[str, float]:
    """What the limits of the servo would have to undercut: the largest integral [rad] and acceleration [rad/s^2]."""
    states, _ = run(experiment, model, nuisance)
    return {"integrator_limit": float(np.abs(states[:, s.I]).max()), "accel_limit": experiment.accel}


def free_of(variant: Variant, reach: dict[str, float]) -> tuple[Free, ...]:
    """The free parameters of a variant, with steps from their starts."""
    free = []
    for term in variant.terms:
        start = _start(term, reach)
        if term.shape:
            free.append(
                Free(
                    term.parameter,
                    _SHAPE_STEP * abs(start) + 1e-5 * (start == 0.0),
                    term.low,
                    term.high,
                    start,
                    term.prior_std,
                )
            )
        else:
            neutral = term.neutral if math.isfinite(term.neutral) else start / 0.999
            high = term.high if math.isfinite(term.neutral) else neutral
            free.append(Free(term.parameter, abs(start - neutral), term.low, high))
    return tuple(free)


def columns_of(experiment: Experiment, fitted: FitResult, variant: Variant, reach: dict[str, float]) -> Array:
    """(number of sizes, N, 3) change of the normalised readings for one start size of each term."""
    shapes = {name: value for name, value in start_values(variant, reach).items() if _is_shape(variant, name)}
    here = override(fitted.model, fitted.model.name, **shapes)
    parts = []
    for term in variant.sizes:
        moved = override(here, here.name, **{term.parameter: _away(here[term.parameter], term, reach)})
        parts.append(fitted.residuals - residuals(experiment, moved, fitted.nuisance))
    return np.array(parts)


def _is_shape(variant: Variant, name: str) -> bool:
    return name in dict(variant.fixed) or any(t.shape and t.parameter == name for t in variant.terms)


def _away(value: float, term: Term, reach: dict[str, float]) -> float:
    """The parameter one start size away from where it is."""
    start = _start(term, reach)
    return start if not math.isfinite(term.neutral) else value + (start - term.neutral)


def screen(
    experiment: Experiment, fitted: FitResult, causes: Sequence[str], reach: dict[str, float]
) -> list[Candidate]:
    """Every variant of the causes, best score first; variants that the data cannot move are left out."""
    pairs = [(CAUSES[name], variant) for name in causes for variant in CAUSES[name].variants]
    with ThreadPoolExecutor(2) as pool:
        columns = list(pool.map(lambda pair: columns_of(experiment, fitted, pair[1], reach), pairs))
    base = Projector(experiment, fitted)
    found = [
        candidate
        for (cause, variant), block in zip(pairs, columns, strict=True)
        if (candidate := _score(base, cause, variant, block, reach)) is not None
    ]
    return sorted(found, key=lambda c: -c.gain)


class Projector:
    """Projects columns off the refit: the free parameters (with their priors) and two numbers per move."""

    def __init__(self, experiment: Experiment, fitted: FitResult) -> None:
        self.experiment = experiment
        around = nuisance_columns(experiment, fitted.model, fitted.nuisance, fitted.residuals)
        self._bases = []
        for m in range(experiment.moves):
            rows = experiment.rows(m)
            self._bases.append(orthonormal(around[:, rows].reshape(2, -1)))
        inner = [k for k, f in enumerate(fitted.free) if f.low < fitted.model[f.name] < f.high]
        free = [fitted.free[k] for k in inner]  # what is at a bound cannot make room for a candidate
        prior = scales(free) / np.array([f.prior_std for f in free])
        self.r = self._clean(fitted.residuals)
        G = np.array([self._clean(column) for column in fitted.columns[inner]])
        pull = np.array([(f.prior - fitted.model[f.name]) / f.prior_std for f in free])
        self.basis = orthonormal(np.hstack([G, np.diag(prior)]))
        self.r = np.concatenate([self.r, pull])
        subtract_rows(self.r, matvec(self.basis, self.r), self.basis)

    def __call__(self, column: Array) -> Array:
        y = np.concatenate([self._clean(column), np.zeros(self.r.size - column.size)])
        subtract_rows(y, matvec(self.basis, y), self.basis)
        return y

    def _clean(self, column: Array) -> Array:
        out = column.ravel().copy()
        for m, basis in enumerate(self._bases):
            rows = self.experiment.rows(m)
            y = out[3 * rows.start : 3 * rows.stop]
            subtract_rows(y, matvec(basis, y), basis)
        return out


def _score(
    base: Projector, cause: Cause, variant: Variant, block: Array, reach: dict[str, float]
) -> Candidate | None:
    C = np.array([base(column) for column in block])
    H = self_gram(C)
    if not np.isfinite(H).all() or np.trace(H) < 1e-6:
        return None
    gain, weights = _best_subset(H, matvec(C, base.r), variant.sizes)
    size, detectable = {}, {}
    inverse = np.linalg.pinv(H)
    for k, term in enumerate(variant.sizes):
        start = _start(term, reach)
        unit = start - term.neutral if math.isfinite(term.neutral) else start / 0.999 - start
        origin = term.neutral if math.isfinite(term.neutral) else start
        size[term.parameter] = origin + weights[k] * unit if math.isfinite(term.neutral) else start
        detectable[term.parameter] = abs(unit) * math.sqrt(max(inverse[k, k], 0.0))
    return Candidate(cause, variant, gain, size, detectable)


def _best_subset(H: Array, g: Array, terms: tuple[Term, ...]) -> tuple[float, Array]:
    """Largest gain [nats] over subsets of the terms that respect the signs, and the weights in units of the starts."""
    best, weights = 0.0, np.zeros(len(terms))
    for count in range(1, len(terms) + 1):
        for chosen in combinations(range(len(terms)), count):
            k = list(chosen)
            w = np.linalg.lstsq(H[np.ix_(k, k)], g[k], rcond=1e-12)[0]
            gain = 0.5 * float(g[k] @ w)
            if gain > best and all(_allowed(terms[j], v) for j, v in zip(k, w, strict=True)):
                best, weights = gain, np.zeros(len(terms))
                weights[k] = w
    return best, weights


def _allowed(term: Term, weight: float) -> bool:
    """Whether a weight respects the physical sign of a term: what starts at its bound may only go one way."""
    return weight >= 0.0 or (term.low < term.neutral < term.high and math.isfinite(term.neutral))


def refit(
    experiment: Experiment,
    fitted: FitResult,
    candidate: Candidate,
    reach: dict[str, float],
    exact: bool = False,
) -> FitResult:
    """The fit with the candidate's parameters free as well, from its linear estimate.

    exact: every column anew in each iteration; otherwise those of the earlier fit are kept, which is faster.
    """
    starts = start_values(candidate.variant, reach) | candidate.size
    model = override(fitted.model, fitted.model.name, **_inside(candidate.variant, starts))
    extra = free_of(candidate.variant, reach)
    names = {f.name for f in extra}
    free = (*(f for f in fitted.free if f.name not in names), *extra)
    if exact:
        return fit(experiment, model, free, fitted.nuisance, iterations=30)
    known = {f.name: column for f, column in zip(fitted.free, fitted.columns, strict=True)}
    return fit(experiment, model, free, fitted.nuisance, known, _REFIT_ITERATIONS, _REFIT_WORTH)


def _inside(variant: Variant, values: dict[str, float]) -> dict[str, float]:
    bounds = {t.parameter: (t.low, t.high) for t in variant.terms}
    return {n: min(max(v, bounds[n][0]), bounds[n][1]) if n in bounds else v for n, v in values.items()}
