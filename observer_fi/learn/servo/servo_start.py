"""Where the fit of a servo begins on a rig of which only a data sheet is known: mechanics first, then its gains, all linear.

Mechanics and winding need no servo (`integral_regression.py`). With them the speed is known, and outside saturation equation 3
is linear in the gains,

    i = c + Kp e + Ki int e dt + a int w dt + b int i dt,    e = w_cmd - w,

with a constant a move, and a and b for what is left of the errors of Km and Rm in the speed. Of a position servo, w_cmd = Kx u
with u = x_cmd / D - angle, and its encoder is the integral of w. So

    angle = c + Kx int u dt + Kp/Ki (Kx u - w) - i / Ki,

in which the angle and the integral have next to no noise: they tell Kx, on which the scale of every speed rests.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.learn.driven.integral_regression import identify_driven
from observer_fi.learn.plausibility import with_possible_signs
from observer_fi.logs import moves_from_rest, with_command
from observer_fi.numerics import constant_runs, filled
from observer_fi.physics import UNLEARNED, Rig, speed, whole_command, with_values
from observer_fi.records import Array, Log

FIRST = ("J", "A", "Kp", "Ki")  # of which one that no log has shown is reason enough
BELOW = 0.97  # of the largest source voltage: above it the supply may limit
BEFORE_S, AFTER_S = 0.02, 0.1  # of a move, in which the servo is looked at
FEWEST = 50  # samples
PROPORTIONAL = (
    0.8  # of the speed, that the error of the position makes: more than 0.99 where nothing is fed forward
)
STEEP = 0.7  # of the steepest change of the command: on a ramp, not at its corner


def needs_start(rig: Rig) -> bool:
    """Whether a servo's rig is known from data sheets only."""
    given = rig.quantities
    return rig.driven.servo and any(n in given and given[n].method in UNLEARNED for n in FIRST)


def with_start(logs: Sequence[Log], rig: Rig) -> Rig:
    """`rig` with the mechanics, the gains and the commanded acceleration that its logs show; values only, its spreads stay.

    Raises InvalidLogError where the motor never turns for long enough.
    """
    fit = with_possible_signs(identify_driven(logs, replace(rig, drive="voltage")), logs)
    found = {
        p.name: p.value for p in fit.parameters if p.name in ("Rm", "Km", "J", "A", "B") and p.value > 0.0
    }
    plant = with_values(rig, found, method="from the logs")
    gains = _gains(logs, plant)
    top = max(
        float(np.nanquantile(np.abs(log.z[:, 0] + plant.model["Rs"] * log.z[:, 1]), 0.999)) for log in logs
    )
    supply = {"Vmax": top} if top > plant.model["Vmax"] else {}
    steep = {} if rig.driven.command else acceleration_of(logs)
    return with_values(plant, {**gains, **supply, **steep}, method="from the logs")


def with_crawl(log: Log, rig: Rig) -> Log:
    """`log` with the command that a servo nobody knows yet followed: whole while its goal moves, 0 where that stands and friction
    may hold the motor against what is left.

    Of a start, what is so slow is a tenth of what the integral has when the motor breaks away.
    """
    goal = log.position_cmd
    if rig.driven.command is None or goal is None or goal.size < 2:
        return log
    moves = np.diff(goal) != 0.0
    either = np.append(moves, False) | np.append(False, moves)
    return replace(log, w_cmd=np.where(either, whole_command(log, rig), log.w_cmd))


def acceleration_of(logs: Sequence[Log]) -> dict[str, float]:
    """Commanded acceleration [rad/s^2] as the ramps of the command show it; nothing where there are none."""
    slopes = np.concatenate([np.abs(np.diff(log.w_cmd) / np.diff(log.t)) for log in logs])
    slopes = slopes[np.isfinite(slopes) & (slopes > 0.0)]
    if not slopes.size:
        return {}
    return {"accel_cmd": float(np.median(slopes[slopes > STEEP * slopes.max()]))}


def _gains(logs: Sequence[Log], rig: Rig) -> dict[str, float]:
    """Kp and Ki, and Kx of a position servo; none of what the logs do not show as a servo can have it.

    Smooth moves tell Kx and no gains; a fit that took Kx for what is guessed of it would have every speed off.
    """
    Kx = _position_gain(logs, rig) if rig.driven.command is not None else None
    known = {} if Kx is None else {"Kx": Kx}
    moves = [part for log in logs for part in _moves(log, rig)]
    if sum(part.i.size for part in moves) < FEWEST:
        return known
    x = _solved([(*_errors(part, Kx), part.i) for part in moves])
    gains = {"Kp": float(x[0]), "Ki": float(x[1])}
    return {**known, **gains} if all(np.isfinite(v) and v > 0.0 for v in gains.values()) else known


