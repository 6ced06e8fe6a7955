"""`inspect_log`: what a file holds, as one record that a page or a terminal prints."""

import math
import tomllib
from dataclasses import dataclass, replace

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.columns import COLUMNS, STAMPS, ColumnMap, columns_from_table
from observer_fi.logs.ingest import open_log
from observer_fi.logs.inspection.commands import with_commands
from observer_fi.logs.inspection.contents import MOST_ROWS, Column, Contents, columns_by_header, contents_of
from observer_fi.logs.inspection.guesses import Guess, guesses, implausible
from observer_fi.logs.inspection.map_text import map_text
from observer_fi.logs.inspection.motion import Motion, motions, moving
from observer_fi.logs.inspection.motor_checks import checked_by_motor
from observer_fi.logs.inspection.nameless import with_nameless
from observer_fi.logs.inspection.needs import Need, needs
from observer_fi.logs.inspection.vocabulary import understood
from observer_fi.logs.logger.acquisition import acquisition_of
from observer_fi.logs.logger.clock import JITTER, clock_of
from observer_fi.logs.moves import log_segments
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, Array, Log

GAP = 1.5  # of the median interval


@dataclass(frozen=True)
class ClockFound:
    """The clock of a file: rate [Hz], jitter and step of its stamps [s], gaps, and when it starts if it says so."""

    rate_hz: float
    seconds: float
    jitter_s: float
    resolution_s: float | None
    gaps: int
    backward: int
    start: str


@dataclass(frozen=True)
class Inspection:
    """All there is to say of one file.

    guesses: by column of the contract. clock, acquisition, moves: None and empty where the file cannot be read as a log yet;
    refused: the line that says why. commanded: whether moves are those of a command, or found in the position. doubts: what
    does not fit. column_map: TOML.
    """

    contents: Contents
    guesses: dict[str, Guess]
    clock: ClockFound | None
    acquisition: Acquisition | None
    moves: tuple[Motion, ...]
    commanded: bool
    needs: tuple[Need, ...]
    doubts: tuple[str, ...]
    column_map: str
    refused: str = ""
    notes: tuple[str, ...] = ()

    @property
    def needs_map(self) -> bool:
        """Whether the file is no log without a map."""
        plain = all(
            g.header == g.column and g.scale == 1.0 and g.unit in _OWN_UNITS for g in self.guesses.values()
        )
        table = self.contents.table
        found_alone = table is None or (
            table.separator != " " and table.header_line and table.data_line == table.header_line + 1
        )
        return not (plain and found_alone and self.guesses and not self.refused)


_OWN_UNITS = {kind.unit for kind in COLUMNS.values()} | {STAMPS}


def inspect_log(path: str, column_map: ColumnMap | None = None, rig: Rig | None = None) -> Inspection:
    """What a file holds. Raises InvalidLogError for one that cannot be read or is no table, for nothing else."""
    contents = contents_of(path, column_map)
    values = {column.header: column.values for column in columns_by_header(contents)}
    with np.errstate(all="ignore"):
        found = guesses(contents, column_map)
        found = with_commands(found, tuple(columns_by_header(contents)))
        found = with_nameless(found, values, _silent(contents, found))
        found = with_commands(found, tuple(columns_by_header(contents)))
        found, doubts = checked_by_motor(found, values, rig.model if rig else None)
        doubts = (*doubts, *implausible(found, values))
        clock = _clock(contents, found, values)
    text = map_text(contents, found)
    missing = needs(set(found))
    bare = Inspection(
        contents, found, clock, None, (), False, missing, (*doubts, *_advice(contents, found)), text
    )
    if all(need.missing for need in missing):
        return bare
    return _as_log(bare, rig)


def _silent(contents: Contents, found: dict[str, Guess]) -> list[str]:
    """Headers that say nothing, and are nothing yet."""
    taken = {guess.header for guess in found.values()}
    heard = ((c.header, understood(c.header, c.unit)) for c in columns_by_header(contents))
    return [
        name
        for name, h in heard
        if name not in taken and not (h.quantities or h.unit or h.commanded or h.deviation)
    ]


