"""A log as a filter takes it: a missing sample wherever the clock has a gap, NaN for what can be no reading."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.feed import SETTLING
from observer_fi.records import Array, Log

LARGEST = 1e6  # a reading [V, A, m] or command [rad/s] beyond this is none
LONGEST_S = 2.5e-3  # step that the integrator takes without missing a ring of the servo (22 Hz, 22 ms)
SLOWEST_S = 0.01  # a log with longer intervals has them filled, all of them
MOST_MISSING = 40_000  # samples put into one gap: the last 100 s of it


class LogStream:
    """A log in order, whole, in chunks, or sample by sample from its SETTLING first samples on."""

    def __init__(self) -> None:
        self.t, self.w, self.theta = np.nan, 0.0, 0.0
        self.longest = 0.0

    def start(self, t: Array) -> None:
        """Choose what counts as a gap from the first samples of a log."""
        usual = float(np.median(np.diff(t[: SETTLING + 1]))) if t.size > 1 else 0.0
        self.longest = max(LONGEST_S, 3.0 * usual) if usual <= SLOWEST_S else LONGEST_S

    def take(self, log: Log) -> tuple[Log, NDArray[np.bool_]]:
        """The next chunk with its gaps filled, n samples, and (n,) which of them are the log's own.

        Over a gap command and pitch are interpolated; one step over it would be far beyond what the integrator bears.
        """
        if not self.longest:
            self.start(log.t)
        z = np.where(np.abs(log.z) < LARGEST, log.z, np.nan)
        w = np.clip(np.nan_to_num(log.w_cmd), -LARGEST, LARGEST)
        theta = np.clip(_held(log.pitch, self.theta), -180.0, 180.0)
        before = np.append(self.t if np.isfinite(self.t) else log.t[0], log.t[:-1])
        pieces = np.ceil((log.t - before) / self.longest - 1e-6).clip(1, MOST_MISSING).astype(np.int64)
        own = np.ones(log.t.size, dtype=np.bool_)
        filled = replace(log, z=z, w_cmd=w, pitch=theta)
        if pieces.max() > 1:
            filled, own = self._filled(filled, before, pieces)
        self.t, self.w, self.theta = log.t[-1], w[-1], theta[-1]
        return filled, own

    def _filled(self, log: Log, before: Array, pieces: NDArray[np.int64]) -> tuple[Log, NDArray[np.bool_]]:
        rows = np.repeat(np.arange(log.t.size), pieces)  # each sample behind the missing ones before it
        to_go = np.repeat(np.cumsum(pieces), pieces) - 1 - np.arange(rows.size)
        own = to_go == 0
        step = np.minimum((log.t - before) / pieces, self.longest)
        t = log.t[rows] - to_go * step[rows]
        known = np.append(self.t if np.isfinite(self.t) else log.t[0] - 1.0, log.t)
        w = np.interp(t, known, np.append(self.w, log.w_cmd))
        theta = np.interp(t, known, np.append(self.theta, log.pitch))
        z = np.where(own[:, None], log.z[rows], np.nan)
        return replace(log, t=t, z=z, w_cmd=w, pitch=theta), own


def _held(values: Array, last: float) -> Array:
    """`values` with the latest finite one, or `last`, in place of what is not finite."""
    good = np.isfinite(values)
    at = np.maximum.accumulate(np.where(good, np.arange(values.size), -1))
    return np.where(at >= 0, values[np.maximum(at, 0)], last)
