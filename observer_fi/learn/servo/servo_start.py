"""Where the fit of a servo begins on a rig of which only a data sheet is known: mechanics first, then its gains, all linear.

Mechanics and winding need no servo (`integral_regression.py`). With them the speed is known, and outside saturation equation 3
is linear in the gains,

    i = c + Kp e + Ki int e dt,    e = w_cmd - w,

with a constant a move; of a position servo, w_cmd = Kx u with u = x_cmd / D - angle, in Kp, Ki, Kp Kx and Ki Kx, and its
encoder is the integral of w.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.learn.integral_regression import identify_driven
from observer_fi.logs import moves_from_rest, with_command
from observer_fi.numerics import filled
from observer_fi.physics import UNLEARNED, Rig, speed, with_values
from observer_fi.records import Array, Log

FIRST = ("J", "A", "Kp", "Ki")  # of which one that no log has shown is reason enough
BELOW = 0.97  # of the largest source voltage: above it the supply may limit
BEFORE_S, AFTER_S = 0.02, 0.1  # of a move, in which the servo is looked at
FEWEST = 50  # samples
STEEP = 0.7  # of the steepest change of the command: on a ramp, not at its corner


def needs_start(rig: Rig) -> bool:
    """Whether a servo's rig is known from data sheets only."""
    given = rig.quantities
    return rig.driven.servo and any(n in given and given[n].method in UNLEARNED for n in FIRST)


def with_start(logs: Sequence[Log], rig: Rig) -> Rig:
    """`rig` with the mechanics, the gains and the commanded acceleration that its logs show; values only, its spreads stay.

    Raises InvalidLogError where the motor never turns for long enough.
    """
    fit = identify_driven(logs, replace(rig, drive="voltage"))
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


def acceleration_of(logs: Sequence[Log]) -> dict[str, float]:
    """Commanded acceleration [rad/s^2] as the ramps of the command show it; nothing where there are none."""
    slopes = np.concatenate([np.abs(np.diff(log.w_cmd) / np.diff(log.t)) for log in logs])
    slopes = slopes[np.isfinite(slopes) & (slopes > 0.0)]
    if not slopes.size:
        return {}
    return {"accel_cmd": float(np.median(slopes[slopes > STEEP * slopes.max()]))}


def _gains(logs: Sequence[Log], rig: Rig) -> dict[str, float]:
    """Kp and Ki, and Kx of a position servo; nothing where the logs do not show gains that a servo can have."""
    parts = [part for log in logs for part in _moves(log, rig)]
    if sum(y.size for _, y in parts) < FEWEST:
        return {}
    G, y = np.concatenate([g for g, _ in parts]), np.concatenate([y for _, y in parts])
    scale = np.maximum(np.linalg.norm(G, axis=0), 1e-300)
    x = np.linalg.lstsq(G / scale, y, rcond=1e-10)[0] / scale
    found: Mapping[str, float] = {"Kp": float(x[0]), "Ki": float(x[1])}
    if rig.driven.command is not None:  # both columns tell Kx; the integral's is the quieter one
        found = {**found, "Kx": float(x[3] / x[1]) if x[1] else 0.0}
    return dict(found) if all(np.isfinite(v) and v > 0.0 for v in found.values()) else {}


def _moves(log: Log, rig: Rig) -> list[tuple[Array, Array]]:
    """Of each move what the gains multiply (n, 2 or 4) and the current (n,), less what is constant in it."""
    p = rig.model
    log = with_command(log, rig)
    w, i = filled(speed(log.z, p.vector)), filled(log.z[:, 1])
    command = log.w_cmd if rig.driven.command is None else log.w_cmd / p["Kx"]
    source = np.abs(log.z[:, 0] + p["Rs"] * log.z[:, 1])
    free = np.isfinite(log.z[:, :2]).all(axis=1) & (source < BELOW * max(float(np.nanmax(source)), p["Vmax"]))
    found = []
    for move in moves_from_rest(log):
        first = max(move.start - round(BEFORE_S * log.rate_hz), move.rest)
        rows = slice(first, min(move.stop + round(AFTER_S * log.rate_hz), move.end))
        t, kept = log.t[rows], free[rows]
        if int(kept.sum()) < FEWEST // 2:
            continue
        error = command[rows] - w[rows]
        columns = [error, motor_angle(t, error)]
        if log.encoder is not None and rig.driven.command is not None:
            columns = [-w[rows], -filled(log.encoder)[rows], command[rows], motor_angle(t, command[rows])]
        G = np.column_stack(columns)[kept]
        found.append((G - G.mean(axis=0), i[rows][kept] - i[rows][kept].mean()))
    return found
