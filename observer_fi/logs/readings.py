"""What filters may take of a logger's readings: each held reading once, coarse ones that stand still ever more rarely.

Filters take the noise of their readings for white. A held reading is fresh at its ticks only; one that stands within a step
much larger than its noise says nothing new, but for that it has not moved, and so counts at samples 1, 2, 4, 8, ... of its
run. Where a sensor ought to have ticked and did not, the repeat counts: it may be frozen.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.records import Acquisition, Array, ChannelTraits, Log

FEWEST = 100  # time stamps that tell an even clock
STANDING = 2.0  # steps of so many standard deviations and more: readings stand still where the signal does


class Readings:
    """The readings of one log, chunk by chunk."""

    def __init__(self, acquisition: Acquisition, rate_hz: float, noise_std: Array) -> None:
        channels = (acquisition.voltage, acquisition.current, acquisition.position)
        self.every = [_ticks(c, rate_hz) for c in channels]
        self.stands = [
            c.resolution is not None and c.resolution > STANDING * max(c.noise_std, usual)
            for c, usual in zip(channels, noise_std.tolist(), strict=True)
        ]
        self.last = np.full(3, np.nan)
        self.age = [0, 0, 0]

    @property
    def plain(self) -> bool:
        """Whether every reading counts as it is."""
        return not any(self.stands) and all(every == 1 for every in self.every)

    def take(self, log: Log) -> Log:
        """The next chunk with NaN for readings that say nothing new."""
        if self.plain:
            return log
        z = log.z.copy()
        for c in range(3):
            if self.stands[c] or self.every[c] > 1:
                z[~self._fresh(c, log.z[:, c]), c] = np.nan
        return replace(log, z=z)

    def _fresh(self, c: int, z: Array) -> NDArray[np.bool_]:
        there = np.isfinite(z)
        values = z[there]
        changed = values != np.append(self.last[c], values[:-1])
        row = np.arange(values.size)
        since = np.maximum.accumulate(np.where(changed, row, -self.age[c]))
        age = row - since  # samples since the reading changed
        tick, within = np.divmod(age, self.every[c])
        fresh = within == 0
        if self.stands[c]:
            fresh &= (tick & (tick - 1)) == 0
        if values.size:
            self.last[c], self.age[c] = values[-1], int(age[-1]) + 1
        out = there.copy()
        out[there] = fresh
        return out


def _ticks(c: ChannelTraits, rate_hz: float) -> int:
    """Samples between two updates of a reading, 1 where it is not held."""
    return 1 if c.update_hz is None else max(math.ceil(rate_hz / c.update_hz - 1e-3), 1)


def even(t: Array, interval: float, step: float) -> Array:
    """Time stamps (n,) as they were before they were rounded to multiples of `step`, where the clock was an even one.

    As they are where samples do not stand at multiples of an interval of about `interval` [s].
    """
    if t.size < FEWEST or step >= interval:
        return t
    for _ in range(3):
        count = np.round((t - t[0]) / interval)
        interval, begin = np.polyfit(count, t, 1)
    off = t - (begin + interval * count)
    return begin + interval * count if np.abs(off).max() < step and (np.diff(count) >= 1.0).all() else t
