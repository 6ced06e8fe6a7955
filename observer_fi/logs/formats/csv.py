"""CSV and CSV.gz: what the first lines say. The rows are read by `text_rows.py`."""

import csv
import re
from collections.abc import Iterator
from typing import NamedTuple

from observer_fi.errors import InvalidLogError
from observer_fi.logs.blank_columns import BlankColumns, blank_headers
from observer_fi.logs.columns import PLAIN, ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.stamps import Stamps, is_stamp, stamp_columns
from observer_fi.logs.formats.text_rows import TextLayout, lines_in, text_blocks, without_lines
from observer_fi.logs.formats.texts import is_like_ascii, utf8_pieces
from observer_fi.logs.tables import Block, RowCount, Table, positions, regrouped, shown_name

PREAMBLE_BYTES = 1 << 18
LONGEST_HEADER = 1 << 16  # characters
MOST_COLUMNS = 2000
_GROUPS = re.compile(r"\.(\d{3}(?=[.,]))")  # of digits by points, which a decimal comma ends


class _Layout(NamedTuple):
    """What the first lines of a text table say. first_line: line of the first row, 1 is that of the file; first_row: its fields,
    as many as there are headers."""

    headers: list[str]
    separator: str
    decimal: str
    first_line: int
    first_row: list[str]
    metadata: tuple[str, ...]
    notes: tuple[str, ...]
    sure: bool


def open_csv(source: Source, column_map: ColumnMap) -> Table:
    """A table of text: its header is read now, its rows later."""
    layout = _layout(source, column_map)
    at = positions(source.path, layout.headers, column_map)
    stamped = column_map.source("time_s").stamps or is_stamp(layout.first_row[at["time_s"]])
    stamps = stamp_columns(source.path, layout.headers, column_map, at) if stamped else {}
    used = at | stamps
    rows_layout = TextLayout(
        len(layout.headers),
        "\t" if layout.separator == " " else layout.separator,
        layout.decimal,
        layout.first_line,
        used,
        {column: shown_name(column, layout.headers[k]) for column, k in used.items()},
        column_map.missing,
        stamps=tuple(stamps),
        headers=tuple(layout.headers),
        sure=layout.sure,
    )
    count = RowCount()
    remarks: list[str] = []

    def blocks(rows: int) -> Iterator[Block]:
        lines = lines_in(source.path, utf8_pieces(source, column_map.encoding))
        kept = without_lines(lines, layout.first_line - 1)
        if layout.separator == " ":
            kept = BlankColumns(len(layout.headers)).tabbed(kept)
        clock = Stamps(source.path, remarks) if stamps else None
        return regrouped(text_blocks(source.path, kept, rows_layout, count, clock), rows)

    return Table(tuple(at), blocks, count, layout.metadata, layout.notes, layout.first_line, remarks)


def _layout(source: Source, column_map: ColumnMap) -> _Layout:
    path, head = source.path, first_bytes(source, column_map.encoding)
    texts, notes = decoded(head, column_map.encoding)
    if is_binary(texts):
        raise InvalidLogError(f"{path}: this is not a table of text but binary data; export the log as CSV")
    header_at = _header_index(path, texts, column_map)
    data_at = header_at + 1 if column_map.data_line is None else column_map.data_line - 1
    if header_at < 0 and column_map.data_line is None:
        data_at = _header_index(path, texts, PLAIN)  # without a header the first line of it all is a row
    names = texts[max(header_at, data_at - 1, 0)]
    separator = column_map.separator or _separator(names)
    if header_at < 0:
        headers = _numbered(texts[data_at:], separator)
    elif separator == " ":
        row_of_words = next((line.split() for line in texts[data_at:] if line.strip()), [])
        headers = blank_headers(texts[header_at], len(row_of_words))
    else:
        headers = header_fields(path, header_at + 1, texts[header_at], separator)
    if header_at >= 0 and _all_numbers(headers):
        raise InvalidLogError(
            f"{path}: line {header_at + 1} holds numbers, not column names; add a header as in docs/logs.md, or map columns "
            "by their numbers with header_line = 0"
        )
    first = next((line for line in texts[data_at:] if line.strip()), None)
    if first is None:
        raise InvalidLogError(f"{path}: there is a header but no samples; record or export the log again")
    row = fields_of(first, separator)
    if len(row) == len(headers) + 1 and not row[-1]:
        headers = [*headers, ""]  # every row ends with a separator, the header does not
    decimal_comma = column_map.decimal_comma
    if decimal_comma is None:
        numbers = [_GROUPS.sub(r"\1", field) for field in row if not is_stamp(field)]
        decimal_comma = any(re.search(r"\d,\d", n) for n in numbers) and not any("." in n for n in numbers)
        notes += ("numbers have a decimal comma",) if decimal_comma else ()
    metadata = tuple(line.lstrip("#").strip() for line in texts[: max(header_at, 0)] if line.strip("# \t"))
    decimal = "," if decimal_comma else "."
    first_row = [*row, *[""] * len(headers)][: len(headers)]
    sure = any(re.fullmatch(rf"[+-]?\d*{re.escape(decimal)}\d+", field) for field in first_row)
    return _Layout(headers, separator, decimal, data_at + 1, first_row, metadata, notes, sure)


