"""LVM, the text format of LabVIEW: two headers, the channels' clocks, and rows that may end in a comment."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import PLAIN, ColumnMap
from observer_fi.logs.formats.csv import decoded, first_bytes, header_fields
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.text_rows import TextLayout, lines_in, text_blocks, without_lines
from observer_fi.logs.formats.texts import utf8_pieces
from observer_fi.logs.formats.waveforms import Waveform, checked_waveform
from observer_fi.logs.tables import Block, RowCount, Table, positions, regrouped, shown_name
from observer_fi.records import Array

_CLOCK = "clock of "  # before the name of a column: its own column of times


class _Layout(NamedTuple):
    """headers: of the columns, repeated ones numbered; entries: of the two headers, by their first word.

    x_columns: how times stand in the file: "One" column, one a channel ("Multi"), or "No".
    """

    headers: list[str]
    separator: str
    decimal: str
    first_line: int
    entries: dict[str, list[str]]
    x_columns: str
    comment: bool


def open_lvm(source: Source, column_map: ColumnMap) -> Table:
    """A LabVIEW measurement file; its X_Value is the time unless a column map says otherwise."""
    layout = _layout(source, column_map)
    timed = layout.x_columns != "No" or "time_s" in column_map.columns or "time_s" in layout.headers
    if timed and "time_s" not in column_map.columns and "time_s" not in layout.headers:
        layout.headers[layout.headers.index("X_Value")] = "time_s"
    at = positions(source.path, layout.headers, column_map, () if timed else ("time_s",))
    wave = None if timed else _waveform(source.path, layout, at)
    clocks = _clocks(layout, at) if timed else {}
    used = at | clocks
    rows_layout = TextLayout(
        len(layout.headers),
        layout.separator,
        layout.decimal,
        layout.first_line,
        used,
        {column: shown_name(column, layout.headers[k]) for column, k in used.items()},
        column_map.missing,
        layout.comment,
    )
    count = RowCount()

    def blocks(rows: int) -> Iterator[Block]:
        lines = lines_in(source.path, utf8_pieces(source, column_map.encoding))
        kept = without_lines(lines, layout.first_line - 1)
        found = text_blocks(source.path, kept, rows_layout, count)
        return regrouped((_on_one_clock(source.path, block, wave, clocks) for block in found), rows)

    notes = () if timed else ("time from X0 and Delta_X of the header",)
    columns = (*at, *(() if timed else ("time_s",)))
    return Table(columns, blocks, count, _metadata(layout.entries), notes, layout.first_line)


def lvm_columns(
    source: Source,
) -> tuple[list[str], Iterator[dict[str, Array]], bool, tuple[str, ...], tuple[str, ...]]:
    """All columns of a file: their names, blocks of them, whether the file has a clock, metadata and notes."""
    layout = _layout(source, PLAIN)
    timed = layout.x_columns != "No"
    names = ["time_s" if name == "X_Value" else name for name in layout.headers]
    used = {name: k for k, name in enumerate(names) if name and (timed or name != "time_s")}
    rows_layout = TextLayout(
        len(names),
        layout.separator,
        layout.decimal,
        layout.first_line,
        used,
        {name: name for name in used},
        (),
        layout.comment,
    )
    channels = {name: k for name, k in used.items() if name != "time_s"}
    wave = None if timed else _waveform(source.path, layout, channels)
    kept = without_lines(lines_in(source.path, utf8_pieces(source, None)), layout.first_line - 1)
    found = text_blocks(source.path, kept, rows_layout, RowCount())
    blocks = (_on_one_clock(source.path, block, wave, {}).values for block in found)
    notes = () if timed else ("time from X0 and Delta_X of the header",)
    return [*(() if timed else ("time_s",)), *used], blocks, True, _metadata(layout.entries), notes


def _layout(source: Source, column_map: ColumnMap) -> _Layout:
    """The two headers of a LabVIEW measurement file: of the file, and of the channels."""
    path = source.path
    texts, _ = decoded(first_bytes(source, column_map.encoding), column_map.encoding)
    ends = [k for k, line in enumerate(texts) if line.startswith("***End_of_Header***")][:2]
    if not texts or not texts[0].lstrip("\ufeff").startswith("LabVIEW Measurement") or not ends:
        raise InvalidLogError(f"{path}: not a LabVIEW measurement file; export it again, or as CSV")
    separator = "," if any(line.startswith("Separator,") for line in texts[: ends[0]]) else "\t"
    entries = {parts[0]: parts[1:] for line in texts[: ends[-1]] if len(parts := line.split(separator)) > 1}
    header_at = ends[-1] + 1
    if header_at >= len(texts) or not any(line.strip() for line in texts[header_at + 1 :]):
        raise InvalidLogError(f"{path}: there is a header but no samples; record or export the log again")
    headers = _first_unique(header_fields(path, header_at + 1, texts[header_at], separator))
    comment = headers[-1] == "Comment"
    decimal = entries.get("Decimal_Separator", ["."])[0].strip() or "."
    if decimal not in (".", ",") or decimal == separator:
        raise InvalidLogError(f"{path}: Decimal_Separator of the header is {decimal!r}; export with a point")
    x_columns = entries.get("X_Columns", ["One"])[0].strip() if "X_Value" in headers else "No"
    headers = headers[:-1] if comment else headers
    return _Layout(headers, separator, decimal, header_at + 2, entries, x_columns, comment)


def _metadata(entries: dict[str, list[str]]) -> tuple[str, ...]:
    return tuple(
        f"{key}: {' '.join(entries[key]).strip()}"
        for key in ("Operator", "Description", "Date", "Time")
        if key in entries
    )


def _first_unique(headers: list[str]) -> list[str]:
    """Repeated headers (an X column a channel) numbered, so that the first keeps its name."""
    seen: dict[str, int] = {}
    found = []
    for header in headers:
        seen[header] = seen.get(header, 0) + 1
        found.append(header if seen[header] == 1 else f"{header} ({seen[header]})")
    return found


# --- the channels' clocks ------------------------------------------------------------------------


def _waveform(path: str, layout: _Layout, at: dict[str, int]) -> Waveform:
    """The one clock of all channels, from X0 and Delta_X of the header. Raises InvalidLogError if they have several."""
    first = 1 if layout.headers[0] == "X_Value" else 0
    found = {}
    for column, k in at.items():
        start, step = (_header_number(path, layout, key, k - first) for key in ("X0", "Delta_X"))
        found[column] = checked_waveform(path, layout.headers[k], start, step)
    one = next(iter(found.values()))
    for column, other in found.items():
        if other != one:
            first_name = layout.headers[at[next(iter(found))]]
            raise InvalidLogError(
                f"{path}: channels {first_name!r} (X0 {one.start:g} s, Delta_X {one.step:g} s) and "
                f"{layout.headers[at[column]]!r} (X0 {other.start:g} s, Delta_X {other.step:g} s) are on different clocks; "
                "export them on one clock"
            )
    return one


def _header_number(path: str, layout: _Layout, key: str, channel: int) -> float:
    """The value of one channel in a line of the header; where there is only one value, it is that of all."""
    values = [text for text in layout.entries.get(key, []) if text.strip()]
    text = values[channel] if 0 <= channel < len(values) else values[0] if len(values) == 1 else ""
    try:
        return float(text.replace(layout.decimal, "."))
    except ValueError as error:
        raise InvalidLogError(
            f"{path}: there is no time column, and {key} of the header is {text!r}; export with a time column"
        ) from error


def _clocks(layout: _Layout, at: dict[str, int]) -> dict[str, int]:
    """Where every channel has a column of times in front of it: those that are not the time column itself."""
    if layout.x_columns != "Multi":
        return {}
    times = [
        k for k, header in enumerate(layout.headers) if header.startswith("X_Value") or header == "time_s"
    ]
    own = {column: max((k for k in times if k < at[column]), default=at["time_s"]) for column in at}
    return {_CLOCK + column: k for column, k in own.items() if k != at["time_s"] and column != "time_s"}


def _on_one_clock(path: str, block: Block, wave: Waveform | None, clocks: dict[str, int]) -> Block:
    """The block with its times; raises InvalidLogError where a channel's own times are not those of the log."""
    values = dict(block.values)
    if wave is not None:
        values["time_s"] = wave.times(block.rows - 1)
    for clock in clocks:
        if not np.array_equal(values.pop(clock), values["time_s"], equal_nan=True):
            raise InvalidLogError(
                f"{path}: channel {clock.removeprefix(_CLOCK)} has times of its own, other than those of the first channel; "
                "export all channels on one clock"
            )
    return block._replace(values=values)
