"""Figures of `identify` and `improve`: fits over data, residuals before and after, correlations, smooth terms."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from observer_fi.improve import Improvement, Residuals, Smooth
from observer_fi.physics import Curve
from observer_fi.records import Array, Fit
from observer_fi.report.chart import GRID, MUTED, Figure, padded

BEFORE, AFTER, MEASURED = "#b4560f", "#0b62b0", "#9aa3ad"
CHANNELS = (("Voltage [V]", 1.0), ("Current [mA]", 1e3), ("Position [mm]", 1e3))
REGRESSORS = {
    "speed": ("speed [rad/s]", 1.0),
    "position": ("position [mm]", 1e3),
    "shaft_angle": ("motor angle [rad]", 1.0),
    "screw_angle": ("screw angle [rad]", 1.0),
    "pitch": ("pitch [deg]", 1.0),
    "current": ("current [mA]", 1e3),
    "load": ("|current| [mA]", 1e3),
    "temperature": ("heat put in [J]", 1.0),
    "time": ("time [s]", 1.0),
    "direction": ("decades of m since reversal", 1.0),
}
_OF_FORCE = {"current": ("commanded force [N]", 1.0)}  # what commands there
UNITS = {
    "torque": ("torque [mN m]", 1e3),
    "electrical": ("resistance [ohm]", 1.0),
    "kinematics": ("share of travel", 1.0),
    "sensor:position": ("position error [µm]", 1e6),
    "sensor:current": ("current error [mA]", 1e3),
    "sensor:voltage": ("voltage error [mV]", 1e3),
}
AXES = {
    "current": "current [A]", "voltage": "terminal voltage [V]", "pitch": "pitch [deg]", "torque": "motor torque [N m]",
    "time": "time [s]", "speed": "speed [rad/s]", "error": "speed less command [rad/s]", "x": "position [m]",
    "angle": "motor angle [rad]",
}  # fmt: skip
WIDTH, LEFT, RIGHT = 1040.0, 62.0, 150.0


def main_channel(residuals: Residuals) -> int:
    """The channel that shows most: the current, where it is measured."""
    return residuals.channels.index("current") if "current" in residuals.channels else 0


def regressor(residuals: Residuals, name: str) -> tuple[str, float]:
    """Label of a regressor, and the factor to its unit."""
    known = REGRESSORS | _OF_FORCE if "force" in residuals.channels else REGRESSORS
    return known.get(name, (name.replace("_", " "), 1.0))


def _label(residuals: Residuals, channel: int) -> str:
    name = residuals.channels[channel]
    return f"{name} residual / noise" if residuals.unit == "noise" else f"{name} residual [{residuals.unit}]"


def residuals_over_time(before: Residuals, after: Residuals) -> str:
    """Residuals of every channel over the logs, before and after."""
    count = len(before.channels)
    figure = Figure("over-time", WIDTH, count * 150.0 + 60.0, "Residuals before and after")
    step = float(np.median(np.diff(before.t))) if before.t.size > 1 else 0.0
    along: Array = np.asarray(step * np.arange(before.t.size), dtype=np.float64)
    span = (0.0, float(along[-1]) if along.size else 1.0)
    for c in range(count):
        last = c == count - 1
        least = 4.0 if before.unit == "noise" else 0.0
        limits = padded(np.quantile(before.z_minus_y[:, c], [0.002, 0.998]), least=least)
        panel = figure.panel(LEFT, 30.0 + 150.0 * c, WIDTH - LEFT - RIGHT, 105.0, span, limits)
        panel.frame("time along the moves [s]" if last else "", _label(before, c), last)
        panel.line(along, before.z_minus_y[:, c], BEFORE, 0.7, opacity=0.75)
        panel.line(along, after.z_minus_y[:, c], AFTER, 0.7)
        panel.end_labels(((limits[1] * 0.5, "refitted rig", BEFORE), (0.0, "extended rig", AFTER)))
    return figure.svg()


def residual_curves(before: Residuals, after: Residuals, channel: int) -> str:
    """Mean residual of a channel over each regressor, with the sign of motion, before and after."""
    names = [n for n in REGRESSORS if n in before.curves and before.curves[n].at.size > 2]
    columns, width, height = 3, 255.0, 120.0
    rows = -(-len(names) // columns)
    figure = Figure(
        f"curves-{channel}", WIDTH, max(rows, 1) * (height + 78.0) + 20.0, "Residual over each regressor"
    )
    least = 0.5 if before.unit == "noise" else 0.0
    for k, name in enumerate(names):
        label, scale = regressor(before, name)
        one, two = before.curves[name], after.curves.get(name, before.curves[name])
        limits = padded(one.mean[:, channel], two.mean[:, channel], least=least)
        panel = figure.panel(
            LEFT + (k % columns) * (width + 75.0), 32.0 + (k // columns) * (height + 78.0), width, height,
            padded(scale * one.at), limits,
        )  # fmt: skip
        panel.frame(label, _label(before, channel) if k % columns == 0 else "")
        panel.level(0.0)
        for curve, colour in ((one, BEFORE), (two, AFTER)):
            panel.line(scale * curve.at, curve.mean[:, channel], colour, 1.6)
            panel.points(scale * curve.at, curve.mean[:, channel], colour, 4.0)
    return figure.svg()


def spectra(before: Residuals, after: Residuals, channel: int) -> str:
    """Power of a channel's residual over frequency and over orders of the motor turn; 1 is white noise."""
    figure = Figure("spectra", WIDTH, 250.0, "Spectra of the residual")
    sides = (
        ("frequency [Hz]", before.spectrum, after.spectrum),
        ("per motor turn", before.orders, after.orders),
    )
    for k, (label, one, two) in enumerate(sides):
        if not one[1].size or not two[1].size:
            continue
        x, power = one[0][1:], one[1][1:, channel]
        high = float(max(10.0, np.nanmax(power, initial=10.0)))
        span = (0.0, float(x[-1]) if x.size else 1.0)
        panel = figure.panel(LEFT + k * 490.0, 34.0, 390.0, 160.0, span, (0.05, 2.0 * high), log=True)
        panel.frame(label, "power, 1 = white" if k == 0 else "")
        panel.level(1.0)
        panel.line(x, power, BEFORE, 1.2)
        panel.line(two[0][1:], two[1][1:, channel], AFTER, 1.2)
    return figure.svg()


