"""Ripple once a turn of the motor, from logs that are faster than friction asks for: a turn is a few hundredths of a second."""

import math

import numpy as np

from observer_fi.numerics import filled
from observer_fi.physics import Rig
from observer_fi.records import Array, Log
from observer_fi.trend.travel import (
    WAYS,
    Series,
    Set,
    averaged,
    driving_of,
    even_clock,
    regression,
    steady_friction,
)

PER_TURN = 6.0  # samples of a turn from which its ripple is told
TURNS = 3.0  # longer than that is no ripple of a turn: friction, and what a smoothed acceleration leaves
CHOSEN = "chosen"  # method of a travel per turn that nobody gave


def of_turn(log: Log, s: Series, rig: Rig) -> list[Set]:
    """Sine and cosine at the travel's zero by direction, where the log has samples enough and `s` has not.

    Torques [N m] as (names, units, values (k,), covariance (k, k)); nothing where the travel per turn was not given.
    """
    from scipy.ndimage import uniform_filter1d  # imported late: for logs that are new

    turn = 2.0 * math.pi * rig.model["D"]
    per_second = s.typical / turn
    if rig.quantities["D"].method == CHOSEN or 1.0 / s.step >= PER_TURN * per_second > 0.0:
        return []
    factor = int(log.rate_hz / (PER_TURN * per_second))
    if factor < 1:
        return []
    fine = _finer(log, s, rig, max(factor // 2, 1))
    steady = steady_friction(fine)
    if steady is None:
        return []
    names, columns = _columns(fine.x[steady.used], fine.moving[steady.used], turn)
    left = regression(steady.G, steady.torque)[2]
    window = max(round(TURNS / per_second / fine.step), 3)
    fast = np.column_stack([c - uniform_filter1d(c, window) for c in (left, *columns.T)])
    # A corner of the command kicks for a while: how far the residual scatters there is how little it tells.
    loud = np.sqrt(uniform_filter1d(fast[:, 0] ** 2, window))
    fast /= np.maximum(loud, max(1e-3 * float(loud.max()), 1e-300))[:, None]
    theta, covariance, _ = regression(fast[:, 1:], fast[:, 0])
    return [(names, ("N m",) * len(names), theta, covariance)]


def _columns(x: Array, moving: Array, turn: float) -> tuple[tuple[str, ...], Array]:
    """Names and (n, 2 or 4) columns of a ripple, each of one direction."""
    names, columns = [], []
    for w, name in WAYS.items():
        here = moving == w
        if here.any():
            names += [f"ripple_{part}_{name}@{turn:.6g}" for part in ("sin", "cos")]
            columns += [here * f(2.0 * math.pi * x / turn) for f in (np.sin, np.cos)]
    return tuple(names), np.column_stack(columns)


def _finer(log: Log, s: Series, rig: Rig, factor: int) -> Series:
    """The series on a clock of `factor` of the log's samples; how it moves is that of the coarser one."""
    t = even_clock(log)
    driving, constant = driving_of(log, rig)
    assert driving is not None  # the coarser series has it
    i, x = (averaged(np.interp(t, log.t, filled(c)), factor) for c in (driving, log.z[:, 2]))
    t = averaged(t, factor)
    near = np.clip(np.searchsorted(s.t, t - 0.5 * s.step), 0, s.t.size - 1)
    way, moving = s.way[near], s.moving[near]
    signed = i * (np.where(moving < 0.0, -1.0, 1.0) if s.unsigned else 1.0)
    v, a, error, load, pitch = (np.interp(t, s.t, c) for c in (s.v, s.a, s.error, s.load, s.pitch))
    return s._replace(
        t=t, x=x, v=v, a=a, torque=constant * signed, magnitude=constant * np.abs(i), error=error, way=way, moving=moving,
        load=load, pitch=pitch,
    )  # fmt: skip
