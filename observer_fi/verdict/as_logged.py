"""A rig and its bank fitted to what a log shows of its logger, and that log as filters may take it.

The first samples say what the logger does (`logs.acquisition`); its noise, steps and delays go into the rig that the filters
take, everything else out of the readings.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from observer_fi.bank import REPEATING, Bank, bank, between_samples
from observer_fi.logs import FEWEST_AT_REST, Readings, acquisition_of, even
from observer_fi.numerics import in_python
from observer_fi.physics import Rig, equations, with_values
from observer_fi.records import Acquisition, Array, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.lateness import Lateness, SetBack, first_start, lateness_of, set_right
from observer_fi.verdict.testable import for_readings

OFFSET = 0.7  # of the noise of a reading, from which the mean at rest is off: fourteen standard deviations of a usual rest
SPIKE_NIS = 22.0  # what a spike counts: one reading in a thousand, within a hundred standard deviations
# Of the resistance of the rig file: copper has 0.39 % more a kelvin, and a winding that is cold or has run is 15 K cooler to 45 K
# warmer. What lies beyond is a fault.
WINDINGS = (0.94, 1.06, 1.12, 1.18)
FINER = (-0.03, -0.015, -0.007, 0.007, 0.015, 0.03)
LOOKED_AT = 1.05  # times the expected NIS: a start that nominal explains better tells of no other winding
NOTICED_NATS, FITS = 40.0, 1.3  # that another winding must gain at a start, and how well nominal then fits
SAME_NOISE = 0.1  # relative: less is no news
BEGIN = 8  # samples until a filter has found its state
LEARNABLE = FEWEST_AT_REST  # samples of a stream


class AsLogged:
    """What filters take of one log. log: its beginning, as long as there is; rig, settings: before anything was known of it.

    rig, settings: what banks are to be made with; acquisition: what the logger does.
    """

    def __init__(self, log: Log, rig: Rig, settings: BankSettings) -> None:
        self.acquisition = _commanded(_of(acquisition_of(log, rig.file_noise_std), rig.logger), log, rig)
        rig = replace(rig, logger=None) if rig.logger else rig
        self.readings = Readings(self.acquisition, log.rate_hz, rig.noise_std)
        usual = between_samples(for_readings(settings, rig, log.z), rig, log.rate_hz)
        spiky = any(channel.spikes for channel in self.acquisition[:3])
        self.settings = replace(usual, glitch_nis=min(SPIKE_NIS, usual.glitch_nis)) if spiky else usual
        self.offset = electrical_offset(self.acquisition, rig)
        known = replace(rig, logger=self.acquisition)
        averaged = Lateness(*(0.5 * (channel.averaged - 1) for channel in self.acquisition[:3]))
        self.late = lateness_of(self._even(self.readings.take(log)), known, self.settings, averaged)
        known = set_right(known, self.late, 1.0 / log.rate_hz)
        self.winding = winding_of(self._even(self.readings.take(log)), known, self.settings)
        known = with_values(known, {"Rm": self.winding * known.model["Rm"]}) if self.winding != 1.0 else known
        as_filed = (
            self.winding == 1.0
            and (known.noise_std == rig.noise_std).all()
            and (known.repeats <= REPEATING).all()
        )
        self.rig = rig if as_filed and not known.step.any() and not any(self.late) else known
        self.readings = Readings(self.acquisition, log.rate_hz, rig.noise_std)
        self.set_back = SetBack(self.late)

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

    def same_as(self, other: "AsLogged | None", settings: BankSettings) -> bool:
        """Whether another, or the rig file alone where there is none, says the same to filters."""
        plain = self.readings.plain and not self.offset and not any(self.late) and self.winding == 1.0
        if other is None:
            return plain and self.rig.logger is None and self.settings == settings
        same_noise = np.allclose(self.rig.noise_std, other.rig.noise_std, rtol=SAME_NOISE)
        same = (
            self.offset == other.offset
            and self.winding == other.winding
            and self.late == other.late
            and self.settings == other.settings
        )
        held = self.readings.every == other.readings.every and self.readings.stands == other.readings.stands
        return bool(same_noise) and same and held

    def _even(self, log: Log) -> Log:
        """A chunk on an even clock and without the offset of its voltage."""
        clock = self.acquisition.clock
        if clock.resolution_s:
            log = replace(log, t=even(log.t, clock.interval_s, clock.resolution_s))
        return replace(log, z=log.z - np.array([self.offset, 0.0, 0.0])) if self.offset else log


def winding_of(log: Log, rig: Rig, settings: BankSettings) -> float:
    """Resistance of the winding over that of the rig file, 1 where the first start of a log does not tell.

    A winding that is warm is no fault, and no constant of the rig either: it has its own value every day. It is told where
    nominal with another resistance explains the start, and better than any fault with that of the file.
    """
    cut = first_start(log)
    if cut is None or rig.model["Rm"] == 0.0 or not np.isfinite(cut.z[:, :2]).any(axis=0).all():
        return 1.0
    told = partial(_start_told, cut, rig, settings)
    nats, misfit = told(1.0)
    if misfit < LOOKED_AT:
        return 1.0
    best = max((1.0, *WINDINGS), key=lambda share: told(share)[0])
    best = max((best, *(best + more for more in FINER)), key=lambda share: told(share)[0])
    gained, left = told(best)
    of_a_fault = Bank(rig, settings).advance(cut).density[BEGIN:, 1:].sum(axis=0).max()
    return best if gained > max(nats + NOTICED_NATS, of_a_fault) and left < FITS else 1.0


def _start_told(cut: Log, rig: Rig, settings: BankSettings, share: float) -> tuple[float, float]:
    """Nats of nominal with so much of the winding's resistance, and its NIS in motion over its expectation."""
    warm = with_values(rig, {"Rm": share * rig.model["Rm"]})
    e = Bank(warm, settings, hypotheses=bank(warm, settings)[:1]).advance(cut)
    read = np.isfinite(cut.z).sum(axis=1)
    moving = e.active & (read > 0)
    return float(e.density[BEGIN:, 0].sum()), float(np.mean(e.nis[moving, 0] / read[moving]))


