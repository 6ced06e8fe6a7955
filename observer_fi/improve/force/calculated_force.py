"""The problem of a rig that logs a force: the force that its motion calls for, against the commanded one.

A cause adds columns to a linear regression (`learn.inverse_dynamics`); held out are parts of the logs in turn, and one is
accepted if its extended BIC is positive and the residual there falls by three per cent or more. Two causes that hide one
another (each does little alone, both do much) are tried as a pair.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from observer_fi.improve.force.force_dependence import follows
from observer_fi.improve.force.force_screening import (
    ForceCandidate,
    alike,
    independent_samples,
    off,
    orthonormal,
    screen,
    vocabulary,
    won,
)
from observer_fi.improve.freed.freed_equations import FreedEquation
from observer_fi.improve.freed.smoothed_disturbance import SmoothedDisturbance
from observer_fi.improve.moves.keep_curve import Kept
from observer_fi.improve.residual_tables import Residuals, force_tables
from observer_fi.improve.steps import Candidate, HeldOut, Ladder, Measure, Smooth, Step, Trial
from observer_fi.learn import (
    TIMING,
    Columns,
    Motion,
    Solution,
    check_force_rig,
    extended_rig,
    held_out,
    parameters_of,
    prepare_motion,
    solve,
    structure_of,
    whiteness,
)
from observer_fi.logs import Excitation
from observer_fi.physics import FORCE, Coverage, Rig
from observer_fi.records import Array, Log

_LOW_SPEEDS = {"stribeck_torque", "saturating_drag"}  # curves of friction over low speeds
STANDS_OUT = 2.0  # standard errors of a size
SMEAR_S = 0.01  # one period of the position filter
# Sizes that cannot be below zero.
_SIGNED = (
    "A",
    "viscous_positive",
    "viscous_negative",
    "stribeck_torque",
    "saturating_drag",
    "load_friction",
    "slip_per_torque",
)


@dataclass(frozen=True)
class ForceSettings:
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
class _Refit(Trial[Solution]):
    """A trial with the number of samples that are independent for its columns, and of its parameters."""

    independent: float
    parameters: int


@dataclass(frozen=True)
class CalculatedForce:
    """Motions of one rig, and the columns of their regression."""

    rig: Rig
    motions: tuple[Motion, ...]
    columns: Columns
    settings: ForceSettings = field(default_factory=ForceSettings)
    seen_by: str = FORCE

    @property
    def rounds(self) -> int:
        return self.settings.rounds

    @property
    def parts(self) -> str:
        return f"{np.unique(self._baseline.part).size} parts"

    @property
    def sample_count(self) -> int:
        return int(self._baseline.residual.size)

    @cached_property
    def _baseline(self) -> Solution:
        return solve(self.columns, self.motions, structure_of(self.rig, self.motions))

    @cached_property
    def _vocabulary(self) -> list[ForceCandidate]:
        return vocabulary(coverage_of(self.rig, self.motions))

    def baseline(self) -> Solution:
        return self._baseline

    # --- scores -----------------------------------------------------------------------------------

    def screen(self, fitted: Solution, steps: Sequence[Step[Solution]]) -> list[Candidate]:
        self._look_through(fitted)
        still_open = [c for c in self._vocabulary if _is_open(c, fitted, steps) and self._stands(c, fitted)]
        scored = screen(self.columns, self.motions, fitted, still_open)
        gap = {"backlash": smallest_gap(fitted, self.columns.D)}
        return [
            replace(c, detectable={k: max(v, gap.get(k, 0.0)) for k, v in c.detectable.items()})
            for c in scored
        ]

    def _stands(self, candidate: ForceCandidate, fitted: Solution) -> bool:
        """Whether a form stands alone, or the one that it joins is in the model."""
        there = {term.name for term in fitted.structure.terms}
        others = [
            c for c in self._vocabulary if c.cause is candidate.cause and c.variant is not candidate.variant
        ]
        joined = any(t.name in there for c in others if not c.variant.beside for t in c.columns)
        return joined or not candidate.variant.beside

    def _look_through(self, fitted: Solution) -> None:
        """Small kinematic errors are seen through the inertia and the drag that the data show."""
        found = parameters_of(fitted)
        b = [found[name][0] for name in ("viscous_positive", "viscous_negative") if name in found]
        self.columns.reference = (float(f"{found['J'][0]:.4g}"), float(f"{np.mean(b) if b else 0.0:.4g}"))

    def trials(self, fitted: Solution, candidates: Sequence[Candidate]) -> list[Trial[Solution]]:
        """The leading causes one by one, and pairs that hide each other and win more than both alone."""
        leading = self._leading(_own(candidates))
        alone = _best_of_each_cause(c for c in leading if c.possible)
        singles = [self._trial(fitted, c) for c in alone[: self.settings.rivals]]
        pairs = [self._pair(fitted, pair, singles) for pair in self._hiding_pairs(fitted, leading)]
        return _in_order([*singles, *(pair for pair in pairs if pair is not None)], self._price)

    def _trial(self, fitted: Solution, *candidates: ForceCandidate) -> _Refit:
        structure = fitted.structure
        for candidate in candidates:
            structure = candidate.added_to(structure)
        solution = solve(self.columns, self.motions, structure)
        new = orthonormal(off(orthonormal(fitted.jacobian), solution.jacobian))
        n, k = independent_samples(new, solution.residual), new.shape[1]
        gain = 0.5 * n * math.log(fitted.rss / solution.rss)
        return _Refit(candidates, solution, gain, (gain - self._price(k, n, len(candidates)),), n, k)

    def _price(self, parameters: int, independent: float, causes: int) -> float:
        """Extended BIC [nats]: k ln n / 2 + causes ln(candidates)."""
        return 0.5 * parameters * math.log(independent) + causes * math.log(len(self._vocabulary))

    def _pair(
        self, fitted: Solution, pair: tuple[ForceCandidate, ForceCandidate], singles: Sequence[_Refit]
    ) -> _Refit | None:
        """Both together, with what each wins beside the other; None where they win no more than both alone."""
        both = self._trial(fitted, *pair)
        known = {t.candidates[0].variant: t.nets[0] for t in singles}
        a, b = (known[c.variant] if c.variant in known else self._trial(fitted, c).nets[0] for c in pair)
        net = both.nets[0]
        if net <= max(a, 0.0) + max(b, 0.0):
            return None
        return replace(both, nets=(net - max(b, 0.0), net - max(a, 0.0)))

    def _leading(self, scores: Sequence[ForceCandidate]) -> list[ForceCandidate]:
        """Scores without the causes that these data cannot tell from one that stands before them in the vocabulary.

        Otherwise the name would hang on the third digit of a score; the others are listed as rivals. What has the wrong sign
        now may have the right one beside another cause: both stay.
        """
        order = [c.cause.name for c in self._vocabulary]
        first: list[ForceCandidate] = []
        for score in sorted(scores, key=lambda s: order.index(s.cause.name)):
            others = [s for s in first if s.cause.name != score.cause.name and s.possible == score.possible]
            if not any(alike(s, score) > self.settings.alike for s in others):
                first.append(score)
        return sorted(first, key=lambda s: -s.net)

    def _hiding_pairs(
        self, fitted: Solution, scores: Sequence[ForceCandidate]
    ) -> list[tuple[ForceCandidate, ForceCandidate]]:
        """Pairs of causes that explain more together than the sum of what each explains alone, best first."""
        found = []
        for a, b in combinations([s for s in scores if math.isfinite(s.net)], 2):
            if a.cause.name == b.cause.name or all(_is_of_low_speeds(c) for c in (a, b)):
                continue
            basis = orthonormal(np.column_stack([a.basis, b.basis]))
            power = float(np.sum((basis.T @ fitted.residual) ** 2))
            if power > 1.1 * (a.power + b.power):
                n = independent_samples(basis, fitted.residual)
                net = won(fitted.rss, fitted.rss - power, n) - self._price(basis.shape[1], n, 2)
                found.append((net, (a, b)))
        found.sort(key=lambda item: -item[0])
        chosen: dict[tuple[str, ...], tuple[ForceCandidate, ForceCandidate]] = {}
        for net, pair in found:
            if net > 0.0:
                chosen.setdefault(tuple(sorted(c.cause.name for c in pair)), pair)
        return list(chosen.values())[: self.settings.pairs]

    # --- what is accepted -------------------------------------------------------------------------

    def judge(self, fitted: Solution, trial: Trial[Solution]) -> HeldOut | None:
        """A trial must pay, be possible, and help on held-out parts: by a share of what is left there, and by more than the
        noise of the position, which comes back through the controller into the force, where it looks like a delay or a slip.
        """
        if sum(trial.nets) <= 0.0 or not physical(trial.fitted, self.columns.D) or not _stands_out(trial):
            return None
        before, after = held_out(fitted), held_out(trial.fitted)
        ratio = float(np.linalg.norm(after) / np.linalg.norm(before))
        mass = parameters_of(fitted)["J"][0] / self.columns.D**2
        noise = sum(np.count_nonzero(m.use) * (mass * m.acceleration_noise) ** 2 for m in self.motions)
        if float(before @ before - after @ after) <= noise or ratio > 1.0 - self.settings.gain:
            return None
        return HeldOut(nll(before, fitted) - nll(after, trial.fitted), {"force_n": ratio})

    def rivals(
        self,
        fitted: Solution,
        trial: Trial[Solution],
        trials: Sequence[Trial[Solution]],
        candidates: Sequence[Candidate],
    ) -> dict[str, tuple[str, ...]]:
        found = {}
        for one in _own(trial.candidates):
            names = [
                c.cause.name for c in _own(candidates) if c.possible and alike(one, c) > self.settings.alike
            ]
            names += [
                t.causes[0] for t in trials if self._near(fitted, t, trial) and self._gone(fitted, t, trial)
            ]
            if one.cause.name == "shaft_ripple" and coverage_of(self.rig, self.motions).screw_is_shaft:
                names.append("screw_ripple")
            aliases = one.variant.aliases
            names += one.cause.aliases if aliases is None else aliases
            found[one.cause.name] = tuple(sorted(set(names) - set(trial.causes)))
        return found

    def _near(self, fitted: Solution, rival: Trial[Solution], accepted: Trial[Solution]) -> bool:
        """Whether the rival alone explains nearly what the accepted cause alone does."""
        if len(accepted.candidates) > 1 or len(rival.candidates) > 1:
            return False
        share = math.log(fitted.rss / rival.fitted.rss) / math.log(fitted.rss / accepted.fitted.rss)
        return share > 1.0 - self.settings.near

    def _gone(self, fitted: Solution, rival: Trial[Solution], accepted: Trial[Solution]) -> bool:
        """Whether the rival's evidence went with the residual that the accepted cause took away."""
        both = self._trial(accepted.fitted, *_own(rival.candidates))
        left = math.log(accepted.fitted.rss / both.fitted.rss)
        return left < 0.3 * math.log(fitted.rss / rival.fitted.rss)

    def settled(self, fitted: Solution, trial: Trial[Solution]) -> Solution:
        return trial.fitted

    def without(self, fitted: Solution, candidates: Sequence[Candidate]) -> Solution:
        structure = fitted.structure
        for candidate in _own(candidates):
            structure = candidate.taken_from(structure, self._baseline.structure)
        return solve(self.columns, self.motions, structure)

    def reconsidered(self, ladder: Ladder[Solution]) -> Ladder[Solution]:
        return ladder

    # --- what is reported -------------------------------------------------------------------------

    def measure(self, fitted: Solution) -> Measure:
        """The force residual [N] stands for the readings, for nothing else was predicted."""
        seen = held_out(fitted)
        rms = float(np.sqrt(np.mean(seen**2)))
        return Measure(
            nll(seen, fitted), {"force_n": rms}, {"force_n": whiteness(seen)}, noise_floor_of(seen)
        )

    def values(self, fitted: Solution) -> dict[str, tuple[float, float]]:
        return parameters_of(fitted)

    def doubt(self, fitted: Solution, parameter: str, std: float) -> float:
        return std

    def tables(self, fitted: Solution) -> Residuals:
        return force_tables(self.motions, fitted, self.rig)

    def unexplained(self, ladder: Ladder[Solution]) -> tuple[Smooth, ...]:
        return follows(self.motions, ladder.extended, self.rig, self.settings.report)

    def freed(self, baseline: Solution) -> tuple[tuple[FreedEquation, ...], tuple[SmoothedDisturbance, ...]]:
        return (), ()

    def kept(self, fitted: Solution, left: Sequence[Smooth]) -> tuple[Solution, Kept] | None:
        return None

    def extended_rig(self, ladder: Ladder[Solution]) -> Rig:
        causes = ", ".join(dict.fromkeys(name for step in ladder.steps for name in step.trial.causes))
        source = f"{self.rig.source}; extended by {causes or 'nothing'}"
        return extended_rig(self.rig, ladder.extended, f"{self.rig.name}_extended", source)

    def excitations(self) -> tuple[Excitation, ...]:
        return tuple(_excitation(m, self.columns.D) for m in self.motions)


