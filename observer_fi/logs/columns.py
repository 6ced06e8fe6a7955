"""Column maps: how the headers, units and separators of a foreign log become the columns of this project.

A map is a small TOML file; docs/logs.md explains it and data/columns holds one example of each kind.
"""

import codecs
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.physics import unknown_name
from observer_fi.settings import checked, toml_table

MOST_HEADER_LINES = 10_000  # lines before the first sample of a text table


class Kind(NamedTuple):
    """A column's own unit, units it may come in with their factors, and the largest believable value."""

    unit: str
    units: dict[str, float]
    limit: float


_SPEEDS = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605}

_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
STAMPS = "datetime"  # the unit of time stamps as texts, or of a type of the file's own
_ABSOLUTE = {STAMPS: 1.0} | {f"epoch {unit}": factor for unit, factor in _TIMES.items()}

# Limits are far beyond any actuator this is for: what exceeds them is a fault of the logger.
COLUMNS: dict[str, Kind] = {
    "time_s": Kind("s", {**_TIMES, "min": 60.0, **_ABSOLUTE}, 1e11),
    "voltage_v": Kind("V", {"V": 1.0, "mV": 1e-3}, 1e3),
    "current_a": Kind("A", {"A": 1.0, "mA": 1e-3, "uA": 1e-6}, 1e4),
    "position_m": Kind("m", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}, 1e2),
    "pitch_deg": Kind("deg", {"deg": 1.0, "rad": 180.0 / math.pi}, 180.0),
    "speed_cmd_rad_s": Kind("rad/s", _SPEEDS, 1e5),
    "encoder_rad": Kind("rad", _ANGLES, 1e9),
    "position_cmd_m": Kind("m", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}, 1e2),
    "force_cmd_n": Kind("N", _FORCES, 1e6),
    "load_n": Kind("N", _FORCES, 1e6),
}
_SYMBOLS = str.maketrans({"µ": "u", "μ": "u", "°": "deg"})


class Source(NamedTuple):
    """Where a column comes from: header in the file, and the factor from its unit to that of the contract.

    stamps: its fields are dates and times of day, the latter under the header time_of_day, if that is not None. epoch: its
    numbers count from 1970 on. Of either the log begins at zero.
    """

    header: str
    factor: float = 1.0
    stamps: bool = False
    epoch: bool = False
    time_of_day: str | None = None


@dataclass(frozen=True)
class ColumnMap:
    """How to read a log. `columns` holds what the map names; other columns keep the name of the contract.

    separator, decimal_comma: None finds them from the file. header_line, data_line: 1 is the first line of
    the file; None takes the first line that is no comment, and the one after it. header_line 0: there is no
    header, and columns are called by their numbers, "1" the first.
    """

    columns: dict[str, Source] = field(default_factory=dict)
    separator: str | None = None
    decimal_comma: bool | None = None
    header_line: int | None = None
    data_line: int | None = None
    encoding: str | None = None
    missing: tuple[str, ...] = ()
    limits: dict[str, float] = field(default_factory=dict)

    def source(self, column: str) -> Source:
        """Header and factor of a column of the contract."""
        return self.columns.get(column, Source(column))

    def limit(self, column: str) -> float:
        """Largest believable magnitude, in the unit of the contract."""
        return self.limits.get(column, COLUMNS[column].limit)


PLAIN = ColumnMap()

_TOP = ("separator", "decimal_comma", "header_line", "data_line", "encoding", "missing", "columns", "limits")
_ENTRY = ("header", "unit", "factor", "time_of_day")
_NAMED_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
_PART_OF_NUMBERS = "+-.\"'#_eE0123456789"
_SAMPLE = "time_s;1,5\n-2.5e-3\t"


def load_columns(path: str | Path) -> ColumnMap:
    """The column map of a TOML file. Raises UsageError naming the file, the key and the right keys."""
    table = toml_table(path, "column map", "data/columns")
    try:
        return columns_from_table(table)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def columns_of(given: "str | Path | Mapping[str, Any] | ColumnMap | None") -> ColumnMap:
    """A column map however it is given: as one, as its file, or as what stands under [columns] of such a file, by column a
    header or {"header": ..., "unit": ..., "factor": ...}. Raises UsageError.
    """
    if given is None or isinstance(given, ColumnMap):
        return given or PLAIN
    if isinstance(given, Mapping):
        return columns_from_table({"columns": dict(given)})
    return load_columns(given)


def columns_from_table(table: dict[str, Any]) -> ColumnMap:
    """The column map of a parsed TOML table. Raises UsageError."""
    _check_names(table)
    file = checked(_map_file(), table)
    found = ColumnMap(
        {name: _source(name, entry) for name, entry in file.columns.items()},
        _separator(file.separator),
        file.decimal_comma,
        file.header_line,
        file.data_line,
        _encoding(file.encoding),
        tuple(file.missing),
        dict(file.limits),
    )
    _check(found)
    return found


@cache
def _map_file() -> Any:
    """The pydantic model of a column map (made on use: most logs need none)."""
    from pydantic import BaseModel, ConfigDict, Field, field_validator

    text = Annotated[str, Field(min_length=1, max_length=1000)]

    class Entry(BaseModel):
        model_config = ConfigDict(strict=True, extra="forbid")
        header: text | None = None  # type: ignore[valid-type]
        unit: str | None = None
        time_of_day: text | None = None  # type: ignore[valid-type]
        factor: Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)] = 1.0

    class MapFile(BaseModel):
        model_config = ConfigDict(strict=True, extra="forbid")
        separator: str | None = None
        decimal_comma: bool | None = None
        header_line: Annotated[int, Field(ge=0, le=MOST_HEADER_LINES)] | None = None
        data_line: Annotated[int, Field(ge=1, le=MOST_HEADER_LINES)] | None = None
        encoding: str | None = None
        missing: Annotated[list[text], Field(max_length=1000)] = []  # type: ignore[valid-type]
        columns: dict[str, Entry] = {}
        limits: dict[str, Annotated[float, Field(gt=0.0, le=1e15, allow_inf_nan=False)]] = {}

        @field_validator("columns", mode="before")
        @classmethod
        def _headers_alone(cls, given: Any) -> Any:
            if not isinstance(given, dict):
                return given
            return {name: _entry(name, entry) for name, entry in given.items()}

    return MapFile


