"""The commanded speed between samples: a trapezoid whose corners fall inside sampling intervals.

Holding the command over a sample looks like half a sample of delay, and cutting a corner puts up to half a percent
of a start into the error integral. The corners are found from the known acceleration, causally.
"""

import math

import numpy as np

from observer_fi.numerics import inlined, uncounted
from observer_fi.records import Array

ALIKE = 4.0  # times as steep, and a curve goes on: a curve that begins with a square has 1, 3, 5 times its first step


@inlined
def corner(before, was, t, w, slope, accel):
    """Time and value of the corner between samples (before, was) and (t, w) of the command; a time of NaN where there is none.

    slope: of the interval before [rad/s^2]. Where the difference is less than accel allows, the ramp ends early where the
    interval before was a ramp, and starts late where it was not. Where the command went on much as before, it is a softer curve
    without corners: steps at the end of every interval would leave it half an interval late.
    """
    ramp, least = abs(w - was) / accel, 1e-9 * accel * (t - before)
    if not (abs(w - was) > least and ramp < 0.999 * (t - before)):
        return math.nan, w
    if abs(slope) > 0.5 * accel:
        return before + ramp, w
    change, usual = w - was, slope * (t - before)
    if change * usual > 0.0 and abs(usual) < ALIKE * abs(change) < ALIKE * ALIKE * abs(usual):
        return math.nan, w
    return t - ramp, was


def corners(t: Array, w_cmd: Array, accel: float) -> tuple[Array, Array]:
    """Knots of the piecewise linear command through the samples (t, w_cmd).

    t: (n,) s, w_cmd: (n,) rad/s, accel: commanded acceleration [rad/s^2], 0 where it is not known or the command no trapezoid.
    Returns knot times and values, (m,) with m >= n.
    """
    knots = np.empty((2, 2 * t.size))
    count = _corners(t, w_cmd, accel or math.inf, knots)
    return knots[0, :count].copy(), knots[1, :count].copy()


@uncounted
def _corners(t, w_cmd, accel, knots):
    count, slope = 0, 0.0
    for j in range(t.size):
        if j:
            at, value = corner(t[j - 1], w_cmd[j - 1], t[j], w_cmd[j], slope, accel)
            slope = (w_cmd[j] - w_cmd[j - 1]) / (t[j] - t[j - 1])
            if at == at:
                knots[0, count], knots[1, count] = at, value
                count += 1
        knots[0, count], knots[1, count] = t[j], w_cmd[j]
        count += 1
    return count
