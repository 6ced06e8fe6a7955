"""What a loop that follows the measured position makes of a sensor that shows the mass elsewhere (`tracking_loop.py`).

The loop takes what is shown for the angle of the motor. Where a sensor lags, has another gain, or play lies between it and the
motor, that is off by e, and while the motor turns the simulated angle goes along by

    d'' = Kp (c' - d') + Ki (c - d)   [of the current, Km / J],   c = d + low-pass(e - d),

which is linear but for the rest: there friction holds the motor, and d stays. A model with that sensor reads e - d more than the
simulated angle, and its voltage lacks what makes the simulation go along.
"""

import math
from functools import lru_cache

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second

from observer_fi.learn.servo.tracking_doubt import Loop
from observer_fi.physics import Model
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_PASSES = 6  # each leaves a fifth of what the one before left open
_AROUND = 6.0  # radians of the ring on either side of a move, in which what is shown there is taken to stay


def shown_ahead(states: Array, model: Model, y: Array) -> Array:
    """(n,) by which the angle that readings y (n, 3) tell is ahead of that of the states (n, COLUMNS) [rad]."""
    return np.asarray((y[:, 2] - states[:, s.X]) / model["D"], dtype=np.float64)


def as_followed(t: Array, states: Array, model: Model, known: Array, y: Array) -> None:
    """Into the readings y (n, 3) of a move with states (n, COLUMNS): its loop has followed what a sensor shows that is ahead of
    the motor by `known` (n,) [rad], and not by as much as this model's.
    """
    off = shown_ahead(states, model, y) - known
    off -= off[0]
    turning = np.flatnonzero(states[:, s.W])
    if turning.size < 2 or not off.any() or not np.isfinite(off).all():
        return
    dt, m = float(np.median(np.diff(t))), model
    d, pulled = _gone_along(off, dt, slice(int(turning[0]), int(turning[-1]) + 1), model)
    y[:, 0] -= m["Rm"] * m["J"] / m["Km"] * pulled + m["Km"] * np.gradient(d, dt)
    y[:, 2] -= m["D"] * d


def _gone_along(e: Array, dt: float, turning: slice, model: Model) -> tuple[Array, Array]:
    """(n,) angle d [rad] by which a simulation goes along e (n,) while it turns, and what the loop pulls for it [rad/s^2]."""
    per_current = model["Km"] / model["J"]
    Kp, Ki = per_current * model["Kp"], per_current * model["Ki"]
    loop = Loop.of(model)
    low_pass = loop.low_pass(dt)
    settled = scipy.signal.sosfilt_zi(low_pass)
    follows, starts = _laws(Kp, Ki, dt)
    pad = math.ceil(_AROUND / (loop.ring * dt))
    inside = slice(pad, pad + e.size)
    d = c = np.zeros(e.size)
    for _ in range(_PASSES):
        c = d + _smooth(low_pass, settled, np.pad(e - d, pad, mode="edge"))[inside]
        moved = c[turning] - c[turning.start]
        d = np.zeros(e.size)
        d[turning] = scipy.signal.lfilter(*follows, moved)
        d[turning] += c[turning.start] * scipy.signal.lfilter(*starts, np.ones(moved.size))
        d[turning.stop :] = d[turning.stop - 1]
    return d, Kp * np.gradient(c - d, dt) + Ki * (c - d)


def _smooth(sections: Array, settled: Array, x: Array) -> Array:
    """x (n,) through a low-pass forth and back, as if it had been at its first and last value for ever.

    settled (k, 2): state of its sections (k, 6) that has been at 1.
    """
    for _ in range(2):
        x = scipy.signal.sosfilt(sections, x, zi=settled * x[0])[0][::-1]
    return x


@lru_cache(maxsize=64)
def _laws(Kp: float, Ki: float, dt: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Numerators and denominators by which d follows a change of c, and c itself while it stands."""
    tops = [Kp, Ki], [Ki]
    follows, starts = (scipy.signal.bilinear(top, [1.0, Kp, Ki], 1.0 / dt) for top in tops)
    return follows, starts
