"""Moves of a motor whose servo nobody knows: which motion the loop around their simulation follows (docs/decisions/0029)."""

import math
from collections.abc import Callable
from dataclasses import replace

from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.misfit import GROSS_NATS, excess, missed, samples
from observer_fi.improve.moves.simulated_moves import SimulatedMoves
from observer_fi.improve.steps import Ladder
from observer_fi.learn import FitResult, followed
from observer_fi.numerics import with_unit

_TIMES = 2  # that a loop follows what was fitted with it
_MAKERS = ("Rm", "Km", "D", "tick_phase")
# Equations that are not simulated without a servo, or a voltage, in words.
_SILENT = {"servo": "servo", "sensor:current": "current sensor", "electrical": "winding"}


def named(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The problem and its ladder of causes; where a loop stands for a servo, behind one that follows a model with all of them.

    What a loop follows holds some of the model that it was made with, which hides a part of every cause, and the smaller ones
    behind the largest. That one is sought first, of a motor and a screw as their makers state them: a refit that fails by far
    would bend these. Behind a loop around a machine of far other constants everything fails, and nothing is named: where a refit
    fails by far the loop follows that one first.
    """
    if problem.given is None:
        return _named_with_stops(problem, progress)
    alone = replace(problem, settings=replace(problem.settings, rounds=1), held=_MAKERS)
    alone = _near_its_refit(alone)
    near, first = _near(alone, name_causes(alone, progress))
    problem = replace(problem, experiment=near.experiment)
    if first.steps and problem.model == problem.rig.model:
        problem = replace(problem, model=problem.ended(first.extended))
    problem, ladder = _near(problem, name_causes(problem, progress))
    return problem, problem.reconsidered(ladder)


def _named_with_stops(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The same where a servo is known. Where nothing is believed with the stops that a gross misfit seemed to show, the largest
    cause is sought without them, and they beside it.
    """
    ladder = problem.reconsidered(name_causes(problem, progress))
    gross = missed(problem.experiment, ladder.extended) > GROSS_NATS * samples(problem.experiment)
    if ladder.steps or not gross or problem.model == problem.rig.model:
        return problem, ladder
    free = replace(problem, model=problem.rig.model)
    first = name_causes(replace(free, settings=replace(problem.settings, rounds=1)), progress)
    if not first.steps:
        return problem, ladder
    free = replace(free, model=free.ended(first.extended))
    other = free.reconsidered(name_causes(free, progress))
    return (free, other) if other.steps else (problem, ladder)


def _near_its_refit(problem: SimulatedMoves) -> SimulatedMoves:
    """The problem behind a loop that follows its own refit, where that fails by far and by less then."""
    for _ in range(_TIMES):
        experiment, fitted = problem.experiment, problem.baseline()
        if excess(experiment, fitted.residuals) < GROSS_NATS * samples(experiment):
            break
        other = replace(problem, experiment=followed(experiment, fitted.model))
        if not other.baseline().objective < fitted.objective:
            break
        problem = other
    return problem


def _near(problem: SimulatedMoves, ladder: Ladder[FitResult]) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The same behind a loop that follows the extended model."""
    for _ in range(_TIMES if ladder.steps else 0):
        problem = replace(problem, experiment=followed(problem.experiment, ladder.extended.model))
        ladder = problem.again(ladder)
    return problem, ladder


def told(problem: SimulatedMoves) -> tuple[str, ...]:
    """What to say of moves that no servo of their own drives."""
    if problem.given is None:
        return ()
    silent = [_SILENT[name] for name in problem.experiment.silent if name in _SILENT]
    m = problem.rig.model
    hz = math.sqrt(m["Ki"] * m["Km"] / m["J"]) / (2.0 * math.pi)
    return (
        "the servo is not known: the measured current drives every move, behind a loop that follows the measured position "
        f"at {with_unit(hz, 'Hz')}; {', '.join(silent)} are not tested",
    )
