"""Which accepted names are not to be believed, by what they leave: a law that is right leaves nothing of its equation.

A name beside the truth explains a part of the misfit, often the most of it; what shows it is the rest. Three rests do: one that
no curve explains and that is larger than what the name gained; one that the name's own equation is wanted for, though nothing
known goes with it; and one for which a single curve does, which then explains the share of the name as well.
"""

from collections.abc import Callable

from observer_fi.improve.moves.left_over import Rest, rest_of
from observer_fi.improve.moves.misfit import missed
from observer_fi.improve.steps import Ladder, Step
from observer_fi.learn import Experiment, FitResult

_NEEDLESS = 0.5  # of what a curve explains beside a name, by which a curve in place of it must explain more than the name

Without = Callable[[FitResult, Step[FitResult]], FitResult]


def believed(experiment: Experiment, ladder: Ladder[FitResult], without: Without) -> Ladder[FitResult]:
    """The ladder without names that what they leave refutes, the weakest asked first. without: the fit less one step."""
    rest = rest_of(experiment, ladder)
    if not ladder.steps or not rest.told:
        return ladder
    dark = missed(experiment, ladder.extended) - rest.curve
    fitted, kept = ladder.extended, list(ladder.steps)
    for step in sorted(ladder.steps, key=lambda s: s.trial.gain):
        before = without(fitted, step)
        gain = before.objective - fitted.objective
        if gain < dark or _is_incomplete(step, rest) or _is_needless(experiment, ladder, before, gain, rest):
            fitted, kept = before, [s for s in kept if s is not step]
    gone = tuple(
        pair for s in ladder.steps if s not in kept for pair in zip(s.trial.causes, s.trial.nets, strict=True)
    )
