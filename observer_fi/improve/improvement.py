"""Improve: what the simulation gets wrong, its name, the extended model, and what it gains on moves never fitted."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.improve.freed_equations import FreedEquation
from observer_fi.improve.keep_curve import Kept, keep
from observer_fi.improve.ladder import (
    Named,
    Naming,
    NamingSettings,
    base_parameters,
    dust,
    excess,
    held_out_residuals,
    name_again,
    name_causes,
)
from observer_fi.improve.residual_tables import Residuals, residual_tables
from observer_fi.improve.smoothed_disturbance import Latent, free_equations
from observer_fi.improve.unexplained import Smooth, rest_steps, slow_excess, smooth_terms
from observer_fi.learn import (
    Experiment,
    FitResult,
    Free,
    find_stops,
    fit,
    nll_per_sample,
    prepare,
    stops_of_travel,
    whiteness,
)
from observer_fi.numerics import square
from observer_fi.physics import (
    CAUSES,
    PARAMETERS,
    Model,
    Rig,
    is_curve,
    override,
    speed,
    to_table,
    with_curve,
    with_values,
)
from observer_fi.records import Array, Log, Segment

SCHEMA = "observer-fi/improve/1"
CHANNELS = ("voltage_v", "current_a", "position_m")
_SENSORS = ("sensor:voltage", "sensor:current", "sensor:position")
# On development seeds 4200, 4300 and 4400 of the independent truth formal errors of sizes scatter by 1.2.
_IMPERFECT = 1.25
_SAMPLED = ("current_lag", "input_delay", "voltage_delay")
_STOP_NATS = 100.0  # that stops must gain in the refit
_STEPS = 8  # of the integration in a transient: with two, A and Kp are four standard errors off
_UNEXPLAINED_SHARE = 0.2  # of the excess misfit that a smooth term must carry to be told
_STEP_NATS = 20.0  # that a drift or tilt of the position sensor must gain in the steps between moves
_SLOW_SHARE = (
    0.5  # of the dust that must be left in means over some milliseconds before smooth terms are tried
)
_AS_GOOD = 0.9  # a second regressor is told where it explains this much of what the first does


@dataclass(frozen=True)
class Measure:
    """How well a model explains moves it was not fitted to. rmse: A, m, rad/s. whiteness_p: per channel."""

    nll_per_sample: float
    rmse: dict[str, float]
    whiteness_p: dict[str, float]


@dataclass(frozen=True)
class Value:
    """One parameter: value, standard error, what it was before, unit."""

    value: float
    std: float
    prior: float
    unit: str


@dataclass(frozen=True)
class FoundCause:
    """One finding of contract section 4, with the cause's formula and its variant in words."""

    cause: str
    equation: str
    variant: str
    formula: str
    parameters: dict[str, Value]
    delta_bic: float
    heldout_nll_drop_per_sample: float
    heldout_rmse_ratio: dict[str, float]
    indistinguishable_from: tuple[str, ...]
    separate_by: str


@dataclass(frozen=True)
class Improvement:
    """Everything that a report on `improve` needs.

    kept: the curve that stands for what is unexplained in the extended rig, if it was asked for (keep_unexplained) and helps.
    detectable: for each cause the smallest size that this log could have shown (five standard errors), by parameter,
    or None where it cannot speak about the cause. refused: causes that were tried last, with their net nats. freed: for each
    equation of the refitted rig how much the data want it free, the most wanted first; latents: what that looks like.
    """

    rig: Rig
    extended_rig: Rig
    experiment: Experiment
    naming: Naming
    baseline: Measure
    extended: Measure
    refit: dict[str, Value]
    findings: tuple[FoundCause, ...]
    unexplained: tuple[Smooth, ...]
    keep_unexplained: bool
    kept: Kept | None
    detectable: dict[str, dict[str, float] | None]
    refused: tuple[tuple[str, float], ...]
    before: Residuals
    after: Residuals
    freed: tuple[FreedEquation, ...]
    latents: tuple[Latent, ...]


