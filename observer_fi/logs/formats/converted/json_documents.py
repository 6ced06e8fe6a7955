"""JSON documents, and JSON with an object a line."""

import json
import os
from collections.abc import Iterable, Iterator
from typing import Any

from observer_fi.errors import InvalidLogError, one_line
from observer_fi.logs.formats.converted.cells import at_most, text_of

JSONS = (".json", ".jsonl", ".ndjson")


def json_text(pieces: Iterable[bytes]) -> bytes:
    """A JSON document, or one object a line, as a table whose header is all keys; what stands beside it is metadata.

    A table is an array of objects, an object of arrays of one length, the forms `records`, `list`, `columns` and `split` of
    pandas, or such a table under a key. Raises InvalidLogError for anything else.
    """
    data = at_most(pieces)
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
    return told.encode() + text_of([list(columns), *zip(*columns.values(), strict=True)])


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
