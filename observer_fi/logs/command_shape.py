"""A commanded speed that is no trapezoid with the ramps of its rig: other ramps, S-curves, sines, tables.

Where levels with ramps of a known acceleration between them do not describe how a motor is brought up to speed, what its servo
shows of the command is the command, but for its noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.moves import quarter_of_a_ring, settling_time
from observer_fi.numerics import constant_runs
from observer_fi.physics import Model
from observer_fi.records import Array, Log

Mask = NDArray[np.bool_]

AT_SPEED = 0.9  # of the first speed: up to there a motor is brought up to it
# Mean over the way up, as a share of that speed, by which what is shown is off: of a steep ramp a winding of another
# resistance shows as much as the first; behind the ring of one, stairs through a soft ramp are off by more than the second.
OFF, OFF_LONG = 0.1, 0.05
OF_RAMP = 8.0  # of the way up, the part that samples around one may span, whose mean it is
AT_LIMIT, LIMITED = 0.97, 0.3  # of the highest voltage of a log: a supply gives no more; of a short way up
CLEARLY = 6.0  # standard deviations of a sample, by which it is off at least
STANDS = 3.0  # standard deviations of such a mean: what is less at the ends of a rest is one
MOST = 0.8  # of a level: the crest of a sine is no level
BEFORE = 5  # samples before a hole, that tell how steep the command is


class Level(NamedTuple):
    """Samples [first, last] over which what is shown stands still at `seen`, for a command of `speed` [rad/s]."""

    first: int
    last: int
    seen: float
    speed: float

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.first, self.last + 1)


class Shown(NamedTuple):
    """What a servo shows of its command: (n,) [rad/s], where it can be believed, and its noise, 1 sigma [rad/s].

    full: (n,) where its voltage has reached the supply of the rig file.
    """

    command: Array
    known: Mask
    noise: float
    full: Mask


def as_shown(log: Log, shown: Shown, w_cmd: Array, levels: Sequence[Level], model: Model) -> Array | None:
    """The command (n,) [rad/s] as it is shown, smoothed; None where `w_cmd` (n,) through levels describes how it begins.

    None, too, where nothing tells: of a log that begins in motion, and of a short ramp whose supply was at its limit.
    model: of the servo, for how long it rings.
    """
    first = next((level.speed for level in levels if level.speed), 0.0)
    if not first or levels[0].speed or levels[0].first > 0:
        return None
    whole, starts = _bridged(log.t, shown.command, shown.known), levels[0].last + 1
    there = np.abs(whole[starts:]) >= AT_SPEED * abs(first)
    up = slice(starts, starts + int(np.argmax(there)))
    off = np.abs(shown.command - w_cmd)[up][shown.known[up]]
    takes = float(log.t[up.stop] - log.t[starts]) if there.any() else 0.0
    long = takes > settling_time(model)
    limited = (shown.full | _highest(log.z[:, 0]))[up]
    if off.size < 2 * BEFORE or (not long and float(limited.mean()) > LIMITED):
        return None
    if float(off.mean()) < max((OFF_LONG if long else OFF) * abs(first), CLEARLY * shown.noise):
        return None
    span = min(quarter_of_a_ring(model), takes / OF_RAMP)
    count = 2 * round(0.5 * span / float(np.median(np.diff(log.t)))) + 1
    smooth = _with_levels(_smoothed(whole, count), levels, STANDS * shown.noise, count)
    return _with_corners(smooth, whole, count)


def _highest(voltage: Array) -> Mask:
    """Where a voltage (n,) is next to the highest of the log, or is not read: that may be all that the supply has."""
    size = np.abs(voltage)
    return ~(size < AT_LIMIT * np.nanmax(size, initial=0.0))


def _bridged(t: Array, shown: Array, known: Mask) -> Array:
    """What is shown, and through holes a ramp that goes on as before them until it has reached what is shown behind."""
    out = np.interp(t, t[known], shown[known])
    for a, b in constant_runs(known.astype(np.int8)):
        before = np.arange(max(a - BEFORE, 0), a)
        if known[a] or b >= t.size or before.size < BEFORE or not known[before].all():
            continue
        rise, left = out[before[-1]] - out[before[0]], out[b] - out[a - 1]
        slope = rise / (t[before[-1]] - t[before[0]])
        if slope * left > 0.0:
            out[a:b] = out[a - 1] + np.sign(left) * np.minimum(abs(left), abs(slope) * (t[a:b] - t[a - 1]))
    return out


def _with_levels(smooth: Array, levels: Sequence[Level], near_by: float, count: int) -> Array:
    """The smoothed command, less what the first rest is off 0, at one speed where a rest or most of a level stands still.

    near_by: of a single sample [rad/s]; count: of samples in a mean, which at the end of a log tells less.
    """
    out, least = smooth - np.median(smooth[levels[0].samples]), near_by / count**0.5
    for level in levels:
        near = np.flatnonzero(np.abs(out[level.samples] - level.speed) < least)
        if near.size > (0 if level.speed == 0.0 else MOST * (level.last + 1 - level.first)):
            begin = 0 if level.first == 0 else level.first + int(near[0])
            end = level.first + int(near[-1]) + 1
            over = level is levels[-1] and (np.abs(out[end:] - level.speed) < near_by).all()
            out[begin : None if over else end] = level.speed
    return _with_last_rest(out, near_by, least)


def _with_corners(smooth: Array, whole: Array, count: int) -> Array:
    """The smoothed command (n,) with the corners of its levels, those of constant speed, as sharp as `whole` (n,) shows them."""
    for a, b in constant_runs((np.diff(smooth, append=np.nan) == 0.0).astype(np.int8)):
        if b < smooth.size and smooth[a] == smooth[b]:
            _straighten(smooth[:a], whole[:a], smooth[a], count)
            _straighten(smooth[b + 1 :][::-1], whole[b + 1 :][::-1], smooth[a], count)
    return smooth


def _straighten(smooth: Array, whole: Array, level: float, count: int) -> None:
    """Let a ramp before a level, at the end of (n,) samples, go straight up to it in place of means over `count` samples, which
    round its corner, where that describes what is shown better: a command that is not 0 yet is motion.
    """
    if smooth.size < 2 * count:
        return
    at = np.arange(-2 * count, 0)
    slope, end = np.polyfit(at[:count], whole[at[:count]] - level, 1)
    line, way = slope * at[count:] + end, np.sign(whole[at[:count]].mean() - level)
    line = level + np.where(way * line < 0.0, 0.0, line)
    near = whole[-count:]
    if float(((near - line) ** 2).sum()) < float(((near - smooth[-count:]) ** 2).sum()):
        smooth[-count:] = line


def _with_last_rest(command: Array, near_by: float, least: float) -> Array:
    """The command, 0 from where it first is within `least` [rad/s] of that if it stays `near_by` to the end: a rest too short for
    a level."""
    away = np.flatnonzero(np.abs(command) >= near_by)
    ends = int(away[-1]) + 1 if away.size else 0
    rest = np.flatnonzero(np.abs(command[ends:]) < least)
    if rest.size:
        command[ends + int(rest[0]) :] = 0.0
    return command


def _smoothed(values: Array, count: int) -> Array:
    """Means of `count` samples around each; at the ends, where a log may begin or stop in a ramp, the line through as many."""
    from scipy.signal import savgol_filter  # a second to import, for logs without a command

    return np.asarray(savgol_filter(values, count, 1)) if count > 1 else values
