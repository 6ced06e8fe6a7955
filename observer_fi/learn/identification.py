"""A rig learned from its own logs: section 3's closed forms, then the output-error likelihood of all logs jointly.

The maker's data (Rm, Km, D) enter as tight priors. A parameter that the logs cannot tell is not reported as a number:
the fit says what to record instead. It stays in the likelihood with the rig's spread as its prior, so that the
intervals of the others stay honest. docs/identify.md has the equations, the checks and what the limits rest on.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn import section3 as cf
from observer_fi.learn.contacts_and_losses import Breaks, find_breaks
from observer_fi.learn.driven.integral_regression import identify_driven
from observer_fi.learn.gauss_newton import Free
from observer_fi.learn.joint_likelihood import (
    Z95,
    JointFit,
    Part,
    fit_parts,
    nll,
    part_of,
    predict,
    profile_interval,
    residuals_of,
)
from observer_fi.learn.logger.filtered_readings import NAMES as FILTERED
from observer_fi.learn.logger.filtered_readings import Through
from observer_fi.learn.logger.low_passes import filter_of, needed
from observer_fi.learn.move_data import share_of
from observer_fi.learn.plausibility import refuse_suspects, told_if_far, told_if_left, with_possible_signs
from observer_fi.learn.servo.encoder_steps import without_steps
from observer_fi.learn.servo.inductance import behind_inductance, winding_of
from observer_fi.learn.servo.servo_start import needs_start, with_crawl, with_start
from observer_fi.learn.servo.servo_ticks import Ticks, are_one, with_one_age
from observer_fi.logs import (
    LowPass,
    LowPasses,
    log_phases,
    mean_square_by_phase,
    moves_from_rest,
    on_its_clock,
    thinned,
    unfiltered,
    with_command,
    without_inductance,
)
from observer_fi.physics import (
    PARAMETERS,
    UNLEARNED,
    Model,
    Quantity,
    Rig,
    bounds,
    override,
    rederived,
    speed,
    with_values,
)
from observer_fi.records import Array, Fit, Log, Parameter, Segment

# Relative 1-sigma of what the maker states; the rig file's spread, where it gives one, takes its place.
MAKER = {"Rm": 2e-3, "Km": 2e-3, "D": 1e-3}
ANOTHER = 1.5  # times what the maker states: no motor is so far off, hot or cold, and no lead
BESIDE = 1.1  # times what the readings tell without a servo: a law that is none of this servo's bends its motor until it fits
DEFAULT_SPREAD = 0.1  # of a parameter that the logs cannot tell
PITCH_SPAN = 2.0  # deg between the moves' pitches that tells B
PROFILE_FROM = 0.01  # relative standard error from which on the interval is the profile likelihood's
CANNOT_TELL = 0.3  # relative standard error from which on a value is none
# A sampled servo needs two numbers: its proportional path sees the speed half a period late (2 ms is a servo of
# 250 Hz), and its ticks and the logger's samples have a time between them. Without them Ki is 0.4 % off, J 0.1 %.
TIMING = (Free("servo_delay", 1e-5, 0.0, 2e-3), Free("input_delay", 1e-5, -5e-3, 0.2))
# A third one is each log's own: by how much of half a tick, which the delay is, the current that such a servo holds is older when
# it is read than it is on average. That is a whole one at most, and the delay is known to a quarter.
AGE = Free("tick_share", 2e-2, -1.25, 1.25)
_TIMING = tuple(f.name for f in TIMING)
# What a value that was learned may still be off from one day to the next (the paper's spread); a data sheet leaves more open.
DAILY = {"A": 0.1, "B": 0.1, "C": 0.15, "E": 0.05, "A_decoupled": 0.1}
# What the command shows and no likelihood asks, with its relative standard error.
FROM_COMMAND = {"accel_cmd": 1e-2, "Kx": 2e-5}
# Times the supply that is fitted, and nats by which no limit must be worse than it.
NO_LIMIT, LIMITS_NATS = 2.0, 30.0
SUPPLIES_DIFFER = 0.015  # of the highest, from which on logs have supplies of their own
GAINS = ("Kp", "Ki")
# Relative standard error that a position servo's loop keeps: on 40 drawn ones it was off by 1e-4 to 4e-4 where noise left 1e-5.
BETWEEN_TICKS, LOOP = 2e-4, ("J", "Kp", "Ki")
OFFSET_SHOWS = 3.0  # standard errors from which on a torque offset belongs into the rig

RECORD = {
    "J": "the logs hold no start from rest; record a start at full speed",
    "A": "the logs hold no steady move; record moves of a second or longer in both directions",
    "Kp": "the logs hold no start from rest; record a start at full speed",
    "Ki": "the logs hold no start from rest; record a start at full speed",
    "B": "all moves are at one pitch; record moves at two pitches or more, 5 deg apart or farther",
    "Rs": "no start saturates the supply; record starts at full speed",
    "Vmax": "no start saturates the supply; record starts at full speed",
    "torque_offset": "all moves go in one direction; record moves in both",
    "C": "no move leans on a stop; record a slow move 1 mm or deeper into one",
    "E": "no move leans on a stop; record a slow move 1 mm or deeper into one",
    "x_stop_high": "no move reaches the high stop; record a slow move 1 mm or deeper into it",
    "x_stop_low": "no move reaches the low stop; record a slow move 1 mm or deeper into it",
    "A_decoupled": "no log shows the motor without the mass; record moves with the coupling open",
    "J_decoupled": "no log shows a start or a stop of the motor without the mass; record moves with the coupling open",
    "Rm": "the logs add nothing to the maker's value; record moves at several speeds and pitches",
    "Km": "the logs add nothing to the maker's value; record moves at several speeds and pitches",
    "D": "the logs add nothing to the maker's value; record a long move",
}


class Material(NamedTuple):
    """A log, without the filters of its logger, with what was found in it: its moves, and where the mass stops following.

    logged: the log as it is.
    """

    log: Log
    moves: tuple[Segment, ...]
    breaks: Breaks
    logged: Log


class Learned(NamedTuple):
    """A fit of all logs with what it took, and what of it can be told."""

    material: list[Material]
    parts: list[Part]
    fitted: JointFit
    identified: set[str]
    steps: dict[str, cf.Step]


class _Read(NamedTuple):
    """The fit of logs whose current has one age, the filters before their readings, and the ticks where it had not."""

    learned: Learned
    logs: Sequence[Log]
    low_passes: LowPasses
    ticks: tuple[Ticks, ...]


class Campaign(NamedTuple):
    """Logs without what their logger does to the readings; which filters were taken out, and the ticks that a servo showed."""

    logs: list[Log]
    low_passes: LowPasses
    ticks: tuple[Ticks, ...]

    @property
    def told(self) -> tuple[str, ...]:
        """What to say of readings that have one age now."""
        return tuple(own.told() for own in self.ticks)

    def known(self, rig: Rig) -> Rig:
        """The rig with half a tick of its servo for its delay, where it says none and the logs do."""
        if not self.ticks or "servo_delay" in rig.quantities:
            return rig
        return with_values(rig, {"servo_delay": 0.5 / self.ticks[0].rate_hz}, method="from the logs")


def identify(logs: Sequence[Log], rig: Rig, *, filters: bool = True) -> Fit:
    """Parameters of `rig` from logs, with intervals, correlations and what could not be identified.

    filters: whether a misfit is asked for a filter that a servo's logger has before its readings, for a winding with inductance,
    or for the ticks between which the servo holds its current; without, the logs have none of these.

    Raises InvalidLogError where no log holds a move that can be used. Drives 'voltage' and 'current' need no servo
    gains (`integral_regression.py`); drive 'force' is `inverse_dynamics.py`'s.
    """
    given, logs = logs[0], [thinned(log, rig) for log in logs]
    fit = _identified(logs, rig, filters)
    far = told_if_far(fit, rig, MAKER)
    fit = replace(fit, warnings=(*far, *fit.warnings)) if far else fit
    if not fit.filters:
        return fit
    more = given.rate_hz / logs[0].rate_hz
    return replace(fit, filters=tuple(own._replace(late=more * own.late) for own in fit.filters))


def _identified(logs: Sequence[Log], rig: Rig, filters: bool) -> Fit:
    """`identify` of logs of no more samples than tell something."""
    if not rig.driven.motor:
        from observer_fi.learn.inverse_dynamics import identify_force

        return identify_force(logs, rig)
    refuse_suspects(logs, rig)
    if not rig.driven.servo:
        return with_possible_signs(identify_driven(logs, rig), logs)
    logs = [on_its_clock(log, rig) for log in logs]
    fit = _servo_fit(logs, rig, filters)
    winding = winding_of(logs, rig) if filters else None
    if winding is None or winding.inductance is None:
        return fit
    L = winding.inductance.value
    behind = _servo_fit([without_inductance(log, L) for log in logs], rig, filters=False)
    return behind_inductance(behind, fit, winding)


def _servo_fit(logs: Sequence[Log], rig: Rig, filters: bool) -> Fit:
    """The fit of a rig that its servo drives, whatever is known of that."""
    if needs_start(rig):
        begun = with_start(logs, rig)
        fit = _identify_begun(logs, begun, filters)
        if fit is None or not (
            _is_of(fit, rig, ANOTHER) and _is_of(fit, begun, BESIDE)
        ):  # a servo that was begun too far off, or is another
            fit = identify_driven(logs, replace(rig, drive="voltage"))
        return _with_commanded(fit, begun, rig)
    return _identify_servo(logs, rig, filters)


def _identify_begun(logs: Sequence[Log], begun: Rig, filters: bool) -> Fit | None:
    """The fit of a servo from where its logs let it begin; None where that ran away until its numbers were none."""
    try:
        return _identify_servo(logs, begun, filters)
    except np.linalg.LinAlgError:
        return None


def _is_of(fit: Fit, rig: Rig, most: float) -> bool:
    """Whether a fit found inertia and friction, and a motor and a lead that are no others than a rig's, to so many times."""
    values = {p.name: p.value for p in fit.parameters}
    shares = [values[n] / rig.model[n] for n in MAKER if n in values]
    return {"J", "A"} <= values.keys() and all(1.0 / most < share < most for share in shares)


