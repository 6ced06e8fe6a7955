"""The inductance of a winding of which the rig file knows nothing, told at the first start of a log.

There the voltage runs ahead of the current, which no fault does. It counts where the motion of nominal explains the start behind
it, and better than any fault without it.
"""

from collections.abc import Callable

import numpy as np

from observer_fi.logs import LowPasses, Uninductive
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.lateness import first_start
from observer_fi.verdict.logger.low_pass import FITS, NOTICED_NATS, TRUE, Start
from observer_fi.verdict.moves.of_the_day import Told

TIMES_S = (2e-4, 4e-4, 8e-4, 1.6e-3, 3.2e-3, 6.4e-3)  # time constants that are tried first
FINER = (1.4, 1.2, 1.1, 1.05)  # factors by which the best one is tried longer and shorter


def inductance_at_start(
    log: Log,
    rig: Rig,
    settings: BankSettings,
    offset_of: Callable[[Acquisition, Rig], float],
    without: Told | None,
) -> float:
    """Inductance of the winding [H]; 0 where a first start does not tell, or is explained without.

    offset_of: zero offset of the voltage [V] of what a logger does and a rig; without: how well the start is explained.
    """
    cut = first_start(log)
    if (
        without is None
        or cut is None
        or without.misfit < TRUE
        or not np.isfinite(log.z[:, :2]).any(axis=0).all()
    ):
        return 0.0
    start = log.part(slice(0, int(np.searchsorted(log.t, cut.t[-1])) + 1))
    plain = Start(start, rig, settings, offset_of)
    known: dict[float, Start] = {}

    def nats(inductance: float) -> float:
        if inductance not in known:
            behind = Uninductive(inductance, rig.file_noise_std, 1.0 / log.rate_hz).take(start)
            known[inductance] = Start(behind, rig, settings, offset_of)
        return known[inductance].nats(LowPasses())

    best = max((rig.model["Rm"] * time for time in TIMES_S), key=nats)
    for factor in FINER:
        best = max((best, factor * best, best / factor), key=nats)
    worth = max(plain.as_filed, without.nats) + NOTICED_NATS
    return best if known[best].misfit(LowPasses()) < FITS and nats(best) > worth else 0.0
