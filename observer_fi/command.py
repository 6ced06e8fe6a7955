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


def at_half_steps(t: Array, knots: Array, values: Array, substeps: int, delay: float = 0.0) -> Array:
    """Command at the 2 m half-steps from every sample on, (n, 2 m) rad/s, `delay` seconds late.

    Middles are set so that Simpson's rule over the step gives the exact integral of the piecewise linear command.
    """
    n = t.size
    dt = np.append(np.diff(t), 0.0)
    grid = (t[:, None] + dt[:, None] * np.arange(2 * substeps) / (2 * substeps)).ravel() - delay
    w = np.interp(grid, knots, values)
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(knots))))
    edges = grid[::2]
    j = np.clip(np.searchsorted(knots, edges, side="right") - 1, 0, knots.size - 1)
    area = integral[j] + 0.5 * (values[j] + w[::2]) * (edges - knots[j])
    h, mean = np.diff(edges), np.diff(area)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = 0.25 * (6.0 * mean / h - w[:-2:2] - w[2::2])
    w[1:-1:2] = np.where(h > 0.0, middle, w[1:-1:2])
    return w.reshape(n, 2 * substeps)


def slewed(t: Array, w_cmd: Array, accel: float) -> Array:
    """The command as a servo follows it that cannot accelerate faster than `accel` [rad/s^2]; same shape."""
    out = np.empty_like(w_cmd)
    out[0] = w_cmd[0]
    for k in range(1, t.size):
        step = accel * (t[k] - t[k - 1])
        out[k] = out[k - 1] + np.clip(w_cmd[k] - out[k - 1], -step, step)
    return out


# TODO restore class CommandStream(model, substep_s).intervals(t, w_cmd) here: it was lost in a simultaneous edit.
