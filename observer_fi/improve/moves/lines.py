"""Lines in a disturbing torque: at any order of the motor's angle, at any frequency in time.

What a unit of torque at each sample gains is one pass backwards through the linearised motion; its transform over the angle or
the time then scores every order and frequency at once (order tracking, of irregular samples).
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi.improve.moves.screening import Projector
from observer_fi.learn import TORQUE, Experiment, FitResult, Linear, gradient, linearised, response, run
from observer_fi.physics import simulation as s
from observer_fi.records import Array

FEWEST_PERIODS = 3.0  # of a line within what a log covers: less is no line but a slope
HIGHEST_ORDER = 30.0
HIGHEST_SHARE = 0.4  # of the sampling rate
_CELLS = 20.0  # per period of the highest line
_FINER = 4  # points of the transform per period in the whole
_MOST_POINTS = 1 << 21
_TRIED = 24  # orders or frequencies at which the size of the answer is computed
_HUM_HZ = 1.0  # around a line of the logger
_SPARE = 8  # more lines that are looked at for each of the logger's
_APART = 3.0  # periods in the whole by which two lines differ at least


class Line(NamedTuple):
    """A line over an angle (per radian) or in time (per second). gain: nats that its sine and cosine would gain."""

    at: float
    gain: float


def lines_of(experiment: Experiment, fitted: FitResult, most: int = 3) -> list[Line]:
    """The strongest lines over the motor's angle in the torque that a fit leaves."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    linear = linearised(experiment, fitted.model, states)
    return order_lines(experiment, Projector(experiment, fitted), linear, states, most)


def order_lines(
    experiment: Experiment, projector: Projector, linear: Linear, states: Array, most: int = 3
) -> list[Line]:
    """The strongest lines over the motor's angle, by their order per turn, the best first."""
    phi = states[:, s.PHI]
    span = max(float(np.ptp(phi[experiment.rows(m)])) for m in range(experiment.moves))
    if span <= 0.0:
        return []
    turns = np.abs(experiment.peak) / (2.0 * math.pi)  # a second
    fastest = HIGHEST_SHARE / _interval(experiment) / max(float(turns.max()), 1e-300)
    low, high = FEWEST_PERIODS * 2.0 * math.pi / span, min(HIGHEST_ORDER, fastest)
    found = _lines(experiment, projector, linear, phi, (low, high), most + _SPARE * len(experiment.hum_hz))
    return [line for line in found if not _is_hum(experiment, line.at * turns)][:most]


def time_lines(experiment: Experiment, projector: Projector, linear: Linear, most: int = 1) -> list[Line]:
    """The strongest lines in time [Hz], the best first, without those of the logger."""
    t = 2.0 * math.pi * experiment.t
    low, high = FEWEST_PERIODS / float(np.ptp(experiment.t)), HIGHEST_SHARE / _interval(experiment)
    found = _lines(experiment, projector, linear, t, (low, high), most + _SPARE * len(experiment.hum_hz))
    return [line for line in found if not _is_hum(experiment, np.array([line.at]))][:most]


def _interval(experiment: Experiment) -> float:
    return float(np.median(np.diff(experiment.t)))


def _is_hum(experiment: Experiment, hz: Array) -> bool:
    """Whether one of some frequencies is that of a line of the logger."""
    return any(bool((np.abs(hz - own) < _HUM_HZ).any()) for own in experiment.hum_hz)


def _lines(
    experiment: Experiment, projector: Projector, linear: Linear, over: Array, band: tuple[float, float],
    most: int,
) -> list[Line]:  # fmt: skip
    low, high = band
    if high <= low:
        return []
    pull = gradient(experiment, linear, TORQUE, projector.r[: 3 * experiment.t.size].reshape(-1, 3))
    at, power = _transform(over, pull, high)
    inside = (at >= low) & (at <= high)
    at, power = at[inside], power[inside]
    if at.size < 3:
        return []
    tried = np.geomspace(low, high, _TRIED)
    size = np.array([_size(response(experiment, linear, TORQUE, waves(over, k))) for k in tried])
    gain = 0.5 * power / np.exp(np.interp(np.log(at), np.log(tried), np.log(np.maximum(size, 1e-300))))
    apart = _APART * 2.0 * math.pi / max(float(np.ptp(over)), 1e-300)
    found: list[Line] = []
    for k in np.argsort(-gain)[: 50 * most].tolist():
        if all(abs(at[k] - line.at) > apart for line in found):
            found.append(Line(float(at[k]), float(gain[k])))
        if len(found) == most:
            break
    return found


def waves(over: Array, at: float) -> Array:
    """(2, N) sine and cosine of an order over an angle, or of a frequency over time times 2 pi."""
    return np.array([np.sin(at * over), np.cos(at * over)])


def _size(columns: Array) -> float:
    """Mean over sine and cosine of the squared answer."""
    return float(np.sum(columns**2)) / columns.shape[0]


def _transform(over: Array, pull: Array, high: float) -> tuple[Array, Array]:
    """Lines per unit of `over` up to `high`, and the squared sum of the pull (N,) turned by each."""
    cell = 2.0 * math.pi / (_CELLS * high)
    first = float(over.min())
    k = np.round((over - first) / cell).astype(np.int64)
    if k.max() >= _MOST_POINTS:
        return np.empty(0), np.empty(0)
    points = 1 << math.ceil(math.log2(_FINER * (int(k.max()) + 1)))
    spectrum = np.fft.rfft(np.bincount(k, pull, minlength=points), points)
    at: Array = 2.0 * math.pi / (points * cell) * np.arange(spectrum.size, dtype=np.float64)
    power: Array = np.square(np.abs(spectrum), dtype=np.float64)
    return at, power