def improve(
    logs: Sequence[Log],
    rig: Rig,
    moves: Sequence[Sequence[Segment]] | None = None,
    settings: NamingSettings | None = None,
    progress: Callable[[str], None] = lambda text: None,
    keep_unexplained: bool = False,
) -> Improvement:
    """The whole of `improve` for logs of one rig. Raises UsageError for a rig that is not driven by its servo.

    keep_unexplained: what no cause explains becomes an empirical curve of the extended rig, where it can.
    """
    if rig.drive != "pi_servo":
        raise UsageError(f"improve needs a rig with drive 'pi_servo', {rig.name} has {rig.drive!r}")
    experiment = replace(prepare(logs, rig, moves), steps=_STEPS)
    naming = _named(experiment, logs, rig, settings, progress)
    progress("which equation the data want to free")
    freed, latents = free_equations(experiment, naming.baseline)
    progress("what stays unexplained")
    before = held_out_residuals(experiment, naming.baseline)
    left = _unexplained(experiment, naming)
    kept = keep(experiment, naming.extended, left) if keep_unexplained else None
    if kept:
        naming = replace(naming, extended=kept.fitted)
    after = held_out_residuals(experiment, naming.extended) if naming.named or kept else before
    base, extended = (
        _measure(experiment, naming.baseline, before),
        _measure(experiment, naming.extended, after),
    )
    return Improvement(
        rig,
        _extended(rig, naming, kept),
        experiment,
        naming,
        base,
        extended,
        _refit(rig, naming),
        tuple(_finding(experiment, rig, naming, named, before, after) for named in naming.named),
        left,
        keep_unexplained,
        kept,
        _detectable(naming),
        naming.refused,
        residual_tables(experiment, naming.baseline),
        residual_tables(experiment, naming.extended),
        freed,
        latents,
    )


def _named(
    experiment: Experiment,
    logs: Sequence[Log],
    rig: Rig,
    settings: NamingSettings | None,
    progress: Callable[[str], None],
) -> Naming:
    """The causes beside the stops that the logs show, or without these where the causes leave them nothing to explain."""
    model = _with_stops(experiment, logs, rig)
    naming = name_causes(experiment, rig, model, settings, progress)
    if model == rig.model or _stops_matter(experiment, rig.model, naming):
        return naming
    progress("without the stops, which what was named explains")
    return name_again(experiment, rig, rig.model, naming)


def _extended(rig: Rig, naming: Naming, kept: Kept | None) -> Rig:
    """The rig with everything that was fitted."""
    values = {f.name: naming.extended.model[f.name] for f in naming.extended.free if not is_curve(f.name)}
    values |= {name: v for n in naming.named for name, v in n.candidate.variant.fixed}
    extended = with_values(rig, values, naming.extended.std, "improve")
    return with_curve(extended, kept.curve) if kept else extended


def refitted(logs: Sequence[Log], rig: Rig) -> tuple[Experiment, FitResult]:
    """The moves of logs, and the refitted rig before any cause is tried."""
    experiment = replace(prepare(logs, rig), steps=_STEPS)
    model = _with_stops(experiment, logs, rig)
    return experiment, fit(experiment, model, base_parameters(rig, model))


def _with_stops(experiment: Experiment, logs: Sequence[Log], rig: Rig) -> Model:
    """The rig's model with the stops that the current or the travel shows, where a refit is better for them.

    A torque offset is free in that refit: it looks like a stop at the end of the travel.
    """
    shown = find_stops(experiment, rig)
    seen = stops_of_travel(experiment, logs, shown)
    models = list(dict.fromkeys([rig.model, shown, override(shown, shown.name, **seen)]))
    if len(models) == 1:
        return rig.model
    offset = Free("torque_offset", 1e-6)
    fits = [fit(experiment, m, (*base_parameters(rig, m), offset)) for m in models]
    return models[int(np.argmin([f.objective + _STOP_NATS * k for k, f in enumerate(fits)]))]


