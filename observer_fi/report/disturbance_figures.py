"""Figures of freed equations: a smoothed disturbance with its 95 % band over time, and over what it may depend on."""

from collections.abc import Sequence

import numpy as np

from observer_fi.improve import DRAWN, BinnedDisturbance, SmoothedDisturbance
from observer_fi.records import Array
from observer_fi.report.chart import INK, Figure, Panel, padded
from observer_fi.report.learning_figures import AFTER, BEFORE, LEFT, REGRESSORS, RIGHT, WIDTH

HANDY = {
    "N m": ("mN m", 1e3),
    "V": ("mV", 1e3),
    "A": ("mA", 1e3),
    "m": ("µm", 1e6),
    "m/s": ("mm/s", 1e3),
    "N m s/rad": ("nN m s/rad", 1e9),
}
_OVER_TIME, _SMALL, _GAP = 130.0, 120.0, 78.0
_COLUMNS, _APART, _WIDE = 4, 250.0, 190.0
_RANGE, _ROOM = (
    (0.01, 0.99),
    0.3,
)  # quantiles, and what is shown beyond them: single samples at a start ask for any size


def of_disturbances(disturbances: Sequence[SmoothedDisturbance]) -> list[str]:
    """One SVG a disturbance."""
    return [disturbance_figure(disturbance, number) for number, disturbance in enumerate(disturbances)]


def handy(unit: str) -> tuple[str, float]:
    """A unit in which the numbers are short, and the factor to it."""
    return HANDY.get(unit, (unit, 1.0))


def disturbance_figure(disturbance: SmoothedDisturbance, number: int) -> str:
    """One disturbance: over time, and its mean over each regressor by the direction of motion."""
    names = [name for name in DRAWN if name in disturbance.curves]
    rows = -(-len(names) // _COLUMNS)
    height = 30.0 + _OVER_TIME + 68.0 + rows * (_SMALL + _GAP)
    figure = Figure(
        f"disturbance-{number}", WIDTH, height, f"What the {disturbance.what.name} would have to be"
    )
    unit, factor = handy(disturbance.what.unit)
    limits = _limits(disturbance, factor)
    label = f"{disturbance.what.name}{'' if unit == '1' else f' [{unit}]'}"
    panel = figure.panel(LEFT, 30.0, WIDTH - LEFT - RIGHT, _OVER_TIME, padded(disturbance.t, pad=0.0), limits)
    _over_time(panel, disturbance, factor, label)
    for k, name in enumerate(names):
        left = LEFT + (k % _COLUMNS) * _APART
        top = 30.0 + _OVER_TIME + 68.0 + (k // _COLUMNS) * (_SMALL + _GAP)
        _over(figure, disturbance.curves[name], name, left, top, factor)
    for at, text, colour in ((0.0, "forward", AFTER), (62.0, "backward", BEFORE)):
        figure.text(WIDTH - RIGHT + 6.0 + at, 30.0 + _OVER_TIME + 44.0, text, colour, 600)
    return figure.svg()


def _limits(disturbance: SmoothedDisturbance, factor: float) -> tuple[float, float]:
    known = np.isfinite(disturbance.mean)
    low, high = (
        factor * (disturbance.mean - disturbance.band)[known],
        factor * (disturbance.mean + disturbance.band)[known],
    )
    return padded(np.quantile(low, _RANGE[:1]), np.quantile(high, _RANGE[1:]), np.zeros(1), pad=_ROOM)


def _over_time(panel: Panel, disturbance: SmoothedDisturbance, factor: float, label: str) -> None:
    mean, band = factor * disturbance.mean, factor * disturbance.band
    panel.frame("time along the moves [s]", label)
    panel.level(0.0)
    panel.ribbon(disturbance.t, mean - band, mean + band, AFTER)
    panel.line(disturbance.t, mean, INK, 0.9)
    panel.end_labels(((panel.y[1], "smoothed", INK), (0.5 * panel.y[1], "95 % band", AFTER)))


def _over(
    figure: Figure, curve: BinnedDisturbance, name: str, left: float, top: float, factor: float
) -> None:
    label, scale = REGRESSORS[name]
    directed = bool(np.isfinite(curve.backward).any())
    ways = ((curve.forward, AFTER), (curve.backward, BEFORE)) if directed else ((curve.forward, INK),)
    shown = [factor * (y + side * curve.band) for y, _ in ways for side in (-1.0, 1.0)]
    panel = figure.panel(left, top, _WIDE, _SMALL, padded(scale * curve.at), padded(*shown, np.zeros(1)))
    panel.frame(label, f"mean, predicts {100.0 * curve.share:.0f} %")
    panel.level(0.0)
    for y, colour in ways:
        _way(panel, scale * curve.at, factor * y, factor * curve.band, colour)


def _way(panel: Panel, at: Array, y: Array, band: Array, colour: str) -> None:
    panel.ribbon(at, y - band, y + band, colour, 0.18)
    panel.line(at, y, colour, 1.5)
    panel.points(at, y, colour, 2.6)
