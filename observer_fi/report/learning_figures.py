"""Charts of `identify` and `improve`: fits over data, residuals before and after, correlations, smooth terms."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from observer_fi.improve import Improvement, Residuals, Smooth
from observer_fi.numerics import readable
from observer_fi.physics import Curve
from observer_fi.records import Array, Fit
from observer_fi.report.interactive import MUTED, Charts, Level, Panel, Series, joined, thinned

BEFORE, AFTER, MEASURED = "#b4560f", "#0b62b0", "#9aa3ad"
CHANNELS = (("Voltage", "V", 1.0), ("Current", "mA", 1e3), ("Position", "mm", 1e3))
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
    "torque": ("torque", "N m"),
    "electrical": ("resistance", "ohm"),
    "kinematics": ("share of travel", "1"),
    "sensor:position": ("position error", "m"),
    "sensor:current": ("current error", "A"),
    "sensor:voltage": ("voltage error", "V"),
}
AXES = {
    "current": ("current", "A"), "voltage": ("terminal voltage", "V"), "pitch": ("pitch", "deg"),
    "torque": ("motor torque", "N m"), "time": ("time", "s"), "speed": ("speed", "rad/s"),
    "error": ("speed less command", "rad/s"), "x": ("position", "m"),
    "angle": ("motor angle", "rad"),
}  # fmt: skip
RIGS = (("refitted rig", BEFORE), ("extended rig", AFTER))  # before and after
ALONG = 4000  # points of a line over the logs, at most
ZERO = (Level(0.0),)


def main_channel(residuals: Residuals) -> int:
    """The channel that shows most: the current, where it is measured."""
    return residuals.channels.index("current") if "current" in residuals.channels else 0


def regressor(residuals: Residuals, name: str) -> tuple[str, float]:
    """Label of a regressor, and the factor to its unit."""
    known = REGRESSORS | _OF_FORCE if "force" in residuals.channels else REGRESSORS
    return known.get(name, (name.replace("_", " "), 1.0))


def quantity(label: str) -> str:
    """The label of an axis without its unit."""
    return label.partition(" [")[0]


def _named(residuals: Residuals, channel: int) -> tuple[str, str]:
    """What a residual is called, and its unit: none where it is over the noise."""
    name = f"{residuals.channels[channel]} residual"
    return (f"{name} / noise", "") if residuals.unit == "noise" else (name, residuals.unit)


def residuals_over_time(before: Residuals, after: Residuals) -> Charts:
    """Residuals of every channel over the logs, before and after, on one axis."""
    step = float(np.median(np.diff(before.t))) if before.t.size > 1 else 0.0
    panels = []
    for c in range(len(before.channels)):
        place: Array = np.asarray(step * np.arange(before.t.size), dtype=np.float64)
        along, both = thinned(place, before.z_minus_y[:, c], after.z_minus_y[:, c], most=ALONG)
        title, unit = _named(before, c)
        lines = [Series(name, y, colour, 1.0) for (name, colour), y in zip(RIGS, both, strict=True)]
        about = f"The {title} over the moves, of the refitted and of the extended rig."
        panels.append(
            Panel(title.capitalize(), unit, along, tuple(lines), about, "time along the moves [s]", "residuals",
                  least=4.0 if before.unit == "noise" else 0.0, levels=ZERO)
        )  # fmt: skip
    return Charts("over-time", tuple(panels))


def residual_curves(before: Residuals, after: Residuals, channel: int) -> Charts:
    """Mean residual of a channel over each regressor, with the sign of motion, before and after."""
    title, unit = _named(before, channel)
    panels = []
    for name in (n for n in REGRESSORS if n in before.curves and before.curves[n].at.size > 2):
        label, scale = regressor(before, name)
        pair = (before.curves[name], after.curves.get(name, before.curves[name]))
        x, both = joined(*((scale * curve.at, curve.mean[:, channel]) for curve in pair))
        lines = [
            Series(rig, y, colour, 1.6, points=4.0, spans=True)
            for (rig, colour), y in zip(RIGS, both, strict=True)
        ]
        about = f"Mean {title} over {label}, of the refitted and of the extended rig."
        panels.append(
            Panel(f"over {quantity(label)}", unit, x, tuple(lines), about, label, levels=ZERO,
                  least=0.5 if before.unit == "noise" else 0.0)
        )  # fmt: skip
    return Charts(f"curves-{channel}", tuple(panels), small=True)


def spectra(before: Residuals, after: Residuals, channel: int) -> Charts:
    """Power of a channel's residual over frequency and over orders of the motor turn; 1 is white noise."""
    sides = (
        ("over frequency [Hz]", before.spectrum, after.spectrum),
        ("per motor turn", before.orders, after.orders),
    )
    panels = []
    for label, one, two in sides:
        if not one[1].size or not two[1].size:
            continue
        x, both = joined(*((side[0][1:], np.maximum(side[1][1:, channel], 1e-4)) for side in (one, two)))
        x, both = thinned(x, *both, most=ALONG)
        lines = [Series(rig, y, colour, 1.2, spans=True) for (rig, colour), y in zip(RIGS, both, strict=True)]
        about = f"Power of the {before.channels[channel]} residual {label}; white noise lies at 1."
        panels.append(
            Panel(f"Power {quantity(label)}", "1 = white", x, tuple(lines), about, label, scale="log",
                  levels=(Level(1.0, "white"),), height=170)
        )  # fmt: skip
    return Charts("spectra", tuple(panels), small=True)