def smooth_curves(terms: Sequence[Smooth], residuals: Residuals) -> str:
    """The curve of every unexplained term with its band of two standard errors."""
    figure = Figure("smooth", WIDTH, 240.0, "What no named cause explains")
    for k, term in enumerate([term for term in terms if term.at.size][:3]):
        label, scale = regressor(residuals, term.regressor)
        unit, factor = UNITS.get(term.equation, (term.equation, 1.0))
        order = np.argsort(term.at)
        x, y, band = scale * term.at[order], factor * term.curve[order], 2.0 * factor * term.band[order]
        panel = figure.panel(LEFT + k * 330.0, 34.0, 240.0, 140.0, padded(x), padded(y - band, y + band))
        panel.frame(label, unit)
        panel.level(0.0)
        panel.line(x, y - band, MUTED, 0.8, "3 3")
        panel.line(x, y + band, MUTED, 0.8, "3 3")
        panel.line(x, y, AFTER, 1.8)
    return figure.svg()


def kept_curve(curve: Curve) -> str:
    """The empirical curve of the extended rig at its points, with a band of two standard errors."""
    figure = Figure("kept", WIDTH, 240.0, "The curve that is kept")
    label, scale = REGRESSORS[curve.regressor]
    unit, factor = UNITS[curve.equation]
    x = np.array([scale * (curve.first + k * curve.step) for k in range(len(curve.values))])
    y = np.array([factor * v for v in curve.values])
    band = np.array([2.0 * factor * v for v in curve.std or (0.0,) * y.size])
    panel = figure.panel(LEFT, 34.0, WIDTH - LEFT - RIGHT, 140.0, padded(x), padded(y - band, y + band))
    panel.frame(label, unit)
    panel.level(0.0)
    panel.line(x, y - band, MUTED, 0.8, "3 3")
    panel.line(x, y + band, MUTED, 0.8, "3 3")
    panel.line(x, y, AFTER, 1.4)
    panel.points(x, y, AFTER, 4.0)
    return figure.svg()


def of_improve(record: Improvement) -> dict[str, str]:
    """Every figure of an improve report, {name: SVG}."""
    main = main_channel(record.before)
    drawn = {
        "over_time": residuals_over_time(record.before, record.after),
        "curves": residual_curves(record.before, record.after, main),
        "spectra": spectra(record.before, record.after, main),
    }
    for c, name in enumerate(record.before.channels):
        if c != main:
            drawn[f"curves_{name}"] = residual_curves(record.before, record.after, c)
    if any(term.at.size for term in record.unexplained):
        drawn["unexplained"] = smooth_curves(record.unexplained, record.before)
    if record.kept:
        drawn["kept"] = kept_curve(record.kept.curve)
    return drawn


