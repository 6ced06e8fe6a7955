"""The command as a bank takes it: interval by interval, from a log that comes whole, in chunks or sample by sample."""

import numpy as np

from observer_fi.command import corners
from observer_fi.models import Model
from observer_fi.records import Array

HISTORY = 0.05  # s of past that corners need, beyond the delay itself


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


class CommandStream:
    """The command between samples for a log that comes in chunks: remembers enough of the past for corners and delay."""

    def __init__(self, model: Model, substep_s: float) -> None:
        self.accel = model["accel_cmd"]
        self.limit = model["accel_limit"]
        self.delay = model["input_delay"]
        self.substep_s = substep_s
        self.t = np.empty(0)
        self.w = np.empty(0)
        self.followed = np.nan
        self.substeps = 0

    def intervals(self, t: Array, w_cmd: Array) -> tuple[Array, Array]:
        """Command as the servo sees it: (n,) at the samples, (n, 2 m) at the half-steps of the interval before each."""
        if not self.substeps:
            step = np.median(np.diff(t)) if t.size > 1 else self.substep_s
            self.substeps = int(np.clip(np.ceil(step / self.substep_s - 1e-6), 1, 8))
        followed = np.nan_to_num(w_cmd)
        if np.isfinite(self.limit):
            followed = self._slewed(t, followed)
        past = self.t.size
        all_t, all_w = np.concatenate((self.t, t)), np.concatenate((self.w, followed))
        knots, values = corners(all_t, all_w, min(self.accel, self.limit))
        rows = at_half_steps(all_t, knots, values, self.substeps, self.delay)
        before = np.vstack((rows[:1], rows[:-1]))
        keep = all_t >= all_t[-1] - self.delay - HISTORY
        keep[-4:] = True
        self.t, self.w = all_t[keep], all_w[keep]
        return rows[past:, 0].copy(), before[past:].copy()

    def _slewed(self, t: Array, w_cmd: Array) -> Array:
        """The command as a servo follows it that cannot accelerate faster than its limit."""
        out = np.empty_like(w_cmd)
        last_t, last = (self.t[-1], self.followed) if self.t.size else (t[0], w_cmd[0])
        for k in range(t.size):
            step = self.limit * (t[k] - last_t)
            last, last_t = last + np.clip(w_cmd[k] - last, -step, step), t[k]
            out[k] = last
        self.followed = last
        return out
