"""Where the mass stops following the motor: a rough detection of contacts and coupling losses, by x against D phi.

The motor angle is the integral of equation 16. Over a move x is a straight line in it, with one bend where the rate
changes: to D (1 - E) in contact (equation 10), to 0 after a coupling loss (equation 12).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.physics import Model, speed
from observer_fi.records import Array, Log, Segment

BLOCK_S = 0.01  # averages of so long are compared
FOLLOWS, FROZEN = 0.85, 0.2  # of D w: above, the mass follows; below, it stands
GAIN = 40.0  # nats that a bend must win over a straight line
TRAVEL_SIGMAS = 6.0  # of one position sample that the motor must turn on after a bend


RELEASE = (
    1.5e-4  # m of D phi before a mass that leaves a stop is free: play and sensor lag bend the first 0.1 mm
)


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
    w = speed(log.z, model.vector)
    bad = np.isnan(w)
    if bad.any() and not bad.all():
        w = np.interp(log.t, log.t[~bad], w[~bad])
    return w


def motor_angle(t: Array, w: Array) -> Array:
    """(n,) integral of the speed from the first sample on [rad], by trapezoids."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))))


def find_breaks(log: Log, moves: Sequence[Segment], model: Model, position_std: float) -> Breaks:
    """Stops and the coupling loss of a log; moves as cut from its command."""
    bends = [b for b in (_bend(log, move, model, position_std) for move in moves) if b is not None]
    last = max(
        (k for k, b in enumerate(bends) if b.after > FROZEN), default=-1
    )  # what follows stands for good
    loss = bends[last + 1].row if last + 1 < len(bends) else None
    pressed = [b for b in bends if loss is None or b.row < loss]
    sides = {side: [b.x for b in pressed if _side(b) == side] for side in (1.0, -1.0)}
    high, low = (float(np.median(sides[s])) if sides[s] else None for s in (1.0, -1.0))
    return Breaks(high, low, loss)


def _side(bend: Bend) -> float:
    """The stop that a bend shows: 1 high, -1 low, 0 none. Motion into it slows the mass, motion out of it frees it."""
    if bend.before > FOLLOWS and FROZEN < bend.after < FOLLOWS:
        return bend.sign
    if bend.after > FOLLOWS and FROZEN < bend.before < FOLLOWS and bend.travel > RELEASE:
        return -bend.sign
    return 0.0


def _bend(log: Log, move: Segment, model: Model, std: float) -> Bend | None:
    """The best bend of one move, or its single slope (before = after) where it has none; None if it hardly moves."""
    rows = slice(move.start, move.stop)
    t, x = log.t[rows], log.z[rows, 2]
    good = ~np.isnan(x)
    if good.sum() < 20:
        return None
    w = speed_of(log, model)[rows]
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
