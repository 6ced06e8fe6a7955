"""Fits of effects that are too large for a score beside a refit, from a scan of their sizes beside a rig that nobody refitted.

A refit that fails by far has bent what is known, and what a size would change there says nothing of the truth. A delay of two
ramps is found from near by only: the steps of the scan are as fine as such a fit needs. A loop that rings is soon out of step
with its simulation: the fit begins with the openings of the moves, and goes on with longer and longer ones.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.improve.moves.screening import free_of, inside, start_values
from observer_fi.learn import Experiment, FitResult, Free, fit_or_none, openings, residuals_each
from observer_fi.logs import settling_time
from observer_fi.numerics import sum_of_squares
from observer_fi.physics import CAUSES, MOVES, Cause, Coverage, Model, Term, Variant, override

_TIMES = tuple(10.0 ** (k / 4.0) for k in range(4, 13))  # of the start of a size
_SHARES = (0.9, 0.75, 0.6, 0.45, 0.33, 0.25, 0.18, 0.13, 0.1)  # of what a limit would leave alone
_NEARER = tuple(10.0 ** (k / 24.0) for k in (-2, -1, 0, 1, 2))  # times the best of these
_FORMS = 2  # of one cause
_STARTS = 4  # that are fitted
_OPENING = 0.3  # of the time in which a transient is over: what comes first in a move
_LONGER = 2.0  # times as long each time
_ITERATIONS = 30
_GO_ON = 2  # fits of openings that go on


class Start(NamedTuple):
    """A form of a cause with values of its parameters, and the sum of squares that it leaves."""

    cause: Cause
    variant: Variant
    values: dict[str, float]
    left: float


Found = tuple[Start, FitResult]


def gross_fits(
    experiment: Experiment,
    model: Model,
    free: Sequence[Free],
    causes: Sequence[str],
    coverage: Coverage,
    goal: float = math.inf,
) -> list[Found]:
    """The best starts of the causes with the fits from there, of whole moves at once and of their openings first.

    goal: an objective; no fit goes on that will not come there.
    """
    starts = gross_starts(experiment, model, causes, coverage, _STARTS)
    whole = [(start, fit_from(experiment, model, free, start, goal)) for start in starts]
    return [*_that_end(whole), *_from_openings(experiment, model, free, causes, coverage, goal)]


def _from_openings(
    experiment: Experiment,
    model: Model,
    free: Sequence[Free],
    causes: Sequence[str],
    coverage: Coverage,
    goal: float,
) -> list[Found]:
    """Fits that begin with the openings of the moves: the best of them, gone on with until the moves are whole."""
    seconds = _OPENING * settling_time(model)
    first = openings(experiment, seconds)
    starts = gross_starts(first, model, causes, coverage, _STARTS)
    fits = _that_end([(start, fit_from(first, model, free, start)) for start in starts])
    best = sorted(fits, key=lambda found: found[1].objective)[:_GO_ON]
    return _that_end([(start, _gone_on(experiment, fitted, seconds, goal)) for start, fitted in best])


def _that_end(fits: Sequence[tuple[Start, FitResult | None]]) -> list[Found]:
    """Those that ended in numbers, where they may."""
    return [(start, fitted) for start, fitted in fits if fitted is not None]


def _gone_on(experiment: Experiment, fitted: FitResult, seconds: float, goal: float) -> FitResult | None:
    """The fit of whole moves from that of their first seconds, by longer and longer ones.

    None where a part of the moves leaves more than the whole of them may, or a fit runs away.
    """
    longest = float(np.diff(experiment.t[[experiment.bounds[:-1], experiment.bounds[1:] - 1]], axis=0).max())
    while (seconds := _LONGER * seconds) < longest and fitted.objective < goal:
        longer = fit_or_none(openings(experiment, seconds), fitted.model, fitted.free, iterations=_ITERATIONS)
        if longer is None:
            return None
        fitted = longer
    if fitted.objective > goal:
        return None
    return fit_or_none(experiment, fitted.model, fitted.free, iterations=_ITERATIONS, goal=goal)


def gross_starts(
    experiment: Experiment, model: Model, causes: Sequence[str], coverage: Coverage, most: int
) -> list[Start]:
    """The best starts of causes with one size or limit, one for each form, at most `most`, the best first.

    Only those that leave less misfit than the rig as it is.
    """
    pairs = [(CAUSES[name], v) for name in causes for v in CAUSES[name].variants(coverage, MOVES)]
    alone = [(c, v, v.sizes[0]) for c, v in pairs if len(v.sizes) == 1 and not v.sizes[0].with_it]
    scanned = _tried(experiment, model, [(c, v, s) for c, v, term in alone for s in _sizes(term)])
    (nothing,) = _left(experiment, [model])
    best: dict[tuple[str, str], Start] = {}
    forms: dict[str, int] = {}
    for start in sorted(scanned, key=lambda start: start.left):
        form = start.cause.name, start.variant.name
        seen = forms.get(start.cause.name, 0)
        if start.left < nothing and form not in best and seen < _FORMS and len(best) < most:
            best[form], forms[start.cause.name] = start, seen + 1
    return [_nearer(experiment, model, start) for start in best.values()]


def fit_from(
    experiment: Experiment, model: Model, free: Sequence[Free], start: Start, goal: float = math.inf
) -> FitResult | None:
    """The fit with a cause from a gross start, everything else from the model's own values; None where that runs away."""
    begun = override(model, model.name, **inside(start.variant, start.values))
    return fit_or_none(experiment, begun, (*free, *free_of(start.variant)), iterations=_ITERATIONS, goal=goal)


def _sizes(term: Term) -> list[float]:
    """Sizes of a term that are tried, within its bounds."""
    if not np.isfinite(term.neutral):
        return [share * term.start for share in _SHARES if share * term.start >= term.low]
    ways = (1.0, -1.0) if term.low < term.neutral else (1.0,)
    sizes = [term.neutral + way * times * (term.start - term.neutral) for times in _TIMES for way in ways]
    return [size for size in sizes if term.low <= size <= term.high]


def _nearer(experiment: Experiment, model: Model, start: Start) -> Start:
    """The best of some sizes around that of a start."""
    (term,) = start.variant.sizes
    neutral, size = term.neutral if np.isfinite(term.neutral) else 0.0, start.values[term.parameter]
    around = [neutral + times * (size - neutral) for times in _NEARER]
    near = _tried(experiment, model, [(start.cause, start.variant, size) for size in around])
    return min(near, key=lambda start: start.left)


def _tried(
    experiment: Experiment, model: Model, sizes: Iterable[tuple[Cause, Variant, float]]
) -> list[Start]:
    """What each size of a form leaves, its shapes where they start, beside the rig as it is."""
    given = [
        (cause, v, inside(v, {**start_values(v), v.sizes[0].parameter: size})) for cause, v, size in sizes
    ]
    left = _left(experiment, [override(model, model.name, **values) for _, _, values in given])
    return [Start(*each, rest) for each, rest in zip(given, left, strict=True)]


def _left(experiment: Experiment, models: Sequence[Model]) -> list[float]:
    """Sum of squares of each model, every move from the rest that was measured."""
    still = np.zeros((experiment.moves, 2))
    return [sum_of_squares(r) for r in residuals_each(experiment, models, [still] * len(models))]
