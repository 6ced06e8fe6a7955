"""Naming what a simulation gets wrong: one cause at a time, each judged on moves that the fit never saw.

Score every variant (`screening`), refit the leading rivals together with everything else, accept the best one if it
pays for its parameters, explains a good part of what is left, and helps on held-out moves; then ask again.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer_fi.improve.screening import Candidate, reach_of, refit, screen
from observer_fi.improve.unexplained import smooth_terms
from observer_fi.learn import (
    Experiment,
    FitResult,
    Free,
    fit,
    inflation,
    objective,
    residuals,
    select,
    without_moves,
)
from observer_fi.numerics import square
from observer_fi.physics import CAUSES, PARAMETERS, Model, Rig, override
from observer_fi.records import Array

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
_BEHIND = 0.05  # of its score that a refit may miss
_DUST = 0.001
_DUST_NOISE = 0.07
_POSITION, _POSITION_DUST = 2, 0.05  # channel, and its share


@dataclass(frozen=True)
class NamingSettings:
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


@dataclass(frozen=True)
class Named:
    """One accepted cause: candidate, the nats it gained and the penalty it paid, its rivals, and the held-out gain.

    rivals: causes that these data cannot tell from it, with the nats they fall short.
    """

    candidate: Candidate
    gain: float
    penalty: float
    held_out: float
    rivals: dict[str, float]


@dataclass(frozen=True)
class Naming:
    """The baseline refit, the fit with every accepted cause, the causes in order, and the last round's refused ones."""

    experiment: Experiment
    baseline: FitResult
    extended: FitResult
    named: tuple[Named, ...]
    refused: tuple[tuple[str, float], ...]
    screened: tuple[Candidate, ...]


def base_parameters(rig: Rig, model: Model) -> tuple[Free, ...]:
    """What a refit may move without saying that something is missing."""
    names = dict(_PRIORS)
    free = []
    if math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"]):
        names |= _STOPS
    for name, relative in names.items():
        value = rig.model[name]
        free.append(Free(name, 1e-3 * value, 0.1 * value, 10.0 * value, value, relative * value))
    return (*free, *_stops(model), _SERVO_DELAY, _TICK_PHASE)


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


def excess(experiment: Experiment, r: Array) -> float:
    """Misfit over the noise [nats], less three standard deviations of what white noise alone shows; never negative."""
    n = int((experiment.weight > 0.0).sum())
    return max(0.5 * (square(r) - n) - 3.0 * math.sqrt(0.5 * n), 0.0)


def dust(experiment: Experiment, most: float) -> float:
    """Nats below which nothing is named or told: imperfections of larger causes, and of timing, look like that.

    0.1 % of the baseline's excess `most`, and a misfit of 7 % of the noise.
    """
    return max(_DUST * most, 0.5 * _DUST_NOISE**2 * int((experiment.weight > 0.0).sum()))


def position_dust(experiment: Experiment, most: float) -> float:
    """The same for a gain in the position alone, 5 % of its noise: the timing of a servo does not reach it [nats]."""
    return max(_DUST * most, 0.5 * _POSITION_DUST**2 * int((experiment.weight[:, _POSITION] > 0.0).sum()))


def held_out_residuals(experiment: Experiment, fitted: FitResult) -> Array:
    """(N, 3) residuals of every move under the parameters fitted without it.

    Current and position of its rest are the move's own: no other move can tell them, nor the phase of a shaft there.
    """
    still = np.zeros_like(fitted.nuisance)
    parts = []
    for m in range(experiment.moves):
        model = without_moves(fitted, [m])
        window = [m - 1, m] if m and model["backlash"] != 0.0 else [m]
        here = select(experiment, window)
        size = experiment.rows(m).stop - experiment.rows(m).start
        # At the edge of friction a rest may slip with one of the two, for a friction a little different.
        tried = [residuals(here, model, start[window])[-size:] for start in (fitted.nuisance, still)]
        parts.append(min(tried, key=square))
    return np.concatenate(parts)


def causes_of(experiment: Experiment, model: Model) -> tuple[str, ...]:
    """The causes that this experiment can speak about at all."""
    touched = math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"])
    return tuple(
        name for name, cause in CAUSES.items() if cause.variants and (touched or cause.equation != "contact")
    )


def penalty(experiment: Experiment, parameters: int, candidates: int) -> float:
    """Extended BIC of one more candidate [nats]: k (ln n / 2 + ln candidates)."""
    n = int((experiment.weight > 0.0).sum())
    return parameters * 0.5 * math.log(n) + math.log(candidates)