def _errors(part: "_Move", Kx: float | None) -> tuple[Array, Array]:
    """The error of the speed and its integral (n, 2), and what is as them but for the noise of the speed.

    A position servo's error is small beside the noise of the voltage; its encoder has another one (instrumental variables).
    Without an encoder two more columns: where Km is off by a thousandth, its share of the angle soon outgrows the integral of
    the error, and where Rm is, the integral of the current does.
    """
    if Kx is None or part.angle is None:
        error = part.command - part.w
        columns = error, motor_angle(part.t, error), motor_angle(part.t, part.w), motor_angle(part.t, part.i)
        G = np.column_stack(columns)
        return G, G
    goal = Kx * part.command
    integral = motor_angle(part.t, goal) - part.angle
    encoder = np.gradient(part.angle, part.t)
    return np.column_stack([goal - part.w, integral]), np.column_stack([goal - encoder, integral])


def _position_gain(logs: Sequence[Log], rig: Rig) -> float | None:
    """Kx of a position servo [1/s]; None where its logs show none."""
    moves, parts = [part for log in logs for part in _moves(log, rig)], []
    for part in moves:
        if part.angle is not None:
            G = np.column_stack([motor_angle(part.t, part.command), part.t, part.command, part.w, part.i])
            parts.append((G, G, part.angle))
    if sum(y.size for *_, y in parts) < FEWEST:
        return None
    Kx = float(_solved(parts)[0])
    return Kx if np.isfinite(Kx) and Kx > 0.0 and _is_proportional(Kx, moves) else None


def _is_proportional(Kx: float, moves: Sequence["_Move"]) -> bool:
    """Whether the errors of the position make the speeds of some moves; what is fed forward leaves next to none of them."""
    made, seen = (
        np.concatenate(columns) for columns in zip(*((Kx * m.command, m.w) for m in moves), strict=True)
    )
    return float(made @ seen) > PROPORTIONAL * float(seen @ seen)


def _solved(parts: Sequence[tuple[Array, Array, Array]]) -> Array:
    """Coefficients of columns G (n, k) that make y (n,), with a constant a part, by the instruments Z (n, k): (G, Z, y) each."""
    G, Z, y = (np.concatenate([part[k] - part[k].mean(axis=0) for part in parts]) for k in range(3))
    size = np.maximum(np.linalg.norm(G, axis=0), 1e-300)
    Z = Z / size
    return np.asarray(np.linalg.lstsq(Z.T @ (G / size), Z.T @ y, rcond=1e-12)[0] / size)


class _Move(NamedTuple):
    """A move outside saturation, (n,) each: times [s], commanded speed [rad/s], or what Kx makes one of [rad], the speed of
    equation 16 [rad/s], current [A], and the encoder's angle [rad] of a position servo.
    """

    t: Array
    command: Array
    w: Array
    i: Array
    angle: Array | None


def _moves(log: Log, rig: Rig) -> list[_Move]:
    """The stretches of moves in which the servo makes its current as it will."""
    p = rig.model
    log = with_command(log, rig)
    w, i = filled(speed(log.z, p.vector)), filled(log.z[:, 1])
    loop = rig.driven.command is not None and log.encoder is not None
    command = whole_command(log, rig) / (p["Kx"] if loop else 1.0)
    angle = filled(log.encoder) if loop and log.encoder is not None else None
    source = np.abs(log.z[:, 0] + p["Rs"] * log.z[:, 1])
    free = np.isfinite(log.z[:, :2]).all(axis=1) & (source < BELOW * max(float(np.nanmax(source)), p["Vmax"]))
    found = []
    for move in moves_from_rest(log):
        first = max(move.start - round(BEFORE_S * log.rate_hz), move.rest)
        last = min(move.stop + round(AFTER_S * log.rate_hz), move.end)
        for a, b in constant_runs(free[first:last].astype(np.int8)):
            rows = slice(first + a, first + b)
            if free[first + a] and b - a >= FEWEST // 2:
                found.append(
                    _Move(
                        log.t[rows], command[rows], w[rows], i[rows], None if angle is None else angle[rows]
                    )
                )
    return found
