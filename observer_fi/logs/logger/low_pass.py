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
from numpy.typing import NDArray

from observer_fi.numerics import digits
from observer_fi.physics import COLUMNS, Rig
from observer_fi.records import CHANNELS, Acquisition, Array, ChannelTraits, Filter, Log

FAST_HZ = 300.0  # corner of a filter that takes away nothing of what is looked for
FEWEST = 4  # readings that can be interpolated
TIMED = 0.1  # of a sample by which readings that were taken for earlier may still be late
BENT = 12.0  # times the median, eight standard deviations of noise
GAP = 1.5  # intervals between two samples from which one is missing


class LowPass(NamedTuple):
    """A filter before the readings of one channel. corner_hz: infinite where there is none; order: one, or Butterworth's two.

    late: samples by which it is later than that, and where there is no filter; `lateness` measures them anew.
    """

    corner_hz: float = math.inf
    order: int = 1
    late: float = 0.0

    @property
    def is_none(self) -> bool:
        """Whether readings come as they are."""
        return math.isinf(self.corner_hz) and self.late == 0.0

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
        """Those that there are, as records have them, and what is late without one."""
        named = zip(CHANNELS, self, strict=True)
        return tuple(Filter(name, *own) for name, own in named if not own.is_none)

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


def behind_steps(now: ChannelTraits, read: ChannelTraits, own: LowPass, interval: float) -> ChannelTraits:
    """Traits of readings without their filter where they came in steps, which are not to be seen any more.

    now: as they look then, read: as they came. Rounding comes after a filter, and is more without it; no rest tells it.
    """
    if math.isinf(own.corner_hz) or read.resolution is None:
        return now
    as_white = max(now.as_white, math.hypot(*own.weights(interval)) * read.as_white)
    return now._replace(as_white=as_white, resolution=read.resolution, repeats=read.repeats, grown=read.grown)


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
        if not own.is_none:
            z[:, c] = earlier(log.t, z[:, c], own.late * interval)
    return replace(out, z=z)


def timing_doubt(told: Iterable[Filter]) -> Array:
    """(3,) samples by which the readings of a channel may be off in time once its filter or delay is taken out."""
    channels = {own.channel for own in told}
    return np.array([TIMED if name in channels else 0.0 for name in CHANNELS])


def earlier(t: Array, y: Array, by: float) -> Array:
    """Readings (n,) as they are so much later [s]; NaN where none is near, or where they bend too sharply between samples.

    The polynomial through the four readings around: what it does to noise is the same everywhere.
    """
    if t.size < FEWEST or by == 0.0:
        return y
    at = t + by
    first = np.clip(np.searchsorted(t, at, side="right") - 2, 0, t.size - FEWEST)
    nodes = first[:, None] + np.arange(FEWEST)
    moved = np.einsum("nk,nk->n", _lagrange(t[nodes], at), y[nodes])
    outside = (at < t[0]) | (at > t[-1])
    return np.where(np.isnan(y) | outside | _bent(y)[nodes].any(axis=1), np.nan, moved)


def _lagrange(nodes: Array, at: Array) -> Array:
    """(n, k) weights of the polynomials through readings at nodes (n, k), at the times (n,)."""
    weights = np.ones_like(nodes)
    for k in range(nodes.shape[1]):
        others = np.delete(nodes, k, axis=1)
        weights[:, k] = np.prod((at[:, None] - others) / (nodes[:, [k]] - others), axis=1)
    return weights


def _bent(y: Array) -> NDArray[np.bool_]:
    """(n,) readings at which the line through them bends by far more than noise, and usual motion, makes it."""
    bend = np.abs(np.diff(y, n=2))
    known = np.isfinite(bend)
    usual = BENT * float(np.median(bend[known])) if known.any() else math.inf
    return np.concatenate(([False], known & (bend > usual) & (usual > 0.0), [False]))


def with_low_passes(acquisition: Acquisition, filters: Iterable[Filter]) -> Acquisition:
    """What a logger does, with these filters and no others."""
    corners = {own.channel: own.corner_hz for own in filters if math.isfinite(own.corner_hz)}
    pairs = zip(CHANNELS, acquisition[:3], strict=True)
    voltage, current, position = (traits._replace(low_pass_hz=corners.get(name)) for name, traits in pairs)
    return Acquisition(voltage, current, position, acquisition.clock)


def told_filter(own: Filter) -> str:
    """What to say of a filter or a delay that was taken out of the readings."""
    if math.isinf(own.corner_hz):
        return (
            f"{COLUMNS[own.channel]} is read {digits(own.late)} of a sample later than the other channels: its readings "
            "are taken for earlier by that; read them at the same instant"
        )
    return (
        f"{COLUMNS[own.channel]} comes through a low-pass filter of {digits(own.corner_hz)} Hz, of order {own.order}: taken "
        f"out of its readings; log it without, or with a corner above {digits(FAST_HZ)} Hz"
    )


def filtered_logger(rig: Rig, filters: Iterable[Filter], rate_hz: float) -> Rig:
    """The rig whose logger has these filters, of logs of so many samples a second; as it is where nothing is known of its logger.

    What is late beside a known servo is measured anew in each log; beside an unknown one not every start tells it.
    """
    if not rig.logger:
        return rig
    told = tuple(filters)
    seen = with_low_passes(rig.logger, told)
    if rig.driven.servo:
        return replace(rig, logger=seen)
    late = {own.channel: own.late / rate_hz for own in told if math.isinf(own.corner_hz)}
    pairs = zip(CHANNELS, seen[:3], strict=True)
    voltage, current, position = (traits._replace(late_s=late.get(name, 0.0)) for name, traits in pairs)
    return replace(rig, logger=Acquisition(voltage, current, position, seen.clock))
