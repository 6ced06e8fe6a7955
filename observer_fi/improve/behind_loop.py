"""Moves of a motor whose servo nobody knows: which motion the loop around their simulation follows (docs/decisions/0029)."""

import math
from collections.abc import Callable
from dataclasses import replace

from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.misfit import GROSS_NATS, excess, samples
from observer_fi.improve.moves.screening import refit
from observer_fi.improve.moves.simulated_moves import SimulatedMoves
from observer_fi.improve.steps import Candidate, Ladder
from observer_fi.learn import FitResult, fit_or_none, followed
from observer_fi.numerics import with_unit

_TIMES = 2  # that a loop follows what was fitted with it
_LEADS = 0.5  # of the highest score, from which on a cause may be the largest
_ALIKE = 0.2  # of one size, by which it may differ from what another makes of it
_SHOWN = ("kinematics", "sensor:position")  # equations between the motor and its position
_MAKERS = ("Rm", "Km", "D", "tick_phase")
# Equations that are not simulated without a servo, or a voltage, in words.
_SILENT = {"servo": "servo", "sensor:current": "current sensor", "electrical": "winding"}


def named_behind_loop(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The problem behind a loop that follows a model with all causes, and its ladder of them.

    What a loop follows holds some of the model that it was made with, which hides a part of every cause, and the smaller ones
    behind the largest. That one is sought first, of a motor and a screw as their makers state them: a refit that fails by far
    would bend these. Behind a loop around a machine of far other constants everything fails, and nothing is named: where a refit
    fails by far the loop follows that one first.
    """
    alone = replace(problem, settings=replace(problem.settings, rounds=1), held=_MAKERS)
    alone = _near_its_refit(alone)
    near, first = _largest(alone, progress)
    problem = replace(problem, experiment=near.experiment)
    if first.steps and problem.model == problem.rig.model:
        problem = replace(problem, model=problem.ended(first.extended))
    problem, ladder = _near(problem, name_causes(problem, progress))
    return problem, _or_current_offset(problem, problem.reconsidered(ladder))


def _largest(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The problem and its ladder behind the loop that follows a model with all of it: as it is, or what a sensor shows of it."""
    near = _near_a_sensor(problem)
    loops = [problem] if near is None else [near[0]] if near[1] else [problem, near[0]]
    found = [_near(each, name_causes(each, progress)) for each in loops]
    return min(found, key=lambda pair: pair[1].extended.objective)


def _near_a_sensor(problem: SimulatedMoves) -> tuple[SimulatedMoves, bool] | None:
    """The problem behind a loop that follows a motor whose position is shown elsewhere, where that scores about as high as any
    cause; and whether it leaves less than any score promised.

    What is shown moves the loop itself, by more than a score can tell.
    """
    before = problem.baseline()
    candidates = problem.screen(before, ())
    most = max((c.gain for c in candidates), default=0.0)
    if most < GROSS_NATS * samples(problem.experiment):
        return None
    best = {c.cause.name: c for c in reversed(candidates) if c.gain > _LEADS * most}
    shown = [c for c in best.values() if c.cause.equation in _SHOWN]
    tried = [pair for pair in (_followed_with(problem, c) for c in shown) if pair is not None]
    if not tried:
        return None
    near, fitted = min(tried, key=lambda pair: pair[1].objective)
    return near, fitted.objective < before.objective - most


def _followed_with(problem: SimulatedMoves, candidate: Candidate) -> tuple[SimulatedMoves, FitResult] | None:
    """The problem behind a loop that follows the fit with a cause, and that fit; None where it runs away."""
    fitted = refit(problem.experiment, problem.baseline(), candidate)
    for _ in range(_TIMES):
        if fitted is None:
            return None
        problem = replace(problem, experiment=followed(problem.experiment, fitted.model))
        fitted = fit_or_none(problem.experiment, fitted.model, fitted.free, fitted.nuisance)
    return (problem, fitted) if fitted is not None else None


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


def _or_current_offset(problem: SimulatedMoves, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
    """The ladder whose offsets of torque and voltage are declared to be one of the current reading, where they may: what is
    measured drives the motor, and an offset o in it is a torque of Km o and a voltage of -Rm o.
    """
    names = {name for step in ladder.steps for name in step.trial.causes}
    m, alike = ladder.extended.model, {"torque_offset"}
    if "electrical" not in problem.experiment.silent:
        alike.add("voltage_offset")
        of_current = m["Rm"] / m["Km"] * m["torque_offset"]
        if not abs(m["voltage_offset"] + of_current) < _ALIKE * abs(of_current):
            return ladder
    if not alike <= names:
        return ladder
    rivals = [
        {
            cause: (*others, "current_offset") if cause in alike else others
            for cause, others in step.rivals.items()
        }
        for step in ladder.steps
    ]
    steps = [replace(step, rivals=own) for step, own in zip(ladder.steps, rivals, strict=True)]
    return replace(ladder, steps=tuple(steps))


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
