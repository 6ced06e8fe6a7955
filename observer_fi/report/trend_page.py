"""What `trend` found, for programs and people: trend.json of contract section 4b, trend.csv, a page with a lane a quantity."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from observer_fi.numerics import digits, readable, to_the_error, with_unit
from observer_fi.records import Array
from observer_fi.report.diagnosis import environment, json_rows_text, versions
from observer_fi.report.interactive import INK, Charts, Level, Mark, Panel, Series
from observer_fi.trend import (
    CHANGED,
    NOT_TESTED,
    UNCHANGED,
    Compared,
    Finding,
    Judged,
    Trend,
    in_percent,
    in_words,
)

SCHEMA = "observer-fi/trend/1"
COLOURS = {UNCHANGED: "#3d6fa8", CHANGED: "#b3261e", NOT_TESTED: "#8a929b"}
NO_CHANGE_OF_FEW = "No change beyond what sound runs may differ by"
FIRST_NAMED = 3  # of what differs between a few logs
LANES = 12  # shown at once; the others stand below, folded


NONE: Mapping[str, str] = MappingProxyType({})


def trend_files(
    found: Trend, name: str, bad: list[str], reports: Mapping[str, str] = NONE, fleet: str = ""
) -> dict[str, str]:
    """Everything that one trend consists of, {file name: text}. bad: one line per log that could not be read.

    reports: links to the diagnoses of logs, by path; fleet: link to the summary of all logs, "" where there is none.
    """
    return {
        "trend.json": json_rows_text(trend_json(found, bad)),
        "trend.csv": trend_csv(found),
        "trend.html": page(found, name, bad, reports, fleet),
    }


# --- for programs -----------------------------------------------------------------------------------


def trend_json(found: Trend, bad: list[str]) -> dict[str, Any]:
    """Contract section 4b, and what it was made from."""
    b = found.baseline
    history = found.history
    seen = [] if history is None else history.detectable.tolist()
    return {
        "schema": SCHEMA,
        "false_alarm_rate": found.rate,
        "baseline": {
            "logs": len(b.reference.paths),
            "from": found.baseline_from,
            "limit": 1.0,
            "paths": list(b.reference.paths),
            "parameters": {
                n: {"value": _plain(v), "scatter": _plain(s), "unit": u}
                for n, v, s, u in zip(b.names, b.coefficients[0], b.scatter, b.units, strict=True)
            },
        },
        "ordered_by": found.ordered_by,
        "logs": [_log(j) for j in found.logs],
        "changes": [_change(f, found) for f in found.findings],
        "ahead": [
            {"name": a.name, "limit": a.limit, "reached": _plain(a.reached), "interval": [_plain(a.low), _plain(a.high)],
             "unit": found.unit, "explanation": a.words}
            for a in found.aheads
        ],
        "detectable": {n: {"step": _plain(d), "unit": u} for n, d, u in zip(b.names, seen, b.units, strict=False)},
        "scatter_known": not found.assumed,
        "compared": [_compared(c) for c in found.compared],
        "unreadable": bad,
        "versions": versions(),
    }  # fmt: skip


def _compared(c: Compared) -> dict[str, Any]:
    return {
        "path": c.path,
        "quantities": [
            {"name": d.name, "unit": d.unit, "from": _plain(d.before), "from_std": _plain(d.before_std), "to": _plain(d.after),
             "to_std": _plain(d.after_std), "size": _plain(d.size), "std": _plain(d.std), "sigmas": _plain(d.sigmas),
             "differs": d.differs}
            for d in c.differences
        ],
    }  # fmt: skip


def _log(j: Judged) -> dict[str, Any]:
    d = j.digest
    std = np.sqrt(np.maximum(np.diag(d.covariance), 0.0))
    return {
        "path": d.path,
        "time": d.time,
        "verdict": j.verdict,
        "score": _plain(j.score),
        "reason": j.reason,
        "notes": [*d.notes, *j.notes],
        "conditions": {n: _plain(v) for n, v in d.conditions.items()},
        "parameters": {
            n: {"value": _plain(v), "std": _plain(s), "unit": u}
            for n, v, s, u in zip(d.names, d.value, std, d.units, strict=True)
        },
        "changed": [
            {"name": m.name, "cause": m.cause, "from": _plain(m.before), "to": _plain(m.after), "std": _plain(m.std),
             "unit": m.unit}
            for m in j.changed
        ],
        "causes": [{"cause": c.cause, "equation": c.equation, "rivals": list(c.rivals)} for c in j.causes],
    }  # fmt: skip


def _change(f: Finding, found: Trend) -> dict[str, Any]:
    return {
        "kind": f.kind, "since": found.paths[f.row], "since_interval": [found.paths[f.low], found.paths[f.high]],
        "cause": f.cause, "equation": f.equation, "name": f.name, "size": _plain(f.size), "std": _plain(f.std),
        "unit": f.unit, "from": _plain(f.before), "rivals": list(f.rivals), "shown_by": list(f.names),
        "explanation": f.words,
    }  # fmt: skip


def _plain(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def trend_csv(found: Trend) -> str:
    """One row a log: verdict, score, and every quantity with its standard error."""
    names = list(dict.fromkeys(n for j in found.logs for n in j.digest.names))
    units = {n: u for j in found.logs for n, u in zip(j.digest.names, j.digest.units, strict=True)}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [f"{n} [{units[n]}]" for n in names]
    writer.writerow(["path", "time", "verdict", "score", *(c for h in heads for c in (h, f"{h} std"))])
    for j in found.logs:
        d = j.digest
        std = np.sqrt(np.maximum(np.diag(d.covariance), 0.0))
        at = {n: (v, s) for n, v, s in zip(d.names, d.value.tolist(), std.tolist(), strict=True)}
        cells = [f"{x:.8g}" for n in names for x in at.get(n, (math.nan, math.nan))]
        writer.writerow(
            [d.path, d.time, j.verdict, f"{j.score:.4g}", *("" if c == "nan" else c for c in cells)]
        )
    return text.getvalue()


# --- for people -------------------------------------------------------------------------------------


def headline(found: Trend) -> str:
    """The life in one line."""
    tested = [j for j in found.logs if j.verdict != NOT_TESTED]
    changed = sum(j.verdict == CHANGED for j in tested)
    untested = len(found.logs) - len(tested)
    rest = f", {untested} not tested" if untested else ""
    if found.assumed:
        return _few_headline(found)
    if found.findings:
        return f"{'; '.join(f.words for f in found.findings)} ({changed} of {len(tested)} logs changed{rest})"
    what = (
        f"{changed} of {len(tested)} logs changed" if changed else f"none of {len(tested)} logs has changed"
    )
    return f"{what}{rest}"


def _few_headline(found: Trend) -> str:
    """What differs in the last of a few logs, and that no scatter is known."""
    told = "; ".join(f.words for f in found.findings) or _few_verdict(found)
    return f"{told}. {_beyond_noise(found)}; {found.assumed}"


def _beyond_noise(found: Trend) -> str:
    """What differs in the last of a few logs by more than their noise, and how many quantities do not."""
    last = found.compared[-1:]
    differ = [d for c in last for d in c.differences if d.differs]
    alike = sum(len(c.differences) for c in last) - len(differ)
    named = ", ".join(
        f"{in_words(d.name)} {in_percent(d) or _moved(d.size, d.unit)} ({abs(d.sigmas):.0f} σ)"
        for d in differ[:FIRST_NAMED]
    )
    more = f" and {len(differ) - FIRST_NAMED} more" if len(differ) > FIRST_NAMED else ""
    beyond = (
        f"Beyond the noise of the logs differ {named}{more}"
        if differ
        else "No difference beyond the noise of the logs"
    )
    return f"{beyond}; {alike} quantities do not"


def _few_verdict(found: Trend) -> str:
    """What is said where the last of a few logs shows no change."""
    last = found.logs[-1]
    if last.verdict == NOT_TESTED:
        return f"{_short(last.digest.path)} is not tested: {last.reason}"
    return NO_CHANGE_OF_FEW


def page(found: Trend, name: str, bad: list[str], reports: Mapping[str, str] = NONE, fleet: str = "") -> str:
    """trend.html: one file, no network, the same bytes for the same logs."""
    order = _lane_order(found)
    return (
        environment()
        .get_template("trend.html")
        .render(
            found=found, name=name, bad=bad, lanes=lanes(found, order[:LANES], "lanes", reports),
            folded=lanes(found, order[LANES:], "folded", reports) if len(order) > LANES else None,
            score=score_chart(found, reports), reports=reports, fleet=fleet,
            counts={v: sum(j.verdict == v for j in found.logs) for v in (CHANGED, UNCHANGED, NOT_TESTED)},
            colours=COLOURS, words=in_words, versions=versions(), least=_least(found), size=with_unit, level=_level, moved=_moved,
            short=_short, sizes=_sizes, cause=_cause, percent=in_percent,
            no_change=NO_CHANGE_OF_FEW if found.assumed else "Nothing has changed",
            beyond=_beyond_noise(found) if found.assumed and found.compared else "",
        )
    )  # fmt: skip


def _short(path: str) -> str:
    """The name of a log without its folders."""
    return path.replace("\\", "/").rpartition("/")[2]


def _level(value: float, unit: str) -> str:
    """A usual value; none for one without a unit, which is a logarithm: only its changes say something."""
    return "" if unit == "1" else with_unit(value, unit)


def _sizes(f: Finding) -> tuple[str, str, str]:
    """What it was, by how much it changed, and the standard error of that, in one unit and to the digit that the error leaves."""
    if f.unit == "1":
        return "", _moved(f.size, f.unit), _moved(f.std, f.unit).removeprefix("+")
    unit, factor = readable(f.unit, max(abs(f.before), abs(f.size)))
    before, size, std = (to_the_error(factor * v, factor * f.std) for v in (f.before, f.size, f.std))
    return f"{before} {unit}", f"{'+' if f.size > 0.0 else ''}{size} {unit}", f"{std} {unit}"


def _cause(f: Finding) -> str:
    """The cause in words; that of a friction which the contract calls by what it is in one direction says so."""
    both = f.name == "A" and f.cause == "asymmetric_friction"
    return "friction, in both directions" if both else f.cause.replace("_", " ")


def _moved(size: float, unit: str) -> str:
    """A change with its sign; of a logarithm in per cent."""
    return f"{digits(100.0 * math.expm1(size), sign='+')} %" if unit == "1" else with_unit(size, unit, "+")


def _least(found: Trend) -> list[tuple[str, float, float, str]]:
    """Name, usual value, the step that would have been seen by now, and unit of every quantity."""
    if found.history is None:
        return []
    b = found.baseline
    return [
        (n, float(v), float(d), u)
        for n, v, d, u in zip(b.names, b.coefficients[0], found.history.detectable, b.units, strict=True)
        if math.isfinite(d)
    ]


def _lane_order(found: Trend) -> list[int]:
    """Rows of the quantities: those of changes first, then by how far they went."""
    names = found.baseline.names
    first = [names.index(n) for f in found.findings for n in f.names]
    first += [names.index(m.name) for j in found.logs for m in j.changed]
    return list(dict.fromkeys([*first, *range(len(names))]))


def _places(found: Trend) -> tuple[Array, str]:
    """Where along the axis the logs stand, and its label."""
    if found.history is not None:
        return found.times, f"{found.unit} since the first"
    return np.arange(len(found.table.paths), dtype=float), "logs"


def lanes(found: Trend, rows: list[int], name: str, reports: Mapping[str, str] = NONE) -> Charts:
    """A lane a quantity: each log as a dot without what its conditions do, the fitted level, the healthy band, changes marked."""
    times, label = _places(found)
    order = np.argsort(times, kind="stable")
    values, level = _lane_values(found)
    verdicts = _colours(found)[order]
    paths = [_paths(found)[k] for k in order]
    names, links = tuple(map(_short, paths)), tuple(reports.get(path, "") for path in paths)
    panels = []
    for row in rows:
        unit, factor = readable(
            found.baseline.units[row], float(np.nanmax(np.abs(values[:, row]), initial=0.0))
        )
        value, fitted = factor * values[order, row], factor * level[order, row]
        scatter = found.baseline.limit_of * found.baseline.scatter[row] * factor
        middle = found.baseline.coefficients[0, row] * factor
        words, own = in_words(found.baseline.names[row]), found.baseline.names[row]
        marks = tuple(
            Mark(float(times[f.row]), f"{f.kind}: {_cause(f)}", COLOURS[CHANGED])
            for f in found.findings
            if own in f.names
        )
        lines = (*_dots(value, verdicts), Series("fitted level", fitted, INK, 1.2))
        about = f"{words} over the logs, one dot each, with the level fitted to them and the band of healthy ones."
        panels.append(
            Panel(f"{words} ({own})", unit, times[order], lines, about, label, "logs", levels=_band(middle, scatter),
                  least=max(scatter, 0.0) if math.isfinite(scatter) else 0.0, marks=marks, height=96, names=names, links=links)
        )  # fmt: skip
    return Charts(name, tuple(panels))


def _dots(value: Array, verdicts: Array) -> list[Series]:
    """The logs of each verdict as dots of its colour."""
    return [
        Series(
            verdict.replace("_", " "), np.where(verdicts == verdict, value, np.nan), colour, 0.0, points=5.0
        )
        for verdict, colour in COLOURS.items()
        if (verdicts == verdict).any()
    ]


def _band(middle: float, scatter: float) -> tuple[Level, ...]:
    """What one quantity alone may differ by."""
    known = math.isfinite(middle) and math.isfinite(scatter)
    return (Level(middle - scatter, to=middle + scatter),) if known else ()


def _lane_values(found: Trend) -> tuple[Array, Array]:
    """Values and fitted levels (n, k) that the lanes show."""
    if found.history is not None:
        return found.history.value, found.history.level
    columns = [found.table.names.index(n) if n in found.table.names else -1 for n in found.baseline.names]
    values = np.column_stack(
        [found.table.value[:, c] if c >= 0 else np.full(len(found.table.paths), np.nan) for c in columns]
    )
    return values, np.full_like(values, np.nan)


def _colours(found: Trend) -> Array:
    """Verdict of every log of the lanes; the baseline's own have none and count as unchanged."""
    verdicts = {j.digest.path: j.verdict for j in found.logs}
    return np.array([verdicts.get(path, UNCHANGED) for path in _paths(found)])


