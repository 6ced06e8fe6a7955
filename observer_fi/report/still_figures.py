"""Still figures, drawn by matplotlib as SVG: those of `pipelines/` and `reports/`, and a result's own.

Nothing imports this module but who wants such a figure: matplotlib costs most of a second, `diagnose` draws without it
(docs/decisions/0014). Arrays in, a `Figure` out; the same arrays give the same bytes. Colours are those of the faults.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Figure

from observer_fi.physics import NOMINAL, NOT_TESTED, OPEN_LOOP, colour_of, mode_of, words_of
from observer_fi.records import Array, Outcome
from observer_fi.report.comparison_page import FAULTS, JUDGES, milliseconds
from observer_fi.report.diagnosis_figures import MEASURED

MUTED, GRID = "#5c6670", "#e3e6ea"
SIZE = (7.4, 3.4)  # inches of a figure with one pair of axes
STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "sans-serif"],
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": "#1b1f24",
    "axes.edgecolor": "#b8bfc7",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "observer-fi",  # else every file has names of its own
}
# End of acceleration, of voltage saturation and of stabilisation in a nominal start (section 3.1), s after the command.
PHASES = ((0.007, "acceleration"), (0.05, "saturation"), (0.25, "stabilisation"), (np.inf, "steady state"))
QUANTITIES = (("Motor voltage", "V", 1.0), ("Motor current", "mA", 1e3), ("Motor speed", "rad/s", 1.0))


class Curve(NamedTuple):
    """x and y (n,) of one line, what it is called, and its colour."""

    x: Array
    y: Array
    name: str
    colour: str


def svg(figure: Figure) -> str:
    """A figure as an SVG file without a date and without the version of what drew it."""
    out = io.StringIO()
    with style.context(["default", STYLE]):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


@contextmanager
def sheet(
    size: tuple[float, float] = SIZE, rows: int = 1, columns: int = 1, **share: Any
) -> Iterator[tuple[Figure, Any]]:
    """A figure of this size [inches] and its axes, drawn in one style whatever the user's own settings are."""
    with style.context(["default", STYLE]):
        figure = Figure(figsize=size, layout="constrained")
        yield figure, figure.subplots(rows, columns, **share)


def start_figure(quantity: int, since: Array, measured: Array, modelled: Array) -> Figure:
    """Figures 1 to 3 of the paper: voltage [V], current [A] or speed [rad/s] of a nominal start, measured and modelled.

    quantity: 0, 1 or 2 of QUANTITIES. since (n,): s after the command began.
    """
    name, unit, scale = QUANTITIES[quantity]
    with sheet() as (figure, axes):
        axes.plot(since, scale * measured, color=MEASURED, linewidth=5.0, alpha=0.35, label="measured")
        axes.plot(since, scale * modelled, color=colour_of(NOMINAL), linewidth=1.3, label="modelled, nominal")
        axes.set(xlabel="time since the command began [s]", ylabel=f"{name.lower()} [{unit}]")
        axes.set_title(f"Figure {quantity + 1}: {name.lower()}, nominal operation", pad=18.0)
        axes.set_xlim(float(since[0]), float(since[-1]))
        axes.legend(loc="lower right" if quantity == 2 else "upper right")
        _mark_phases(axes)
    return figure


def _mark_phases(axes: Axes) -> None:
    """The phases of a start, above the axes; the first is too short for its name."""
    begin, end = axes.get_xlim()
    for until, name in PHASES:
        if until < end:
            axes.axvline(until, color=MUTED, linewidth=0.8, linestyle=":")
        middle = 0.5 * (begin + min(until, end))
        if min(until, end) - begin > 0.03:
            axes.text(
                middle, 1.02, name, transform=axes.get_xaxis_transform(), ha="center", color=MUTED, fontsize=8
            )
        begin = min(until, end)