def _with_commanded(fit: Fit, begun: Rig, rig: Rig) -> Fit:
    """A fit from `begun` as one of `rig`: its priors, and what the likelihood takes from the command as it is."""
    known = [replace(p, prior=rig.model[p.name]) if p.name in rig.quantities else p for p in fit.parameters]
    added = [n for n in FROM_COMMAND if n in begun.quantities and begun.model[n] != rig.model[n]]
    for name in added:
        value = begun.model[name]
        std = FROM_COMMAND[name] * value
        low, high = value - Z95 * std, value + Z95 * std
        known.append(Parameter(name, value, std, rig.model[name], PARAMETERS[name][0], low, high))
    correlation = np.eye(len(known))
    correlation[: len(fit.parameters), : len(fit.parameters)] = fit.correlation
    return replace(fit, parameters=tuple(known), correlation=correlation)


def _identify_servo(logs: Sequence[Log], rig: Rig, filters: bool) -> Fit:
    """The fit of a rig whose servo is known well enough to begin with."""
    read = _as_read(logs, rig, filters)
    learned = read.learned
    fitted = learned.fitted if rig.driven.command is None else _between_ticks(learned.fitted)
    fit = _fit(learned.parts, fitted, learned.identified, learned.steps, rig)
    return replace(
        fit, filters=read.low_passes.told, warnings=(*fit.warnings, *(own.told() for own in read.ticks))
    )


