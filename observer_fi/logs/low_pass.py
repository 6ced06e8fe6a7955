"""Low-pass filters that a logger puts before its readings, and readings without them.

A clamp, an amplifier or an anti-aliasing filter lets a current come after the motion that it causes: no model of the actuator
knows that. What is taken out is a filter without zeros, of order one or of Butterworth's second; noise that comes after it
grows by that. Who looks for one: `verdict` at the first start of a log, `learn` at the starts of a campaign.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.numerics import digits
from observer_fi.physics import COLUMNS, Rig
from observer_fi.records import CHANNELS, Acquisition, Array, Filter, Log

FAST_HZ = 300.0  # corner of a filter that takes away nothing of what is looked for
FEWEST = 4  # readings that can be interpolated
GAP = 1.5  # intervals between two samples from which one is missing


class LowPass(NamedTuple):
    """A filter before the readings of one channel. corner_hz: infinite where there is none; order: one, or Butterworth's two.

    late: samples by which it is later than that; `lateness` measures them anew.
    """

    corner_hz: float = math.inf
    order: int = 1
    late: float = 0.0

    @property
    def delay_s(self) -> float:
        """By which what is slow comes later."""
        return (1.0 if self.order == 1 else math.sqrt(2.0)) / (2.0 * math.pi * self.corner_hz)

    def weights(self, interval: float) -> tuple[float, float, float]:
        """By which a reading, the one before and that before it make what went into the filter; their sum is 1."""
        if math.isinf(self.corner_hz):
            return 1.0, 0.0, 0.0
        reach = 2.0 * math.pi * self.corner_hz * interval
        if self.order == 1:
            once, twice = math.exp(-reach), 0.0
        else:
            part = reach / math.sqrt(2.0)
            once, twice = 2.0 * math.exp(-part) * math.cos(part), -math.exp(-2.0 * part)
        rest = 1.0 - once - twice
        return 1.0 / rest, -once / rest, -twice / rest

    def left(self, interval: float) -> float:
        """Samples by which what is slow comes later through this filter than `weights` take out."""
        if math.isinf(self.corner_hz):
            return 0.0
        _, once, twice = self.weights(interval)
        return self.delay_s / interval + once + 2.0 * twice


class LowPasses(NamedTuple):
    """The filters before voltage, current and position."""

    voltage: LowPass = LowPass()
    current: LowPass = LowPass()
    position: LowPass = LowPass()

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return any(math.isfinite(own.corner_hz) for own in self)

    @property
    def told(self) -> tuple[Filter, ...]:
        """Those that there are, as records have them."""
        named = zip(CHANNELS, self, strict=True)
        return tuple(Filter(name, *own) for name, own in named if math.isfinite(own.corner_hz))

    def of(self, channels: tuple[int, ...], own: LowPass) -> "LowPasses":
        """The same with another filter before some channels."""
        return LowPasses(*(own if c in channels else kept for c, kept in enumerate(self)))


class Unfiltered:
    """What went into the filters of one log, chunk by chunk. interval: of samples [s]."""

    def __init__(self, filters: LowPasses, interval: float) -> None:
        self.filters, self.interval = filters, interval
        self.before = np.full((2, 3), np.nan)
        self.time = math.nan

    def take(self, log: Log) -> Log:
        """The next chunk; before the first sample the readings were what that one is, and behind a gap none is known."""
        if not self.filters.any or not log.t.size:
            return log
        if math.isnan(self.time):
            self.before[:] = log.z[0]
        apart = np.diff(np.append(self.time, log.t)) > GAP * self.interval
        known = np.vstack((self.before, log.z))
        out = log.z.copy()
        for c, own in enumerate(self.filters):
            if math.isfinite(own.corner_hz):
                now, once, twice = own.weights(self.interval)
                out[:, c] = now * known[2:, c] + once * known[1:-1, c]
                out[:, c] += twice * known[:-2, c] if own.order > 1 else 0.0
                out[apart, c] = np.nan
                if own.order > 1:
                    out[1:, c][apart[:-1]] = np.nan
        self.before, self.time = known[-2:].copy(), float(log.t[-1])
        return replace(log, z=out)


def unfiltered(log: Log, told: Iterable[Filter]) -> Log:
    """A whole log as it would be without filters, at the time of its other channels.

    By how much a filter is later than what `Unfiltered` takes out is a part of a sample: between readings it is interpolated.
    """
    taken = {own.channel: LowPass(own.corner_hz, own.order, own.late) for own in told}
    if not taken:
        return log
    filters, interval = LowPasses(**taken), 1.0 / log.rate_hz
    out = Unfiltered(filters, interval).take(log)
    z = out.z.copy()
    for c, own in enumerate(filters):
        if math.isfinite(own.corner_hz):
            z[:, c] = _earlier(log.t, z[:, c], own.late * interval)
    return replace(out, z=z)


def _earlier(t: Array, y: Array, by: float) -> Array:
    """Readings (n,) as they are so much later [s]; NaN where none is near."""
    from scipy.interpolate import Akima1DInterpolator  # slow to import, and `diagnose` does without

    there = np.isfinite(y)
    if there.sum() < FEWEST:
        return y
    smooth = Akima1DInterpolator(t[there], y[there], method="makima")
    moved = smooth(np.clip(t + by, t[there][0], t[there][-1]))
    return np.where(there, moved, np.nan)


def with_low_passes(acquisition: Acquisition, filters: Iterable[Filter]) -> Acquisition:
    """What a logger does, with these filters and no others."""
    corners = {own.channel: own.corner_hz for own in filters}
    pairs = zip(CHANNELS, acquisition[:3], strict=True)
    voltage, current, position = (traits._replace(low_pass_hz=corners.get(name)) for name, traits in pairs)
    return Acquisition(voltage, current, position, acquisition.clock)


def told_filter(own: Filter) -> str:
    """What to say of a filter that was taken out of the readings."""
    return (
        f"{COLUMNS[own.channel]} comes through a low-pass filter of {digits(own.corner_hz)} Hz, of order {own.order}: taken "
        f"out of its readings; log it without, or with a corner above {digits(FAST_HZ)} Hz"
    )


def filtered_logger(rig: Rig, filters: Iterable[Filter]) -> Rig:
    """The rig whose logger has these filters; as it is where nothing is known of its logger."""
    return replace(rig, logger=with_low_passes(rig.logger, filters)) if rig.logger else rig
