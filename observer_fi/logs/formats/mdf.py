"""MDF, the measurement format of ASAM (.mf4, .mdf, .dat of older tools), through asammdf (the extra `mdf`, imported on use).

A file holds groups of channels, each with a clock of its own. The table is the group that holds what the column map names, else
the one that can be a log; nothing is resampled: channels that stand in another group are refused by name.
"""

import io
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.arrays import array_table
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.tables import Table
from observer_fi.records import Array

_DAMAGED = "not a whole MDF file ({}); export or copy it again"
TIME = "time_s"
LONGEST_S = 900.0  # that a file may take: a damaged one may lead in circles


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
    if find_spec("asammdf") is None:
        raise InvalidLogError(
            f"{source.path}: MDF files need asammdf; install it: pip install 'observer-fi[mdf]', or export the log as CSV"
        )
    remarks: list[str] = []
    with third_party(source.path, _DAMAGED, remarks):
        with np.load(io.BytesIO(_child(source.path)), allow_pickle=False) as told:
            meta = json.loads(str(told["meta"]))
            arrays = {key: told[key] for key in told.files if key != "meta"}
        if meta["reason"]:
            raise ValueError(meta["reason"])
        groups = tuple(
            Group(number, name, {c: arrays[f"{number}/{k}"] for k, c in enumerate(units)}, units)
            for number, name, units in meta["groups"]
        )
    source.check()
    if not groups:
        raise InvalidLogError(
            f"{source.path}: holds no group of channels with a clock; export the log again, or as CSV"
        )
    return Measurement(groups, (f"start: {meta['start']}",) if meta["start"] else (), tuple(remarks))


def _child(path: str) -> bytes:
    """What a process of its own says of the file: where one is damaged, asammdf may end the process that it runs in."""
    package = str(Path(__file__).parents[3])
    known = os.environ.get("PYTHONPATH")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([package, *([known] if known else [])])}
    code = "import sys; from observer_fi.logs.formats.mdf_child import main; main(sys.argv[1])"
    run = subprocess.run(
        [sys.executable, "-c", code, os.path.abspath(path)],
        capture_output=True,
        env=env,
        check=False,
        timeout=LONGEST_S,
    )
    if run.returncode or not run.stdout:
        raise ValueError("asammdf cannot read it")
    return run.stdout
