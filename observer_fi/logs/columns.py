"""Column maps: how the headers, units and separators of a foreign log become the columns of this project.

A map is a small TOML file; docs/logs.md explains it and data/columns holds one example of each kind.
"""

import codecs
import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.physics import unknown_name

T = TypeVar("T")


class Kind(NamedTuple):
    """A column's own unit, units it may come in with their factors, and the largest believable value."""

    unit: str
    units: dict[str, float]
    limit: float


_SPEEDS = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "rev/s": 2.0 * math.pi}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}

# Limits are far beyond any actuator this is for: what exceeds them is a fault of the logger.
COLUMNS: dict[str, Kind] = {
    "time_s": Kind("s", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}, math.inf),
    "voltage_v": Kind("V", {"V": 1.0, "mV": 1e-3}, 1e3),
    "current_a": Kind("A", {"A": 1.0, "mA": 1e-3, "uA": 1e-6}, 1e3),
    "position_m": Kind("m", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}, 1e2),
    "pitch_deg": Kind("deg", {"deg": 1.0, "rad": 180.0 / math.pi}, 180.0),
    "speed_cmd_rad_s": Kind("rad/s", _SPEEDS, 1e5),
    "encoder_rad": Kind("rad", _ANGLES, 1e9),
    "position_cmd_m": Kind("m", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}, 1e2),
    "force_cmd_n": Kind("N", {"N": 1.0, "mN": 1e-3, "kN": 1e3}, 1e6),
}
_SYMBOLS = str.maketrans({"µ": "u", "μ": "u", "°": "deg"})


class Source(NamedTuple):
    """Where a column comes from: header in the file, and the factor from its unit to that of the contract."""

    header: str
    factor: float = 1.0


@dataclass(frozen=True)
class ColumnMap:
    """How to read a log. `columns` holds what the map names; other columns keep the name of the contract.

    separator, decimal_comma: None finds them from the file. header_line, data_line: 1 is the first line of
    the file; None takes the first line that is no comment, and the one after it.
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
_ENTRY = ("header", "unit", "factor")
_NAMED_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}


def load_columns(path: str | Path) -> ColumnMap:
    """The column map of a TOML file. Raises UsageError naming the file, the key and the right keys."""
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(
            f"{path}: cannot read the column map ({error.strerror}); give a TOML file as in data/columns"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a TOML file: {error}") from error
    try:
        return columns_from_table(table)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def columns_from_table(table: dict[str, object]) -> ColumnMap:
    """The column map of a parsed TOML table. Raises UsageError."""
    for key in table:
        if key not in _TOP:
            raise unknown_name(key, _TOP, "key")
    columns = _table(table, "columns")
    limits = _table(table, "limits")
    for name in (*columns, *limits):
        if name not in COLUMNS:
            raise unknown_name(name, tuple(COLUMNS), "column")
    found = ColumnMap(
        {name: _source(name, entry) for name, entry in columns.items()},
        _separator(table.get("separator")),
        _typed(table, "decimal_comma", bool),
        _typed(table, "header_line", int),
        _typed(table, "data_line", int),
        _encoding(_typed(table, "encoding", str)),
        _tokens(table.get("missing", [])),
        {name: _number(f"limits.{name}", value) for name, value in limits.items()},
    )
    _check(found)
    return found


def _check(found: ColumnMap) -> None:
    if found.decimal_comma and found.separator == ",":
        raise UsageError('separator "," and decimal_comma = true exclude each other')
    if found.header_line is not None and found.header_line < 1:
        raise UsageError(f"header_line must be 1 or more (1 is the first line), got {found.header_line}")
    if found.data_line is not None and found.data_line <= (found.header_line or 1):
        raise UsageError(f"data_line must come after the header line, got {found.data_line}")
    headers = [source.header for source in found.columns.values()]
    for header in headers:
        if headers.count(header) > 1:
            raise UsageError(f"header {header!r} is mapped to two columns")


def _source(name: str, entry: object) -> Source:
    if isinstance(entry, str):
        return Source(entry)
    if not isinstance(entry, dict):
        raise UsageError(f'{name}: give a header, or {{ header = "...", unit = "..." }}, got {entry!r}')
    for key in entry:
        if key not in _ENTRY:
            raise unknown_name(key, _ENTRY, f"key of {name}")
    kind = COLUMNS[name]
    header, unit = entry.get("header", name), entry.get("unit", kind.unit)
    if not isinstance(header, str) or not isinstance(unit, str):
        raise UsageError(f"{name}: header and unit must be texts")
    plain = unit.translate(_SYMBOLS)
    if plain not in kind.units:
        raise unknown_name(unit, tuple(kind.units), f"unit for {name}")
    return Source(header, kind.units[plain] * _number(f"{name}: factor", entry.get("factor", 1.0)))


def _number(what: str, value: object) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not math.isfinite(value)
        or value == 0
    ):
        raise UsageError(f"{what} must be a number other than 0, got {value!r}")
    return float(value)


def _separator(value: object) -> str | None:
    if value is None:
        return None
    text = _NAMED_SEPARATORS.get(value, value) if isinstance(value, str) else value
    if not isinstance(text, str) or len(text) != 1:
        raise UsageError(f'separator must be one character, "tab", "comma" or "semicolon", got {value!r}')
    return text


def _encoding(name: str | None) -> str | None:
    try:
        codecs.lookup(name or "utf-8")
    except LookupError as error:
        raise UsageError(
            f'there is no encoding {name!r} (usual ones: "utf-8", "cp1252", "utf-16")'
        ) from error
    return name


def _typed(table: dict[str, object], key: str, kind: type[T]) -> T | None:
    value = table.get(key)
    if value is None or (isinstance(value, kind) and not (kind is int and isinstance(value, bool))):
        return value
    raise UsageError(f"{key} must be a {kind.__name__}, got {value!r}")


def _table(table: dict[str, object], key: str) -> dict[str, object]:
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise UsageError(f"[{key}] must be a table, got {value!r}")
    return value


def _tokens(value: object) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(token, str) for token in value):
        raise UsageError(f"missing must be a list of texts that stand for no value, got {value!r}")
    return tuple(value)


def missing_column(path: str, column: str, headers: list[str], column_map: ColumnMap) -> InvalidLogError:
    """The one line for a log that lacks a column: which, what exists, and what to do."""
    wanted = column_map.source(column).header
    what = f"column {column}" if wanted == column else f"column {column} (mapped to header {wanted!r})"
    near = _look_alike(column, headers)
    entry = f'{column} = {{ header = "{near or "..."}", unit = "{_unit_of(column, near)}" }}'
    shown = ", ".join(headers[:20]) + (", ..." if len(headers) > 20 else "")
    return InvalidLogError(
        f"{path}: {what} is missing; the columns are: {shown}; map it with --columns map.toml, "
        f"for example {entry}"
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
