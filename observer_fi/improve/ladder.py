"""Names what the equations of a rig get wrong: one cause at a time, each judged on samples that the fit never saw.

Score every variant of the vocabulary, refit the leading ones together with everything else, accept the best one that pays
for its parameters and helps on what was held out; then ask again. In the end each step must still earn its place beside the
others. The columns, the fit and the rule for what is held out belong to the problem (`problem.py`).
"""

from collections.abc import Callable, Sequence

from observer_fi.improve.problem import Problem
from observer_fi.improve.steps import Candidate, F, Ladder, Step, Trial


def name_causes(problem: Problem[F], progress: Callable[[str], None] = lambda text: None) -> Ladder[F]:
    """Refit, then name one cause after the other until nothing pays."""
    progress("refit of the rig")
    baseline = fitted = problem.baseline()
    steps: list[Step[F]] = []
    path: list[F] = []
    trials: list[Trial[F]] = []
    candidates: list[Candidate] = []
    for _ in range(problem.rounds):
        progress(f"scores, {len(steps)} named so far")
        step, trials, candidates = next_step(problem, fitted, steps)
        if step is None:
            break
        fitted = problem.settled(fitted, step.trial)
        steps.append(step)
        path.append(fitted)
    if len(steps) > 1:
        progress("does each cause still stand")
        fitted, steps = still_standing(problem, fitted, steps)
    refused = tuple((name, net) for t in trials for name, net in zip(t.causes, t.nets, strict=True))
    return Ladder(baseline, fitted, tuple(steps), tuple(path), refused, tuple(candidates))


def next_step(
    problem: Problem[F], fitted: F, steps: Sequence[Step[F]]
) -> tuple[Step[F] | None, list[Trial[F]], list[Candidate]]:
    """The best trial that is accepted, if any; all trials; all scores."""
    candidates = problem.screen(fitted, steps)
    trials = problem.trials(fitted, candidates)
    for trial in trials:
        held_out = problem.judge(fitted, trial)
        if held_out is not None:
            rivals = problem.rivals(fitted, trial, trials, candidates)
            return Step(trial, held_out, rivals), trials, candidates
    return None, trials, candidates


def still_standing(problem: Problem[F], fitted: F, steps: Sequence[Step[F]]) -> tuple[F, list[Step[F]]]:
    """Drop what lost its support after others entered; swap what another cause explains better by now.

    The step that entered last won beside all others: it is asked again only where one of these has changed.
    """
    left, changed = list(steps), False
    for item in sorted(steps, key=lambda s: s.trial.gain):
        if len(left) < 2:
            break
        if item is steps[-1] and not changed:
            continue
        without = problem.without(fitted, item.trial.candidates)
        rest = [s for s in left if s is not item]
        step, _, _ = next_step(problem, without, rest)
        if step is None:
            left, fitted, changed = rest, without, True
            continue
        left = [step if s is item else s for s in left]
        if set(step.trial.causes) != set(item.trial.causes):
            fitted, changed = problem.settled(without, step.trial), True
    return fitted, left