def _between_ticks(fitted: JointFit) -> JointFit:
    """A fit of a position servo whose intervals hold what nobody logged: the encoder at the ticks between two samples."""
    doubt = [BETWEEN_TICKS * fitted.values[f.name] if f.name in LOOP else 0.0 for f in fitted.free]
    return replace(fitted, covariance=fitted.covariance + np.diag(np.square(doubt)))


def campaign_readings(logs: Sequence[Log], rig: Rig) -> Campaign:
    """The readings of some logs without what their logger does to them; as they are where no servo's starts tell.

    A servo's current has one age in them (`servo_ticks.py`), and filters that come before the readings are taken out.
    """
    if not rig.driven.servo:
        return _in_time(logs, rig)
    if needs_start(rig):
        return Campaign(list(logs), LowPasses(), ())
    read = _as_read(logs, rig, filters=True)
    taken = [unfiltered(log, read.low_passes.told) for log in read.logs]
    return Campaign(taken, read.low_passes, read.ticks)


def _in_time(logs: Sequence[Log], rig: Rig) -> Campaign:
    """Logs without a known servo as they are, and by how much their current is later than the voltage: `tracked` takes it so. A
    voltage and a position that are late are causes with names.
    """
    try:
        found = {own.channel: own.late for own in identify_driven(logs, rig).filters}
    except InvalidLogError:
        found = {}
    late = max(found.get("current", 0.0) - found.get("voltage", 0.0), 0.0)
    return Campaign(list(logs), LowPasses(current=LowPass(late=late)), ())


