"""The process in which asammdf reads an MDF file: groups of numbers to standard output, as arrays of numpy and a line of JSON."""

import contextlib
import datetime
import io
import json
import logging
import os
import sys
from typing import Any, NamedTuple

import numpy as np

from observer_fi.logs.formats.arrays import MOST_VALUES
from observer_fi.records import Array


class _Group(NamedTuple):
    """number and name of a group, its columns (n,), the time first, and their units."""

    number: int
    name: str
    columns: dict[str, Array]
    units: dict[str, str]


def main(path: str) -> None:
    """The file to standard output; what is wrong with it is a text there, too."""
    arrays: dict[str, Any] = {}
    meta: dict[str, Any] = {"groups": [], "start": "", "reason": ""}
    out = os.dup(1)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        logging.disable(logging.CRITICAL)
        try:
            groups, meta["start"] = _read(path)
        except Exception as error:  # it unpacks and indexes what it finds
            groups, meta["reason"] = [], str(error) or type(error).__name__
    for group in groups:
        meta["groups"].append((group.number, group.name, group.units))
        arrays |= {f"{group.number}/{k}": values for k, values in enumerate(group.columns.values())}
    held = io.BytesIO()
    np.savez(held, meta=np.array(json.dumps(meta)), **arrays)
    with os.fdopen(out, "wb") as stream:
        stream.write(held.getvalue())
    sys.stdout.flush()
    os._exit(0)  # what is half open complains as it is deleted


def _read(path: str) -> tuple[list[_Group], str]:
    from asammdf import MDF

    with MDF(path) as file:
        groups = [group for k in range(len(file.groups)) if (group := _group(file, k)) is not None]
        start = getattr(file, "start_time", None)
    return groups, start.isoformat() if isinstance(start, datetime.datetime) else ""


def _group(file: Any, number: int) -> _Group | None:
    """A group with its clock; None where it has no samples or no numbers."""
    about = file.groups[number]
    master, cycles = file.masters_db.get(number), int(about.channel_group.cycles_nr)
    channels = [(str(c.name), k) for k, c in enumerate(about.channels) if k != master]
    if master is None or cycles < 2 or not channels:
        return None
    if cycles * len(channels) > MOST_VALUES:
        raise ValueError(f"{cycles * len(channels)} values claimed")
    columns: dict[str, Array] = {"time_s": np.asarray(file.get_master(number), dtype=np.float64)}
    units = {"time_s": "s"}
    for name, k in channels:
        signal = file.get(group=number, index=k, ignore_invalidation_bits=False)
        if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iufb" and name not in columns:
            columns[name] = signal.samples.astype(np.float64)
            units[name] = str(signal.unit or "")
    named = getattr(about.channel_group, "acq_name", "")
    return (
        _Group(number, repr(named) if named else str(number + 1), columns, units)
        if len(columns) > 1
        else None
    )