def _stops_matter(experiment: Experiment, given: Model, naming: Naming) -> bool:
    """Whether the stops that were found still explain something once the causes are named.

    What they explained before may have been another cause: a lag of the current looks like a stop at the end of the travel.
    A stop that touches nothing would leave its place and depth to chance.
    """
    if any(n.candidate.cause.equation == "contact" for n in naming.named):
        return True
    fitted = naming.extended
    stops = {name: given[name] for name in ("x_stop_high", "x_stop_low")}
    gone = {name for name, place in stops.items() if math.isinf(place)}
    gone |= {"C", "E"} if len(gone) == 2 else set()
    free = tuple(f for f in fitted.free if f.name not in gone)
    without = fit(experiment, override(fitted.model, fitted.model.name, **stops), free, fitted.nuisance)
    return without.objective - fitted.objective > _STOP_NATS


def to_json(record: Improvement) -> dict[str, Any]:
    """Contract section 4."""
    return {
        "schema": SCHEMA,
        "baseline": _measure_json(record.baseline),
        "refit": {name: _value_json(v) for name, v in record.refit.items()},
        "findings": [
            {
                "cause": f.cause,
                "equation": f.equation,
                "parameters": {
                    n: {"value": v.value, "std": v.std, "unit": v.unit} for n, v in f.parameters.items()
                },
                "evidence": {"delta_bic": f.delta_bic},
                "gain": {
                    "heldout_nll_drop_per_sample": f.heldout_nll_drop_per_sample,
                    "heldout_rmse_ratio": f.heldout_rmse_ratio,
                },
                "indistinguishable_from": list(f.indistinguishable_from),
                "separate_by": f.separate_by,
            }
            for f in record.findings
        ],
        "unexplained": [
            {"equation": u.equation, "regressor": u.regressor, "share_of_residual_variance": u.share}
            for u in record.unexplained
        ],
        "extended": _measure_json(record.extended),
        "freed": [asdict(row) for row in record.freed],
    } | ({"kept": _kept_json(record, record.kept)} if record.kept else {})


def _kept_json(record: Improvement, kept: Kept) -> dict[str, Any]:
    samples = max(int((record.experiment.weight > 0.0).any(axis=1).sum()), 1)
    return to_table(kept.curve) | {"heldout_nll_drop_per_sample": kept.held_out / samples}


def _measure_json(m: Measure) -> dict[str, Any]:
    return {"nll_per_sample": m.nll_per_sample, "rmse": m.rmse, "whiteness_p": m.whiteness_p}


def _value_json(v: Value) -> dict[str, Any]:
    return {"value": v.value, "std": v.std, "prior": v.prior, "unit": v.unit}


def _measure(experiment: Experiment, fitted: FitResult, held_out: Array) -> Measure:
    white = {name: whiteness(fitted.residuals[:, c]) for c, name in enumerate(CHANNELS)}
    return Measure(nll_per_sample(experiment, held_out), _rmse(experiment, fitted, held_out), white)


def _rmse(experiment: Experiment, fitted: FitResult, held_out: Array) -> dict[str, float]:
    """Root mean square of the held-out residuals: current, position, and the speed of equation 16."""
    error = held_out * experiment.noise
    turning = speed(error, fitted.model.vector)
    both = (experiment.weight[:, :2] > 0.0).all(axis=1)
    return {
        "current_a": _rms(error[experiment.weight[:, 1] > 0.0, 1]),
        "position_m": _rms(error[experiment.weight[:, 2] > 0.0, 2]),
        "speed_rad_s": _rms(turning[both]),
    }


def _rms(y: Array) -> float:
    return float(np.sqrt(np.mean(y**2))) if y.size else float("nan")


def _refit(rig: Rig, naming: Naming) -> dict[str, Value]:
    """Parameters of the rig file, and the delay of its servo, after the refit with all that was found."""
    terms = {t.parameter for n in naming.named for t in n.candidate.variant.terms}
    std = naming.extended.std
    return {
        f.name: Value(naming.extended.model[f.name], std[f.name], rig.model[f.name], PARAMETERS[f.name][0])
        for f in naming.extended.free
        if f.name not in terms and not is_curve(f.name)
    }


