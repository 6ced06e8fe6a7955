"""Blocks of numbers become Logs: one increasing clock, SI units, and a list of all that was masked.

Every function takes a block and the running `Tally` of the file: any log costs one block of memory.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.logger.clock import ByRows, by_rows
from observer_fi.logs.logger.resampled import interpolated, lost, out_of_range
from observer_fi.logs.tables import LISTED, NONE, Block, LeftOut, Table, joined_blocks, place, together
from observer_fi.numerics import digits
from observer_fi.records import Array, Gap, Log, Rejected

FEWEST_SAMPLES = 10
NO_PITCH = "pitch_deg is absent: taken"  # how the note begins that says so
SLOWEST_STEP_S = (
    0.05  # the servo rings at 22 Hz: beyond this a log shows no move, or its clock is not in seconds
)
FASTEST_HZ = 1e6  # nothing of an actuator happens in a microsecond: beyond this a clock is not in seconds
STUCK_ROWS = 10_000  # rows in a row without a new time: the clock stands still
LATEST_STAMP_S = 1.6e10  # since 1970: the year 2477
WRONG_UNIT = 0.25  # of the samples beyond the limit
TELLING_ROWS, JOINED_ROWS = 1800, 2000  # that tell what clock they have, and that are read for it
GAP = 1.5  # of the median sampling interval
JITTER = 0.25  # of the median sampling interval
CHANNEL_COLUMNS = ("voltage_v", "current_a", "position_m")

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


class Summary(NamedTuple):
    """What there is to say about a whole file. Lists hold the first `LISTED` entries, counts are complete."""

    samples: int
    rate_hz: float
    gaps: tuple[Gap, ...]
    gap_count: int
    rejected: tuple[Rejected, ...]
    rejected_count: int
    notes: tuple[str, ...]


@dataclass
class Tally:
    """What is carried from one block of a file to the next. step: median interval of the first block [s];
    start: of a clock that counts from 1970 on, in the file's unit."""

    path: str
    column_map: ColumnMap
    table: Table
    samples: int = 0
    left_out: int = 0
    step: float = float("nan")
    start: float | None = None
    last_t: float = float("nan")
    last_input: dict[str, float] = field(default_factory=dict)
    gaps: list[Gap] = field(default_factory=list)
    gap_count: int = 0
    rejected: list[Rejected] = field(default_factory=list)
    rejected_count: int = 0
    repeated: int = 0
    by_rows: ByRows | None = None
    jittery: int = 0
    worst_jitter: float = 0.0
    worst_row: int = 0
    usable: dict[str, int] = field(default_factory=dict)
    beyond: dict[str, int] = field(default_factory=dict)
    interpolated: dict[str, float | None] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    out_of_range: dict[str, int] = field(default_factory=dict)

    def place(self, row: int) -> str:
        """Row, and line where the file is text, for a message."""
        first = self.table.first_line
        return place(row, None if first is None else first + row - 1)


class _Masked:
    """The samples of one block that were repaired, masked or left out."""

    def __init__(self, block: Block) -> None:
        self.rows, self.count = block.rows, block.left_out.total
        self.entries = list(block.left_out.entries)

    def add(self, which: Indices, column: str, reason: str, values: Array | None = None) -> None:
        """Lists the samples of the indices `which`; {} in the reason stands for the value."""
        self.count += which.size
        for k in which[: max(LISTED - len(self.entries), 0)]:
            said = reason if values is None else reason.format(f"{values[k]:.9g}")
            self.entries.append(Rejected(int(self.rows[k]), column, said))


def cleaned(blocks: Iterable[Block], tally: Tally) -> Iterator[Log]:
    """The blocks as Logs, in order. Raises InvalidLogError where the file cannot be used.

    Rows with no value at all are left out, listed. A row without a time of its own (none, or that of
    the row before) is placed evenly between its neighbours with its channels masked.
    """
    first: list[Log] = []  # none of a file that has too few for any judgement
    for block in _with_a_clock(_ending_on_a_time(blocks, tally), tally):
        first.append(_log(block, tally))
        if tally.samples >= FEWEST_SAMPLES:
            yield from first
            first.clear()
    _check_whole(tally)


# --- the clock ------------------------------------------------------------------------------------