def calculated_force(
    logs: Sequence[Log], rig: Rig, motions: Sequence[Motion] | None = None
) -> CalculatedForce:
    """The problem of a rig that is driven by a commanded force. motions: in place of the logs', if given."""
    check_force_rig(rig)
    prepared = tuple(motions or [prepare_motion(log) for log in logs])
    return CalculatedForce(rig, prepared, Columns(rig))


def coverage_of(rig: Rig, motions: Sequence[Motion]) -> Coverage:
    """What motions cover. The regression is linear in every size, so that only travel, speed and clock matter."""
    D = rig.model["D"]
    return Coverage(
        min(float(m.x.min()) for m in motions),
        max(float(m.x.max()) for m in motions),
        speed=max(float(np.abs(m.v).max()) for m in motions) / D,
        pitch=max(1.0, *(float(np.abs(m.theta).max()) for m in motions)),
        torque=max(rig.model["A"], 1e-9),
        step_s=motions[0].step,
        position_noise=max(m.noise for m in motions),
        turn=2.0 * math.pi * D,
        lead=rig.model["screw_lead"] if "screw_lead" in rig.quantities else math.nan,
    )


def smallest_gap(solution: Solution, D: float) -> float:
    """Play that these logs could show [m]: friction / mass times `SMEAR_S` squared.

    Friction that needs some milliseconds to change its sign looks like play of that size.
    """
    found = parameters_of(solution)
    return found["A"][0] * D / found["J"][0] * SMEAR_S**2


