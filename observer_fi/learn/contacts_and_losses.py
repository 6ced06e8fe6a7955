"""Where the mass stops following the motor: contact points and coupling losses, found before any fit.

By travel: the motor angle is the integral of equation 16, and over a move x is a straight line in it, with one bend where
the rate changes: to D (1 - E) in contact (equation 10), to 0 after a coupling loss (equation 12). By torque: in steady
motion against a stop the current grows with the square of the depth (equation 11).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.learn.move_data import Experiment
from observer_fi.logs import moves_from_rest
from observer_fi.numerics import filled
from observer_fi.physics import Model, Rig, override, speed
from observer_fi.records import Array, Log, Segment

BLOCK_S = 0.01  # averages of so long are compared
FOLLOWS, FROZEN = 0.85, 0.2  # of D w: above, the mass follows; below, it stands
GAIN = 40.0  # nats that a bend must win over a straight line
TRAVEL_SIGMAS = 6.0  # of one position sample that the motor must turn on after a bend
RELEASE = (
    1.5e-4  # m of D phi before a mass that leaves a stop is free: play and sensor lag bend the first 0.1 mm
)
_SETTLED_S = 0.3  # after a start, until the current is that of steady motion
_BLOCK = 40  # samples of steady motion that are averaged
_FEWEST = 20  # averages that can tell a stop
_PLACES = 60  # contact points tried
_LESS = 0.5  # share of the steady torque's variance that a stop must explain


class Bend(NamedTuple):
    """One move's bend: row of the log, position there [m], dx over D dphi before and after, direction of motion.

    travel: D phi from the start to the bend [m].
    """

    row: int
    x: float
    before: float
    after: float
    sign: float
    travel: float


class Breaks(NamedTuple):
    """What a log shows: positions of its stops [m] or None, and the row of a coupling loss or None."""

    stop_high: float | None
    stop_low: float | None
    loss: int | None


def speed_of(log: Log, model: Model) -> Array:
    """(n,) measured speed of equation 16 [rad/s], missing samples interpolated; nan where nothing was measured."""
    return filled(speed(log.z, model.vector), log.t)


def motor_angle(t: Array, w: Array) -> Array:
    """(n,) integral of the speed from the first sample on [rad], by trapezoids."""
    return np.concatenate(([0.0], np.cumsum(np.diff(t) * (w[1:] + w[:-1]) / 2.0)))


def find_breaks(log: Log, moves: Sequence[Segment], model: Model, position_std: float) -> Breaks:
    """Stops and the coupling loss of a log; moves as cut from its command."""
    w = speed_of(log, model)
    bends = [b for b in (_bend(log, w, move, model, position_std) for move in moves) if b is not None]
    last = max(
        (k for k, b in enumerate(bends) if b.after > FROZEN), default=-1
    )  # what follows stands for good
    loss = bends[last + 1].row if last + 1 < len(bends) else None
    pressed = [b for b in bends if loss is None or b.row < loss]
    sides = {side: [b.x for b in pressed if _side(b) == side] for side in (1.0, -1.0)}
    high, low = (float(np.median(sides[s])) if sides[s] else None for s in (1.0, -1.0))
    if high is not None and low is not None and low >= high:  # play, which bends every start
        return Breaks(None, None, loss)
    return Breaks(high, low, loss)


def _side(bend: Bend) -> float:
    """The stop that a bend shows: 1 high, -1 low, 0 none. Motion into it slows the mass, motion out of it frees it."""
    if bend.before > FOLLOWS and FROZEN < bend.after < FOLLOWS:
        return bend.sign
    if bend.after > FOLLOWS and FROZEN < bend.before < FOLLOWS and bend.travel > RELEASE:
        return -bend.sign
    return 0.0


def _bend(log: Log, speed: Array, move: Segment, model: Model, std: float) -> Bend | None:
    """The best bend of one move, or its single slope (before = after) where it has none; None if it hardly moves.

    speed: (n,) of the whole log.
    """
    rows = slice(move.start, move.stop)
    t, x = log.t[rows], log.z[rows, 2]
    good = ~np.isnan(x)
    if good.sum() < 20:
        return None
    w = speed[rows]
    angle = (
        motor_angle(t, log.w_cmd[rows] if np.isnan(w).any() else w) * model["D"]
    )  # the loop follows its command
    block = max(1, round(BLOCK_S * log.rate_hz))
    count = int(good.sum()) // block
    u = angle[good][: count * block].reshape(count, block).mean(axis=1)
    y = x[good][: count * block].reshape(count, block).mean(axis=1)
    if count < 8 or np.ptp(u) < 2.0 * TRAVEL_SIGMAS * std:
        return None
    sign = float(np.sign(move.peak))
    straight, slope = _line(u, y)
    cost, k, before, after = _hinge(u, y, TRAVEL_SIGMAS * std)
    if not 0.5 * (straight - cost) * block / std**2 > GAIN or abs(after - before) < 1.0 - FOLLOWS:
        return Bend(move.start, float(x[good][0]), slope, slope, sign, 0.0)
    row = move.start + int(np.flatnonzero(good)[min(k * block, int(good.sum()) - 1)])
    return Bend(row, float(y[k]), before, after, sign, float(abs(u[k])))


def _line(u: Array, y: Array) -> tuple[float, float]:
    """Sum of squares about a straight line, and its slope."""
    G = np.column_stack([np.ones(u.size), u])
    fit = np.linalg.lstsq(G, y, rcond=None)[0]
    return float(np.sum((y - G @ fit) ** 2)), float(fit[1])


def _hinge(u: Array, y: Array, margin: float) -> tuple[float, int, float, float]:
    """Least sum of squares of a line with one bend, its block, and the slopes before and after."""
    best = (np.inf, 0, 1.0, 1.0)
    for k in range(1, u.size - 1):
        if min(abs(u[k] - u[0]), abs(u[-1] - u[k])) < margin:
            continue
        past = u - u[k]
        G = np.column_stack([np.ones(u.size), u, np.where(past * np.sign(u[-1] - u[0]) > 0.0, past, 0.0)])
        fit = np.linalg.lstsq(G, y, rcond=None)[0]
        cost = float(np.sum((y - G @ fit) ** 2))
        if cost < best[0]:
            best = (cost, k, float(fit[1]), float(fit[1] + fit[2]))
    return best


# --- stops of a whole campaign ---------------------------------------------------------------------


def find_stops(experiment: Experiment, rig: Rig) -> Model:
    """The rig's model, with a stop at either end where the steady current says that there is one."""
    model = rig.model
    torque, direction, theta, x = _steady(experiment, model)
    if torque.size < _FEWEST:
        return model
    usual = np.column_stack([direction, theta])
    span = float(x.max() - x.min())
    places = np.linspace(x.min() + 0.05 * span, x.max() - 0.05 * span, _PLACES)
    free = _misfit(torque, usual, [])
    best: tuple[float, dict[str, float]] = (free, {})
    for place in places:
        best = min(best, _with(torque, usual, x, {"x_stop_high": place}), key=lambda b: b[0])
        best = min(best, _with(torque, usual, x, {"x_stop_low": place}), key=lambda b: b[0])
    if best[0] > (1.0 - _LESS) * free:
        return model
    for name in ("x_stop_high", "x_stop_low"):
        if name in best[1]:
            continue
        both = min(
            (_with(torque, usual, x, best[1] | {name: place}) for place in places),
            key=lambda b: b[0],
        )
        if both[0] < (1.0 - _LESS) * best[0]:
            best = both
    # The offset of a current sensor would be a stop beyond the travel, whose depth hardly changes.
    offset = np.column_stack([usual, np.ones(torque.size)])
    if _with(torque, offset, x, best[1])[0] > (1.0 - _LESS) * _misfit(torque, offset, []):
        return model
    return override(model, model.name, **{n: float(v) for n, v in best[1].items()})