def _with_a_clock(blocks: Iterable[Block], tally: Tally) -> Iterator[Block]:
    """The blocks, as soon as the first of them, however few rows each has, tell what clock the file has."""
    left, first, rows = iter(blocks), list[Block](), 0
    while rows < JOINED_ROWS and (block := next(left, None)) is not None:
        first.append(block)
        rows += block.rows.size
    if first:
        tally.by_rows = by_rows(np.concatenate([block.values["time_s"] for block in first])[:TELLING_ROWS])
    yield from first
    yield from left


def _ending_on_a_time(blocks: Iterable[Block], tally: Tally) -> Iterator[Block]:
    """The blocks in the units of the contract, cut so that each but the last ends with a time of its own."""
    held: list[Block] = []
    last = float("nan")
    for raw in blocks:
        block = joined_blocks([*held, _in_units(raw, tally)])
        time = block.values["time_s"]
        timed = np.flatnonzero(np.isfinite(time))
        end = 0
        if timed.size and time[timed[-1]] != last:
            last = float(time[timed[-1]])
            end = int(np.argmax(time == last)) + 1
        rest = _part(block, slice(end, None), NONE if end else block.left_out)
        _check_alive(rest, tally)
        held = [rest]
        if end:
            yield _part(block, slice(0, end), block.left_out)
    if held and (held[0].rows.size or held[0].left_out.total):
        yield held[0]


def _check_alive(rest: Block, tally: Tally) -> None:
    if rest.rows.size > STUCK_ROWS:
        raise InvalidLogError(
            f"{tally.path}: {tally.place(int(rest.rows[0]))}, column time_s: the time stands still or is "
            f"missing for {rest.rows.size} rows; cut the file there, or export it with the right clock"
        )


def _in_units(block: Block, tally: Tally) -> Block:
    column_map = tally.column_map
    values = {}
    with np.errstate(over="ignore"):
        for column, raw in block.values.items():
            factor, plain = column_map.source(column).factor, _quiet(raw)
            if column == "time_s" and column_map.source(column).epoch:
                plain = _since_start(plain, factor, tally)
            values[column] = plain if factor == 1.0 else plain * factor
    time, limit = values["time_s"], column_map.limit("time_s")
    if not (np.abs(time) <= limit).all():
        values["time_s"] = np.where(np.abs(time) > limit, np.inf, time)
    return _with_values(block._replace(values=values))


def _since_start(stamps: Array, factor: float, tally: Tally) -> Array:
    """Times since 1970, in units of `factor` [s], from the first one of the file on."""
    known = np.abs(stamps * factor) < LATEST_STAMP_S
    if tally.start is None and known.any():
        tally.start = float(stamps[known][0])
        begin = np.datetime64(round(tally.start * factor * 1e6), "us")
        tally.table.remarks.append(f"time stamps are absolute: time_s is 0 at {begin} UTC")
    return stamps - (tally.start or 0.0)


def _quiet(values: Array) -> Array:
    """The same values with one kind of NaN: a signalling one, which binary files can hold, warns at every operation."""
    missing = np.isnan(values)
    return np.where(missing, np.nan, values) if missing.any() else values


def _with_values(block: Block) -> Block:
    """The block without rows that have no value at all, which are listed as left out."""
    empty = np.isnan(block.values["time_s"])
    if not empty.any():
        return block
    for values in block.values.values():
        empty &= np.isnan(values)
    rows = block.rows[empty]
    entries = tuple(Rejected(int(row), "time_s", "no value at all: row left out") for row in rows[:LISTED])
    return _part(block, ~empty, together([block.left_out, LeftOut(entries, rows.size)]))


def _part(block: Block, which: slice | Mask, left_out: LeftOut) -> Block:
    return Block(block.rows[which], {name: v[which] for name, v in block.values.items()}, left_out)


def _clock(block: Block, tally: Tally) -> tuple[Array, Mask]:
    """Strictly increasing times, and which rows have one of their own."""
    t = block.values["time_s"]
    if tally.by_rows is not None:
        t = tally.by_rows.take(t)
    good = np.isfinite(t)
    own = t if good.all() else t[good]
    before = np.concatenate(([tally.last_t], own[:-1]))
    _check_forward(block.rows[good], before, own, tally)
    good[good] = own != before  # the first time of a file differs from NaN
    _set_step(t[good], tally)
    return _placed(t, good, tally), good


def _check_forward(rows: NDArray[np.int64], before: Array, own: Array, tally: Tally) -> None:
    back = np.flatnonzero(own < before)
    if back.size:
        k = int(back[0])
        raise InvalidLogError(
            f"{tally.path}: {tally.place(int(rows[k]))}, column time_s: time runs backward "
            f"({before[k]:.9g} -> {own[k]:.9g}); split the file where the clock restarts, or sort it by time"
        )


