"""What the model with every named cause still leaves of simulated moves: smooth terms, or an equation without a name."""

from collections.abc import Callable
from dataclasses import replace

from observer_fi.improve.freed.freed_equations import WANTED_NATS
from observer_fi.improve.freed.smoothed_disturbance import Freedom
from observer_fi.improve.moves.lines import MOST_OF_IT, line_by_move
from observer_fi.improve.moves.misfit import (
    OF_POSITION,
    POSITION,
    bent,
    clear,
    dust,
    excess,
    position_dust,
    raw_excess,
)
from observer_fi.improve.moves.unexplained import LINES_OF, price, rest_steps, slow_excess, smooth_terms
from observer_fi.improve.steps import Ladder, Smooth, nameless
from observer_fi.learn import DISTURBANCES, Experiment, FitResult
from observer_fi.records import Array

_SENSORS = ("sensor:voltage", "sensor:current")
_UNEXPLAINED_SHARE = 0.2  # of the excess misfit that a smooth term must carry to be told
_STEP_NATS = 20.0  # that a drift or tilt of the position sensor must gain in the steps between moves
_SLOW_SHARE = 0.5  # of the dust that must be left in means over some ms before smooth terms are tried
_BELOW = 0.02  # nats a reading below the noise, from which a freed equation follows the noise
_CLEARLY = 2.0  # times the dust: what a freed equation must gain to be told without a name
_AS_GOOD = 0.9  # a second regressor is told where it explains this much of what the first does
_FEW = 4  # terms that are told: of a scale that is not the same everywhere every regressor explains the most


def left_over(
    experiment: Experiment, ladder: Ladder[FitResult], free: Callable[[FitResult], Freedom]
) -> tuple[Smooth, ...]:
    """The smooth terms that the extended model still asks for, the best first; else what it leaves without a name.

    Where an equation that is free explains more than the best of them, it comes first, with its own terms if there are any: a
    curve that has the right regressor explains as much, with fewer numbers. A line over the motor's angle that explains more
    than all of them stands alone. free: which equations the data want to free from a fit.
    """
    terms = _smooth_rest(experiment, ladder)
    freed = _wanted(experiment, ladder, free)
    if not terms and not freed:
        return tuple(nameless(equation, 0.0, 0.0) for equation in bent(experiment, ladder.extended))
    line = _line(experiment, ladder.extended)
    if line is not None and line.gain > max(row.held_out for row in (*terms, *freed)):
        return (line,)
    if terms and freed and terms[0].held_out >= freed[0].gain:
        return terms
    freest = {row.equation for row in freed}
    own = [term for term in terms if term.equation in freest]
    return (*(own or freed), *(term for term in terms if term.equation not in freest))


def _wanted(
    experiment: Experiment, ladder: Ladder[FitResult], free: Callable[[FitResult], Freedom]
) -> tuple[Smooth, ...]:
    """The equation that the data still want free, though nothing known goes with it, if there is one."""
    fitted = ladder.extended
    most = excess(experiment, ladder.baseline.residuals) if ladder.steps else 0.0
    least = max(WANTED_NATS, min(_CLEARLY * dust(experiment, most), clear(experiment)))
    whole = raw_excess(experiment, fitted.residuals)
    below = whole < -_BELOW * int((experiment.weight > 0.0).sum())  # noise of the logger that is not white
    if below or slow_excess(experiment, fitted.residuals) <= _SLOW_SHARE * least:
        return ()
    # A loop that follows a noisy position wanders, which a free equation takes for its own.
    if experiment.driven.size and whole < least:
        return ()
    freed = [row for row in free(fitted)[0] if row.gain >= least]
    return (nameless(freed[0].equation, freed[0].gain, whole),) if freed else ()


def _line(experiment: Experiment, fitted: FitResult) -> Smooth | None:
    """A line over the motor's angle that explains the most of what a fit leaves, if there is one, by its order."""
    whole = raw_excess(experiment, fitted.residuals)
    equations = {kind: DISTURBANCES[kind].equation for kind in LINES_OF}
    found = [
        (line_by_move(experiment, fitted, k), name)
        for k, name in equations.items()
        if name not in experiment.silent
    ]
    lines = [(line, equation) for line, equation in found if line is not None]
    line, equation = max(lines, key=lambda pair: pair[0].gain, default=(None, ""))
    if line is None or line.gain < MOST_OF_IT * whole:
        return None
    return replace(nameless(equation, line.gain, whole), regressor="shaft_angle", order=line.at)


def _smooth_rest(experiment: Experiment, ladder: Ladder[FitResult]) -> tuple[Smooth, ...]:
    """The smooth terms that the extended model still asks for, the best first."""
    r = ladder.extended.residuals
    whole = max(raw_excess(experiment, r), *(raw_excess(experiment, r, c) for c in range(3)))
    most = excess(experiment, ladder.baseline.residuals)
    least, of_position = dust(experiment, most), position_dust(experiment, most)
    slow = (
        slow_excess(experiment, r) > _SLOW_SHARE * least
        or slow_excess(experiment, r, POSITION) > _SLOW_SHARE * of_position
    )
    terms = smooth_terms(experiment, ladder.extended, whole) if slow else []
    terms = [
        term
        for term in terms
        if min(term.held_out, term.gain - price(experiment, term))
        >= (of_position if term.equation in OF_POSITION else least)
    ]
    # The share of steps is that of the steps themselves.
    steps = [term for term in rest_steps(experiment, ladder.extended) if term.held_out >= _STEP_NATS]
    terms = sorted([*terms, *steps], key=lambda term: -term.held_out)
    if not terms:
        return ()
    best = terms[0]
    told: dict[tuple[str, str], Smooth] = {}
    for term in terms:
        share = term.share if any(term is step for step in steps) else _share(experiment, r, term, whole)
        if share >= _UNEXPLAINED_SHARE and term.held_out >= _AS_GOOD * best.held_out:
            told.setdefault((term.equation, term.regressor), replace(term, share=share))
    return tuple(told.values())[:_FEW]


def _share(experiment: Experiment, r: Array, term: Smooth, whole: float) -> float:
    """Share of the residual's excess variance, of the only channel where one shows it, that the term explains."""
    if term.equation in OF_POSITION:
        whole = raw_excess(experiment, r, POSITION)
    elif term.equation in _SENSORS:
        whole = raw_excess(experiment, r, _SENSORS.index(term.equation))
    return min(term.held_out / max(whole, term.gain, 1e-300), 1.0)
