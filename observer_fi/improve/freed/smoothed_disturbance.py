"""What a freed equation looks like: its smoothed disturbance with a band, over time and over what it may depend on.

A Kalman filter around the simulated motion (`diffusion.py`) runs forward with the likeliest intensity, the smoother of
Bryson and Frazier back (`walk_filter.py`).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer_fi.improve.freed.freed_equations import (
    WANTED_NATS,
    Freed,
    FreedEquation,
    free_each,
    freed_equations,
)
from observer_fi.improve.freed.random_walk import Series, series_of, smoothed
from observer_fi.improve.moves.unexplained import regressors
from observer_fi.learn import (
    DISTURBANCES,
    DRAG,
    FRICTION,
    POSITION,
    TORQUE,
    WINDING,
    Disturbance,
    Experiment,
    FitResult,
    Linear,
    linearised,
    run,
)
from observer_fi.physics import simulation as s
from observer_fi.records import Array

DRAWN = ("position", "screw_angle", "shaft_angle", "speed", "pitch", "current", "temperature", "time")
_ONE_WAY = ("temperature", "time")  # what passes once has one curve for both directions
_BINS = 60
_LEVELS = 6  # of a pitch that moves in steps
_TOLD, _AS_MUCH = (
    0.5,
    0.05,
)  # share of the variance that is worth a word, and that a second regressor may lack
_USUAL = (0.01, 0.99)  # quantiles: a sample in which a start or stop is off by an instant asks for any size
_FEWEST = 5  # samples in a bin that is told


@dataclass(frozen=True)
class BinnedDisturbance:
    """Mean of a disturbance over K bins of a regressor, NaN where few samples are. at: centres (K,); forward, backward: by the
    direction of motion, forward for both where what passes is seen once; band: half of the 95 % band, mean of the bin. share:
    of the disturbance's variance that the curves of the other moves predict.
    """

    at: Array
    forward: Array
    backward: Array
    band: Array
    share: float


@dataclass(frozen=True)
class SmoothedDisturbance:
    """One smoothed disturbance: mean and half of its 95 % band (N,), NaN in front of a move; t (N,) time along the moves [s]."""

    what: Disturbance
    gain: float
    t: Array
    mean: Array
    band: Array
    curves: dict[str, BinnedDisturbance]

    @property
    def goes_with(self) -> tuple[str, ...]:
        """The regressors that explain it best, the best first; those that explain nearly as much with it."""
        most = max((c.share for c in self.curves.values()), default=0.0)
        near_best = [name for name, c in self.curves.items() if c.share >= max(most - _AS_MUCH, _TOLD)]
        return tuple(sorted(near_best, key=lambda name: -self.curves[name].share))


Freedom = tuple[tuple[FreedEquation, ...], tuple[SmoothedDisturbance, ...]]


def free_equations(experiment: Experiment, fitted: FitResult) -> Freedom:
    """Which equations the data want to free, the largest gain first; and what the best looks like, with torque, voltage, x."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    linear, series = linearised(experiment, fitted.model, states), series_of(experiment, fitted)
    freed = free_each(experiment, fitted.model, linear, series)
    turning = states[:, s.W] != 0.0

    def rms(one: Freed) -> float:
        mean, _ = smoothed(linear, series, one.kind, one.size, one.memory)
        return float(np.sqrt(np.mean(mean[turning] ** 2))) if turning.any() else 0.0

    rows = freed_equations(experiment, fitted.model, freed, rms)
    return rows, tuple(
        _smoothed_one(experiment, states, fitted.model["screw_lead"], linear, series, one)
        for one in _to_draw(freed)
    )


def _to_draw(freed: list[Freed]) -> list[Freed]:
    """The best disturbance, and torque, voltage and position; friction and drag show in the torque, over direction and speed."""
    best = max(freed, key=lambda f: f.gain)
    first = [best] if best.kind not in (FRICTION, DRAG) else []
    others = [f for f in freed if f.kind in (TORQUE, WINDING, POSITION) and f is not best]
    return [f for f in (*first, *others) if f.gain >= WANTED_NATS]


def _smoothed_one(
    experiment: Experiment, states: Array, lead: float, linear: Linear, series: Series, freed: Freed
) -> SmoothedDisturbance:
    mean, std = smoothed(linear, series, freed.kind, freed.size, freed.memory)
    band = 1.96 * std
    w = states[:, s.W]
    given = regressors(experiment, states, lead)
    curves = (
        {name: curve_of(name, given[name], w, experiment.owner, mean, band) for name in DRAWN}
        if w.any()
        else {}
    )
    t = np.cumsum(np.where(series.begins > 0, np.median(series.since), series.since))
    shown = series.begins == 0  # a line must not lead from one move to the next
    return SmoothedDisturbance(
        DISTURBANCES[freed.kind], freed.gain, t, np.where(shown, mean, np.nan), np.where(shown, band, np.nan), curves
    )  # fmt: skip


def curve_of(
    name: str, values: Array, w: Array, owner: NDArray[np.int64], mean: Array, band: Array
) -> BinnedDisturbance:
    """A disturbance over one regressor while the motor turns; an angle is folded to one turn. owner (N,): the move."""
    values = np.mod(values, 2.0 * math.pi) if name.endswith("_angle") else values
    turning = w != 0.0
    centres, k = _bins(values[turning], _LEVELS if name == "pitch" else 0)
    y = np.clip(mean[turning], *np.quantile(mean[turning], _USUAL))
    forward = (w[turning] > 0.0) | (name in _ONE_WAY)
    cell = k + np.where(forward, 0, centres.size)
    count = np.bincount(cell, minlength=2 * centres.size)
    means = np.bincount(cell, y, count.size) / np.maximum(count, 1)
    bands = np.bincount(k, band[turning], centres.size) / np.maximum(
        np.bincount(k, minlength=centres.size), 1
    )
    shown = np.where(count >= _FEWEST, means, np.nan).reshape(2, -1)
    return BinnedDisturbance(centres, shown[0], shown[1], bands, _predicted(y, cell, owner[turning], centres))


def _predicted(y: Array, cell: NDArray[np.int64], owner: NDArray[np.int64], centres: Array) -> float:
    """Share of the variance of y that the curves of the other moves predict for each move; 0 for one move alone."""
    off = y - y.mean()
    whole, left = float(off @ off), 0.0
    for move in np.unique(owner):
        own, others = owner == move, owner != move
        count = np.bincount(cell[others], minlength=2 * centres.size).reshape(2, -1)
        total = np.bincount(cell[others], off[others], 2 * centres.size).reshape(2, -1)
        known = count > 0
        curves = np.zeros_like(total)
        for way in range(2):
            if known[way].any():
                there = total[way][known[way]] / count[way][known[way]]
                curves[way] = np.interp(centres, centres[known[way]], there)
        left += float(np.sum((off[own] - curves.ravel()[cell[own]]) ** 2))
    return max(1.0 - left / whole, 0.0) if whole > 0.0 else 0.0


def _bins(values: Array, most_levels: int) -> tuple[Array, NDArray[np.int64]]:
    """Centres of the bins, and the bin of every sample: a few levels, else equal widths."""
    levels = np.unique(np.round(values, 1))
    if levels.size <= most_levels:
        return levels, np.abs(values[:, None] - levels).argmin(axis=1)
    low, high = np.quantile(values, (0.002, 0.998))
    width = max((high - low) / _BINS, 1e-12)
    k = np.clip((values - low) / width, 0, _BINS - 1).astype(np.int64)
    return low + width * (np.arange(_BINS) + 0.5), k
