"""What Python gets around a recording: what to record next (`plan`), and what a recorded file holds (`inspect`)."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from observer_fi.errors import UsageError
from observer_fi.logs import ColumnMap, Inspection, columns_of, inspect_log
from observer_fi.physics import Rig, load_rig
from observer_fi.plan import (
    Plan,
    asked_by,
    in_lines,
    limits_of,
    moves_csv,
    parse,
    plan_causes,
    plan_constants,
    plan_faults,
    to_json,
)  # fmt: skip
from observer_fi.report.inspection import inspection_json, inspection_text
from observer_fi.report.results.results import Result, drawn

if TYPE_CHECKING:
    from observer_fi.report.still_figures import Figure

AnyRig = str | Path | Rig | None


@dataclass(frozen=True, repr=False)
class Planned(Result):
    """The next log worth recording. moves: what `plan` writes as moves.csv."""

    record: Plan

    @property
    def moves(self) -> str:
        """The command at its corners, linear in between, as CSV."""
        return moves_csv(self.record)

    @property
    def headline(self) -> str:
        """One line: whether the moves decide, and why."""
        return in_lines(self.record)[0]

    verdict = headline

    def paragraphs(self) -> tuple[str, ...]:
        """The moves in words."""
        return tuple(in_lines(self.record)[1:])

    def to_dict(self) -> dict[str, Any]:
        """What plan.json holds."""
        return to_json(self.record)

    def to_frame(self) -> pd.DataFrame:
        """One row a corner of the command: time [s], speed [rad/s] or position [m], pitch [deg]."""
        return pd.read_csv(io.StringIO(self.moves))

    def figures(self) -> "dict[str, Figure]":
        """`command`: what to play; nothing where no moves help."""
        found: dict[str, Figure] = drawn().of_plan(self.record)
        return found


@dataclass(frozen=True, repr=False)
class Inspected(Result):
    """What a file holds: columns, clock, units, moves, and the column map that is proposed."""

    record: Inspection

    @property
    def column_map(self) -> str:
        """The proposed column map as TOML: for `--columns`, or `tomllib.loads` of it for `columns=`."""
        return self.record.column_map

    @property
    def headline(self) -> str:
        """One line: the file and its form."""
        return inspection_text(self.record).partition("\n")[0]

    verdict = headline

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about the columns or their units."""
        return self.record.doubts

    def __str__(self) -> str:
        return inspection_text(self.record)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

    def to_dict(self) -> dict[str, Any]:
        """What `inspect --json` prints."""
        return inspection_json(self.record)

    def to_frame(self) -> pd.DataFrame:
        """One row a column: header, unit, range, and what it is taken for."""
        return pd.json_normalize(self.to_dict()["columns"])

    def figures(self) -> "dict[str, Figure]":
        """None: an inspection is a table."""
        return {}


def plan(
    between: str | None = None,
    rig: AnyRig = None,
    *,
    faults: str | None = None,
    constants: Sequence[str] = (),
    findings: str | Path | None = None,
    seconds: float = 10.0,
    pitches: Sequence[float] = (0.0,),
    speed: float | None = None,
    travel: tuple[float, float] | None = None,
    rate_hz: float = 1600.0,
) -> Planned:
    """The moves that best tell rivals apart, show a cause, or teach constants; one of the first four arguments besides `rig`.

    between, faults: names with commas, as `plan --between` and `--faults` take them; constants: of the rig; findings: an
    improve.json. Limits: length [s], levels of pitch [deg], highest speed [rad/s], travel from the start of the log [m], samples
    a second of the logger. Raises UsageError.
    """
    given = {"between": between, "faults": faults, "constants": tuple(constants), "findings": findings}
    asked = [name for name, value in given.items() if value]
    if len(asked) != 1:
        raise UsageError(f"plan: give one of {', '.join(given)}; got {' and '.join(asked) or 'none'}")
    machine = rig if isinstance(rig, Rig) else load_rig(rig)
    limits = limits_of(machine, seconds, tuple(pitches), speed, travel, rate_hz)
    if faults:
        return Planned(plan_faults(faults, machine, limits))
    if constants:
        return Planned(plan_constants(tuple(constants), machine, limits))
    causes = parse(between) if between else asked_by(Path(str(findings)))
    return Planned(plan_causes(causes, machine, limits))


def inspect(
    log: str | Path, columns: str | Path | Mapping[str, Any] | ColumnMap | None = None, rig: AnyRig = None
) -> Inspected:
    """What a file holds, and the column map that fits it. Raises InvalidLogError for what is no table.

    rig: its motor tells units that the numbers leave open.
    """
    machine = rig if isinstance(rig, Rig) or rig is None else load_rig(rig)
    known = None if columns is None else columns_of(columns)
    return Inspected(inspect_log(str(log), known, machine))
