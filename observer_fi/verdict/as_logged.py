"""A rig and its bank fitted to what a log shows of its logger, and that log as filters may take it.

The first samples say what the logger does (`logs.acquisition`); its noise, steps and delays go into the rig that the filters
take, everything else out of the readings.
"""

import math
from dataclasses import replace

import numpy as np

from observer_fi.logs import FEWEST, Readings, acquisition_of, even
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, Array, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.lateness import Lateness, SetBack, lateness_of, set_right
from observer_fi.verdict.testable import for_readings

OFFSET_STD = 4.0  # standard deviations of a mean reading at rest from which it is an offset
DOUBT_OF_RM = 0.05  # relative: what a current at rest leaves in doubt of an offset


class AsLogged:
    """What filters take of one log. log: its beginning, as long as there is; rig, settings: before anything was known of it.

    rig, settings: what banks are to be made with; acquisition: what the logger does.
    """

    def __init__(self, log: Log, rig: Rig, settings: BankSettings) -> None:
        self.acquisition = acquisition_of(log, rig.noise_std)
        self.readings = Readings(self.acquisition, log.rate_hz, rig.noise_std)
        self.settings = for_readings(settings, rig, log.z)
        self.offset = electrical_offset(self.acquisition, rig)
        known = replace(rig, logger=self.acquisition)
        averaged = Lateness(*(0.5 * (channel.averaged - 1) for channel in self.acquisition[:3]))
        self.late = lateness_of(self._even(self.readings.take(log)), known, self.settings, averaged)
        known = set_right(known, self.late, 1.0 / log.rate_hz)
        as_filed = (known.noise_std == rig.noise_std).all() and not known.step.any() and not any(self.late)
        as_filed &= bool((known.repeats <= 0.0).all())
        self.rig = rig if as_filed else known
        self.readings, self.set_back = (
            Readings(self.acquisition, log.rate_hz, rig.noise_std),
            SetBack(self.late),
        )

    def take(self, log: Log) -> Log:
        """The next chunk of the log, the first one again."""
        return self.set_back.take(self._even(self.readings.take(log)))

    def take_rows(self, rows: Array) -> Array:
        """Samples (n, 6) of a stream: time, three readings, pitch, command."""
        if self.readings.plain and not self.offset and not any(self.late):
            return rows
        out = rows.copy()
        out[:, 1:4] = self.take(Log("stream", rows[:, 0], rows[:, 1:4], rows[:, 5], rows[:, 4])).z
        return out

    def same_as(self, other: "AsLogged | None", rig: Rig) -> bool:
        """Whether another, or the rig file alone where there is none, says the same to filters."""
        plain = self.readings.plain and not self.offset and not any(self.late)
        if other is None:
            return plain and self.rig is rig
        same_noise = np.allclose(self.rig.noise_std, other.rig.noise_std, rtol=SAME_NOISE)
        return same_noise and self.offset == other.offset and self.late == other.late

    def _even(self, log: Log) -> Log:
        """A chunk on an even clock and without the offset of its voltage."""
        clock = self.acquisition.clock
        if clock.resolution_s:
            log = replace(log, t=even(log.t, clock.interval_s, clock.resolution_s))
        return replace(log, z=log.z - np.array([self.offset, 0.0, 0.0])) if self.offset else log


def electrical_offset(a: Acquisition, rig: Rig) -> float:
    """Zero offset of the voltage against the current [V]: at rest equation 16 leaves their resistance only.

    Of two offsets only this sum shows in the motor's voltage balance; what is left of the current's is like friction.
    """
    Rm = rig.model["Rm"] if rig.driven.motor else math.nan
    off = a.voltage.offset - Rm * a.current.offset
    noise = math.hypot(a.voltage.as_white, Rm * a.current.as_white)
    doubt = OFFSET_STD * noise / math.sqrt(OFFSET_SAMPLES) + DOUBT_OF_RM * abs(Rm * a.current.offset)
    return off if math.isfinite(off) and abs(off) > doubt else 0.0


SAME_NOISE = 0.1  # relative: less is no news
LEARNABLE = FEWEST  # samples of a stream
OFFSET_SAMPLES = 400.0  # of a usual rest