def _clock(contents: Contents, found: dict[str, Guess], values: dict[str, Array]) -> ClockFound | None:
    guess = found.get("time_s")
    if guess is None or guess.header not in values:
        return None
    raw = values[guess.time_of_day or guess.header] * guess.scale  # which counts the midnights that it passes
    t = raw[np.isfinite(raw)]
    steps = np.diff(t)
    if steps.size < 2 or not np.median(steps) > 0.0:
        return None
    usual, ordered = float(np.median(steps)), np.unique(t)
    told = clock_of(ordered)
    gaps, backward = int(np.count_nonzero(steps > GAP * usual)), int(np.count_nonzero(steps <= 0.0))
    start = _start(contents, guess, float(t[0]))
    jitter = told.jitter_s if told.jitter_s > JITTER * usual else 0.0
    return ClockFound(1.0 / usual, float(t[-1] - t[0]), jitter, told.resolution_s, gaps, backward, start)


def _start(contents: Contents, guess: Guess, first: float) -> str:
    """When a log with absolute stamps starts, as text."""
    if guess.unit.startswith("epoch") and abs(first) < 1e10:
        return f"{np.datetime64(round(first * 1e6), 'us')} UTC"
    texts = {column.header: column.texts for column in contents.columns if column.stamps}
    own = [texts[h][0] for h in (guess.header, guess.time_of_day or "") if texts.get(h)]
    return " ".join(own)


def _advice(contents: Contents, found: dict[str, Guess]) -> tuple[str, ...]:
    """What a map cannot do, for columns that are nearly what is missing."""
    said = []
    heard = {c.header: understood(c.header, c.unit) for c in contents.columns}
    off = [h for h, u in heard.items() if u.deviation and ("position" in u.quantities or u.unit is None)]
    if "position_m" not in found and "position_cmd_m" in found and off:
        goal = found["position_cmd_m"].header
        said.append(
            f"position_m may be {goal!r} less {off[0]!r}: a map cannot subtract, write it as a column of its own"
        )
    if "time_s" not in found:
        counters = [h for h, u in heard.items() if "number" in u.quantities and not u.deviation]
        hint = f" ({', '.join(counters[:3])} only count)" if counters else ""
        said.append(
            f"no column is a clock{hint}: write time_s as a column, or the rate of the logger is not known"
        )
    for header, u in heard.items():
        if u.unit is not None and u.unit.of == "mass" and "load" in u.quantities:
            said.append(
                f"{header!r} is a mass: as a weight along the axis it is load_n with unit N and factor 9.81"
            )
        if (
            u.unit is not None
            and u.unit.of == "linear speed"
            and u.commanded
            and "speed_cmd_rad_s" not in found
        ):
            said.append(
                f"{header!r} is a speed along the axis: speed_cmd_rad_s is that over D, as a factor in the map"
            )
    names = [c.header for c in contents.columns]
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        said.append(f"headers that stand several times cannot be mapped: {', '.join(twice[:5])}")
    return tuple(said)


# --- as a log ------------------------------------------------------------------------------------


def _as_log(bare: Inspection, rig: Rig | None) -> Inspection:
    """With what the file shows once it is read with the proposed map; with the line of the refusal, where it is refused."""
    path = bare.contents.path
    try:
        column_map = columns_from_table(tomllib.loads(bare.column_map))
        log = _first_part(path, column_map)
    except (InvalidLogError, UsageError) as error:
        return replace(bare, refused=str(error).removeprefix(f"{path}: "))
    usual = rig.file_noise_std if rig is not None else np.zeros(3)
    commanded = bool(np.isfinite(log.w_cmd).all() and log.w_cmd.any())
    with np.errstate(all="ignore"):
        mask = moving(log.t, log.z[:, 2])
        if commanded:
            segments = log_segments(log)
            moves = tuple(_move(log, s.start, s.stop) for s in segments)
        else:
            moves = motions(log.t, log.z[:, 2], mask)
            log = replace(log, w_cmd=mask.astype(np.float64))
        acquisition = acquisition_of(log, usual)
    return replace(bare, acquisition=acquisition, moves=moves, commanded=commanded, notes=log.notes)


def _first_part(path: str, column_map: ColumnMap) -> Log:
    """The first part of a log, whole where it is short. Raises InvalidLogError for one that is refused."""
    for log in open_log(path, column_map).chunks(MOST_ROWS):
        if log.t.size >= 10:
            return log
        break
    raise InvalidLogError(f"{path}: too few samples; record a whole move")


def _move(log: Log, start: int, stop: int) -> Motion:
    x = log.z[start:stop, 2]
    known = x[np.isfinite(x)]
    travel = float(known[-1] - known[0]) if known.size > 1 else math.nan
    return Motion(float(log.t[start]), float(log.t[stop - 1]), travel)


def shown_range(column: Column) -> tuple[float, float] | None:
    """Smallest and largest number of a column, None where it has none."""
    known = column.values[np.isfinite(column.values)]
    return (float(known.min()), float(known.max())) if known.size else None
