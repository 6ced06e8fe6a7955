"""What a file holds, as lines for a terminal and as JSON."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from observer_fi.logs import Column, Guess, Inspection, Motion, meaning, shown_range, understood
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import acquisition_table
from observer_fi.records import ChannelTraits

SCHEMA = "observer-fi/inspect/1"
MAP_FILE = "columns.toml"
_SEPARATORS = {"\t": "tabs", ",": "commas", ";": "semicolons", "|": "bars", " ": "blanks"}
_MOST_COLUMNS, _MOST_MOVES, _MOST_METADATA, _WIDEST = 40, 4, 3, 34


def inspection_json(found: Inspection) -> dict[str, Any]:
    """One file as JSON takes it."""
    contents, table = found.contents, found.contents.table
    layout = None if table is None else {
        "separator": table.separator, "decimal_comma": table.decimal == ",", "header_line": table.header_line,
        "data_line": table.data_line,
    }  # fmt: skip
    return {
        "schema": SCHEMA,
        "path": contents.path, "format": contents.kind, "layout": layout, "rows": contents.rows, "whole": contents.whole,
        "metadata": list(contents.metadata), "notes": [*contents.notes, *found.notes],
        "columns": [_column_json(column, _guess_of(found, column)) for column in contents.columns],
        "clock": None if found.clock is None else vars(found.clock).copy(),
        "acquisition": acquisition_table(found.acquisition),
        "moves": {"from": "command" if found.commanded else "position", "moves": [m._asdict() for m in found.moves]},
        "drives": {need.drive: {"missing": list(need.missing), "for_streams": list(need.for_streams)} for need in found.needs},
        "doubts": list(found.doubts), "refused": found.refused or None, "column_map": found.column_map,
    }  # fmt: skip


def _guess_of(found: Inspection, column: Column) -> Guess | None:
    return next((g for g in found.guesses.values() if column.header in (g.header, g.time_of_day)), None)


def _column_json(column: Column, guess: Guess | None) -> dict[str, Any]:
    span = shown_range(column)
    told = None if guess is None else {
        "column": guess.column, "unit": guess.unit, "factor": guess.factor, "sure": guess.sure, "why": list(guess.why),
        "also": list(guess.also),
    }  # fmt: skip
    return {
        "header": column.header, "unit": column.unit or None, "min": span and span[0], "max": span and span[1],
        "first": list(column.texts), "missing": column.missing, "not_numbers": column.strange, "guess": told,
    }  # fmt: skip


# --- the terminal --------------------------------------------------------------------------------


def inspection_text(found: Inspection) -> str:
    """One file in the lines that a person reads, the column map last."""
    name = Path(found.contents.path).name
    of_map = [f"  {line}".rstrip() for line in found.column_map.splitlines()]
    title = f"column map for --columns ({name}):"
    if not found.needs_map:
        title, of_map = "column map: none is needed, the columns have the names of a log", []
    lines = [
        _headline(found), *_facts(found), "", *_column_lines(found), "", *_log_lines(found), *_need_lines(found), "",
        title, *of_map,
    ]  # fmt: skip
    return "\n".join(_shown(line) for line in lines) + "\n"


def _shown(line: str) -> str:
    """A line that no terminal obeys; spaces of any kind are plain ones."""
    return "".join(" " if c.isspace() else c if c.isprintable() else ascii(c)[1:-1] for c in line)


def _headline(found: Inspection) -> str:
    contents, table = found.contents, found.contents.table
    parts = [contents.kind]
    if table is not None:
        parts.append(f"{_SEPARATORS.get(table.separator, repr(table.separator))} between columns")
        parts += ["decimal comma"] if table.decimal == "," else []
        parts.append(f"header in line {table.header_line}" if table.header_line else "no header")
        parts += [f"first row in line {table.data_line}"] if table.data_line != table.header_line + 1 else []
    parts.append(f"{contents.rows} rows" if contents.whole else f"the first {contents.rows} rows")
    return f"{contents.path}: {', '.join(parts)}"


def _facts(found: Inspection) -> Iterator[str]:
    contents, clock = found.contents, found.clock
    for line in contents.metadata[:_MOST_METADATA]:
        yield f"  {line[:150]}"
    if len(contents.metadata) > _MOST_METADATA:
        yield f"  ... {len(contents.metadata) - _MOST_METADATA} more lines of metadata"
    for note in contents.notes:
        yield f"  {note}"
    if clock is None:
        yield "clock: none found"
        return
    said = [f"{digits(clock.rate_hz, 5)} Hz over {digits(clock.seconds, 5)} s"]
    said += [f"starts {clock.start}"] if clock.start else []
    said += [f"stamps in steps of {with_unit(clock.resolution_s, 's')}"] if clock.resolution_s else []
    said.append(f"jitter {with_unit(clock.jitter_s, 's')}" if clock.jitter_s else "even")
    said.append(f"{clock.gaps} gap{'s' if clock.gaps != 1 else ''}" if clock.gaps else "no gaps")
    said += [f"{clock.backward} stamps that do not increase"] if clock.backward else []
    yield f"clock: {', '.join(said)}"


def _column_lines(found: Inspection) -> list[str]:
    rows: list[tuple[str, ...]] = [("column", "range", "first values", "missing", "is", "because")]
    for column in found.contents.columns[:_MOST_COLUMNS]:
        rows.append(_column_row(column, _guess_of(found, column)))
    widths = [min(max(len(row[k]) for row in rows), _WIDEST) for k in range(5)]
    lines = [
        "  ".join([*(f"{_cut(row[k]):<{widths[k]}}" for k in range(5)), row[5]]).rstrip() for row in rows
    ]
    more = len(found.contents.columns) - _MOST_COLUMNS
    return [*lines, *([f"... and {more} more columns"] if more > 0 else [])]


def _column_row(column: Column, guess: Guess | None) -> tuple[str, ...]:
    span = shown_range(column)
    shown = (
        "no numbers"
        if span is None
        else f"{digits(span[0], 5)} .. {digits(span[1], 5)}"
        if span[0] != span[1]
        else f"always {digits(span[0], 5)}"
    )
    missing = f"{digits(100.0 * column.missing, 2)} %" if column.missing else "-"
    header = column.header or "(no name)"
    first = " ".join(column.texts)
    if guess is None:
        strange = f"{digits(100.0 * column.strange, 2)} % are no numbers" if column.strange else ""
        return (
            header,
            shown,
            first,
            missing,
            "not used",
            strange or meaning(understood(column.header, column.unit)),
        )
    factor = "" if guess.factor == 1.0 else f" x {guess.factor:g}"
    because = "; ".join((f"{guess.sure}: {', '.join(guess.why)}", *guess.also))
    return header, shown, first, missing, f"{guess.column} in {guess.unit}{factor}", because


def _cut(text: str) -> str:
    return text if len(text) <= _WIDEST else text[: _WIDEST - 3] + "..."


def _log_lines(found: Inspection) -> Iterator[str]:
    if found.acquisition is not None:
        a = found.acquisition
        channels = (
            ("voltage_v", "V", a.voltage),
            ("current_a", "A", a.current),
            ("position_m", "m", a.position),
        )
        told = [f"{name} {_traits(c, unit)}" for name, unit, c in channels if math.isfinite(c.noise_std)]
        yield f"logger: {'; '.join(told) or 'nothing can be told of it'}"
        yield _moves(found)
    for note in found.notes:
        yield f"note: {note}"
    for doubt in found.doubts:
        yield f"doubt: {doubt}"
    if found.refused:
        yield f"with this map the log is refused: {found.refused}"


def _traits(c: ChannelTraits, unit: str) -> str:
    said = [f"noise {with_unit(c.noise_std, unit)}"]
    said += [f"steps of {with_unit(c.resolution, unit)}"] if c.resolution else []
    said += [f"fresh at {digits(c.update_hz, 4)} Hz only"] if c.update_hz else []
    said += [f"read in {digits(100.0 * c.read, 2)} % of the rows"] if c.read < 0.5 else []
    said += [f"mean of {c.averaged} samples"] if c.averaged > 1 else []
    said += [f"coloured over {with_unit(c.correlation_s, 's')}"] if c.correlation_s else []
    said += [f"lines at {', '.join(digits(line.hz, 4) for line in c.lines)} Hz"] if c.lines else []
    said += [f"{c.spikes} spikes"] if c.spikes else []
    return ", ".join(said)


def _moves(found: Inspection) -> str:
    how = "of the command" if found.commanded else "found in the position"
    if not found.moves:
        return "moves: none; a log of rests tells nothing of faults"
    shown = [_move(move) for move in found.moves[:_MOST_MOVES]]
    shown += ["..."] if len(found.moves) > _MOST_MOVES else []
    return f"moves: {len(found.moves)} {how}: {', '.join(shown)}"


def _move(move: Motion) -> str:
    return f"{move.start_s:.2f} to {move.end_s:.2f} s ({with_unit(move.travel, 'm', '+')})"


def _need_lines(found: Inspection) -> Iterator[str]:
    yield "for diagnose, fleet, identify, improve, by the drive of the rig file:"
    for need in found.needs:
        live = f"; watch needs {', '.join(need.for_streams)} too" if need.for_streams else ""
        what = f"missing: {', '.join(need.missing)}" if need.missing else "everything is there"
        yield f"  {need.drive}: {what}{live}"
