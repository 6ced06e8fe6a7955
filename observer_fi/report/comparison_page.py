"""What `compare` found, for people: a page, and a table for the terminal."""

from typing import Any

import numpy as np

from observer_fi.physics import NOT_TESTED, OPEN_LOOP, colour_of, words_of
from observer_fi.records import Array
from observer_fi.report.diagnosis import NAMES, environment, versions
from observer_fi.report.interactive import INK, MUTED, Charts, Panel, Series

JUDGES = {"bank": "Observer bank", "mixture": "Open-loop mixture"}
FAULTS = OPEN_LOOP[1:]


def table(result: dict[str, Any]) -> str:
    """A few lines for the terminal."""
    lines = [f"{'':20}{'right':>8}{'overload [ms]':>16}{'coupling loss [ms]':>20}"]
    for judge, name in JUDGES.items():
        sheet = result[judge]
        medians = [milliseconds(sheet["delays"].get(fault, {}).get("median_s")) for fault in FAULTS]
        lines.append(f"{name:20}{100 * sheet['accuracy']:>7.1f}%{medians[0]:>16}{medians[1]:>20}")
    return "\n".join([*lines, "median time from the true onset to a posterior that stays above 0.95"])


def milliseconds(value: float | None) -> str:
    """Seconds as whole milliseconds, tenths below ten."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{1e3 * value:.1f}" if abs(value) < 0.01 else f"{1e3 * value:.0f}"


def page(result: dict[str, Any]) -> str:
    """compare.html: one file, no network, the same bytes for the same cases."""
    return (
        environment()
        .get_template("compare.html")
        .render(
            result=result,
            judges=JUDGES,
            faults=FAULTS,
            names={label: name for label, name in NAMES.items() if label != NOT_TESTED},  # all have moves
            ms=milliseconds,
            delays=delay_charts(result["cases"]),
            wrong=[c for c in result["cases"] if any(c[j]["verdict"] != c["label"] for j in JUDGES)],
            versions=versions(),
        )
    )


def delay_charts(cases: list[dict[str, Any]]) -> Charts:
    """Every delay as a dot, by fault, phase and judge, on a logarithmic scale, and the medians."""
    groups = sorted({case["group"] for case in cases}, reverse=True)
    strips = [(group, judge) for group in groups for judge in JUDGES]
    panels = []
    for fault in FAULTS:
        columns = [_delays(cases, fault, group, judge) for group, judge in strips]
        places = np.concatenate([_beside(k, y.size) for k, y in enumerate(columns)] or [np.empty(0)])
        medians = [float(np.median(y)) if y.size else np.nan for y in columns]
        x = np.concatenate((places, np.arange(len(strips)) + 0.5)) if strips else places
        order = np.argsort(x, kind="stable")
        lines = []
        for judge, name in JUDGES.items():
            own = [
                y if strip[1] == judge else np.full(y.size, np.nan)
                for strip, y in zip(strips, columns, strict=True)
            ]
            y = np.concatenate((*own, np.full(len(strips), np.nan)))
            lines.append(
                Series(name, y[order], colour_of(fault) if judge == "bank" else MUTED, 0.0, points=5.0)
            )
        y = np.concatenate((np.full(places.size, np.nan), medians))
        lines.append(Series("median", y[order], INK, 0.0, points=11.0))
        ticks = tuple((k + 0.5, f"{judge}\n{group.split()[0]}") for k, (group, judge) in enumerate(strips))
        about = f"Time from the onset to the isolation of {words_of(fault)} in ms, a dot a log, by judge and phase."
        title = f"{words_of(fault).capitalize()}: onset to isolation"
        panels.append(
            Panel(title, "ms", x[order], tuple(lines), about, "", scale="log", height=230, ticks=ticks)
        )
    return Charts("delays", tuple(panels))


def _delays(cases: list[dict[str, Any]], fault: str, group: str, judge: str) -> Array:
    """Times to the isolation [ms], in order, at least half a sample."""
    found = [c[judge]["delay_s"] for c in cases if c["label"] == fault and c["group"] == group]
    y = np.sort(1e3 * np.array(found, dtype=np.float64))
    return np.maximum(y[np.isfinite(y)], 0.6)


def _beside(place: int, count: int) -> Array:
    """Places of a column of dots, spread sideways so that each can be seen."""
    return place + 0.5 + 0.3 * np.linspace(-1.0, 1.0, count)[np.argsort(np.arange(count) * 0.618 % 1.0)]
