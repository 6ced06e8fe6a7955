"""A log beside a servo that nobody knows, whose voltage and current are held: its rows where they are fresh.

What such a servo does between two readings of the current nobody foretells. Rows in between say so with every step that filters
take through them, until nothing is left that a small fault could contradict: a friction that grew by a fifth gained 12 nats of a
move instead of 5600. A log of as many rows as there are readings has none of that.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs import CHUNK_ROWS, Readings, acquisition_of
from observer_fi.physics import Rig
from observer_fi.records import Log

ELECTRICAL = slice(0, 2)
MOST = 0.75  # of the rows that may be ticks of held readings
TOGETHER = 0.9  # of the ticks: where fewer are of both channels, they are not read together
NOTE = "what is read of voltage and current is fresh in {} of {} rows, which alone are judged: nobody knows the servo in between"


def at_ticks(log: Log, rig: Rig) -> Log:
    """The log as it is or, where its voltage and current are held together and no servo foretells them, at their ticks."""
    if not is_held(log, rig):
        return log
    ticks = _fresh(log, rig).any(axis=1)
    shown = log.part(np.flatnonzero(ticks))
    return replace(shown, notes=(*log.notes, NOTE.format(shown.t.size, log.t.size)))


def is_held(log: Log, rig: Rig) -> bool:
    """Whether the first rows of a log show voltage and current held together beside an unknown servo."""
    return not rig.watched.servo and held_together(log, rig)


def held_together(log: Log, rig: Rig) -> bool:
    """Whether the first rows of a log show voltage and current, what there is of them, held together."""
    fresh = _fresh(log.part(slice(0, CHUNK_ROWS)), rig)
    ticks, both = np.count_nonzero(fresh.any(axis=1)), np.count_nonzero(fresh.all(axis=1))
    return bool(0 < ticks < MOST * len(fresh) and both >= TOGETHER * ticks)


def _fresh(log: Log, rig: Rig) -> NDArray[np.bool_]:
    """(n, k) rows in which each of the k of voltage and current that are there is fresh; every one of those that are not held."""
    there = np.flatnonzero(np.isfinite(log.z[:, ELECTRICAL]).any(axis=0))
    if log.t.size < 2 or not there.size:
        return np.ones((log.t.size, 1), dtype=np.bool_)
    acquisition = acquisition_of(log.part(slice(0, CHUNK_ROWS)), rig.file_noise_std)
    readings = Readings(acquisition, log.rate_hz, rig.noise_std)
    held = np.array(readings.every)[there] > 1
    return np.where(held, np.isfinite(readings.take(log).z[:, there]), True)
