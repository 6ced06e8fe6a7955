"""Lines of a logger, mains hum for one, taken out of its readings: in rests nothing else is there, and moves have the same.

Its size and phase are those of the rests around; where they do not go together from rest to rest, it stays, as noise.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.logs import rests_of, undriven
from observer_fi.records import Acquisition, Array, Log

FEWEST_RESTS = 2
TOGETHER = 0.9  # of its size in single rests, that the mean of a line in all of them keeps

Phasors = NDArray[np.complex128]


def without_lines(log: Log, acquisition: Acquisition) -> Log:
    """The log without those of its lines that are one and the same throughout."""
    if not any(channel.lines for channel in acquisition[:3]):
        return log
    rests = [undriven(rest, log.z) for rest in rests_of(log.t, log.w_cmd)]
    rests = [rest for rest in rests if rest.stop > rest.start]
    z = log.z.copy()
    for c, channel in enumerate(acquisition[:3]):
        if channel.lines and len(rests) >= FEWEST_RESTS:
            z[:, c] -= _lines_of(log.t, log.z[:, c], rests, [line.hz for line in channel.lines])
    return replace(log, z=z)


def _lines_of(t: Array, y: Array, rests: Sequence[slice], hz: Sequence[float]) -> Array:
    """What lines of about these frequencies add to the readings y (n,) at times t (n,)."""
    middle = np.array([float(t[rest].mean()) for rest in rests])
    seen = [np.isfinite(y[rest]) for rest in rests]
    fine = [_finer(t, y, rests, seen, middle, list(hz), k) for k in range(len(hz))]
    found = np.array(
        [_phasors(t[rest][there], y[rest][there], fine) for rest, there in zip(rests, seen, strict=True)]
    )
    total = np.zeros(t.size)
    for k, f in enumerate(fine):
        own = found[:, k]
        if abs(own.mean()) > TOGETHER * float(np.abs(own).mean()):
            size: Any = np.interp(t, middle, own.real) + 1j * np.interp(t, middle, own.imag)
            total += (size * np.exp(2j * np.pi * f * t)).real
    return total


def _finer(
    t: Array, y: Array, rests: Sequence[slice], seen: Sequence[NDArray[np.bool_]], middle: Array, hz: list[float], k: int
) -> float:  # fmt: skip
    """The frequency of a line at which its phase is the same in all rests [Hz]."""
    found = np.array(
        [_phasors(t[rest][there], y[rest][there], hz)[k] for rest, there in zip(rests, seen, strict=True)]
    )
    phase = np.unwrap(np.angle(found))
    return hz[k] + float(np.polyfit(middle, phase, 1)[0]) / (2.0 * np.pi)


def _phasors(t: Array, y: Array, hz: Sequence[float]) -> Phasors:
    """Size and phase, at time 0, of lines in the readings y (n,) of one rest: sum of Re(c exp(2 pi i f t)) and a constant."""
    turn = 2.0 * np.pi * np.outer(t, hz)
    solution = np.linalg.lstsq(
        np.column_stack([np.ones(t.size), np.cos(turn), -np.sin(turn)]), y, rcond=None
    )[0]
    return np.asarray(solution[1 : 1 + len(hz)] + 1j * solution[1 + len(hz) :])
