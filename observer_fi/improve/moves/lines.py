"""Lines in a disturbance: at any order of the motor's angle, at any frequency in time.

What a unit of a torque, or of another disturbance, at each sample gains is one pass backwards through the linearised motion; its
transform over the angle or the time then scores every order and frequency at once (order tracking, of irregular samples).
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi.improve.moves.screening import Projector
from observer_fi.learn import TORQUE, Experiment, FitResult, Linear, gradient, linearised, response, run
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_PERIODS_A_MOVE = 10.0  # of a line with a phase of its own in every move: fewer fit whatever a move does
FEWEST_PERIODS = 3.0  # of a line within what a log covers: less is no line but a slope
HIGHEST_ORDER = 30.0
HIGHEST_SHARE = 0.4  # of the sampling rate
# A line gains more than orders close by do: 0.38 to 0.6 of its gain for ripples of orders 8 to 11 and a winding's 5, 0.02 to
# 0.08 for a spring or a sagging supply, which many orders explain, and anything where no line explains the most of it. It does
# so in 0.89 to 1 of the moves; what is taken for a line of another order in 0.55 to 0.78.
_CLOSE_BY, _ABOVE_THESE, _IN_MOVES = (0.01, 0.05), 0.2, 0.85
_HIGHER = 0.05  # of its gain, that another order may gain more in slow moves: one that fast moves do not show is the line
MOST_OF_IT = 0.5  # of a misfit, that a line explains which is told whatever else does
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


def line_by_move(experiment: Experiment, fitted: FitResult, kind: int) -> Line | None:
    """The strongest line over the motor's angle in a disturbance that a fit leaves, with a phase of its own in every move.

    Errors of the angle add up from move to move: a high order has no phase that all of a log shares. A move tells of orders of
    which it holds some periods, and the logger some samples a period. None where orders close by do as well. gain: less what the
    phases cost.
    """
    turns = np.abs(experiment.peak) / (2.0 * math.pi)
    at, gains = _gains_by_move(experiment, fitted, kind, turns)
    total = gains.sum(axis=0)
    for k in np.argsort(-total)[: _SPARE * (1 + len(experiment.hum_hz))].tolist():
        if total[k] > 0.0 and not _is_hum(experiment, at[k] * turns):
            gain = _gain_at(experiment, fitted, kind, float(at[k]))
            return Line(float(at[k]), gain) if gain > 0.0 and _stands_out(at, gains, k) else None
    return None


def _gain_at(experiment: Experiment, fitted: FitResult, kind: int, order: float) -> float:
    """Nats that a line with a phase of its own in every move gains, with its answer there instead of one between two others."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    r = Projector(experiment, fitted).r[: 3 * experiment.t.size].reshape(-1, 3)
    answer = response(
        experiment, linearised(experiment, fitted.model, states), kind, waves(states[:, s.PHI], order)
    )
    price, total = math.log(int((experiment.weight > 0.0).sum())), 0.0
    for rows in map(experiment.rows, range(experiment.moves)):
        both = answer[:, rows].reshape(2, -1)
        pull, size = both @ r[rows].ravel(), float(np.sum(both**2))
        total += max(float(pull @ pull) / size - price, 0.0) if size > 0.0 else 0.0
    return total


def _stands_out(at: Array, gains: Array, k: int) -> bool:
    """Whether order k of orders (K,) gains more than those close by, in all and in nearly every move of gains (M, K), and as much
    as any in slow moves: these tell of orders that fast ones do not show.
    """
    total, off = gains.sum(axis=0), np.abs(at / at[k] - 1.0)
    close_by = gains[:, (off > _CLOSE_BY[0]) & (off < _CLOSE_BY[1])]
    telling = gains[:, k] != 0.0
    in_moves = np.mean(gains[telling, k] > np.median(close_by[telling], axis=1))
    slow = gains[gains[:, np.flatnonzero(gains.any(axis=0))[-1]] != 0.0].sum(axis=0)
    above = np.median(close_by.sum(axis=0)) < (1.0 - _ABOVE_THESE) * total[k]
    return bool(above and in_moves > _IN_MOVES and slow.max() - slow[k] < _HIGHER * total[k])