def _entry(name: str, given: Any) -> Any:
    if isinstance(given, str):
        return {"header": given}
    if not isinstance(given, dict):
        raise ValueError(
            f'columns.{name}: give a header, or {{ header = "...", unit = "..." }}, got {given!r:.80}'
        )
    return given


def _check_names(table: dict[str, Any]) -> None:
    """A misspelt key, column or part of an entry is an error that lists the right ones."""
    for key in table:
        if key not in _TOP:
            raise unknown_name(key, _TOP, "key")
    for part in ("columns", "limits"):
        entries = table.get(part, {})
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            if name not in COLUMNS:
                raise unknown_name(name, tuple(COLUMNS), "column")
            for key in entry if isinstance(entry, dict) and part == "columns" else ():
                if key not in _ENTRY:
                    raise unknown_name(key, _ENTRY, f"key of {name}")


def _check(found: ColumnMap) -> None:
    if found.decimal_comma and found.separator == ",":
        raise UsageError('separator "," and decimal_comma = true exclude each other')
    least = 1 if found.header_line is None else found.header_line
    if found.data_line is not None and found.data_line <= least:
        raise UsageError(f"data_line must come after the header line, got {found.data_line}")
    headers = [source.header for source in found.columns.values()]
    for header in headers:
        if headers.count(header) > 1:
            raise UsageError(f"header {header!r} is mapped to two columns")


def _source(name: str, entry: Any) -> Source:
    kind = COLUMNS[name]
    unit = kind.unit if entry.unit is None else entry.unit
    plain = unit.translate(_SYMBOLS)
    if plain not in kind.units:
        raise unknown_name(unit, tuple(kind.units), f"unit for {name}")
    if abs(entry.factor) < 1e-15 or (name == "time_s" and entry.factor < 0.0):
        wanted = "above 0" if name == "time_s" else "other than 0"
        raise UsageError(f"columns.{name}.factor must be a number {wanted}, got {entry.factor!r}")
    stamps = plain == STAMPS
    if entry.time_of_day is not None and not stamps:
        raise UsageError(
            f'columns.{name}.time_of_day: only of time_s with unit = "{STAMPS}", beside the header of the date'
        )
    if stamps and entry.factor != 1.0:
        raise UsageError(
            f'columns.{name}.factor: time stamps (unit = "{STAMPS}") have none, got {entry.factor!r}'
        )
    factor, epoch = kind.units[plain] * entry.factor, plain.startswith("epoch")
    return Source(entry.header or name, factor, stamps, epoch, entry.time_of_day)


def _separator(text: str | None) -> str | None:
    found = _NAMED_SEPARATORS.get(text or "", text)
    if found is None:
        return None
    if (
        len(found) != 1
        or not found.isascii()
        or found in _PART_OF_NUMBERS
        or ord(found) < 9
        or found in "\r\n"
    ):
        raise UsageError(
            f'separator must be one character that is no part of a number, "tab", "comma" or "semicolon", got {text!r}'
        )
    return found


def _encoding(name: str | None) -> str | None:
    """The name, if text in that encoding can be read piece by piece; it must give back what was written."""
    if name is None:
        return None
    try:
        raw = _SAMPLE.encode(name)
        decoder = codecs.getincrementaldecoder(name)()
        pieces = [decoder.decode(raw[k : k + 1], k + 1 == len(raw)) for k in range(len(raw))]
        known_as = codecs.lookup(name).name.replace("_", "-")
        usable = "".join(pieces).lstrip("\ufeff") == _SAMPLE and known_as not in _NOT_FOR_FILES
    except (LookupError, ValueError, TypeError, AttributeError, AssertionError):
        usable = False
    if not usable:
        raise UsageError(f'there is no encoding {name!r} (usual ones: "utf-8", "cp1252", "utf-16")')
    return name


_NOT_FOR_FILES = ("unicode-escape", "raw-unicode-escape", "idna", "punycode", "undefined")


def missing_column(path: str, column: str, headers: list[str], column_map: ColumnMap) -> InvalidLogError:
    """The one line for a log that lacks a column: which, what exists, and what to do."""
    wanted = column_map.source(column).header
    what = f"column {column}" if wanted == column else f"column {column} (mapped to header {wanted!r})"
    near = _look_alike(column, headers)
    entry = f'{column} = {{ header = "{near or "..."}", unit = "{_unit_of(column, near)}" }}'
    shown = ", ".join(headers[:20]) + (", ..." if len(headers) > 20 else "")
    return InvalidLogError(
        f"{path}: {what} is missing; the columns are: {shown}; map it with --columns map.toml (in Python columns=), "
        f"for example {entry}; observer-fi inspect --write makes a whole map"
    )


def _look_alike(column: str, headers: list[str]) -> str | None:
    word = column.split("_")[0]
    return next((header for header in headers if word in header.lower()), None)


def _unit_of(column: str, header: str | None) -> str:
    tail = (
        (header or "")
        .translate(_SYMBOLS)
        .replace("[", "_")
        .replace("(", "_")
        .strip(" ])")
        .split("_")[-1]
        .lower()
    )
    kind = COLUMNS[column]
    return next((unit for unit in kind.units if unit.lower() == tail), kind.unit)
