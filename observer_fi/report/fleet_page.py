"""The summary of a fleet for people: what each log needs, what was found when and how large, log by log, and a table of all."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from observer_fi.numerics import readable_share
from observer_fi.physics import NOMINAL, NOT_TESTED, UNKNOWN, Rig, colour_of, mode_of, words_of
from observer_fi.records import Array
from observer_fi.report.diagnosis import NAMES, environment, versions
from observer_fi.report.interactive import Charts, Level, Panel, Series
from observer_fi.settings import Settings

Rows = Sequence[Mapping[str, Any]]

# What a log asks of who reads the page, the most urgent first: its word, its colour, what it means.
URGENCIES = {
    "act": ("Act", "#b3261e", "a fault that is certain"),
    "look": ("Look", "#b4560f", "a fault that is likely, or none that has a name"),
    "none": ("No verdict", "#8a929b", "not tested, not readable or not done"),
    "healthy": ("Healthy", "#3d6fa8", "no fault"),
}
HEIGHTS = {"none": 0.0, "healthy": 1.0, "look": 2.0, "act": 3.0}  # of the dots
CERTAIN = Settings().decision.isolated
SIZES = 4  # sizes of faults that are drawn, those of most events first
LINK = "logs"


def page(folder: str, rig: Rig, rows: Rows, trends: Mapping[str, str]) -> str:
    """index.html: one file, no network, the same bytes for the same logs. rows: worst first; trends: name and link of pages."""
    return str(
        environment()
        .get_template("fleet.html")
        .render(
            folder=folder, rig=rig, rows=rows, trends=trends, charts=charts(rows), what_of=what_of, urgency_of=urgency_of,
            counts=_counted(what_of(row) for row in rows), urgent=_counted(urgency_of(row) for row in rows),
            urgencies=URGENCIES, names=NAMES | {"bad": "Not readable", "failed": "Not done"}, colour_of=colour_of,
            link=_link, versions=versions(),
        )
    )  # fmt: skip


def what_of(row: Mapping[str, Any]) -> str:
    """The label of a log's verdict, or the status of one without."""
    return str(row["label"] if row["status"] == "done" else row["status"])


def urgency_of(row: Mapping[str, Any]) -> str:
    """Which of URGENCIES a log is."""
    what = what_of(row)
    if what in ("bad", "failed", NOT_TESTED):
        return "none"
    if what == NOMINAL:
        return "healthy"
    return "act" if what != UNKNOWN and row["probability"] > CERTAIN else "look"


def _counted(words: Any) -> dict[str, int]:
    found: dict[str, int] = {}
    for word in words:
        found[word] = found.get(word, 0) + 1
    return found


def _link(path: str) -> str:
    return quote(os.fsencode(path))


# --- the charts -------------------------------------------------------------------------------------


def charts(rows: Rows) -> Charts:
    """Over the logs in the order of their paths: what each needs, when its faults began, how large they are, the fit."""
    ordered = sorted(rows, key=lambda row: str(row["log"]))
    where = _Logs(ordered)
    events = [(k, event) for k, row in enumerate(ordered) for event in json.loads(row["events"] or "[]")]
    panels = [_needs(where)]
    panels += [_onsets(where, events)] if any(e["onset_s"] is not None for _, e in events) else []
    panels += [_sizes(where, events, name) for name in _most_common(events)]
    if any(_finite(row["nis_ratio"]) for row in ordered):
        panels.append(_fit(where))
    return Charts("fleet", tuple(panels))


class _Logs:
    """The logs along the axis, with what a point of theirs is called and leads to."""

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self.names = [str(row["log"]) for row in rows]
        self.links = [_link(row["report"]) if row["report"] else "" for row in rows]

    def panel(
        self, title: str, unit: str, at: Sequence[int], series: Sequence[Series], about: str, **how: Any
    ) -> Panel:
        """A panel of dots, the k-th of which is of the log at[k]."""
        x = np.array(at, dtype=np.float64) + 1.0
        names, links = (tuple(told[k] for k in at) for told in (self.names, self.links))
        return Panel(
            title,
            unit,
            x,
            tuple(series),
            about,
            "logs in the order of their paths",
            LINK,
            names=names,
            links=links,
            **how,
        )