def contact_figure(measured: tuple[Array, Array], modelled: tuple[Array, Array]) -> Figure:
    """Figure 4 of the paper: motor current [A] against the distance after contact [m], measured and modelled."""
    with sheet() as (figure, axes):
        axes.plot(
            1e3 * measured[0],
            1e3 * measured[1],
            ".",
            color=MEASURED,
            markersize=3.5,
            alpha=0.5,
            label="measured",
        )
        axes.plot(
            1e3 * modelled[0],
            1e3 * modelled[1],
            color=colour_of("overload"),
            linewidth=1.6,
            label="modelled, overload",
        )
        axes.set(xlabel="distance after contact [mm]", ylabel="motor current [mA]")
        axes.set_title("Figure 4: motor current against distance, overload")
        axes.set_xlim(0.0, 1e3 * float(modelled[0].max()))
        axes.legend(loc="lower right")
    return figure


def residual_norm_figure(title: str, t: Array, norm: Array, detected_s: float) -> Figure:
    """Figures 5 to 7 of the paper: error residuals (equation 19) of the models in `OPEN_LOOP`, norm (n, 3), from t (n,) [s]."""
    curves = [Curve(t, norm[:, j], words_of(mode), colour_of(mode)) for j, mode in enumerate(OPEN_LOOP)]
    with sheet() as (figure, axes):
        for curve in curves:
            axes.semilogy(curve.x, curve.y, color=curve.colour, linewidth=0.9, label=f"model: {curve.name}")
        axes.axvline(detected_s, color=MUTED, linewidth=0.9, linestyle="--")
        axes.annotate(
            "anomaly detected", (detected_s, 0.97), xycoords=axes.get_xaxis_transform(), xytext=(-4, 0),
            textcoords="offset points", rotation=90, ha="right", va="top", color=MUTED, fontsize=8,
        )  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="error residual (equation 19) [1]", title=title)
        axes.set_xlim(detected_s - 0.15, float(t[-1]))
        axes.set_ylim(0.1, 300.0)
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure


def delay_figure(cases: Sequence[Mapping[str, Any]]) -> Figure:
    """Every time from the onset to the isolation as a dot, by fault, phase and judge, and the medians."""
    groups = sorted({case["group"] for case in cases}, reverse=True)
    with sheet((9.0, 3.8), 1, len(FAULTS), sharey=True) as (figure, row):
        for axes, fault in zip(row, FAULTS, strict=True):
            ticks = [(group, judge) for group in groups for judge in JUDGES]
            for place, (group, judge) in enumerate(ticks):
                found = [c[judge]["delay_s"] for c in cases if c["label"] == fault and c["group"] == group]
                _dots(
                    axes,
                    place,
                    np.array(found, dtype=float),
                    colour_of(fault) if judge == "bank" else "#8a929b",
                )
            axes.set_yscale("log")
            axes.set_ylim(0.5, 3000.0)
            axes.set_title(words_of(fault).capitalize())
            axes.set_xticks(range(len(ticks)), [f"{judge}\n{group}" for group, judge in ticks])
        row[0].set_ylabel("onset to isolation [ms]")
    return figure


def _dots(axes: Axes, place: int, delays: Array, colour: str) -> None:
    """A column of dots, spread sideways, and its median in words."""
    y = np.sort(1e3 * delays[np.isfinite(delays)])
    if not y.size:
        return
    side = 0.3 * np.linspace(-1.0, 1.0, y.size)[np.argsort(np.arange(y.size) * 0.618 % 1.0)]
    axes.plot(
        place + side, np.maximum(y, 0.6), "o", color=colour, markersize=4.0, alpha=0.6, markeredgewidth=0
    )
    median = max(float(np.median(y)), 0.6)
    axes.plot([place - 0.38, place + 0.38], [median, median], color="#1b1f24", linewidth=1.8)
    axes.annotate(
        milliseconds(median / 1e3), (place, median), xytext=(0, 5), textcoords="offset points", ha="center",
        fontweight="bold", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8},
    )  # fmt: skip


