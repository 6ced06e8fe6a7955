"""CSV and CSV.gz, block by block through pyarrow (imported on use: pandas would cost 0.4 s of start-up)."""

import csv
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.tables import NO_VALUE, Block, Table, not_a_number, place, plain, positions, regrouped
from observer_fi.records import Rejected

PREAMBLE_BYTES = 1 << 18
_BLOCK_BYTES = 1 << 22


class _Layout(NamedTuple):
    """What the first lines of a text table say. skip: bytes (UTF-8) before the first row."""

    headers: list[str]
    separator: str
    decimal: str
    skip: int
    first_line: int
    metadata: tuple[str, ...]
    notes: tuple[str, ...]


def open_csv(path: str, column_map: ColumnMap) -> Table:
    """A table of text: its header is read now, its rows later."""
    layout = _layout(path, column_map)
    at = positions(path, layout.headers, column_map)

    def blocks(rows: int) -> Iterator[Block]:
        return regrouped(_csv_blocks(path, column_map, layout, at), rows)

    return Table(tuple(at), blocks, layout.metadata, layout.notes, layout.first_line)


def _utf8_stream(path: str, column_map: ColumnMap) -> Any:
    """The decompressed bytes of a text file; UTF-16 and UTF-32 become UTF-8."""
    import pyarrow as pa

    with open(path, "rb") as file:
        magic = file.read(2)
    stream = pa.input_stream(path, compression="gzip" if magic == b"\x1f\x8b" else None)
    encoding = column_map.encoding or ("utf-16" if magic in (b"\xff\xfe", b"\xfe\xff") else "utf-8")
    if encoding.lower().replace("-", "").replace("_", "").startswith(("utf16", "utf32")):
        return pa.transcoding_input_stream(stream, encoding, "utf-8")
    return stream


def _layout(path: str, column_map: ColumnMap) -> _Layout:
    with _utf8_stream(path, column_map) as stream:
        head = _head(path, stream)
    lines = head.splitlines(keepends=True)
    text, notes = _decoded(head, column_map)
    if "\0" in text or sum(not c.isprintable() and c not in "\r\n\t" for c in text) > 0.01 * len(text):
        raise InvalidLogError(f"{path}: this is not a table of text but binary data; export the log as CSV")
    texts = text.splitlines()
    header_at = _header_index(path, texts, column_map)
    data_at = header_at + 1 if column_map.data_line is None else column_map.data_line - 1
    separator = column_map.separator or max(",;\t|", key=texts[header_at].count)
    headers = header_fields(texts[header_at], separator)
    if _all_numbers(headers):
        raise InvalidLogError(
            f"{path}: line {header_at + 1} holds numbers, not column names; add a header as in docs/logs.md"
        )
    if not any(line.strip() for line in texts[data_at:]):
        raise InvalidLogError(f"{path}: there is a header but no samples; record or export the log again")
    decimal_comma = column_map.decimal_comma
    if decimal_comma is None:
        decimal_comma = (
            separator != "," and bool(re.search(r"\d,\d", texts[data_at])) and "." not in texts[data_at]
        )
        notes += ("numbers have a decimal comma",) if decimal_comma else ()
    metadata = tuple(line.lstrip("#").strip() for line in texts[:header_at] if line.strip("# \t"))
    skip = sum(len(line) for line in lines[:data_at])
    return _Layout(headers, separator, "," if decimal_comma else ".", skip, data_at + 1, metadata, notes)


def _head(path: str, stream: Any) -> bytes:
    try:
        return bytes(stream.read(PREAMBLE_BYTES))
    except (OSError, ValueError) as error:
        raise InvalidLogError(f"{path}: cannot be decoded ({error}); copy or export it again") from error


def _decoded(head: bytes, column_map: ColumnMap) -> tuple[str, tuple[str, ...]]:
    """Text of the first bytes; what is not UTF-8 is read as Windows text, and the note says so."""
    named = column_map.encoding
    if named and not named.lower().startswith(("utf", "u8")):
        return head.decode(named, "replace"), ()
    try:
        return head[: head.rfind(b"\n") + 1 or None].decode("utf-8-sig"), ()
    except UnicodeDecodeError:
        return head.decode("cp1252", "replace"), ("the text is not UTF-8: read as Windows text (cp1252)",)


