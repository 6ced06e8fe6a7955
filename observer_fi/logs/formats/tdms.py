"""TDMS, the binary format of LabVIEW, through npTDMS (imported on use)."""

import datetime
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.stamps import Stamps
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.formats.waveforms import OnClock, Waveform, checked_waveform, on_clock, one_clock
from observer_fi.logs.tables import Block, RowCount, Table, positions
from observer_fi.records import Array

_DAMAGED = "not a whole TDMS file ({}); copy it again"
_LOGGER = "nptdms"
MOST_CHANNELS = 2000


class _Plan(NamedTuple):
    """Channels by column as (group, name), the clock that their properties tell, where each stands on it, and the rows."""

    channels: dict[str, tuple[str, str]]
    wave: Waveform | None
    placed: dict[str, OnClock]
    rows: int


def open_tdms(source: Source, column_map: ColumnMap) -> Table:
    """A TDMS file: a channel a column, by its name, or "group/channel" where two groups share a name."""
    remarks: list[str] = []
    with source.open() as stream:
        with _npt(source, _DAMAGED, remarks):
            file = _opened(stream)
            channels = [channel for group in file.groups() for channel in group.channels()]
            names = [(str(channel.group_name), str(channel.name)) for channel in channels]
            metadata = tuple(f"{key}: {value}" for key, value in file.properties.items())
            cut = bool(channels) and file.file_status.incomplete_final_segment
        if cut or not channels:
            what = "its last segment breaks off" if cut else "it holds no channels"
            raise InvalidLogError(f"{source.path}: " + _DAMAGED.format(what))
        if len(channels) > MOST_CHANNELS:
            raise InvalidLogError(
                f"{source.path}: {len(channels)} channels, more than {MOST_CHANNELS}; export those that are needed"
            )
        headers = _short_names(names)
        with _npt(source, _DAMAGED, remarks):
            has_clock = any("wf_increment" in channel.properties for channel in channels)
        at = positions(source.path, headers, column_map, ("time_s",) if has_clock else ())
        used = {column: channels[k] for column, k in at.items()}
        with _npt(source, _DAMAGED, remarks):
            for column, channel in used.items():
                _check_channel(source, column, channel)
            plan = _plan(source.path, {column: names[k] for column, k in at.items()}, used)
    count = RowCount(plan.rows)

    def blocks(rows: int) -> Iterator[Block]:
        return _blocks(source, plan, rows, remarks)

    if "time_s" in at:
        return Table(tuple(at), blocks, count, metadata, remarks=remarks)
    notes = ("time from the start and step of the waveform", *_rate_notes(plan))
    return Table((*at, "time_s"), blocks, count, metadata, notes, remarks=remarks)


def tdms_columns(
    source: Source, rows: int
) -> tuple[dict[str, Any], dict[str, str], bool, tuple[str, ...], tuple[str, ...]]:
    """The first samples of all channels of one length, their units, whether time_s comes of a waveform, metadata, notes."""
    remarks: list[str] = []
    with source.open() as stream, _npt(source, _DAMAGED, remarks):
        file = _opened(stream)
        channels = [channel for group in file.groups() for channel in group.channels()]
        names = _short_names([(str(c.group_name), str(c.name)) for c in channels])
        longest = max((len(channel) for channel in channels), default=0)
        kept = {n: c for n, c in zip(names, channels, strict=True) if longest and len(c) == longest}
        arrays = {n: np.asarray(c.read_data(offset=0, length=min(rows, longest))) for n, c in kept.items()}
        units = {
            n: str(c.properties.get("unit_string", c.properties.get("NI_UnitDescription", "")))
            for n, c in kept.items()
        }
        metadata = tuple(f"{key}: {value}" for key, value in file.properties.items())
        steps = {float(c.properties["wf_increment"]) for c in kept.values() if "wf_increment" in c.properties}
    others = [name for name in names if name not in kept]
    notes = (f"channels with fewer samples are not shown: {', '.join(others[:8])}",) if others else ()
    clock = "time_s" not in arrays and len(steps) == 1 and longest > 0
    if clock:
        arrays = {"time_s": np.arange(min(rows, longest)) * steps.pop(), **arrays}
        notes = (*notes, "time from the start and step of the waveform")
    return arrays, units, clock, metadata, notes


@contextmanager
def _npt(source: Source, refusal: str, remarks: list[str]) -> Iterator[None]:
    """Around a call of npTDMS, which brings a handler of its own that writes to the terminal."""
    from nptdms.log import log_manager

    handler = log_manager.console_handler
    before = handler.level
    handler.setLevel(logging.CRITICAL + 1)
    try:
        with third_party(source.path, refusal, remarks, _LOGGER):
            yield
    finally:
        handler.setLevel(before)


def _opened(stream: Any) -> Any:
    from nptdms import TdmsFile

    return TdmsFile.open(stream)


def _short_names(names: list[tuple[str, str]]) -> list[str]:
    """Channel names, with their group where that is needed to tell them apart."""
    alone = [channel for _, channel in names]
    return [c if alone.count(c) == 1 else f"{group}/{c}" for group, c in names]


def _check_channel(source: Source, column: str, channel: Any) -> None:
    """Raises InvalidLogError for what are no real numbers, and for more of them than the file has room for."""
    kind = np.dtype(channel.dtype)
    if kind.kind not in "iuf" and not (kind.kind == "M" and column == "time_s"):
        raise InvalidLogError(
            f"{source.path}: column {column} is of type {kind}; export it as numbers in {COLUMNS[column].unit}"
        )
    raw = channel.data_type.size if getattr(channel, "data_type", None) is not None else kind.itemsize
    if len(channel) * max(int(raw or 1), 1) > source.size:
        raise InvalidLogError(
            f"{source.path}: " + _DAMAGED.format(f"channel {channel.name!r} claims {len(channel)} samples")
        )


