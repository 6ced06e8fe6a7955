"""A commanded speed that is no trapezoid with the ramps of its rig: other ramps, S-curves, sines, tables.

Where levels with ramps of a known acceleration between them do not describe how a motor is brought up to speed, what its servo
shows of the command is the command, but for its noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import constant_runs
from observer_fi.records import Array

Mask = NDArray[np.bool_]

AT_SPEED = 0.9  # of the first speed: up to there a motor is brought up to it
# Mean over the way up, as a share of that speed, by which what is shown is off: of a steep ramp a winding of another
# resistance shows as much as the first; behind the ring of one, stairs through a soft ramp are off by more than the second.
OFF, OFF_LONG, RINGS_S = 0.1, 0.05, 0.08
SMOOTH_S, OF_RAMP = 0.01, 8.0  # of samples around one, whose mean it is: no more than that part of the way up
LIMITED = 0.3  # of a short way up
CLEARLY = 6.0  # standard deviations of a sample, by which it is off at least
STANDS = 3.0  # standard deviations of such a mean: what is less at the ends of a rest is one
MOST = 0.8  # of a level: the crest of a sine is no level
BEFORE = 5  # samples before a hole, that tell how steep the command is


class Shown(NamedTuple):
    """What a servo shows of its command: (n,) [rad/s], where it can be believed, and its noise, 1 sigma [rad/s].

    limited: (n,) where its voltage may be all that the supply has.
    """

    command: Array
    known: Mask
    noise: float
    limited: Mask


class Level(NamedTuple):
    """Samples over which a command stands still at a speed [rad/s]."""

    samples: slice
    speed: float


def as_shown(t: Array, shown: Shown, w_cmd: Array, levels: Sequence[Level]) -> Array:
    """`w_cmd` (n,) [rad/s] through levels, or what is shown, smoothed, where the motor is first brought up to speed otherwise.

    t: times [s]. Nothing tells how a log began that begins in motion, nor a short ramp whose supply was at its limit.
    """
    first = next((level.speed for level in levels if level.speed), 0.0)
    if not first or levels[0].speed or levels[0].samples.start > 0:
        return w_cmd
    whole, starts = _bridged(t, shown.command, shown.known), levels[0].samples.stop
    there = np.abs(whole[starts:]) >= AT_SPEED * abs(first)
    up = slice(starts, starts + int(np.argmax(there)))
    off = np.abs(shown.command - w_cmd)[up][shown.known[up]]
    takes = float(t[up.stop] - t[starts]) if there.any() else 0.0
    long = takes > RINGS_S
    if off.size < 2 * BEFORE or (not long and float(shown.limited[up].mean()) > LIMITED):
        return w_cmd
    if float(off.mean()) < max((OFF_LONG if long else OFF) * abs(first), CLEARLY * shown.noise):
        return w_cmd
    count = 2 * round(0.5 * min(SMOOTH_S, takes / OF_RAMP) / float(np.median(np.diff(t)))) + 1
    return _with_levels(_smoothed(whole, count), levels, STANDS * shown.noise / count**0.5)


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


def _with_levels(smooth: Array, levels: Sequence[Level], least: float) -> Array:
    """The smoothed command, less what the first rest is off 0, at one speed where most of a level is within `least` of it."""
    out = smooth - np.median(smooth[levels[0].samples])
    for samples, speed in levels:
        near = np.flatnonzero(np.abs(out[samples] - speed) < least)
        if near.size > MOST * (samples.stop - samples.start):
            begin = 0 if samples.start == 0 else samples.start + int(near[0])
            out[begin : samples.start + int(near[-1]) + 1] = speed
    tail = levels[-1].samples
    if levels[-1].speed == 0.0 and tail.start > 0 and (np.abs(out[tail.stop :]) < 2.0 * least).all():
        out[tail.stop :] = 0.0
    return out


def _smoothed(values: Array, count: int) -> Array:
    """Means of `count` samples around each, of fewer at the ends."""
    around = np.ones(count)
    return np.convolve(values, around, "same") / np.convolve(np.ones(values.size), around, "same")