def physical(solution: Solution, D: float) -> bool:
    """Whether friction brakes at every speed, sizes with a sign have the right one, and a gap is wide enough to be one."""
    found = parameters_of(solution)
    wide = found.get("backlash", (math.inf, 0.0))[0] > smallest_gap(solution, D)
    return wide and all(found[n][0] > -2.0 * found[n][1] for n in _SIGNED if n in found)


def nll(residual: Array, solution: Solution) -> float:
    """Gaussian negative log-likelihood a sample [nats] with the variance of the fit."""
    variance = solution.rss / solution.residual.size
    return 0.5 * (math.log(2.0 * math.pi * variance) + float(np.mean(residual**2)) / variance)


def noise_floor_of(residual: Array) -> float:
    """Negative log-likelihood a sample [nats] of the part of a residual that differs from sample to sample."""
    variance = max(0.5 * float(np.mean(np.diff(residual) ** 2)), 1e-300)
    return 0.5 * (math.log(2.0 * math.pi * variance) + 1.0)


def _own(candidates: Iterable[Candidate]) -> list[ForceCandidate]:
    return [c for c in candidates if isinstance(c, ForceCandidate)]


def _is_open(candidate: ForceCandidate, fitted: Solution, steps: Sequence[Step[Solution]]) -> bool:
    """Whether neither the rig nor a step has this cause, or one that it cannot be told from.

    A form that only joins another one of its cause is open beside it.
    Of delays and lags one at a time is fitted: the next one would only share its time. Of curves over low speeds, too: the
    next one would only bend it.
    """
    there = {term.name for term in fitted.structure.terms}
    cause, beside = candidate.cause.name, candidate.variant.beside
    named = {(c.cause.name, c.variant.beside) for step in steps for c in step.trial.candidates}
    taken = {name for step in steps for rivals in step.rivals.values() for name in rivals}
    timed = set(TIMING) & set(candidate.free) and set(TIMING) & set(fitted.structure.free)
    bent = _LOW_SPEEDS & there and _is_of_low_speeds(candidate)
    return (
        not timed
        and not bent
        and cause not in taken
        and (cause, beside) not in named
        and not any(t.name in there for t in candidate.columns)
    )


