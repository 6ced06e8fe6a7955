"""Readings as fits may take them: each one that says something new, with the noise by which it counts.

Residuals of a fit are taken for white. A held reading counts at its ticks, a coarse one that stands ever more rarely
(`logs.logger.readings`), and a channel whose noise is not white, or comes in steps, counts as the white noise that says as
little.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs import Readings as FreshReadings
from observer_fi.logs import (
    acquisition_of,
    clock_of,
    earlier,
    even,
    timing_doubt,
    without_lines,
    without_means,
    without_spikes,
)
from observer_fi.numerics import runs
from observer_fi.physics import Rig
from observer_fi.records import Acquisition, Array, ChannelTraits, Filter, Log

_SETTLED_S = 0.3  # after a corner of the command: only noise is left in second differences
_OFF = 4.0  # standard deviations: a drive that is off drives nothing
_OFF_S = 0.05
_HOLE = 3  # samples of a drive that is off that look as if it were not
_FEWEST = 100  # settled samples for an estimate of the noise
_ALIKE = 1e-3  # rates of one converter, as they are measured
_MEAN = 4  # samples of which a reading is the mean, from which on it is taken for one
_NOISE_FLOOR = 0.1  # of the rig file's noise: a log without noise must not weigh without limit


class Readings(NamedTuple):
    """The logs with NaN for readings that say nothing new, on an even clock; noise (3,) of what is left; lines of it [Hz].

    jitter_s: (3,) of each log's clock, and by what its channels are off in time besides. A servo sets its current between
    samples, and an even clock is as far behind each tick. older_s: by which voltage and current may be older than their rows,
    where one converter holds both.
    """

    logs: list[Log]
    noise: Array
    hum_hz: tuple[float, ...]
    jitter_s: list[Array]
    older_s: float = 0.0


def readings_to_fit(logs: Sequence[Log], rig: Rig, filters: Sequence[Filter] = ()) -> Readings:
    """What fits may take of some logs of one rig. filters: that were taken out of their readings."""
    taken, estimates, hum, jitter, older = [], [], [], [], 0.0
    for log in logs:
        log, acquisition, lines = without_logger(log, rig)
        hum += lines
        white = _settled_noise(log)
        channels = zip(acquisition[:3], white.tolist(), strict=True)
        estimates.append([noise if _plain(channel) else channel.as_white for channel, noise in channels])
        jitter.append(np.hypot(clock_of(log.t).jitter_s, timing_doubt(filters) / log.rate_hz))
        older = max(older, 1.0 / log.rate_hz if _held_together(acquisition) else 0.0)
        taken.append(without_drive_off(fresh_readings(log, acquisition, rig), acquisition))
    found = np.array([_usual(column) for column in np.array(estimates).T])
    usual = rig.file_noise_std
    noise = np.where(np.isfinite(found), np.maximum(found, _NOISE_FLOOR * usual), usual)
    return Readings(taken, noise, tuple(hum), jitter, older)


def without_logger(log: Log, rig: Rig) -> tuple[Log, Acquisition, list[float]]:
    """A log on an even clock, without lines and means of samples; what its logger does besides; and the lines [Hz]."""
    acquisition = acquisition_of(log, rig.file_noise_std)
    lines = [line.hz for channel in acquisition[:3] for line in channel.lines]
    if lines:
        log = without_lines(log, acquisition)
        acquisition = acquisition_of(log, rig.file_noise_std)
    taken_apart = without_means(log)
    if taken_apart is not log:
        log, acquisition = taken_apart, acquisition_of(taken_apart, rig.file_noise_std)
    clock = acquisition.clock
    if clock.resolution_s:
        log = replace(log, t=even(log.t, clock.interval_s, clock.resolution_s))
    return log, acquisition, lines


def fresh_readings(log: Log, acquisition: Acquisition, rig: Rig, coarse: bool = False) -> Log:
    """A log with NaN for readings that say nothing new, or are spikes. coarse: whether those count that stand in steps."""
    voltage, current, position = (c._replace(resolution=None) if coarse else c for c in acquisition[:3])
    seen = Acquisition(voltage, current, position, acquisition.clock)
    fresh = FreshReadings(seen, log.rate_hz, rig.file_noise_std).take(log)
    fresh = without_late_updates(fresh, log, acquisition)
    return in_time(without_spikes(fresh, acquisition), acquisition)


def without_late_updates(fresh: Log, log: Log, acquisition: Acquisition) -> Log:
    """Fresh readings of channels that are held, without those that may have come in a row before, which is missing in the log."""
    held = np.array([channel.update_hz is not None for channel in acquisition[:3]])
    unread = np.asarray(np.isnan(log.z).all(axis=1))
    if not held.any() or not unread.any():
        return fresh
    z = fresh.z.copy()
    z[1:][np.outer(unread[:-1], held)] = np.nan
    return replace(fresh, z=z)


def in_time(log: Log, acquisition: Acquisition) -> Log:
    """The log with the readings that are means of samples at the middle of those, which they are later than.

    Means of a few samples are told by the colour of their noise alone, which readings without their filter have as well.
    """
    many = [channel.averaged if channel.averaged >= _MEAN else 1 for channel in acquisition[:3]]
    if max(many) == 1:
        return log
    late = [0.5 * (averaged - 1) / log.rate_hz for averaged in many]
    columns = [earlier(log.t, y, by) if by else y for y, by in zip(log.z.T, late, strict=True)]
    return replace(log, z=np.column_stack(columns))


def without_drive_off(log: Log, acquisition: Acquisition) -> Log:
    """The log with NaN for voltage and current where the drive is off: both at their zero for long, at a rest after a move.

    A servo that is on holds the current at which friction stopped the mass. One that is off later was so before the first move.
    """
    zero = np.array([acquisition.voltage.offset, acquisition.current.offset])
    noise = np.array([math.hypot(c.noise_std, c.resolution or 0.0) for c in acquisition[:2]])
    still = log.w_cmd == 0.0
    off = _closed((np.abs(log.z[:, :2] - zero) <= _OFF * noise).all(axis=1) & still) & still
    long = [(a, b) for a, b in zip(*runs(off), strict=True) if log.t[b - 1] - log.t[a] > _OFF_S]
    if not any((log.w_cmd[:first] != 0.0).any() for first, _ in long):
        return log
    z = log.z.copy()
    for first, last in long:
        z[first:last, :2] = np.nan
    return replace(log, z=z)


def _closed(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask (n,) with its shortest holes filled: a reading in many is far off."""
    closed = mask.copy()
    for first, last in zip(*runs(~mask), strict=True):
        if last - first <= _HOLE and first > 0 and last < mask.size:
            closed[first:last] = True
    return closed