def _separator(names: str) -> str:
    """What separates column names most often; blanks where nothing else does."""
    found = max(",;\t|", key=names.count)
    return found if found in names or len(names.split()) < 2 else " "


def first_bytes(source: Source, encoding: str | None) -> bytes:
    """The first bytes of a text file, as UTF-8 if it is not one byte a character."""
    head = b""
    for piece in utf8_pieces(source, encoding):
        head += piece
        if len(head) >= PREAMBLE_BYTES:
            break
    return head[:PREAMBLE_BYTES].removeprefix(b"\xef\xbb\xbf")


def decoded(head: bytes, encoding: str | None) -> tuple[list[str], tuple[str, ...]]:
    """The first lines as texts, and a note where that is a guess: what is not UTF-8 is read as Windows text.

    Lines end as in `text_rows.py`: by newline, carriage return, or both, and by nothing else.
    """
    notes: tuple[str, ...] = ()
    name = encoding if encoding and is_like_ascii(encoding) else "utf-8"
    if encoding is None:
        try:
            head[: head.rfind(b"\n") + 1 or None].decode("utf-8")
        except UnicodeDecodeError:
            name, notes = "cp1252", ("the text is not UTF-8: read as Windows text (cp1252)",)
    return [line.decode(name, "replace") for line in head.splitlines()], notes


def is_binary(texts: list[str]) -> bool:
    """Whether there are zero bytes, or more than one character in a hundred that cannot be shown."""
    doubtful = [text for text in texts if not text.replace("\t", "").isprintable()]
    strange = sum(not c.isprintable() and not c.isspace() for text in doubtful for c in text)
    return any("\0" in text for text in doubtful) or strange > 0.01 * sum(map(len, texts))


def _numbered(rows: list[str], separator: str) -> list[str]:
    """Names of the columns of a table without a header: their numbers, from 1 on."""
    first = next((line for line in rows if line.strip()), "")
    return [f"{k + 1}" for k in range(len(fields_of(first, separator)))]


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


def header_fields(path: str, number: int, line: str, separator: str) -> list[str]:
    """The column names of a header line. Raises InvalidLogError for what cannot be one."""
    if len(line) > LONGEST_HEADER:
        raise InvalidLogError(
            f"{path}: line {number} has {len(line)} characters, too many for a header of column names; export the log again"
        )
    try:
        headers = [field.strip() for field in next(csv.reader([line], delimiter=separator))] or [""]
    except (csv.Error, StopIteration) as error:
        raise InvalidLogError(
            f"{path}: line {number} is no header of column names ({error}); export the log again"
        ) from error
    if len(headers) > MOST_COLUMNS:
        raise InvalidLogError(
            f"{path}: line {number} has {len(headers)} columns, more than {MOST_COLUMNS}; export those that are needed"
        )
    return headers


def fields_of(line: str, separator: str) -> list[str]:
    """The fields of a line without their quotes; as they stand where quotes are broken. Many blanks separate as one."""
    if separator == " ":
        return line.split()
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=separator))]
    except (csv.Error, StopIteration):
        return line.split(separator)


def _all_numbers(headers: list[str]) -> bool:
    return all(re.fullmatch(r"[-+]?[\d.,]+(e[-+]?\d+)?", field, re.IGNORECASE) for field in headers)
