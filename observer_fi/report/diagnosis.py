"""Records to people and programs: report.json, report.html, figures. Prints what is known, computes none."""

import json
import math
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any

from observer_fi import __version__
from observer_fi.numerics import digits, readable, readable_share, with_unit
from observer_fi.physics import (
    DRIVES,
    FAULTS,
    LABELS,
    NOMINAL,
    NOT_TESTED,
    UNKNOWN,
    Rig,
    acquisition_table,
    colour_of,
    mode_of,
    words_of,
)
from observer_fi.records import Event, Isolation, Log, Outcome
from observer_fi.report import diagnosis_figures as figures
from observer_fi.report.interactive import library
from observer_fi.report.result_folder import Made, write_result

SCHEMA = "observer-fi/report/1"
LISTED = 200  # rejected samples and gaps that the report lists one by one
CHANNEL_UNITS = {"voltage": "V", "current": "A", "position": "m"}
CHANNEL_UNITS |= {"voltage_v": "V", "current_a": "A", "position_m": "m"}  # of columns, too
_CERTAIN = 0.95  # from here on the page calls a verdict sure

NAMES = {label: row.title for label, row in FAULTS.items()} | {NOT_TESTED: "Not tested"}


def report_dict(outcome: Outcome) -> dict[str, Any]:
    """report.json of contract section 3 as plain data. Raises ValueError for an outcome without a verdict."""
    isolation, log = _complete(outcome)
    verdict = isolation.verdict
    return _plain(
        {
            "schema": SCHEMA,
            "log": {
                "path": log.path,
                "sha256": log.sha256,
                "samples": outcome.samples,
                "rate_hz": outcome.rate_hz,
                "gaps": [gap._asdict() for gap in log.gaps[:LISTED]],
                "notes": log.notes,
                "duration_s": outcome.duration_s,
                "metadata": log.metadata,
                "gap_count": len(log.gaps),
                "rejected_count": log.rejected_count,
                "rejected": [sample._asdict() for sample in log.rejected[:LISTED]],
            },
            "acquisition": acquisition_table(outcome.acquisition),
            "warnings": outcome.warnings,
            "verdict": {
                "label": verdict.label,
                "channel": verdict.channel,
                "probability": verdict.probability,
                "onset_s": verdict.onset_s,
                "onset_interval_s": verdict.onset_interval_s,
                "detected_s": verdict.detected_s,
                "isolated_s": verdict.isolated_s,
                "end_s": verdict.over_s,
                "severity": {
                    s.name: {"value": s.value, "interval": s.interval, "unit": s.unit}
                    for s in verdict.severity
                },
                "alike": verdict.alike,
            },
            "posterior": {label: verdict.posterior.get(label, 0.0) for label in LABELS},
            "open_loop": _open_loop(outcome),
            "consistency": isolation.consistency._asdict(),
            "explanation": outcome.explanation,
            "could_show": _could_show(isolation),
            "events": [_event(one) for event in isolation.events for one in (event, *event.then)],
            "settings": outcome.settings,
            "versions": versions(),
        }
    )


def _event(event: Event) -> dict[str, Any]:
    """An event of `events`: one a move, and behind it a second fault of that move, which has the same `start_s`."""
    return {name: value for name, value in event._asdict().items() if name != "then"}


def _could_show(isolation: Isolation) -> dict[str, Any] | None:
    """What the move of an all-clear could have shown, by label."""
    could = isolation.could_show
    if could is None:
        return None
    least = {
        d.label: {"name": d.name, "value": d.value, "unit": d.unit, "words": d.words} for d in could.least
    }
    return {"begin_s": could.begin_s, "least": least, "blind": could.blind}


def sensitivity(isolation: Isolation) -> str:
    """What the move of an all-clear could have shown, as a sentence; nothing where that is not known."""
    could = isolation.could_show
    if could is None:
        return ""
    words = []
    if could.least:
        told = " or ".join(d.words for d in could.least)
        words.append(
            f"A fault that began in the middle of this move, at {could.begin_s:.3f} s, would have shown if it was {told}."
        )
    if could.blind:
        names = " and ".join(NAMES[label].lower() for label in could.blind)
        words.append(f"It could not have shown: {names}, of whatever size.")
    return " ".join(words)


def _open_loop(outcome: Outcome) -> dict[str, Any]:
    """What the mixture says; it starts at a detection, so without one it says nominal, without a servo nothing."""
    if not DRIVES[outcome.settings["drive"]].servo:
        return {"label": None, "isolated_s": None, "started_s": None}
    if _complete(outcome)[0].verdict.label == NOT_TESTED:
        return {"label": NOT_TESTED, "isolated_s": None, "started_s": None}
    if outcome.open_loop is None:
        return {"label": NOMINAL, "isolated_s": None, "started_s": None}
    verdict = outcome.open_loop.verdict
    return {"label": verdict.label, "isolated_s": verdict.isolated_s, "started_s": verdict.start_s}


