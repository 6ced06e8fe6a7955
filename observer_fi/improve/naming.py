"""Moves that are simulated: in which order their causes, the stops of the travel and the loop around a simulation are asked."""

from collections.abc import Callable
from dataclasses import replace

from observer_fi.improve.behind_loop import named_behind_loop
from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.misfit import GROSS_NATS, missed, samples
from observer_fi.improve.moves.simulated_moves import SimulatedMoves
from observer_fi.improve.steps import Ladder
from observer_fi.learn import FitResult


def named(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The problem as it was asked in the end, and its ladder of causes.

    Stops that a gross misfit seemed to show may be none. Where causes beside them leave a gross part of it, the largest one
    is sought without them, and they beside it.
    """
    if problem.given is not None:
        return named_behind_loop(problem, progress)
    ladder = problem.reconsidered(name_causes(problem, progress))
    gross = missed(problem.experiment, ladder.extended) > GROSS_NATS * samples(problem.experiment)
    if not gross or problem.model == problem.rig.model:
        return problem, ladder
    free = replace(problem, model=problem.rig.model)
    first = name_causes(replace(free, settings=replace(problem.settings, rounds=1)), progress)
    if not first.steps:
        return problem, ladder
    free = replace(free, model=free.ended(first.extended))
    other = free.reconsidered(name_causes(free, progress))
    better = other.extended.objective < ladder.extended.objective
    return (free, other) if better else (problem, ladder)
