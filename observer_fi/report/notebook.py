"""What Python and notebooks call: one function a question, each with a result that shows itself.

Logs are given as paths, as DataFrames with the columns of the contract, or as `Log`; a missing command is recovered. A rig is
a `Rig`, a file, a packaged name, or None for the paper's mass-shifter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pandas as pd

from observer_fi import learn, verdict
from observer_fi.improve import Improvement, diagnosis_gain
from observer_fi.improve import improve as improved
from observer_fi.logs import (
    ColumnMap,
    load_columns,
    log_from_frame,
    log_name,
    read_log,
    with_command,
    with_logger,
)
from observer_fi.physics import Rig, Scenario, Truth, load_rig, synthesise
from observer_fi.records import CHANNELS, Event, Fit, Log, Outcome
from observer_fi.report import diagnosis as diagnosis_report
from observer_fi.report import learning as learning_report
from observer_fi.report.result_folder import Made, write_result
from observer_fi.settings import Settings

if TYPE_CHECKING:
    from observer_fi.report.still_figures import Figure

AnyLog = str | Path | pd.DataFrame | Log
AnyRig = str | Path | Rig | None
_UNITS = dict(zip(CHANNELS, ("V", "A", "m"), strict=True))


def _still() -> ModuleType:
    """The module that draws with matplotlib, which nothing else needs."""
    from observer_fi.report import still_figures

    return still_figures


@dataclass(frozen=True)
class Diagnosis:
    """The verdict on one log, with what it rests on."""

    outcome: Outcome
    rig: Rig

    @property
    def verdict(self) -> Event:
        """The log's verdict: label, channel, probability, onset and times [s]."""
        if self.outcome.isolation is None:
            raise ValueError(f"{self.outcome.name} has no verdict: {self.outcome.error}")
        return self.outcome.isolation.verdict

    def to_dict(self) -> dict[str, Any]:
        """What report.json holds."""
        return diagnosis_report.report_dict(self.outcome)

    def to_frame(self) -> pd.DataFrame:
        """Time [s], signals (SI) and the probability of each hypothesis; a long log is thinned, its extremes stay."""
        traces = self.outcome.overview
        if traces is None:
            raise ValueError(f"{self.outcome.name} has no traces: {self.outcome.error}")
        signals = {
            "time_s": traces.t, "voltage_v": traces.z[:, 0], "current_a": traces.z[:, 1], "position_m": traces.z[:, 2],
            "speed_rad_s": traces.w, "speed_cmd_rad_s": traces.w_cmd, "pitch_deg": traces.pitch,
        }  # fmt: skip
        return pd.DataFrame(
            signals | {f"p_{mode}": traces.probability[:, j] for j, mode in enumerate(self.outcome.modes)}
        )

    def plot(self) -> "Figure":
        """Signals above, the posterior below, with the onset of each fault."""
        return _still().diagnosis_figure(self.outcome)

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(diagnosis_report.headline(self.outcome))}</b></p><p>{escape(self.outcome.explanation)}</p>"


@dataclass(frozen=True)
class Identification:
    """A rig learned from its logs."""

    fit: Fit
    before: Rig
    logs: tuple[Log, ...]

    @cached_property
    def rig(self) -> Rig:
        """The rig with the values that were learned."""
        learned = with_logger(learn.identified_rig(self.fit, self.before), self.logs)
        return learn.with_equation_errors(learned, self.logs)

    @property
    def verdict(self) -> str:
        """One line: how much was learned."""
        untold = len(self.fit.not_identifiable)
        return f"{len(self.fit.parameters)} parameters learned" + (
            f", {untold} cannot be told" if untold else ""
        )

    def to_frame(self) -> pd.DataFrame:
        """One row a parameter: value, standard error, 95 % interval, what it was before, unit (SI)."""
        return pd.DataFrame([vars(parameter) for parameter in self.fit.parameters]).set_index("name")

    def plot(self) -> "Figure":
        """Values with their 95 % intervals, relative to what they were before."""
        return _still().interval_figure(self.to_frame())

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(self.verdict)}</b></p>{self.to_frame().to_html()}"


