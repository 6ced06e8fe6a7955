"""An actuator's life from its logs: digests in, what changed out."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import Rig
from observer_fi.records import Array
from observer_fi.trend.ahead import Ahead, ahead
from observer_fi.trend.baseline import UNITS, Baseline, Departure, departure, learn, outside, score_of
from observer_fi.trend.changes import STEP, Change, History, as_departure, history_of
from observer_fi.trend.digests import Digest
from observer_fi.trend.few import ASSUMED, Difference, differences, from_few, is_few
from observer_fi.trend.kinds import in_words, kind_of
from observer_fi.trend.naming import MISFIT, Named, named, ratio_words
from observer_fi.trend.order import LOGS, ordered
from observer_fi.trend.rig_baseline import from_rig, rig_as_table
from observer_fi.trend.table import Table, periods_of, table_of

UNCHANGED, CHANGED, NOT_TESTED = "unchanged", "changed", "not_tested"
FIRST_SHARE, FIRST_LEAST, FIRST_MOST = (
    3,
    8,
    20,
)  # a baseline that nobody gave: the first third, but 8 to 20 logs
FEWEST_FOR_HISTORY = 8
TOO_WIDE = 5.0  # times the usual scatter: conditions so far from the baseline's that a log says nothing
ALIASES = {"friction": "A", "delay": "input_delay", "play": "backlash"}


class Moved(NamedTuple):
    """One quantity of a changed log: name, cause, from what to what, standard error of the difference, unit."""

    name: str
    cause: str
    before: float
    after: float
    std: float
    unit: str


@dataclass(frozen=True)
class Judged:
    """One log: its digest, verdict, score, and what moved; reason: why it was not tested; notes: on its conditions."""

    digest: Digest
    verdict: str
    score: float
    changed: tuple[Moved, ...]
    causes: tuple[Named, ...]
    reason: str = ""
    notes: tuple[str, ...] = ()


class Finding(NamedTuple):
    """One change over the logs, named. row: of its first log in the history; size up to the last log, std, in unit; before: level
    until then; names: of all quantities that show it; low, high: rows between which it began.
    """

    kind: str
    row: int
    cause: str
    equation: str
    name: str
    size: float
    std: float
    unit: str
    before: float
    rivals: tuple[str, ...]
    names: tuple[str, ...]
    low: int
    high: int
    words: str


class Compared(NamedTuple):
    """One log beside what it is compared with, the clearest difference first."""

    path: str
    differences: tuple[Difference, ...]


@dataclass(frozen=True)
class Trend:
    """What changed. logs in order, the baseline's own not among them where they were given apart; history: of all logs, with
    `paths` in its order, None where they are too few. ordered_by, unit: of the times. baseline_from: in words. assumed: what is
    assumed where logs are too few to tell how much runs differ, "" where they tell it; compared: each of them then, quantity by
    quantity.
    """

    rate: float
    baseline: Baseline
    baseline_from: str
    logs: tuple[Judged, ...]
    table: Table
    paths: tuple[str, ...]
    times: Array
    history: History | None
    findings: tuple[Finding, ...]
    aheads: tuple[Ahead, ...]
    ordered_by: str
    unit: str
    periods: tuple[float, ...]
    assumed: str = ""
    compared: tuple[Compared, ...] = ()


def trend(
    logs: Sequence[Digest], rig: Rig, rate: float, healthy: Sequence[Digest] = (), baseline_rig: Rig | None = None,
    limits: Mapping[str, float] | None = None, calibration: Sequence[Digest] = (),
) -> Trend:  # fmt: skip
    """What changed between logs of one actuator and a baseline: healthy logs, a rig file, or the first of the logs.

    rate: false alarms per log, and of a false change in the whole history. calibration: further healthy logs that set the limit
    alone. Raises UsageError where no baseline can be made.
    """
    told = [d for d in logs if d.names]
    mine, times, by, unit = ordered(told)
    before = [d for d in ordered(list(healthy))[0] if d.names]
    source, text = _source(mine, before, baseline_rig)
    few = is_few(len(mine)) and (
        baseline_rig is not None or is_few(len(source)) and len(mine) + len(before) > 1
    )
    if not source:
        reason = next((f"{d.path}: {r}" for d in (*healthy, *logs) for r in d.missing.values()), "no logs")
        raise UsageError(f"no log tells anything that a baseline could be made of ({reason})")
    periods = periods_of(source, rig)
    reference = table_of(source, periods)
    if baseline_rig is not None and not healthy:
        baseline = from_rig(reference, baseline_rig, rate)
    elif few:
        baseline = from_few(reference, rate)
    else:
        baseline = learn(reference, rate, table_of(calibration, periods) if calibration else None)
    known = _known_periods(rig)
    table = table_of(mine, periods)
    judged = [_judge(d, baseline, table, row, known) for row, d in enumerate(mine)]
    silent = [
        Judged(d, NOT_TESTED, 0.0, (), (), next(iter(d.missing.values()), "")) for d in logs if not d.names
    ]
    every, all_times, by, unit = _with_healthy(mine, times, by, unit, before)
    over_time = (every, all_times, periods, baseline, rate, len(before))
    history, findings, aheads = _over_time(*over_time, known, limits or {}, unit)
    if few and history is None:
        findings = _lasting(judged, [d.path for d in every])
        first = reference if baseline_rig is None else rig_as_table(reference, baseline_rig)
        later = [row for row, d in enumerate(mine) if baseline_rig is not None or d not in source]
        compared = tuple(Compared(mine[row].path, differences(first, table, row)) for row in later)
    return Trend(
        rate, baseline, text, (*judged, *silent), table, tuple(d.path for d in every), all_times, history, findings,
        aheads, by, unit, periods, ASSUMED if few else "", compared if few and history is None else (),
    )  # fmt: skip


def _source(mine: list[Digest], before: list[Digest], baseline_rig: Rig | None) -> tuple[list[Digest], str]:
    """The logs that a baseline is made of, and in words what it is."""
    if before:
        return before, f"{len(before)} logs given as healthy" if len(
            before
        ) > 1 else "one log given as healthy"
    if baseline_rig is not None:
        scatter = "an assumed scatter" if is_few(len(mine)) else "the scatter that neighbouring logs have"
        return mine, f"the constants of rig {baseline_rig.name}, with {scatter}"
    if is_few(len(mine)):
        return mine[:1], "the first log, as no baseline was given"
    source = mine[: max(FIRST_LEAST, min(FIRST_MOST, len(mine) // FIRST_SHARE))]
    return source, f"the first {len(source)} logs, as no baseline was given"


def _with_healthy(
    mine: list[Digest], times: Array, by: str, unit: str, before: list[Digest]
) -> tuple[list[Digest], Array, str, str]:
    """All logs in order: healthy logs that were given stand in front of the others where no times tell."""
    known = {(d.path, d.sha256) for d in before}
    others = [d for d in mine if (d.path, d.sha256) not in known]
    if not before or not others:
        return mine, times, by, unit
    every, all_times, by, unit = ordered([*before, *others])
    if unit == LOGS:
        every = [*before, *others]
    return every, all_times, by, unit


def _known_periods(rig: Rig) -> dict[str, float]:
    """Periods along the travel [m] of what turns, where the rig tells them."""
    found = {}
    if "screw_lead" in rig.quantities:
        found["screw_ripple"] = rig.quantities["screw_lead"].value
        found["shaft_ripple"] = 2.0 * math.pi * rig.model["D"]
    return found


# --- one log ----------------------------------------------------------------------------------------


def _judge(
    digest: Digest, baseline: Baseline, table: Table, row: int, periods: Mapping[str, float]
) -> Judged:
    found = departure(baseline, table, row)
    notes = outside(baseline, table, row)
    if not found.which.size:
        return Judged(digest, NOT_TESTED, 0.0, (), (), "tells nothing that the baseline's logs tell", notes)
    score = score_of(baseline, found)
    if score <= 1.0:
        wide = float(np.median(found.std / baseline.scatter[found.which])) > TOO_WIDE
        reason = (
            f"{notes[0]}; healthy logs there are needed"
            if notes
            else "its own noise hides what it could tell"
        )
        return Judged(digest, NOT_TESTED if wide else UNCHANGED, score, (), (), reason if wide else "", notes)
    causes = named(baseline, found, periods)
    moved = tuple(_moved(baseline, found, k, cause) for cause in causes for k in cause.rows)
    return Judged(digest, CHANGED, score, moved, causes, "", notes)


def _moved(baseline: Baseline, found: Departure, k: int, cause: Named) -> Moved:
    at = found.which[k]
    values = (float(found.expected[k]), float(found.found[k]), float(found.std[k]))
    return Moved(baseline.names[at], cause.cause, *values, baseline.units[at])


# --- over the logs ----------------------------------------------------------------------------------


def _over_time(
    every: Sequence[Digest], times: Array, periods: Sequence[float], baseline: Baseline, rate: float,
    healthy: int, known: Mapping[str, float], limits: Mapping[str, float], unit: str,
) -> tuple[History | None, tuple[Finding, ...], tuple[Ahead, ...]]:  # fmt: skip
    names = {ALIASES.get(n, n): v for n, v in limits.items()}
    for name in names:
        if name not in baseline.names:
            raise UsageError(
                f"--limit {name}: these logs do not tell it (they tell {', '.join(baseline.names)})"
            )
    if len(every) < FEWEST_FOR_HISTORY:
        return None, (), ()
    history = history_of(table_of(every, periods), baseline, times, rate, healthy if unit == LOGS else 0)
    paths = [d.path for d in every]
    findings = [f for c in history.changes for f in _findings(c, baseline, history, paths, known)]
    clear = [f for f in findings if kind_of(f.name).group != MISFIT]
    findings = (
        clear or findings
    )  # what the constants leave is a symptom where something with a name has changed
    aheads = tuple(ahead(n, v, baseline, history, unit) for n, v in names.items())
    return history, tuple(sorted(findings, key=lambda f: f.row)), aheads


def _lasting(judged: Sequence[Judged], paths: Sequence[str]) -> tuple[Finding, ...]:
    """What changed in the last of a few logs, since the log from which on each one has it."""
    if not judged or judged[-1].verdict != CHANGED:
        return ()
    found = []
    moved = {m.name: m for m in judged[-1].changed}
    for cause in judged[-1].causes:
        mine = [m for m in moved.values() if m.cause == cause.cause]
        if not mine:
            continue
        m = mine[0]
        since = len(judged) - 1
        while since > 0 and m.name in {other.name for other in judged[since - 1].changed}:
            since -= 1
        row = paths.index(judged[since].digest.path)
        size = m.after - m.before
        words = _words(STEP, row, m.name, m.unit, size, m.std, m.before, paths)
        found.append(Finding(
            STEP, row, cause.cause, cause.equation, m.name, size, m.std, m.unit, m.before, cause.rivals,
            tuple(other.name for other in mine), row, row, words,
        ))  # fmt: skip
    return tuple(found)


def _findings(
    c: Change, baseline: Baseline, history: History, paths: Sequence[str], known: Mapping[str, float]
) -> list[Finding]:
    """What one change is called: a finding a cause, each with the quantity that shows it most clearly."""
    found = as_departure(c, baseline, history.level)
    shown = {int(at) for at in np.flatnonzero(c.shows)}
    causes = [n for n in named(baseline, found, known) if shown & {int(found.which[k]) for k in n.rows}]
    result = []
    for cause in causes:
        rows = [k for k in cause.rows if int(found.which[k]) in shown]
        k, at = rows[0], int(found.which[rows[0]])
        size, std, before = (
            float(found.found[k] - found.expected[k]),
            float(found.std[k]),
            float(found.expected[k]),
        )
        names = tuple(baseline.names[int(found.which[j])] for j in rows)
        if c.by:
            result.append(_by_condition(c, at, size, std, baseline, history, paths, names))
            continue
        words = _words(c.kind, c.since, baseline.names[at], baseline.units[at], size, std, before, paths)
        result.append(Finding(
            c.kind, c.since, cause.cause, cause.equation, baseline.names[at], size, std, baseline.units[at], before,
            cause.rivals, names, c.low, c.high, words,
        ))  # fmt: skip
    return result


# What it means where a condition acts otherwise than before: cause, equation, rivals, name, and words.
_BY = {
    "pitch_deg": (
        "gravity_nonlinearity",
        "torque",
        ("load_dependent_friction", "pitch_offset"),
        "pitch",
        "the mass that is carried",
    ),
    "load_n": (
        "load_dependent_friction",
        "torque",
        ("torque_offset", "current_gain"),
        "load",
        "efficiency of screw or gear",
    ),
}


def _by_condition(
    c: Change, at: int, size: float, std: float, baseline: Baseline, history: History, paths: Sequence[str],
    names: tuple[str, ...],
) -> Finding:  # fmt: skip
    """A change of what a condition does to a quantity, per unit of the condition."""
    condition, scale = history.conditions[c.by]
    cause, equation, rivals, word, doubt = _BY[condition]
    name, unit = baseline.names[at], f"{baseline.units[at]}/{UNITS[condition]}"
    before = float(history.slopes[c.by, at]) * scale
    words = f"what {word} does to {in_words(name)} {with_unit(size * scale, unit, '+')}, since {_short(paths, c.since)}: {doubt}"
    shown = "B" if (name, condition) == ("torque_offset", "pitch_deg") else name
    return Finding(
        c.kind,
        c.since,
        cause,
        equation,
        shown,
        size * scale,
        std * scale,
        unit,
        before,
        rivals,
        names,
        c.low,
        c.high,
        words,
    )


def _words(
    kind: str, since: int, name: str, unit: str, size: float, std: float, before: float, paths: Sequence[str]
) -> str:
    """One change in a sentence for a technician."""
    signed = kind_of(name).group in ("ripple", "travel")  # parts of an amplitude: no part of what was before
    percent = "" if signed else ratio_words(before + size, before, std)
    if unit == "1":
        percent = f"{digits(100.0 * math.expm1(size), sign='+')} %"
    much = percent or with_unit(size, unit, "+")
    how = {"step": "since", "drift": "rising since" if size > 0.0 else "falling since"}[kind]
    both = ", in both directions" if name == "A" else ""
    doubt = kind_of(name).doubt
    return f"{in_words(name)} {much}{both}, {how} {_short(paths, since)}{': ' + doubt if doubt else ''}"


def _short(paths: Sequence[str], row: int) -> str:
    """What a log is called in a sentence: its file name, with its folders where another log has that name too."""
    names = [os.path.basename(path) for path in paths]
    return names[row] if names.count(names[row]) == 1 else paths[row]
