"""What a loop that follows the measured position makes of a sensor that shows the mass elsewhere (`tracking_loop.py`).

The loop takes what is shown for the angle of the motor. Where a sensor lags, has another gain, or play lies between it and the
motor, it is off by e, and the simulated angle by H e with it, H = L / (s^2 + L), L as in `tracking_doubt.py`. A model with that
sensor reads (1 - H) e more than the simulated angle, and its voltage lacks what makes the simulation go along H e.
"""

import math

import numpy as np
import scipy  # whose parts load when they are used: `fft` takes a while

from observer_fi.learn.servo.tracking_doubt import Loop
from observer_fi.physics import Model
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_SETTLED = 12.0  # radians of the ring on either side of a move, after which the loop has forgotten it
_MOST_ROWS = 1 << 17  # on either side of it


def shown_ahead(states: Array, model: Model, y: Array) -> Array:
    """(n,) by which the angle that readings y (n, 3) tell is ahead of that of the states (n, COLUMNS) [rad]."""
    return np.asarray((y[:, 2] - states[:, s.X]) / model["D"], dtype=np.float64)


def as_followed(t: Array, states: Array, model: Model, known: Array, y: Array) -> None:
    """Into the readings y (n, 3) of a move with states (n, COLUMNS): its loop has followed what a sensor shows that is ahead of
    the motor by `known` (n,) [rad], and not by as much as this model's.
    """
    off = shown_ahead(states, model, y) - known
    off -= off[0]
    if not off.any() or not np.isfinite(off).all():
        return
    dt, loop = float(np.median(np.diff(t))), Loop.of(model)
    pad = min(math.ceil(_SETTLED / (loop.ring * dt)), _MOST_ROWS)
    size = scipy.fft.next_fast_len(off.size + 2 * pad, real=True)
    E = np.fft.rfft(np.pad(off, (pad, size - off.size - pad), mode="edge"))
    at = np.asarray(2.0 * math.pi * np.fft.rfftfreq(size, dt), dtype=np.float64)
    L = loop.back(at)
    followed = L / (L - at**2) * E
    of_voltage = 1j * at * (model["Km"] + 1j * at * model["Rm"] * model["J"] / model["Km"])
    for channel, response in ((0, of_voltage), (2, model["D"])):
        y[:, channel] -= np.fft.irfft(response * followed, size)[pad : pad + off.size]
