"""Whether a campaign leans on the stops: contact points from the steady torque or the travel, before any fit."""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.learn.kinematic_breaks import find_breaks
from observer_fi.learn.move_data import Experiment, cut_moves
from observer_fi.physics import Model, Rig, override
from observer_fi.records import Array, Log

_SETTLED_S = 0.3
_BLOCK = 40
_PLACES = 60
_LESS = 0.5  # share of the steady torque's variance that a stop must explain


def find_stops(experiment: Experiment, rig: Rig) -> Model:
    """The rig's model, with a stop at either end where the steady current says that there is one."""
    model = rig.model
    torque, direction, theta, x = _steady(experiment, model)
    if torque.size < 20:
        return model
    span = float(x.max() - x.min())
    places = np.linspace(x.min() + 0.05 * span, x.max() - 0.05 * span, _PLACES)
    free = _misfit(torque, direction, theta, [])
    best: tuple[float, dict[str, float]] = (free, {})
    for place in places:
        best = min(best, _with(torque, direction, theta, x, {"x_stop_high": place}), key=lambda b: b[0])
        best = min(best, _with(torque, direction, theta, x, {"x_stop_low": place}), key=lambda b: b[0])
    if best[0] > (1.0 - _LESS) * free:
        return model
    for name in ("x_stop_high", "x_stop_low"):
        if name in best[1]:
            continue
        both = min(
            (_with(torque, direction, theta, x, best[1] | {name: place}) for place in places),
            key=lambda b: b[0],
        )
        if both[0] < (1.0 - _LESS) * best[0]:
            best = both
    return override(model, model.name, **{n: float(v) for n, v in best[1].items()})


def stops_of_travel(experiment: Experiment, logs: Sequence[Log], model: Model) -> dict[str, float]:
    """Stops that the model lacks, by where x begins to follow the motor at another rate (`kinematic_breaks.py`)."""
    breaks = [find_breaks(log, cut_moves(log), model, float(experiment.noise[2])) for log in logs]
    found = {}
    for name, places in (
        ("x_stop_high", [b.stop_high for b in breaks]),
        ("x_stop_low", [b.stop_low for b in breaks]),
    ):
        told = [place for place in places if place is not None]
        if told and not math.isfinite(model[name]):
            found[name] = float(np.median(told))
    return found


def _steady(experiment: Experiment, model: Model) -> tuple[Array, Array, Array, Array]:
    """Means over blocks of steady motion: Km i [N m], direction, pitch [deg], position [m]."""
    parts: list[tuple[float, float, float, float]] = []
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        t = experiment.t[rows]
        knots, values = experiment.knots[experiment.log[m]]
        w_cmd = np.interp(t, knots, values)
        steady = (w_cmd == experiment.peak[m]) & (t - t[experiment.moving[m]] > _SETTLED_S)
        k = np.flatnonzero(steady & (experiment.weight[rows] > 0.0).all(axis=1))
        for block in np.array_split(k, max(k.size // _BLOCK, 1)):
            if block.size >= _BLOCK // 2:
                z = experiment.z[rows][block]
                theta = float(experiment.theta[rows][block].mean())
                sign = float(np.sign(experiment.peak[m]))
                parts.append((model["Km"] * float(z[:, 1].mean()), sign, theta, float(z[:, 2].mean())))
    table = np.array(parts).reshape(-1, 4)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]


def _with(
    torque: Array, direction: Array, theta: Array, x: Array, stops: dict[str, float]
) -> tuple[float, dict[str, float]]:
    depths = []
    if "x_stop_high" in stops:
        depths.append(np.maximum(x - stops["x_stop_high"], 0.0) ** 2)
    if "x_stop_low" in stops:
        depths.append(-(np.maximum(stops["x_stop_low"] - x, 0.0) ** 2))
    return _misfit(torque, direction, theta, [np.sum(depths, axis=0)]), stops


def _misfit(torque: Array, direction: Array, theta: Array, terms: list[Array]) -> float:
    """Residual sum of squares of torque = A s + B theta + C depth^2, infinite for a stop that pulls."""
    columns = np.column_stack([direction, theta, *terms])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    if terms and solution[2] <= 0.0:
        return float("inf")
    return float(np.sum((torque - columns @ solution) ** 2))