def _needs(where: _Logs) -> Panel:
    """Which of URGENCIES each log is, as heights."""
    urgency = [urgency_of(row) for row in where.rows]
    height = np.array([HEIGHTS[u] for u in urgency])
    lines = _dots(
        height,
        [URGENCIES[u][0] for u in urgency],
        {word: colour for word, colour, _ in URGENCIES.values()},
        7.0,
    )
    about = "What each log asks for, one dot each: act, look, no verdict or healthy."
    ticks = tuple((HEIGHTS[u], u) for u in URGENCIES)
    return where.panel(
        "What each log asks for",
        "",
        range(len(height)),
        lines,
        about,
        limits=(-0.5, 3.5),
        ticks_up=ticks,
        height=96,
    )


Events = list[tuple[int, dict[str, Any]]]


def _onsets(where: _Logs, events: Events) -> Panel:
    """When each fault began on its log's own clock."""
    placed = [(k, e) for k, e in events if e["onset_s"] is not None]
    about = "When each fault began, in seconds of its log, one dot each, in the colour of its kind."
    return _by_kind(
        where,
        "Onset of every fault, on the clock of its log",
        "s",
        placed,
        [e["onset_s"] for _, e in placed],
        about,
    )


def _most_common(events: Events) -> list[str]:
    """Names of the sizes that faults have, those of most events first."""
    found = _counted(name for _, event in events for name in event["severity"])
    return sorted(found, key=lambda name: (-found[name], name))[:SIZES]


def _sizes(where: _Logs, events: Events, name: str) -> Panel:
    """One size of the faults that have it."""
    having = [(k, e) for k, e in events if name in e["severity"]]
    unit = having[0][1]["severity"][name]["unit"]
    largest = max(abs(e["severity"][name]["value"]) for _, e in having)
    unit, factor = readable_share(unit, largest)
    words = name.replace("_", " ")
    about = f"The {words} of every fault that has one, one dot each, in the colour of its kind."
    values = [factor * e["severity"][name]["value"] for _, e in having]
    return _by_kind(where, f"How large: {words}", unit, having, values, about)


def _by_kind(
    where: _Logs, title: str, unit: str, events: Events, values: Sequence[float], about: str
) -> Panel:
    kinds = [mode_of(e["label"], e["channel"]) for _, e in events]
    colours = {
        words_of(kind): colour_of(e["label"], e["channel"])
        for kind, (_, e) in zip(kinds, events, strict=True)
    }
    lines = _dots(np.array(values, dtype=np.float64), [words_of(kind) for kind in kinds], colours)
    return where.panel(title, unit, [k for k, _ in events], lines, about, height=110)


def _fit(where: _Logs) -> Panel:
    """How well the winning model fits: 1 is what the noise of the sensors leaves."""
    judged = [(k, row) for k, row in enumerate(where.rows) if _finite(row["nis_ratio"])]
    y = np.array([row["nis_ratio"] for _, row in judged])
    words = [URGENCIES[urgency_of(row)][0] for _, row in judged]
    lines = _dots(y, words, {word: colour for word, colour, _ in URGENCIES.values()})
    about = "Normalised innovations squared over what is expected, one dot a log; 1 where the model fits."
    return where.panel(
        "Fit (NIS / expected)", "", [k for k, _ in judged], lines, about, levels=(Level(1.0),), height=96
    )


def _dots(y: Array, words: Sequence[str], colours: Mapping[str, str], size: float = 6.0) -> list[Series]:
    """Dots of each word as a series of its own colour."""
    own = np.array(words)
    return [
        Series(word, np.where(own == word, y, np.nan), colour, 0.0, points=size)
        for word, colour in colours.items()
        if word in words
    ]


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
