"""Lines of a logger: hum, PWM that is folded, found in stretches in which nothing else is periodic."""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.records import Array, Line

FEWEST = 100  # samples of a stretch from which anything is told
LINE = 25.0  # times the spectrum beside it, from which a line is one: noise reaches 12
SURE_LINE = 8.0  # nats beyond what the strongest of so many noise lines has
BESIDE, PEAK = 36, 4  # bins on either side that a line is compared with, and those that are its own
FINEST = 5.0  # periods in a rest that a line needs at least
MOST_LINES = 4


def lines_of(pieces: Sequence[tuple[Array, Array]]) -> tuple[tuple[Line, ...], list[tuple[Array, Array]]]:
    """Periodic disturbances of rests, the strongest first, and the rests without them."""
    lines: list[Line] = []
    left = list(pieces)
    while len(lines) < MOST_LINES:
        hz = _strongest(left)
        if hz is None:
            break
        parts = [_sine(t, y, hz) for t, y in left]
        n = sum(y.size for _, y in left)
        energy, rest = (
            sum(float(p @ p) for p in q)
            for q in (parts, [y - p for (_, y), p in zip(left, parts, strict=True)])
        )
        if 0.5 * n * energy < (math.log(n) + SURE_LINE) * rest:
            break
        amplitude = math.sqrt(2.0 * energy / n)
        lines.append(Line(hz, amplitude))
        left = [(t, y - p) for (t, y), p in zip(left, parts, strict=True)]
    return tuple(lines), left


def _strongest(pieces: Sequence[tuple[Array, Array]]) -> float | None:
    """Frequency of the strongest line that stands out of the spectrum beside it [Hz]."""
    t, y = max(pieces, key=lambda piece: piece[1].size)
    if y.size < FEWEST:
        return None
    interval = float(np.median(np.diff(t)))
    size = 1 << (y.size - 1).bit_length()
    index = np.round((t - t[0]) / interval).astype(np.int64).clip(0, 4 * size - 1)
    even = np.zeros(2 * size)
    inside = index < even.size
    even[index[inside]] = (y * np.hanning(y.size))[inside]
    power = np.abs(np.fft.rfft(even)) ** 2
    first = int(FINEST * even.size / y.size)
    beside = _beside(power)
    ratio = power / np.maximum(beside, 1e-300)
    ratio[:first], ratio[-2:] = 0.0, 0.0
    k = int(np.argmax(ratio))
    if ratio[k] < LINE / math.log(2.0):
        return None
    bin_hz = 1.0 / (even.size * interval)
    for width, steps in ((1.0, 21), (0.1, 21), (0.01, 11)):
        around = np.linspace(k - width, k + width, steps) * bin_hz
        best = max(around, key=lambda hz: sum(float((_sine(a, b, hz) ** 2).sum()) for a, b in pieces))
        k = best / bin_hz
    return float(best)


def _beside(power: Array) -> Array:
    """Median of a spectrum on the stronger side of each bin, without what may be its own peak."""
    far = PEAK + BESIDE
    medians = np.median(
        np.lib.stride_tricks.sliding_window_view(np.pad(power, far, mode="reflect"), BESIDE), axis=1
    )
    left, right = medians[: power.size], medians[far + PEAK + 1 : far + PEAK + 1 + power.size]
    return np.maximum(left, right)


def _sine(t: Array, y: Array, hz: float) -> Array:
    """The sine of a frequency in y (n,) at t (n,) s."""
    angle = 2.0 * np.pi * hz * (t - t[0])
    basis = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return basis @ np.linalg.lstsq(basis, y, rcond=None)[0]
