"""A log that begins within a start, while the supply limits the servo: nothing shows then how far its integral has wound up.

A filter that begins there takes what it does not know for another inertia, or another supply.
"""

import numpy as np
from numpy.typing import NDArray

from observer_fi.physics import Rig
from observer_fi.records import Log

NEAR = 0.85  # of the supply of the rig file
LONGEST_S = 0.25  # a servo that is at its limit for longer runs there, and begins where the log does


def known_from(log: Log, rig: Rig) -> int:
    """The first row from which voltage and current tell what the servo asks for: 0 of a log that begins at rest."""
    below = _below(log, rig)
    return int(below[0]) if below.size else 0


def at_the_limit(log: Log, rig: Rig) -> bool:
    """Whether samples, those of a stream so far, are all at the limit, and not for long enough that it runs there."""
    return not _below(log, rig).size and bool(log.t[-1] - log.t[0] <= LONGEST_S)


def _below(log: Log, rig: Rig) -> NDArray[np.intp]:
    """Rows of the log's begin that are below the limit: its first one where it begins at rest."""
    if not rig.watched.servo or not log.w_cmd[:1].any():
        return np.zeros(1, dtype=np.intp)
    begun = log.z[log.t <= log.t[0] + LONGEST_S]
    supply = np.abs(begun[:, 0] + rig.model["Rs"] * begun[:, 1])
    return np.flatnonzero(supply < NEAR * rig.model["Vmax"])
