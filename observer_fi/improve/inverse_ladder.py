"""Naming what a force-driven rig's equations miss: one cause at a time, each judged on parts the fit never saw.

1. Every cause that a commanded force and a position can show is scored: how much of the residual its columns explain
   after everything that is already in the model has done what it can, against an extended BIC
   n ln(rss0 / rss1) - k ln n - 2 ln candidates, n the number of independent samples.
2. The best are refitted with everything else. Two that hide one another (each does little alone, both do much) are
   tried as a pair.
3. One is accepted if its extended BIC is positive and the residual on held-out parts falls by one per cent or more.
4. What no cause explains is set against what it may depend on.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from observer_fi.improve.inverse_screening import (
    Score,
    alike,
    independent_samples,
    off,
    orthonormal,
    screen,
    won,
)
from observer_fi.improve.inverse_unexplained import unexplained
from observer_fi.improve.inverse_vocabulary import Candidate, screw_is_shaft, vocabulary
from observer_fi.learn import (
    TIMING,
    Columns,
    Motion,
    Solution,
    Structure,
    held_out,
    parameters_of,
    relative,
    solve,
    structure_of,
)
from observer_fi.physics import CAUSES, Rig
from observer_fi.records import Array


@dataclass(frozen=True)
class NamingSettings:
    """What it takes to name a cause.

    gain: smallest relative fall of the held-out residual. rivals: how many causes are refitted in a round; pairs: how
    many pairs. near: a rival that explains all but this share of what the accepted cause does, and nothing once it is
    in, cannot be told apart, nor one whose direction has a |cos| above `alike`. report: smallest share of the
    residual's variance that is worth a line.
    """

    gain: float = 0.03
    rivals: int = 6
    pairs: int = 3
    rounds: int = 12
    near: float = 0.3
    alike: float = 0.95
    report: float = 0.03


@dataclass(frozen=True)
class Rung:
    """One accepted step: a cause, or a pair of which each hides the other.

    nets: extended BIC of each cause, of a pair with the other in place. before, after: held-out residual relative to
    the force [per cent]. drop: fall of the held-out negative log-likelihood [nats a sample]. rivals: by cause, those
    that these data cannot tell from it.
    """

    candidates: tuple[Candidate, ...]
    nets: tuple[float, ...]
    before: float
    after: float
    drop: float
    rivals: dict[str, tuple[str, ...]]
    solution: Solution


@dataclass(frozen=True)
class Ladder:
    """The refitted start, the steps in order, the causes refused at the end, and what could have been seen."""

    rig: Rig
    columns: Columns
    motions: tuple[Motion, ...]
    start: Solution
    rungs: tuple[Rung, ...]
    refused: tuple[Score, ...]
    unexplained: tuple[tuple[str, float], ...]

    @property
    def final(self) -> Solution:
        """The model with every accepted cause."""
        return self.rungs[-1].solution if self.rungs else self.start


# --- the ladder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Round:
    """What every trial of a round shares."""

    columns: Columns
    motions: tuple[Motion, ...]
    base: Solution
    count: int
    settings: NamingSettings


@dataclass(frozen=True)
class _Trial:
    """One or two candidates refitted with everything else, the extended BIC that they win, and what went into it."""

    candidates: tuple[Candidate, ...]
    solution: Solution
    net: float
    independent: float
    parameters: int


def name_causes(
    rig: Rig,
    motions: Sequence[Motion],
    settings: NamingSettings | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Ladder:
    """Refit the rig's own terms, then name one cause after the other until nothing pays."""
    settings = settings or NamingSettings()
    columns, motions = Columns(rig), tuple(motions)
    start = base = solve(columns, motions, structure_of(rig, motions))
    candidates = vocabulary(rig, motions)
    rungs: list[Rung] = []
    scores: list[Score] = []
    for _ in range(settings.rounds):
        _look_through(columns, base)
        scores = screen(columns, motions, base, [c for c in candidates if _is_open(c, base.structure, rungs)])
        progress(f"{len(rungs)} steps, residual {base.relative:.2f} %")
        rung = _next(_Round(columns, motions, base, len(candidates), settings), scores)
        if rung is None:
            break
        rungs.append(rung)
        base = rung.solution
    gap = smallest_gap(base, columns.D)
    refused = tuple(
        _at_least(s, gap) for s in scores if all(s.candidate.cause not in _causes(rung) for rung in rungs)
    )
    left = unexplained(motions, base, rig, settings.report)
    return Ladder(rig, columns, motions, start, tuple(rungs), refused, left)


def _at_least(score: Score, gap: float) -> Score:
    """A score whose detectable play is no smaller than a gap can be told [m]."""
    limits = {"backlash": gap}
    return replace(score, detectable={k: max(v, limits.get(k, 0.0)) for k, v in score.detectable.items()})


def _causes(rung: Rung) -> tuple[str, ...]:
    return tuple(c.cause for c in rung.candidates)