def _as_read(logs: Sequence[Log], rig: Rig, filters: bool) -> _Read:
    """The fit of all logs, with their current of one age, and the filters that it found before their readings.

    filters: see `identify`.
    """
    if not filters:
        return _Read(_learned(logs, rig, held=False), logs, LowPasses(), ())
    learned = _learned(logs, rig)
    commanded = [each.logged for each in learned.material]
    taken, ticks = with_one_age(logs, commanded, rig, learned.parts, learned.fitted)
    if ticks:  # told again by constants that fit behind them
        fitted = _learned(taken, rig).fitted
        taken, again = with_one_age(logs, commanded, rig, learned.parts, fitted)
        # Of a fit that fails by far anything may look like ticks, but of another rate each time, or with nothing gained.
        behind = _learned(taken, rig) if are_one(ticks, again, logs) else learned
        stand = behind.fitted.objective < learned.fitted.objective
        logs, learned, ticks = (taken, behind, again) if stand else (logs, learned, ())
    if not needed(learned.fitted):
        return _Read(learned, logs, LowPasses(), ticks)
    begun = _start_values(learned.material, {}, rig)
    free = _free(learned.material, begun, learned.identified, rig)
    found = filter_of(learned.parts, rig.model, free, begun)
    if found is None:
        return _Read(learned, logs, LowPasses(), ticks)
    learned = _learned(logs, rig, *found, held=False)
    return _Read(learned, logs, found[0].told(learned.fitted.values, 1.0 / logs[0].rate_hz), ticks)


def _learned(
    logs: Sequence[Log],
    rig: Rig,
    through: Through | None = None,
    values: Mapping[str, float] | None = None,
    held: bool = True,
) -> Learned:
    """The fit of all logs whose readings come through a filter, if through any: about that of some `values`.

    held: whether their current is read as the servo holds it; behind a filter, and in a winding with inductance, it is not.
    """
    known = values or {}
    material = [_material(log, rig, _taken_out(through, known, log)) for log in logs]
    steps, start = closed_form_start(material, rig.model)
    share = share_of(m.moves for m in material)
    found = [part_of(m.logged, rig, k, m.breaks, share, m.log) for k, m in enumerate(material)]
    parts = [part._replace(through=through) for part in found if part is not None]
    if not parts:
        raise InvalidLogError(
            f"{logs[0].path}: no move that begins from a rest; record the rest before each move too"
        )
    identified = identifiable(material, parts, rig.model)
    behind = through.free(1.0 / logs[0].rate_hz) if through else []
    start = {**start, **{f.name: known[f.name] for f in behind}}
    begun = _beginning(parts, material, start, rig)
    begun = begun if held else {n: v for n, v in begun.items() if n.split("@")[0] != AGE.name}
    fitted, identified = _told(parts, material, begun, identified, behind, rig)
    return Learned(material, parts, fitted, identified, steps)


def _taken_out(through: Through | None, values: Mapping[str, float], log: Log) -> LowPasses:
    return through.told(values, 1.0 / log.rate_hz) if through else LowPasses()


def _told(
    parts: list[Part],
    material: list[Material],
    values: dict[str, float],
    identified: set[str],
    behind: list[Free],
    rig: Rig,
) -> tuple[JointFit, set[str]]:
    """The fit of what the logs tell, and the names of that. behind: what is free of a filter."""

    def fit(identified: set[str], values: Mapping[str, float]) -> JointFit:
        free = [*_free(material, values, identified, rig), *behind]
        return fit_parts(parts, rig.model, free, values)

    fitted = fit(identified, values)
    if "Vmax" in identified and not _limits(parts, rig.model, fitted):
        identified = identified - {"Rs", "Vmax"}
        supplies = {
            n: max(rig.model["Vmax"], v) for n, v in fitted.values.items() if n.split("@")[0] == "Vmax"
        }
        fitted = fit(identified, {**fitted.values, "Rs": rig.model["Rs"], **supplies})
    weak = _weak(fitted, identified)
    if weak:
        fitted = fit(identified - weak, fitted.values)
        again = fit(identified, fitted.values)
        still = _weak(again, identified)  # a fit that began far away may only have stopped short
        fitted = again if not still else fitted
        identified = identified - (weak if still else set())
        identified = identified - _weak(fitted, identified)  # what the first fit hid
    return fitted, identified


def identified_rig(fit: Fit, rig: Rig) -> Rig:
    """`rig` with the values of a fit. Contact points of several logs become their mean, and so do supplies, with the scatter of
    these from day to day; onsets are left out.
    """
    values, std = {}, {}
    for name in {p.name.split("@")[0] for p in fit.parameters} - {"onset"}:
        same = [p for p in fit.parameters if p.name.split("@")[0] == name]
        by_day = name == "Vmax" and len(same) > 1
        scatter = float(np.std([p.value for p in same], ddof=1)) if by_day else 0.0
        weight = np.array([1.0 / max(math.hypot(p.std, scatter), 1e-300) ** 2 for p in same])
        values[name] = float(np.average([p.value for p in same], weights=weight))
        std[name] = float(1.0 / math.sqrt(weight.sum()))
    for name in ("torque_offset",):
        if name in values and abs(values[name]) < OFFSET_SHOWS * std[name]:
            del values[name], std[name]
    both = "viscous_positive", "viscous_negative"
    if both[0] in values and both[1] not in values:  # one coefficient that was fitted to moves either way
        values[both[1]], std[both[1]] = values[both[0]], std[both[0]]
    learned = with_values(rig, values, std, "identified")
    if fit.inductance:
        L = fit.inductance
        learned = replace(learned, inductance=Quantity(L.value, L.unit, "identified", std=L.std))
    narrow = {
        name: replace(q, spread=DAILY.get(name, 0.0))
        for name, q in learned.quantities.items()
        if name in values and name in rig.quantities and rig.quantities[name].method in UNLEARNED
    }
    return rederived(replace(learned, quantities=learned.quantities | narrow))


