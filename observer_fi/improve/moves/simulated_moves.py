"""The problem of a rig with a servo: its moves are simulated, and compared with the measured ones.

A cause adds parameters to the simulation; the fit is Gauss-Newton over all moves; held out is every move in turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from observer_fi.improve.freed.smoothed_disturbance import Freedom, free_equations
from observer_fi.improve.moves.gross_starts import gross_fits
from observer_fi.improve.moves.judgement import (
    MoveSettings,
    is_no_line,
    is_no_scale,
    matters,
    only_bends,
    smooth_is_better,
)
from observer_fi.improve.moves.keep_curve import Kept, fit_kept_curve
from observer_fi.improve.moves.left_over import left_over
from observer_fi.improve.moves.lines import lines_of
from observer_fi.improve.moves.misfit import (
    GROSS_NATS,
    OF_POSITION,
    bent,
    disregard,
    dust,
    excess,
    held_out_residuals,
    imperfection,
    missed,
    position_dust,
    samples,
)
from observer_fi.improve.moves.refuted import unrefuted
from observer_fi.improve.moves.rig_refit import (
    STOP_NATS,
    base_parameters,
    causes_of,
    refit_of_the_rig,
    with_stops,
)
from observer_fi.improve.moves.screening import coverage_of, free_of, penalty, refit, screen, without
from observer_fi.improve.residual_tables import Residuals, residual_tables
from observer_fi.improve.steps import Candidate, HeldOut, Ladder, Measure, Smooth, Step, Trial
from observer_fi.learn import (
    Experiment,
    FitResult,
    doubtful,
    fit,
    fit_or_none,
    inflation,
    nll_per_sample,
    noise_floor,
    prepare,
    share_of,
    timed,
    tracked,
    whiteness,
    with_usual_servo,
    with_whole_command,
)
from observer_fi.logs import Excitation, excitation, is_recovered, log_segments, moves_from_rest
from observer_fi.numerics import sum_of_squares
from observer_fi.physics import CAUSES, MOVES, Model, Rig, is_curve, override, speed, with_values
from observer_fi.records import Array, Filter, Log, Segment

# A score is taken before a candidate's shape is fitted: shares of the dust, and of the best score, below which it is
# not worth a refit.
_PROMISING, _HOPELESS = 0.1, 0.03
_EXACT = 2  # refits of a round that may be done anew, exactly
_SECONDS = 2  # causes that are tried beside a first one, where a smooth term explains more than that
_DEAREST = 3  # parameters of a cause, at most
_BEHIND = 0.05  # of its score that a refit may miss
MOST_ROWS = 120_000  # samples of moves that are fitted at once: a fit is held for every cause that is tried
_STEPS = 8  # of the integration in a transient: with two, A and Kp are four standard errors off
_SETTLED = 30  # iterations in which an accepted trial is fitted exactly
# On development seeds 4200, 4300 and 4400 of the independent truth formal errors of sizes scatter by 1.2.
_IMPERFECT = 1.25
_SAMPLED = ("current_lag", "input_delay", "voltage_delay")
_HOPELESS_NATS = (
    10.0  # a sample, that no right model leaves, whatever it explains: a loop that rings has been lost
)
_GROSS_LEFT = 0.1  # of the refit's misfit, that the best other trial leaves
_GROSS_BENT = 0.01  # the same of names, where they bend what data sheets hold

UNITS = (("voltage", "v"), ("current", "a"), ("position", "m"))


# --- the problem -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class SimulatedMoves:
    """Moves of the logs of one rig, simulated with a model: the rig's, with the stops that the logs show.

    given, logged: the rig and the moves as they were where that has no servo, and a loop around the simulation stands for one
    (`learn.tracked`).
    held: constants that no refit moves. begun: what a position sensor shows as a first cause, and the model with it that the loop
    follows.
    """

    logs: tuple[Log, ...]
    rig: Rig
    experiment: Experiment
    model: Model
    settings: MoveSettings = field(default_factory=MoveSettings)
    seen_by: str = MOVES
    given: Rig | None = None
    logged: Experiment | None = None
    held: tuple[str, ...] = ()
    begun: tuple[Candidate, Model] | None = None

    @property
    def rounds(self) -> int:
        return self.settings.rounds

    @property
    def parts(self) -> str:
        return f"{self.experiment.moves} moves"

    @property
    def sample_count(self) -> int:
        return samples(self.experiment)

    @property
    def _channels(self) -> list[tuple[int, tuple[str, str]]]:
        """Numbers, names and units of the channels that count."""
        return [(c, UNITS[c]) for c in self.experiment.seen]

    @cached_property
    def _baseline(self) -> FitResult:
        return refit_of_the_rig(self.experiment, self.rig, self.model, self.held)

    @cached_property
    def _most(self) -> float:
        """Excess of the refitted rig [nats]."""
        return excess(self.experiment, self._baseline.residuals)

    @property
    def written(self) -> Rig:
        """The rig that what was learned is written into: without the loop that stands for a servo."""
        return self.given or self.rig

    def baseline(self) -> FitResult:
        return self._baseline

    def screen(self, fitted: FitResult, steps: Sequence[Step[FitResult]]) -> list[Candidate]:
        taken = {name for step in steps for name in step.trial.causes}
        names = [name for name in causes_of(fitted.model, self.experiment.silent) if name not in taken]
        cover = coverage_of(self.experiment, fitted.model, fitted.nuisance)
        return screen(self.experiment, fitted, names, cover._replace(orders=self._orders(fitted)))

    def _orders(self, fitted: FitResult) -> tuple[float, ...]:
        """Orders of the motor's turn at which the torque that a fit leaves has lines."""
        return tuple(
            line.at for line in lines_of(self.experiment, fitted) if line.gain > self.settings.margin
        )

    def trials(self, fitted: FitResult, candidates: Sequence[Candidate]) -> list[Trial[FitResult]]:
        rivals = shortlist(candidates, _PROMISING * dust(self.experiment, self._most), self.settings)
        begun = self._begun(fitted)
        if begun:  # no score of another equation promises as much
            first = begun[0][0].cause
            rivals = [c for c in rivals if c.cause.equation in OF_POSITION and c.cause is not first]
        found = [_trial(fitted, *pair) for pair in (*begun, *self._refitted(fitted, rivals))]
        if fitted is self._baseline and not begun and self._is_left(found):
            found += self._gross_trials(fitted, candidates, found)
        return sorted(found, key=lambda trial: -trial.nets[0])

    def _begun(self, fitted: FitResult) -> list[tuple[Candidate, FitResult]]:
        """The cause that the loop follows, fitted from there beside a fit without it, which has bent the constants."""
        if self.begun is None:
            return []
        candidate, model = self.begun
        extra, taken = free_of(candidate.variant), {f.name for f in fitted.free}
        if any(f.name in taken for f in extra):
            return []
        usual = {f.name for f in self._baseline.free}
        others = {name: fitted.model[name] for name in fitted.model.effects if name not in usual}
        near = override(model, model.name, **others)
        result = fit_or_none(self.experiment, near, (*fitted.free, *extra))
        return [] if result is None else [(candidate, result)]

    def _is_left(self, trials: Sequence[Trial[FitResult]]) -> bool:
        """Whether the best of some trials leaves a good part of the refit's misfit, or one that is still gross."""
        before = missed(self.experiment, self._baseline)
        left = min((missed(self.experiment, trial.fitted) for trial in trials), default=before)
        return left > min(_GROSS_LEFT * before, GROSS_NATS * self.sample_count)

    def _gross_trials(
        self, fitted: FitResult, candidates: Sequence[Candidate], others: Sequence[Trial[FitResult]]
    ) -> list[Trial[FitResult]]:
        """Where the refit fails by far: effects that are too large for a score beside it, from the rig as it was given.

        others: trials that these will have to come close to.
        """
        experiment, trials = self.experiment, []
        if missed(self.experiment, fitted) < GROSS_NATS * self.sample_count:
            return []
        cover = coverage_of(experiment, self.model, np.zeros_like(fitted.nuisance))
        scored = {(c.cause.name, c.variant.name): c for c in candidates}
        names = causes_of(self.model, experiment.silent)
        every = base_parameters(self.rig, self.model, experiment.older_s, experiment.silent)
        free = [f for f in every if f.name not in self.held]
        goal = min((self._close_to(trial.fitted) for trial in others), default=fitted.objective)
        for start, result in gross_fits(experiment, self.model, free, names, cover, goal):
            gain = fitted.objective - result.objective
            price = penalty(experiment, len(start.variant.terms), max(len(candidates), 1))
            known = scored.get(
                (start.cause.name, start.variant.name),
                Candidate(start.cause, start.variant, gain, gain - price, {}, {}),
            )
            trials.append(Trial((replace(known, variant=start.variant),), result, gain, (gain - price,)))
        return trials

    def _refitted(self, fitted: FitResult, rivals: Sequence[Candidate]) -> list[tuple[Candidate, FitResult]]:
        """Every rival refitted; one that stays behind its score, and might have won with it, is refitted exactly.

        A refit ends where it will neither come close to the best before it nor matter.
        """
        goal, best = fitted.objective - min(self._least), math.inf
        tried: list[tuple[Candidate, FitResult]] = []
        for c in rivals:
            result = refit(self.experiment, fitted, c, goal=goal)
            if result is None:
                continue
            tried.append((c, result))
            if result.objective < best:
                best = result.objective
                goal = min(goal, self._close_to(result))
        left = _EXACT
        for k, (c, r) in enumerate(tried):
            if left and fitted.objective - c.gain < min(best, r.objective - _BEHIND * c.gain):
                tried[k], left = (c, refit(self.experiment, fitted, c, True, goal) or r), left - 1
        return tried

    def _close_to(self, best: FitResult) -> float:
        """The objective above which no other fit is a rival of the best, whatever the two cost."""
        price = penalty(self.experiment, _DEAREST, 1)
        return best.objective + price + self._close(best)

    def _close(self, best: FitResult) -> float:
        """Nats by which a rival falls short of the best trial at most; behind a loop the usual imperfection may be as much."""
        close = self.settings.close * inflation(self.experiment, best.residuals)
        return max(close, imperfection(self.experiment)) if self.given is not None else close

    @property
    def _least(self) -> tuple[float, float]:
        """Nats that a cause must gain, in all or in the position alone."""
        return dust(self.experiment, self._most), position_dust(self.experiment, self._most)

    def judge(self, fitted: FitResult, trial: Trial[FitResult]) -> HeldOut | None:
        settings, price = self.settings, trial.gain - trial.nets[0]
        factor = inflation(self.experiment, trial.fitted.residuals)
        if trial.nets[0] < settings.margin or trial.gain / factor < price + settings.margin:
            return None
        if only_bends(self.experiment, trial) or is_no_scale(self.experiment, trial):
            return None
        if is_no_line(self.experiment, fitted, trial):
            return None
        if not matters(self.experiment, fitted, trial.fitted, self._least, settings):
            return None
        seen, held_out = self._gain(fitted, trial.fitted)
        if seen < settings.held_out * trial.gain or self._smooth_is_better(fitted, trial):
            return None
        return held_out

    def _gain(self, before: FitResult, after: FitResult) -> tuple[float, HeldOut]:
        """Nats by which held-out moves are better explained, and what is known of the rig better respected.

        Without a voltage the latter counts nothing: see `bent`.
        """
        r0, r1 = (held_out_residuals(self.experiment, one) for one in (before, after))
        respected = disregard(self.experiment, before) - disregard(self.experiment, after)
        seen = 0.5 * (sum_of_squares(r0) - sum_of_squares(r1)) + respected
        ratio = {
            f"{name}_{unit}": rms(r1[:, c]) / max(rms(r0[:, c]), 1e-300) for c, (name, unit) in self._channels
        }
        return seen, HeldOut(seen / self.sample_count, ratio)

    def _smooth_is_better(self, before: FitResult, trial: Trial[FitResult]) -> bool:
        return smooth_is_better(self.experiment, before, trial, lambda: self._second(trial), self.settings)

    def _second(self, trial: Trial[FitResult]) -> float:
        """Nats that another cause gains beside that of a trial: two offsets at once look like one smooth torque."""
        open_ = causes_of(trial.fitted.model, self.experiment.silent)
        names = [name for name in open_ if name not in trial.causes]
        cover = coverage_of(self.experiment, trial.fitted.model, trial.fitted.nuisance)
        found = self._refitted(trial.fitted, screen(self.experiment, trial.fitted, names, cover)[:_SECONDS])
        return max((trial.fitted.objective - result.objective for _, result in found), default=0.0)

    def rivals(
        self,
        fitted: FitResult,
        trial: Trial[FitResult],
        trials: Sequence[Trial[FitResult]],
        candidates: Sequence[Candidate],
    ) -> dict[str, tuple[str, ...]]:
        """Causes that fall short by too little, and aliases."""
        (best,), close = trial.candidates, self._close(trial.fitted)
        others = dict.fromkeys(best.cause.aliases)
        for other in trials:
            cause = other.candidates[0].cause
            if cause.name != best.cause.name and trial.nets[0] - other.nets[0] < close:
                others |= dict.fromkeys((cause.name, *cause.aliases))
        return {best.cause.name: tuple(others)}

    def settled(self, fitted: FitResult, trial: Trial[FitResult]) -> FitResult:
        near = trial.fitted
        return fit(self.experiment, near.model, near.free, near.nuisance, iterations=_SETTLED)

    def without(self, fitted: FitResult, candidates: Sequence[Candidate]) -> FitResult:
        return without(self.experiment, fitted, candidates[0].variant)

    def reconsidered(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """Without stops that explain nothing once the causes are named; without names that what they leave refutes."""
        ladder = self._believed(self._without_stops(ladder))
        rest = self.unexplained(ladder) if ladder.steps else ()
        if not rest:
            return ladder
        return unrefuted(
            self.experiment, ladder, rest, lambda f, step: self.without(f, step.trial.candidates)
        )

    def _believed(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """The ladder, or no name at all where its causes leave a gross part of the misfit: something larger is not known.

        Causes that fit what is not theirs leave it where they cannot follow, or bend what is known. Behind a loop that follows
        the motion right ones leave next to nothing.
        """
        left, before = missed(self.experiment, ladder.extended), missed(self.experiment, ladder.baseline)
        bends = bent(self.experiment, ladder.extended)
        share = (_GROSS_BENT if bends else _GROSS_LEFT) * before
        most = min(max(share, GROSS_NATS * self.sample_count), _HOPELESS_NATS * self.sample_count)
        if bends and self.given is not None:
            most = GROSS_NATS * self.sample_count
        if not ladder.steps or left < most:
            return ladder
        named = [pair for s in ladder.steps for pair in zip(s.trial.causes, s.trial.nets, strict=True)]
        return replace(ladder, extended=ladder.baseline, steps=(), path=(), refused=(*named, *ladder.refused))

    def _without_stops(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """Without the stops that were found, where the causes leave these nothing to explain."""
        if self.model == self.rig.model or self._stops_matter(ladder):
            return ladder
        return replace(self, model=self.rig.model).again(ladder)

    def again(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """The steps of a ladder that was found with other moves, or another model, with these; none that do not pay there."""
        steps, path = [], [self.baseline()]
        for step in ladder.steps:
            after = self._beside(path[-1], step.trial.candidates[0])
            if after is None:
                continue
            # A fit may have stopped short without the step.
            path[-1] = min(
                path[-1], self.without(after, step.trial.candidates), key=lambda fitted: fitted.objective
            )
            gain, price = path[-1].objective - after.objective, step.trial.gain - step.trial.nets[0]
            if gain <= price:
                continue
            trial = Trial(step.trial.candidates, after, gain, (gain - price,))
            steps.append(Step(trial, self._gain(path[-1], after)[1], step.rivals))
            path.append(after)
        return replace(ladder, baseline=path[0], extended=path[-1], steps=tuple(steps), path=tuple(path[1:]))

    def _beside(self, fitted: FitResult, candidate: Candidate) -> FitResult | None:
        """A fit with one more cause; from where the loop follows it, if it does."""
        for begun, result in self._begun(fitted):
            if begun.cause is candidate.cause:
                return result
        return refit(self.experiment, fitted, candidate, exact=True)

    def _stops_matter(self, ladder: Ladder[FitResult]) -> bool:
        """Whether the stops that were found still explain something once the causes are named.

        What they explained before may have been another cause: a lag of the current looks like a stop at the end of the travel.
        A stop that touches nothing would leave its place and depth to chance.
        """
        if any(CAUSES[name].equation == "contact" for step in ladder.steps for name in step.trial.causes):
            return True
        fitted, given = ladder.extended, self.rig.model
        stops = {name: given[name] for name in ("x_stop_high", "x_stop_low")}
        gone = {name for name, place in stops.items() if math.isinf(place)}
        gone |= {"C", "E"} if len(gone) == 2 else set()
        free = tuple(f for f in fitted.free if f.name not in gone)
        plain = fit(
            self.experiment, override(fitted.model, fitted.model.name, **stops), free, fitted.nuisance
        )
        return plain.objective - fitted.objective > STOP_NATS

    def measure(self, fitted: FitResult) -> Measure:
        seen = held_out_residuals(self.experiment, fitted)
        white = {f"{name}_{unit}": whiteness(fitted.residuals[:, c]) for c, (name, unit) in self._channels}
        floor = noise_floor(self.experiment)
        return Measure(nll_per_sample(self.experiment, seen), self._rmse(fitted, seen), white, floor)

    def _rmse(self, fitted: FitResult, held_out: Array) -> dict[str, float]:
        """Root mean square of the held-out residuals: current, position, and the speed of equation 16."""
        weight, error = self.experiment.weight, held_out * self.experiment.noise
        turning = speed(error, fitted.model.vector)
        both = (weight[:, :2] > 0.0).all(axis=1)
        return {
            "current_a": rms(error[weight[:, 1] > 0.0, 1]),
            "position_m": rms(error[weight[:, 2] > 0.0, 2]),
            "speed_rad_s": rms(turning[both]),
        }

    def values(self, fitted: FitResult) -> dict[str, tuple[float, float]]:
        std = fitted.std
        return {f.name: (fitted.model[f.name], std[f.name]) for f in fitted.free if not is_curve(f.name)}

    def doubt(self, fitted: FitResult, parameter: str, std: float) -> float:
        """A delay inside a sampled servo is known to half its period only (uniform), whatever the noise."""
        if parameter not in _SAMPLED:
            return _IMPERFECT * std
        half_a_period = math.hypot(fitted.model["servo_delay"], fitted.model["tick_phase"])
        return math.hypot(_IMPERFECT * std, half_a_period / math.sqrt(3.0))

    def tables(self, fitted: FitResult) -> Residuals:
        return residual_tables(self.experiment, fitted)

    def unexplained(self, ladder: Ladder[FitResult]) -> tuple[Smooth, ...]:
        return left_over(self.experiment, ladder, self.freed)

    def freed(self, baseline: FitResult) -> Freedom:
        return self._freedom if baseline is self._baseline else free_equations(self.experiment, baseline)

    @cached_property
    def _freedom(self) -> Freedom:
        """Which equations the data want to free from the refitted rig."""
        return free_equations(self.experiment, self._baseline)

    def kept(self, fitted: FitResult, left: Sequence[Smooth]) -> tuple[FitResult, Kept] | None:
        found = fit_kept_curve(self.experiment, fitted, left)
        return (found.fitted, found) if found else None

    def ended(self, beside: FitResult) -> Model:
        """The rig's model with the stops that these moves show beside what a fit has."""
        return with_stops(self.experiment, self.logs, self.rig, self.logged, beside)

    def extended_rig(self, ladder: Ladder[FitResult]) -> Rig:
        fitted = ladder.extended
        of_log = ("tick_share",)  # by how much this log's samples are older than the next one's nobody knows
        values = {name: value for name, (value, _) in self.values(fitted).items() if name not in of_log}
        fixed = {name: v for s in ladder.steps for c in s.trial.candidates for name, v in c.variant.fixed}
        return with_values(self.written, values | fixed, fitted.std, "improve")

    def excitations(self) -> tuple[Excitation, ...]:
        return tuple(excitation(log, log_segments(log), self.rig.model) for log in self.logs)


def simulated_moves(
    logs: Sequence[Log],
    rig: Rig,
    moves: Sequence[Sequence[Segment]] | None = None,
    settings: MoveSettings | None = None,
    filters: Sequence[Filter] = (),
) -> SimulatedMoves:
    """The problem of a rig with a motor. filters: that were taken out of the readings.

    Raises InvalidLogError where no log holds a move.
    """
    cut = [moves_from_rest(log) for log in logs] if moves is None else moves
    driven = rig if rig.driven.servo else with_usual_servo(logs, rig)
    experiment = replace(prepare(logs, driven, cut, share_of(cut, MOST_ROWS), filters), steps=_STEPS)
    settings = settings or MoveSettings()
    if not rig.driven.servo:
        late = sum(own.late for own in filters if own.channel == "current") / logs[0].rate_hz
        near, looped = tracked(experiment, rig, late)
        model = with_stops(near, logs, looped, experiment)
        return SimulatedMoves(tuple(logs), looped, near, model, settings, given=rig, logged=experiment)
    experiment = _with_timed_command(with_whole_command(experiment, logs, rig), logs, rig)
    model = with_stops(experiment, logs, rig)
    return SimulatedMoves(tuple(logs), rig, experiment, model, settings)


def _with_timed_command(experiment: Experiment, logs: Sequence[Log], rig: Rig) -> Experiment:
    """The experiment with its command's ramps where the motion shows them, where the samples of the command do not."""
    commands = doubtful(experiment, [is_recovered(log) for log in logs])
    free = base_parameters(rig, rig.model, experiment.older_s)
    return timed(experiment, commands, rig.model, free) if commands else experiment


def shortlist(candidates: Sequence[Candidate], least: float, settings: MoveSettings) -> list[Candidate]:
    """The best two variants of the best causes, of those whose score is not hopeless."""
    least = max([least, *(_HOPELESS * c.gain for c in candidates[:1])])
    chosen: list[Candidate] = []
    causes: dict[str, int] = {}
    for c in candidates:
        if c.gain <= least:
            break
        count = causes.get(c.cause.name, 0)
        if count >= 2 or (count == 0 and len(causes) >= settings.rivals):
            continue
        causes[c.cause.name] = count + 1
        chosen.append(c)
    return chosen


def _trial(fitted: FitResult, candidate: Candidate, result: FitResult) -> Trial[FitResult]:
    gain, price = fitted.objective - result.objective, candidate.gain - candidate.net
    return Trial((candidate,), result, gain, (gain - price,))


def rms(y: Array) -> float:
    """Root mean square, NaN of nothing."""
    return float(np.sqrt(np.mean(y**2))) if y.size else float("nan")