def _paths(found: Trend) -> Sequence[str]:
    """The logs of the lanes."""
    return found.paths if found.history is not None else found.table.paths


def _along(found: Trend, judged: Sequence[Judged]) -> tuple[Array, str, str]:
    """Where judged logs stand, label and link of that axis: that of the lanes, where they have ascending places there."""
    times, label = _places(found)
    place = dict(zip(_paths(found), times.tolist(), strict=True))
    x = np.array([place.get(j.digest.path, math.nan) for j in judged], dtype=np.float64)
    if np.isfinite(x).all() and (np.diff(x) > 0.0).all():
        return x, label, "logs"
    return np.arange(x.size, dtype=np.float64), "logs in order", ""


def score_chart(found: Trend, reports: Mapping[str, str] = NONE) -> Charts:
    """The score of every log against the limit."""
    judged = [j for j in found.logs if j.verdict != NOT_TESTED]
    if not judged:
        return Charts("score", ())
    y, verdicts = np.array([j.score for j in judged]), np.array([j.verdict for j in judged])
    limit = Level(1.0, f"limit: one false alarm in {digits(1.0 / found.rate, 4)} logs")
    about = "Distance of every log from healthy ones, one dot each; above the dashed line a log has changed."
    x, label, link = _along(found, judged)
    panel = Panel(
        "Score",
        "",
        x,
        tuple(_dots(y, verdicts)),
        about,
        label,
        link,
        levels=(Level(0.0), limit),
        height=150,
        names=tuple(_short(j.digest.path) for j in judged),
        links=tuple(reports.get(j.digest.path, "") for j in judged),
    )
    return Charts("score", (panel,))
