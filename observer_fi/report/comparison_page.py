"""What `compare` found, for people: a page, and a table for the terminal."""

from typing import Any

import numpy as np

from observer_fi.physics import NOT_TESTED, OPEN_LOOP, colour_of, words_of
from observer_fi.report.chart import MUTED, Figure, Panel
from observer_fi.report.diagnosis import NAMES, environment, versions

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
            figure=delay_figure(result["cases"]),
            wrong=[c for c in result["cases"] if any(c[j]["verdict"] != c["label"] for j in JUDGES)],
            versions=versions(),
        )
    )


def delay_figure(cases: list[dict[str, Any]]) -> str:
    """Every delay as a dot, by fault, phase and judge, on a logarithmic scale."""
    figure = Figure("delays", 1040.0, 330.0, "Time from the onset to the isolation")
    groups = sorted({case["group"] for case in cases}, reverse=True)
    for column, fault in enumerate(FAULTS):
        left = 60.0 + column * 500.0
        figure.text(left, 22.0, words_of(fault).capitalize(), weight=650, size=14)
        panel = figure.panel(left, 60.0, 440.0, 210.0, (0.0, 2.0 * len(groups)), (0.5, 3000.0), log=True)
        panel.frame(y_label="onset to isolation [ms]", x_ticks=False)
        for g, group in enumerate(groups):
            figure.text(left + 440.0 * g / len(groups) + 30.0, 305.0, group, MUTED)
            for j, judge in enumerate(JUDGES):
                delays = [c[judge]["delay_s"] for c in cases if c["label"] == fault and c["group"] == group]
                _strip(panel, 2.0 * g + j + 0.5, np.array(delays, dtype=float), fault, judge)
    return figure.svg()


def _strip(panel: Panel, x: float, delays: np.ndarray, fault: str, judge: str) -> None:
    """A column of dots and its median."""
    left = float(panel.at_x(np.array(x - 0.35)))
    panel.notes.append(f'<text x="{left:.1f}" y="286" fill="{MUTED}">{judge}</text>')
    y = np.sort(1e3 * delays[np.isfinite(delays)])
    if not y.size:
        return
    colour = colour_of(fault) if judge == "bank" else "#8a929b"
    side = 0.3 * np.linspace(-1.0, 1.0, y.size)[np.argsort(np.arange(y.size) * 0.618 % 1.0)]
    panel.points(x + side, np.maximum(y, 0.6), colour, 5.0, 0.55)
    median = float(np.median(y))
    panel.line(np.array([x - 0.38, x + 0.38]), np.array([median, median]), "#1b1f24", 2.0)
    height = float(panel.at_y(np.array(max(median, 0.6))))
    middle = float(panel.at_x(np.array(x)))
    panel.notes.append(
        f'<text x="{middle:.1f}" y="{height - 9:.1f}" font-weight="600" text-anchor="middle" '
        f'stroke="#fff" stroke-width="3" paint-order="stroke">{milliseconds(median / 1e3)}</text>'
    )
