"""Stretches of a log in which the motor turns one way, with its readings as they were fresh.

A reading that is held is as old as it stands: taken as it is, a position of 100 Hz made an inertia 20 % smaller, and a current
of every second row a resistance 15 % larger, both within a percent by their standard errors. Rows are those in which voltage and
current are fresh, the other channels lie on a smooth curve through their updates, and a position counts where it was one.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used
from numpy.typing import NDArray

from observer_fi.learn.fit_readings import fresh_readings, without_logger
from observer_fi.logs import change_rate, position_speed
from observer_fi.numerics import between_near, constant_runs, filled
from observer_fi.physics import Model, Rig, speed
from observer_fi.records import Acquisition, Array, ChannelTraits, Log

WINDOW_S = 0.25
SLOWEST = 0.05  # of the fastest speed: below it the sign of friction is in doubt
SMOOTH_S = 0.02  # over which the speed is averaged to find where the motor turns
TURNS = 20.0  # rad/s: a motor slower than this stands
FEWEST = 4  # positions in a window, and readings of a curve
# Times as far apart as rows usually are, or seconds: more is missing than an integral goes over. Three rows that are lost, or
# a few more of a fast logger, are no break.
_GAP, _GAP_S = 4.5, 3e-3
_LONGEST = 3.0  # times between two updates of a held channel, over which a curve goes
_TOGETHER = 0.8  # of the updates of one channel are those of another
_DRIVES = (0, 1)  # voltage and current
_POSITION = 2
MOVES, _SURE = 0.5, 3.0  # of a motion, from which on it is one, and standard errors by which it is none


class Window(NamedTuple):
    """One stretch of motion one way: times from its start [s], readings, pitch [deg], motor speed [rad/s], direction.

    seen: times [s] and values (k,) [m] of the positions that were fresh; every row's, by default.
    """

    t: Array
    z: Array
    pitch: Array
    w: Array
    sign: float
    seen: tuple[Array, Array] | None = None

    @property
    def positions(self) -> tuple[Array, Array]:
        """Times [s] and values [m] of the positions."""
        return (self.t, self.z[:, _POSITION]) if self.seen is None else self.seen

    def where_seen(self, G: Array) -> Array:
        """(k, ...) columns G (n, ...) at the times of the positions."""
        return G if self.seen is None else at_times(self.t, G, self.seen[0])

    def with_position_earlier(self, late: float) -> "Window":
        """The window whose positions are taken for as much earlier as they are late [s]; none outside it."""
        at, x = self.positions
        inside = (at - late >= 0.0) & (at - late <= self.t[-1])
        return self._replace(seen=(at[inside] - late, x[inside]))

    def every_second(self, first: int) -> "Window":
        """The window with every second of its rows."""
        rows = slice(first, None, 2)
        t = self.t[rows]
        at, x = self.positions
        near = (t[0] <= at) & (at <= t[-1])
        seen = None if self.seen is None else (at[near] - t[0], x[near])
        return Window(t - t[0], self.z[rows], self.pitch[rows], self.w[rows], self.sign, seen)


def interval_of(windows: Sequence[Window]) -> float:
    """The usual time from a row to the next [s]."""
    return float(np.median(np.concatenate([np.diff(w.t) for w in windows])))


class Ahead(NamedTuple):
    """What the voltage of a winding has beside Rm i + Km w: that of an inductance [H], and a drop [V] that changes its sign with
    the current, within a knee [A].
    """

    inductance: float = 0.0
    drop: float = 0.0
    knee: float = 1.0

    def of(self, log: Log) -> Array:
        """(n,) that voltage [V]."""
        i = log.z[:, 1]
        rate = change_rate(log.t, i, 1) if self.inductance else 0.0
        return np.asarray(self.inductance * rate + self.drop * np.tanh(i / self.knee))


class Driven(NamedTuple):
    """A log whose rows are fresh; seen: times [s] and values (k,) [m] of the positions that were. rounding: what the steps of a
    converter leave in a steady voltage [V] and current [A], standard deviations.
    """

    log: Log
    seen: tuple[Array, Array]
    rounding: tuple[float, float] = (0.0, 0.0)


def driven(log: Log, rig: Rig) -> Driven:
    """What a log tells of a motor that it drives, without what its logger does."""
    log, acquisition, _ = without_logger(_without_false_rest(log), rig)
    fresh = fresh_readings(log, acquisition, rig, coarse=True)
    held = _held(acquisition)
    rows = _rows(fresh, [c for c in _DRIVES if held[c]])
    rows = rows[
        np.isfinite(log.z[rows]).any(axis=1)
    ]  # on its clock a log has those that are missing, without readings
    z = np.column_stack([_curve(fresh, log, c, held[c])[rows] for c in range(3)])
    read = np.isfinite(fresh.z[:, _POSITION])
    seen = log.t[read], fresh.z[read, _POSITION]
    return Driven(replace(log.part(rows), z=z), seen, (_left_of(acquisition[0]), _left_of(acquisition[1])))


def _left_of(channel: ChannelTraits) -> float:
    """What steps leave in the mean of a steady reading, whose noise of a third of a step carries it over them: the first harmonic
    of a rounding error (B. Widrow and I. Kollar, Quantization Noise, 2008).
    """
    step = channel.resolution
    if not step:
        return 0.0
    noise = math.sqrt(max(channel.noise_std**2 - step**2 / 12.0, 0.0))
    return step / (math.pi * math.sqrt(2.0)) * math.exp(-2.0 * (math.pi * noise / step) ** 2)


def _without_false_rest(log: Log) -> Log:
    """A log without a command that stands from beginning to end: of a loop whose speed and torque are fed forward the error makes
    none, and the whole log would be a rest.
    """
    return log if log.w_cmd.any() or not log.z.any() else replace(log, w_cmd=np.full(log.t.size, np.nan))


def windows_of(each: Driven, rig: Rig, ahead: Ahead | None = None) -> list[Window]:
    """Stretches of `WINDOW_S` in which the motor turns one way and nothing is missing.

    ahead: voltage of an inductance, at a start, or of brushes, while the motor stands; it seems to turn by that.
    """
    log = each.log
    more = ahead.of(log) if ahead else np.zeros(log.t.size)
    w, smooth = speed_of(replace(log, z=log.z - np.outer(more, (1.0, 0.0, 0.0))), rig.model)
    sign = np.where(
        np.abs(smooth) > max(SLOWEST * float(np.nanmax(np.abs(smooth), initial=0.0)), TURNS),
        np.sign(smooth),
        0.0,
    )
    channels = log.z[:, 1:] if np.isnan(log.z[:, 0]).all() else log.z
    sign[~np.isfinite(channels).all(axis=1)] = 0.0
    size = round(WINDOW_S * log.rate_hz)
    most = max(_GAP * float(np.median(np.diff(log.t))), _GAP_S)
    found = []
    for a, b in constant_runs(sign):
        if sign[a] == 0.0:
            continue
        for first in range(a, b - size // 2, size):
            rows = slice(first, min(first + size, b))
            if np.diff(log.t[rows]).max() < most:
                t = log.t[rows] - log.t[first]
                seen = _seen(each, log.t[rows])
                found.append(Window(t, log.z[rows], log.pitch[rows], w[rows], float(sign[a]), seen))
    return _moved([w for w in found if w.positions[0].size >= FEWEST])


def _moved(windows: list[Window]) -> list[Window]:
    """The windows in which the position moves with the speed as it does in all of them: what a voltage has beside a current and
    a speed looks like motion at rest.
    """
    if not windows:
        return windows
    pairs = [_angle_and_position(w) for w in windows]
    pitch = sum(float(a @ x) for a, x in pairs) / max(sum(float(a @ a) for a, _ in pairs), 1e-300)
    return [w for w, pair in zip(windows, pairs, strict=True) if not _stays(*pair, pitch)]


def _angle_and_position(w: Window) -> tuple[Array, Array]:
    """Angle of the motor [rad] and position [m] where that was read, each from its mean."""
    angle = np.append(0.0, np.cumsum(0.5 * (w.w[1:] + w.w[:-1]) * np.diff(w.t)))
    seen, x = w.where_seen(angle), w.positions[1]
    return seen - seen.mean(), x - x.mean()


def _stays(angle: Array, x: Array, pitch: float) -> bool:
    """Whether the position moves by less than `MOVES` of what the angle says, beyond doubt. pitch: in all windows [m/rad]."""
    size = max(float(angle @ angle), 1e-300)
    slope = float(angle @ x) / size
    left = x - slope * angle
    std = float(np.sqrt(left @ left / max(x.size - 2, 1) / size))
    return pitch > 0.0 and slope + _SURE * std < MOVES * pitch


def _seen(each: Driven, t: Array) -> tuple[Array, Array] | None:
    """Times from the first of t (n,) and values of the positions within them, None where every row has its own."""
    at, x = each.seen
    own = slice(*np.searchsorted(at, (t[0], np.nextafter(t[-1], np.inf))))
    same = at[own].size == t.size and bool((at[own] == t).all())
    return None if same else (at[own] - t[0], x[own])


def at_times(t: Array, y: Array, at: Array) -> Array:
    """(k, ...) a smooth curve through y (n, ...) at the times t (n,), at others (k,) within them."""
    curve = scipy.interpolate.Akima1DInterpolator(t, y, method="makima")
    return np.asarray(curve(np.clip(at, t[0], t[-1])), dtype=np.float64)


def _held(acquisition: Acquisition) -> list[bool]:
    """(3,) whether a channel is held."""
    return [channel.update_hz is not None or channel.hold_s is not None for channel in acquisition[:3]]


def _rows(fresh: Log, held: Sequence[int]) -> NDArray[np.intp]:
    """The rows in which all held channels are fresh, or the one that is so the most rarely where they are not so together."""
    if not held:
        return np.arange(fresh.t.size)
    there = np.isfinite(fresh.z[:, held])
    rarest = there[:, int(np.argmin(np.count_nonzero(there, axis=0)))]
    together = there.all(axis=1)
    return np.flatnonzero(
        together if np.count_nonzero(together) > _TOGETHER * np.count_nonzero(rarest) else rarest
    )


def _curve(fresh: Log, log: Log, c: int, held: bool) -> Array:
    """(n,) readings of a channel, those of a held one on a smooth curve through its updates; NaN where it was not read."""
    z, there = fresh.z[:, c], np.isfinite(fresh.z[:, c])
    if np.count_nonzero(there) < FEWEST:
        return z
    if not held:  # what is missing beside the log's own holes are spikes
        read = np.isfinite(log.z[:, c])
        return np.where(read | between_near(log.t, read, _LONGEST), filled(z, log.t), np.nan)
    y = scipy.interpolate.Akima1DInterpolator(log.t[there], z[there], method="makima")(log.t)
    return np.where(there | between_near(log.t, there, _LONGEST), y, np.nan)


def speed_of(log: Log, model: Model) -> tuple[Array, Array]:
    """Motor speed of equation 16, or from the position where no voltage is logged, and the same smoothed."""
    size = max(1, round(SMOOTH_S * log.rate_hz))
    kernel = np.ones(size) / size
    if np.isnan(log.z[:, 0]).all() or model["Rm"] == 0.0:
        w = position_speed(log.t, log.z[:, 2], model["D"]).w
        return w, w
    w = filled(speed(log.z, model.vector))
    return w, np.convolve(w, kernel, "same")
