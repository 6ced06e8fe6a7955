"""A file as blocks of numbers, whatever its format: the types that readers return, and what they share."""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap, missing_column
from observer_fi.records import Array, Rejected

REQUIRED = ("time_s", "current_a", "position_m")
NO_VALUE = (
    "",
    "NaN",
    "nan",
    "NAN",
    "-nan",
    "NA",
    "N/A",
    "#N/A",
    "null",
    "NULL",
    "None",
    "-",
    "1.#QNAN",
    "-1.#IND",
)


@dataclass
class RowCount:
    """Rows that a reader has passed in the file, however it uses them; after the last block all rows of the file."""

    rows: int = 0


LISTED = 1000  # entries kept of each list: enough to see a pattern, and a day of broken samples stays small


class LeftOut(NamedTuple):
    """Rows of the file that are no samples: the first `LISTED` of them with their reasons, and how many there are."""

    entries: tuple[Rejected, ...] = ()
    total: int = 0


NONE = LeftOut()


def left_out_rows(entries: Iterable[Rejected]) -> LeftOut:
    """All rows that were left out of a block."""
    listed = tuple(sorted(entries))
    return LeftOut(listed[:LISTED], len(listed))


def together(parts: Iterable[LeftOut]) -> LeftOut:
    """What was left out of several blocks, in order."""
    parts = list(parts)
    entries = [entry for part in parts for entry in part.entries]
    return LeftOut(tuple(entries[:LISTED]), sum(part.total for part in parts))


class Block(NamedTuple):
    """Consecutive rows: numbers in the file, values by column in the file's units, and rows left out."""

    rows: NDArray[np.int64]
    values: dict[str, Array]
    left_out: LeftOut = NONE


@dataclass(frozen=True)
class Table:
    """An opened file: the columns of the contract it holds, and how to read `n` rows at a time.

    count: what the reader says it passed, against which samples and rows left out are held. first_line: line of the first
    row in a text file, else None. remarks: notes that come up while the rows are read.
    """

    columns: tuple[str, ...]
    blocks: Callable[[int], Iterator[Block]]
    count: RowCount
    metadata: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    first_line: int | None = None
    remarks: list[str] = field(default_factory=list)


def positions(
    path: str, headers: list[str], column_map: ColumnMap, known: tuple[str, ...] = ()
) -> dict[str, int]:
    """Index of the header of every column of the contract. known: columns that need none (a clock)."""
    found = {column: position(path, headers, column_map.source(column).header) for column in COLUMNS}
    at = {column: index for column, index in found.items() if index is not None}
    drive_by_force = "force_cmd_n" in at and "current_a" not in column_map.columns
    for column in (*REQUIRED, *column_map.columns):
        if column not in at and column not in known and not (column == "current_a" and drive_by_force):
            raise missing_column(path, column, headers, column_map)
    for column, index in at.items():
        others = [other for other, k in at.items() if k == index and other != column]
        if others:
            raise InvalidLogError(
                f"{path}: header {headers[index]!r} stands for {column} and for {others[0]}; map one of them to another header"
            )
    return at


def shown_name(column: str, header: str) -> str:
    """A column in messages, with its header if that is another."""
    return column if column == header else f"{column} (header {header!r})"


def position(path: str, headers: list[str], wanted: str) -> int | None:
    """Index of a header, in any case if not as it stands, None where it is not there. Raises InvalidLogError if repeated."""
    exact = [k for k, header in enumerate(headers) if header == wanted]
    hits = exact or [k for k, header in enumerate(headers) if header.casefold() == wanted.casefold()]
    if len(hits) > 1:
        raise InvalidLogError(
            f"{path}: header {wanted!r} stands {len(hits)} times; rename or remove all but one"
        )
    return hits[0] if hits else None


def not_a_number(path: str, row: int, column: str, text: object, line: int | None = None) -> InvalidLogError:
    """The one line for a text in a column of numbers."""
    shown = repr(str(text)[:40])
    hint = (
        "; a decimal comma needs decimal_comma = true in the column map" if re.search(r"\d,\d", shown) else ""
    )
    return InvalidLogError(
        f"{path}: {place(row, line)}, column {column}: {shown} is not a number; correct it, "
        f"or list it under missing in a column map (--columns map.toml){hint}"
    )


def plain(array: Any) -> Array:
    """A float64 array of arrow as numpy, NaN for null. (Arrow's own conversion imports pandas, 0.3 s.)"""
    validity, data = array.buffers()
    part = slice(array.offset, array.offset + len(array))
    values = np.frombuffer(data, dtype=np.float64)[part]
    if array.null_count == 0:
        return values
    valid = np.unpackbits(np.frombuffer(validity, dtype=np.uint8), bitorder="little")[part]
    return np.where(valid == 1, values, np.nan)


def place(row: int, line: int | None) -> str:
    """Where a row is: its number, 1 after the header, and for a text file the line."""
    return f"row {row}" if line is None else f"row {row} (line {line})"


def regrouped(blocks: Iterator[Block], rows: int) -> Iterator[Block]:
    """The same rows in blocks of exactly `rows` (the last may be shorter)."""
    held: list[Block] = []
    count = 0
    for block in blocks:
        start, left_out = 0, block.left_out
        while count + block.rows.size - start >= rows:
            stop = start + rows - count
            yield joined_blocks([*held, _cut(block, start, stop, left_out)])
            held, count, start, left_out = [], 0, stop, NONE
        if start < block.rows.size or left_out.total:
            held.append(_cut(block, start, block.rows.size, left_out))
            count += block.rows.size - start
    if held:
        yield joined_blocks(held)


def _cut(block: Block, start: int, stop: int, left_out: LeftOut) -> Block:
    return Block(block.rows[start:stop], {name: v[start:stop] for name, v in block.values.items()}, left_out)


def joined_blocks(blocks: list[Block]) -> Block:
    """Blocks one behind the other."""
    if len(blocks) == 1:
        return blocks[0]
    return Block(
        np.concatenate([block.rows for block in blocks]),
        {name: np.concatenate([block.values[name] for block in blocks]) for name in blocks[0].values},
        together(block.left_out for block in blocks),
    )