def _look_through(columns: Columns, base: Solution) -> None:
    """Small kinematic errors are seen through the inertia and the drag that the data show."""
    found = parameters_of(base)
    b = [found[name][0] for name in ("viscous_positive", "viscous_negative") if name in found]
    columns.reference = (float(f"{found['J'][0]:.4g}"), float(f"{np.mean(b) if b else 0.0:.4g}"))


def _is_open(candidate: Candidate, structure: Structure, rungs: Sequence[Rung]) -> bool:
    """Whether neither the rig nor a step has this cause, nor one that it cannot be told from.

    Of delays and lags one at a time is fitted: the next one would only share its time.
    """
    there = {term.name for term in structure.terms}
    taken = {name for rung in rungs for cause, rivals in rung.rivals.items() for name in (cause, *rivals)}
    timed = set(TIMING) & set(candidate.free) and set(TIMING) & set(structure.free)
    return not timed and candidate.cause not in taken and not any(t.name in there for t in candidate.terms)


def _next(round_: _Round, scores: Sequence[Score]) -> Rung | None:
    """The best step that pays and helps on held-out parts."""
    leading = _leading(round_, scores)
    singles = [_trial(round_, s.candidate) for s in _best_of_each_cause(leading)[: round_.settings.rivals]]
    pairs = [_trial(round_, *pair) for pair in _hiding_pairs(round_, leading)]
    hiding = {id(pair): _alone(round_, pair, singles) for pair in pairs}
    strong = [pair for pair in pairs if pair.net > sum(max(net, 0.0) for net in hiding[id(pair)])]
    for trial in _in_order([t for t in [*singles, *strong] if t.net > 0.0], round_):
        before, after = held_out(round_.base), held_out(trial.solution)
        if physical(trial.solution, round_.columns.D) and _earns(round_, before, after):
            nets: tuple[float, ...] = (trial.net,)
            if len(trial.candidates) == 2:
                a, b = hiding[id(trial)]
                nets = (trial.net - max(b, 0.0), trial.net - max(a, 0.0))
            drop = nll(before, round_.base) - nll(after, trial.solution)
            was, now = (relative(e, round_.base.force) for e in (before, after))
            rivals = _rivals(round_, trial, singles, scores)
            return Rung(trial.candidates, nets, was, now, drop, rivals, trial.solution)
    return None


def _earns(round_: _Round, before: Array, after: Array) -> bool:
    """Whether held-out residuals (N,) fall by enough: a share of themselves, and more than the noise of the position.

    That noise comes back through the controller into the force, where it looks like a delay or a slip.
    """
    mass = parameters_of(round_.base)["J"][0] / round_.columns.D**2
    noise = sum(np.count_nonzero(m.use) * (mass * m.acceleration_noise) ** 2 for m in round_.motions)
    won_power = float(before @ before - after @ after)
    return won_power > noise and np.linalg.norm(after) <= (1.0 - round_.settings.gain) * np.linalg.norm(
        before
    )


def _trial(round_: _Round, *candidates: Candidate) -> _Trial:
    structure = round_.base.structure
    for candidate in candidates:
        structure = candidate.added_to(structure)
    solution = solve(round_.columns, round_.motions, structure)
    new = orthonormal(off(orthonormal(round_.base.jacobian), solution.jacobian))
    n, k = independent_samples(new, solution.residual), new.shape[1]
    net = won(round_.base.rss, solution.rss, n, k, len(candidates), round_.count)
    return _Trial(candidates, solution, net, n, k)


def _leading(round_: _Round, scores: Sequence[Score]) -> list[Score]:
    """Scores without the causes that these data cannot tell from one that stands before them in the vocabulary.

    Otherwise the name would hang on the third digit of a score; the others are listed as rivals.
    """
    order = [c.cause for c in vocabulary(round_.columns.rig, round_.motions)]
    first: list[Score] = []
    for score in sorted(scores, key=lambda s: order.index(s.candidate.cause)):
        others = [s for s in first if s.candidate.cause != score.candidate.cause]
        if not any(alike(s, score) > round_.settings.alike for s in others):
            first.append(score)
    return sorted(first, key=lambda s: -s.net)


SMEAR_S = 0.01  # one period of the position filter


def smallest_gap(solution: Solution, D: float) -> float:
    """Play that these logs could show [m]: friction / mass times `SMEAR_S` squared.

    Friction that needs some milliseconds to change its sign looks like play of that size.
    """
    found = parameters_of(solution)
    return found["A"][0] * D / found["J"][0] * SMEAR_S**2


def physical(solution: Solution, D: float) -> bool:
    """Whether friction brakes at every speed, sizes with a sign have the right one, and a gap is wide enough to be one."""
    found = parameters_of(solution)
    lowest = found["A"][0] + min(found.get("stribeck_torque", (0.0, 0.0))[0], 0.0)
    signed = ("viscous_positive", "viscous_negative", "load_friction", "slip_per_torque")
    wide = found.get("backlash", (math.inf, 0.0))[0] > smallest_gap(solution, D)
    return wide and lowest >= 0.0 and all(found[n][0] > -2.0 * found[n][1] for n in signed if n in found)