# --- the channels' clocks ------------------------------------------------------------------------


def _plan(path: str, names: dict[str, tuple[str, str]], used: dict[str, Any]) -> _Plan:
    lengths = {column: len(channel) for column, channel in used.items()}
    waves = _waveforms(path, used)
    if "time_s" in used:
        _check_one_rate(path, used, waves)
        rows = max(lengths.values())
        return _Plan(names, None, dict.fromkeys(used, OnClock(0, 1)), rows)
    for column, channel in used.items():
        if column not in waves:
            raise InvalidLogError(
                f"{path}: channel {channel.name!r} has no wf_increment, so its clock is not known; export it as a waveform"
            )
    shown = {column: str(channel.name) for column, channel in used.items()}
    by_name = {f"{shown[column]}": column for column in used}
    if len(by_name) < len(used):
        by_name = {"/".join(names[column]): column for column in used}
    wave, placed, rows = one_clock(
        path,
        {name: waves[column] for name, column in by_name.items()},
        {name: lengths[column] for name, column in by_name.items()},
    )
    return _Plan(names, wave, {by_name[name]: at for name, at in placed.items()}, rows)


def _waveforms(path: str, used: dict[str, Any]) -> dict[str, Waveform]:
    """The clock of every channel that has one: offset and increment, after a start of its own if the starts differ."""
    clocked = {c: channel for c, channel in used.items() if "wf_increment" in channel.properties}
    begins = {c: channel.properties.get("wf_start_time") for c, channel in clocked.items()}
    known = [begin for begin in begins.values() if begin is not None]
    found = {}
    for column, channel in clocked.items():
        step = _property(path, channel, "wf_increment")
        offset = _property(path, channel, "wf_start_offset")
        if len(set(map(str, known))) > 1:
            if begins[column] is None:
                raise InvalidLogError(
                    f"{path}: channel {channel.name!r} has no wf_start_time, and those of the others differ; export all "
                    "channels on one clock"
                )
            offset += _seconds(begins[column]) - min(map(_seconds, known))
        found[column] = checked_waveform(path, str(channel.name), offset, step)
    return found


def _property(path: str, channel: Any, key: str) -> float:
    value = channel.properties.get(key, 0.0)
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        raise InvalidLogError(
            f"{path}: {key} of channel {channel.name!r} is {str(value)[:40]!r}, not a number; export it again"
        )
    return float(value)


def _seconds(begin: Any) -> float:
    """A start time as seconds since 1970, to the microsecond."""
    if isinstance(begin, datetime.datetime):
        return begin.timestamp()
    return float(np.datetime64(begin, "us").astype(np.int64)) * 1e-6


def _check_one_rate(path: str, used: dict[str, Any], waves: dict[str, Waveform]) -> None:
    """With a time channel the samples belong together row by row, so that clocks of their own must not differ."""
    given = {column: wave for column, wave in waves.items() if column != "time_s"}
    if given:
        lengths = {column: len(used[column]) for column in given}
        _, placed, _ = one_clock(path, given, lengths)
        for column, at in placed.items():
            if at != OnClock(0, 1):
                raise InvalidLogError(
                    f"{path}: channel {used[column].name!r} has a clock of its own, other than the time channel's; export "
                    "all channels on one clock"
                )


def _rate_notes(plan: _Plan) -> tuple[str, ...]:
    if plan.wave is None:
        return ()
    return tuple(
        f"{column} has {1 / (at.stride * plan.wave.step):.6g} samples a second on a clock of {1 / plan.wave.step:.6g}"
        for column, at in plan.placed.items()
        if at.stride > 1
    )


# --- the samples ---------------------------------------------------------------------------------


def _blocks(source: Source, plan: _Plan, rows: int, remarks: list[str]) -> Iterator[Block]:
    with source.open() as stream:
        with _npt(source, _DAMAGED, remarks):
            file = _opened(stream)
            channels = {column: file[group][name] for column, (group, name) in plan.channels.items()}
        stamps = Stamps(source.path, remarks)
        for start in range(0, plan.rows, rows):
            count = min(rows, plan.rows - start)
            refusal = f"breaks off after row {start} ({{}}); copy it again"
            with _npt(source, refusal, remarks):
                values = {
                    column: _part(channel, plan.placed[column], start, count, stamps)
                    for column, channel in channels.items()
                }
            index = np.arange(start, start + count)
            if plan.wave is not None:
                values["time_s"] = plan.wave.times(index)
            yield Block(index + 1, values)


def _part(channel: Any, at: OnClock, start: int, count: int, stamps: Stamps) -> Array:
    """`count` rows from `start` on, NaN where the channel has no sample."""
    first = max(-(-(start - at.shift) // at.stride), 0)
    last = min((start + count - 1 - at.shift) // at.stride, len(channel) - 1)
    if last < first:
        return np.full(count, np.nan)
    samples = np.asarray(channel.read_data(offset=first, length=last - first + 1))
    if samples.dtype.kind == "M":
        samples = stamps.seconds(samples.astype("M8[ns]").astype(np.int64), ~np.isnat(samples))
    if samples.size != last - first + 1 or samples.dtype.kind not in "iuf":
        raise ValueError(f"channel {channel.name!r} holds fewer samples than it says")
    with np.errstate(invalid="ignore"):  # a signalling NaN
        return on_clock(samples.astype(np.float64), first, at, start, count)
