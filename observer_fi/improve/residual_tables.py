"""Where the residuals are: by channel and phase, speed, direction, position, angles, pitch, current, time; spectra."""

import math
from dataclasses import dataclass

import numpy as np

from observer_fi.improve.unexplained import regressors
from observer_fi.learn import Experiment, FitResult, run
from observer_fi.logs import mean_square_by_phase
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_BINS = 24


@dataclass(frozen=True)
class BinnedResiduals:
    """Mean of a normalised residual over bins of a regressor: centres, means (bins, 3), counts."""

    at: Array
    mean: Array
    count: Array


@dataclass(frozen=True)
class Residuals:
    """Normalised residuals (unit = the noise) from every side.

    by_phase: mean square per channel and phase. curves: per regressor, against the direction of motion (signed) as a
    friction shows. spectrum: frequency [Hz] and power per channel of the moves, 1 for white noise; orders: the same
    over the motor angle [per turn].
    """

    t: Array
    z_minus_y: Array
    by_phase: dict[str, Array]
    curves: dict[str, BinnedResiduals]
    spectrum: tuple[Array, Array]
    orders: tuple[Array, Array]


def residual_tables(experiment: Experiment, fitted: FitResult) -> Residuals:
    """Tables and curves of a fit's residuals."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    r = fitted.residuals
    by_phase = mean_square_by_phase(r, experiment.phase)
    sign = np.sign(states[:, s.W])
    curves = {
        name: _curve(values, r if name.endswith("_angle") else r * sign[:, None])
        for name, values in regressors(experiment, states, fitted.model["screw_lead"]).items()
    }
    curves["direction"] = _curve(sign, r)
    return Residuals(
        experiment.t,
        r,
        by_phase,
        curves,
        _spectrum(experiment, r, None),
        _spectrum(experiment, r, states[:, s.PHI]),
    )


def _curve(values: Array, r: Array) -> BinnedResiduals:
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)))
    k = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(edges.size - 2, 0))
    count = np.bincount(k, minlength=max(edges.size - 1, 1))
    mean = (
        np.stack([np.bincount(k, r[:, c], count.size) for c in range(3)], axis=1)
        / np.maximum(count, 1)[:, None]
    )
    centres = 0.5 * (edges[1:] + edges[:-1]) if edges.size > 1 else edges
    return BinnedResiduals(centres, mean, count.astype(float))


def _spectrum(experiment: Experiment, r: Array, angle: Array | None) -> tuple[Array, Array]:
    """Power over frequency, or over orders where the motor angle is given; mean over the moves."""
    size = 1024
    power, moves = np.zeros((size // 2 + 1, 3)), 0
    pitch = 1.0 / 1600.0
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        x = experiment.t[rows] if angle is None else angle[rows] / (2.0 * math.pi)
        y = r[rows]
        if angle is not None:
            x, y = (x, y) if x[-1] > x[0] else (-x, y)
            go = np.diff(x, prepend=x[0] - 1.0) > 0.0
            x, y = x[go], y[go]
        if x.size < 64:
            continue
        grid = np.linspace(x[0], x[-1], size)
        pitch = (x[-1] - x[0]) / (size - 1)
        window = np.hanning(size)
        for c in range(3):
            line = np.interp(grid, x, y[:, c])
            power[:, c] += np.abs(np.fft.rfft((line - line.mean()) * window)) ** 2 / np.sum(window**2)
        moves += 1
    return np.asarray(np.fft.rfftfreq(size, pitch), dtype=float), power / max(moves, 1)