def _set_step(t: Array, tally: Tally) -> None:
    if np.isfinite(tally.last_t):
        t = np.concatenate(([tally.last_t], t))
    if np.isfinite(tally.step) or t.size < 2:
        return
    tally.step = float(np.median(np.diff(t)))
    if tally.step * FASTEST_HZ < 1.0 - 1e-6:
        raise InvalidLogError(
            f"{tally.path}: column time_s: {digits(1 / tally.step, 4)} samples a second are more than any actuator needs "
            f"(at most {FASTEST_HZ:.0e}); if the clock is not in seconds, map its unit with --columns"
        )
    if tally.step > SLOWEST_STEP_S:
        raise InvalidLogError(
            f"{tally.path}: column time_s: a sample every {digits(tally.step, 4)} s is too slow to show a move "
            f"(at least {1 / SLOWEST_STEP_S:.0f} a second); if the clock is not in seconds, map its "
            "unit with --columns"
        )


def _placed(t: Array, good: Mask, tally: Tally) -> Array:
    """t, with the rows that are not good placed evenly between the others, and a step apart at the ends."""
    if good.all():
        return t
    index = np.arange(t.size, dtype=np.float64)
    at, times = index[good], t[good]
    if np.isfinite(tally.last_t):
        at, times = np.concatenate(([-1.0], at)), np.concatenate(([tally.last_t], times))
    step = tally.step if np.isfinite(tally.step) else 1.0
    if times.size == 0:
        return index * step
    placed = np.interp(index, at, times)
    placed = np.where(index < at[0], times[0] - step * (at[0] - index), placed)
    return np.where(index > at[-1], times[-1] + step * (index - at[-1]), placed)


def _gaps(t: Array, good: Mask, rows: NDArray[np.int64], tally: Tally) -> tuple[Gap, ...]:
    """Gaps before and between the samples of a block; counts jitter on the way."""
    if not np.isfinite(tally.step) or not t.size:
        return ()
    before = np.concatenate(([tally.last_t if tally.samples else t[0] - tally.step], t[:-1]))
    ratio = (t - before) / tally.step
    wide = np.flatnonzero(ratio > GAP)
    off = np.abs(ratio - 1.0)
    off[wide] = 0.0
    if not good.all():
        off[~good | ~np.append(True, good[:-1])] = 0.0  # placed rows have no clock to be judged by
    tally.jittery += int(np.count_nonzero(off > JITTER))
    if float(off.max()) > max(JITTER, tally.worst_jitter):
        tally.worst_jitter, tally.worst_row = float(off.max()), int(rows[int(off.argmax())])
    tally.gap_count += wide.size
    found = tuple(Gap(float(before[k]), float(t[k]), round(float(ratio[k])) - 1) for k in wide[:LISTED])
    tally.gaps.extend(found[: LISTED - len(tally.gaps)])
    return found


# --- the channels ---------------------------------------------------------------------------------


def _log(block: Block, tally: Tally) -> Log:
    t, good = _clock(block, tally)
    masked = _Masked(block)
    _list_times(block, good, tally, masked)
    z = np.column_stack(
        [_own(column, t, _channel(column, block, good, tally, masked), tally) for column in CHANNEL_COLUMNS]
    )
    log = Log(
        path=tally.path,
        t=_owned(t),
        z=np.ascontiguousarray(z),
        w_cmd=_input("speed_cmd_rad_s", float("nan"), block, t, tally, masked),
        pitch=_input("pitch_deg", 0.0, block, t, tally, masked),
        encoder=_optional("encoder_rad", block, good, tally, masked),
        force=_optional("force_cmd_n", block, good, tally, masked),
        position_cmd=_optional("position_cmd_m", block, good, tally, masked),
        load=_input("load_n", 0.0, block, t, tally, masked) if "load_n" in block.values else None,
        metadata=tally.table.metadata,
        gaps=_gaps(t, good, block.rows, tally),
        rejected=tuple(sorted(masked.entries)),
        rejected_count=masked.count,
        notes=column_notes(tally.table) if tally.samples == 0 else (),
        first_row=tally.samples,
    )
    tally.rejected.extend(log.rejected[: LISTED - len(tally.rejected)])
    tally.rejected_count += log.rejected_count
    tally.samples += t.size
    tally.left_out += block.left_out.total
    tally.last_t = float(t[-1]) if t.size else tally.last_t
    return log