def _finding(
    experiment: Experiment, rig: Rig, naming: Naming, named: Named, before: Array, after: Array
) -> FoundCause:
    cause, variant = named.candidate.cause, named.candidate.variant
    std, model = naming.extended.std, naming.extended.model
    samples = max(int((experiment.weight > 0.0).any(axis=1).sum()), 1)
    parameters = {
        t.parameter: Value(model[t.parameter], _error(t.parameter, std, model), t.neutral, t.unit)
        for t in variant.terms
    }
    parameters |= {n: Value(v, 0.0, v, PARAMETERS[n][0]) for n, v in variant.fixed}
    ratio = {name: _rms(after[:, c]) / max(_rms(before[:, c]), 1e-300) for c, name in enumerate(CHANNELS)}
    return FoundCause(
        cause.name,
        cause.equation,
        variant.name,
        cause.formula,
        parameters,
        2.0 * (named.gain - named.penalty),
        named.held_out / samples,
        ratio,
        tuple(named.rivals),
        _separate_by(cause.name, tuple(named.rivals)),
    )


def _error(parameter: str, std: dict[str, float], model: Model) -> float:
    """Standard error of an effect's size, with what the model leaves out.

    A delay inside a sampled servo is known to half its period only (uniform), whatever the noise.
    """
    error = _IMPERFECT * std.get(parameter, 0.0)
    if parameter in _SAMPLED:
        half_a_period = math.hypot(model["servo_delay"], model["tick_phase"])
        return math.hypot(error, half_a_period / math.sqrt(3.0))
    return error


def _separate_by(cause: str, rivals: Sequence[str]) -> str:
    texts = [CAUSES[name].separate_by for name in (cause, *rivals) if CAUSES[name].separate_by]
    return "; ".join(dict.fromkeys(texts))


def _unexplained(experiment: Experiment, naming: Naming) -> tuple[Smooth, ...]:
    """The smooth terms that the extended model still asks for, the best first."""
    r = naming.extended.residuals
    n = int((experiment.weight > 0.0).sum())
    whole = max(0.5 * (square(r) - n), *(_raw_excess(experiment, r, c) for c in range(3)))
    least = dust(experiment, excess(experiment, naming.baseline.residuals))
    slow = slow_excess(experiment, r) > _SLOW_SHARE * least
    terms = smooth_terms(experiment, naming.extended, whole) if slow else []
    steps = rest_steps(experiment, naming.extended)  # their share is that of the steps themselves
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
        share = term.share if any(term is step for step in steps) else _share(experiment, r, term, whole)
        if share >= _UNEXPLAINED_SHARE and term.held_out >= _AS_GOOD * best.held_out:
            told.setdefault((term.equation, term.regressor), replace(term, share=share))
    return tuple(told.values())


def _share(experiment: Experiment, r: Array, term: Smooth, whole: float) -> float:
    """Share of the residual's excess variance, of its own channel for a sensor, that the term explains."""
    if term.equation in _SENSORS:
        whole = _raw_excess(experiment, r, _SENSORS.index(term.equation))
    return min(term.held_out / max(whole, term.gain, 1e-300), 1.0)


def _raw_excess(experiment: Experiment, r: Array, channel: int) -> float:
    n = int((experiment.weight[:, channel] > 0.0).sum())
    return 0.5 * (float(np.sum(r[:, channel] ** 2)) - n)


def _detectable(naming: Naming) -> dict[str, dict[str, float] | None]:
    """Five standard errors of each cause's size beside the refit, from the last round of scores."""
    found: dict[str, dict[str, float] | None] = dict.fromkeys(CAUSES)
    for candidate in naming.screened:
        name = candidate.cause.name
        if found[name] is None:
            found[name] = {k: 5.0 * v for k, v in candidate.detectable.items() if math.isfinite(v)}
    for name, cause in CAUSES.items():
        for alias in cause.aliases:
            if found[name] is None:
                found[name] = found[alias]
    return found
