"""What filters may take of a logger's readings: each held reading once, coarse ones that stand still ever more rarely.

Filters take the noise of their readings for white. A held reading is fresh at its ticks only; one that stands within a step
much larger than its noise says nothing new, but for that it has not moved, and so counts at samples 1, 4, 16, 64, ... of its
run, and of a new command: that it stands still then is news. Where a sensor ought to have ticked and did not, the repeat counts:
it may be frozen. A channel that covers a few steps only, or none, is not taken at all.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.logger.acquisition import STANDING
from observer_fi.records import Acquisition, Array, ChannelTraits, Log

FEWEST_STEPS = 6.0  # that a channel in steps must cover in a log, to tell anything
AGES = np.append(0, 4 ** np.arange(31))  # ticks that a reading has stood for when it counts again


class Readings:
    """The readings of one log, chunk by chunk."""

    def __init__(self, acquisition: Acquisition, rate_hz: float, noise_std: Array) -> None:
        channels = (acquisition.voltage, acquisition.current, acquisition.position)
        self.every = [_ticks(c, rate_hz) for c in channels]
        self.stands = [
            c.resolution is not None and c.resolution > STANDING * max(c.noise_std, usual)
            for c, usual in zip(channels, noise_std.tolist(), strict=True)
        ]
        self.dark = [c.travel == 0.0 or c.travel < FEWEST_STEPS * (c.resolution or 0.0) for c in channels]
        self.rate_hz = rate_hz
        self.last = np.full(
            3, np.nan
        )  # reading, when it came, and how many ticks it has stood since, of each channel
        self.since = np.zeros(3)
        self.commands = np.empty(0)  # the last two
        self.ticks = np.full(3, -1)

    @property
    def plain(self) -> bool:
        """Whether every reading counts as it is."""
        return not any(self.stands) and not any(self.dark) and all(every == 1 for every in self.every)

    def take(self, log: Log) -> Log:
        """The next chunk with NaN for readings that say nothing new."""
        if self.plain:
            return log
        z, settled = log.z.copy(), self._settled(log.w_cmd)
        for c in range(3):
            if self.dark[c]:
                z[:, c] = np.nan
            elif self.stands[c] or self.every[c] > 1:
                z[~self._fresh(c, log.t, log.z[:, c], settled), c] = np.nan
        return replace(log, z=z)

    def _settled(self, w_cmd: Array) -> NDArray[np.bool_]:
        """Where a command has just come to a new speed."""
        before = self.commands if self.commands.size else np.repeat(w_cmd[:1], 2)
        w = np.append(before, w_cmd)
        self.commands = w[-2:]
        return (w[2:] == w[1:-1]) & (w[1:-1] != w[:-2])

    def _fresh(self, c: int, t: Array, z: Array, settled: NDArray[np.bool_]) -> NDArray[np.bool_]:
        there = np.isfinite(z)
        t, values = t[there], z[there]
        out = there.copy()
        if not values.size:
            return out
        changed = values != np.append(self.last[c], values[:-1])
        if self.stands[c]:
            changed |= settled[there]
        at = np.maximum.accumulate(np.where(changed, np.arange(values.size), -1))
        since = np.where(at < 0, self.since[c], t[at])  # when the reading came that stands
        tick = np.floor((t - since) * self.rate_hz / self.every[c] + 0.25 / self.every[c]).astype(np.int64)
        fresh = changed | (tick != np.append(self.ticks[c], tick[:-1]))
        if self.stands[c]:
            fresh &= np.isin(tick, AGES)
        self.last[c], self.since[c], self.ticks[c] = values[-1], since[-1], tick[-1]
        out[there] = fresh
        return out


def _ticks(c: ChannelTraits, rate_hz: float) -> int:
    """Samples between two updates of a reading at most, 1 where it is not held."""
    longest = c.hold_s or (c.update_hz and 1.0 / c.update_hz)
    return 1 if longest is None else max(math.ceil(rate_hz * longest - 1e-3), 1)