def _owned(values: Array) -> Array:
    """The values in memory of their own: readers hand out read-only views, for numba another type."""
    return np.array(values, dtype=np.float64, order="C")


def _list_times(block: Block, good: Mask, tally: Tally, masked: _Masked) -> None:
    if good.all():
        return
    time = block.values["time_s"]
    masked.add(np.flatnonzero(np.isnan(time)), "time_s", "no time: channels masked")
    limit = f"time is not finite or beyond {tally.column_map.limit('time_s'):g} s: channels masked"
    masked.add(np.flatnonzero(np.isinf(time)), "time_s", limit)
    repeated = np.flatnonzero(np.isfinite(time) & ~good)
    masked.add(repeated, "time_s", "time {} repeats: channels masked", time)
    tally.repeated += repeated.size


def _channel(column: str, block: Block, clocked: Mask, tally: Tally, masked: _Masked) -> Array:
    """(n,) the column, NaN where it is missing, not finite, beyond its limit, or has no time of its own."""
    values = block.values.get(column)
    if values is None:
        return np.full(block.rows.size, np.nan)
    believable = _believable(column, values, clocked, tally, masked)
    tally.usable[column] = tally.usable.get(column, 0) + int(np.count_nonzero(believable))
    return values if believable.all() else np.where(believable, values, np.nan)


def _own(column: str, t: Array, values: Array, tally: Tally) -> Array:
    """(n,) the column, NaN where a reading is out of range, or was put between others or for one that was lost."""
    lines, ends = interpolated(t, values), out_of_range(values)
    if ends is not None:
        tally.out_of_range[column] = tally.out_of_range.get(column, 0) + int(ends.sum())
        values = np.where(ends, np.nan, values)
    gone = lost(values)
    if gone is not None:
        tally.lost[column] = tally.lost.get(column, 0) + int(gone.sum())
        values = np.where(gone, np.nan, values)
    if lines is None:
        return values
    tally.interpolated[column] = lines.rate_hz
    return np.where(lines.own, values, np.nan)


def _optional(column: str, block: Block, clocked: Mask, tally: Tally, masked: _Masked) -> Array | None:
    return _owned(_channel(column, block, clocked, tally, masked)) if column in block.values else None


def _believable(column: str, values: Array, judged: Mask, tally: Tally, masked: _Masked | None) -> Mask:
    """Which of the judged values can be used; the others are listed."""
    limit = tally.column_map.limit(column)
    good = np.abs(values) <= limit
    if good.all():
        return judged
    bad = judged & ~good
    beyond = np.flatnonzero(bad & np.isfinite(values))
    tally.beyond[column] = tally.beyond.get(column, 0) + beyond.size
    if beyond.size:
        _check_unit(column, float(values[beyond[0]]), tally, tally.samples + values.size)
    if masked is not None:
        masked.add(np.flatnonzero(bad & np.isnan(values)), column, "no value: masked")
        masked.add(np.flatnonzero(bad & np.isinf(values)), column, "{} is not finite: masked", values)
        masked.add(beyond, column, f"{{}} is beyond {limit:g} {COLUMNS[column].unit}: masked", values)
    return good & judged


def _check_unit(column: str, example: float, tally: Tally, samples: int) -> None:
    """Single values beyond the limit are faults of the logger; a large part of the log is a wrong unit."""
    beyond, kind = tally.beyond[column], COLUMNS[column]
    if beyond >= FEWEST_SAMPLES and beyond > WRONG_UNIT * samples:
        raise InvalidLogError(
            f"{tally.path}: column {column}: {beyond} of {samples} values are beyond "
            f"{tally.column_map.limit(column):g} {kind.unit} (as {example:.6g}); map its unit "
            f"({', '.join(kind.units)}) with --columns, or raise its limit there"
        )


def _input(column: str, absent: float, block: Block, t: Array, tally: Tally, masked: _Masked) -> Array:
    """Pitch or command, which a model needs at every sample: interpolated where it is missing."""
    values = block.values.get(column)
    if values is None:
        return np.full(t.size, absent)
    good = _believable(column, values, np.ones(t.size, dtype=np.bool_), tally, None)
    filled = values
    if not good.all():
        masked.add(np.flatnonzero(~good), column, "no usable value: interpolated")
        known_t, known = t[good], values[good]
        if column in tally.last_input:
            known_t = np.concatenate(([tally.last_t], known_t))
            known = np.concatenate(([tally.last_input[column]], known))
        filled = np.interp(t, known_t, known) if known.size else np.zeros(t.size)
    tally.usable[column] = tally.usable.get(column, 0) + int(np.count_nonzero(good))
    if filled.size:
        tally.last_input[column] = float(filled[-1])
    return _owned(filled)


