"""Reports of `identify` and `improve`: the records printed, nothing computed."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from observer_fi.improve import (
    CLOSE_ALIKE,
    CLOSE_SHARE,
    WANTED_NATS,
    DiagnosisGain,
    Improvement,
    Smooth,
    SmoothedDisturbance,
    Value,
    to_json,
)
from observer_fi.logs import Excitation, told_filter
from observer_fi.numerics import digits, to_the_error, with_error
from observer_fi.physics import CAUSES, PARAMETERS, Rig, rig_toml
from observer_fi.records import Array, Filter, Fit, Parameter
from observer_fi.report import disturbance_figures, learning_figures
from observer_fi.report.diagnosis import environment, json_text, quantity, versions

_SAME = 0.97, 1.03  # a ratio of rms errors within is told as no change
FAR_NOISIER = 10.0  # times the noise of the rig file: nats a sample by that say nothing of the fit

Gain = tuple[DiagnosisGain, DiagnosisGain] | None


def improve_files(
    record: Improvement, gain: Gain, name: str, logs: list[str], note: str = ""
) -> dict[str, str]:
    """Everything that one improve report consists of, {file name: text}. note: what else to say of the logs.

    gain: `diagnose` with either rig, None where it cannot tell this rig's faults.
    """
    drawn = learning_figures.of_improve(record)
    disturbances = disturbance_figures.of_disturbances(record.disturbances)
    page = environment().get_template("improve.html")
    html = page.render(
        record=record, gain=gain, name=name, logs=logs, note=_notes(note, record.filters), figures=drawn,
        headline=improve_headline(record), words=plain, goes_with=goes_with,
        causes=CAUSES, shown=[excitation_sentence(e) for e in record.excitations], value=with_error, versions=versions(),
        rmse=RMSE,
        disturbances=list(zip(record.disturbances, disturbances, strict=True)), wish=freed_sentence(record),
        likeness=likeness(record), shape=shape, wanted=WANTED_NATS, close=CLOSE_SHARE, close_alike=CLOSE_ALIKE,
        digits_of=to_the_error, fitted=fitted, errors=errors_words, not_kept=not_kept(record), size=reader_of(record),
        main=learning_figures.main_channel(record.before),
        smallest=lambda name, size: reader_of(record)(Value(size, 0.0, 0.0, PARAMETERS[name][0])),
    )  # fmt: skip
    return {
        "improve.json": json_text(improve_json(record, gain)),
        "improve.html": html,
        "extended_rig.toml": rig_toml(record.extended_rig),
    }


# Where a force is logged, sizes are read at the mass: unit in the equations, unit there, power of D that divides a value.
AT_MASS = {
    "kg m^2": ("kg", 2),
    "N m": ("N", 1),
    "N m s/rad": ("N s/m", 2),
    "N m/m": ("N/m", 1),
    "N m/m^2": ("N/m^2", 1),
    "N m/deg": ("N/deg", 1),
    "rad/s": ("m/s", -1),
}


def at_mass(v: Value, D: float) -> Value:
    """A value as it is felt at the mass."""
    unit, power = AT_MASS.get(v.unit, (v.unit, 0))
    scale = D**-power
    return Value(v.value * scale, v.std * scale, v.prior * scale, unit)


def reader_of(record: Improvement) -> Callable[[Value], Value]:
    """How sizes are read: at the mass where its force was logged, else as they stand in the equations."""
    if "force" not in record.before.channels:
        return lambda v: v
    return lambda v: at_mass(v, record.rig.model["D"])


def freed_sentence(record: Improvement) -> str:
    """Which equation the data want to free first, in a sentence."""
    first = next((f for f in record.freed if f.verdict == "first"), None)
    if first is None:
        return "None: no freedom in any equation makes these moves likelier than chance would."
    return f"{EQUATIONS[first.equation].capitalize()} ({first.disturbance})."


def likeness(record: Improvement) -> str:
    """What the first equation cannot be told from, in sentences; empty where nothing is wanted or nothing comes near."""
    others = [EQUATIONS[f.equation] for f in record.freed if f.verdict == "close"]
    cannot = f"These logs cannot tell it from {' or '.join(others)} in this way. " if others else ""
    alike = next((f.alike for f in record.freed if f.verdict == "first" and f.alike), "")
    return cannot + (f"What looks alike: {alike}." if alike else "")


def improve_json(record: Improvement, gain: Gain) -> dict[str, Any]:
    """Contract section 4, and what `diagnose` makes of the same moves and of simulated faults, before and after."""
    told = {**to_json(record), "warnings": [*map(told_filter, record.filters), *record.warnings]}
    if gain is None:
        return told
    before, after = (g._asdict() for g in gain)
    return {**told, "diagnosis": {"baseline": before, "extended": after}}


_NOT_KNOWN = "The equations do not know, where it would enter them, what it depends on: no curve of it can be kept in the rig."
_NOT_HELD = (
    "A curve over this alone, fitted to some moves, did not hold on the others: it was not kept in the rig."
)
_NOT_ASKED = (
    "Option --keep-unexplained fits it as an empirical curve of the rig, "
    "and keeps it if it holds on moves that its fit never saw."
)


def goes_with(term: Smooth) -> str:
    """What an unexplained term goes with, in words."""
    return term.over.partition(" [")[0] or plain(term.regressor)


def not_kept(record: Improvement) -> str:
    """Why what is unexplained does not stand in the extended rig."""
    if not any(u.can_be_kept for u in record.unexplained):
        return _NOT_KNOWN
    return _NOT_HELD if record.keep_unexplained else _NOT_ASKED


EQUATIONS = {
    "torque": "the torque balance", "electrical": "the electrical equation", "servo": "the servo",
    "kinematics": "the screw", "contact": "the stops", "sensor:position": "the position sensor",
    "sensor:current": "the current sensor", "sensor:voltage": "the voltage sensor", "sensor:pitch": "the pitch sensor",
}  # fmt: skip


def shape(disturbance: SmoothedDisturbance) -> str:
    """What a disturbance goes with, in a sentence."""
    if not disturbance.goes_with:
        return "No quantity below predicts more than half of it in moves that were left out."
    names = [
        f"the {plain(name)} ({100.0 * disturbance.curves[name].share:.0f} %)"
        for name in disturbance.goes_with
    ]
    return f"It goes best with {' or '.join(names)}."


def excitation_sentence(shown: Excitation) -> str:
    """What a log holds, in a sentence."""
    one_way = "forward only" if 1 in shown.directions else "backward only"
    ways = one_way if len(shown.directions) == 1 else "both directions"
    speeds = ", ".join(f"{speed:.0f}" for speed in shown.speeds)
    pitches = ", ".join(f"{digits(round(pitch, 1))}" for pitch in shown.pitches)
    seconds = ", ".join(f"{digits(s, 2)} s {phase}" for phase, s in shown.seconds.items() if s > 0.0)
    turns = f", {shown.reversals} reversals without a rest" if shown.reversals else ""
    return f"{shown.moves} moves, {ways}{turns}; speeds {speeds} rad/s; pitch {pitches} deg; {seconds}"


def improve_headline(record: Improvement) -> str:
    """One line: what the simulation misses, and which rig file is handed over where that is not the extended one."""
    written = {
        "rig_file": "; the rig file as given does best on new moves",
        "refit": "; the refitted rig does best on new moves",
    }
    return _missing(record) + written.get(record.new_moves.best, "")


def _missing(record: Improvement) -> str:
    named = list(dict.fromkeys(plain(f.cause) for f in record.findings))
    rest = " and something without a name" if record.unexplained else ""
    if not named:
        return "Nothing with a name is missing" + (", but something is" if record.unexplained else "")
    return f"The simulation misses {', '.join(named)}{rest}"


def fitted(parameters: Mapping[str, Value]) -> dict[str, Value]:
    """Those that were estimated; one without an error is a choice between forms of the cause, which says nothing of its size."""
    return {name: v for name, v in parameters.items() if v.std} or dict(parameters)


def errors_words(ratios: Mapping[str, float]) -> str:
    """What becomes of the rms errors on samples that no fit saw, as the end of a sentence; "" where there are none."""
    told: dict[str, list[str]] = {"falls to": [], "rises to": [], "stays as it was": []}
    for column, ratio in ratios.items():
        name = column.split("_")[0]
        if _SAME[0] <= ratio < _SAME[1]:
            told["stays as it was"].append(f"({name})")
        else:
            told["falls to" if ratio < 1.0 else "rises to"].append(f"{100.0 * ratio:.0f} % ({name})")
    said = [f"{verb} {', '.join(what)}" for verb, what in told.items() if what]
    return f"; their rms error {', '.join(said)}" if said else ""


def identify_files(
    fit: Fit, rig: Rig, identified: Rig, by_phase: Mapping[str, Array], name: str, logs: list[str],
    note: str = "",
) -> dict[str, str]:  # fmt: skip
    """Everything that one identify report consists of, {file name: text}. by_phase: mean square of the residuals, (3,);
    note: what else to say of the logs.
    """
    drawn = learning_figures.of_identify(fit)
    page = environment().get_template("identify.html")
    html = page.render(
        fit=fit, rig=rig, name=name, logs=logs, note=_notes(note, fit.filters), figures=drawn,
        value=with_error, digits_of=to_the_error,
        versions=versions(), by_phase=by_phase, correlated=correlated(fit), left_over=left_over(fit.rmse),
        noisier=[name for name, std in identified.noise.items() if std > FAR_NOISIER * rig.noise.get(name, math.inf)],
        units={name: unit for name, (unit, _) in PARAMETERS.items()},
    )  # fmt: skip
    return {
        "identify.json": json_text(identify_json(fit)),
        "identify.html": html,
        "rig.toml": rig_toml(identified),
    }


def _notes(note: str, filters: Iterable[Filter]) -> str:
    """What else to say of the logs, one sentence after the other."""
    return ". ".join([*([note] if note else []), *map(told_filter, filters)])


def correlated(fit: Fit) -> list[tuple[str, list[float]]]:
    """Each parameter with its correlations with itself and those before it; none where there are not two."""
    names, known = [p.name for p in fit.parameters], np.asarray(fit.correlation, dtype=float)
    if len(names) < 2 or not known.size:
        return []
    return [
        (name, known[row, : row + 1].tolist() if row < len(known) else [math.nan] * (row + 1))
        for row, name in enumerate(names)
    ]


RMSE = {
    "current_a": ("current", "A"), "position_m": ("position", "m"), "speed_rad_s": ("speed", "rad/s"),
    "voltage_v": ("voltage", "V"), "force_n": ("force", "N"),
}  # fmt: skip


def left_over(rmse: dict[str, float]) -> str:
    """Root mean squares of a fit in words and handy units."""
    known = [(*RMSE[name], value) for name, value in rmse.items() if name in RMSE]
    return ", ".join(f"{name} {quantity(value, unit)}" for name, unit, value in known)


def identify_json(fit: Fit) -> dict[str, Any]:
    """The fit as plain data."""
    return {
        "schema": "observer-fi/identify/1",
        "parameters": {p.name: _fields(p) for p in fit.parameters},
        "not_identifiable": fit.not_identifiable,
        "nll_per_sample": fit.nll_per_sample,
        "rmse": fit.rmse,
        "warnings": [*map(told_filter, fit.filters), *fit.warnings],
        "correlation": {"names": [p.name for p in fit.parameters], "matrix": fit.correlation.tolist()},
    }


def _fields(parameter: Parameter) -> dict[str, Any]:
    return {k: getattr(parameter, k) for k in ("value", "std", "prior", "unit", "low", "high")}


def plain(name: str) -> str:
    """The name of a cause or parameter in words."""
    return name.replace("_", " ")
