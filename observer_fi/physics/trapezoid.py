"""The commanded speed at the quarters of every sampling interval, as an open-loop run needs it: exact in its integral."""

import math

import numpy as np

from observer_fi.numerics import uncounted
from observer_fi.records import Array


def quarters(
    t: Array, knots: Array, values: Array, delay: float = 0.0, accel: float = math.inf, ahead: float = 0.0
) -> Array:
    """Command at the quarters of the interval from every sample on, (n, 4) rad/s, `delay` seconds late.

    accel: what a servo with an acceleration limit of its own can follow [rad/s^2]; ahead: other than 0 where it knows the
    whole move (`planned`). The first and third quarter are
    set so that Simpson's rule over each half of the interval gives the exact integral of the piecewise linear command.
    """
    out = np.empty((t.size, 4))
    if ahead and math.isfinite(accel):
        knots, values = planned(knots, values, accel)
    _quarters(t, knots, values, delay, out)
    if math.isfinite(accel):
        _slew(t, accel, out)
    return out


def planned(knots: Array, values: Array, accel: float) -> tuple[Array, Array]:
    """The command of a servo that plans its moves: it brakes so early that its own ramp [rad/s^2] ends when the given one does.

    knots, values: (m,) s, rad/s of a piecewise linear command; returns the same of another one, below it in size.
    """
    out = np.empty((2, 2 * knots.size))
    count = _planned(knots, values, accel, out)
    return out[0, -count:], out[1, -count:]


@uncounted
def _planned(t, v, accel, out):
    at = out.shape[1] - 1
    out[0, at], out[1, at] = t[-1], v[-1]
    u = abs(v[-1])
    for k in range(t.size - 2, -1, -1):
        dt, later, now = t[k + 1] - t[k], abs(v[k + 1]), abs(v[k])
        slope = (now - later) / dt if dt > 0.0 else 0.0
        if later > u and now < u + accel * dt:
            back = (later - u) / (accel - slope)
            at -= 1
            out[0, at], out[1, at] = t[k + 1] - back, math.copysign(u + accel * back, v[k])
        u = min(now, u + accel * dt)
        at -= 1
        out[0, at], out[1, at] = t[k], math.copysign(u, v[k])
    return out.shape[1] - at


@uncounted
def _quarters(t, knots, values, delay, out):
    n, last = t.size, knots.size - 1
    k, area = 0, 0.0
    before = 0.0
    for j in range(2 * n - 1):
        left = t[j // 2]
        at = left - delay
        if j % 2 == 1:
            at += 0.5 * (t[j // 2 + 1] - left)
        while k < last and knots[k + 1] <= at:
            area += 0.5 * (values[k] + values[k + 1]) * (knots[k + 1] - knots[k])
            k += 1
        value = values[k]
        if at > knots[k] and k < last:
            value += (at - knots[k]) / (knots[k + 1] - knots[k]) * (values[k + 1] - values[k])
        total = area + 0.5 * (values[k] + value) * (at - knots[k])
        out[j // 2, 2 * (j % 2)] = value
        if j > 0:
            h = 0.5 * (t[(j - 1) // 2 + 1] - t[(j - 1) // 2])
            row, column = (j - 1) // 2, 2 * ((j - 1) % 2)
            out[row, column + 1] = 0.25 * (6.0 * (total - before) / h - out[row, column] - value)
        before = total
    out[n - 1, 1:] = out[n - 1, 0]


@uncounted
def _slew(t, accel, out):
    y = out[0, 0]
    for j in range(t.size):
        dt = t[j + 1] - t[j] if j + 1 < t.size else 0.0
        for q in range(4):
            out[j, q], y = y, y
            goal = out[j, q + 1] if q < 3 else (out[j + 1, 0] if j + 1 < t.size else y)
            step = 0.25 * dt * accel
            y += min(max(goal - y, -step), step)
