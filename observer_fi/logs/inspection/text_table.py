"""What a table of text looks like: separator, decimal comma, where the header, the units and the rows are."""

from typing import NamedTuple

from observer_fi.logs.blank_columns import blank_headers
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.csv import fields_of
from observer_fi.logs.formats.stamps import is_stamp
from observer_fi.logs.inspection.vocabulary import unit_of
from observer_fi.logs.plain_cells import plain_cell

SEPARATORS = (";", "\t", ",", "|", " ")
LOOKED_AT = 300  # lines
SURE_ROWS = 3  # rows in a row that begin the table


class TextTable(NamedTuple):
    """Layout of a text table. header_line: 1 is the first line, 0 where there is none; data_line: of the first row."""

    separator: str
    decimal: str
    headers: list[str]
    units: list[str]
    header_line: int
    data_line: int
    preamble: tuple[str, ...]


def text_table(lines: list[str], column_map: ColumnMap | None = None) -> TextTable | None:
    """The layout of the first lines of a file, as a map says where it does; None where there are no rows of numbers."""
    lines = lines[:LOOKED_AT]
    separators = [column_map.separator] if column_map and column_map.separator else SEPARATORS
    decimal = column_map.decimal_comma if column_map else None
    decimals = [".", ","] if decimal is None else [","] if decimal else ["."]
    worth = {(s, d): _worth(lines, s, d) for s in separators for d in decimals}
    separator, decimal_sign = max(worth, key=lambda key: worth[key])
    if worth[separator, decimal_sign][0] <= 0.0:
        return None
    return _placed(lines, separator, decimal_sign, column_map)


def is_number(text: str, decimal: str) -> bool:
    """Whether a field is a number with that decimal sign."""
    return bool(plain_cell(text, decimal, sure=False))


def _worth(lines: list[str], separator: str, decimal: str) -> tuple[float, int]:
    """Share of fields that are numbers in lines with as many fields as most, times the share of such lines; and the fields."""
    rows = [_split(line, separator) for line in lines if line.strip()]
    rows = rows[len(rows) // 4 :]  # what stands before the table is no part of it
    if not rows:
        return 0.0, 0
    counts = [len(row) for row in rows]
    usual = max(set(counts), key=lambda n: (counts.count(n), n))
    if usual < 2:
        return 0.0, 0
    like = [row for row in rows if len(row) == usual]
    told = sum(_is_value(field, decimal) for row in like for field in row)
    numbers = sum(is_number(field, decimal) for row in like for field in row)
    if not numbers:
        return 0.0, 0
    return round(told / (usual * len(like)) * len(like) / len(rows), 2), usual


def _split(line: str, separator: str) -> list[str]:
    """The fields of a line."""
    return fields_of(line.rstrip("\r"), separator)


def _is_value(field: str, decimal: str) -> bool:
    return plain_cell(field, decimal, sure=False) is not None or is_stamp(field)


def _placed(lines: list[str], separator: str, decimal: str, column_map: ColumnMap | None) -> TextTable | None:
    split = [_split(line, separator) if line.strip() else [] for line in lines]
    counts = [len(fields) for fields in split if fields]
    usual = max(set(counts), key=lambda n: (counts.count(n), n))
    if separator == " ":  # names may have blanks in them
        split = [
            blank_headers(line, usual) if fields else [] for line, fields in zip(lines, split, strict=True)
        ]
    is_row = [_is_row(fields, usual, decimal) for fields in split]
    first = _first_row(split, is_row)
    if first is None:
        return None
    header, units = _header(split, is_row, first, usual)
    if column_map and column_map.header_line is not None:
        header = column_map.header_line - 1
        units = None
    if column_map and column_map.data_line is not None:
        first = column_map.data_line - 1
    named = split[header] if header is not None and 0 <= header < len(split) else []
    headers = [f"{k + 1}" for k in range(usual)] if not named else [field.strip() for field in named]
    told = [field.strip() for field in split[units]] if units is not None else []
    told = [*told, *[""] * len(headers)][: len(headers)]
    begin = header if named and header is not None else first
    preamble = tuple(line.lstrip("#").strip() for line in lines[:begin] if line.strip("# \t;,"))
    return TextTable(
        separator,
        decimal,
        headers,
        told,
        header + 1 if named and header is not None else 0,
        first + 1,
        preamble,
    )


def _is_row(fields: list[str], usual: int, decimal: str) -> bool:
    """A line of values, at least one of them a number, and most of them."""
    if len(fields) != usual or fields[0].startswith("#"):
        return False
    values = sum(_is_value(field, decimal) for field in fields)
    return values >= 0.5 * usual and any(is_number(field, decimal) for field in fields)


def _first_row(split: list[list[str]], is_row: list[bool]) -> int | None:
    """The first of several rows, blank lines aside; of a table of one or two rows the first."""
    there = [k for k, fields in enumerate(split) if fields]
    for n, k in enumerate(there):
        if all(is_row[j] for j in there[n : n + SURE_ROWS]):
            return k
    return None


def _header(
    split: list[list[str]], is_row: list[bool], first: int, usual: int
) -> tuple[int | None, int | None]:
    """Lines of the header and of the units: the last one or two of as many fields above the rows."""
    above = [k for k in range(first) if split[k] and not is_row[k]]
    like = [k for k in above if abs(len(split[k]) - usual) <= (1 if usual > 2 else 0) and len(split[k]) > 1]
    if not like:
        return None, None
    last = like[-1]
    if len(like) > 1 and _is_units(split[last]) and any(like[-2] == k for k in above[-3:]):
        return like[-2], last
    return last, None


def _is_units(fields: list[str]) -> bool:
    """A row of units: those fields that hold anything are units, at least half of all."""
    given = [field for field in fields if field.strip(" []()-")]
    return (
        bool(given) and 2 * len(given) >= len(fields) and all(unit_of(field) is not None for field in given)
    )
