"""Spreadsheets and JSON as text between tabs, which the reader of text tables takes from there."""

import datetime
import json
import os
from collections.abc import Iterable, Iterator
from typing import IO, Any

from observer_fi.errors import InvalidLogError, one_line

SPREADSHEETS = (".xlsx", ".xlsm", ".ods")
JSONS = (".json", ".jsonl", ".ndjson")
MOST_BYTES = 1 << 29  # of JSON: what stands in memory is ten times that
ALIKE = 0.5  # of the rows of the longest sheet: one that has as many may be the log as well
_BREAKS = str.maketrans("\t\r\n", "   ")


def sheet_text(stream: IO[bytes]) -> bytes:
    """The sheet of a spreadsheet that holds the log. Raises InvalidLogError where several may."""
    from python_calamine import CalamineError, CalamineWorkbook

    try:
        book = CalamineWorkbook.from_filelike(stream)
        sheets = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names
        }
    except (CalamineError, OSError) as error:
        raise InvalidLogError(
            f"not a whole spreadsheet ({one_line(error, 100)}); save it again, or export CSV"
        ) from error
    longest = max(map(len, sheets.values()), default=0)
    if longest < 2:
        raise InvalidLogError("this spreadsheet has no rows; save the sheet that holds the log")
    alike = [name for name, rows in sheets.items() if len(rows) >= ALIKE * longest]
    if len(alike) > 1:
        raise InvalidLogError(
            f"this spreadsheet has {len(alike)} tables ({', '.join(alike)[:100]}); save each by itself"
        )
    return _text(sheets[alike[0]])


def json_text(stream: IO[bytes]) -> bytes:
    """A JSON document, or one object a line, as a table whose header is all keys; what stands beside it is metadata.

    A table is an array of objects, an object of arrays of one length, the forms `records`, `list`, `columns` and `split` of
    pandas, or such a table under a key. Raises InvalidLogError for anything else.
    """
    data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise InvalidLogError(f"more than {MOST_BYTES >> 20} MB of JSON; write the log as CSV or Parquet")
    try:
        found, metadata = _document(data.decode(json.detect_encoding(data)))
    except (ValueError, RecursionError) as error:
        raise InvalidLogError(f"no JSON of a table ({one_line(error, 100)}); export the log again") from error
    columns, beside = _columns(found)
    if not columns:
        raise InvalidLogError(
            "no table in this JSON: neither an array of objects nor arrays of one length by name; export the log as CSV"
        )
    told = "".join(f"# {one_line(f'{key}: {value}', 500)}\n" for key, value in (metadata | beside).items())
    return told.encode() + _text([list(columns), *zip(*columns.values(), strict=True)])


def _text(rows: Iterable[Iterable[Any]]) -> bytes:
    """Rows of cells as lines between tabs; a row without any is a blank line."""
    lines = ("\t".join(map(_cell, row)) for row in rows)
    return "".join((line if line.strip("\t") else "") + "\n" for line in lines).encode()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return repr(value) if isinstance(value, float) else str(value).translate(_BREAKS)


def _document(text: str) -> tuple[Any, dict[str, Any]]:
    """The whole document, or the objects of its lines, and what is to be told of them. Raises ValueError that names the line."""
    try:
        return json.loads(text), {}
    except ValueError:
        lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
        if len(lines) < 2 or not all(line.lstrip().startswith("{") for _, line in lines):
            raise
    found = list(_lines(lines))
    return found, {"left out": "the last line, which is cut off"} if len(found) < len(lines) else {}


def _lines(lines: list[tuple[int, str]]) -> Iterator[Any]:
    """Objects of lines (number, text); the last one may be cut off, as where a logger is switched off."""
    for number, line in lines:
        try:
            yield json.loads(line)
        except ValueError as error:
            if number < lines[-1][0]:
                raise ValueError(f"line {number}: {error}") from error


def _columns(found: Any) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """Columns of one length by name, and what stands beside them; none where there is no table."""
    if isinstance(found, dict):
        return _columns(list(found.values())) if _counts_rows(found) else _of_members(found)
    if not isinstance(found, list) or not found:
        return {}, {}
    if all(isinstance(row, dict) for row in found):
        rows = [dict(_flat(row)) for row in found]
        return {
            key: [row.get(key) for row in rows] for key in dict.fromkeys(k for row in rows for k in row)
        }, {}
    named = isinstance(found[0], list) and all(isinstance(name, str) for name in found[0])
    return _split(found[0], found[1:]) if named else ({}, {})


def _of_members(found: dict[str, Any]) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """As `_columns`, of an object: its members are the columns, or one of them is the table."""
    if isinstance(found.get("columns"), list) and isinstance(found.get("data"), list):
        return _split(found["columns"], found["data"])
    members = dict(_flat(found))
    lists = {key: value for key, value in members.items() if isinstance(value, list) and value}
    others = {key: value for key, value in members.items() if key not in lists}
    flat = not any(isinstance(value[0], dict | list) for value in lists.values())
    if flat and len({len(value) for value in lists.values()}) == 1:
        before = os.path.commonprefix(list(lists)).rpartition(".")[0]
        return {key.removeprefix(f"{before}."): value for key, value in lists.items()}, others
    tables = [columns for value in lists.values() if (columns := _columns(value)[0])]
    return (tables[0], others) if len(tables) == 1 else ({}, {})


def _split(names: list[Any], data: list[Any]) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    """Columns of names and rows."""
    if not all(isinstance(row, list) and len(row) == len(names) for row in data):
        return {}, {}
    return {str(name): [row[k] for row in data] for k, name in enumerate(names)}, {}


def _flat(found: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Members of an object and of those within; one whose keys count rows is a list."""
    for key, value in found.items():
        if isinstance(value, dict) and _counts_rows(value):
            yield before + key, list(value.values())
        elif isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


def _counts_rows(found: dict[str, Any]) -> bool:
    """Whether the keys of an object are the numbers of rows."""
    return bool(found) and list(found) == [str(k) for k in range(len(found))]