def since_change(t: Array, w_cmd: Array) -> Array:
    """(n,) time since the command last changed, 0 at the sample before it does [s]; infinite before the first change."""
    changes = np.abs(np.diff(w_cmd, append=w_cmd[-1])) > 1e-9
    last = np.maximum.accumulate(np.where(changes, np.arange(t.size), -1))
    return np.where(last >= 0, t - t[np.maximum(last, 0)], np.inf)


def _held_together(acquisition: Acquisition) -> bool:
    """Whether one converter reads voltage and current, and holds both."""
    voltage, current = acquisition.voltage.update_hz, acquisition.current.update_hz
    return voltage is not None and current is not None and math.isclose(voltage, current, rel_tol=_ALIKE)


def _plain(channel: ChannelTraits) -> bool:
    """Whether white noise is all that a logger adds to a channel, as far as its rests show."""
    if channel.resolution is not None or channel.update_hz is not None or channel.lines:
        return False
    return channel.correlation_s is None and channel.averaged == 1 and channel.grown == 1.0


def _usual(noise: Array) -> float:
    known = noise[np.isfinite(noise)]
    return float(np.median(known)) if known.size else math.nan


def _settled_noise(log: Log) -> Array:
    """(3,) standard deviation of the white noise of each channel, from second differences; robust to transients."""
    settled = since_change(log.t, log.w_cmd)[1:-1] > _SETTLED_S
    second = np.abs(np.diff(log.z, 2, axis=0))[settled]
    return np.array([_white_std(second[:, c]) for c in range(3)])


def _white_std(second: Array) -> float:
    """Standard deviation of white noise from the sizes of its second differences, without outliers."""
    y = second[np.isfinite(second)]
    if y.size < _FEWEST:
        return math.nan
    usual = y <= 5.9 * np.median(y)  # four standard deviations
    return float(np.sqrt(np.mean(y[usual] ** 2) / 6.0))
