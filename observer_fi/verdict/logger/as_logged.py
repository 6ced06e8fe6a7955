"""A rig and its bank fitted to what a log shows of its logger, and that log as filters may take it.

The first samples say what the logger does (`logs.logger.acquisition`); its noise, steps and delays go into the rig that the
filters take, everything else out of the readings.
"""

import math
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np

from observer_fi.bank import between_samples, repeat_share, with_servo_error
from observer_fi.logs import (
    SHORTEST_REST,
    Hum,
    Lateness,
    LowPasses,
    Mean,
    Readings,
    SetBack,
    Unfiltered,
    Uninductive,
    Unmeant,
    acquisition_of,
    behind_steps,
    even,
    inductance_of,
    means_of,
    with_low_passes,
)
from observer_fi.physics import COLUMNS, Rig
from observer_fi.records import CHANNELS, Acquisition, Array, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.lateness import first_start, lateness_of, set_right
from observer_fi.verdict.logger.low_pass import low_passes_of
from observer_fi.verdict.logger.offset import as_in_motion, electrical_offset
from observer_fi.verdict.logger.winding import inductance_at_start
from observer_fi.verdict.logger.zero_current import with_zero, zero_current
from observer_fi.verdict.moves.of_the_day import LOOKED_AT, Day, FirstStart, Told
from observer_fi.verdict.moves.ripple_phase import phases_of
from observer_fi.verdict.testable import for_readings

SPIKE_NIS = 22.0  # what a spike counts: one reading in a thousand, within a hundred standard deviations
FEWEST_RESTS = 3  # that say the same of a line: two say it of any
QUIET = 1.25  # times its expected NIS: a start whose lines are out of it is explained as well as this, or they were others
SAME_NOISE = 0.1  # relative: less is no news
LEARNABLE = SHORTEST_REST  # samples of a stream
# How long a current must go on changing [s], in how few and how many readings, and standard deviations that a change of each of
# them may be: of a reversal without a rest a filter with less room made a fault without a name.
LASTING_S, LASTING, PEAK = 3e-3, (3, 5), 4.0


