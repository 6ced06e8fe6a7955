"""Where the residuals are: by channel and phase, speed, direction, position, angles, pitch, current, time; spectra."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from observer_fi.improve.force.force_dependence import motion_regressors
from observer_fi.improve.moves.unexplained import regressors
from observer_fi.learn import Experiment, FitResult, Motion, Solution, held_out, run
from observer_fi.logs import mean_square_by_phase
from observer_fi.physics import Rig
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_BINS = 24
_RAMP = 0.05  # of the largest acceleration
_POINTS, _FEWEST = 1024, 64  # of a spectrum, and samples that it needs
CHANNELS = ("voltage", "current", "position")


@dataclass(frozen=True)
class BinnedResiduals:
    """Mean of a residual over bins of a regressor: centres, means (bins, C), counts."""

    at: Array
    mean: Array
    count: Array


@dataclass(frozen=True)
class Residuals:
    """Residuals (N, C) of C channels from every side, each in its unit: "noise" where they are normalised.

    by_phase: mean square per channel and phase. curves: per regressor, against the direction of motion (signed) as a
    friction shows. spectrum: frequency [Hz] and power per channel of the moves, 1 for white noise; orders: the same
    over the motor angle [per turn].
    """

    channels: tuple[str, ...]
    unit: str
    t: Array
    z_minus_y: Array
    by_phase: dict[str, Array]
    curves: dict[str, BinnedResiduals]
    spectrum: tuple[Array, Array]
    orders: tuple[Array, Array]


def residual_tables(experiment: Experiment, fitted: FitResult) -> Residuals:
    """Tables and curves of a fit's residuals, of the channels that count in it."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    kept = experiment.seen
    r = fitted.residuals[:, kept]
    by_phase = mean_square_by_phase(r, experiment.phase)
    sign = np.sign(states[:, s.W])
    curves = {
        name: _curve(values, r if name.endswith("_angle") else r * sign[:, None])
        for name, values in regressors(experiment, states, fitted.model["screw_lead"]).items()
    }
    curves["direction"] = _curve(sign, r)
    rows = [experiment.rows(m) for m in range(experiment.moves)]
    turns = states[:, s.PHI] / (2.0 * math.pi)
    spectrum = _spectrum((experiment.t[k], r[k]) for k in rows)
    orders = _spectrum(_rising(turns[k], r[k]) for k in rows)
    channels = tuple(CHANNELS[c] for c in kept)
    return Residuals(channels, "noise", experiment.t, r, by_phase, curves, spectrum, orders)


def force_tables(motions: Sequence[Motion], fitted: Solution, rig: Rig) -> Residuals:
    """Tables and curves of the force that is missed on parts that were held out [N]; spectra over its variance."""
    r = held_out(fitted)[:, None]
    turn = 2.0 * math.pi * rig.model["D"]
    parts = [(m.t[m.use], m.x[m.kept][m.use] / turn, m.v[m.kept][m.use], m.a[m.kept][m.use]) for m in motions]
    t, turns, v, a = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    ramp = np.abs(a) > _RAMP * np.abs(a).max()
    by_phase = {n: np.mean(r[k] ** 2, axis=0) for n, k in (("ramp", ramp), ("steady", ~ramp)) if k.any()}
    curves = {
        name: _curve(values, r * np.sign(v)[:, None] if directed else r)
        for name, (values, directed) in motion_regressors(motions, rig).items()
    }
    white = r / max(float(np.sqrt(np.mean(fitted.residual**2))), 1e-300)
    log = np.repeat(np.arange(len(motions)), [int(m.use.sum()) for m in motions])
    strokes = np.split(
        np.arange(t.size), np.flatnonzero((np.diff(log) != 0) | (np.diff(np.sign(v)) != 0)) + 1
    )
    spectrum = _spectrum((t[log == k], white[log == k]) for k in range(len(motions)))
    orders = _spectrum(_rising(turns[k], white[k]) for k in strokes)
    return Residuals(("force",), "N", t, r, by_phase, curves, spectrum, orders)


def _curve(values: Array, r: Array) -> BinnedResiduals:
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)))
    k = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(edges.size - 2, 0))
    count = np.bincount(k, minlength=max(edges.size - 1, 1))
    sums = [np.bincount(k, column, count.size) for column in r.T]
    mean = np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]
    centres = 0.5 * (edges[1:] + edges[:-1]) if edges.size > 1 else edges
    return BinnedResiduals(centres, mean, count.astype(float))


def _rising(x: Array, y: Array) -> tuple[Array, Array]:
    """Residuals of one move over its angle, without the samples at which that stood still."""
    if x.size and x[-1] <= x[0]:
        x = -x
    go = np.diff(x, prepend=x[0] - 1.0) > 0.0 if x.size else np.zeros(0, dtype=bool)
    return x[go], y[go]


def _spectrum(pieces: Iterable[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Power of residuals (n, C) over the reciprocal of x (n,): mean over the pieces that are long enough.

    Pieces that cover more or less of x have other frequencies: those of the one in the middle stand for all.
    """
    window = np.hanning(_POINTS)
    found = []
    for x, y in pieces:
        if x.size < _FEWEST:
            continue
        grid = np.linspace(x[0], x[-1], _POINTS)
        lines = np.stack([np.interp(grid, x, column) for column in y.T], axis=1)
        power = np.abs(np.fft.rfft((lines - lines.mean(axis=0)) * window[:, None], axis=0)) ** 2
        found.append((np.fft.rfftfreq(_POINTS, grid[1] - grid[0]), power / np.sum(window**2)))
    if not found:
        return np.zeros(0), np.zeros((0, 0))
    shown: Array = sorted((frequency for frequency, _ in found), key=lambda f: float(f[-1]))[len(found) // 2]
    each = [np.stack([np.interp(shown, f, p) for p in power.T], axis=1) for f, power in found]
    return shown, np.mean(each, axis=0)
