"""Moves and rests of a log without a command: from where its position goes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import runs
from observer_fi.records import Array

WINDOW_S = 0.02  # over which a speed is taken
FEWEST_SAMPLES = 4  # of a window
NOISE = 5.0  # standard deviations of a difference at rest that are no motion
SLOW = 0.03  # of the fastest speed: slower is creep
PAUSE_S, SHORTEST_S = 0.1, 0.05  # shorter pauses are none, and shorter moves are jolts


class Motion(NamedTuple):
    """One move: from when to when [s], and how far [m]."""

    start_s: float
    end_s: float
    travel: float


def moving(t: Array, x: Array) -> NDArray[np.bool_]:
    """(n,) whether the position moves. t (n,) s; x (n,), NaN where there is none."""
    known = np.isfinite(x)
    if np.count_nonzero(known) < 4 * FEWEST_SAMPLES:
        return np.zeros(t.size, dtype=np.bool_)
    x = np.interp(t, t[known], x[known])
    step = float(np.median(np.diff(t)))
    size = max(FEWEST_SAMPLES, round(WINDOW_S / step))
    smooth = np.convolve(np.pad(x, size // 2, mode="edge"), np.ones(size) / size, mode="same")[size // 2 :][
        : x.size
    ]
    change = np.zeros(x.size)
    change[size:-size] = smooth[2 * size :] - smooth[: -2 * size]
    # noise of a mean of `size` samples, and the steps of a coarse reading
    white = float(np.sqrt(np.median(np.diff(x, 2) ** 2) / 2.7)) / np.sqrt(size)
    at_rest = float(np.quantile(np.abs(change), 0.2))
    limit = max(
        NOISE * white,
        2.0 * at_rest if at_rest < 0.1 * np.abs(change).max() else 0.0,
        SLOW * float(np.abs(change).max()),
    )
    return _without_short(np.abs(change) > limit, step) if limit > 0.0 else np.zeros(t.size, dtype=np.bool_)


def _without_short(mask: NDArray[np.bool_], step: float) -> NDArray[np.bool_]:
    out = mask.copy()
    for value, seconds in ((False, PAUSE_S), (True, SHORTEST_S)):
        for first, last in zip(*runs(out == value), strict=True):
            inside = value or (first > 0 and last < out.size)
            if inside and (last - first) * step < seconds:
                out[first:last] = not value
    return out


def motions(t: Array, x: Array, mask: NDArray[np.bool_]) -> tuple[Motion, ...]:
    """The moves of a mask."""
    found = []
    for first, last in zip(*runs(mask), strict=True):
        part = x[first:last][np.isfinite(x[first:last])]
        if part.size > 1:
            found.append(Motion(float(t[first]), float(t[last - 1]), float(part[-1] - part[0])))
    return tuple(found)
