"""The problem of a rig with a servo: its moves are simulated, and compared with the measured ones.

A cause adds parameters to the simulation; the fit is Gauss-Newton over all moves; held out is every move in turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from observer_fi.improve.freed.freed_equations import WANTED_NATS, FreedEquation
from observer_fi.improve.freed.smoothed_disturbance import SmoothedDisturbance, free_equations
from observer_fi.improve.gross_starts import gross_fits
from observer_fi.improve.keep_curve import Kept, fit_kept_curve
from observer_fi.improve.lines import order_lines
from observer_fi.improve.misfit import (
    POSITION,
    channel_excess,
    dust,
    excess,
    held_out_residuals,
    position_dust,
    raw_excess,
)
from observer_fi.improve.problem import Candidate, HeldOut, Ladder, Measure, Step, Trial
from observer_fi.improve.residual_tables import Residuals, residual_tables
from observer_fi.improve.screening import (
    Projector,
    coverage_of,
    penalty,
    refit,
    screen,
    without,
)
from observer_fi.improve.unexplained import Smooth, nameless, rest_steps, slow_excess, smooth_terms
from observer_fi.learn import (
    Experiment,
    FitResult,
    Free,
    doubtful,
    find_stops,
    fit,
    inflation,
    linearised,
    nll_per_sample,
    noise_floor,
    objective,
    prepare,
    run,
    share_of,
    stops_of_travel,
    timed,
    whiteness,
)
from observer_fi.logs import Excitation, excitation, is_recovered, log_segments, moves_from_rest
from observer_fi.numerics import sum_of_squares
from observer_fi.physics import CAUSES, MOVES, Model, Rig, is_curve, override, speed, with_values
from observer_fi.records import Array, Filter, Log, Segment

# Relative prior of what a servo rig gives: maker's data tight, the rest as wide as rigs differ.
_PRIORS = {
    "Vmax": 0.1, "Kp": 0.5, "Ki": 0.5, "J": 0.5, "A": 0.5, "B": 0.5, "Rs": 2.0,
    "Rm": 5e-4, "Km": 5e-4, "D": 2e-4,
}  # fmt: skip
_SERVO_DELAY = Free("servo_delay", 1e-5, 0.0, 1e-4, 0.0, 1e-4)  # half the period of a servo of 5 kHz or more
# Between the servo's ticks and the logger's samples lies a time of either sign, within a period of that servo.
_TICK_PHASE = Free("tick_phase", 1e-5, -1e-4, 1e-4, 0.0, 3e-5)
_STOPS = {"C": 1.0, "E": 0.2}
# A score is taken before a candidate's shape is fitted: shares of the dust, and of the best score, below which it is
# not worth a refit.
_PROMISING, _HOPELESS = 0.1, 0.03
_EXACT = 2  # refits of a round that may be done anew, exactly
_SECONDS = 2  # causes that are tried beside a first one, where a smooth term explains more than that
_BEHIND = 0.05  # of its score that a refit may miss
MOST_ROWS = 120_000  # samples of moves that are fitted at once: a fit is held for every cause that is tried
_STEPS = 8  # of the integration in a transient: with two, A and Kp are four standard errors off
_SETTLED = 30  # iterations in which an accepted trial is fitted exactly
_STOP_NATS = 100.0  # that stops must gain in the refit
# On development seeds 4200, 4300 and 4400 of the independent truth formal errors of sizes scatter by 1.2.
_IMPERFECT = 1.25
_SAMPLED = ("current_lag", "input_delay", "voltage_delay")
_SENSORS = ("sensor:voltage", "sensor:current", "sensor:position")
_UNEXPLAINED_SHARE = 0.2  # of the excess misfit that a smooth term must carry to be told
_STEP_NATS = 20.0  # that a drift or tilt of the position sensor must gain in the steps between moves
_SLOW_SHARE = 0.5  # of the dust that must be left in means over some ms before smooth terms are tried
_BELOW = 0.02  # nats a reading below the noise, from which a freed equation follows the noise
_CLEARLY = 2.0  # times the dust: what a freed equation must gain to be told without a name
_MAKERS = {"Rm": "electrical", "Km": "electrical", "D": "kinematics"}  # the equations that data sheets hold
_TOO_FAR = 5.0  # standard deviations of their priors
_GROSS_NATS = 1.0  # a sample that the refit misses by, from which on gross effects are tried
_HOPELESS_NATS = (
    10.0  # a sample, that no right model leaves, whatever it explains: a loop that rings has been lost
)
_GROSS_LEFT = 0.1  # of the refit's misfit, that the best other trial leaves
_GROSS_BENT = 0.01  # the same of names, where they bend what data sheets hold
_AS_GOOD = 0.9  # a second regressor is told where it explains this much of what the first does


@dataclass(frozen=True)
class MoveSettings:
    """What it takes to name a cause.

    share: of the excess misfit (over the noise) that a cause must explain, or channel_share of it in one channel. held_out:
    share of the gain that must be seen on held-out moves. close: nats, per unit of the residuals' inflation, within
    which a rival cannot be told apart. rivals: how many are refitted in a round. margin: nats over the penalty. A cause
    is refused where one smooth term gains smooth_factor times as much, smooth_nats more, and smooth_share of all: the
    truth is then outside the vocabulary.
    """

    share: float = 0.25
    channel_share: float = 0.5
    held_out: float = 0.3
    close: float = 6.0
    rivals: int = 6
    rounds: int = 6
    margin: float = 10.0
    smooth_factor: float = 1.15
    smooth_share: float = 0.6
    smooth_nats: float = 40.0


UNITS = (("voltage", "v"), ("current", "a"), ("position", "m"))


# --- the rig refitted ------------------------------------------------------------------------------


def base_parameters(rig: Rig, model: Model, older_s: float = 0.0) -> tuple[Free, ...]:
    """What a refit may move without saying that something is missing. older_s: see `Experiment`."""
    names = dict(_PRIORS)
    free = []
    if math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"]):
        names |= _STOPS
    for name, relative in names.items():
        value = rig.model[name]
        relative = max(relative, rig.spread(name))
        free.append(Free(name, 1e-3 * value, 0.1 * value, 10.0 * value, value, relative * value))
    return (*free, *_stops(model), _SERVO_DELAY, _tick_phase(older_s))


def _tick_phase(older_s: float) -> Free:
    """Readings that a converter holds are as old as it is ahead of the logger, up to `older_s`."""
    usual = _TICK_PHASE
    std = math.hypot(usual.prior_std, older_s / math.sqrt(12.0))
    return usual._replace(high=usual.high + older_s, prior=usual.prior + 0.5 * older_s, prior_std=std)


def _stops(model: Model) -> tuple[Free, ...]:
    """Where the rails end. Two stops keep half of their distance: with a wrong law of contact they would change places."""
    low, high = model["x_stop_low"], model["x_stop_high"]
    apart = 0.25 * (high - low)
    free = []
    if math.isfinite(high):
        free.append(Free("x_stop_high", 2e-6, max(high - apart, -1.0), 1.0, high, 1e-2))
    if math.isfinite(low):
        free.append(Free("x_stop_low", 2e-6, -1.0, min(low + apart, 1.0), low, 1e-2))
    return tuple(free)


def with_stops(experiment: Experiment, logs: Sequence[Log], rig: Rig) -> Model:
    """The rig's model with the stops that the current or the travel shows, where a refit is better for them.

    A torque offset is free in that refit: it looks like a stop at the end of the travel.
    """
    shown = find_stops(experiment, rig)
    seen = stops_of_travel(experiment, logs, shown)
    models = list(dict.fromkeys([rig.model, shown, override(shown, shown.name, **seen)]))
    if len(models) == 1:
        return rig.model
    offset = Free("torque_offset", 1e-6)
    fits = [fit(experiment, m, (*base_parameters(rig, m, experiment.older_s), offset)) for m in models]
    return models[int(np.argmin([f.objective + _STOP_NATS * k for k, f in enumerate(fits)]))]


def causes_of(model: Model) -> tuple[str, ...]:
    """The causes that moves of this model can speak about at all."""
    touched = math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"])
    return tuple(name for name, cause in CAUSES.items() if touched or cause.equation != "contact")


# --- the problem -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class SimulatedMoves:
    """Moves of the logs of one rig, simulated with a model: the rig's, with the stops that the logs show."""

    logs: tuple[Log, ...]
    rig: Rig
    experiment: Experiment
    model: Model
    settings: MoveSettings = field(default_factory=MoveSettings)
    seen_by: str = MOVES

    @property
    def rounds(self) -> int:
        return self.settings.rounds

    @property
    def parts(self) -> str:
        return f"{self.experiment.moves} moves"

    @property
    def sample_count(self) -> int:
        return max(int((self.experiment.weight > 0.0).any(axis=1).sum()), 1)

    @cached_property
    def _baseline(self) -> FitResult:
        free = base_parameters(self.rig, self.model, self.experiment.older_s)
        return fit(self.experiment, self.model, free)

    @property
    def _sees_voltage(self) -> bool:
        return bool((self.experiment.weight[:, 0] > 0.0).any())

    @cached_property
    def _most(self) -> float:
        """Excess of the refitted rig [nats]."""
        return excess(self.experiment, self._baseline.residuals)

    def baseline(self) -> FitResult:
        return self._baseline

    def screen(self, fitted: FitResult, steps: Sequence[Step[FitResult]]) -> list[Candidate]:
        taken = {name for step in steps for name in step.trial.causes}
        names = [name for name in causes_of(fitted.model) if name not in taken]
        cover = coverage_of(self.experiment, fitted.model, fitted.nuisance)
        return screen(self.experiment, fitted, names, cover._replace(orders=self._orders(fitted)))

    def _orders(self, fitted: FitResult) -> tuple[float, ...]:
        """Orders of the motor's turn at which the torque that a fit leaves has lines."""
        experiment = self.experiment
        states, _ = run(experiment, fitted.model, fitted.nuisance)
        linear = linearised(experiment, fitted.model, states)
        lines = order_lines(experiment, Projector(experiment, fitted), linear, states)
        return tuple(line.at for line in lines if line.gain > self.settings.margin)

    def trials(self, fitted: FitResult, candidates: Sequence[Candidate]) -> list[Trial[FitResult]]:
        rivals, found = (
            shortlist(candidates, _PROMISING * dust(self.experiment, self._most), self.settings),
            [],
        )
        for candidate, result in self._refitted(fitted, rivals):
            gain = fitted.objective - result.objective
            price = candidate.gain - candidate.net
            found.append(Trial((candidate,), result, gain, (gain - price,)))
        if fitted is self._baseline and self._is_left(found):
            found += self._gross_trials(fitted, candidates)
        return sorted(found, key=lambda trial: -trial.nets[0])

    def _is_left(self, trials: Sequence[Trial[FitResult]]) -> bool:
        """Whether the best of some trials leaves a good part of the refit's misfit, or one that is still gross."""
        missed = self._missed(self._baseline)
        left = min((self._missed(trial.fitted) for trial in trials), default=missed)
        return left > min(_GROSS_LEFT * missed, _GROSS_NATS * self.sample_count)

    def _gross_trials(self, fitted: FitResult, candidates: Sequence[Candidate]) -> list[Trial[FitResult]]:
        """Where the refit fails by far: effects that are too large for a score beside it, from the rig as it was given."""
        experiment, trials = self.experiment, []
        if self._missed(fitted) < _GROSS_NATS * self.sample_count:
            return []
        cover = coverage_of(experiment, self.model, np.zeros_like(fitted.nuisance))
        scored = {(c.cause.name, c.variant.name): c for c in candidates}
        names = causes_of(self.model)
        free = base_parameters(self.rig, self.model, experiment.older_s)
        for start, result in gross_fits(experiment, self.model, free, names, cover):
            gain = fitted.objective - result.objective
            price = penalty(experiment, len(start.variant.terms), max(len(candidates), 1))
            known = scored.get(
                (start.cause.name, start.variant.name),
                Candidate(start.cause, start.variant, gain, gain - price, {}, {}),
            )
            trials.append(Trial((replace(known, variant=start.variant),), result, gain, (gain - price,)))
        return trials

    def _refitted(self, fitted: FitResult, rivals: Sequence[Candidate]) -> list[tuple[Candidate, FitResult]]:
        """Every rival refitted; one that stays behind its score, and might have won with it, is refitted exactly."""
        tried = [(c, refit(self.experiment, fitted, c)) for c in rivals]
        best = min((r.objective for _, r in tried), default=math.inf)
        left = _EXACT
        for k, (c, r) in enumerate(tried):
            if left and fitted.objective - c.gain < min(best, r.objective - _BEHIND * c.gain):
                tried[k], left = (c, refit(self.experiment, fitted, c, exact=True)), left - 1
        return tried

    def judge(self, fitted: FitResult, trial: Trial[FitResult]) -> HeldOut | None:
        settings, price = self.settings, trial.gain - trial.nets[0]
        factor = inflation(self.experiment, trial.fitted.residuals)
        if trial.nets[0] < settings.margin or trial.gain / factor < price + settings.margin:
            return None
        if not self._matters(fitted, trial.fitted):
            return None
        seen, held_out = self._gain(fitted, trial.fitted)
        if seen < settings.held_out * trial.gain or self._smooth_is_better(fitted, trial):
            return None
        return held_out

    def _gain(self, before: FitResult, after: FitResult) -> tuple[float, HeldOut]:
        """Nats by which held-out moves are better explained, and what is known of the rig better respected.

        Without a voltage the latter counts nothing: see `_bent`.
        """
        r0, r1 = (held_out_residuals(self.experiment, one) for one in (before, after))
        respected = self._disregard(before) - self._disregard(after)
        seen = 0.5 * (sum_of_squares(r0) - sum_of_squares(r1)) + respected
        ratio = {
            f"{name}_{unit}": rms(r1[:, c]) / max(rms(r0[:, c]), 1e-300)
            for c, (name, unit) in enumerate(UNITS)
        }
        return seen, HeldOut(seen / self.sample_count, ratio)

    def _disregard(self, fitted: FitResult) -> float:
        """Nats by which a fit leaves what is known of the rig; nothing without a voltage: see `_bent`."""
        return objective(fitted.model, fitted.free, np.zeros(1)) if self._sees_voltage else 0.0

    def _missed(self, fitted: FitResult) -> float:
        """Nats that a fit misses by, in the readings and in what is known of the rig."""
        return excess(self.experiment, fitted.residuals) + self._disregard(fitted)

    def _matters(self, before: FitResult, after: FitResult) -> bool:
        """Whether the gain is a good part of the misfit that is left, in all or in one channel, and not dust of the whole."""
        experiment, settings = self.experiment, self.settings
        gain = before.objective - after.objective
        won = 0.5 * np.sum(before.residuals**2 - after.residuals**2, axis=0)
        least = dust(experiment, self._most), position_dust(experiment, self._most)
        if gain < least[0] and min(gain, won[POSITION]) < least[1]:
            return False
        if gain >= settings.share * excess(experiment, before.residuals):
            return True
        for c in range(3):
            left = channel_excess(experiment, before.residuals, c)
            if left > 0.0 and won[c] >= settings.channel_share * left:
                return True
        return False

    def _smooth_is_better(self, before: FitResult, trial: Trial[FitResult]) -> bool:
        """Whether one smooth term explains nearly all that is left where the cause, or it and a second one, explain far less."""
        settings, left, gain = self.settings, raw_excess(self.experiment, before.residuals), trial.gain
        if settings.smooth_factor * gain > 1.1 * left:
            return False
        best = smooth_terms(self.experiment, before, left)[0]
        more = best.held_out - gain
        if more <= max(settings.smooth_nats, (settings.smooth_factor - 1.0) * gain):
            return False
        return best.held_out > settings.smooth_share * left and gain + self._second(trial) < best.held_out

    def _second(self, trial: Trial[FitResult]) -> float:
        """Nats that another cause gains beside that of a trial: two offsets at once look like one smooth torque."""
        names = [name for name in causes_of(trial.fitted.model) if name not in trial.causes]
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
        (best,), close = (
            trial.candidates,
            self.settings.close * inflation(self.experiment, trial.fitted.residuals),
        )
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
        """Without stops that explain nothing once the causes are named; without any name where the misfit is still gross."""
        return self._believed(self._without_stops(ladder))

    def _believed(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """The ladder, or no name at all where its causes leave a gross part of the misfit: something larger is not known.

        Causes that fit what is not theirs leave it where they cannot follow, or bend what is known.
        """
        left, before = self._missed(ladder.extended), self._missed(ladder.baseline)
        share = (_GROSS_BENT if self._bent(ladder.extended) else _GROSS_LEFT) * before
        most = min(max(share, _GROSS_NATS * self.sample_count), _HOPELESS_NATS * self.sample_count)
        if not ladder.steps or left < most:
            return ladder
        named = [pair for s in ladder.steps for pair in zip(s.trial.causes, s.trial.nets, strict=True)]
        return replace(ladder, extended=ladder.baseline, steps=(), path=(), refused=(*named, *ladder.refused))

    def _without_stops(self, ladder: Ladder[FitResult]) -> Ladder[FitResult]:
        """Without the stops that were found, where the causes leave these nothing to explain."""
        if self.model == self.rig.model or self._stops_matter(ladder):
            return ladder
        plain = replace(self, model=self.rig.model)
        fitted = plain.baseline()
        steps, path = [], []
        for step in ladder.steps:
            after = refit(self.experiment, fitted, step.trial.candidates[0], exact=True)
            gain, price = fitted.objective - after.objective, step.trial.gain - step.trial.nets[0]
            trial = Trial(step.trial.candidates, after, gain, (gain - price,))
            steps.append(Step(trial, plain._gain(fitted, after)[1], step.rivals))
            path.append(fitted := after)
        return replace(
            ladder, baseline=plain.baseline(), extended=fitted, steps=tuple(steps), path=tuple(path)
        )

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
        return plain.objective - fitted.objective > _STOP_NATS

    def measure(self, fitted: FitResult) -> Measure:
        seen = held_out_residuals(self.experiment, fitted)
        white = {f"{name}_{unit}": whiteness(fitted.residuals[:, c]) for c, (name, unit) in enumerate(UNITS)}
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
        """The smooth terms that the extended model still asks for, the best first; else what it leaves without a name."""
        return self._smooth_rest(ladder) or self._without_a_name(ladder)

    def _without_a_name(self, ladder: Ladder[FitResult]) -> tuple[Smooth, ...]:
        """The equation that the data still want free, though nothing known goes with it; and what a refit bent too far."""
        experiment, fitted = self.experiment, ladder.extended
        most = excess(experiment, ladder.baseline.residuals) if ladder.steps else 0.0
        least = max(WANTED_NATS, _CLEARLY * dust(experiment, most))
        whole = raw_excess(experiment, fitted.residuals)
        below = whole < -_BELOW * int(
            (experiment.weight > 0.0).sum()
        )  # noise of the logger that is not white
        if not below and slow_excess(experiment, fitted.residuals) > _SLOW_SHARE * least:
            freed = [row for row in free_equations(experiment, fitted)[0] if row.gain >= least]
            if freed:
                return (nameless(freed[0].equation, freed[0].gain, whole),)
        return tuple(nameless(equation, 0.0, 0.0) for equation in self._bent(fitted))

    def _bent(self, fitted: FitResult) -> tuple[str, ...]:
        """Equations whose constants of the data sheet a refit moved by more than their makers ever do.

        Without a voltage those of the winding come from when the supply limits, which a servo's ticks blur.
        """
        far = [
            f.name
            for f in fitted.free
            if f.name in _MAKERS and abs(fitted.model[f.name] - f.prior) > _TOO_FAR * f.prior_std
        ]
        blind = set() if self._sees_voltage else {"electrical"}
        return tuple(dict.fromkeys(_MAKERS[name] for name in far if _MAKERS[name] not in blind))

    def _smooth_rest(self, ladder: Ladder[FitResult]) -> tuple[Smooth, ...]:
        """The smooth terms that the extended model still asks for, the best first."""
        experiment, r = self.experiment, ladder.extended.residuals
        n = int((experiment.weight > 0.0).sum())
        whole = max(raw_excess(experiment, r), *(raw_excess(experiment, r, c) for c in range(3)))
        least = dust(experiment, excess(experiment, ladder.baseline.residuals))
        slow = slow_excess(experiment, r) > _SLOW_SHARE * least
        terms = smooth_terms(experiment, ladder.extended, whole) if slow else []
        steps = rest_steps(experiment, ladder.extended)  # their share is that of the steps themselves
        terms = sorted([*terms, *steps], key=lambda term: -term.held_out)
        if not terms:
            return ()
        best = terms[0]
        of_steps = any(best is term for term in steps)
        floor = _STEP_NATS if of_steps else least
        price = 0.0 if of_steps else 0.5 * best.coefficients * math.log(n)
        if best.held_out < floor or best.gain < floor + price:
            return ()
        told: dict[tuple[str, str], Smooth] = {}
        for term in terms:
            share = term.share if any(term is step for step in steps) else self._share(r, term, whole)
            if share >= _UNEXPLAINED_SHARE and term.held_out >= _AS_GOOD * best.held_out:
                told.setdefault((term.equation, term.regressor), replace(term, share=share))
        return tuple(told.values())

    def _share(self, r: Array, term: Smooth, whole: float) -> float:
        """Share of the residual's excess variance, of its own channel for a sensor, that the term explains."""
        if term.equation in _SENSORS:
            whole = raw_excess(self.experiment, r, _SENSORS.index(term.equation))
        return min(term.held_out / max(whole, term.gain, 1e-300), 1.0)

    def freed(self, baseline: FitResult) -> tuple[tuple[FreedEquation, ...], tuple[SmoothedDisturbance, ...]]:
        return free_equations(self.experiment, baseline)

    def kept(self, fitted: FitResult, left: Sequence[Smooth]) -> tuple[FitResult, Kept] | None:
        found = fit_kept_curve(self.experiment, fitted, left)
        return (found.fitted, found) if found else None

    def extended_rig(self, ladder: Ladder[FitResult]) -> Rig:
        fitted = ladder.extended
        values = {name: value for name, (value, _) in self.values(fitted).items()}
        fixed = {name: v for s in ladder.steps for c in s.trial.candidates for name, v in c.variant.fixed}
        return with_values(self.rig, values | fixed, fitted.std, "improve")

    def excitations(self) -> tuple[Excitation, ...]:
        return tuple(excitation(log, log_segments(log), self.rig.model) for log in self.logs)


def simulated_moves(
    logs: Sequence[Log],
    rig: Rig,
    moves: Sequence[Sequence[Segment]] | None = None,
    settings: MoveSettings | None = None,
    filters: Sequence[Filter] = (),
) -> SimulatedMoves:
    """The problem of a rig with a servo. filters: that were taken out of the readings.

    Raises InvalidLogError where no log holds a move.
    """
    cut = [moves_from_rest(log) for log in logs] if moves is None else moves
    experiment = replace(prepare(logs, rig, cut, share_of(cut, MOST_ROWS), filters), steps=_STEPS)
    experiment = _with_timed_command(experiment, logs, rig)
    model = with_stops(experiment, logs, rig)
    return SimulatedMoves(tuple(logs), rig, experiment, model, settings or MoveSettings())


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


def rms(y: Array) -> float:
    """Root mean square, NaN of nothing."""
    return float(np.sqrt(np.mean(y**2))) if y.size else float("nan")
