"""Voltages and currents of which a logger takes running means, as they were before it did.

In a start the mean of a voltage belongs to no current, and no delay makes it one. But what a running mean gains from one reading
to the next is what came in less what went out, one window ago: with the rest before the first move known, every reading is.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.logs.logger.acquisition import rests_for_noise
from observer_fi.logs.logger.holds import HELD
from observer_fi.logs.logger.low_pass import earlier
from observer_fi.numerics import autocorrelation, resolution_of
from observer_fi.records import Array, Log

FEWEST = 4  # samples of a mean, from which on it matters
WINDOWS = 4  # of a rest, that tell what the first one was
# Of a rest: how late it may begin, as means of few samples do, and its end, in which a mean that reaches ahead shows the start.
BEGINS, ENDS = 0.1, 0.125
# Autocorrelation of differences that may be that of a mean, -0.5 but for chance: the first start decides.
OPPOSITE = -0.25
# Share of a sample that is taken from the mean anew, so that no rounding adds up: at least, and what would blur a start.
LEAK, MOST_LEAK = 1e-4, 1e-3
AS_WHITE = 1.5  # times the noise of white samples, that what is taken apart may have
# Standard deviations of a mean that moves, and of its samples by which that is before the command.
MOVED, EARLY = 6.0, 0.2
ROUNDED = 0.5  # of the noise of a sample, that rounded means may add to it
GAP = 1.5  # intervals between two samples from which one is missing


class Mean(NamedTuple):
    """A running mean in one channel. samples: of which; leak: see above; begin: (samples,) by which the first window is off.

    ahead: samples by which it comes too early, of a mean that reaches as far ahead as back.
    """

    channel: int
    samples: int
    leak: float
    begin: tuple[float, ...]
    ahead: float = 0.0


def means_of(log: Log) -> tuple[Mean, ...]:
    """The means of voltage and current that can be taken out of a log: those of whole readings that begin at rest."""
    rests = rests_for_noise(log)
    if not rests or rests[0].start > BEGINS * rests[0].stop or (np.diff(log.t) > GAP / log.rate_hz).any():
        return ()
    until = round((1.0 - ENDS) * rests[0].stop)
    found = (_mean(c, log.z[:, c], until) for c in range(2))
    told = (mean for mean in found if mean is not None)
    return tuple(mean._replace(ahead=_ahead(log, mean.channel, mean.samples, until)) for mean in told)


def without_means(log: Log) -> Log:
    """A whole log with what voltage and current are means of, at the time of its other channels."""
    means = means_of(log)
    if not means:
        return log
    out = Unmeant(means).take(log)
    z = out.z.copy()
    for mean in means:
        z[:, mean.channel] = earlier(log.t, z[:, mean.channel], -mean.ahead / log.rate_hz)
    return replace(out, z=z)


def _mean(c: int, y: Array, until: int) -> Mean | None:
    """The mean in a channel y (n,), as the rest of so many samples tells: a sample goes out whenever one comes in."""
    still = y[:until]
    if still.size < FEWEST * WINDOWS or not np.isfinite(still).all():
        return None
    changes = np.diff(still)
    if np.mean(changes == 0.0) > HELD:
        return None
    alike = autocorrelation(changes, still.size // WINDOWS)
    strongest = int(np.argmax(np.abs(alike)))  # behind a low-pass, that of neighbours
    samples = strongest + 1 if alike[strongest] < OPPOSITE else 1
    whole = len(still) // samples * samples
    if samples < FEWEST or whole < WINDOWS * samples or not np.isfinite(y).all():
        return None
    rounding = (resolution_of(np.diff(y)) or 0.0) / math.sqrt(12.0)
    noise = float(still.std()) * math.sqrt(samples)
    leak = max(LEAK, (samples * rounding / (ROUNDED * noise)) ** 2) if noise > 0.0 else math.inf
    if leak > MOST_LEAK:
        return None
    mean = Mean(c, samples, leak, (0.0,) * samples)
    before = _Before(mean).take(still[:whole]).reshape(-1, samples)[1:]
    begin = before.mean(axis=0) - still[:whole].mean()
    if (before - begin).std() > AS_WHITE * noise:  # noise of another colour would add up
        return None
    return mean._replace(begin=tuple(begin.tolist()))


def _ahead(log: Log, c: int, samples: int, until: int) -> float:
    """Samples by which a mean comes too early: half of them where its reading moves before the command does, which tells it."""
    started = np.flatnonzero(log.w_cmd != 0.0)
    if not started.size:
        return 0.0
    level, noise = float(log.z[:until, c].mean()), float(log.z[:until, c].std())
    around = slice(max(int(started[0]) - samples, 0), int(started[0]) + samples)
    off = np.abs(log.z[around, c] - level) > MOVED * noise
    moved = around.start + int(np.argmax(off[:-1] & off[1:]))
    early = off.any() and moved < started[0] - EARLY * samples
    return 0.5 * (samples - 1) if early else 0.0


class Unmeant:
    """The samples of which one log's readings are means, chunk by chunk."""

    def __init__(self, means: tuple[Mean, ...]) -> None:
        self.channels = [_Before(mean) for mean in means]

    def take(self, log: Log) -> Log:
        """The next chunk; of the first window, the means themselves."""
        if not self.channels:
            return log
        z = log.z.copy()
        for own in self.channels:
            z[:, own.mean.channel] = own.take(log.z[:, own.mean.channel])
        return replace(log, z=z)


class _Before:
    """What went into a running mean, chunk by chunk."""

    def __init__(self, mean: Mean) -> None:
        self.mean = mean
        self.window = np.empty(0)  # the latest samples, as many as a mean is of
        self.last = math.nan

    def take(self, y: Array) -> Array:
        """The samples of the next means y (n,); a mean that is missing changed nothing."""
        n, out = self.mean.samples, np.empty(y.size)
        gained = np.diff(y, prepend=self.last)
        first = n - self.window.size if self.window.size < n else 0
        first = min(first, y.size)
        out[:first] = y[:first]
        known = np.concatenate((self.window, out[:first]))
        if known.size == n and self.window.size < n:
            known = known - np.array(self.mean.begin)
        for k in range(first, y.size, n):
            part = slice(k, min(k + n, y.size))
            size = part.stop - k
            new = known[:size] + n * np.nan_to_num(gained[part])
            new += self.mean.leak * (np.where(np.isfinite(y[part]), y[part], new) - new)
            out[part] = new
            known = np.concatenate((known[size:], new))
        out[np.isnan(y)] = np.nan
        self.window = known[-n:]
        finite = y[np.isfinite(y)]
        self.last = float(finite[-1]) if finite.size else self.last
        return out
