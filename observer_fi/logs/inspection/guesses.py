"""Which column of the contract each column of a file may be: by its name, its unit, its values, and why."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from observer_fi.logs.columns import COLUMNS, STAMPS, ColumnMap
from observer_fi.logs.inspection.contents import Column, Contents, columns_by_header
from observer_fi.logs.inspection.sizes import (
    LARGE,
    NOISY_M,
    RATES,
    Steady,
    noise_of,
    steady,
    time_unit,
    unit_by_values,
)
from observer_fi.logs.inspection.vocabulary import Header, Unit, understood
from observer_fi.numerics import digits
from observer_fi.records import Array

SURE, LIKELY, GUESS = "sure", "likely", "a guess"
LEAST = 1.4  # points from which a column is taken for a quantity: a letter alone
NEAR = 1.0  # points by which a rival may be behind
BY_NAME, BY_UNIT, CLASH, STEADY = 3.0, 3.0, -6.0, 2.0
_EPOCHS = {
    "s": (8e8, 2.6e9),
    "ms": (8e11, 2.6e12),
    "us": (8e14, 2.6e15),
    "ns": (8e17, 2.6e18),
}  # 1995 to 2052
_DAYS = {"Excel": (3e4, 6e4), "MATLAB": (7e5, 8e5)}  # days that programs count
DAY_S = 86_400.0
_OF_UNIT = {
    "time": ("time_s",), "voltage": ("voltage_v",), "current": ("current_a",), "length": ("position_m", "position_cmd_m"),
    "angle": ("pitch_deg", "encoder_rad"), "turns": ("encoder_rad",), "speed": ("speed_cmd_rad_s",),
    "force": ("force_cmd_n", "load_n"),
}  # fmt: skip
_OF_WORD = {
    "time": "time_s", "voltage": "voltage_v", "current": "current_a", "pitch": "pitch_deg", "angle": "encoder_rad",
    "load": "load_n", "force": "force_cmd_n",
}  # fmt: skip


@dataclass(frozen=True)
class Guess:
    """A column of the contract and what in a file may be it.

    why: what speaks for it. sure: sure, likely or a guess. also: what else it may be, in words. told: its unit stands in the
    file.
    """

    column: str
    header: str
    unit: str
    factor: float = 1.0
    why: tuple[str, ...] = ()
    sure: str = GUESS
    also: tuple[str, ...] = ()
    told: bool = False
    time_of_day: str | None = None

    @property
    def scale(self) -> float:
        """Factor from the numbers in the file to the unit of the contract."""
        return COLUMNS[self.column].units[self.unit] * self.factor


@dataclass(frozen=True)
class Named:
    """A column with what its header says, and how well it would be each column of the contract, in points."""

    column: Column
    header: Header
    points: dict[str, float] = field(default_factory=dict)


def guesses(contents: Contents, column_map: ColumnMap | None = None) -> dict[str, Guess]:
    """The best guess for each column of the contract that the file may hold; what a map says is taken as it is."""
    given = _given(contents, column_map)
    taken = {guess.header for guess in given.values()} | {guess.time_of_day for guess in given.values()}
    named = [_named(c) for c in columns_by_header(contents) if c.header not in taken]
    found = dict(given)
    pairs = sorted(
        (
            (points, n.column.header, column, n)
            for n in named
            for column, points in n.points.items()
            if points >= LEAST
        ),
        key=lambda pair: (-pair[0], pair[2] == "load_n"),
    )
    for points, header, column, one in pairs:
        if column in found or header in taken:
            continue
        rivals = [
            f"{o.column.header} may be it too" for o in named
            if o is not one and o.column.header not in taken and o.points.get(column, 0.0) > points - NEAR
        ]  # fmt: skip
        others = [
            f"or {other}"
            for other, p in one.points.items()
            if other != column and p > points - NEAR and other not in found
        ]
        guess = _unit_guess(column, one, contents)
        found[column] = _judged(replace(guess, also=(*guess.also, *others, *rivals[:2])), points)
        taken.add(header)
    return _with_time_of_day(found, named)


def _given(contents: Contents, column_map: ColumnMap | None) -> dict[str, Guess]:
    if column_map is None:
        return {}
    headers = {column.header for column in contents.columns}
    found = {}
    for name, source in column_map.columns.items():
        if source.header in headers:
            unit, factor = _unit_of_map(name, source.factor)
            unit = STAMPS if source.stamps else f"epoch {unit}" if source.epoch else unit
            found[name] = Guess(
                name, source.header, unit, factor, ("by the map",), SURE, (), True, source.time_of_day
            )
    return found


def _unit_of_map(name: str, factor: float) -> tuple[str, float]:
    """The unit of which a factor is one, and what is left of it."""
    kind = COLUMNS[name]
    for unit, own in kind.units.items():
        if abs(abs(factor) / own - 1.0) < 1e-12:
            return unit, float(np.sign(factor))
    return kind.unit, factor


def _named(column: Column) -> Named:
    header = understood(column.header, column.unit)
    lower = column.header.strip().casefold()
    if lower in COLUMNS:
        return Named(column, header, {lower: 20.0})
    if column.strange > 0.5 or header.deviation:
        return Named(column, header)
    points = _points(header)
    clock = steady(column.values)
    if "time_s" in points or clock is not None or column.stamps:
        points["time_s"] = points.get("time_s", 0.0) + _as_clock(column, clock, header)
    if column.stamps:
        points = {"time_s": points["time_s"]}
    if "pitch_deg" in points and _turns(column.values, header):
        points["pitch_deg"] += CLASH
    return Named(column, header, points)


def _turns(values: Array, header: Header) -> bool:
    """Whether an angle goes further than a vehicle pitches."""
    known = np.abs(values[np.isfinite(values)])
    in_rad = header.unit is not None and header.unit.unit == "rad"
    factor = header.unit.factor if header.unit is not None else 1.0
    return bool(known.size and float(known.max()) * factor > (1.6 if in_rad else 90.0))


def _as_clock(column: Column, clock: Steady | None, header: Header) -> float:
    """Points for a column to be the clock, by its values."""
    if column.stamps:
        return BY_UNIT
    if clock is None:
        return (
            2.0 * CLASH
            if column.values.size > 1 and np.nanmin(np.diff(column.values), initial=0.0) < 0.0
            else -1.0
        )
    counts_rows = "number" in header.quantities and "time" not in header.quantities
    return -0.5 if counts_rows else STEADY if header.unit is None or header.unit.of == "time" else CLASH


def _points(header: Header) -> dict[str, float]:
    """Points for each column of the contract, by the words and the unit of a header."""
    points: dict[str, float] = {}
    of = header.unit.of if header.unit else None
    for quantity, share in header.quantities.items():
        column = _column_of(quantity, header)
        if column is not None:
            clash = of is not None and column not in _OF_UNIT.get(of, ())
            points[column] = max(points.get(column, -9.0), BY_NAME * share + (CLASH if clash else 0.0))
    for column in _OF_UNIT.get(of or "", ()):
        if _other_way(column, header):
            continue
        points[column] = (
            points.get(column, 0.0) + BY_UNIT - (0.0 if column in points or not header.quantities else 2.0)
        )
    if of in ("angle", "turns") and "position" in header.quantities and not header.commanded:
        points["encoder_rad"] = points.get("encoder_rad", 0.0) + 0.5 * BY_NAME  # the position of a motor
    if header.commanded and "voltage_v" in points:
        points["voltage_v"] -= NEAR  # a measured one is better
    if not header.quantities and header.commanded and of is None:
        points["position_cmd_m"] = 0.5 * BY_NAME
    return points


def _other_way(column: str, header: Header) -> bool:
    """Whether a header says that it is no command where the column is one, or the other way round."""
    if column in ("position_cmd_m", "speed_cmd_rad_s"):
        return not header.commanded
    return header.commanded and column in ("position_m", "current_a", "encoder_rad", "pitch_deg", "load_n")


def _column_of(quantity: str, header: Header) -> str | None:
    if quantity == "position":
        return "position_cmd_m" if header.commanded else "position_m"
    if quantity == "speed":
        return "speed_cmd_rad_s" if header.commanded else None
    column = _OF_WORD.get(quantity)
    return None if column is None or _other_way(column, header) else column


def _judged(guess: Guess, points: float) -> Guess:
    """The guess with how sure it is."""
    if points >= 15.0:
        return replace(guess, sure=SURE)
    if guess.column in ("load_n", "force_cmd_n") and not guess.told:
        return guess
    sure = SURE if points >= BY_NAME + BY_UNIT - 1.6 and guess.told else LIKELY if points >= 2.5 else GUESS
    return replace(guess, sure=LIKELY if guess.also and sure == SURE else sure)


# --- units ---------------------------------------------------------------------------------------


def _unit_guess(column: str, one: Named, contents: Contents) -> Guess:
    header, unit = one.column.header, one.header.unit
    why: list[str] = []
    if header.casefold() == column:
        return Guess(column, header, COLUMNS[column].unit, why=("by the contract's name",), told=True)
    if one.header.quantities or one.header.commanded:
        why.append("name")
    if column == "time_s":
        return _time_guess(one, contents, why)
    if unit is not None and unit.unit in COLUMNS[column].units:
        return Guess(
            column, header, unit.unit, unit.factor, (*why, f"unit {one.header.unit_text}"), told=True
        )
    chosen, also, because = unit_by_values(column, one.column.values, one.header)
    return Guess(column, header, chosen, 1.0, (*why, because), also=also)


def implausible(found: dict[str, Guess], values: Mapping[str, Array]) -> tuple[str, ...]:
    """Doubts on units that stand in the file, or in the name of the contract, where values are too large for them."""
    said = []
    for column, guess in found.items():
        if column not in LARGE or guess.header not in values or not guess.told:
            continue
        known = values[guess.header][np.isfinite(values[guess.header])] * guess.scale
        own, position = COLUMNS[column].unit, column.startswith("position")
        top = float(np.ptp(known)) if position and known.size else float(np.abs(known).max(initial=0.0))
        noise = noise_of(known) if position else 0.0
        if top > LARGE[column][0] or noise > NOISY_M:
            what = f"{'spans' if position else 'reaches'} {digits(top, 4)} {own}"
            what += f" with a noise of {digits(noise, 2)} {own}" if noise > NOISY_M else ""
            said.append(f"{column} {what}: is {guess.header!r} really in {guess.unit}?")
    return tuple(said)


def _time_guess(one: Named, contents: Contents, why: list[str]) -> Guess:
    column, header = one.column, one.header
    if column.stamps:
        return Guess("time_s", column.header, STAMPS, why=(*why, "time stamps"), told=True)
    why.append("increases steadily" if steady(column.values) else "")
    why = [text for text in why if text]
    unit: Unit | None = header.unit
    first = float(column.values[np.isfinite(column.values)][0]) if np.isfinite(column.values).any() else 0.0
    for name, (low, high) in _EPOCHS.items():
        if low < first < high and (unit is None or unit.unit == name):
            return Guess(
                "time_s",
                column.header,
                f"epoch {name}",
                1.0,
                (*why, f"counts from 1970 in {name}"),
                told=unit is not None,
            )
    if unit is not None and unit.of == "time":
        return Guess("time_s", column.header, unit.unit, 1.0, (*why, f"unit {header.unit_text}"), told=True)
    steps = steady(column.values)
    for program, (low, high) in _DAYS.items():
        if low < first < high and steps is not None and RATES[0] < 1.0 / (steps.step * DAY_S) < RATES[1]:
            return Guess(
                "time_s", column.header, "s", DAY_S, (*why, f"days as {program} counts them"), LIKELY
            )
    chosen, also, because = time_unit(column.values)
    return Guess("time_s", column.header, chosen, 1.0, (*why, because), also=also)


def _with_time_of_day(found: dict[str, Guess], named: list[Named]) -> dict[str, Guess]:
    """A clock whose date and time of day stand in two columns."""
    clock = found.get("time_s")
    if clock is None or clock.unit != STAMPS or clock.time_of_day:
        return found
    stamped = [n.column for n in named if n.column.stamps]
    dates = [c for c in stamped if c.texts and ":" not in c.texts[0]]
    days = [
        c
        for c in stamped
        if c.texts and ":" in c.texts[0] and not any(mark in c.texts[0].split(":")[0] for mark in "-./")
    ]
    if not dates:
        return found
    if days:
        joined = replace(
            clock,
            header=dates[0].header,
            time_of_day=days[0].header,
            why=(*clock.why, "date and time of day"),
        )
        return found | {"time_s": joined}
    return found