# --- what the logs hold ---------------------------------------------------------------------------


def _material(log: Log, rig: Rig, low_passes: LowPasses) -> Material:
    even = without_steps(log, rig)
    logged = with_crawl(with_command(even, rig), rig)
    log = unfiltered(logged, low_passes.told)
    moves = moves_from_rest(log)
    return Material(log, moves, find_breaks(log, moves, rig.model, rig.noise["position"]), logged)


def identifiable(material: Sequence[Material], parts: Sequence[Part], model: Model) -> set[str]:
    """Names of the parameters that these logs can tell, judged by what was done, before any fit."""
    coupled = [m for k in material for m in _coupled(k)]
    identified = {*_TIMING, *MAKER} if coupled or parts else set()
    if coupled:
        identified |= {"J", "A", "Kp", "Ki"}
        if np.ptp([m.pitch for m in coupled]) >= PITCH_SPAN:
            identified.add("B")
        if len({np.sign(m.peak) for m in coupled}) == 2:
            identified.add("torque_offset")
    if any(cf.saturated_starts(k.log, k.moves, model) for k in material):
        identified |= {"Rs", "Vmax"}
    if any(k.breaks.stop_high is not None or k.breaks.stop_low is not None for k in material):
        identified |= {"C", "E"}
    if any(k.breaks.loss is not None for k in material):
        identified |= {"A_decoupled", "J_decoupled"}
    return identified


def _coupled(material: Material) -> list[Segment]:
    """Moves that begin with the mass coupled."""
    loss = material.breaks.loss
    return [m for m in material.moves if loss is None or m.start < loss]


def _decoupled(material: Material) -> list[Segment]:
    loss = material.breaks.loss
    return [] if loss is None else [m for m in material.moves if m.start >= loss]


# --- where the fit begins -------------------------------------------------------------------------


def closed_form_start(
    material: Sequence[Material], model: Model
) -> tuple[dict[str, cf.Step], dict[str, float]]:
    """The steps of section 3 in the paper's order, each with the values of those before it, and the values found."""
    steps: dict[str, cf.Step] = {}
    found: dict[str, float] = {}
    for name, step in _sequence(material, model, found):
        if step is not None and _plausible(step, model):
            steps.setdefault(name, step)
            found.update({n: v for n, v in step.values.items() if n not in found})
    return steps, found


def _sequence(material: Sequence[Material], model: Model, found: dict[str, float]) -> Any:
    def now() -> Model:
        return override(model, model.name, **{n: v for n, v in found.items() if not n.startswith("x_stop")})

    for k in material:
        free = [m for m in _coupled(k) if not _touches_stop(k, m)]
        starts = cf.saturated_starts(k.log, k.moves, now())
        whole = [s for s in starts if s.move in free]
        yield "source", cf.source(k.log, starts)
        yield "friction", cf.friction(k.log, free, now())
        yield "inertia", cf.inertia(k.log, whole, now())
        yield "gains", cf.gains(k.log, free, starts, now())
        for side, stop in ((1.0, k.breaks.stop_high), (-1.0, k.breaks.stop_low)):
            pressing = [
                m
                for m in _coupled(k)
                if stop is not None and np.sign(m.peak) == side and _reaches(k, m, stop, side)
            ]
            for move in pressing[:1]:
                yield "contact", cf.contact(k.log, move, now(), float(stop or 0.0), side)
                yield "compression", cf.compression(k.log, move, now(), float(stop or 0.0), side)
        loose = _decoupled(k)
        yield "decoupled_friction", cf.friction(k.log, loose, now(), ("A_decoupled", ""))
        loose_starts = [s for s in starts if s.move in loose]
        yield "decoupled_inertia", cf.inertia(k.log, loose_starts, now(), "J_decoupled")


def _reaches(k: Material, move: Segment, stop: float, side: float) -> bool:
    x = k.log.z[move.start : move.stop, 2]
    return bool(np.isfinite(x).any() and np.nanmax(side * (x - stop)) > 2e-4)


