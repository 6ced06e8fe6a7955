"""The last samples of a stream as its filters took them, and what nominal remembered among them: bounded, whatever the stream."""

import copy
from collections import deque

import numpy as np

from observer_fi.bank import HypothesisState, LogSamples

KEPT = 16384  # samples that are always at hand: ten seconds at 1600 a second
SAFE = 0.9  # share of the time that they span after which the first of them are as good as gone
EVERY = 256  # samples between two memories of nominal


class Recent:
    """The last samples, at least KEPT. substeps: half as many numbers has the command of an interval; most: samples that
    come at once."""

    def __init__(self, substeps: int, most: int) -> None:
        room = 2 * KEPT + most
        one = np.empty(room)
        self.rows = LogSamples(
            one, np.empty((room, 2 * substeps)), one.copy(), one.copy(), np.empty((room, 3)), np.empty(room, dtype=np.bool_)
        )  # fmt: skip
        self.count = 0
        self.seen = 0  # samples of the stream
        self.memories: deque[tuple[float, HypothesisState]] = deque(maxlen=KEPT // EVERY)

    def until_memory(self) -> int:
        """Samples from here to the next one before which nominal's memory is wanted, 0 where that is now."""
        return -self.seen % EVERY

    def remember(self, t: float, memory: HypothesisState) -> None:
        """What nominal remembers before the sample at t [s]."""
        self.memories.append((t, memory))

    def add(self, now: LogSamples) -> None:
        """Take samples behind the others; the oldest make room."""
        n = now.t.size
        if self.count + n > self.rows.t.size:
            for name in LogSamples._fields:
                column = getattr(self.rows, name)
                column[:KEPT] = column[self.count - KEPT : self.count].copy()
            self.count = KEPT
        for name in LogSamples._fields:
            getattr(self.rows, name)[self.count : self.count + n] = getattr(now, name)
        self.count, self.seen = self.count + n, self.seen + n

    def safe_until(self, first_s: float) -> float:
        """Until when on the stream's clock the samples from first_s on are still at hand [s], infinite of an empty stream."""
        if self.count < 2:
            return np.inf
        rows = self.rows.t[: self.count]
        return first_s + SAFE * KEPT * float(rows[-1] - rows[0]) / (self.count - 1)

    def between(self, first_s: float, last_s: float) -> tuple[LogSamples, HypothesisState] | None:
        """The samples from a memory of nominal, at or before first_s, to last_s, and that memory; None where they are gone."""
        known = [(t, memory) for t, memory in self.memories if t <= first_s]
        if not known or not self.count or known[-1][0] < self.rows.t[0]:
            return None
        t, memory = known[-1]
        first, last = np.searchsorted(self.rows.t[: self.count], (t, last_s))
        return copy.deepcopy(self.rows.cut(int(first), min(int(last) + 1, self.count))), memory