def force_figure(t: Array, force: Array, residuals: Sequence[Curve], unit: str = "N") -> Figure:
    """A force against time, and below it what each model leaves of it, on one scale."""
    largest = 1.05 * max(float(np.abs(curve.y).max()) for curve in residuals)
    with sheet((7.4, 1.6 + 1.25 * len(residuals)), 1 + len(residuals), 1, sharex=True) as (figure, column):
        column[0].plot(t, force, color=MEASURED, linewidth=0.8)
        column[0].set_title("Commanded force")
        for axes, curve in zip(column[1:], residuals, strict=True):
            axes.plot(curve.x, curve.y, color=curve.colour, linewidth=0.7)
            axes.set_title(f"Left by: {curve.name}")
            axes.set_ylim(-largest, largest)
        for axes in column:
            axes.set_ylabel(f"[{unit}]")
        column[-1].set_xlabel("time [s]")
        column[-1].set_xlim(float(t[0]), float(t[-1]))
    return figure


def diagnosis_figure(outcome: Outcome) -> Figure:
    """Measured voltage, current, position and speed around the onset, and the probability of every hypothesis below.

    Raises ValueError where the log held nothing to judge.
    """
    traces, isolation = outcome.zoom, outcome.isolation
    if traces is None or isolation is None or traces.t.size < 2 or isolation.verdict.label == NOT_TESTED:
        raise ValueError(f"{outcome.name}: there is no verdict to draw")
    verdict = isolation.verdict
    signals = (*traces.z.T, traces.w)
    words = (("voltage", "V", 1.0), ("current", "mA", 1e3), ("position", "mm", 1e3), ("speed", "rad/s", 1.0))
    with sheet((7.4, 8.0), 5, 1, sharex=True) as (figure, column):
        for axes, y, (name, unit, scale) in zip(column, signals, words, strict=False):
            axes.plot(traces.t, scale * y, color=MEASURED, linewidth=0.9)
            axes.set_ylabel(f"{name} [{unit}]")
        for j, mode in enumerate(outcome.modes):
            column[4].plot(
                traces.t,
                traces.probability[:, j],
                color=colour_of(mode),
                linewidth=1.3,
                label=words_of(mode),
            )
        for name, moment in (("onset", verdict.onset_s), ("isolated", verdict.isolated_s)):
            if moment is None or not traces.t[0] <= moment <= traces.t[-1]:
                continue
            for axes in column:
                axes.axvline(moment, color=MUTED, linewidth=0.8, linestyle="--")
            column[0].text(
                moment, 1.02, name, transform=column[0].get_xaxis_transform(), color=MUTED, fontsize=8,
                ha="right" if name == "onset" else "left",
            )  # fmt: skip
        column[4].set(xlabel="time [s]", ylabel="probability [1]", ylim=(-0.03, 1.03))
        column[4].legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
        figure.suptitle(f"Verdict: {words_of(mode_of(verdict.label, verdict.channel))}", x=0.02, ha="left")
    return figure


def interval_figure(table: pd.DataFrame) -> Figure:
    """Values of a fit with their 95 % intervals, as shares of what they were before; one row a parameter.

    table: by parameter, columns value, low, high, prior.
    """
    known = table[np.isfinite(table["prior"]) & (table["prior"] != 0.0)]
    scale, ratio = known["prior"].abs(), known["value"] / known["prior"].abs()
    wide = [(known["value"] - known["low"]) / scale, (known["high"] - known["value"]) / scale]
    figure = Figure(figsize=(7.0, 0.4 * len(known) + 1.2), layout="constrained")
    ax = figure.subplots()
    ax.errorbar(ratio, known.index, xerr=np.abs(np.array(wide)), fmt="o", capsize=3)
    ax.axvline(1.0, color="black", linestyle=":", linewidth=1.0)
    ax.set_xlabel("value, of the value before")
    return figure


def gain_figure(findings: pd.DataFrame) -> Figure:
    """What each cause gains on moves that no fit saw; columns cause, heldout_nll_drop_per_sample."""
    figure = Figure(figsize=(7.0, 0.4 * len(findings) + 1.2), layout="constrained")
    ax = figure.subplots()
    ax.barh(findings["cause"], findings["heldout_nll_drop_per_sample"])
    ax.set_xlabel("held-out gain [nats per sample]")
    return figure
