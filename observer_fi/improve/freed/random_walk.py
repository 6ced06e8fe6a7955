"""Likelihood of a campaign with one disturbance free: a Kalman filter around the simulated motion.

The disturbance is a random walk with memory, ds = -s dt / memory + intensity dB; the filter's innovations give the
likelihood (Kristensen, Madsen and Jorgensen 2004, section 3). The rests before each move and the steps at reversals
are as uncertain as in the fit. The rig's parameters are free beside it: the same filter runs on their columns, and what
is left is a linear regression of innovations (de Jong 1991).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.improve.freed.random_walk_filter import STATES, back, forward
from observer_fi.learn import CAUGHT_A, Experiment, FitResult, Linear, scales, unwhitened
from observer_fi.records import Array

# A linear analysis of a deviation is right to some per cent of it, so a tenth of the local misfit counts as noise. On field
# campaigns with deviations of 100 times the noise (winding heating, viscous friction) other equations won without it.
_LINEAR_TO = 0.1
_LOCAL = 17  # samples, 10 ms


class Series(NamedTuple):
    """What the filter takes, for N rows, M moves, k parameters.

    y (N, 3, 1 + k): residual z - y(p), and the change of the readings for one step of each parameter, SI; variance (N, 3),
    infinite where nothing was measured. since (N,) time since the row before [s]; begins (N,) 1 at the first row of a move, 2
    at that of a log. start, start_var (M, 2): deviation of I, x at the start of a move; kick (N,) variance of the step of w
    at a row; caught (N,) of I. off, precision (k,): prior of the parameters around the fit, in steps.
    """

    y: Array
    variance: Array
    since: Array
    begins: NDArray[np.int64]
    start: Array
    start_var: Array
    kick: Array
    caught: Array
    off: Array
    precision: Array


def series_of(experiment: Experiment, fitted: FitResult) -> Series:
    """The residuals of a fit as a filter takes them."""
    m = fitted.model
    inner = [
        k for k, f in enumerate(fitted.free) if f.low < m[f.name] < f.high
    ]  # as in `screening.Projector`
    free = [fitted.free[k] for k in inner]
    columns = [fitted.residuals, *fitted.columns[inner]]
    y = np.stack([unwhitened(experiment, c) * experiment.noise for c in columns], axis=2)
    unit = np.array([1.0 / (m["Ki"] * m["current_gain"]), 1.0 / m["position_gain"]])
    kick, caught = _steps(experiment)
    std = np.array([f.prior_std for f in free]) / scales(free)
    return Series(
        y,
        _variance(experiment, y[:, :, 0]),
        np.diff(experiment.t, prepend=experiment.t[0]),
        _begins(experiment),
        -fitted.nuisance * unit,
        (experiment.nuisance_std * unit) ** 2,
        kick,
        caught / m["Ki"] ** 2,
        np.array([f.prior - m[f.name] for f in free]) / scales(free),
        1.0 / std**2,
    )


def _variance(experiment: Experiment, r: Array) -> Array:
    """(N, 3) of each reading: noise, and a share of the misfit around it."""
    window = np.ones(_LOCAL) / _LOCAL
    local = np.stack([np.convolve(channel**2, window, "same") for channel in r.T], axis=1)
    rough = _LINEAR_TO**2 * np.maximum(local - experiment.noise**2, 0.0)
    return np.where(experiment.weight > 0.0, experiment.noise**2 + rough, np.inf)


def _begins(experiment: Experiment) -> NDArray[np.int64]:
    begins = np.zeros(experiment.t.size, dtype=np.int64)
    begins[experiment.bounds[:-1]] = np.where(np.diff(experiment.log, prepend=-1) != 0, 2, 1)
    return begins


def _steps(experiment: Experiment) -> tuple[Array, Array]:
    """(N,) variance of the steps in speed at reversals, and of the current where the mass is caught."""
    kick, caught = np.zeros(experiment.t.size), np.zeros(experiment.t.size)
    for m, doubt in enumerate(experiment.doubts):
        rows = experiment.rows(m)
        for row, std in doubt.kicks:
            kick[rows.start + row] += std**2
        if rows.start + doubt.still < rows.stop:
            caught[rows.start + doubt.still] = CAUGHT_A**2
    return kick, caught


def likelihood(linear: Linear, series: Series, kind: int, size: float, memory: float) -> tuple[float, Array]:
    """Log-likelihood [nats, a constant left out] with a disturbance of standard deviation `size` free, parameters
    integrated over; and the parameters (k,) that go with it, in steps from the fit. Minus infinity where the filter breaks
    down: NaN would be above every other likelihood that it is compared with first.
    """
    A = np.zeros((series.y.shape[2], series.y.shape[2]))
    log_det = _run(
        linear, series, kind, size, memory, A, np.empty((1, 3, 2 + STATES)), np.empty((1, STATES, 1 + STATES))
    )
    if not (np.isfinite(A).all() and np.isfinite(log_det)):
        return -math.inf, np.zeros(A.shape[0] - 1)
    A += np.tril(A, -1).T
    g = A[1:, 0] + series.precision * series.off
    information = A[1:, 1:] + np.diag(series.precision)
    best = np.asarray(np.linalg.solve(information, g) if g.size else g, dtype=np.float64)
    square = A[0, 0] + float(np.sum(series.precision * series.off**2)) - float(g @ best)
    volume = float(np.linalg.slogdet(information)[1]) if g.size else 0.0
    return -0.5 * (float(square) + log_det + volume), best


def smoothed(linear: Linear, series: Series, kind: int, size: float, memory: float) -> tuple[Array, Array]:
    """(N,) mean and standard deviation of a disturbance given everything measured, the parameters at their best beside it."""
    _, steps = likelihood(linear, series, kind, size, memory)
    y = series.y[:, :, :1] - (series.y[:, :, 1:] @ steps)[:, :, None]
    n = y.shape[0]
    seen, ahead, out = np.empty((n, 3, 2 + STATES)), np.empty((n, STATES, 1 + STATES)), np.empty((n, 2))
    _run(linear, series._replace(y=y), kind, size, memory, np.zeros((1, 1)), seen, ahead)
    back(
        linear.F, linear.held, linear.H, linear.G[kind], linear.S[kind], series.variance, series.since, series.begins,
        memory, seen, ahead, out, np.zeros((3, STATES, STATES)),
    )  # fmt: skip
    return out[:, 0], np.sqrt(np.maximum(out[:, 1], 0.0))


def _run(
    linear: Linear, series: Series, kind: int, size: float, memory: float, products: Array, seen: Array, ahead: Array
) -> float:  # fmt: skip
    """`walk_filter.forward` on these arrays."""
    return forward(
        linear.F, linear.held, linear.H, linear.G[kind], linear.S[kind], *series[:8], size * size, memory, products,
        seen, ahead, np.zeros((STATES, series.y.shape[2])), np.zeros((3, STATES, STATES)),
    )  # fmt: skip