def json_text(value: Any) -> str:
    """JSON as it is written to files: NaN and infinity become null."""
    return json.dumps(_plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def json_rows_text(value: Mapping[str, Any]) -> str:
    """As `json_text`, each object in a list on one line: what a thousand logs say is written in a tenth of the time."""
    parts = [f" {json.dumps(key)}: {_rows(member)}" for key, member in _plain(dict(value)).items()]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _rows(value: Any) -> str:
    if isinstance(value, list) and value and all(isinstance(member, dict) for member in value):
        lines = [json.dumps(member, ensure_ascii=False, allow_nan=False) for member in value]
        return "[\n  " + ",\n  ".join(lines) + "\n ]"
    return json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False)


def headline(outcome: Outcome) -> str:
    """The verdict in one line, with the labels that are as good."""
    isolation, _ = _complete(outcome)
    verdict = isolation.verdict
    if verdict.label == NOT_TESTED:
        return f"not tested: {verdict.reasons[0]}"
    words = NAMES[verdict.label].lower()
    if verdict.channel:
        words += f" ({verdict.channel})"
    words = ", or ".join((words, *(NAMES[label].lower() for label in verdict.alike)))
    if verdict.onset_s is not None:
        words += f" since {verdict.onset_s:.3f} s"
    return f"{words}, probability {percent(verdict.probability)}"


def percent(p: float | None) -> str:
    """A probability that never rounds to certainty."""
    if p is None or not math.isfinite(p):
        return "–"
    if p > 0.9999:
        return "> 99.99 %"
    if p < 1e-4:
        return "< 0.01 %"
    return f"{100.0 * p:.2f} %" if p > 0.99 or p < 0.01 else f"{100.0 * p:.1f} %"


def files(outcome: Outcome, rig: Rig, fleet: str = "") -> dict[str, str]:
    """Everything that one report consists of, {file name: text}. fleet: link to the summary that the log is in, if it is."""
    return {"report.json": json_text(report_dict(outcome)), "report.html": page(outcome, rig, fleet)}


def write(
    outcome: Outcome, rig: Rig, folder: Path, still: Mapping[str, bytes] = MappingProxyType({})
) -> Path:
    """report.json and report.html into `folder`, or into one with a number where that is another log's;
    returns the folder. still: figures that were asked for beside them, {file name: content}. Raises UsageError.
    """
    _, log = _complete(outcome)
    made = Made("diagnose", {log.path: log.sha256})
    return write_result(folder.parent, folder.name, made, {**files(outcome, rig), **still})


def page(outcome: Outcome, rig: Rig, fleet: str = "") -> str:
    """report.html: one file, no network, the same bytes for the same inputs."""
    isolation, log = _complete(outcome)
    return (
        environment()
        .get_template("report.html")
        .render(
            outcome=outcome,
            fleet=fleet,
            log=log,
            isolation=isolation,
            verdict=isolation.verdict,
            mixture=_open_loop(outcome),
            names=NAMES,
            colour=colour_of(isolation.verdict.label, isolation.verdict.channel),
            drawn=figures.draw(outcome),
            captions=figures.captions(outcome),
            doubts=doubts(outcome),
            sensitivity=sensitivity(isolation),
            settings=flattened(outcome.settings),
            rig=rig,
            listed=LISTED,
            colour_of=colour_of,
            channel_units=CHANNEL_UNITS,
            versions=versions(),
            acquisition=acquisition_table(outcome.acquisition),
        )
    )


@cache
def environment() -> Any:
    """The Jinja2 environment of every page of this project."""
    import jinja2

    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    env.filters |= {
        "seconds": seconds,
        "percent": percent,
        "number": number,
        "chance": chance,
        "quantity": quantity,
    }
    env.globals |= {"uplot": library, "readable": readable, "readable_share": readable_share}
    return env