def fit_over_data(one: dict[str, Any], number: int) -> str:
    """Measured and simulated readings of one log, and the residuals below each."""
    figure = Figure(f"fit-{number}", WIDTH, 3 * 210.0 + 50.0, "The fit over the data")
    t, measured, simulated, r = (np.asarray(one[k]) for k in ("time", "measured", "simulated", "residual"))
    for c, (name, scale) in enumerate(CHANNELS):
        top = 28.0 + 210.0 * c
        x, shown = padded(t), measured if np.isfinite(measured[:, c]).any() else simulated
        panel = figure.panel(LEFT, top, WIDTH - LEFT - RIGHT, 95.0, x, padded(scale * shown[:, c]))
        panel.frame("", name, False)
        panel.line(t, scale * measured[:, c], MEASURED, 1.6)
        panel.line(t, scale * simulated[:, c], AFTER, 0.9)
        middle = float(np.nanmedian(scale * shown[:, c]))
        panel.end_labels(((middle, "measured", MUTED), (middle, "simulated", AFTER)))
        below = figure.panel(LEFT, top + 108.0, WIDTH - LEFT - RIGHT, 45.0, x, padded(r[:, c], least=4.0))
        below.frame("time [s]" if c == 2 else "", "", c == 2)
        below.level(0.0)
        below.line(t, r[:, c], BEFORE, 0.7)
        below.end_labels(((0.0, "residual / noise", BEFORE),))
    return figure.svg()


def correlation(fit: Fit) -> str:
    """The correlation matrix of the parameters as a grid of shaded squares with their values."""
    names = [p.name for p in fit.parameters]
    cell, left = 46.0, 130.0
    figure = Figure("correlation", WIDTH, cell * len(names) + 60.0, "Correlation of the parameters")
    for row, name in enumerate(names):
        figure.text(8.0, 42.0 + cell * row, name)
        for column in range(row + 1):
            value = float(fit.correlation[row, column]) if row < len(fit.correlation) else float("nan")
            panel = figure.panel(
                left + cell * column, 14.0 + cell * row, cell - 3.0, cell - 3.0, (0.0, 1.0), (0.0, 1.0)
            )
            colour = GRID if not np.isfinite(value) else (AFTER if value > 0.0 else BEFORE)
            panel.band(0.0, 1.0, colour, 0.0 if not np.isfinite(value) else min(abs(value), 1.0) * 0.85)
            panel.note(f"{value:.2f}" if np.isfinite(value) else "")
    return figure.svg()


def of_identify(fit: Fit) -> dict[str, str]:
    """Every figure of an identify report, {name: SVG}."""
    drawn = {f"fit_{k + 1}": fit_over_data(one, k) for k, one in enumerate(fit.figures.get("fits", [])[:4])}
    if len(fit.parameters) > 1 and np.asarray(fit.correlation).size:
        drawn["correlation"] = correlation(fit)
    steps: dict[str, Any] = fit.figures.get("steps", {})
    drawn |= {f"step_{name}": step_figure(name, step) for name, step in steps.items() if _pairs(step)}
    return drawn


def _pairs(step: Any) -> list[tuple[str, Array, Array]]:
    """Curves of a step of section 3: its first array is the abscissa, the others of the same length are drawn over it."""
    arrays = {
        k: np.asarray(v, dtype=float) for k, v in step.arrays.items() if np.ndim(v) == 1 and np.size(v) > 1
    }
    if len(arrays) < 2:
        return []
    (first, x), *rest = arrays.items()
    return [(name, x, y) for name, y in rest if y.size == x.size and name != "direction"]


def step_figure(name: str, step: Any) -> str:
    """One step of section 3: data as dots, what was fitted as lines, one a direction of motion."""
    curves = _pairs(step)
    title = f"{name.replace('_', ' ').capitalize()}, equation {step.equation}: {_axis(curves[0][0])}"
    figure = Figure(f"step-{name}", WIDTH, 230.0, title)
    x = curves[0][1]
    panel = figure.panel(
        LEFT, 34.0, WIDTH - LEFT - RIGHT, 140.0, padded(x), padded(*(y for _, _, y in curves))
    )
    panel.frame(_axis(next(iter(step.arrays))), title)
    ways = np.asarray(step.arrays.get("direction", np.ones(x.size)))
    labels = []
    for k, (label, at, y) in enumerate(curves):
        colour = MUTED if k == 0 else (AFTER, BEFORE)[(k - 1) % 2]
        for way in np.unique(ways) if k else ():
            order = np.flatnonzero(ways == way)[np.argsort(at[ways == way])]
            panel.line(at[order], y[order], colour, 1.4)
        if k == 0:
            panel.points(at, y, colour, 5.0 if y.size < 40 else 2.5)
        labels.append((float(y[np.argmax(at)]), label.replace("_", " "), colour))
    panel.end_labels(labels)
    return figure.svg()


def _axis(name: str) -> str:
    return AXES.get(name, name.replace("_", " "))
