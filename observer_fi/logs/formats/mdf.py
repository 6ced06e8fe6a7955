"""MDF, the measurement format of ASAM (.mf4, .mdf, .dat of older tools), through asammdf (the extra `mdf`, imported on use).

A file holds groups of channels, each with a clock of its own. The table is the group that holds what the column map names, else
the one that can be a log; nothing is resampled: channels that stand in another group are refused by name.
"""

import datetime
import gc
import sys
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.arrays import MOST_VALUES, array_table
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.tables import Table
from observer_fi.records import Array

_DAMAGED = "not a whole MDF file ({}); export or copy it again"
TIME = "time_s"


class Group(NamedTuple):
    """One group of channels: its number, its name, columns (n,) with the time [s] as `time_s`, and units by column."""

    number: int
    name: str
    columns: dict[str, Array]
    units: dict[str, str]


class Measurement(NamedTuple):
    """All groups of an MDF file, and what it says of itself."""

    groups: tuple[Group, ...]
    metadata: tuple[str, ...]
    remarks: tuple[str, ...]


def open_mdf(source: Source, column_map: ColumnMap) -> Table:
    """An MDF file as a table: the one group with the channels that a log needs."""
    found = mdf_groups(source)
    group = best_group(found.groups, {column_map.source(column).header for column in COLUMNS} - {TIME})
    notes = list(found.remarks)
    if len(found.groups) > 1:
        notes.append(
            f"group {group.name} of {len(found.groups)} is read, with its own clock; no other is resampled onto it"
        )
    _check_one_group(source.path, group, found.groups, column_map)
    return array_table(source.path, group.columns, column_map, found.metadata, notes)


def best_group(groups: tuple[Group, ...], wanted: set[str]) -> Group:
    """The group with most of the wanted channels; of those with as many, the one with most samples."""
    names = {name.casefold() for name in wanted}

    def worth(group: Group) -> tuple[int, int]:
        return sum(name.casefold() in names for name in group.columns), group.columns[TIME].size

    return max(groups, key=worth)


def _check_one_group(path: str, group: Group, groups: tuple[Group, ...], column_map: ColumnMap) -> None:
    for column, given in column_map.columns.items():
        elsewhere = [other for other in groups if given.header in other.columns]
        if given.header not in group.columns and elsewhere:
            other = elsewhere[0]
            raise InvalidLogError(
                f"{path}: channel {given.header!r} ({column}) stands in group {other.name} ({_rate(other):.6g} Hz), the "
                f"others in {group.name} ({_rate(group):.6g} Hz); export them in one group, on one clock"
            )


def _rate(group: Group) -> float:
    steps = np.diff(group.columns[TIME])
    return float(1.0 / np.median(steps)) if steps.size and np.median(steps) > 0.0 else float("nan")


def mdf_groups(source: Source) -> Measurement:
    """The groups that hold numbers. Raises InvalidLogError, also where asammdf is not installed."""
    try:
        import asammdf  # noqa: F401
    except ImportError as error:
        raise InvalidLogError(
            f"{source.path}: MDF files need asammdf; install it: pip install 'observer-fi[mdf]', or export the log as CSV"
        ) from error
    remarks: list[str] = []
    with (
        source.open() as stream,
        third_party(source.path, _DAMAGED, remarks, "asammdf"),
        _opened(stream) as file,
    ):
        groups = tuple(group for k in range(len(file.groups)) if (group := _group(file, k)) is not None)
        start = getattr(file, "start_time", None)
    if not groups:
        raise InvalidLogError(
            f"{source.path}: holds no group of channels with a clock; export the log again, or as CSV"
        )
    metadata = (f"start: {start.isoformat()}",) if isinstance(start, datetime.datetime) else ()
    return Measurement(groups, metadata, tuple(remarks))


def _opened(stream: Any) -> Any:
    """The file opened by asammdf. What it leaves half made of a damaged one complains again as it is deleted: unheard."""
    from asammdf import MDF

    hook, reason = sys.unraisablehook, ""
    sys.unraisablehook = lambda unraisable: None
    try:
        try:
            return MDF(stream)
        except Exception as error:  # it unpacks and indexes what it finds
            reason = str(error) or type(error).__name__
        gc.collect()
    finally:
        sys.unraisablehook = hook
    raise ValueError(reason)


def _group(file: Any, number: int) -> Group | None:
    """A group with its clock; None where it has no samples or no numbers."""
    master = file.masters_db.get(number)
    cycles = int(file.groups[number].channel_group.cycles_nr)
    channels = [(str(c.name), k) for k, c in enumerate(file.groups[number].channels) if k != master]
    if master is None or cycles < 2 or not channels:
        return None
    if cycles * len(channels) > MOST_VALUES:
        raise ValueError(f"{cycles * len(channels)} values claimed")
    columns: dict[str, Array] = {TIME: np.asarray(file.get_master(number), dtype=np.float64)}
    units = {TIME: "s"}
    for name, k in channels:
        signal = file.get(group=number, index=k, ignore_invalidation_bits=False)
        if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iufb" and name not in columns:
            columns[name] = signal.samples.astype(np.float64)
            units[name] = str(signal.unit or "")
    named = (
        file.groups[number].channel_group.acq_name
        if hasattr(file.groups[number].channel_group, "acq_name")
        else ""
    )
    return (
        Group(number, repr(named) if named else str(number + 1), columns, units) if len(columns) > 1 else None
    )
