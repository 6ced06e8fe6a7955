"""A file of samples becomes a Log. `read_log` reads it whole, `open_log` chunk by chunk in bounded memory."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.cleaning import Summary, Tally, cleaned, summary
from observer_fi.logs.columns import PLAIN, ColumnMap, load_columns
from observer_fi.logs.formats.registry import SUFFIXES, open_table
from observer_fi.logs.formats.source import Source
from observer_fi.logs.tables import Block, RowCount, Table
from observer_fi.records import SAMPLES, Array, Log

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ColumnMap",
    "LogFile",
    "Summary",
    "load_columns",
    "log_from_frame",
    "log_name",
    "open_log",
    "read_log",
]

CHUNK_ROWS = 1 << 16
Progress = Callable[[float], None]  # is told how much is done, from 0 to 1
MOST_WHOLE = (
    6_000_000  # samples of a log that is read whole: an hour at 1600 Hz; a longer one goes chunk by chunk
)


class LogFile:
    """An opened log. Opening reads the header; samples come with `chunks`, the summary after the last one."""

    def __init__(self, path: str | Path, column_map: ColumnMap) -> None:
        self.path = str(path)
        self._map = column_map
        self._source = Source(self.path)
        self._table = open_table(self._source, column_map)
        self._summary: Summary | None = None

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file that was opened. Raises InvalidLogError if it changed since."""
        return self._source.sha256()

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the contract that the file holds."""
        return self._table.columns

    @property
    def share_read(self) -> float:
        """How much of the file was read so far, from 0 to 1."""
        return self._source.share_read

    @property
    def has_command(self) -> bool:
        """Whether the commanded speed is in the file; if not, `w_cmd` is NaN until it is recovered."""
        return "speed_cmd_rad_s" in self.columns

    @property
    def metadata(self) -> tuple[str, ...]:
        """Lines before the header, or properties of the file."""
        return self._table.metadata

    @property
    def summary(self) -> Summary:
        """Gaps, rejected samples and notes of the whole file. Raises RuntimeError before the last chunk."""
        if self._summary is None:
            raise RuntimeError(f"{self.path}: the summary exists after the last chunk was read, not before")
        return self._summary

    def chunks(self, rows: int = CHUNK_ROWS) -> Iterator[Log]:
        """The file as Logs of about `rows` samples, in order, each with its own gaps and rejected samples.

        Raises InvalidLogError; for a fault deep in the file only when its chunk is reached.
        """
        tally = Tally(self.path, self._map, self._table)
        try:
            yield from cleaned(self._table.blocks(rows), tally)
        except InvalidLogError:
            self._source.check()  # what is wrong with a file that changed on the way is that it did
            raise
        self._source.check()
        self._summary = summary(tally)


def open_log(path: str | Path, column_map: ColumnMap | None = None) -> LogFile:
    """The log file, ready to be read in chunks. Raises InvalidLogError with the one line for the user."""
    return LogFile(path, column_map or PLAIN)


def read_log(path: str | Path, column_map: ColumnMap | None = None) -> Log:
    """The whole file as one Log. Raises InvalidLogError with the one line for the user."""
    file = open_log(path, column_map)
    logs = list(_not_too_many(file.chunks(), file.path))
    return replace(_joined(logs, file.summary), sha256=file.sha256)


def _not_too_many(logs: Iterable[Log], path: str) -> Iterator[Log]:
    for log in logs:
        if log.first_row + log.t.size > MOST_WHOLE:
            raise InvalidLogError(
                f"{path}: more than {MOST_WHOLE} samples, too many to be taken whole; cut the file into parts, and log "
                "speed_cmd_rad_s (a log without it cannot be diagnosed piece by piece)"
            )
        yield log


def log_name(path: str | Path) -> str:
    """The file name without the suffix of its format: what reports are filed under."""
    name = Path(path).name
    return next((name[: -len(suffix)] for suffix in SUFFIXES if name.lower().endswith(suffix)), name)


def log_from_frame(frame: "pd.DataFrame", path: str = "frame", column_map: ColumnMap | None = None) -> Log:
    """A DataFrame as a Log: its columns are called as in the contract, or as the map says; pandera checks their types.

    path: what the log is called in messages and reports. Raises InvalidLogError with the one line for the user.
    """
    from observer_fi.logs.frame_schema import checked, named, with_seconds

    names, remarks = column_map or PLAIN, list[str]()
    time = names.source("time_s")
    if time.time_of_day is not None:
        raise UsageError(
            f"{path}: a column map joins no two columns of a DataFrame to a time stamp (time_of_day {time.time_of_day!r}); "
            "join them first, as with pandas.to_datetime"
        )
    frame = checked(with_seconds(named(frame, path, names), path, remarks, time.stamps), path)
    values = {str(name): frame[name].to_numpy(dtype=np.float64) for name in frame}
    block = Block(np.arange(1, len(frame) + 1), values)
    table = Table(tuple(values), lambda rows: iter((block,)), RowCount(len(frame)), remarks=remarks)
    tally = Tally(path, names, table)
    logs = list(cleaned(iter((block,)), tally))
    return _joined(logs, summary(tally))


def _joined(logs: list[Log], whole: Summary) -> Log:
    """Logs one behind the other, with the lists and notes of the whole file."""
    first = logs[0]
    if len(logs) > 1:
        joined: dict[str, Any] = {
            name: _concatenated([getattr(log, name) for log in logs]) for name in SAMPLES
        }
        first = replace(first, **joined)
    return replace(
        first,
        gaps=whole.gaps,
        rejected=whole.rejected,
        rejected_count=whole.rejected_count,
        notes=whole.notes,
    )


def _concatenated(parts: list[Array | None]) -> Array | None:
    """One array of those of all logs, None for a channel that the file does not have."""
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if there else None
