"""Which cause would explain a residual: the score of every variant of the vocabulary, and the refit of its rivals.

The score of a candidate is the gain of its linearised term after the free parameters and the two numbers of every
move have done what they can: g' S^-1 g / 2, with S and g projected off the refit. No candidate is simulated more than
once per parameter.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from observer_fi.improve.steps import Candidate
from observer_fi.learn import (
    NUISANCE_STEP,
    Experiment,
    FitResult,
    Free,
    doubt_along,
    fit,
    fit_or_none,
    nuisance_columns,
    residuals_each,
    run,
    scales,
)
from observer_fi.numerics import matvec, orthonormal, self_gram, subtract_rows
from observer_fi.physics import CAUSES, MOVES, PARAMETERS, Cause, Coverage, Model, Term, Variant, override
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_SHAPE_STEP = 0.03  # relative step of a shape
_STANDS_OUT = 5.0  # standard errors from which on a size would have been seen
_REFIT_ITERATIONS = 10
_REFIT_WORTH = 0.5  # nats: rivals differ by more, and the one that wins is fitted exactly


def coverage_of(experiment: Experiment, model: Model, nuisance: Array) -> Coverage:
    """What the moves cover, and what their simulation says of the servo and of the heat in the winding."""
    states, _ = run(experiment, model, nuisance)
    x = experiment.z[experiment.weight[:, 2] > 0.0, 2]
    low, high = (float(x.min()), float(x.max())) if x.size else (0.0, 1.0)
    step = float(np.median(np.diff(experiment.t[experiment.rows(0)])))
    length = step * experiment.t.size
    heat = model["Rm"] * float(np.sum(states[:, s.CURRENT] ** 2)) * step
    friction = max(model["A"], 1e-9)
    return Coverage(
        low,
        high,
        speed=float(np.abs(experiment.peak).max()),
        pitch=max(float(np.abs(experiment.theta).max()), 1.0),
        torque=friction,
        current=friction / model["Km"],
        resistance=model["Rm"],
        heat=max(heat, 1e-6),
        length_s=length,
        step_s=step,
        voltage_noise=float(experiment.noise[0]),
        current_noise=float(experiment.noise[1]),
        position_noise=float(experiment.noise[2]),
        turn=2.0 * math.pi * model["D"],
        lead=model["screw_lead"],
        integral=float(np.abs(states[:, s.I]).max()),
        acceleration=experiment.accel,
    )


def start_values(variant: Variant) -> dict[str, float]:
    """Where a refit of this variant begins, fixed shapes included."""
    return dict(variant.fixed) | {term.parameter: term.start for term in variant.terms}


def free_of(variant: Variant) -> tuple[Free, ...]:
    """The free parameters of a variant, with steps from their starts."""
    return tuple(_free(term) for term in variant.terms)


def _free(term: Term) -> Free:
    """A limit that clamps nothing where it is neutral starts just below what the moves reached."""
    start = term.start
    if term.shape:
        step = term.step or _SHAPE_STEP * abs(start) + 1e-5 * (start == 0.0)
        return Free(term.parameter, step, term.low, term.high, start, term.prior_std)
    if math.isfinite(term.neutral):
        return Free(term.parameter, term.step or abs(start - term.neutral), term.low, term.high)
    reached = start / 0.999
    return Free(term.parameter, abs(start - reached), term.low, reached)


def columns_of(experiment: Experiment, fitted: FitResult, variants: Sequence[Variant]) -> Iterator[Array]:
    """Of each variant the (number of sizes, N, 3) change of the normalised readings for one start size of each term."""
    moved = [model for variant in variants for model in _one_size_away(fitted.model, variant)]
    made = residuals_each(experiment, moved, [fitted.nuisance] * len(moved))
    for variant in variants:
        yield np.array([fitted.residuals - next(made) for _ in variant.sizes])


def _one_size_away(model: Model, variant: Variant) -> list[Model]:
    """For each size of a variant the model with one start of it, and with the shapes where they start."""
    shapes = {name: value for name, value in start_values(variant).items() if name in variant.shapes}
    here = override(model, model.name, **shapes)
    return [override(here, here.name, **{t.parameter: _away(here[t.parameter], t)}) for t in variant.sizes]


def _away(value: float, term: Term) -> float:
    """The parameter one start size away from where it is."""
    return value + (term.start - term.neutral) if math.isfinite(term.neutral) else term.start


def screen(
    experiment: Experiment, fitted: FitResult, causes: Sequence[str], coverage: Coverage
) -> list[Candidate]:
    """Every variant of the causes, best score first; variants that the data cannot move are left out."""
    pairs = [(CAUSES[name], v) for name in causes for v in CAUSES[name].variants(coverage, MOVES)]
    base = Projector(experiment, fitted)
    columns = columns_of(experiment, fitted, [variant for _, variant in pairs])
    scored = (_score(base, *pair, block) for pair, block in zip(pairs, columns, strict=True))
    found = [candidate for candidate in scored if candidate is not None]
    prices = [penalty(experiment, len(c.variant.terms), len(found)) for c in found]
    priced = [replace(c, net=c.gain - price) for c, price in zip(found, prices, strict=True)]
    return sorted(priced, key=lambda c: -c.gain)


def penalty(experiment: Experiment, parameters: int, candidates: int) -> float:
    """Extended BIC of one more candidate [nats]: k (ln n / 2 + ln candidates)."""
    n = int((experiment.weight > 0.0).sum())
    return parameters * 0.5 * math.log(n) + math.log(candidates)


class Projector:
    """Projects columns off the refit: the free parameters (with their priors) and two numbers per move."""

    def __init__(self, experiment: Experiment, fitted: FitResult) -> None:
        self.experiment = experiment
        around = nuisance_columns(experiment, fitted.model, fitted.nuisance, fitted.residuals)
        self._open = [_left_open(experiment, around, m) for m in range(experiment.moves)]
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
        for m, (basis, share) in enumerate(self._open):
            rows = self.experiment.rows(m)
            y = out[3 * rows.start : 3 * rows.stop]
            subtract_rows(y, share * matvec(basis, y), basis)
        return out


def _left_open(experiment: Experiment, around: Array, move: int) -> tuple[Array, Array]:
    """Orthonormal rows (k, 3 n) along which the two numbers of a move change its readings, and the share taken of each (k,).

    around: see `nuisance_columns`. Where a loop holds a motion near the measured one, a steady torque looks like another position
    at rest, which is known far better than that.
    """
    rows = around[:, experiment.rows(move)].reshape(2, -1)
    if not experiment.driven.size:
        basis = orthonormal(rows)
        return basis, np.ones(len(basis))
    known = doubt_along(
        (experiment.nuisance_std[move] / NUISANCE_STEP)[:, None, None] * rows.reshape(2, -1, 3)
    )
    return known.directions, known.share


def _score(base: Projector, cause: Cause, variant: Variant, block: Array) -> Candidate | None:
    C = np.array([base(column) for column in block])
    H = self_gram(C)
    if not np.isfinite(H).all() or np.trace(H) < 1e-6:
        return None
    gain, weights = _best_subset(H, matvec(C, base.r), variant.sizes)
    size, detectable = {}, {}
    std = np.sqrt(np.maximum(np.diag(np.linalg.pinv(H)), 0.0))
    for term, weight, error in zip(variant.sizes, weights, std, strict=True):
        limit = not math.isfinite(term.neutral)
        unit = term.start / 0.999 - term.start if limit else term.start - term.neutral
        size[term.parameter] = term.start if limit else term.neutral + weight * unit
        detectable[term.parameter] = _STANDS_OUT * abs(unit) * float(error)
    return Candidate(cause, variant, gain, -math.inf, size, detectable)


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
    exact: bool = False,
    goal: float = math.inf,
) -> FitResult | None:
    """The fit with the candidate's parameters free as well, from its linear estimate; None where that runs away until its numbers
    are none.

    exact: every column anew in each iteration; otherwise those of the earlier fit are kept, which is faster. goal: see `search`.
    """
    variant = candidate.variant
    starts = start_values(variant) | candidate.size
    model = override(fitted.model, fitted.model.name, **inside(variant, starts))
    extra = free_of(variant)
    names = {f.name for f in extra}
    free = (*(f for f in fitted.free if f.name not in names), *extra)
    known = {f.name: column for f, column in zip(fitted.free, fitted.columns, strict=True)}
    if exact:
        return fit_or_none(experiment, model, free, fitted.nuisance, iterations=30, goal=goal)
    return fit_or_none(experiment, model, free, fitted.nuisance, known, _REFIT_ITERATIONS, _REFIT_WORTH, goal)


def without(experiment: Experiment, fitted: FitResult, variant: Variant) -> FitResult:
    """The fit with one form of a cause taken out again."""
    neutral = {t.parameter: t.neutral for t in variant.terms}
    neutral |= {name: PARAMETERS[name][1] or 0.0 for name, _ in variant.fixed}
    free = tuple(f for f in fitted.free if f.name not in neutral)
    return fit(experiment, override(fitted.model, fitted.model.name, **neutral), free, fitted.nuisance)


def inside(variant: Variant, values: dict[str, float]) -> dict[str, float]:
    """Values of parameters, SI, those of the variant's terms within their bounds."""
    bounds = {t.parameter: (t.low, t.high) for t in variant.terms}
    return {n: min(max(v, bounds[n][0]), bounds[n][1]) if n in bounds else v for n, v in values.items()}