def _gains_by_move(experiment: Experiment, fitted: FitResult, kind: int, turns: Array) -> tuple[Array, Array]:
    """Orders (K,), and (M, K) what a line there gains in every move, 0 where it tells nothing of it. turns (M,): a second."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    linear = linearised(experiment, fitted.model, states)
    phi, rows = states[:, s.PHI], [experiment.rows(m) for m in range(experiment.moves)]
    spans = np.maximum([float(np.ptp(phi[move])) for move in rows], 1e-300)
    lows = _PERIODS_A_MOVE * 2.0 * math.pi / spans
    highs = np.minimum(HIGHEST_ORDER, _fastest(experiment, turns))
    use = np.flatnonzero(lows < highs)
    points = _points_for(float(spans[use].max()), float(highs[use].max())) if use.size else 0
    if not points:
        return np.zeros(0), np.zeros((0, 0))
    r = Projector(experiment, fitted).r[: 3 * experiment.t.size].reshape(-1, 3)
    pull = gradient(experiment, linear, kind, r)
    tried = np.geomspace(lows[use].min(), highs[use].max(), _TRIED)
    answers = np.array([
        np.sum(response(experiment, linear, kind, waves(phi, k)) ** 2, axis=(0, 2)) for k in tried
    ])  # fmt: skip
    price = math.log(int((experiment.weight > 0.0).sum()))
    at, gains = np.zeros(0), np.zeros((use.size, points // 2 + 1))
    for row, m in enumerate(use):
        at, power = _transform(phi[rows[m]], pull[rows[m]], float(highs[use].max()), points)
        gain = _gain_of(power, at, tried, 0.5 * answers[:, rows[m]].sum(axis=1)) - price
        tells = (at >= lows[m]) & (at <= highs[m])
        gains[row, tells] = gain[tells]
    return at, gains


def order_lines(
    experiment: Experiment,
    projector: Projector,
    linear: Linear,
    states: Array,
    most: int = 3,
    kind: int = TORQUE,
) -> list[Line]:
    """The strongest lines over the motor's angle, by their order per turn, the best first. kind: of `DISTURBANCES`."""
    phi = states[:, s.PHI]
    span = max(float(np.ptp(phi[experiment.rows(m)])) for m in range(experiment.moves))
    if span <= 0.0:
        return []
    turns = np.abs(experiment.peak) / (2.0 * math.pi)  # a second
    low, high = (
        FEWEST_PERIODS * 2.0 * math.pi / span,
        min(HIGHEST_ORDER, float(_fastest(experiment, turns).min())),
    )
    wanted = most + _SPARE * len(experiment.hum_hz)
    found = _lines(experiment, projector, linear, kind, phi, (low, high), wanted)
    return [line for line in found if not _is_hum(experiment, line.at * turns)][:most]


def time_lines(experiment: Experiment, projector: Projector, linear: Linear, most: int = 1) -> list[Line]:
    """The strongest lines in time [Hz], the best first, without those of the logger."""
    t = 2.0 * math.pi * experiment.t
    low, high = FEWEST_PERIODS / float(np.ptp(experiment.t)), HIGHEST_SHARE / _interval(experiment)
    wanted = most + _SPARE * len(experiment.hum_hz)
    found = _lines(experiment, projector, linear, TORQUE, t, (low, high), wanted)
    return [line for line in found if not _is_hum(experiment, np.array([line.at]))][:most]


def _fastest(experiment: Experiment, turns: Array) -> Array:
    """The highest order that the logger shows of a motor of so many turns a second."""
    order: Array = HIGHEST_SHARE / _interval(experiment) / np.maximum(turns, 1e-300)
    return order


def _interval(experiment: Experiment) -> float:
    return float(np.median(np.diff(experiment.t)))


def _is_hum(experiment: Experiment, hz: Array) -> bool:
    """Whether one of some frequencies is that of a line of the logger."""
    return any(bool((np.abs(hz - own) < _HUM_HZ).any()) for own in experiment.hum_hz)


def _lines(
    experiment: Experiment, projector: Projector, linear: Linear, kind: int, over: Array,
    band: tuple[float, float], most: int,
) -> list[Line]:  # fmt: skip
    low, high = band
    if high <= low:
        return []
    pull = gradient(experiment, linear, kind, projector.r[: 3 * experiment.t.size].reshape(-1, 3))
    at, power = _transform(over, pull, high, _points_for(float(np.ptp(over)), high))
    inside = (at >= low) & (at <= high)
    at, power = at[inside], power[inside]
    if at.size < 3:
        return []
    tried = np.geomspace(low, high, _TRIED)
    size = np.array([_size(response(experiment, linear, kind, waves(over, k))) for k in tried])
    gain = _gain_of(power, at, tried, size)
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


def _gain_of(power: Array, at: Array, tried: Array, size: Array) -> Array:
    """Nats that a line gains at every order (K,). size: of the answer at those that were tried."""
    there = np.interp(np.log(np.maximum(at, tried[0])), np.log(tried), np.log(np.maximum(size, 1e-300)))
    gain: Array = 0.5 * power / np.exp(there)
    return gain


def _size(columns: Array) -> float:
    """Mean over sine and cosine of the squared answer."""
    return float(np.sum(columns**2)) / columns.shape[0]


def _points_for(span: float, high: float) -> int:
    """Points of the transform over a span, for lines per unit up to `high`; 0 where they would be too many."""
    cells = span * _CELLS * high / (2.0 * math.pi)
    return 1 << math.ceil(math.log2(_FINER * (cells + 2.0))) if cells < _MOST_POINTS else 0


def _transform(over: Array, pull: Array, high: float, points: int) -> tuple[Array, Array]:
    """Lines per unit of `over` up to `high`, and the squared sum of the pull (N,) turned by each. points: see `_points_for`."""
    cell = 2.0 * math.pi / (_CELLS * high)
    if not points:
        return np.empty(0), np.empty(0)
    k = np.round((over - float(over.min())) / cell).astype(np.int64)
    spectrum = np.fft.rfft(np.bincount(k, pull, minlength=points), points)
    at: Array = 2.0 * math.pi / (points * cell) * np.arange(spectrum.size, dtype=np.float64)
    power: Array = np.square(np.abs(spectrum), dtype=np.float64)
    return at, power
