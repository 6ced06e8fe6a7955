"""A drive that is switched off at rest: from there on voltage and current tell of no actuator."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.records import Array, Estimate, Log

# Standard deviations that voltage and current of a drive that is off stay below, and from which they drop there in so long, as no
# motor does that sticks (18 in 30 stops); of the readings' offsets there; samples that tell it.
NOTHING, DROP, DROP_S, OFFSETS, OFF = 5.0, 25.0, 3e-3, 8.0, 8
ALL = 0.99  # of them, but for spikes


def without_off(e: Estimate, log: Log, noise: Array) -> Estimate:
    """The estimate of a log's samples, with no evidence in those of a rest in which the drive is off."""
    off = is_off(log, noise)
    if not off.any():
        return e
    nis, normalised, density = (
        np.where(off[:, None], np.nan, told) for told in (e.nis, e.normalised, e.density)
    )
    return replace(e, nis=nis, normalised=normalised, density=density)


def is_off(log: Log, noise: Array) -> NDArray[np.bool_]:
    """(n,) whether a sample is of a rest in which the drive has been switched off."""
    still = np.flatnonzero(np.diff(np.concatenate(([False], log.w_cmd == 0.0, [False])).astype(np.int8)))
    off = np.zeros(log.t.size, dtype=bool)
    zero = zero_of(log.z[: int(np.argmax(log.w_cmd != 0.0)), :2])
    for first, end in zip(still[::2].tolist(), still[1::2].tolist(), strict=True):
        if first > 0:
            off[first + until_off(log.z[first:end, :2], noise[:2], 1.0 / log.rate_hz, zero) : end] = True
    return off


def zero_of(before: Array) -> Array:
    """(2,) what voltage and current (n, 2) read in the rest before the first move, where the drive may be off; NaN for none."""
    return np.median(_filled(before), axis=0) if len(before) > OFF else np.full(2, np.nan)


def until_off(electrical: Array, noise: Array, interval: float, zero: Array) -> int:
    """Samples (n, 2) of voltage and current at rest until the drive is switched off: both drop to nothing at once, and stay.

    From there on the motor coasts, and the readings tell of no actuator. Readings may be held, filtered and offset.
    zero (2,): see `zero_of`.
    """
    z = _filled(electrical / noise)
    there = np.isfinite(z[-1:]).all(axis=0)
    z = z[:, there]
    if len(z) <= OFF or not z.size:
        return len(electrical)
    level = np.median(z[-OFF:], axis=0)  # zero, but for offsets
    sizes = np.max(np.abs(z - level), axis=1)
    over = ~(sizes < NOTHING)
    alive = np.flatnonzero(over[1:] & over[:-1])  # a single one is a spike
    first = int(alive[-1]) + 2 if alive.size else 0
    before = max(first - max(round(DROP_S / interval), 2), 0)
    dropped = 0 < first <= len(z) - OFF and np.nanmax(sizes[before:first]) > DROP
    return before if dropped and _is_nothing(level, (zero / noise)[there]) else len(electrical)


def goes_off(electrical: Array, noise: Array, at: int, interval: float, zero: Array) -> bool:
    """Whether voltage and current (n, 2) at rest are nothing but offsets from sample `at` on, and were something before.

    A motor that sticks at no current looks the same: nothing else speaks for a fault there. zero (2,): see `zero_of`.
    """
    z, around = _filled(electrical / noise), max(round(DROP_S / interval), 2)
    after, before = z[at + around :], z[max(at - around, 0) : at + around]
    there = np.isfinite(z[-1:]).all(axis=0)
    if len(after) < 2 * OFF or not there.any():
        return False
    level = np.median(after[:, there], axis=0)
    silent = np.mean(np.abs(after[:, there] - level) < NOTHING) > ALL
    changed = np.nanmax(np.abs(before[:, there] - level)) > NOTHING
    return bool(silent and changed and _is_nothing(level, (zero / noise)[there]))


def may_be_off(electrical: Array, noise: Array, zero: Array) -> bool:
    """Whether samples (n, 2) of voltage and current end with nothing in them, but for offsets: the drive may have been off.

    zero (2,): see `zero_of`.
    """
    z = _filled(electrical / noise)[-OFF:]
    there = np.isfinite(z[-1:]).all(axis=0)
    level = np.median(z[:, there], axis=0)
    return not level.size or _is_nothing(level, (zero / noise)[there])


def _is_nothing(level: Array, zero: Array) -> bool:
    """Whether readings (k,) are what an offset makes of nothing, or what they were before the first move (k,)."""
    return bool(np.max(np.abs(level)) < OFFSETS or np.max(np.abs(level - zero)) < NOTHING)


def _filled(z: Array) -> Array:
    """Rows with each channel's last known value where it has none, before its first one with that."""
    known = np.isfinite(z)
    rows = np.maximum.accumulate(np.where(known, np.arange(len(z))[:, None], 0), axis=0)
    rows = np.maximum(rows, known.argmax(axis=0)) if len(z) else rows
    return np.take_along_axis(z, rows, axis=0)