def name_causes(
    experiment: Experiment,
    rig: Rig,
    model: Model,
    settings: NamingSettings | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Naming:
    """Refit, then name one cause after the other until nothing pays."""
    settings = settings or NamingSettings()
    progress("refit of the rig")
    baseline = fit(experiment, model, base_parameters(rig, model))
    most = excess(experiment, baseline.residuals)
    fitted = baseline
    named: list[Named] = []
    refused: tuple[tuple[str, float], ...] = ()
    screened: tuple[Candidate, ...] = ()
    for _ in range(settings.rounds):
        progress(f"scores, {len(named)} named so far")
        step, refused, screened = _next(experiment, fitted, tuple(named), most, settings)
        if step is None:
            break
        named.append(step)
        fitted = refit(experiment, fitted, step.candidate, _reach(experiment, fitted), exact=True)
    if len(named) > 1:
        progress("does each cause still stand")
        fitted, named = _prune(experiment, fitted, named, most, settings)
    return Naming(experiment, baseline, fitted, tuple(named), refused, screened)


def name_again(experiment: Experiment, rig: Rig, model: Model, naming: Naming) -> Naming:
    """The same causes in the same order from another baseline, with the gains that they have there."""
    baseline = fitted = fit(experiment, model, base_parameters(rig, model))
    named = []
    for n in naming.named:
        after = refit(experiment, fitted, n.candidate, _reach(experiment, fitted), exact=True)
        gain, seen = fitted.objective - after.objective, _held_out_gain(experiment, fitted, after)
        named.append(replace(n, gain=gain, held_out=seen))
        fitted = after
    return replace(naming, baseline=baseline, extended=fitted, named=tuple(named))


def _reach(experiment: Experiment, fitted: FitResult) -> dict[str, float]:
    return reach_of(experiment, fitted.model, fitted.nuisance)


def _next(
    experiment: Experiment, fitted: FitResult, named: tuple[Named, ...], most: float, settings: NamingSettings
) -> tuple[Named | None, tuple[tuple[str, float], ...], tuple[Candidate, ...]]:
    reach = _reach(experiment, fitted)
    taken = {n.candidate.cause.name for n in named}
    causes = [name for name in causes_of(experiment, fitted.model) if name not in taken]
    candidates = screen(experiment, fitted, causes, reach)
    rivals = _shortlist(candidates, _PROMISING * dust(experiment, most), settings)
    tried = _refitted(experiment, fitted, rivals, reach)
    scored = sorted(
        ((fitted.objective - r.objective - _price(experiment, c, candidates), c, r) for c, r in tried),
        key=lambda item: -item[0],
    )
    refused = tuple((c.cause.name, net) for net, c, _ in scored)
    for net, candidate, result in scored:
        gain = fitted.objective - result.objective
        factor = inflation(experiment, result.residuals)
        if (
            net < settings.margin
            or gain / factor < _price(experiment, candidate, candidates) + settings.margin
        ):
            continue
        if not _matters(experiment, fitted, result, most, settings):
            continue
        seen = _held_out_gain(experiment, fitted, result)
        if seen < settings.held_out * gain:
            continue
        if _smooth_is_better(experiment, fitted, result, gain, settings):
            continue
        others = _indistinguishable(candidate, net, factor, scored, settings)
        return (
            Named(candidate, gain, _price(experiment, candidate, candidates), seen, others),
            refused,
            tuple(candidates),
        )
    return None, refused, tuple(candidates)


def _refitted(
    experiment: Experiment, fitted: FitResult, rivals: Sequence[Candidate], reach: dict[str, float]
) -> list[tuple[Candidate, FitResult]]:
    """Every rival refitted; one that stays behind its score, and might have won with it, is refitted exactly."""
    tried = [(c, refit(experiment, fitted, c, reach)) for c in rivals]
    best = min((r.objective for _, r in tried), default=math.inf)
    left = _EXACT
    for k, (c, r) in enumerate(tried):
        if left and fitted.objective - c.gain < min(best, r.objective - _BEHIND * c.gain):
            tried[k], left = (c, refit(experiment, fitted, c, reach, exact=True)), left - 1
    return tried


def _matters(
    experiment: Experiment, before: FitResult, after: FitResult, most: float, settings: NamingSettings
) -> bool:
    """Whether the gain is a good part of the misfit that is left, in all or in one channel, and not dust of the whole.

    most: the excess of the baseline [nats].
    """
    gain = before.objective - after.objective
    won = 0.5 * np.sum(before.residuals**2 - after.residuals**2, axis=0)
    if gain < dust(experiment, most) and min(gain, won[_POSITION]) < position_dust(experiment, most):
        return False
    if gain >= settings.share * excess(experiment, before.residuals):
        return True
    for c in range(3):
        left = channel_excess(experiment, before.residuals, c)
        if left > 0.0 and won[c] >= settings.channel_share * left:
            return True
    return False


def _smooth_is_better(
    experiment: Experiment, before: FitResult, after: FitResult, gain: float, settings: NamingSettings
) -> bool:
    """Whether one smooth term explains nearly all that is left where the named cause explains far less."""
    n = int((experiment.weight > 0.0).sum())
    left = 0.5 * (square(before.residuals) - n)
    if settings.smooth_factor * gain > 1.1 * left:
        return False
    best = smooth_terms(experiment, before, left)[0]
    more = best.held_out - gain
    return more > max(settings.smooth_nats, (settings.smooth_factor - 1.0) * gain) and (
        best.held_out > settings.smooth_share * left
    )


def channel_excess(experiment: Experiment, r: Array, channel: int) -> float:
    """`excess` of one channel [nats]."""
    n = int((experiment.weight[:, channel] > 0.0).sum())
    return max(0.5 * (float(np.sum(r[:, channel] ** 2)) - n) - 3.0 * math.sqrt(0.5 * n), 0.0)


def _price(experiment: Experiment, candidate: Candidate, candidates: Sequence[Candidate]) -> float:
    return penalty(experiment, len(candidate.variant.terms), max(len(candidates), 1))


def _shortlist(candidates: Sequence[Candidate], least: float, settings: NamingSettings) -> list[Candidate]:
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


def _held_out_gain(experiment: Experiment, before: FitResult, after: FitResult) -> float:
    """Nats by which held-out moves are better explained, and what is known of the rig better respected."""
    r0, r1 = held_out_residuals(experiment, before), held_out_residuals(experiment, after)
    prior = objective(before.model, before.free, np.zeros(1)) - objective(
        after.model, after.free, np.zeros(1)
    )
    return 0.5 * (square(r0) - square(r1)) + prior


def _indistinguishable(
    best: Candidate,
    net: float,
    factor: float,
    scored: Sequence[tuple[float, Candidate, FitResult]],
    settings: NamingSettings,
) -> dict[str, float]:
    """Causes that fall short by too little, or move the readings in the same direction, and aliases."""
    others = dict.fromkeys(best.cause.aliases, 0.0)
    for other_net, c, _ in scored:
        if c.cause.name == best.cause.name or c.cause.name in others:
            continue
        short = net - other_net
        if short < settings.close * factor:
            others[c.cause.name] = short
            others |= {alias: short for alias in c.cause.aliases if alias not in others}
    return others


def _prune(
    experiment: Experiment, fitted: FitResult, named: list[Named], most: float, settings: NamingSettings
) -> tuple[FitResult, list[Named]]:
    """Drop what lost its support after others entered; swap what another cause explains better by now."""
    for item in sorted(named, key=lambda n: n.gain):
        if len(named) < 2:
            break
        without = _without(experiment, fitted, item.candidate)
        rest = tuple(n for n in named if n is not item)
        step, _, _ = _next(experiment, without, rest, most, settings)
        if step is None:
            named, fitted = list(rest), without
        elif step.candidate.cause.name != item.candidate.cause.name:
            named = [step if n is item else n for n in named]
            fitted = refit(experiment, without, step.candidate, _reach(experiment, without), exact=True)
        else:
            named = [step if n is item else n for n in named]
    return fitted, named


def _without(experiment: Experiment, fitted: FitResult, candidate: Candidate) -> FitResult:
    """The fit with one cause taken out again."""
    terms = candidate.variant.terms
    names = {t.parameter for t in terms}
    neutral = {t.parameter: t.neutral for t in terms}
    neutral |= {name: PARAMETERS[name][1] or 0.0 for name, _ in candidate.variant.fixed}
    free = tuple(f for f in fitted.free if f.name not in names)
    return fit(experiment, override(fitted.model, fitted.model.name, **neutral), free, fitted.nuisance)
