"""What the motor says of units and signs: x' = D / Km (V - Rm i), with the rig's numbers, or with those of any motor."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from observer_fi.logs.columns import COLUMNS
from observer_fi.logs.inspection.guesses import GUESS, LIKELY, Guess
from observer_fi.logs.inspection.relations import drive_fit, follows, prefix_of, rate_of, roughness
from observer_fi.numerics import digits
from observer_fi.physics import Model
from observer_fi.records import Array

FOLLOWS = 0.9  # share of the variance from which one column follows another
CLEAR = 10.0  # standard errors
CONSUMES = 0.5  # share of the electrical work: a load that falls gives some back
RESISTANCES = (0.02, 500.0)  # ohm, of the motors this is for
NEARLY = 0.15  # of a logarithm: the slip of a belt, the D of a data sheet
SAME = 0.98  # share of the variance: a position and its command

Guesses = dict[str, Guess]


def checked_by_motor(
    found: Guesses, values: Mapping[str, Array], model: Model | None
) -> tuple[Guesses, tuple[str, ...]]:
    """The guesses with units and signs as the motor has them, and sentences on what does not fit.

    values: (n,) numbers of the file by its headers. Units that stand in the file are never changed.
    """
    given = _in_si(found, values)
    doubts: list[str] = []
    if "current_a" in given and _is_magnitude(given):
        doubts.append(
            "current_a is never negative while the position goes both ways: it may be a magnitude, without its sign"
        )
    if "time_s" not in given or "position_m" not in given:
        return found, tuple(doubts)
    if "voltage_v" in given and "current_a" in given:
        found = _by_equation(found, given, model, doubts)
    if "speed_cmd_rad_s" in given:
        found = _by_speed(found, _in_si(found, values), model, doubts)
    if "position_cmd_m" in given:
        found = _by_command(found, _in_si(found, values), doubts)
    if "encoder_rad" in given:
        found = _encoder(found, _in_si(found, values), model, doubts)
    return found, tuple(doubts)


def _in_si(found: Guesses, values: Mapping[str, Array]) -> dict[str, Array]:
    """The columns that were guessed, in the units of the contract."""
    return {c: values[guess.header] * guess.scale for c, guess in found.items() if guess.header in values}


def _is_magnitude(given: Mapping[str, Array]) -> bool:
    """Whether the current has one sign while a position goes there and back."""
    x = given.get("position_m", given.get("position_cmd_m", np.empty(0)))
    x, i = x[np.isfinite(x)], given["current_a"][np.isfinite(given["current_a"])]
    if x.size < 8 or i.size < 8:
        return False
    span, steps = float(np.ptp(x)), np.diff(x)
    both_ways = min(float(steps[steps > 0.0].sum()), -float(steps[steps < 0.0].sum())) > 0.5 * span > 0.0
    return both_ways and float(i.min()) > -0.05 * float(i.max())


def _by_equation(
    found: Guesses, given: Mapping[str, Array], model: Model | None, doubts: list[str]
) -> Guesses:
    fit = drive_fit(given["time_s"], given["voltage_v"], given["current_a"], given["position_m"])
    if fit is None or fit.explained < FOLLOWS:
        return found
    clear = abs(fit.resistance) > CLEAR * fit.std
    gives = fit.resistance < 0.0 and _consumption(given["voltage_v"], given["current_a"]) < -CONSUMES
    if gives and fit.gain < 0.0:
        found = _turned(found, "voltage_v", "opposite to current and position")
    elif fit.gain < 0.0:
        found = _turned(found, "position_m", "falls where the voltage is positive")
    elif gives:
        found = _turned(found, "current_a", "the motor would give power, not take it")
    if model is not None and model["Km"] > 0.0:
        ratio = abs(fit.gain) / (model["D"] / model["Km"])
        found = _scaled(found, "position_m", ratio, "D (V - Rm i) / Km of the rig", doubts)
        if clear and model["Rm"] > 0.0:
            found = _scaled(found, "current_a", model["Rm"] / abs(fit.resistance), "Rm of the rig", doubts)
    elif clear:
        found = _by_resistance(found, abs(fit.resistance), doubts)
    return found


def _consumption(voltage: Array, current: Array) -> float:
    """Electrical work that a motor takes, as a share of all that goes in and out, from -1 to 1."""
    power = voltage * current
    power = power[np.isfinite(power)]
    return float(power.sum() / np.abs(power).sum()) if power.any() else 0.0


def _turned(found: Guesses, column: str, because: str) -> Guesses:
    guess = found[column]
    return found | {column: replace(guess, factor=-guess.factor, why=(*guess.why, because))}


def _scaled(found: Guesses, column: str, ratio: float, what: str, doubts: list[str]) -> Guesses:
    """A column that is `ratio` times what it should be, in another unit where that explains it."""
    guess, power = found[column], prefix_of(ratio)
    if power == 1.0:
        return found | {column: replace(guess, why=(*guess.why, f"fits {what}"), also=_without_units(guess),
                                        sure=LIKELY if guess.sure == GUESS else guess.sure)}  # fmt: skip
    units = COLUMNS[column].units
    wanted = None if power is None else units[guess.unit] / power
    unit = next((u for u, factor in units.items() if wanted and abs(factor / wanted - 1.0) < 1e-6), None)
    if unit is None or guess.told:
        hint = f": is its unit {unit}?" if unit else ": another machine, or another unit?"
        doubts.append(f"{column} is {digits(ratio)} times what {what} gives{hint}")
        return found
    return found | {column: replace(guess, unit=unit, why=(*guess.why, f"fits {what} in {unit}"), sure=LIKELY,
                                    also=_without_units(guess))}  # fmt: skip


def _without_units(guess: Guess) -> tuple[str, ...]:
    """What else a guess may be, but for its unit."""
    units = {f"or {unit}" for unit in COLUMNS[guess.column].units}
    return tuple(text for text in guess.also if text not in units)


def _by_resistance(found: Guesses, resistance: float, doubts: list[str]) -> Guesses:
    """The unit of the current in which the winding has a resistance that motors have."""
    guess = found["current_a"]
    low, high = RESISTANCES
    if low <= resistance <= high:
        other = [u for u in ("A", "mA") if u != guess.unit and f"or {u}" in guess.also]
        factor = COLUMNS["current_a"].units
        out = [u for u in other if not low <= resistance * factor[guess.unit] / factor[u] <= high]
        also = tuple(text for text in guess.also if text.removeprefix("or ") not in out)
        return found | {
            "current_a": replace(
                guess, also=also, why=(*guess.why, f"a winding of {digits(resistance, 2)} ohm")
            )
        }
    units = COLUMNS["current_a"].units
    for unit in units:
        in_ohm = resistance * units[guess.unit] / units[unit]
        if low <= in_ohm <= high and not guess.told and not found["voltage_v"].also:
            why = (*guess.why, f"a winding of {digits(in_ohm, 2)} ohm in {unit}")
            changed = replace(guess, unit=unit, why=why, sure=LIKELY, also=_without_units(guess))
            return found | {"current_a": changed}
    doubts.append(
        f"voltage and current would make a winding of {digits(resistance, 2)} ohm: is a unit wrong?"
    )
    return found


def _by_speed(found: Guesses, given: Mapping[str, Array], model: Model | None, doubts: list[str]) -> Guesses:
    """A commanded speed of which the position is D times the integral: its sign, with a rig its unit, or that of the position."""
    guess, units = found["speed_cmd_rad_s"], COLUMNS["speed_cmd_rad_s"].units
    slope = rate_of(given["time_s"], given["position_m"], given["speed_cmd_rad_s"])
    if slope is None or slope.explained < FOLLOWS:
        return found
    motor_told = "voltage_v" in given
    if slope.slope < 0.0:
        turned = "speed_cmd_rad_s" if motor_told else "position_m"
        found = _turned(found, turned, "position and commanded speed go opposite ways")
        guess = found["speed_cmd_rad_s"]
    if model is None:
        return found
    ratio = abs(slope.slope) / model["D"]
    if not motor_told and not found["position_m"].told:
        return _scaled(found, "position_m", ratio, "D times the commanded speed", doubts)
    unit = next((u for u, f in units.items() if abs(np.log(ratio * units[guess.unit] / f)) < NEARLY), None)
    if unit is None or (guess.told and unit != guess.unit):
        doubts.append(
            f"the position goes {digits(ratio)} times the way that speed_cmd_rad_s and the rig's D give"
        )
        return found
    why = (*guess.why, "fits D of the rig")
    return found | {"speed_cmd_rad_s": replace(guess, unit=unit, why=why, also=_without_units(guess))}


def _by_command(found: Guesses, given: Mapping[str, Array], doubts: list[str]) -> Guesses:
    """A commanded position and a measured one: equal but for a unit, and the commanded one without noise."""
    slope = follows(given["position_cmd_m"], given["position_m"])
    if slope is None or slope.explained < FOLLOWS:
        return found
    if slope.slope < 0.0:
        found = _turned(found, "position_cmd_m", "goes the other way than the position")
    command, measured = found["position_cmd_m"], found["position_m"]
    if (
        roughness(given["position_cmd_m"]) > 3.0 * roughness(given["position_m"]) > 0.0
        and slope.explained > SAME
    ):
        doubts.append(
            f"{command.header!r} is noisier than {measured.header!r}: are command and measurement the other way round?"
        )
    power = prefix_of(abs(slope.slope), 1.5)
    if power not in (None, 1.0):
        one, other = (measured, command) if measured.told else (command, measured)
        if not other.told:
            wanted = COLUMNS[other.column].units[other.unit] * (
                power if other is command else 1.0 / float(power or 1.0)
            )
            unit = next(
                (u for u, f in COLUMNS[other.column].units.items() if abs(f / wanted - 1.0) < 1e-6), None
            )
            if unit:
                why = (*other.why, f"as {one.header!r}")
                return found | {other.column: replace(other, unit=unit, why=why, also=_without_units(other))}
        doubts.append(
            f"{command.header!r} and {measured.header!r} differ by a factor of {digits(slope.slope)}: is a unit wrong?"
        )
    return found


def _encoder(found: Guesses, given: Mapping[str, Array], model: Model | None, doubts: list[str]) -> Guesses:
    """An angle beside the position: its sign, and its unit by the rig's D, or by a commanded speed whose unit is told."""
    guess, units = found["encoder_rad"], COLUMNS["encoder_rad"].units
    beside = follows(given["encoder_rad"], given["position_m"])
    if beside is None or beside.explained < FOLLOWS:
        return found
    if beside.slope < 0.0:
        found = _turned(found, "encoder_rad", "goes the other way than the position")
        guess = found["encoder_rad"]
    ratio = None
    if model is not None:
        ratio = abs(beside.slope) / model["D"]
    elif "speed_cmd_rad_s" in given and found["speed_cmd_rad_s"].told:
        rate = rate_of(given["time_s"], given["encoder_rad"], given["speed_cmd_rad_s"])
        ratio = (
            1.0 / abs(rate.slope) if rate is not None and rate.explained > FOLLOWS and rate.slope else None
        )
    if ratio is None:
        return found
    unit = next((u for u, f in units.items() if abs(np.log(ratio * units[guess.unit] / f)) < NEARLY), None)
    if unit is None or (guess.told and unit != guess.unit):
        what = "the rig's D" if model is not None else "the commanded speed"
        doubts.append(f"{guess.header!r} turns {digits(1.0 / ratio)} times as far as {what} gives")
        return found
    why = (*guess.why, "fits D of the rig" if model is not None else "its rate is the commanded speed")
    return found | {"encoder_rad": replace(guess, unit=unit, why=why, also=_without_units(guess))}
