"""What Python and notebooks call: one function a question, each with a result that shows itself.

Logs are given as paths, as DataFrames, or as `Log`; a missing command is recovered. Columns that are called otherwise than in the
contract, or have other units, are named by `columns`: a map, its file, or a dict as under [columns] of such a file. A rig is a
`Rig`, a file, a packaged name, or None for the paper's mass-shifter.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from observer_fi import learn, verdict
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve import diagnosis_gain
from observer_fi.improve import improve as improved
from observer_fi.logs import (
    ColumnMap,
    columns_of,
    digest_of,
    log_from_frame,
    log_name,
    read_log,
    thinned,
    with_command,
)
from observer_fi.physics import Rig, Scenario, Truth, load_rig, synthesise
from observer_fi.records import Log
from observer_fi.report import comparison_page, plan_page, trend_page
from observer_fi.report import diagnosis as diagnosis_report
from observer_fi.report import learning as learning_report
from observer_fi.report.inspection import MAP_FILE
from observer_fi.report.result_folder import Made, write_result
from observer_fi.report.results.recording import Inspected, Planned
from observer_fi.report.results.results import Comparison, Diagnosis, Identification, Improved, Life, Result
from observer_fi.settings import Settings
from observer_fi.trend import Digest, rig_without_constants
from observer_fi.trend import digest_of as trend_digest_of
from observer_fi.trend import trend as trend_of
from observer_fi.verdict import comparison

AnyLog = str | Path | pd.DataFrame | Log
AnyRig = str | Path | Rig | None
AnyColumns = str | Path | Mapping[str, Any] | ColumnMap | None


def diagnose(
    log: AnyLog,
    rig: AnyRig = None,
    settings: Settings | None = None,
    columns: AnyColumns = None,
    *,
    detected_at: float | None = None,
) -> Diagnosis:
    """The verdict on a log. Raises InvalidLogError where it cannot be read, UsageError for a bad rig or column map.

    detected_at: time of an external detection in a file [s].
    """
    machine, chosen = _rig(rig), settings or Settings()
    if isinstance(log, str | Path):
        outcome = verdict.diagnose(log, machine, chosen, columns=columns_of(columns), detected_at=detected_at)
    else:
        if detected_at is not None:
            raise UsageError("detected_at: only with a log given as a file")
        outcome = verdict.diagnose_log(_log(log, machine, columns), machine, chosen)
    return Diagnosis(outcome, machine)


def identify(
    logs: AnyLog | Sequence[AnyLog], rig: AnyRig = None, columns: AnyColumns = None
) -> Identification:
    """Parameters of a rig from its logs, with intervals."""
    machine = _rig(rig)
    material = [thinned(log, machine) for log in _logs(logs, machine, columns)]
    return Identification(learn.identify(material, machine), machine, tuple(material))


def improve(logs: AnyLog | Sequence[AnyLog], rig: AnyRig = None, columns: AnyColumns = None) -> Improved:
    """What the simulation of a rig gets wrong on these logs, by name."""
    given = _rig(rig)
    material = [thinned(log, given) for log in _logs(logs, given, columns)]
    record = improved(material, given)
    return Improved(record, record.rig, tuple(material))


def trend(
    logs: AnyLog | Sequence[AnyLog],
    rig: AnyRig = None,
    columns: AnyColumns = None,
    *,
    healthy: AnyLog | Sequence[AnyLog] = (),
    baseline: AnyRig = None,
    false_alarm_rate: float = 1e-3,
    limits: Mapping[str, float] | None = None,
) -> Life:
    """What changed over the logs of one actuator, since when, by how much.

    The healthy state is that of the logs in `healthy`, or of the constants of the rig `baseline`, or of the first of the logs.
    false_alarm_rate: of a log. limits: values whose reaching is forecast, by quantity. A log that cannot be used is left out and
    told in `unreadable`. Raises UsageError where none can.
    """
    if healthy and baseline is not None:
        raise UsageError("healthy, baseline: give one of them")
    bad: list[str] = []
    every, good = _usable(_listed(logs), columns, bad), _usable(_listed(healthy), columns, bad, "healthy")
    if not every:
        raise UsageError("no log could be read" + (f" ({bad[0]})" if bad else ""))
    told = any(np.isfinite(log.z[:, 0]).any() for log in every)
    named = rig if rig is not None else baseline
    machine = _rig(named) if named is not None or told else rig_without_constants()
    measured = None if baseline is None else _rig(baseline)
    found = trend_of(
        _digests(every, machine), machine, false_alarm_rate, _digests(good, machine), measured, limits
    )
    return Life(found, tuple(bad))


def compare(
    cases: int = 60, seed: int = 0, rig: AnyRig = None, settings: Settings | None = None
) -> Comparison:
    """The observer bank against the open-loop mixture on drawn faults; a seed repeats them. About 0.1 s a case."""
    if cases < 1:
        raise UsageError(f"cases: at least one log, got {cases}")
    machine = _rig(rig)
    pairs = comparison.compare(cases, seed, machine, settings or Settings())
    return Comparison(comparison.as_dict(list(pairs), seed, machine))


def simulate(scenario: Scenario, rig: AnyRig = None, name: str = "synthetic") -> tuple[Log, Truth]:
    """A synthetic log, and what was done to it."""
    return synthesise(scenario, _rig(rig), name)


def write_report(result: Result, folder: str | Path, figures: str | None = None) -> Path:
    """Page, JSON and more of a result into a folder, as the command of the same name does; the page's path, or that of the
    column map of an inspection.

    figures: "png", "svg" or "pdf" for still figures beside the page. A folder that holds another log's result is left alone: the
    result gets one with a number.
    """
    folder = Path(folder)
    still: dict[str, bytes] = {}
    if figures is not None:
        from observer_fi.report.still_figures import still_files

        still = still_files(result.figures(), figures)
    if isinstance(result, Diagnosis):
        return diagnosis_report.write(result.outcome, result.rig, folder, still) / "report.html"
    command, logs, files = _files(result, folder.name)
    written = write_result(
        folder.parent, folder.name, Made(command, logs, grows=command == "trend"), files | still
    )
    return written / (f"{command}.html" if f"{command}.html" in files else next(iter(files)))


def _files(result: Result, name: str) -> tuple[str, dict[str, str], dict[str, str | bytes]]:
    """Command, logs with their digests, and files of a result that is no diagnosis."""
    if isinstance(result, Identification):
        return "identify", _sources(result.logs), {**_identify_files(result, name)}
    if isinstance(result, Improved):
        return "improve", _sources(result.logs), {**_improve_files(result, name)}
    if isinstance(result, Life):
        digests = {j.digest.path: j.digest.sha256 for j in result.record.logs}
        return "trend", digests, {**trend_page.trend_files(result.record, name, list(result.unreadable))}
    if isinstance(result, Planned):
        return "plan", {}, {**plan_page.plan_files(result.record)}
    if isinstance(result, Inspected):
        path = result.record.contents.path
        return "inspect", {path: digest_of(path)}, {MAP_FILE: result.column_map}
    if isinstance(result, Comparison):
        json = diagnosis_report.json_text(result.record)
        return "compare", {}, {"compare.json": json, "compare.html": comparison_page.page(result.record)}
    raise UsageError(
        f"write_report takes what diagnose, identify, improve, trend, compare, plan or inspect return, not {result!r:.80}"
    )


def _sources(logs: Sequence[Log]) -> dict[str, str]:
    return {log.path: log.sha256 for log in logs}


def _identify_files(result: Identification, name: str) -> dict[str, str]:
    by_phase = learn.residuals_by_phase(list(result.logs), result.fit, result.before)
    paths = [log.path for log in result.logs]
    return learning_report.identify_files(result.fit, result.before, result.rig, by_phase, name, paths)


def _improve_files(result: Improved, name: str) -> dict[str, str]:
    gain = diagnosis_gain(result.before, result.rig)
    paths = [log.path for log in result.logs]
    return learning_report.improve_files(result.record, gain, name or log_name(paths[0]), paths)


def _rig(rig: AnyRig) -> Rig:
    return rig if isinstance(rig, Rig) else load_rig(rig)


def _listed(given: AnyLog | Sequence[AnyLog]) -> list[AnyLog]:
    if not isinstance(given, AnyLog | Sequence):
        raise UsageError(f"logs are one or a list of paths, DataFrames or Logs, not {type(given).__name__}")
    return [given] if isinstance(given, str | Path | pd.DataFrame | Log) else list(given)


def _read(given: AnyLog, columns: AnyColumns, name: str = "frame") -> Log:
    if isinstance(given, pd.DataFrame):
        return log_from_frame(given, name, columns_of(columns))
    if isinstance(given, Log):
        return given
    if not isinstance(given, str | Path):
        raise UsageError(f"a log is a path, a DataFrame or a Log, not {type(given).__name__}")
    return read_log(given, columns_of(columns))


def _log(given: AnyLog, rig: Rig, columns: AnyColumns, name: str = "frame") -> Log:
    """A log with its command; a force-driven rig needs none."""
    log = _read(given, columns, name)
    return with_command(log, rig) if rig.driven.motor else log


def _logs(given: AnyLog | Sequence[AnyLog], rig: Rig, columns: AnyColumns) -> list[Log]:
    every = _listed(given)
    names = ["frame"] if len(every) == 1 else _numbered("frame", len(every))
    return [_log(one, rig, columns, name) for one, name in zip(every, names, strict=True)]


def _numbered(name: str, count: int) -> list[str]:
    return [f"{name}_{k + 1}" for k in range(count)]


def _usable(given: Sequence[AnyLog], columns: AnyColumns, bad: list[str], name: str = "frame") -> list[Log]:
    """The logs that can be read; `bad` takes a line for each of the others."""

    def read() -> Iterator[Log]:
        for one, called in zip(given, _numbered(name, len(given)), strict=True):
            try:
                yield _read(one, columns, called)
            except InvalidLogError as error:
                bad.append(str(error))

    return list(read())


def _digests(logs: Sequence[Log], rig: Rig) -> list[Digest]:
    return [trend_digest_of(log, rig) for log in logs]
