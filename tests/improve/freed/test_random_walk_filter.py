"""The filter with one free disturbance against the Gaussian that it stands for, and the smoother against its conditional."""

import numpy as np
import pytest

from observer_fi.improve.freed.random_walk import Series, likelihood, smoothed
from observer_fi.learn.linear import Linear

ROWS, MEMORY, SIZE = 60, 0.02, 0.7
DT = 1e-3


def problem(seed: int = 1, parameters: int = 2) -> tuple[Linear, Series]:
    """Two moves of one log and one of another with made-up slopes; some readings are missing."""
    rng = np.random.default_rng(seed)
    F = np.tile([0.97, 0.2, 0.01, -0.05, 0.99, 0.04, 0.02], (ROWS, 1)) + 0.01 * rng.normal(size=(ROWS, 7))
    held = np.zeros(ROWS, dtype=np.bool_)
    held[35:39] = True
    linear = Linear(
        F, held, rng.normal(size=(ROWS, 6)), rng.normal(size=(1, ROWS, 3)), rng.normal(size=(1, ROWS, 3))
    )
    begins = np.zeros(ROWS, dtype=np.int64)
    begins[[0, 20, 45]] = 2, 1, 2
    variance = rng.uniform(0.5, 2.0, size=(ROWS, 3))
    variance[rng.random((ROWS, 3)) < 0.2] = np.inf
    since = np.full(ROWS, DT)
    since[20] = 0.03
    kick, caught = np.zeros(ROWS), np.zeros(ROWS)
    kick[30], caught[39] = 0.5, 0.3
    y = rng.normal(size=(ROWS, 3, 1 + parameters))
    start_var = rng.uniform(0.1, 1.0, size=(3, 2))
    return linear, Series(
        y, variance, since, begins, rng.normal(size=(3, 2)), start_var, kick, caught,
        rng.normal(size=parameters), rng.uniform(0.1, 1.0, size=parameters),
    )  # fmt: skip


def gaussian(linear: Linear, series: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean and covariance of all readings, row by row, and mean and covariance with the disturbance at every row.

    Every source of chance is a column of `carried` (4, sources); the states are followed as matrices.
    """
    sources: list[float] = []
    columns: list[np.ndarray] = []  # (rows, 4) path of a unit of each source
    mean, path = np.zeros(4), np.zeros((ROWS, 4))
    alive: list[np.ndarray] = []
    move = -1
    for k in range(ROWS):
        keep = np.exp(-series.since[k] / MEMORY) if series.begins[k] != 2 else 0.0
        A = np.diag([0.0, 0.0, 0.0, keep])
        if series.begins[k] == 0:
            f, g = linear.F[k - 1], linear.G[0, k - 1]
            A[1, 1] = A[2, 2] = 1.0
            A[1:3, 3] = g[1:]
            if not linear.held[k - 1]:
                A[0] = [f[0], f[1], f[2], g[0]]
                A[1, :2], A[2, :2] = f[3:5], f[5:7]
        mean = A @ mean
        alive = [A @ a for a in alive]
        new = [(3, SIZE**2 * (1 - keep**2)), (0, series.kick[k]), (1, series.caught[k])]
        if series.begins[k] != 0:
            move += 1
            mean[1:3] += series.start[move]
            new += [(1, series.start_var[move, 0]), (2, series.start_var[move, 1])]
        for state, variance in new:
            alive.append(np.eye(4)[state])
            sources.append(variance)
            columns.append(np.zeros((ROWS, 4)))
        for j, a in enumerate(alive):
            columns[j][k] = a
        path[k] = mean
    carried = np.stack(columns, axis=2) * np.sqrt(sources)  # (rows, 4, sources)
    H = np.zeros((ROWS, 3, 4))
    H[:, 0, :2], H[:, 1, :2] = linear.H[:, :2], linear.H[:, 2:4]
    H[:, 2, 0], H[:, 2, 2] = linear.H[:, 4], linear.H[:, 5]
    H[:, :, 3] = linear.S[0]
    shown = np.einsum("kcs,ksq->kcq", H, carried).reshape(3 * ROWS, -1)
    s = carried[:, 3]
    return np.einsum("kcs,ks->kc", H, path).ravel(), shown @ shown.T, s @ shown.T, s @ s.T


def test_likelihood_is_that_of_the_gaussian():
    linear, series = problem()
    mean, cov, _, _ = gaussian(linear, series)
    seen = np.isfinite(series.variance.ravel())
    y = series.y.reshape(3 * ROWS, -1)[seen]
    C = y[:, 1:]
    prior = np.diag(1.0 / series.precision)
    cov = cov[np.ix_(seen, seen)] + np.diag(series.variance.ravel()[seen]) + C @ prior @ C.T
    e = y[:, 0] - mean[seen] - C @ series.off
    expected = -0.5 * (e @ np.linalg.solve(cov, e) + np.linalg.slogdet(cov)[1])
    constant = 0.5 * (np.log(series.variance.ravel()[seen]).sum() - np.log(series.precision).sum())
    assert likelihood(linear, series, 0, SIZE, MEMORY)[0] == pytest.approx(expected + constant, rel=1e-9)


def test_smoothed_disturbance_is_the_conditional_of_the_gaussian():
    linear, series = problem(2, parameters=0)
    mean, cov, cross, own = gaussian(linear, series)
    seen = np.isfinite(series.variance.ravel())
    cov = cov[np.ix_(seen, seen)] + np.diag(series.variance.ravel()[seen])
    gain = np.linalg.solve(cov, cross[:, seen].T).T
    expected = gain @ (series.y[:, :, 0].ravel()[seen] - mean[seen])
    found, std = smoothed(linear, series, 0, SIZE, MEMORY)
    assert found == pytest.approx(expected, abs=1e-9)
    assert std**2 == pytest.approx(np.diag(own - gain @ cross[:, seen].T), abs=1e-9)


@pytest.mark.slow
def test_parameters_beside_the_disturbance_are_those_of_least_squares():
    linear, series = problem(3)
    _, found = likelihood(linear, series, 0, 0.0, MEMORY)
    for step in np.eye(2) * 1e-2:
        y = series.y.copy()
        y[:, :, 0] -= y[:, :, 1:] @ (found + step)
        moved = series._replace(y=y[:, :, :1], off=np.empty(0), precision=np.empty(0))
        best = y[:, :, 0] + y[:, :, 1:] @ step
        there = series._replace(y=best[:, :, None], off=np.empty(0), precision=np.empty(0))
        prior = 0.5 * float(
            np.sum(series.precision * ((found + step - series.off) ** 2 - (found - series.off) ** 2))
        )
        assert (
            likelihood(linear, moved, 0, 0.0, MEMORY)[0] - prior
            < likelihood(linear, there, 0, 0.0, MEMORY)[0]
        )


def test_a_filter_that_breaks_down_is_the_least_likely() -> None:
    linear, series = problem()
    spoilt = series.y.copy()
    spoilt[:, :, 1] *= 1e200
    found, best = likelihood(linear, series._replace(y=spoilt), 0, SIZE, MEMORY)
    assert found == -np.inf and not best.any() and best.size == 2