def _header_index(path: str, lines: list[str], column_map: ColumnMap) -> int:
    if column_map.header_line is not None:
        if column_map.header_line > len(lines):
            raise InvalidLogError(
                f"{path}: the column map names header line {column_map.header_line}, past the end"
            )
        return column_map.header_line - 1
    for k, line in enumerate(lines):
        if line.strip() and not line.startswith("#"):
            return k
    raise InvalidLogError(
        f"{path}: there is no header line; the first line names the columns, as in docs/logs.md"
    )


def header_fields(line: str, separator: str) -> list[str]:
    return [field.strip() for field in next(csv.reader([line], delimiter=separator))]


def _all_numbers(headers: list[str]) -> bool:
    return all(re.fullmatch(r"[-+]?[\d.,]+(e[-+]?\d+)?", field, re.IGNORECASE) for field in headers)


def _csv_blocks(path: str, column_map: ColumnMap, layout: _Layout, at: dict[str, int]) -> Iterator[Block]:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    short: list[Any] = []  # rows with a wrong number of fields, also of batches that are still to come

    def leave_out(row: Any) -> str:
        short.append(row)
        return "skip"

    names = [f"{k}" for k in range(len(layout.headers))]
    used = {column: names[k] for column, k in at.items()}
    read = pacsv.ReadOptions(use_threads=False, block_size=_BLOCK_BYTES, column_names=names)
    parse = pacsv.ParseOptions(
        delimiter=layout.separator, ignore_empty_lines=False, invalid_row_handler=leave_out
    )
    convert = pacsv.ConvertOptions(
        column_types={name: pa.float64() for name in used.values()},
        include_columns=list(used.values()),
        null_values=[*NO_VALUE, *column_map.missing],
        decimal_point=layout.decimal,
    )
    done = 0
    told = 0
    try:
        with _utf8_stream(path, column_map) as stream:
            stream.read(layout.skip)
            for batch in pacsv.open_csv(stream, read, parse, convert):
                values = {c: plain(batch.column(name)) for c, name in used.items()}
                rows = _row_numbers(done, batch.num_rows, short)
                left_out = tuple(_left_out(row) for row in short[told:])
                _check_short(path, len(short), done + batch.num_rows, short, layout)
                done, told = done + batch.num_rows, len(short)
                yield Block(rows, values, left_out)
    except pa.ArrowInvalid as error:
        raise _csv_error(path, str(error), layout, at, short) from error
    except (OSError, EOFError) as error:
        raise InvalidLogError(f"{path}: breaks off ({error}); copy or export it again") from error


def _row_numbers(done: int, count: int, short: list[Any]) -> NDArray[np.int64]:
    """File rows of good rows done..done+count, counting those that were left out between them."""
    good = np.arange(done + 1, done + count + 1)
    left_out = np.array([row.number for row in short], dtype=np.int64)
    return good + np.searchsorted(left_out - np.arange(left_out.size), good, side="right")


def _left_out(row: Any) -> Rejected:
    return Rejected(
        row.number, "time_s", f"row left out: {row.actual_columns} fields instead of {row.expected_columns}"
    )


def _check_short(path: str, bad: int, good: int, short: list[Any], layout: _Layout) -> None:
    """A broken line now and then is a hiccup of the logger; every second line is a wrong separator."""
    if bad > max(10, good // 10):
        first = short[0]
        raise InvalidLogError(
            f"{path}: {place(first.number, layout.first_line + first.number - 1)}: {first.actual_columns} "
            f"fields where the header has {first.expected_columns}, and so in {bad} rows; check the "
            f"separator ({layout.separator!r})"
        )


def _csv_error(
    path: str, message: str, layout: _Layout, at: dict[str, int], short: list[Any]
) -> InvalidLogError:
    found = re.search(r"column #(\d+): Row #(\d+): .*invalid value '(.*)'", message, re.DOTALL)
    if found is None:
        if short:
            _check_short(path, len(short), 0, short, layout)
        return InvalidLogError(
            f"{path}: cannot be read as a table ({message.splitlines()[0][:200]}); export it again"
        )
    header = layout.headers[int(found[1])]
    column = next((name for name, k in at.items() if layout.headers[k] == header), header)
    shown = column if column == header else f"{column} (header {header!r})"
    row = int(found[2])
    return not_a_number(path, row, shown, found[3], layout.first_line + row - 1)
