"""The two formats of LabVIEW: TDMS through npTDMS, LVM through pandas (both imported on use)."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.csv import PREAMBLE_BYTES, header_fields
from observer_fi.logs.tables import NO_VALUE, Block, Table, not_a_number, positions
from observer_fi.records import Array

if TYPE_CHECKING:
    import pandas as pd


class _Waveform(NamedTuple):
    """A clock that the header tells: time of the first sample and step [s]."""

    start: float
    step: float

    def times(self, first: int, count: int) -> Array:
        return self.start + self.step * np.arange(first, first + count, dtype=np.float64)


# --- TDMS ----------------------------------------------------------------------------------------


def open_tdms(path: str, column_map: ColumnMap) -> Table:
    """A TDMS file: a channel a column, by its name, or "group/channel" where two groups share a name."""
    from nptdms import TdmsFile

    with open(path, "rb") as stream:
        try:
            file = TdmsFile.open(stream)
        except (ValueError, KeyError, EOFError, IndexError) as error:  # what npTDMS raises on a damaged file
            what = str(error).splitlines()[0][:100]
            raise InvalidLogError(f"{path}: not a whole TDMS file ({what}); copy it again") from error
        channels = [channel for group in file.groups() for channel in group.channels()]
        headers = _short_names([(channel.group_name, channel.name) for channel in channels])
        wave = _tdms_waveform(channels)
        at = positions(path, headers, column_map, ("time_s",) if wave else ())
        for column, k in at.items():
            _check_numeric(path, column, channels[k].dtype)
        used = {column: (channels[k].group_name, channels[k].name) for column, k in at.items()}
        metadata = tuple(f"{key}: {value}" for key, value in file.properties.items())

    def blocks(rows: int) -> Iterator[Block]:
        return _tdms_blocks(path, used, wave, rows)

    if "time_s" in at:
        return Table(tuple(at), blocks, metadata)
    return Table((*at, "time_s"), blocks, metadata, ("time from the start and step of the waveform",))


def _short_names(names: list[tuple[str, str]]) -> list[str]:
    """Channel names, with their group where that is needed to tell them apart."""
    alone = [channel for _, channel in names]
    return [c if alone.count(c) == 1 else f"{group}/{c}" for group, c in names]


def _tdms_waveform(channels: list[Any]) -> _Waveform | None:
    for channel in channels:
        step = channel.properties.get("wf_increment")
        if step:
            return _Waveform(float(channel.properties.get("wf_start_offset", 0.0)), float(step))
    return None


def _check_numeric(path: str, column: str, kind: np.dtype[Any]) -> None:
    if not np.issubdtype(kind, np.number):
        raise InvalidLogError(
            f"{path}: column {column} is of type {kind}; export it as numbers in {COLUMNS[column].unit}"
        )


def _tdms_blocks(
    path: str, used: dict[str, tuple[str, str]], wave: _Waveform | None, rows: int
) -> Iterator[Block]:
    from nptdms import TdmsFile

    with open(path, "rb") as stream:
        file = TdmsFile.open(stream)
        channels = {column: file[group][channel] for column, (group, channel) in used.items()}
        total = max(len(channel) for channel in channels.values())
        for start in range(0, total, rows):
            count = min(rows, total - start)
            values = {column: _tdms_part(channel, start, count) for column, channel in channels.items()}
            if "time_s" not in values and wave is not None:
                values["time_s"] = wave.times(start, count)
            yield Block(np.arange(start + 1, start + count + 1), values)


def _tdms_part(channel: Any, start: int, count: int) -> Array:
    """`count` values from `start` on, NaN where the channel is shorter than the others."""
    have = max(min(count, len(channel) - start), 0)
    part = np.full(count, np.nan)
    if have:
        part[:have] = channel.read_data(offset=start, length=have)
    return part


# --- LVM -----------------------------------------------------------------------------------------


class _LvmLayout(NamedTuple):
    headers: list[str]
    separator: str
    decimal: str
    encoding: str
    first_line: int
    wave: _Waveform | None
    metadata: tuple[str, ...]


def open_lvm(path: str, column_map: ColumnMap) -> Table:
    """A LabVIEW measurement file; its X_Value is the time unless a column map says otherwise."""
    layout = _lvm_layout(path, column_map)
    if "time_s" not in column_map.columns and "time_s" not in layout.headers and layout.wave is None:
        layout.headers[layout.headers.index("X_Value")] = "time_s"
    at = positions(path, layout.headers, column_map, ("time_s",) if layout.wave else ())
    notes = () if "time_s" in at else ("time from X0 and Delta_X of the header",)

    def blocks(rows: int) -> Iterator[Block]:
        return _lvm_blocks(path, column_map, layout, at, rows)

    columns = (*at, *(() if "time_s" in at else ("time_s",)))
    return Table(columns, blocks, layout.metadata, notes, layout.first_line)


def _lvm_layout(path: str, column_map: ColumnMap) -> _LvmLayout:
    """The two headers of a LabVIEW measurement file: of the file, and of the channels."""
    encoding = column_map.encoding or "utf-8"
    with open(path, "rb") as stream:
        texts = stream.read(PREAMBLE_BYTES).decode(encoding, "replace").splitlines()
    ends = [k for k, line in enumerate(texts) if line.startswith("***End_of_Header***")][:2]
    if not texts or not texts[0].lstrip("\ufeff").startswith("LabVIEW Measurement") or not ends:
        raise InvalidLogError(f"{path}: not a LabVIEW measurement file; export it again, or as CSV")
    separator = "," if any(line.startswith("Separator,") for line in texts[: ends[0]]) else "\t"
    entries = {parts[0]: parts[1:] for line in texts[: ends[-1]] if len(parts := line.split(separator)) > 1}
    header_at = ends[-1] + 1
    if header_at >= len(texts) or not any(line.strip() for line in texts[header_at + 1 :]):
        raise InvalidLogError(f"{path}: there is a header but no samples; record or export the log again")
    headers = _first_unique(header_fields(texts[header_at], separator))
    decimal = entries.get("Decimal_Separator", ["."])[0] or "."
    wave = None
    if entries.get("X_Columns", ["One"])[0] == "No" or "X_Value" not in headers:
        start, step = (_header_number(path, entries, key, decimal) for key in ("X0", "Delta_X"))
        wave = _Waveform(start, step)
    metadata = tuple(
        f"{key}: {' '.join(entries[key]).strip()}"
        for key in ("Operator", "Description", "Date", "Time")
        if key in entries
    )
    return _LvmLayout(headers, separator, decimal, encoding, header_at + 2, wave, metadata)


def _header_number(path: str, entries: dict[str, list[str]], key: str, decimal: str) -> float:
    """The first value of a line of the header, one a channel."""
    text = next((text for text in entries.get(key, []) if text.strip()), "")
    try:
        return float(text.replace(decimal, "."))
    except ValueError as error:
        raise InvalidLogError(
            f"{path}: there is no time column, and {key} of the header is {text!r}; export with a time column"
        ) from error


def _first_unique(headers: list[str]) -> list[str]:
    """Repeated headers (an X column a channel) numbered, so that the first keeps its name."""
    return [h if h not in headers[:k] else f"{h} ({headers[:k].count(h) + 1})" for k, h in enumerate(headers)]


def _lvm_blocks(
    path: str, column_map: ColumnMap, layout: _LvmLayout, at: dict[str, int], rows: int
) -> Iterator[Block]:
    done = 0
    for frame in _lvm_frames(path, column_map, layout, at, rows):
        values = {column: _lvm_numbers(path, frame[k], column, layout) for column, k in at.items()}
        if layout.wave is not None and "time_s" not in values:
            values["time_s"] = layout.wave.times(done, len(frame))
        yield Block(np.arange(done + 1, done + len(frame) + 1), values)
        done += len(frame)


def _lvm_frames(
    path: str, column_map: ColumnMap, layout: _LvmLayout, at: dict[str, int], rows: int
) -> "Iterator[pd.DataFrame]":
    """Frames with the columns of `at`. By pandas, because rows lack their last field (the comment) here."""
    import pandas as pd

    try:
        with pd.read_csv(
            path,
            sep=layout.separator,
            decimal=layout.decimal,
            names=list(range(len(layout.headers))),
            usecols=list(at.values()),
            index_col=False,
            skiprows=layout.first_line - 1,
            skip_blank_lines=False,
            na_values=[*NO_VALUE, *column_map.missing],
            encoding=layout.encoding,
            encoding_errors="replace",
            chunksize=rows,
            low_memory=False,
        ) as frames:
            yield from frames
    except pd.errors.ParserError as error:
        raise InvalidLogError(f"{path}: cannot be read as a table ({error}); export it again") from error


def _lvm_numbers(path: str, series: "pd.Series", column: str, layout: _LvmLayout) -> Array:
    import pandas as pd

    if pd.api.types.is_numeric_dtype(series):
        return np.asarray(series, dtype=np.float64)
    texts = series.astype(str).str.replace(layout.decimal, ".")
    numbers = pd.to_numeric(texts, errors="coerce")
    offending = series[numbers.isna() & series.notna()]
    row = int(offending.index[0]) + 1
    raise not_a_number(path, row, column, offending.iloc[0], layout.first_line + row - 1)
