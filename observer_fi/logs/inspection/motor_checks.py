"""What the motor says of units and signs: x' = D / Km (V - Rm i), with the rig's numbers, or with those of any motor."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from observer_fi.logs.columns import COLUMNS
from observer_fi.logs.inspection.guesses import GUESS, LIKELY, Guess
from observer_fi.logs.inspection.relations import drive_fit, follows, prefix_of, rate_of, roughness
from observer_fi.physics import Model
from observer_fi.records import Array

FOLLOWS = 0.9  # share of the variance from which one column follows another
CLEAR = 10.0  # standard errors
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
    given = {
        column: values[guess.header] * guess.scale
        for column, guess in found.items()
        if guess.header in values
    }
    doubts: list[str] = []
    if "current_a" in given and _is_magnitude(given):
        doubts.append(
            "current_a is never negative while the position goes both ways: it may be a magnitude, without its sign"
        )
    if "time_s" not in given or "position_m" not in given:
        return found, tuple(doubts)
    if "voltage_v" in given and "current_a" in given:
        found = _by_equation(found, given, model, doubts)
    if model is not None and "speed_cmd_rad_s" in given:
        now = values[found["position_m"].header] * found["position_m"].scale
        found = _by_speed(found, given, now, model, doubts)
    if "position_cmd_m" in given:
        found = _by_command(found, given, doubts)
    if "encoder_rad" in given and "speed_cmd_rad_s" in given:
        found = _encoder(found, given, doubts)
    return found, tuple(doubts)


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
    if fit.gain < 0.0:
        found = _turned(found, "position_m", "falls where the voltage is positive")
    clear = abs(fit.resistance) > CLEAR * fit.std
    if clear and fit.resistance < 0.0:
        doubts.append(
            "current_a has the sign opposite to that of the voltage (V - Rm i would need a negative Rm)"
        )
    if model is not None and model["Km"] > 0.0:
        ratio = abs(fit.gain) / (model["D"] / model["Km"])
        found = _scaled(found, "position_m", ratio, "D (V - Rm i) / Km of the rig", doubts)
        if clear and model["Rm"] > 0.0:
            found = _scaled(found, "current_a", model["Rm"] / abs(fit.resistance), "Rm of the rig", doubts)
    elif clear:
        found = _by_resistance(found, abs(fit.resistance), doubts)
    return found


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
        doubts.append(f"{column} is {ratio:.3g} times what {what} gives{hint}")
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
            "current_a": replace(guess, also=also, why=(*guess.why, f"a winding of {resistance:.2g} ohm"))
        }
    units = COLUMNS["current_a"].units
    for unit in units:
        in_ohm = resistance * units[guess.unit] / units[unit]
        if low <= in_ohm <= high and not guess.told and not found["voltage_v"].also:
            why = (*guess.why, f"a winding of {in_ohm:.2g} ohm in {unit}")
            changed = replace(guess, unit=unit, why=why, sure=LIKELY, also=_without_units(guess))
            return found | {"current_a": changed}
    doubts.append(f"voltage and current would make a winding of {resistance:.2g} ohm: is a unit wrong?")
    return found


def _by_speed(
    found: Guesses, given: Mapping[str, Array], x: Array, model: Model, doubts: list[str]
) -> Guesses:
    """A commanded speed of which the position x [m] is D times the integral: its unit, or that of a position no motor told."""
    guess, units = found["speed_cmd_rad_s"], COLUMNS["speed_cmd_rad_s"].units
    slope = rate_of(given["time_s"], x, given["speed_cmd_rad_s"] / guess.scale)
    if slope is None or slope.explained < FOLLOWS:
        return found
    wanted = abs(slope.slope) / model["D"]
    if "voltage_v" not in given and not found["position_m"].told:
        return _scaled(found, "position_m", wanted / guess.scale, "D times the commanded speed", doubts)
    unit = next((u for u, f in units.items() if abs(np.log(wanted / f)) < NEARLY), None)
    if unit is None or (guess.told and unit != guess.unit):
        share = wanted / units[guess.unit]
        doubts.append(
            f"the position goes {share:.3g} times the way that speed_cmd_rad_s and the rig's D give"
        )
        return found
    why = (*guess.why, "fits D of the rig")
    return found | {"speed_cmd_rad_s": replace(guess, unit=unit, why=why, also=_without_units(guess))}


def _by_command(found: Guesses, given: Mapping[str, Array], doubts: list[str]) -> Guesses:
    """A commanded position and a measured one: equal but for a unit, and the commanded one without noise."""
    slope = follows(given["position_cmd_m"], given["position_m"])
    if slope is None or slope.explained < FOLLOWS:
        return found
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
            f"{command.header!r} and {measured.header!r} differ by a factor of {slope.slope:.3g}: is a unit wrong?"
        )
    return found


def _encoder(found: Guesses, given: Mapping[str, Array], doubts: list[str]) -> Guesses:
    """An angle whose rate is the commanded speed, in the one unit in which it is."""
    slope = rate_of(given["time_s"], given["encoder_rad"], given["speed_cmd_rad_s"])
    guess = found["encoder_rad"]
    if slope is None or slope.explained < FOLLOWS:
        return found
    for unit, factor in COLUMNS["encoder_rad"].units.items():
        own = COLUMNS["encoder_rad"].units[guess.unit]
        if abs(np.log(abs(slope.slope) * factor / own)) < 0.2 and found["speed_cmd_rad_s"].told:
            if unit == guess.unit:
                return found
            if not guess.told:
                why = (*guess.why, f"its rate is the commanded speed in {unit}")
                return found | {"encoder_rad": replace(guess, unit=unit, why=why, also=())}
    doubts.append(f"the rate of {guess.header!r} is {slope.slope:.3g} times the commanded speed")
    return found