def smooth_curves(terms: Sequence[Smooth], residuals: Residuals) -> Charts:
    """The curve of every unexplained term with its band of two standard errors."""
    panels = []
    for term in [term for term in terms if term.at.size][:3]:
        label, scale = (term.over, 1.0) if term.over else regressor(residuals, term.regressor)
        what, unit = UNITS.get(term.equation, (term.equation, "1"))
        if term.unit:
            what, unit = term.what, term.unit
        unit, factor = readable(unit, float(np.nanmax(np.abs(term.curve))))
        order = np.argsort(term.at)
        x, y, band = scale * term.at[order], factor * term.curve[order], 2.0 * factor * term.band[order]
        line = Series(what, y, AFTER, 1.8, low=y - band, high=y + band)
        about = f"The {what} over {label} that the residual asks for, with a band of two standard errors."
        panels.append(
            Panel(
                f"{what.capitalize()} over {quantity(label)}",
                unit,
                x,
                (line,),
                about,
                label,
                levels=ZERO,
                height=160,
            )
        )
    return Charts("smooth", tuple(panels), small=True)


def kept_curve(curve: Curve) -> Charts:
    """The empirical curve of the extended rig at its points, with a band of two standard errors."""
    label, scale = REGRESSORS[curve.regressor]
    what, unit = UNITS[curve.equation]
    unit, factor = readable(unit, max(map(abs, curve.values)))
    x = np.array([scale * (curve.first + k * curve.step) for k in range(len(curve.values))])
    y = np.array([factor * v for v in curve.values])
    band = np.array([2.0 * factor * v for v in curve.std or (0.0,) * y.size])
    line = Series(what, y, AFTER, 1.4, points=4.0, low=y - band, high=y + band)
    about = f"The {what} over {label} that the extended rig keeps, with a band of two standard errors."
    panel = Panel(
        f"{what.capitalize()} over {quantity(label)}", unit, x, (line,), about, label, levels=ZERO, height=160
    )
    return Charts("kept", (panel,))


def of_improve(record: Improvement) -> dict[str, Charts]:
    """All charts of an improve report, by name."""
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


def fit_over_data(one: dict[str, Any], number: int) -> Charts:
    """Measured and simulated readings of one log, and the residuals below each, on one axis."""
    t, measured, simulated, r = (
        np.asarray(one[k], dtype=float) for k in ("time", "measured", "simulated", "residual")
    )
    panels = []
    for c, (name, unit, scale) in enumerate(CHANNELS):
        x, (y, model, left) = thinned(t, scale * measured[:, c], scale * simulated[:, c], r[:, c], most=ALONG)
        lines = (Series("measured", y, MEASURED, 2.0), Series("simulated", model, AFTER, 1.2))
        about = f"{name} of log {number + 1} over time, measured and simulated."
        panels.append(Panel(name, unit, x, lines, about, link=f"fit-{number}"))
        below = (Series("residual / noise", left, BEFORE, 1.0),)
        about = f"Residual of the {name.lower()} of log {number + 1} over the noise of its sensor."
        panels.append(
            Panel(
                f"{name}: residual / noise",
                "",
                x,
                below,
                about,
                link=f"fit-{number}",
                least=4.0,
                levels=ZERO,
                height=80,
            )
        )
    return Charts(f"fit-{number}", tuple(panels))


def of_identify(fit: Fit) -> dict[str, Charts]:
    """All charts of an identify report, by name."""
    drawn = {f"fit_{k + 1}": fit_over_data(one, k) for k, one in enumerate(fit.figures.get("fits", [])[:4])}
    steps: dict[str, Any] = fit.figures.get("steps", {})
    drawn |= {f"step_{name}": step_chart(name, step) for name, step in steps.items() if _pairs(step)}
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


def step_chart(name: str, step: Any) -> Charts:
    """One step of section 3: data as dots, what was fitted as lines, one a direction of motion."""
    curves = _pairs(step)
    x = curves[0][1]
    ways = np.asarray(step.arrays.get("direction", np.ones(x.size)))
    both = np.unique(ways)
    drawn = [(label, y, MUTED, 0.0) for label, _, y in curves[:1]]
    for k, (label, _, y) in enumerate(curves[1:]):
        for way in both:
            called = f"{label}, {'forward' if way > 0 else 'backward'}" if both.size > 1 else label
            drawn.append((called, np.where(ways == way, y, np.nan), (AFTER, BEFORE)[k % 2], 1.5))
    order = np.argsort(x, kind="stable")
    dots = 5.0 if x.size < 40 else 2.5
    label, across = _axis(next(iter(step.arrays)), x)
    what, up = _axis(curves[0][0], curves[0][2])
    lines = [
        Series(
            called.replace("_", " "), up * y[order], colour, width, points=0.0 if width else dots, spans=True
        )
        for called, y, colour, width in drawn
    ]
    title = f"{name.replace('_', ' ').capitalize()}, equation {step.equation}: {what}"
    about = f"{what.capitalize()} over {label}: data of the step as dots, what was fitted to them as lines."
    return Charts(
        f"step-{name}", (Panel(title, "", across * x[order], tuple(lines), about, label, height=170),)
    )


def _axis(name: str, values: Array) -> tuple[str, float]:
    """Label of an axis with the unit in which its values are short, and the factor to it."""
    words, unit = AXES.get(name, (name.replace("_", " "), "1"))
    shown, factor = readable(unit, float(np.nanmax(np.abs(values), initial=0.0)))
    return (f"{words} [{shown}]" if shown else words), factor
