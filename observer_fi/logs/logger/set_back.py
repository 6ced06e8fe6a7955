"""Channels that are read one after the other, at one time: those that are early are set back to the latest of voltage and
current, so that no later sample is needed.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.records import CHANNELS, Filter, Log


class Lateness(NamedTuple):
    """How many samples voltage, current and position are behind the command."""

    voltage: float = 0.0
    current: float = 0.0
    position: float = 0.0

    @property
    def electrical(self) -> float:
        """The later one of voltage and current, 0 where both come ahead of the command."""
        return max(self.voltage, self.current, 0.0)


class SetBack:
    """Readings of one log, chunk by chunk, with voltage, current and position at one time."""

    def __init__(self, late: Lateness) -> None:
        common = late.electrical
        self.samples = [max(common - own, 0.0) for own in late]
        self.before = np.empty((0, 3))

    def take(self, log: Log) -> Log:
        """The next chunk."""
        if not any(self.samples):
            return log
        room = int(np.ceil(max(self.samples)))
        known = (
            np.vstack((self.before, log.z)) if self.before.size else np.vstack((*(log.z[:1],) * room, log.z))
        )
        out = np.empty_like(log.z)
        for c, samples in enumerate(self.samples):
            whole = int(np.floor(samples))
            share, last = samples - whole, known.shape[0] - whole
            now = known[last - len(log.z) : last, c]
            before = known[last - len(log.z) - 1 : last - 1, c] if share else now
            before = np.where(np.isfinite(before), before, now)  # a held reading stands alone
            out[:, c] = (1.0 - share) * now + share * before
        self.before = known[-room:]
        return replace(log, z=out)


def late_by(told: Iterable[Filter]) -> Lateness:
    """How late channels are of which that is told, as a filter without a corner."""
    return Lateness(**{own.channel: own.late for own in told if own.channel in CHANNELS})
