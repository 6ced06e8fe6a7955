"""Channels that each have a clock of their own: start, step and number of samples, brought to one clock or refused."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.records import Array

OFF = 0.05  # of a sampling interval: how far a sample may be from the instant of the common clock
MOST_STRETCH = 4  # rows of the common clock, of the samples that all channels have together
_LARGEST_START = 1e11  # s: 3000 years


class Waveform(NamedTuple):
    """A clock that the header tells: time of the first sample and step [s]."""

    start: float
    step: float

    def times(self, rows: NDArray[np.int64]) -> Array:
        """Time of each row, 0 the first."""
        return self.start + self.step * rows.astype(np.float64)


class OnClock(NamedTuple):
    """Where a channel's samples stand on the common clock: row of the first, and rows from one to the next."""

    shift: int
    stride: int


def checked_waveform(path: str, name: str, start: float, step: float) -> Waveform:
    """A clock that can be one. Raises InvalidLogError that names the channel."""
    if not (math.isfinite(step) and step > 0.0 and math.isfinite(start) and abs(start) < _LARGEST_START):
        raise InvalidLogError(
            f"{path}: channel {name!r} starts at {start:g} s in steps of {step:g} s, which is no clock; export it again"
        )
    if start + step == start or math.ulp(start) > OFF * step:
        raise InvalidLogError(
            f"{path}: channel {name!r} starts at {start:.9g} s in steps of {step:g} s, too fine to be told apart; "
            "export it again"
        )
    return Waveform(start, step)


def one_clock(
    path: str, waves: dict[str, Waveform], lengths: dict[str, int]
) -> tuple[Waveform, dict[str, OnClock], int]:
    """The common clock of channels, where each stands on it, and its number of rows.

    The clock has the finest step and the earliest start. A channel fits if its samples are at instants of that clock: every
    one of them, or every second, third, ... Nothing is interpolated. Raises InvalidLogError that names two that do not fit.
    """
    finest = min(waves, key=lambda name: waves[name].step)
    step = waves[finest].step
    start = min(wave.start for wave in waves.values())
    # the finest channel's own instants, continued to the earliest start
    start = waves[finest].start - step * round((waves[finest].start - start) / step)
    placed = {}
    for name, wave in waves.items():
        stride, shift = round(wave.step / step), (wave.start - start) / step
        drift = abs(wave.step - stride * step) * max(lengths[name] - 1, 1)
        if drift > OFF * step or abs(shift - round(shift)) > OFF or shift < -OFF:
            raise _unlike(path, finest, waves[finest], name, wave)
        placed[name] = OnClock(round(shift), stride)
    rows = max(at.shift + at.stride * (lengths[name] - 1) + 1 for name, at in placed.items())
    if rows > MOST_STRETCH * sum(lengths.values()):
        last = max(waves, key=lambda name: waves[name].start)
        raise _unlike(path, finest, waves[finest], last, waves[last])
    return Waveform(start, step), placed, rows


def _unlike(path: str, one: str, a: Waveform, other: str, b: Waveform) -> InvalidLogError:
    return InvalidLogError(
        f"{path}: channels {one!r} ({1 / a.step:.6g} Hz from {a.start:.9g} s) and {other!r} ({1 / b.step:.6g} Hz from "
        f"{b.start:.9g} s) are on different clocks; export them on one clock"
    )


def on_clock(samples: Array, first: int, at: OnClock, start: int, count: int) -> Array:
    """(count,) rows from `start` on of a channel whose samples from number `first` on are given; NaN where it has none."""
    rows = np.full(count, np.nan)
    at_rows = at.shift + at.stride * (first + np.arange(samples.size)) - start
    rows[at_rows] = samples
    return rows