@dataclass(frozen=True)
class Improved:
    """What the simulation gets wrong, and the rig that has it."""

    record: Improvement
    before: Rig
    logs: tuple[Log, ...]

    @property
    def rig(self) -> Rig:
        """The rig with every cause that was named."""
        return self.record.extended_rig

    @property
    def verdict(self) -> str:
        """One line: what the simulation misses."""
        return learning_report.improve_headline(self.record)

    def to_frame(self) -> pd.DataFrame:
        """One row a finding: cause, equation, evidence, and what it gains on moves that no fit saw."""
        columns = ("cause", "equation", "variant", "delta_bic", "heldout_nll_drop_per_sample", "separate_by")
        rows = [[getattr(finding, name) for name in columns] for finding in self.record.findings]
        return pd.DataFrame(rows, columns=pd.Index(columns))

    def plot(self) -> "Figure":
        """What each cause gains on moves that no fit saw."""
        return _still().gain_figure(self.to_frame())

    def _repr_html_(self) -> str:
        return f"<p><b>{escape(self.verdict)}</b></p>{self.to_frame().to_html()}"


def diagnose(
    log: AnyLog,
    rig: AnyRig = None,
    settings: Settings | None = None,
    columns: str | Path | ColumnMap | None = None,
    *,
    detected_at: float | None = None,
) -> Diagnosis:
    """The verdict on a log. Raises InvalidLogError where it cannot be read.

    columns: names and units of a file's columns. detected_at: time of an external detection in a file [s].
    """
    machine, chosen = _rig(rig), settings or Settings()
    if isinstance(log, str | Path):
        outcome = verdict.diagnose(log, machine, chosen, columns=_columns(columns), detected_at=detected_at)
    else:
        outcome = verdict.diagnose_log(_log(log, machine), machine, chosen)
    return Diagnosis(outcome, machine)


def identify(logs: AnyLog | Sequence[AnyLog], rig: AnyRig = None) -> Identification:
    """Parameters of a rig from its logs, with intervals."""
    machine = _rig(rig)
    material = _logs(logs, machine)
    return Identification(learn.identify(material, machine), machine, tuple(material))


def improve(logs: AnyLog | Sequence[AnyLog], rig: AnyRig = None) -> Improved:
    """What the simulation of a rig gets wrong on these logs, by name."""
    given = _rig(rig)
    material = _logs(logs, given)
    record = improved(material, given)
    return Improved(record, record.rig, tuple(material))


def simulate(scenario: Scenario, rig: AnyRig = None, name: str = "synthetic") -> tuple[Log, Truth]:
    """A synthetic log, and what was done to it."""
    return synthesise(scenario, _rig(rig), name)


def write_report(result: Diagnosis | Identification | Improved, folder: str | Path) -> Path:
    """Report, figures and JSON of a result into a folder, as the command of the same name does; the page's path.

    A folder that holds another log's result is left alone: the result gets one with a number.
    """
    folder = Path(folder)
    if isinstance(result, Diagnosis):
        return diagnosis_report.write(result.outcome, result.rig, folder) / "report.html"
    command, files_of = (
        ("identify", _identify_files) if isinstance(result, Identification) else ("improve", _improve_files)
    )
    made = Made(command, {log.path: log.sha256 for log in result.logs})
    return write_result(folder.parent, folder.name, made, files_of(result, folder.name)) / f"{command}.html"


def _identify_files(result: Any, name: str) -> dict[str, str]:
    by_phase = learn.residuals_by_phase(list(result.logs), result.fit, result.before)
    paths = [log.path for log in result.logs]
    return learning_report.identify_files(result.fit, result.before, result.rig, by_phase, name, paths)


def _improve_files(result: Any, name: str) -> dict[str, str]:
    gain = diagnosis_gain(list(result.logs), result.before, result.rig)
    paths = [log.path for log in result.logs]
    return learning_report.improve_files(result.record, gain, name or log_name(paths[0]), paths)


def _rig(rig: AnyRig) -> Rig:
    return rig if isinstance(rig, Rig) else load_rig(rig)


def _columns(columns: str | Path | ColumnMap | None) -> ColumnMap | None:
    return load_columns(columns) if isinstance(columns, str | Path) else columns


def _log(given: AnyLog, rig: Rig) -> Log:
    """A log with its command; a force-driven rig needs none."""
    if isinstance(given, pd.DataFrame):
        given = log_from_frame(given)
    log = given if isinstance(given, Log) else read_log(given)
    return log if rig.drive == "force" else with_command(log, rig)


def _logs(given: AnyLog | Sequence[AnyLog], rig: Rig) -> list[Log]:
    every = [given] if isinstance(given, str | Path | pd.DataFrame | Log) else given
    return [_log(one, rig) for one in every]