def _is_of_low_speeds(candidate: ForceCandidate) -> bool:
    return not _LOW_SPEEDS.isdisjoint(t.name for t in candidate.columns)


def _stands_out(trial: Trial[Solution]) -> bool:
    """Whether sizes that have one sign are above what chance and the filters make of none."""
    found = parameters_of(trial.fitted)
    new = [t for c in trial.candidates for t in c.variant.sizes if t.low >= 0.0 and t.parameter in found]
    return all(found[t.parameter][0] > STANDS_OUT * found[t.parameter][1] for t in new)


def _in_order(trials: Sequence[_Refit], price: Callable[[int, float, int], float]) -> list[Trial[Solution]]:
    """Trials by what they win if each had as few independent samples as the worst, for only then do they compare.

    Those that do not pay come last.
    """
    paying = [t for t in trials if sum(t.nets) > 0.0]
    fewest = min((t.independent for t in paying), default=1.0)

    def even(trial: _Refit) -> float:
        gain = trial.gain * fewest / trial.independent
        return gain - price(trial.parameters, fewest, len(trial.candidates))

    rest = [t for t in trials if sum(t.nets) <= 0.0]
    return [*sorted(paying, key=lambda t: -even(t)), *sorted(rest, key=lambda t: -sum(t.nets))]


def _best_of_each_cause(scores: Iterable[ForceCandidate]) -> list[ForceCandidate]:
    """The first variant of each cause, in order."""
    found: dict[str, ForceCandidate] = {}
    for score in scores:
        if math.isfinite(score.net):
            found.setdefault(score.cause.name, score)
    return list(found.values())


def _excitation(motion: Motion, D: float) -> Excitation:
    """What a motion holds: its top speed, directions, pitches, reversals, and the seconds that count."""
    v = motion.v[motion.kept][motion.use]
    ways = np.sign(v[v != 0.0])
    pitches = np.unique(np.round(motion.theta, 0))
    turns = int(np.count_nonzero(np.diff(ways)))
    return Excitation(
        turns + 1, (float(np.abs(v).max()) / D,), tuple(int(w) for w in np.unique(ways)), tuple(pitches.tolist()),
        turns, {"moving": motion.factor * motion.step * v.size},
    )  # fmt: skip