def _touches_stop(k: Material, move: Segment) -> bool:
    high, low = k.breaks.stop_high, k.breaks.stop_low
    return (high is not None and _reaches(k, move, high, 1.0)) or (
        low is not None and _reaches(k, move, low, -1.0)
    )


def _plausible(step: cf.Step, model: Model) -> bool:
    """A closed form that is off by a factor of three or has no finite value is no start for a fit."""
    for name, value in step.values.items():
        reference = model[name]
        if not math.isfinite(value) or (
            not name.startswith("x_stop") and not reference / 3.0 < value < 3.0 * reference
        ):
            return False
    return True


def _start_values(material: Sequence[Material], found: Mapping[str, float], rig: Rig) -> dict[str, float]:
    """Values by name of the fit: closed forms, else the rig's; contact points per log where several have one."""
    names = (*MAKER, "J", "A", "B", "Kp", "Ki", "Rs", "Vmax", "C", "E", "A_decoupled", "J_decoupled")
    values = {n: found.get(n, rig.model[n]) for n in names}
    if "Vmax" not in found:
        values["Vmax"] = max(values["Vmax"], 1.01 * max(_highest(m.log, values["Rs"]) for m in material))
    values |= _supplies(material, rig.model)
    values["servo_delay"] = max(rig.model["servo_delay"], 3e-5)
    values["input_delay"] = rig.model["input_delay"]
    values |= dict.fromkeys(
        [f"{AGE.name}@{k}" for k in range(len(material))] if len(material) > 1 else [AGE.name], 0.0
    )
    values["torque_offset"] = rig.model["torque_offset"]
    values |= {n: rig.model[n] for n in rig.model.effects if n != AGE.name}
    values |= {n: found[n] for n in FILTERED if n in found}
    for side in ("high", "low"):
        stops = {k: s for k, m in enumerate(material) if (s := getattr(m.breaks, f"stop_{side}")) is not None}
        for k, stop in stops.items():
            name = f"x_stop_{side}" if len(material) == 1 else f"x_stop_{side}@{k}"
            values[name] = stop
    return values


def _supplies(material: Sequence[Material], model: Model) -> dict[str, float]:
    """The supply of each log by name [V] where it was not the same on all days: one for all would bend every other constant."""
    highest = {k: _highest(m.log, model["Rs"]) for k, m in enumerate(material)}
    full = [highest[k] for k, m in enumerate(material) if cf.saturated_starts(m.log, m.moves, model)]
    if len(full) < 2 or np.ptp(full) < SUPPLIES_DIFFER * max(full):
        return {}
    return {f"Vmax@{k}": own for k, own in highest.items()}


def _beginning(
    parts: Sequence[Part], material: Sequence[Material], start: Mapping[str, float], rig: Rig
) -> dict[str, float]:
    """Start values with the closed forms' gains or with the rig's, whichever leaves less: gains of a third of the true ones
    pass as plausible, and led one fit of a hundred into a minimum far off.
    """
    own = {n: v for n, v in start.items() if n not in GAINS}
    starts = [start] if len(own) == len(start) else [start, own]
    begun = [_onsets(parts, material, rig.model, _start_values(material, s, rig)) for s in starts]
    return min(begun, key=lambda values: _left(parts, rig.model, values)) if len(begun) > 1 else begun[0]


def _left(parts: Sequence[Part], plant: Model, values: Mapping[str, float]) -> float:
    """Sum of squares that these values leave of all parts; infinite where they cannot be simulated."""
    r = [residuals_of(p, plant, values, np.zeros((p.experiment.moves, 2))) for p in parts]
    total = sum(float(np.vdot(one, one)) for one in r)
    return total if math.isfinite(total) else math.inf


def _highest(log: Log, Rs: float) -> float:
    """Largest source voltage that a log shows [V], a spike aside."""
    with np.errstate(invalid="ignore"):
        y = np.abs(log.z[:, 0] + Rs * log.z[:, 1])
    return float(np.nanquantile(y, 0.9999)) if np.isfinite(y).any() else 0.0


def _onsets(
    parts: Sequence[Part], material: Sequence[Material], plant: Model, values: Mapping[str, float]
) -> dict[str, float]:
    """Values with the time of each coupling loss: rough from the bend, then the best of a scan of its own log."""
    values = dict(values)
    for part in parts:
        loss = material[part.number].breaks.loss
        if loss is None:
            continue
        log = material[part.number].log
        values[f"onset@{part.number}"] = best_onset(part, plant, values, float(log.t[loss]), float(log.t[0]))
    return values


