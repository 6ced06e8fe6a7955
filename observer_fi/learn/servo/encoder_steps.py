"""What the loop of a position servo sees of its encoder on average, where it turns faster than the log can tell its steps.

A servo ticks several times between two samples, and every tick sees another share of a step. One sample of it stands for all:
as the command of a simulation it is noise that the servo never saw, and a fit likes the gains that answer noise the least.
How far the motor turned from sample to sample voltage and current tell better than a step (equation 16).
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.numerics import constant_runs, filled
from observer_fi.physics import Rig, speed
from observer_fi.records import Array, Log

STEPS_EACH = 2.0  # between samples, from which on a sample is no picture of what the loop saw
MEAN_S = 0.02  # over which steps are averaged: what Rm and Km are off by makes no step in it


def without_steps(log: Log, rig: Rig) -> Log:
    """`log` with an encoder that moves evenly where it takes several steps a sample, never farther than half a step from it."""
    if rig.driven.command is None or log.encoder is None:
        return log
    q = filled(log.encoder)
    changes = np.abs(np.diff(q))
    if not (changes > 0.0).any():
        return log
    step = float(changes[changes > 0.0].min())
    fast = changes >= (STEPS_EACH - 0.5) * step
    w = filled(speed(log.z, rig.model.vector))
    even = q.copy()
    for a, b in constant_runs(fast.astype(np.int8)):
        if fast[a]:
            rows = slice(a, b + 1)
            even[rows] += np.clip(_left(log.t[rows], q[rows], w[rows], log.rate_hz), -0.5 * step, 0.5 * step)
    return replace(log, encoder=even)


def _left(t: Array, q: Array, w: Array, rate_hz: float) -> Array:
    """(n,) what a mean over `MEAN_S` of an angle q less the integral of the speed w differs from it [rad]."""
    apart = q - motor_angle(t, w)
    line = np.polynomial.Polynomial.fit(t, apart, 1)(t) if t.size > 1 else apart
    return line + uniform_filter1d(apart - line, 2 * round(0.5 * MEAN_S * rate_hz) + 1) - apart
