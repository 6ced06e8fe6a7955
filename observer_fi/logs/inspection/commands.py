"""Commands told from readings: a command has no noise, a position follows its own, and the rate of a position that of a speed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from observer_fi.logs.inspection.contents import Column
from observer_fi.logs.inspection.guesses import GUESS, LIKELY, Guess
from observer_fi.logs.inspection.relations import follows, leads, rate_of, roughness
from observer_fi.logs.inspection.sizes import unit_by_values
from observer_fi.logs.inspection.vocabulary import Header, understood
from observer_fi.records import Array

FOLLOWS = 0.9  # share of the variance
ALIKE = 0.98  # of a position and its command under headers that say nothing
STRAIGHT = 0.5  # share of second differences of a command that are next to nothing
AHEAD = 0.5  # correlation of what a position is behind with its speed
SMOOTHER = 3.0  # times, what a command is than a reading

Guesses = dict[str, Guess]


def with_commands(found: Guesses, columns: Sequence[Column]) -> Guesses:
    """The guesses with what columns show of each other: commands of speed and position, and a position beside its command."""
    values = {c.header: c.values for c in columns if _moves(c.values)}
    heard = {c.header: understood(c.header, c.unit) for c in columns if c.header in values}
    found = _pair(found, values, heard)
    clock, position = found.get("time_s"), found.get("position_m")
    if position is None or position.header not in values:
        return found
    x = values[position.header] * position.scale
    found = _position_command(found, values, x)
    if clock is None or clock.header not in values or "speed_cmd_rad_s" in found:
        return found
    t = values[clock.header] * clock.scale
    taken = {guess.header for guess in found.values()}
    for header, h in heard.items():
        if (
            header in taken
            or h.deviation
            or h.measured
            or not _may_be_speed(h)
            or not _is_command(values[header])
        ):
            continue
        slope = rate_of(t, x, values[header])
        if slope is not None and slope.explained > FOLLOWS:
            return found | {"speed_cmd_rad_s": _speed_guess(header, h, values[header])}
    return found


def _may_be_speed(header: Header) -> bool:
    return header.unit is None and (not header.quantities or "speed" in header.quantities)


def _speed_guess(header: str, h: Header, values: Array) -> Guess:
    unit, also, because = unit_by_values("speed_cmd_rad_s", values, h)
    why = ("the rate of the position follows it", "no noise", because)
    return Guess("speed_cmd_rad_s", header, unit, why=why, sure=LIKELY if h.commanded else GUESS, also=also)


def _position_command(found: Guesses, values: Mapping[str, Array], x: Array) -> Guesses:
    """Without what was taken for the command of a position that does not follow it."""
    guess = found.get("position_cmd_m")
    if guess is None or guess.header not in values or guess.told or "name" not in guess.why:
        return found
    slope = follows(values[guess.header], x)
    if slope is None or slope.explained < FOLLOWS:
        return {column: other for column, other in found.items() if column != "position_cmd_m"}
    why = tuple(dict.fromkeys((*guess.why, "the position follows it")))
    return found | {"position_cmd_m": replace(guess, why=why, sure=LIKELY)}


def _pair(found: Guesses, values: Mapping[str, Array], heard: Mapping[str, Header]) -> Guesses:
    """Two columns of headers that say nothing, equal but for noise: a position and its command."""
    if "position_m" in found or "position_cmd_m" in found:
        return found
    taken = {guess.header for guess in found.values()}
    silent = [
        h
        for h, u in heard.items()
        if h not in taken and not u.quantities and u.unit is None and not u.deviation
    ]
    for k, one in enumerate(silent):
        for other in silent[k + 1 :]:
            slope = follows(values[one], values[other])
            if slope is None or slope.explained < ALIKE or not 0.9 < slope.slope < 1.1:
                continue
            command, measured = _command_first(one, other, values)
            if not command:
                continue
            unit, also, because = unit_by_values("position_m", values[measured], heard[measured])
            pair = {"position_m": measured, "position_cmd_m": command}
            why = {"position_m": f"follows {command}", "position_cmd_m": f"{measured} follows it"}
            return found | {
                c: Guess(c, h, unit, why=(why[c], because), sure=GUESS, also=also) for c, h in pair.items()
            }
    return found


def _command_first(one: str, other: str, values: Mapping[str, Array]) -> tuple[str, str]:
    """The two with the command first: it leads, or has no noise; empty where neither tells."""
    ahead = leads(values[one], values[other])
    if abs(ahead) > AHEAD:
        return (one, other) if ahead > 0.0 else (other, one)
    rough = {h: roughness(values[h]) for h in (one, other)}
    command, measured = sorted((one, other), key=lambda h: rough[h])
    return (command, measured) if rough[measured] > SMOOTHER * rough[command] else ("", "")


def _is_command(values: Array) -> bool:
    """Whether a column goes in straight lines, as no reading does."""
    known = values[np.isfinite(values)]
    bends = np.abs(np.diff(known, 2))
    return bool(bends.size and np.mean(bends < 1e-4 * float(np.ptp(known))) > STRAIGHT)


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 0.5 * values.size and float(np.ptp(known)) > 0.0