def stops_of_travel(experiment: Experiment, logs: Sequence[Log], model: Model) -> dict[str, float]:
    """Stops that the model lacks, by where x begins to follow the motor at another rate (`find_breaks`)."""
    breaks = [find_breaks(log, moves_from_rest(log), model, float(experiment.noise[2])) for log in logs]
    found = {}
    for name, places in (
        ("x_stop_high", [b.stop_high for b in breaks]),
        ("x_stop_low", [b.stop_low for b in breaks]),
    ):
        there = [place for place in places if place is not None]
        if there and not math.isfinite(model[name]):
            found[name] = float(np.median(there))
    return found


def _steady(experiment: Experiment, model: Model) -> tuple[Array, Array, Array, Array]:
    """Means over blocks of steady motion: Km i [N m], direction, pitch [deg], position [m]."""
    parts: list[tuple[float, float, float, float]] = []
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        t = experiment.t[rows]
        steady = (experiment.w_cmd(m) == experiment.peak[m]) & (t - t[experiment.moving[m]] > _SETTLED_S)
        k = np.flatnonzero(steady & (experiment.weight[rows, 1:] > 0.0).all(axis=1))
        for block in np.array_split(k, max(k.size // _BLOCK, 1)):
            if block.size >= _BLOCK // 2:
                z = experiment.z[rows][block]
                theta = float(experiment.theta[rows][block].mean())
                sign = float(np.sign(experiment.peak[m]))
                parts.append((model["Km"] * float(z[:, 1].mean()), sign, theta, float(z[:, 2].mean())))
    table = np.array(parts).reshape(-1, 4)
    return table[:, 0], table[:, 1], table[:, 2], table[:, 3]


def _with(torque: Array, usual: Array, x: Array, stops: dict[str, float]) -> tuple[float, dict[str, float]]:
    depths = []
    if "x_stop_high" in stops:
        depths.append(np.maximum(x - stops["x_stop_high"], 0.0) ** 2)
    if "x_stop_low" in stops:
        depths.append(-(np.maximum(stops["x_stop_low"] - x, 0.0) ** 2))
    return _misfit(torque, usual, [np.sum(depths, axis=0)]), stops


def _misfit(torque: Array, usual: Array, terms: list[Array]) -> float:
    """Residual sum of squares of the torque as the usual columns (n, k) and C depth^2, infinite for a stop that pulls."""
    columns = np.column_stack([usual, *terms])
    solution = np.linalg.lstsq(columns, torque, rcond=None)[0]
    if terms and solution[usual.shape[1]] <= 0.0:
        return float("inf")
    return float(np.sum((torque - columns @ solution) ** 2))
