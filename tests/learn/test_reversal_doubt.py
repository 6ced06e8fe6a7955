"""Doubt after reversals: the loop's response against an integrator, the whitening against its matrix, what it absorbs."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import RIG, campaign
from scipy.integrate import solve_ivp

from observer_fi.learn.move_data import prepare, unwhitened, whitened
from observer_fi.learn.reversal_doubt import Doubt, _response, doubt_along, doubt_of, subtract_doubt


def test_response_is_the_loop_after_a_step_in_speed():
    m = RIG.model
    since = np.arange(-3, 60) / 1600.0 + 1e-4

    def rates(t, s):
        di = m["Ki"] * s[1] - m["Kp"] * s[0]
        return [m["Km"] / m["J"] * di, -s[0], m["D"] * s[0]]

    first = since > 0.0
    w, I, x = solve_ivp(
        rates, (0.0, since[-1]), [1.0, 0.0, 0.0], t_eval=since[first], rtol=1e-10, atol=1e-14
    ).y
    di = m["Ki"] * I - m["Kp"] * w
    y = _response(since, np.inf, np.zeros(since.size, dtype=bool), m)
    assert y[~first] == pytest.approx(0.0)
    assert y[first] == pytest.approx(
        np.stack([m["Rm"] * di + m["Km"] * w, di, x], axis=1), rel=1e-6, abs=1e-9
    )


def test_whitening_is_the_root_of_the_covariance():
    rng = np.random.default_rng(1)
    B = rng.normal(size=(2, 12))
    _, size, v = np.linalg.svd(B, full_matrices=False)
    values, vectors = np.linalg.eigh(np.eye(12) + B.T @ B)
    r = rng.normal(size=(5, 3))
    expected = np.concatenate([r[:1].ravel(), vectors @ np.diag(values**-0.5) @ vectors.T @ r[1:].ravel()])
    subtract_doubt(r, Doubt(1, v, 1.0 - 1.0 / np.sqrt(1.0 + size**2)))
    assert r.ravel() == pytest.approx(expected)


def test_whitening_can_be_undone():
    experiment = prepare([campaign(seed=11)], RIG)
    r = np.random.default_rng(2).normal(size=(experiment.t.size, 3)) * (experiment.weight > 0.0)
    white = whitened(experiment, r.copy())
    assert np.abs(white - r).max() > 0.1
    assert unwhitened(experiment, white) == pytest.approx(r, abs=1e-9)


def test_steps_in_speed_are_told_with_their_rows():
    experiment = prepare([campaign(seed=11)], RIG)
    for m, doubt in enumerate(experiment.doubts):
        rows = experiment.rows(m)
        w = (experiment.z[rows, 0] - RIG.model["Rm"] * experiment.z[rows, 1]) / RIG.model["Km"]
        assert doubt.kicks and doubt.first <= doubt.kicks[0][0] <= doubt.kicks[-1][0] <= doubt.still
        for row, std in doubt.kicks:
            assert w[row - 4] * w[row + 4] < 0.0
            assert std == pytest.approx(1e-4 * abs(w[row + 3] - w[row - 3]) * 1600.0 / 6.0, rel=0.3)
        assert np.abs(w[doubt.still + 2 :]).max() < 4.0


def test_a_speed_lost_at_a_reversal_is_hardly_seen():
    experiment = prepare([campaign(seed=11)], RIG)
    lost = np.zeros((experiment.t.size, 3))
    for m, doubt in enumerate(experiment.doubts):
        rows = experiment.rows(m)
        t, z = experiment.t[rows], experiment.z[rows]
        w = (z[:, 0] - RIG.model["Rm"] * z[:, 1]) / RIG.model["Km"]
        last = np.flatnonzero(np.abs(w) > 3.0)[-1]
        since = t - t[doubt.first] + 3e-4
        never = np.zeros(t.size, dtype=bool)
        lost[rows] = (
            0.5 * _response(since, t[last] - t[doubt.first], never, RIG.model) * experiment.weight[rows]
        )
    before = np.sum(lost**2)
    assert before > 400.0
    assert (
        np.sum(whitened(experiment, lost) ** 2) < 0.1 * before
    )  # the instant is taken to half a sample here


def test_a_move_without_reversals_has_no_doubt():
    log = campaign(seed=12)
    still = prepare([replace(log, z=log.z * np.array([0.0, 0.0, 1.0]))], RIG)
    assert all(doubt.share.size == 0 for doubt in still.doubts)
    r = np.ones((still.t.size, 3))
    assert (whitened(still, r) == 1.0).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_reversal_is_within_its_move(seed: int) -> None:
    """Of noise alone, as of a sensor that is dead, a line may pass zero past the end of a move."""
    rng = np.random.default_rng(seed)
    z = np.zeros((400, 3))
    z[:, 0] = 0.4 * rng.normal(size=400)
    doubt = doubt_of(np.arange(400) / 1600.0, z, np.ones((400, 3)), 300, RIG.model)
    assert all(row < 400 for row, _ in doubt.kicks)


def test_nothing_is_open_along_no_directions_or_those_of_a_model_that_ran_away() -> None:
    for B in (np.empty((0, 5, 3)), np.full((2, 5, 3), np.nan)):
        r = np.ones((5, 3))
        subtract_doubt(r, doubt_along(B))
        assert (r == 1.0).all()


def test_what_no_direction_touches_stays_exactly_as_it_is() -> None:
    B = np.random.default_rng(3).normal(size=(3, 40, 3))
    B[:, 7:12, 1] = 0.0
    r = np.zeros((40, 3))
    r[:5] = 1.0
    subtract_doubt(r, doubt_along(B))
    assert (r[7:12, 1] == 0.0).all() and r.any()