def seconds(value: float | None) -> str:
    """A time on the log's clock."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.3f} s"


def number(value: float | None, count: int = 3) -> str:
    """A number for people."""
    return "–" if value is None else digits(value, count)


def quantity(value: float | None, unit: str, count: int = 3) -> str:
    """A value with the unit in which it is short."""
    return "–" if value is None or not math.isfinite(value) else with_unit(value, unit, count=count)


def chance(p: float | None) -> str:
    """A probability of a test, which below one in ten thousand says no more."""
    return "–" if p is None or not math.isfinite(p) else "below 0.0001" if p < 1e-4 else digits(p, 2)


def doubts(outcome: Outcome) -> list[str]:
    """How sure the verdict is, and what would change it."""
    isolation, log = _complete(outcome)
    verdict, fit = isolation.verdict, isolation.consistency
    if verdict.label == NOT_TESTED:
        return [f"{verdict.reasons[0].capitalize()}: record a longer log with a move, and diagnose that."]
    found = []
    others = sorted(
        ((p, label) for label, p in verdict.posterior.items() if label != verdict.label), reverse=True
    )
    if others and others[0][0] > 1e-6:
        found.append(f"Next best explanation: {NAMES[others[0][1]].lower()}, with {percent(others[0][0])}.")
    elif others:
        found.append(
            "No other hypothesis has more than one part in a million; "
            f"the next is {NAMES[others[0][1]].lower()}."
        )
    if math.isfinite(fit.nis_mean):
        ratio = fit.nis_mean / fit.nis_expected
        text = f"Normalised innovation squared {fit.nis_mean:.2f}, {fit.nis_expected:.1f} expected: "
        found.append(
            text
            + (
                "the winning model describes this machine as well as its sensors can tell."
                if ratio < 1.5
                else "the winning model misses something of this machine, and probabilities are too sure of "
                "themselves. Identify the rig, or let the model be improved, before trusting a close call."
            )
        )
    if outcome.open_loop is not None and outcome.open_loop.verdict.label != verdict.label:
        other = NAMES[outcome.open_loop.verdict.label].lower()
        found.append(
            f"The open-loop mixture says {other}: "
            + (
                "it knows three models and has to choose one of them."
                if not FAULTS[verdict.label].open_loop
                else "it starts from one state and never looks at the data again, so parameters that are "
                "slightly off lead it astray first."
            )
        )
    refused = _refused(outcome)
    if refused:
        found.append(
            f"The bank's most probable hypothesis is {refused}, but an absolute test refuses it: it "
            f"explains the "
            "data only with constants that no rig shows, or leaves too much of them unexplained."
        )
    untold = [reason for reason in verdict.reasons if reason not in outcome.explanation]
    found += [f"{reason[0].upper()}{reason[1:]}." for reason in untold]
    if verdict.isolated_s is None and verdict.label != NOMINAL:
        found.append(
            f"{_under_way(outcome)}: the verdict is that of the whole move, looked at afterwards."
            if verdict.probability > _CERTAIN
            else "The verdict never stayed above 95 % until the end of its move: a longer move would settle it."
        )
    if log.notes:
        found.append("The log has notes, listed below, that bear on what can be known from it.")
    return found


def _under_way(outcome: Outcome) -> str:
    """What the bank itself held of a verdict that the whole move gave, as the curves below show it."""
    verdict, traces = _complete(outcome)[0].verdict, outcome.overview
    mode = mode_of(verdict.label, verdict.channel)
    if traces is not None and mode in outcome.modes:
        since = verdict.start_s if verdict.onset_s is None else verdict.onset_s
        ours = traces.probability[
            (traces.t >= since) & (traces.t <= verdict.end_s), outcome.modes.index(mode)
        ]
        sure = ours > _CERTAIN
        if sure.size and sure[-1]:
            return "While it ran, the bank came to hold it for certain too, but had to leave others open"
        if sure.any():
            return "While it ran, the bank held it for certain for a time and then let go of it"
    return "While it ran, no hypothesis of the bank said so, and curves below show what they thought"


def _refused(outcome: Outcome) -> str | None:
    """The hypothesis that won on probability where the verdict is that none of them holds."""
    isolation, _ = _complete(outcome)
    verdict, traces = isolation.verdict, outcome.overview
    if verdict.label != UNKNOWN or traces is None or verdict.isolated_s is None:
        return None
    later = traces.probability[traces.t >= verdict.isolated_s]
    if not later.size:
        return None
    mode = outcome.modes[int(later[0].argmax())]
    return None if mode in (UNKNOWN, NOMINAL) else words_of(mode)


def flattened(settings: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as (dotted name, value) rows."""
    rows: list[tuple[str, str]] = []
    for name, value in settings.items():
        if isinstance(value, dict):
            rows += flattened(value, f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", "–" if value is None else str(value)))
    return rows


@cache
def versions() -> dict[str, str]:
    """What computed the result."""
    found = {"observer-fi": __version__}
    for name in ("numpy", "numba", "filterpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _complete(outcome: Outcome) -> tuple[Isolation, Log]:
    if outcome.isolation is None or outcome.log is None:
        raise ValueError(
            f"{outcome.name}: there is no verdict to report ({outcome.error or 'it was not judged'})"
        )
    return outcome.isolation, outcome.log


def _plain(value: Any) -> Any:
    """Tuples as lists, numpy numbers as Python's, and what JSON cannot say as null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str | bool | int) or value is None:
        return value
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)
