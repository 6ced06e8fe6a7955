"""Still figures, drawn by matplotlib: their one style, the files that they become, and those of `pipelines/` and `reports/`.

Nothing imports this module but who wants such a figure: matplotlib costs most of a second, `diagnose` draws without it
(docs/decisions/0014). Arrays in, a `Figure` out; the same arrays give the same bytes. Colours are those of the faults. What a
result shows of itself is in `results/figures.py`.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib.figure
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes as Axes

from observer_fi.errors import UsageError
from observer_fi.physics import NOMINAL, OPEN_LOOP, colour_of, words_of
from observer_fi.records import Array
from observer_fi.report.comparison_page import FAULTS, JUDGES, milliseconds

MEASURED, MUTED, GRID, INK = "#3d444c", "#5c6670", "#e3e6ea", "#1b1f24"
KINDS = ("png", "svg", "pdf")
DPI = 150
# What would make two files of one figure differ: the moment, and the version of what drew it.
_UNSIGNED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
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


class Figure(matplotlib.figure.Figure):
    """A figure that a notebook shows, whether or not it has set matplotlib up to draw there."""

    def _repr_png_(self) -> bytes:
        return drawn(self, "png")


def drawn(figure: matplotlib.figure.Figure, kind: str) -> bytes:
    """A figure as a PNG, SVG or PDF file, without a date and without the version of what drew it. Raises UsageError."""
    if kind not in KINDS:
        raise UsageError(f"figures are written as {', '.join(KINDS)}, not as {kind!r}")
    out = io.BytesIO()
    with style.context(["default", STYLE]):
        figure.savefig(out, format=kind, dpi=DPI, metadata=_UNSIGNED[kind])
    return out.getvalue()


def svg(figure: matplotlib.figure.Figure) -> str:
    """A figure as the text of an SVG file."""
    return drawn(figure, "svg").decode()


def still_files(figures: Mapping[str, Figure], kind: str) -> dict[str, bytes]:
    """The figures of a result as files, {file name: content}. kind: one of KINDS. Raises UsageError."""
    return {f"{name}.{kind}": drawn(figure, kind) for name, figure in figures.items()}


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
