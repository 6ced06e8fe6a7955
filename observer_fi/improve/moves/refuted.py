"""Accepted names that are refuted by what they leave: a law that is right leaves nothing of its equation.

What stands for the truth explains a part of the misfit, often the most of it. Five rests show it: one that is told without a
curve, or beside one, and is larger than what the name gained; one that is told without a curve, or for the servo with one, of
the name's own equation; one of a curve which, in place of the name, explains what both do; one of a curve over what the name
goes with itself; and, beside a scale of the position, a curve over the position.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from observer_fi.improve.moves.misfit import OF_POSITION, missed
from observer_fi.improve.moves.unexplained import price, smooth_terms
from observer_fi.improve.steps import Ladder, Smooth, Step
from observer_fi.learn import Experiment, FitResult

_SCALES = {"position_gain", "partial_slip"}  # of the travel, the same everywhere
_ALONG = ("position", "screw_angle")
# What a law that is right leaves nothing of: a curve over what it goes with itself, of so much of its gain.
_LAWS = {
    "load_dependent_friction": ("load", "current"), "position_dependent_friction": ("position",), "viscous_friction": ("speed",),
    "stribeck_friction": ("speed",), "friction_warmup": ("time", "temperature"), "winding_heating": ("time", "temperature"),
    "brush_drop": ("current", "load"), "gravity_nonlinearity": ("pitch",),
    "position_periodic_error": ("position", "screw_angle"),
}  # fmt: skip
# A drag that goes with the square of the speed leaves 3 % of what one that goes with it gains, at four speeds.
_LEFT_OF_IT, _LEFT_OF_DRAG = 0.05, 0.02
_TIMING = 0.002  # of what a name gains: so much of a gross effect the timing of a servo leaves
_MOST = 0.5  # of what a curve explains beside a name, that a curve in its place must explain besides


def unrefuted(
    experiment: Experiment,
    ladder: Ladder[FitResult],
    rest: Sequence[Smooth],
    without: Callable[[FitResult, Step[FitResult]], FitResult],
) -> Ladder[FitResult]:
    """The ladder less the names that the rest refutes, the weakest asked first.

    rest: what is told of the misfit that it leaves, the most telling first. without: a fit less one of the steps.
    """
    curve = rest[0].gain if rest[0].at.size else 0.0
    dark = missed(experiment, ladder.extended) - curve
    fitted, gone = ladder.extended, []
    for step in sorted(ladder.steps, key=lambda s: s.trial.gain):
        before = without(fitted, step)
        gain = before.objective - fitted.objective
        refuted = gain < dark or _is_part_of_it(step, gain, rest[0]) or _is_no_scale(step, rest[0])
        refuted = refuted or _is_another_law(step, gain, rest[0])
        if refuted or _is_needless(experiment, before, gain, curve):
            fitted = before
            gone.append(step)
    return _less(ladder, fitted, gone)


def _is_part_of_it(step: Step[FitResult], gain: float, first: Smooth) -> bool:
    """Whether an equation that nothing known goes with, and that the data want free, is that of a name [nats].

    A servo's own error goes with whatever a servo does. Of a gross effect the timing of a servo leaves a thousandth.
    """
    equations = {candidate.cause.equation for candidate in step.trial.candidates}
    nameless = not first.at.size or first.equation == "servo"
    return nameless and first.gain > max(_TIMING * gain, 0.0) and first.equation in equations


def _is_another_law(step: Step[FitResult], gain: float, first: Smooth) -> bool:
    """Whether a curve over what a name goes with, in its own equation, is still wanted beside it [nats]."""
    causes = [candidate.cause for candidate in step.trial.candidates]
    own = [
        cause.equation == first.equation and first.regressor in _LAWS.get(cause.name, ()) for cause in causes
    ]
    if len(causes) > 1 or not all(own):
        return False
    drag = all(cause.name == "viscous_friction" for cause in causes)
    return first.gain > (_LEFT_OF_DRAG if drag else _LEFT_OF_IT) * gain


def _is_no_scale(step: Step[FitResult], first: Smooth) -> bool:
    """Whether a scale of the travel is not the same everywhere along it."""
    return set(step.trial.causes) <= _SCALES and first.equation in OF_POSITION and first.regressor in _ALONG


def _is_needless(experiment: Experiment, before: FitResult, gain: float, curve: float) -> bool:
    """Whether a curve explains, without a name, its gain and most of what a curve explains beside it [nats]."""
    if curve == 0.0:
        return False
    instead = smooth_terms(experiment, before, 0.0)[0]
    return instead.gain - price(experiment, instead) > gain + _MOST * curve


def _less(ladder: Ladder[FitResult], fitted: FitResult, gone: list[Step[FitResult]]) -> Ladder[FitResult]:
    """The ladder without some steps, which count as tried and refused."""
    kept = tuple(step for step in ladder.steps if all(step is not other for other in gone))
    refused = [pair for s in gone for pair in zip(s.trial.causes, s.trial.nets, strict=True)]
    return replace(
        ladder,
        extended=fitted if kept else ladder.baseline,
        steps=kept,
        path=ladder.path if kept else (),
        refused=(*refused, *ladder.refused),
    )