def _in_order(trials: list[_Trial], round_: _Round) -> list[_Trial]:
    """Trials by what they win if each had as few independent samples as the worst, for only then do they compare."""
    fewest = min((t.independent for t in trials), default=1.0)

    def even(trial: _Trial) -> float:
        return won(
            round_.base.rss, trial.solution.rss, fewest, trial.parameters, len(trial.candidates), round_.count
        )

    return sorted(trials, key=lambda trial: -even(trial))


def _best_of_each_cause(scores: Iterable[Score]) -> list[Score]:
    """The first variant of each cause, in order."""
    found: dict[str, Score] = {}
    for score in scores:
        if math.isfinite(score.net):
            found.setdefault(score.candidate.cause, score)
    return list(found.values())


def _hiding_pairs(round_: _Round, scores: Sequence[Score]) -> list[tuple[Candidate, Candidate]]:
    """Pairs of causes that explain more together than the sum of what each explains alone, best first."""
    base, found = round_.base, []
    for a, b in combinations([s for s in scores if math.isfinite(s.net)], 2):
        if a.candidate.cause == b.candidate.cause:
            continue
        basis = orthonormal(np.column_stack([a.basis, b.basis]))
        gain = float(np.sum((basis.T @ base.residual) ** 2))
        if gain > 1.1 * (a.gain + b.gain):
            n = independent_samples(basis, base.residual)
            net = won(base.rss, base.rss - gain, n, basis.shape[1], 2, round_.count)
            found.append((net, (a.candidate, b.candidate)))
    found.sort(key=lambda item: -item[0])
    chosen: dict[tuple[str, ...], tuple[Candidate, Candidate]] = {}
    for net, pair in found:
        if net > 0.0:
            chosen.setdefault(tuple(sorted(c.cause for c in pair)), pair)
    return list(chosen.values())[: round_.settings.pairs]


def _alone(round_: _Round, pair: _Trial, singles: Sequence[_Trial]) -> tuple[float, float]:
    """Extended BIC of each member of a pair without the other."""
    known = {(t.candidates[0].cause, t.candidates[0].variant): t.net for t in singles}
    nets = [known.get((c.cause, c.variant)) for c in pair.candidates]
    a, b = (
        _trial(round_, c).net if net is None else net for c, net in zip(pair.candidates, nets, strict=True)
    )
    return a, b


def _rivals(
    round_: _Round, trial: _Trial, singles: Sequence[_Trial], scores: Sequence[Score]
) -> dict[str, tuple[str, ...]]:
    """By accepted cause: those of another name that these data cannot tell from it."""
    settings, own = round_.settings, {c.cause for c in trial.candidates}
    found = {}
    for candidate in trial.candidates:
        own_score = next(s for s in scores if s.candidate is candidate)
        names = [s.candidate.cause for s in scores if alike(own_score, s) > settings.alike]
        names += [
            t.candidates[0].cause for t in singles if _near(round_, t, trial) and _gone(round_, t, trial)
        ]
        if candidate.cause == "shaft_ripple" and screw_is_shaft(round_.columns.rig):
            names.append("screw_ripple")
        names += _ALIASES.get((candidate.cause, candidate.variant), CAUSES[candidate.cause].aliases)
        found[candidate.cause] = tuple(sorted(set(names) - own))
    return found


def _near(round_: _Round, rival: _Trial, accepted: _Trial) -> bool:
    """Whether the rival alone explains nearly what the accepted cause alone does."""
    if len(accepted.candidates) > 1:
        return False
    share = math.log(round_.base.rss / rival.solution.rss) / math.log(round_.base.rss / accepted.solution.rss)
    return share > 1.0 - round_.settings.near


def _gone(round_: _Round, rival: _Trial, accepted: _Trial) -> bool:
    """Whether the rival's evidence went with the residual that the accepted cause took away."""
    both = _trial(replace(round_, base=accepted.solution), *rival.candidates)
    left = math.log(accepted.solution.rss / both.solution.rss)
    return left < 0.3 * math.log(round_.base.rss / rival.solution.rss)


# In these equations a late force and a late position are one; and drag per direction has no double, whatever the
# Coulomb friction of each direction has.
_ALIASES = {
    ("input_delay", "delay"): ("position_delay",),
    ("asymmetric_friction", "viscous, per direction"): (),
}


def nll(residual: Array, solution: Solution) -> float:
    """Gaussian negative log-likelihood a sample [nats] with the variance of the fit."""
    variance = solution.rss / solution.residual.size
    return 0.5 * (math.log(2.0 * math.pi * variance) + float(np.mean(residual**2)) / variance)
