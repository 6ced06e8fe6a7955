"""Lines of a logger, mains hum for one, taken out of its readings: in rests nothing else is there, and moves have the same.

Its size and phase are those of the rests around; where they do not go together from rest to rest, it stays, as noise.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs import rests_of, stuck_from, undriven
from observer_fi.records import Acquisition, Array, Log

FEWEST_RESTS, FEWEST = 2, 20  # rests, and readings of one
MOST_RESTS = 20  # that tell a frequency
REACH_HZ = 1.5  # by which a peak of the spectrum of short rests may be off
POLISHED = 2  # times that frequencies are fitted to the phases
STEPS = 16  # of a turn between the first and the last rest, in which frequencies are tried
TOGETHER = 0.97  # of its size in single rests, that the mean of a line in all of them keeps

Phasors = NDArray[np.complex128]
Rows = NDArray[np.intp]


def without_lines(log: Log, acquisition: Acquisition) -> Log:
    """The log without those of its lines that are one and the same throughout."""
    if not any(channel.lines for channel in acquisition[:3]):
        return log
    rests = [undriven(rest, log.z) for rest in rests_of(log.t, log.w_cmd)]
    z = log.z.copy()
    for c, channel in enumerate(acquisition[:3]):
        stuck = stuck_from(z[:, c])
        live = slice(0, stuck)
        read = [_read(log.z[:, c], rest, stuck) for rest in rests]
        read = [rows for rows in read if rows.size >= FEWEST]
        if channel.lines and len(read) >= FEWEST_RESTS:
            z[live, c] -= _lines_of(log.t, log.z[:, c], read, [line.hz for line in channel.lines])[live]
    return replace(log, z=z)


def _read(y: Array, rest: slice, stuck: int | None) -> Rows:
    """Rows of a rest in which the readings y (n,) are there, before the sensor got stuck."""
    rows = np.arange(rest.start, rest.stop if stuck is None else min(rest.stop, stuck))
    return rows[np.isfinite(y[rows])]


def _lines_of(t: Array, y: Array, rests: Sequence[Rows], hz: Sequence[float]) -> Array:
    """What lines of about these frequencies add to the readings y (n,) at times t (n,). rests: rows in which they show."""
    middle = np.array([float(t[rest].mean()) for rest in rests])
    fine = np.array([_finer(t, y, rests, f) for f in hz])
    for _ in range(
        POLISHED
    ):  # what is left is less than a turn, and lines that stand beside each other share it
        phase = np.unwrap(np.angle([_phasors(t[rest], y[rest], fine) for rest in rests]), axis=0)
        fine = fine + np.polyfit(middle, phase, 1)[0] / (2.0 * np.pi)
    found = np.array([_phasors(t[rest], y[rest], fine) for rest in rests])
    total = np.zeros(t.size)
    for k, f in enumerate(fine):
        own = found[:, k]
        if abs(own.mean()) > TOGETHER * float(np.abs(own).mean()):
            size: Any = np.interp(t, middle, own.real) + 1j * np.interp(t, middle, own.imag)
            total += (size * np.exp(2j * np.pi * f * t)).real
    return total


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
