"""Lines of a logger, mains hum for one, taken out of its readings: in rests nothing else is there, and moves have the same.

Its size and phase are those of the rests around; where they do not go together from rest to rest, it stays, as noise.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs.logger.acquisition import rests_of, stuck_from, undriven
from observer_fi.records import Acquisition, Array, Log

FEWEST_RESTS, FEWEST = 2, 20  # rests, and readings of one
MOST_RESTS = 20  # that tell a frequency
REACH_HZ = 1.5  # by which a peak of the spectrum of short rests may be off
POLISHED = 2  # times that frequencies are fitted to the phases
STEPS = 16  # of a turn between the first and the last rest, in which frequencies are tried
TOGETHER = 0.97  # of its size in single rests, that the mean of a line in all of them keeps

Phasors = NDArray[np.complex128]
Rows = NDArray[np.intp]


class Hum:
    """Lines that are one and the same throughout a log, by its beginning; `take` the log, chunk by chunk, without them.

    fewest: rests that must say so.
    """

    def __init__(self, log: Log, acquisition: Acquisition, fewest: int = FEWEST_RESTS) -> None:
        told = [[line.hz for line in channel.lines] for channel in acquisition[:3]]
        rests = _rests(log) if any(told) else []
        self.channels = [
            _found(log.t, log.z[:, c], _all_read(log.z[:, c], rests), hz, fewest) if hz else NO_LINES
            for c, hz in enumerate(told)
        ]

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return any(lines.hz.size for lines in self.channels)

    def take(self, log: Log) -> Log:
        """The next chunk; the very log where nothing is taken out of it."""
        if not self.any:
            return log
        rests, z = _rests(log), log.z.copy()
        read = [_all_read(y, rests) for y in log.z.T]
        own = zip(self.channels, log.z.T, read, strict=True)
        self.channels = [lines.followed(log.t, y, rows) if lines.hz.size else lines for lines, y, rows in own]
        for c, lines in enumerate(self.channels):
            if lines.hz.size:
                live = slice(0, stuck_from(log.z[:, c]))
                z[live, c] -= lines.at(log.t)[live]
        return replace(log, z=z)


def without_lines(log: Log, acquisition: Acquisition) -> Log:
    """The log without those of its lines that are one and the same throughout."""
    return Hum(log, acquisition).take(log)


class _Lines(NamedTuple):
    """Lines of one channel: their frequencies (m,) [Hz], and their sizes and phases (k, m) at some times (k,)."""

    hz: Array
    times: Array
    phasors: Phasors

    def followed(self, t: Array, y: Array, rests: Sequence[Rows]) -> "_Lines":
        """The lines with their sizes and phases in these rests, and the last ones before them."""
        now = np.array([_phasors(t[rest], y[rest], self.hz) for rest in rests]).reshape(-1, self.hz.size)
        times = np.concatenate((self.times[-1:], _middles(t, rests)))
        return self._replace(times=times, phasors=np.concatenate((self.phasors[-1:], now)))

    def at(self, t: Array) -> Array:
        """What they add to readings at times t (n,)."""
        total = np.zeros(t.size)
        for f, own in zip(self.hz.tolist(), self.phasors.T, strict=True):
            size: Any = np.interp(t, self.times, own.real) + 1j * np.interp(t, self.times, own.imag)
            total += (size * np.exp(2j * np.pi * f * t)).real
        return total


NO_LINES = _Lines(np.empty(0), np.empty(0), np.empty((0, 0), dtype=np.complex128))


def _found(t: Array, y: Array, rests: Sequence[Rows], hz: Sequence[float], fewest: int) -> _Lines:
    """Lines of about these frequencies in the readings y (n,) at times t (n,). rests: rows in which they show."""
    if len(rests) < fewest:
        return NO_LINES
    middle = _middles(t, rests)
    fine = np.array([_finer(t, y, rests, f) for f in hz])
    for _ in range(POLISHED):  # what is left is less than a turn; lines beside each other share it
        phase = np.unwrap(np.angle([_phasors(t[rest], y[rest], fine) for rest in rests]), axis=0)
        fine = fine + np.polyfit(middle, phase, 1)[0] / (2.0 * np.pi)
    own = np.array([_phasors(t[rest], y[rest], fine) for rest in rests])
    together = np.abs(own.mean(axis=0)) > TOGETHER * np.abs(own).mean(axis=0)
    return _Lines(fine[together], middle[:0], own[:0, together])


def _rests(log: Log) -> list[slice]:
    return [undriven(rest, log.z) for rest in rests_of(log.t, log.w_cmd)]


def _middles(t: Array, rests: Sequence[Rows]) -> Array:
    return np.array([float(t[rest].mean()) for rest in rests])


def _all_read(y: Array, rests: Sequence[slice]) -> list[Rows]:
    """Rows of the rests in which the readings y (n,) are there, before the sensor got stuck."""
    stuck = stuck_from(y)
    read = [_read(y, rest, stuck) for rest in rests]
    return [rows for rows in read if rows.size >= FEWEST]


def _read(y: Array, rest: slice, stuck: int | None) -> Rows:
    rows = np.arange(rest.start, rest.stop if stuck is None else min(rest.stop, stuck))
    return rows[np.isfinite(y[rows])]


def _finer(t: Array, y: Array, rests: Sequence[Rows], hz: float) -> float:
    """The frequency near `hz` at which one line explains most of all rests together [Hz].

    Between rests its phase may slip by turns that only the readings within them rule out.
    """
    rests = rests[:: math.ceil(len(rests) / MOST_RESTS)]
    at = np.concatenate([t[rest] for rest in rests])
    z = np.concatenate([y[rest] - y[rest].mean() for rest in rests])
    fine = 1.0 / (STEPS * float(at[-1] - at[0]))
    tried = hz + fine * np.arange(-math.ceil(REACH_HZ / fine), math.ceil(REACH_HZ / fine) + 1)
    return float(tried[int(np.argmax([abs(np.vdot(np.exp(2j * np.pi * f * at), z)) for f in tried]))])


def _phasors(t: Array, y: Array, hz: Array) -> Phasors:
    """Size and phase, at time 0, of lines in the readings y (n,) of one rest: sum of Re(c exp(2 pi i f t)) and a constant."""
    turn = 2.0 * np.pi * np.outer(t, hz)
    solution = np.linalg.lstsq(
        np.column_stack([np.ones(t.size), np.cos(turn), -np.sin(turn)]), y, rcond=None
    )[0]
    return np.asarray(solution[1 : 1 + len(hz)] + 1j * solution[1 + len(hz) :])
