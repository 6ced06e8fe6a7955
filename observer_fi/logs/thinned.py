"""A log of many samples a second as one of fewer, which tells the same: a servo's motion is no faster.

A converter's noise averages out over rows that are judged as one, and with it the ripple of a drive that switches; what
stands still within them, held or in steps, does not, and is read once.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.ingest import CHUNK_ROWS, LogFile
from observer_fi.logs.logger.acquisition import acquisition_of, without_spikes
from observer_fi.physics import COLUMNS, Rig
from observer_fi.records import CHANNELS, Acquisition, Array, ChannelTraits, Log, Outcome

ENOUGH_HZ = 1600.0  # at least, of rows that are judged as one: many samples of the ring of any servo
BREAK = 0.5  # of the time of rows that are judged as one: a gap that is longer lies between two of them
REPEATS = 0.02  # share of readings that repeat the one before, which those with noise of their own hardly do


class Thinner:
    """Takes `rows` rows of a log as one, 1 of slow logs, and of an uneven number, so that it has the time of one of them.

    acquisition: of the log as it is, where that is thinned. means: channels of which a row is the mean, if any may be.
    """

    def __init__(self, begin: Log, rig: Rig, means: bool = True) -> None:
        self.rows = _together(begin.rate_hz) if rig.driven.motor else 1
        self.rate_hz = begin.rate_hz
        self.acquisition: Acquisition | None = None
        self.means: tuple[int, ...] = ()
        if self.rows > 1:
            self.acquisition = acquisition_of(begin, rig.file_noise_std)
            own = (c for c, traits in enumerate(self.acquisition[:3]) if _is_own(traits))
            self.means = tuple(own) if means else ()

    def of(self, log: Log) -> Log:
        """The log, or a chunk of it, with fewer rows."""
        if self.acquisition is None or not log.t.size:
            return log
        first = self._first(log.t)
        last = np.append(first[1:], log.t.size)
        z, read = log.z[(first + last - 1) // 2], without_spikes(log, self.acquisition).z
        for c in self.means:
            z[:, c] = _means(read[:, c], first)
        taken = log.part((first + last - 1) // 2)
        notes = log.notes if self.told()[0] in log.notes else log.notes + self.told()
        return replace(taken, z=z, first_row=log.first_row // self.rows, notes=notes)

    def chunks(self, file: LogFile) -> Iterator[Log]:
        """The chunks of a file, each with about as many rows as one that is not thinned."""
        return map(self.of, file.chunks(self.rows * CHUNK_ROWS))

    def told(self) -> tuple[str, ...]:
        """What is said of it beside a verdict."""
        if self.rows == 1:
            return ()
        means = ", ".join(COLUMNS[CHANNELS[c]] for c in self.means)
        of = f"means of {means}; of other columns the middle one" if means else "the middle one"
        return (f"{self.rate_hz:.0f} samples a second: {self.rows} rows are judged as one ({of})",)

    def restored(self, outcome: Outcome, samples: int) -> Outcome:
        """An outcome with what it says of the log and its logger as they are, of so many samples."""
        if self.acquisition is None:
            return outcome
        return replace(outcome, samples=samples, rate_hz=self.rate_hz, acquisition=self.acquisition)

    def _first(self, t: Array) -> NDArray[np.intp]:
        """The first of the rows that are taken as one, each time; none go on over a gap."""
        gaps = np.flatnonzero(np.diff(t) > BREAK * self.rows / self.rate_hz) + 1
        parts = np.concatenate(([0], gaps, [t.size]))
        starts = [
            np.arange(a, max(b - self.rows // 2, a + 1), self.rows)
            for a, b in zip(parts[:-1], parts[1:], strict=True)
        ]
        return np.concatenate(starts).astype(np.intp)


def thinned(log: Log, rig: Rig) -> Log:
    """A log in memory with as many rows as a rig is learned from; one of few samples a second as it is.

    They are read once: where a command has a corner, or between two ticks of a servo, a mean is no reading at any time.
    """
    return Thinner(log, rig, means=False).of(log)


def _together(rate_hz: float) -> int:
    """Rows that are judged as one: uneven."""
    if not math.isfinite(rate_hz):
        return 1
    count = int(rate_hz / ENOUGH_HZ * (1.0 + 1e-6))
    return max(count - (count + 1) % 2, 1)


def _is_own(traits: ChannelTraits) -> bool:
    """Whether each reading has noise of its own."""
    held = traits.hold_s is not None or traits.update_hz is not None
    return not held and traits.resolution is None and traits.repeats < REPEATS and traits.noise_std > 0.0


def _means(z: Array, first: NDArray[np.intp]) -> Array:
    """Means of readings z (n,) from each first row to the next, without those that are not there; NaN where none is."""
    there = np.isfinite(z)
    count = np.add.reduceat(there.astype(float), first)
    total = np.add.reduceat(np.where(there, z, 0.0), first)
    return np.divide(total, count, out=np.full(count.size, np.nan), where=count > 0.0)
