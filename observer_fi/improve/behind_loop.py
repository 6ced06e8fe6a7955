"""Moves of a motor whose servo nobody knows: which motion the loop around their simulation follows (docs/decisions/0029)."""

import math
from collections.abc import Callable
from dataclasses import replace

from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.misfit import GROSS_NATS, OF_POSITION, excess, samples
from observer_fi.improve.moves.screening import free_of, inside, start_values
from observer_fi.improve.moves.simulated_moves import SimulatedMoves
from observer_fi.improve.steps import Candidate, Ladder
from observer_fi.learn import FitResult, fit_or_none, followed
from observer_fi.numerics import with_unit
from observer_fi.physics import override

_TIMES = 2  # that a loop follows what was fitted with it
_MOST_TIMES = 12  # that it follows what a sensor shows
_BETTER = 0.8  # of what was left each time, to go on
_PLAY = "backlash"
_FAR = 50.0  # of a size at which scores are taken: where a score has none, the loop begins with that
_SEEN_NATS = 0.1  # a sample that a score promises, from which on what a sensor shows is looked for
_LEADS = 0.5  # of the highest score, from which on a cause may be the largest
_ALIKE = 0.2  # of one size, by which it may differ from what another makes of it
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
    problem = replace(problem, experiment=near.experiment, begun=near.begun if first.steps else None)
    if first.steps and problem.model == problem.rig.model:
        problem = replace(problem, model=problem.ended(first.extended))
    problem, ladder = _near(problem, name_causes(problem, progress))
    return problem, _or_current_offset(problem, problem.reconsidered(ladder))


def _largest(
    problem: SimulatedMoves, progress: Callable[[str], None]
) -> tuple[SimulatedMoves, Ladder[FitResult]]:
    """The problem and its ladder behind the loop that follows a model with all of it: as it is, or what a sensor shows of it."""
    near = _near_a_sensor(problem)
    shown = [] if near is None else [_near(near[0], name_causes(near[0], progress))]
    shown = [pair for pair in shown if pair[1].steps]
    if near is not None and near[1] and shown:
        return shown[0]
    as_it_is = _near(problem, name_causes(problem, progress))
    return min(as_it_is, *shown, key=lambda pair: pair[1].extended.objective) if shown else as_it_is


def _near_a_sensor(problem: SimulatedMoves) -> tuple[SimulatedMoves, bool] | None:
    """The problem behind a loop that follows a motor whose position is shown elsewhere, where that scores about as high as any
    cause; and whether it leaves less than any score promised.

    What is shown moves the loop itself, by more than a score can tell. Play has none to speak of: while the motor crosses it, the
    loop holds the simulation where the mass is.
    """
    before = problem.baseline()
    candidates = problem.screen(before, ())
    most = max((c.gain for c in candidates), default=0.0)
    if most < _SEEN_NATS * samples(problem.experiment):
        return None
    best = {c.cause.name: c for c in reversed(candidates) if c.gain > _LEADS * most or c.cause.name == _PLAY}
    shown = [c for c in best.values() if c.cause.equation in OF_POSITION]
    tried = [pair for pair in (_followed_with(problem, c) for c in shown) if pair is not None]
    near, fitted = min(tried, key=lambda pair: pair[1].objective, default=(problem, before))
    gain = before.objective - fitted.objective
    return (near, gain > most) if gain > _LEADS * most else None


def _followed_with(problem: SimulatedMoves, candidate: Candidate) -> tuple[SimulatedMoves, FitResult] | None:
    """The problem behind a loop that follows a cause of the size that is fitted behind it, and that fit; None where all run away.

    Each fit begins with the constants as they are known: a size that is off by far bends them, from where no other fit returns.
    """
    variant, best = candidate.variant, None
    free = (*problem.baseline().free, *free_of(variant))
    values = start_values(variant)
    values |= {name: size or _FAR * values[name] for name, size in candidate.size.items()}
    for _ in range(_MOST_TIMES):
        model = override(problem.model, problem.model.name, **inside(variant, values))
        near = replace(problem, experiment=followed(problem.experiment, model))
        fitted = fit_or_none(near.experiment, model, free)
        if fitted is None or (best is not None and fitted.objective > _BETTER * best[1].objective):
            break
        best = replace(near, begun=(candidate, fitted.model)), fitted
        values |= {term.parameter: fitted.model[term.parameter] for term in variant.terms}
    return best


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
    for _ in range(_TIMES):
        if not ladder.steps:
            break
        near = followed(problem.experiment, ladder.extended.model)
        problem = replace(_begun_again(problem, ladder), experiment=near)
        ladder = problem.again(ladder)
    return problem, ladder


def _begun_again(problem: SimulatedMoves, ladder: Ladder[FitResult]) -> SimulatedMoves:
    """The problem with the cause that it begins with as it was fitted last, alone."""
    first = ladder.steps[0].trial.candidates[0]
    if problem.begun is None or first.cause is not problem.begun[0].cause:
        return problem
    return replace(problem, begun=(first, ladder.path[0].model))


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
