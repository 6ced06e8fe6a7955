"""The commanded speed between samples: a trapezoid whose corners fall inside sampling intervals.

Holding the command over a sample looks like half a sample of delay, and cutting a corner puts up to half a percent
of a start into the error integral. The corners are found from the known acceleration, causally.
"""

import numpy as np

from observer_fi.records import Array


def corners(t: Array, w_cmd: Array, accel: float) -> tuple[Array, Array]:
    """Knots of the piecewise linear command through the samples (t, w_cmd).

    t: (n,) s, w_cmd: (n,) rad/s, accel: commanded acceleration [rad/s^2]. Returns knot times and values, (m,) with
    m >= n. Between two samples whose difference is less than accel allows, the ramp ends early where the interval
    before it was a ramp, and starts late where it was not.
    """
    dt, dw = np.diff(t), np.diff(w_cmd)
    with np.errstate(divide="ignore", invalid="ignore"):
        ramp_time = np.abs(dw) / accel
        partial = (np.abs(dw) > 1e-9 * accel * dt) & (ramp_time < 0.999 * dt)
        slope = np.concatenate(([0.0], dw[:-1] / dt[:-1]))
    ends_here = np.abs(slope) > 0.5 * accel
    at = np.where(ends_here, t[:-1] + ramp_time, t[1:] - ramp_time)[partial]
    value = np.where(ends_here, w_cmd[1:], w_cmd[:-1])[partial]
    knots = np.concatenate((t, at))
    order = np.argsort(knots, kind="stable")
    return knots[order], np.concatenate((w_cmd, value))[order]
