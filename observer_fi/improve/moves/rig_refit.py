"""What a refit of a servo rig may move without saying that something is missing: its constants near their priors, and stops."""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.improve.moves.misfit import GROSS_NATS, POSITION, excess, samples
from observer_fi.learn import (
    MAKER,
    Experiment,
    FitResult,
    Free,
    find_stops,
    fit,
    fit_or_none,
    stops_of_travel,
)
from observer_fi.physics import CAUSES, Curve, Model, Rig, override, parameters
from observer_fi.records import Log

# Relative prior of what a servo rig gives: maker's data tight, the rest as wide as rigs differ.
_PRIORS = {
    "Vmax": 0.1, "Kp": 0.5, "Ki": 0.5, "J": 0.5, "A": 0.5, "B": 0.5, "Rs": 2.0,
    "Rm": 5e-4, "Km": 5e-4, "D": 2e-4,
}  # fmt: skip
# Constants that one equation alone has.
_ONLY_IN = {"servo": ("Vmax", "Kp", "Ki", "Rs"), "electrical": ("Rm", "Km")}
# By how much of the servo's delay, half a tick, samples are older than its current is on average: any part of it is as likely.
_AGE = Free("tick_share", 2e-2, -1.25, 1.25, 0.0, 1.0 / math.sqrt(3.0))
_SERVO_S = 1e-4  # half the period of a servo of 5 kHz or more, where none is known
# Between the servo's ticks and the logger's samples lies a time of either sign, within a period of that servo.
_TICK_PHASE = Free("tick_phase", 1e-5, -1e-4, 1e-4, 0.0, 3e-5)
_STOPS = {"C": 1.0, "E": 0.2}
STOP_NATS = 100.0  # that stops must gain in the refit


def base_parameters(
    rig: Rig, model: Model, older_s: float = 0.0, silent: Sequence[str] = ()
) -> tuple[Free, ...]:
    """What a refit may move without saying that something is missing. older_s, silent: see `Experiment`."""
    unseen = {name for equation in silent for name in _ONLY_IN.get(equation, ())}
    names = {name: prior for name, prior in _PRIORS.items() if name not in unseen}
    free = []
    if math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"]):
        names |= _STOPS
    for name, relative in names.items():
        value = rig.model[name]
        if not value:  # gravity of a screw that lies: nothing to scale
            continue
        learned = rig.quantities[name].std if name in rig.quantities else None
        of_fit = (learned or 0.0) / abs(value)
        # Without a servo no starts tell them any better.
        of_maker = MAKER.get(name, 0.0) if "servo" in silent else 0.0
        relative = max(relative, rig.spread(name), of_fit, of_maker)
        free.append(Free(name, 1e-3 * value, 0.1 * value, 10.0 * value, value, relative * value))
    if "servo" in silent:
        # A current that is held between the samples drives later, or earlier, than a line through them.
        between = Free("tick_phase", 1e-5, -older_s, older_s, 0.0, older_s / math.sqrt(12.0))
        return (*free, *_stops(model), between)
    return (*free, *_stops(model), _servo_delay(model["servo_delay"]), _AGE, _tick_phase(older_s))


def refit_of_the_rig(experiment: Experiment, rig: Rig, model: Model, held: Sequence[str] = ()) -> FitResult:
    """The fit of what a refit may move: first without the age of the samples, beside which a first step from far off may end at
    the edge of stick and slip.
    """
    every = base_parameters(rig, model, experiment.older_s, experiment.silent)
    free = tuple(f for f in every if f.name not in held)
    begun = fit(experiment, model, [f for f in free if f.name != _AGE.name])
    return fit(experiment, begun.model, free)


def _servo_delay(known: float) -> Free:
    """Half a tick of the servo. known: of the rig file or the logs [s], 0 for none."""
    return Free("servo_delay", 1e-5, 0.0, max(_SERVO_S, 1.5 * known), known, max(_SERVO_S, 0.1 * known))


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


def with_stops(
    experiment: Experiment,
    logs: Sequence[Log],
    rig: Rig,
    logged: Experiment | None = None,
    beside: FitResult | None = None,
) -> Model:
    """The rig's model with the stops that the current or the travel shows, where a refit is better for them.

    A torque that is linear in the position is free in that refit: an offset or a spring looks like a stop at the end of the
    travel. logged: the moves as they were logged, where a loop stands for the servo; a gross effect bends them there, and stops
    that leave a gross misfit are believed `beside` a fit only that has it.
    """
    shown = find_stops(logged or experiment, rig)
    seen = stops_of_travel(experiment, logs, shown)
    models = list(dict.fromkeys([rig.model, shown, override(shown, shown.name, **seen)]))
    if len(models) == 1:
        return rig.model
    fits = [_with_a_spring(experiment, *_ended(experiment, rig, model, beside)) for model in models]
    left = [fitted.objective + STOP_NATS * k if fitted else math.inf for k, fitted in enumerate(fits)]
    best = int(np.argmin(left))
    fitted = fits[best]
    put_off = experiment.driven.size and beside is None
    if put_off and fitted and excess(experiment, fitted.residuals) > GROSS_NATS * samples(experiment):
        return rig.model
    return models[best]


def _ended(
    experiment: Experiment, rig: Rig, model: Model, beside: FitResult | None
) -> tuple[Model, tuple[Free, ...]]:
    """What is fitted with the stops of a model, and from where: the rig, or it with what a fit `beside` it has more."""
    free = tuple(
        f for f in base_parameters(rig, model, experiment.older_s, experiment.silent) if f.name != _AGE.name
    )
    if beside is None:
        return model, free
    known = {f.name for f in free}
    ends = {name: model[name] for name in ("x_stop_low", "x_stop_high")}
    more = tuple(f for f in beside.free if f.name not in known)
    return override(beside.model, model.name, **ends), (*free, *more)


def _with_a_spring(experiment: Experiment, model: Model, free: Sequence[Free]) -> FitResult | None:
    """The fit with a torque that is linear in the position, a constant one where the rig has a curve of its own."""
    if model["curve_of"] != 0.0:
        return fit_or_none(experiment, model, (*free, Free("torque_offset", 1e-6)))
    x = experiment.z[experiment.weight[:, POSITION] > 0.0, POSITION]
    spring = Curve("torque", "position", False, float(x.min()), float(np.ptp(x)), (0.0, 0.0))
    ends = [Free(name, 1e-6) for name in spring.names]
    return fit_or_none(experiment, override(model, model.name, **parameters(spring)), (*free, *ends))


def causes_of(model: Model, silent: Sequence[str] = ()) -> tuple[str, ...]:
    """The causes that moves of this model can speak about at all. silent: see `Experiment`."""
    touched = math.isfinite(model["x_stop_high"]) or math.isfinite(model["x_stop_low"])
    unseen = {*silent, *(() if touched else ("contact",))}
    return tuple(name for name, cause in CAUSES.items() if cause.equation not in unseen)