def best_onset(part: Part, plant: Model, values: Mapping[str, float], rough: float, earliest: float) -> float:
    """Onset [s] of least misfit on grids of 10, 2 and 0.3 ms around a rough one; before the log for a whole log."""
    name = f"onset@{part.number}"
    nuisance = np.zeros((part.experiment.moves, 2))

    def cost(onset: float) -> float:
        r = residuals_of(part, plant, {**values, name: onset}, nuisance)
        return float(np.vdot(r, r))

    first = float(part.experiment.t[0])
    centre = rough
    for step, count in ((0.01, 12), (0.002, 6), (3e-4, 8)):
        grid = np.maximum(centre + step * np.arange(-count, count + 1), max(earliest, first) - 1e-9)
        centre = float(min(grid, key=cost))
    return centre


# --- what is free ---------------------------------------------------------------------------------


def _free(
    material: Sequence[Material], values: Mapping[str, float], identified: set[str], rig: Rig
) -> list[Free]:
    """Free parameters with steps, bounds and priors; what the logs cannot tell keeps the rig's spread."""
    free = []
    own = [n for n in values if n.startswith("Vmax@")] if "Vmax" in identified else []
    for name in ("J", "A", "B", "Kp", "Ki", "Rs", "Vmax", "C", "E", "A_decoupled", "J_decoupled"):
        if name == "Vmax" and own:
            continue
        reference = rig.model[name]
        step = 1e-3 * abs(reference) * {"Vmax": 0.1, "Rs": 10.0}.get(name, 1.0)
        bounds = (0.05 * reference, 20.0 * reference if name != "E" else 0.99)
        prior = math.inf if name in identified else reference * (rig.spread(name) or DEFAULT_SPREAD)
        free.append(Free(name, step, *bounds, reference, prior))
    Vmax = rig.model["Vmax"]
    of_a_day = Vmax * (rig.spread("Vmax") or DEFAULT_SPREAD)  # for a log that no start of tells it
    free += [Free(n, 1e-4 * Vmax, 0.05 * Vmax, 20.0 * Vmax, Vmax, of_a_day) for n in own]
    for name, relative in MAKER.items():
        reference = rig.model[name]
        std = reference * (rig.spread(name) or relative)
        free.append(Free(name, 1e-4 * reference, 0.5 * reference, 2.0 * reference, reference, std))
    free += [*TIMING, *(AGE._replace(name=n) for n in values if n.split("@")[0] == AGE.name)]
    offset = math.inf if "torque_offset" in identified else 0.02 * rig.model["A"]
    free.append(Free("torque_offset", 1e-3 * rig.model["A"], prior=0.0, prior_std=offset))
    free += [
        _effect(n, rig.model[n]) for n in rig.model.effects if n not in (*_TIMING, AGE.name, "torque_offset")
    ]
    free += [Free(n, 2e-6, *_travel(material)) for n in values if n.startswith("x_stop")]
    free += [Free(n, 1e-4) for n in values if n.startswith("onset")]
    return free


def _travel(material: Sequence[Material]) -> tuple[float, float]:
    """Positions between which a stop may be [m]: what was covered, and as much beyond on either side."""
    low = min(float(np.nanmin(k.log.z[:, 2])) for k in material)
    high = max(float(np.nanmax(k.log.z[:, 2])) for k in material)
    return 2.0 * low - high, 2.0 * high - low


def _effect(name: str, value: float) -> Free:
    """An effect that the rig names: free within its physical bounds."""
    return Free(name, 1e-2 * abs(value), *bounds(name, value))


def _limits(parts: Sequence[Part], plant: Model, fitted: JointFit) -> bool:
    """Whether the supply limits any start: without a limit the readings are explained far worse.

    A start that comes near a supply, and no nearer, looks like one that it holds there, and the fit puts the limit upon its peak.
    """
    free = {n: NO_LIMIT * v if n.split("@")[0] == "Vmax" else v for n, v in fitted.values.items()}
    more = 0.0
    for part, nuisance, r in zip(parts, fitted.nuisance, fitted.residuals, strict=True):
        without = residuals_of(part, plant, free, nuisance)
        more += 0.5 * float(np.vdot(without, without) - np.vdot(r, r))
    return more > LIMITS_NATS * float(fitted.inflation.max())


def _weak(fitted: JointFit, identified: set[str]) -> set[str]:
    """Parameters without a prior whose standard error is too large to call them a value."""
    std = fitted.std
    return {
        n for n in identified
        if n not in MAKER and n not in (*_TIMING, "torque_offset") and n in std and std[n] > CANNOT_TELL * abs(fitted.values[n])
    }  # fmt: skip


# --- the result -----------------------------------------------------------------------------------