class AsLogged:
    """What filters take of one log. log: its beginning, as long as there is; rig, settings: before anything was known of it.

    rig, settings: what banks are to be made with; acquisition: what the logger does; inductance: of the winding [H], which is
    taken out of the voltage. causal: whether a reading must do without those after it. filed: the logger that the rig file knows.
    """

    def __init__(self, log: Log, rig: Rig, settings: BankSettings, causal: bool = False) -> None:
        self.low_passes, self.interval = LowPasses(), 1.0 / log.rate_hz
        self.inductance, self.causal = inductance_of(rig, log.rate_hz), causal
        self.filed = rig.logger
        self.lines: Hum | None = None
        self.with_lines: Acquisition | None = None
        self.with_filters: Acquisition | None = None
        self.means: tuple[Mean, ...] = ()
        start = self._learn(log, rig, settings)
        if start is not None and start.misfit > LOOKED_AT:
            start = self._without_means(log, rig, settings, start)
        if any(channel.lines for channel in self.acquisition[:3]) and start is not None:
            log, start = self._without_lines(log, rig, settings, start)
        if not self.inductance and start is not None and rig.driven.motor:
            self.inductance = inductance_at_start(log, rig, settings, electrical_offset, start)
            start = self._learn(log, rig, settings) if self.inductance else start
        self.low_passes = low_passes_of(log, rig, settings, electrical_offset, start, self.acquisition)
        if self.low_passes.any:
            self.with_filters = self.acquisition
            self._learn(log, rig, settings)

    def _without_lines(self, log: Log, rig: Rig, settings: BankSettings, start: Told) -> tuple[Log, Told]:
        """The log without its lines, where many rests say the same of them and the first start is then explained, and how well.

        A held reading holds its line too, and is left as it is.
        """
        before = self.acquisition
        voltage, current, position = (c._replace(lines=()) if c.update_hz else c for c in before[:3])
        lines = Hum(log, Acquisition(voltage, current, position, before.clock), FEWEST_RESTS)
        if not lines.any:
            return log, start
        quiet = copy(lines).take(log)
        told = self._learn(quiet, rig, settings)
        if told is None or told.misfit > max(QUIET, start.misfit):
            self._learn(log, rig, settings)
            return log, start
        self.lines, self.with_lines = lines, before
        self._begin(log, rig)
        return quiet, told

    def _without_means(self, log: Log, rig: Rig, settings: BankSettings, start: Told) -> Told:
        """How well the first start is explained by what voltage and current are means of, where it is; else as it was."""
        found = means_of(log)
        if not found:
            return start
        self.means = found
        told = self._learn(log, rig, settings)
        if told is not None and told.misfit < min(QUIET, start.misfit):
            return told
        self.means = ()
        return self._learn(log, rig, settings) or start

    @property
    def told(self) -> Acquisition:
        """What the logger does, with what was taken out of its readings."""
        channels = list(self.acquisition[:3])
        if self.with_filters is not None:
            pairs = zip(channels, self.with_filters[:3], strict=True)
            channels = [
                now if now.low_pass_hz is None else was._replace(low_pass_hz=now.low_pass_hz)
                for now, was in pairs
            ]
        if self.with_lines is not None:
            pairs = zip(channels, self.with_lines[:3], strict=True)
            channels = [now._replace(lines=was.lines, resolution=was.resolution) for now, was in pairs]
        for mean in self.means:
            channels[mean.channel] = channels[mean.channel]._replace(averaged=mean.samples)
        voltage, current, position = channels
        return Acquisition(voltage, current, position, self.acquisition.clock)

    @property
    def lateness(self) -> Lateness:
        """How many samples channels are late as they were logged."""
        late = list(self.late)
        for mean in self.means:
            late[mean.channel] += mean.ahead
        return Lateness(*late)

    @property
    def unread(self) -> tuple[str, ...]:
        """Columns of which filters take no reading, because they stand or cover a few steps only."""
        return tuple(COLUMNS[c] for c, dark in zip(CHANNELS, self.readings.dark, strict=True) if dark)

    def _learn(self, log: Log, rig: Rig, settings: BankSettings) -> Told | None:
        """All but the filters before the readings; how well the first start is explained, where it tells."""
        self._begin_inputs(rig)
        log = self._inputs(log)
        measured = _of(self._in_steps(acquisition_of(log, rig.file_noise_std)), rig.logger)
        read = _commanded(with_low_passes(measured, self.low_passes.told), log, rig)
        self.acquisition = as_in_motion(read, log, rig)
        rig = replace(rig, logger=None) if rig.logger else rig
        self.readings = Readings(self.acquisition, log.rate_hz, rig.noise_std)
        told = between_samples(for_readings(settings, rig, log.z), rig, log.rate_hz)
        usual = self._for_the_servo(told, log, rig)
        spiky = any(channel.spikes for channel in self.acquisition[:3])
        self.settings = replace(usual, glitch_nis=min(SPIKE_NIS, usual.glitch_nis)) if spiky else usual
        self.day, self.offset = Day(), electrical_offset(self.acquisition, rig)
        known = replace(rig, logger=self.acquisition)
        ahead = {mean.channel: mean.ahead for mean in self.means}
        behind = (0.5 * (channel.averaged - 1) for channel in self.acquisition[:3])
        late = zip(behind, self._filed_late(log, rig), strict=True)
        averaged = Lateness(*(own - ahead.get(c, 0.0) + filed for c, (own, filed) in enumerate(late)))
        begun = self._even(self.readings.take(log))
        # a filter begins at whole turns of what the position shows: in the first start by itself at others than in the log
        turned = phases_of(first_start(begun), known, self.settings).of(known)
        self.late = lateness_of(begun, turned, self.settings, averaged)
        self.late, self.day, start = self._of_the_day(log, turned, averaged)
        known = self.day.of(set_right(known, self.late, 1.0 / log.rate_hz))
        self.zero = self._zero_current(log, known)
        known = with_zero(known, self.zero)
        self.offset = self.day.offset
        if self.zero:
            self.offset = electrical_offset(self.acquisition, known, self.day.voltage, 0.0)
        self._begin(log, rig)
        self.phases = phases_of(self._behind_filters(log), known, self.settings)
        of_log, of_file = (repeat_share(one, self.settings) for one in (known, rig))
        alike = bool(np.allclose(of_log, of_file, rtol=SAME_NOISE))
        as_filed = self.day.usual and (known.noise_std == rig.noise_std).all() and alike
        whole = bool(np.isfinite(log.z[:, 0]).any())
        filed = as_filed and whole and not known.step.any() and not any(self.late) and not self.zero
        self.rig = self.phases.of(rig if filed else known)
        self._begin(log, rig)
        return start

    def _filed_late(self, log: Log, rig: Rig) -> Lateness:
        """How many samples channels are late by the rig file, beside a servo that nobody knows: not every start tells it."""
        if self.filed is None or rig.watched.servo:
            return Lateness()
        return Lateness(*(channel.late_s * log.rate_hz for channel in self.filed[:3]))

    def _in_steps(self, measured: Acquisition) -> Acquisition:
        """What a log without its filters shows of its logger, with the steps in which its readings came."""
        if self.with_filters is None:
            return measured
        every = zip(measured[:3], self.with_filters[:3], self.low_passes, strict=True)
        voltage, current, position = (behind_steps(now, was, own, self.interval) for now, was, own in every)
        return Acquisition(voltage, current, position, measured.clock)

    def _for_the_servo(self, settings: BankSettings, log: Log, rig: Rig) -> BankSettings:
        """The settings with room, beside an unknown servo, for the fastest change of the current that this log shows."""
        if rig.watched.servo:
            return settings
        fresh = copy(self.readings).take(log)  # of held readings a change is that of several samples
        return with_servo_error(settings, rig, fastest_current(fresh) / PEAK)

    def _begin(self, log: Log, rig: Rig) -> None:
        """Before the first chunk."""
        self.readings = Readings(self.acquisition, log.rate_hz, rig.noise_std)
        self.set_back = SetBack(self.late)
        self._begin_inputs(rig)
        self.hum = copy(self.lines)

    def _begin_inputs(self, rig: Rig) -> None:
        self.unfiltered, self.unmeant = Unfiltered(self.low_passes, self.interval), Unmeant(self.means)
        self.unwound = Uninductive(self.inductance, rig.file_noise_std, self.interval, self.causal)

    def _inputs(self, log: Log) -> Log:
        """The next chunk as it came before the logger's filters and means, with the voltage of a winding without inductance."""
        return self.unwound.take(self.unmeant.take(self.unfiltered.take(log)))

    @property
    def plain(self) -> bool:
        """Whether filters take every reading as it is."""
        as_read = self.readings.plain and self.hum is None
        as_told = not self.offset and self.day.voltage == 1.0
        as_come = not any(self.late) and not self.low_passes.any and not self.means and not self.inductance
        return as_read and as_told and as_come

    def take(self, log: Log) -> Log:
        """The next chunk of the log, the first one again."""
        quiet = self.hum.take(log) if self.hum is not None else log
        return self._behind_filters(self._inputs(quiet))

    def _behind_filters(self, log: Log) -> Log:
        """The next chunk, without the filters before its readings."""
        return self.set_back.take(self._even(self.readings.take(log)))

    def take_rows(self, rows: Array) -> Array:
        """Samples (n, 6) of a stream: time, three readings, pitch, command."""
        if self.plain:
            return rows
        out = rows.copy()
        out[:, 1:4] = self.take(Log("stream", rows[:, 0], rows[:, 1:4], rows[:, 5], rows[:, 4])).z
        return out

    def same_as(self, other: "AsLogged | None", settings: BankSettings) -> bool:
        """Whether another, or the rig file alone where there is none, says the same to filters."""
        if other is None:
            usual = self.day.usual and not any(self.phases)
            return self.plain and usual and self.rig.logger is None and self.settings == settings
        same_noise = np.allclose(self.rig.noise_std, other.rig.noise_std, rtol=SAME_NOISE)
        same = (
            self.day == other.day
            and self.phases == other.phases
            and self.late == other.late
            and self.lines is other.lines is None
            and math.isclose(self.zero, other.zero, abs_tol=SAME_NOISE * self.rig.noise_std[1])
            and self.low_passes == other.low_passes
            and self.means == other.means
            and self.inductance == other.inductance
            and self.settings == other.settings
        )
        held = self.readings.every == other.readings.every and self.readings.stands == other.readings.stands
        return bool(same_noise) and same and held

    def _of_the_day(self, log: Log, known: Rig, averaged: Lateness) -> tuple[Lateness, Day, Told | None]:
        """How late channels are, and the winding and gains of the day: a start of other gains can look late.

        With them how well they explain the first start, where it tells.
        """
        readings = self._on_even_clock(self.readings.take(log))

        def start(late: Lateness) -> FirstStart:
            right = set_right(known, late, 1.0 / log.rate_hz)
            return FirstStart(
                SetBack(late).take(readings),
                right,
                self.settings,
                partial(electrical_offset, self.acquisition),
            )

        late, begun = self.late, start(self.late)
        day = begun.day()
        if begun.cut is None:
            return late, day, None
        if late != averaged:
            in_time = start(averaged)
            other = in_time.day()
            if not other.usual and in_time.told(other).nats > begun.told(day).nats:
                late, day, begun = averaged, other, in_time
        return late, day, begun.told(day)

    def _zero_current(self, log: Log, known: Rig) -> float:
        """How far the current sensor is off its zero [A], as a bank sees it that takes the rig as it is known so far."""
        self._begin(log, known)
        readings = self.set_back.take(self._true(self._on_even_clock(self.readings.take(log))))
        return zero_current(
            readings,
            known,
            self.settings,
            partial(electrical_offset, self.acquisition, gain=self.day.voltage, least=0.0),
        )

    def _on_even_clock(self, log: Log) -> Log:
        clock = self.acquisition.clock
        return (
            replace(log, t=even(log.t, clock.interval_s, clock.resolution_s)) if clock.resolution_s else log
        )

    def _true(self, log: Log) -> Log:
        """A chunk with the voltage that the motor gets."""
        return log if self.day.voltage == 1.0 else replace(log, z=self.day.true(log.z))

    def _even(self, log: Log) -> Log:
        """A chunk on an even clock, without gain and offset of its voltage."""
        log = self._true(self._on_even_clock(log))
        return replace(log, z=log.z - np.array([self.offset, 0.0, 0.0])) if self.offset else log


def fastest_current(log: Log) -> float:
    """How fast the current of a log changes at most [A per root of a second], as random steps between readings would.

    For as long as an unknown servo takes for a ramp, which no jump of a sensor lasts.
    """
    there = np.isfinite(log.z[:, 1])
    if np.count_nonzero(there) <= LASTING[1]:
        return 0.0
    apart = np.diff(log.t[there])
    lasting = int(np.clip(round(LASTING_S / float(np.median(apart))), *LASTING))
    walks = np.diff(log.z[there, 1]) / np.sqrt(apart)
    steps = np.lib.stride_tricks.sliding_window_view(walks, lasting)
    return float(np.minimum(np.abs(steps.mean(axis=1)), np.abs(np.median(steps, axis=1))).max())


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