# --- the whole file -------------------------------------------------------------------------------


def _check_whole(tally: Tally) -> None:
    _check_nothing_lost(tally)
    if tally.samples < FEWEST_SAMPLES:
        raise InvalidLogError(
            f"{tally.path}: {tally.samples} samples are too few; record a whole move (at least "
            f"{FEWEST_SAMPLES} samples)"
        )
    if not np.isfinite(tally.step):
        raise InvalidLogError(f"{tally.path}: column time_s holds no usable times; export the log again")
    for column in ("current_a", "position_m", "force_cmd_n", "speed_cmd_rad_s"):
        needed = column != "force_cmd_n" or "current_a" not in tally.table.columns
        if needed and column in tally.table.columns and not tally.usable.get(column):
            raise InvalidLogError(
                f"{tally.path}: column {column} holds no usable value; check the sensor or the column map"
            )


def _check_nothing_lost(tally: Tally) -> None:
    """Every row of the file is a sample or is listed as left out: whatever a reader does, none is lost unseen."""
    rows = tally.table.count.rows
    if tally.samples + tally.left_out != rows:
        raise InvalidLogError(
            f"{tally.path}: of its {rows} rows {tally.samples} are samples and {tally.left_out} were left out, so that rows "
            "were lost in reading; export it again, as CSV without quotes"
        )


def column_notes(table: Table) -> tuple[str, ...]:
    """What the reader noted, and what follows from columns that are absent."""
    notes = {
        "voltage_v": "voltage_v is absent: the speed channel (V - Rm i) / Km is not available",
        "current_a": "current_a is absent: the drive is taken from force_cmd_n",
        "pitch_deg": f"{NO_PITCH} as 0",
        "speed_cmd_rad_s": "speed_cmd_rad_s is absent: it has to be recovered from the data",
    }
    unused = ("load_n is read; no equation uses it",) if "load_n" in table.columns else ()
    return (*table.notes, *table.remarks, *unused) + tuple(
        note for column, note in notes.items() if column not in table.columns
    )


def summary(tally: Tally) -> Summary:
    """Gaps, rejected samples and notes of all that was read."""
    notes = list(column_notes(tally.table))
    if "voltage_v" in tally.table.columns and not tally.usable.get("voltage_v"):
        notes.append("voltage_v holds no usable value: the speed channel is not available")
    if tally.by_rows is not None:
        notes.append(
            f"time_s says when rows came, several at a time: they are taken for evenly spaced, {digits(1.0 / tally.step, 4)} a "
            "second; log when they were read"
        )
    if tally.repeated > 0.01 * tally.samples:
        share = 100.0 * tally.repeated / tally.samples
        notes.append(f"{share:.0f} % of the time stamps repeat: the clock is written with too few digits")
    if tally.jittery:
        notes.append(
            f"{tally.jittery} time stamps are off by more than {100 * JITTER:.0f} % of a sampling interval "
            f"(worst {100 * tally.worst_jitter:.0f} %, {tally.place(tally.worst_row)}); used as they are"
        )
    for column, count in tally.lost.items():
        notes.append(
            f"{column} repeats itself to the last digit in {count} samples, a few at a time: taken for lost readings"
        )
    for column, count in tally.out_of_range.items():
        notes.append(
            f"{column} is at the end of its range, or next to it, in {count} samples: not taken; log it in a wider range"
        )
    for column, rate_hz in tally.interpolated.items():
        pace = "over gaps" if rate_hz is None else f"between readings, about {digits(rate_hz, 3)} a second"
        notes.append(
            f"{column} is interpolated {pace}: what is between is not taken; export it as it was read"
        )
    if tally.gap_count:
        notes.append(f"{tally.gap_count} gaps in the clock")
    if tally.rejected_count:
        notes.append(f"{tally.rejected_count} values repaired, masked or left out")
    return Summary(
        tally.samples,
        1.0 / tally.step,
        tuple(tally.gaps),
        tally.gap_count,
        tuple(tally.rejected),
        tally.rejected_count,
        tuple(notes),
    )
