"""Log and command as a bank takes them, interval by interval: the same for a whole log, its chunks and single samples.

Between two samples the command is the trapezoid of `command.py`, whose corners need one interval of the past. A delay
looks further back: the knots of that time are kept, nothing else, so that a stream of days needs no more memory.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import inlined, uncounted
from observer_fi.physics import Model, corner, corners, planned
from observer_fi.records import Array, Log

SETTLING = 8  # first samples that tell the sampling interval
LAST_T, LAST_W, SLOPE, FIRST, COUNT = range(5)  # what a stream remembers besides the knots


@inlined
def _value(knots, k, last, at):
    """Command at a time between knots k and k + 1; constant before the first knot and after the last."""
    if k == last or at <= knots[k, 0]:
        return knots[k, 1]
    share = (at - knots[k, 0]) / (knots[k + 1, 0] - knots[k, 0])
    return knots[k, 1] + share * (knots[k + 1, 1] - knots[k, 1])


@inlined
def _remember(knots, first, count, t, w):
    """Put a knot behind the others; the oldest makes room where there is none. The first knot in use, and how many there are."""
    if count == knots.shape[0]:
        shift = max(first, 1)
        for k in range(shift, count):
            knots[k - shift, 0], knots[k - shift, 1] = knots[k, 0], knots[k, 1]
        first, count = first - min(first, shift), count - shift
    knots[count, 0], knots[count, 1] = t, w
    return first, count + 1


@uncounted
def follow(t, w_cmd, accel, limit, delay, knots, memory, out_w, out):
    """Command at the samples, out_w (n,), and at the half-steps of the interval before each, out (n, 2 m) rad/s.

    t (n,) s; w_cmd (n,) rad/s; accel: commanded acceleration, limit: what the servo can follow [rad/s^2]; delay [s].
    knots (k, 2) times and values, memory (5,): the past, updated in place.
    Middles are set so that Simpson's rule over the step gives the exact integral of the piecewise linear command.
    """
    steps = out.shape[1] // 2
    before, was, slope = memory[LAST_T], memory[LAST_W], memory[SLOPE]
    first, count = int(memory[FIRST]), int(memory[COUNT])
    for row in range(t.size):
        w = w_cmd[row] if w_cmd[row] == w_cmd[row] else 0.0
        dt = t[row] - before
        if dt != dt:  # the first sample
            for q in range(2 * steps):
                out[row, q] = w
            out_w[row] = w
            before, was, slope = t[row], w, 0.0
            first, count = _remember(knots, first, count, t[row], w)
            continue
        w = was + min(max(w - was, -limit * dt), limit * dt)
        at, value = corner(before, was, t[row], w, slope, accel)
        if at == at:
            first, count = _remember(knots, first, count, at, value)
        first, count = _remember(knots, first, count, t[row], w)
        left = before - delay
        last = count - 1
        while first < last and knots[first + 1, 0] <= left:
            first += 1
        k = first
        w_left = _value(knots, k, last, left)
        for m in range(steps):
            right = (before + dt * (m + 1) / steps if m + 1 < steps else t[row]) - delay
            area, at, value = 0.0, left, w_left
            while k < last and knots[k + 1, 0] <= right:
                area += 0.5 * (value + knots[k + 1, 1]) * (knots[k + 1, 0] - at)
                k += 1
                at, value = knots[k, 0], knots[k, 1]
            w_right = _value(knots, k, last, right)
            area += 0.5 * (value + w_right) * (right - at)
            out[row, 2 * m] = w_left
            out[row, 2 * m + 1] = 0.25 * (6.0 * area / (right - left) - w_left - w_right)
            left, w_left = right, w_right
        out_w[row] = w_left
        before, was, slope = t[row], w, (w - was) / dt
    memory[LAST_T], memory[LAST_W], memory[SLOPE] = before, was, slope
    memory[FIRST], memory[COUNT] = first, count


def usual_step(t: Array) -> float:
    """Median sampling interval of the first samples [s]: a stream does not know more when it begins."""
    return float(np.median(np.diff(t[: SETTLING + 1])))


class CommandStream:
    """The command of one log, in order: whole, in chunks, or sample by sample from its SETTLING first samples on."""

    def __init__(self, model: Model, substep_s: float) -> None:
        self.accel = min(
            model["accel_cmd"] or np.inf, model["accel_limit"]
        )  # unknown: linear between samples
        self.limit = model["accel_limit"]
        self.ahead = model["accel_ahead"] != 0.0 and np.isfinite(self.limit)
        self.given = model["accel_cmd"]
        self.delay = model["input_delay"] + model["tick_phase"]
        self.substep_s = substep_s
        self.substeps = 0
        self.knots = np.empty((0, 2))
        self.memory = np.array([np.nan, 0.0, 0.0, 0.0, 0.0])

    def start(self, t: Array) -> None:
        """Choose the steps of an interval and the room for knots from the first samples of a log."""
        step = usual_step(t) if t.size > 1 else self.substep_s
        self.substeps = int(np.clip(np.ceil(step / self.substep_s - 1e-6), 1, 8))
        self.knots = np.empty((64 + 4 * int(np.clip(np.ceil(self.delay / step), 0, 10**6)), 2))

    def intervals(self, t: Array, w_cmd: Array) -> tuple[Array, Array]:
        """Command as the servo sees it: (n,) at the samples, (n, 2 m) at the half-steps of the interval before each."""
        if not self.substeps:
            self.start(t)
        w, out = np.empty(t.size), np.empty((t.size, 2 * self.substeps))
        self.fill(t, w_cmd, w, out)
        return w, out

    def fill(self, t: Array, w_cmd: Array, w: Array, out: Array) -> None:
        """As `intervals`, into arrays that exist. A servo that plans ahead does so within the samples at hand."""
        if self.ahead:
            w_cmd = np.interp(t, *planned(*corners(t, w_cmd, self.given), self.limit))
        follow(t, w_cmd, self.accel, self.limit, self.delay, self.knots, self.memory, w, out)


LARGEST = 1e6  # a reading [V, A, m] or command [rad/s] beyond this is none
LONGEST_S = 2.5e-3  # step that the integrator takes without missing a ring of the servo (22 Hz, 22 ms)
MOST_MISSING = 40_000  # samples put into one gap: the last 100 s of it
MISSING_PER_SAMPLE = (
    4  # what each sample of a log allows its gaps in addition: what a log costs is bounded by its samples
)


@uncounted
def cleaned(t, z, w_cmd, pitch, before, held, out_z, out_w, out_theta):
    """Readings (n, 3), command and pitch (n,) without what can be none, into the out arrays; the longest step of t [s].

    A reading that is none is NaN, a command 0; a pitch keeps the latest there was, `held` before the first. before: t of
    the sample before.
    """
    longest = 0.0
    for k in range(t.size):
        longest, before = max(longest, t[k] - before), t[k]
        for c in range(3):
            out_z[k, c] = z[k, c] if abs(z[k, c]) < LARGEST else np.nan
        w = w_cmd[k] if w_cmd[k] == w_cmd[k] else 0.0
        out_w[k] = min(max(w, -LARGEST), LARGEST)
        held = pitch[k] if abs(pitch[k]) < np.inf else held
        out_theta[k] = min(max(held, -180.0), 180.0)
    return longest


@uncounted
def place(rows, before, longest, out_t, out_z, out_pitch, out_w):
    """Put samples (n, 6), the fields of `live.Row`, into arrays of their own; whether `LogStream` takes them as they are.

    That is: no step beyond `longest` from the sample before (at `before`) on, and nothing that can be no reading.
    """
    for k in range(rows.shape[0]):
        t, pitch, w = rows[k, 0], rows[k, 4], rows[k, 5]
        if not (t - before <= longest and abs(pitch) <= 180.0 and abs(w) <= LARGEST):
            return False
        for c in range(3):
            if abs(rows[k, 1 + c]) >= LARGEST:
                return False
            out_z[k, c] = rows[k, 1 + c]
        out_t[k], out_pitch[k], out_w[k], before = t, pitch, w, t
    return True


class LogStream:
    """A log chunk by chunk, with a missing sample wherever its clock has a gap, and NaN for what can be no reading."""

    def __init__(self) -> None:
        self.t, self.w, self.theta = np.nan, 0.0, 0.0
        self.longest = 0.0
        self.allowance = MOST_MISSING  # samples that the next gap may get

    def take(self, log: Log) -> tuple[Log, NDArray[np.bool_]]:
        """The next chunk with gaps filled, n samples, and (n,) which of them are the log's own."""
        if not self.longest:
            usual = usual_step(log.t) if log.t.size > 1 else 0.0
            self.longest = max(LONGEST_S, 3.0 * usual)
        n, first = log.t.size, self.t if np.isfinite(self.t) else log.t[0]
        z, w, theta = np.empty((n, 3)), np.empty(n), np.empty(n)
        values = (np.ascontiguousarray(a, dtype=np.float64) for a in (log.t, log.z, log.w_cmd, log.pitch))
        gap = cleaned(*values, first, self.theta, z, w, theta)
        own = np.ones(n, dtype=np.bool_)
        filled = replace(log, z=z, w_cmd=w, pitch=theta)
        if gap > self.longest:
            before = np.append(first, log.t[:-1])
            wanted = np.ceil((log.t - before) / self.longest - 1e-6).clip(1, MOST_MISSING).astype(np.int64)
            pieces = self._allowed(wanted)
            filled, own = self._filled(filled, before, pieces)
        else:
            self.allowance = min(self.allowance + MISSING_PER_SAMPLE * n, MOST_MISSING)
        self.t, self.w, self.theta = log.t[-1], w[-1], theta[-1]
        return filled, own

    def _allowed(self, wanted: NDArray[np.int64]) -> NDArray[np.int64]:
        """The samples for each interval, no more than what the gaps before have left: a log of gaps costs as one without."""
        pieces, gaps, done = wanted.copy(), np.flatnonzero(wanted > 1), 0
        for gap in gaps.tolist():
            self.allowance = min(self.allowance + MISSING_PER_SAMPLE * (gap - done), MOST_MISSING)
            pieces[gap] = min(int(wanted[gap]), self.allowance + 1)
            self.allowance, done = self.allowance - int(pieces[gap]) + 1, gap
        self.allowance = min(self.allowance + MISSING_PER_SAMPLE * (wanted.size - done), MOST_MISSING)
        return pieces

    def _filled(self, log: Log, before: Array, pieces: NDArray[np.int64]) -> tuple[Log, NDArray[np.bool_]]:
        rows = np.repeat(np.arange(log.t.size), pieces)  # each sample with the missing ones before it
        to_go = np.repeat(np.cumsum(pieces), pieces) - 1 - np.arange(rows.size)
        own = to_go == 0
        step = np.minimum((log.t - before) / pieces, self.longest)
        t = log.t[rows] - to_go * step[rows]
        known = np.append(self.t if np.isfinite(self.t) else log.t[0] - 1.0, log.t)
        w = np.interp(t, known, np.append(self.w, log.w_cmd))
        theta = np.interp(t, known, np.append(self.theta, log.pitch))
        z = np.where(own[:, None], log.z[rows], np.nan)
        load = None if log.load is None else np.interp(t, log.t, log.load)
        return replace(log, t=t, z=z, w_cmd=w, pitch=theta, load=load), own