def _fit(
    parts: Sequence[Part], fitted: JointFit, identified: set[str], steps: Mapping[str, cf.Step], rig: Rig
) -> Fit:
    std = fitted.std
    names = [f.name for f in fitted.free if _reported(f.name, identified)]
    parameters = []
    for name in names:
        low, high = _interval(parts, fitted, name, rig.model)
        base = name.split("@")[0]
        unit = PARAMETERS[base][0] if base in PARAMETERS else "s"
        prior = rig.model[base] if base in PARAMETERS else math.nan
        parameters.append(Parameter(name, fitted.values[name], std[name], prior, unit, low, high))
    order = [k for k, f in enumerate(fitted.free) if f.name in names]
    scale = np.sqrt(np.maximum(np.diag(fitted.covariance), 1e-300))
    correlation = (fitted.covariance / np.outer(scale, scale))[np.ix_(order, order)]
    missing = {
        n: text for n, text in RECORD.items() if not any(p.name.split("@")[0] == n for p in parameters)
    }
    return Fit(
        tuple(parameters),
        correlation,
        missing,
        nll(parts, fitted),
        rmse(parts, fitted),
        figures(parts, fitted, steps),
        warnings=told_if_left([part.experiment for part in parts], fitted.residuals),
    )


def _interval(parts: Sequence[Part], fitted: JointFit, name: str, model: Model) -> tuple[float, float]:
    """95 % interval: the profile likelihood's for what is known to a percent or worse, else the parabola's.

    What is known better than that moves the readings in proportion, and the parabola is exact.
    """
    value, std, base = fitted.values[name], fitted.std[name], name.split("@")[0]
    scale = {
        "torque_offset": model["A"],
        "onset": math.inf,
        "servo_delay": math.inf,
        "input_delay": math.inf,
        "tick_share": math.inf,
    }.get(base, 1e-3 if base.startswith("x_stop") else abs(value))
    low, high = value - Z95 * std, value + Z95 * std
    if std > PROFILE_FROM * scale:
        low, high = profile_interval(parts, fitted, name)
    free = next(f for f in fitted.free if f.name == name)
    return max(low, min(free.low, value)), min(high, max(free.high, value))


def _reported(name: str, identified: set[str]) -> bool:
    base = name.split("@")[0]
    if base in (*FILTERED, AGE.name):
        return False
    if base in ("x_stop_high", "x_stop_low"):
        return "C" in identified or "E" in identified
    return base in identified or base not in RECORD


def rmse(parts: Sequence[Part], fitted: JointFit) -> dict[str, float]:
    """Root mean square residual of current [A], position [m] and the speed of equation 16 [rad/s], of what was measured."""
    errors = []
    for part, r in zip(parts, fitted.residuals, strict=True):
        e = part.experiment
        single = (e.weight > 0.0) & (e.weight < 1.01 / e.noise)  # neither missing nor the mean of a rest
        errors.append(np.where(single, r, np.nan) / np.where(single, e.weight, 1.0))
    left = np.concatenate(errors)
    named = {
        "current_a": left[:, 1],
        "position_m": left[:, 2],
        "speed_rad_s": speed(left, fitted.plant.vector),
    }
    return {n: float(np.sqrt(np.nanmean(v**2))) for n, v in named.items() if np.isfinite(v).any()}


def residuals_by_phase(logs: Sequence[Log], fit: Fit, rig: Rig) -> dict[str, Array]:
    """Mean square of the normalised residuals (3,) by phase of motion; empty for a rig that is not driven by its servo."""
    codes, residuals = [], []
    for one in fit.figures.get("fits", []):
        log = with_command(logs[one["log"]], rig)
        codes.append(log_phases(log, rig.model)[np.searchsorted(log.t, one["time"])])
        residuals.append(one["residual"])
    if not codes:
        return {}
    return mean_square_by_phase(np.concatenate(residuals), np.concatenate(codes))


def figures(parts: Sequence[Part], fitted: JointFit, steps: Mapping[str, cf.Step]) -> dict[str, Any]:
    """Arrays to draw: section 3's steps, and per log measured and simulated readings with their residuals."""
    fits = []
    for part, nuisance, r in zip(parts, fitted.nuisance, fitted.residuals, strict=True):
        e = part.experiment
        seen = (e.weight > 0.0).any(axis=1)
        simulated = predict(part, fitted.plant, fitted.values, nuisance)
        measured = np.where(e.weight > 0.0, e.z, np.nan)
        fits.append({
            "log": part.number, "time": e.t[seen], "measured": measured[seen], "simulated": simulated[seen],
            "residual": r[seen], "move": e.owner[seen], "peak": e.peak, "pitch": e.pitch,
        })  # fmt: skip
    return {"steps": dict(steps), "fits": fits}