def _of(measured: Acquisition, before: Acquisition | None) -> Acquisition:
    """What a log shows of its logger; of a channel without a rest what other logs have shown of it."""
    if before is None:
        return measured
    pairs = zip(measured[:3], before[:3], strict=True)
    voltage, current, position = (
        old if math.isnan(new.neighbour_std) and math.isfinite(old.noise_std) else new for new, old in pairs
    )
    return Acquisition(voltage, current, position, measured.clock)


def _commanded(a: Acquisition, log: Log, rig: Rig) -> Acquisition:
    """The acquisition with a position's travel that is at least the commanded one: a mass that stands is no coarse sensor.

    One that is the same from the first sample to the last stays so: a sensor that works has noise.
    """
    moved = np.cumsum(np.nan_to_num(log.w_cmd[1:]) * np.diff(log.t)) * rig.model["D"]
    if not moved.size or a.position.travel == 0.0:
        return a
    return a._replace(position=a.position._replace(travel=max(a.position.travel, float(np.ptp(moved)))))


def electrical_offset(a: Acquisition, rig: Rig) -> float:
    """Zero offset of the voltage against the current [V]: at rest equation 16 leaves their resistance only.

    Of two offsets only this sum shows in the motor's voltage balance; what is left of the current's is like friction.
    """
    if not rig.driven.motor:
        return 0.0
    model = rig.model
    current = (a.current.offset - model["current_offset"]) / model["current_gain"]
    expected = in_python(equations.terminal_voltage)(current, 0.0, 0.0, model.vector)
    off = float(a.voltage.offset - expected - model["voltage_offset"])
    noise = math.hypot(a.voltage.as_white, model["Rm"] * a.current.as_white)
    return off if math.isfinite(off) and abs(off) > OFFSET * noise else 0.0
