"""The open-loop mixture is the paper's: equations 14 and 19, open loop, x_c = x, the smallest residual wins."""

from dataclasses import replace

import numpy as np
import pytest

from observer_fi.physics.faults import OPEN_LOOP
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import Log
from observer_fi.verdict.open_loop import Mixture, MixtureSettings, cut, models, open_loop

RIG = load_rig()
STEADY = np.array([410.0, 4.6e-4 / (0.0212 * 0.45)])  # w, I of a steady move: i = A/Km = Ki I


def steady_log(kind: str, seed: int = 0, noise: float = 1.0, speed: float = 410.0) -> Log:
    move = (Move(0.1, speed, 2.0),)
    return synthesise(Scenario(move, 2.4, fault=Fault(kind, 1.0), noise=noise, seed=seed), RIG)[0]


def detected(log: Log, at_s: float = 1.0) -> tuple[int, np.ndarray]:
    """Sample of a detection, and the true state there (noise averaged out of x)."""
    k = int(np.searchsorted(log.t, at_s))
    w = (log.z[k, 0] - RIG.model["Rm"] * log.z[k, 1]) / RIG.model["Km"]
    return k, np.array([w, log.z[k, 1] / RIG.model["Ki"], log.z[k, 2]])


@pytest.mark.parametrize(
    ("kind", "right"), [("none", "nominal"), ("overload", "overload"), ("coupling_loss",) * 2]
)
@pytest.mark.parametrize("speed", [410.0, -300.0])
def test_the_right_model_has_the_smallest_residual(kind: str, right: str, speed: float) -> None:
    log = steady_log(kind, seed=3, speed=speed)
    k, state = detected(log)
    estimate = open_loop(log, k, state, RIG, last=int(np.searchsorted(log.t, 2.0)))
    assert estimate.modes[int(estimate.probability[-1].argmax())] == right
    assert estimate.modes[int(estimate.nis[-1].argmin())] == right


def test_nis_is_the_squared_scalar_of_equation_19() -> None:
    log = steady_log("none", noise=1.0)
    k, state = detected(log)
    estimate = open_loop(log, k, state, RIG)
    Rm, Km = RIG.model["Rm"], RIG.model["Km"]
    std = MixtureSettings().std(RIG)
    V, i, x = (log.z[k:, c] for c in range(3))
    for j in range(len(OPEN_LOOP)):
        y = estimate.predicted[:, j]
        w = (y[:, 0] - Rm * y[:, 1]) / Km
        delta = np.column_stack((y[:, 1] - i, y[:, 2] - x, w - (V - Rm * i) / Km))
        expected = np.einsum("ki,ij,kj->k", delta, np.diag(std**-2.0), delta)
        np.testing.assert_allclose(estimate.nis[:, j], expected, rtol=1e-8, atol=1e-8)


def test_it_is_open_loop() -> None:
    """What is measured after the start changes residuals, never predictions."""
    log = steady_log("none")
    k, state = detected(log)
    other = replace(log, z=log.z + 1.0)
    np.testing.assert_array_equal(
        open_loop(log, k, state, RIG).predicted, open_loop(other, k, state, RIG).predicted
    )


def test_a_perfect_start_without_noise_leaves_no_nominal_residual() -> None:
    log = synthesise(Scenario((Move(0.1, 410.0, 2.0),), 2.4, noise=0.0), RIG)[0]
    estimate = open_loop(log, 0, np.zeros(3), RIG)
    assert np.sqrt(estimate.nis[:, 0]).max() < 1e-6


def test_the_overload_model_starts_at_its_contact_point() -> None:
    _, forward, loose = models(RIG.model, 1e-3, 1.0)
    _, backward, _ = models(RIG.model, 1e-3, -1.0)
    assert (forward["x_stop_high"], backward["x_stop_low"]) == (1e-3, 1e-3)
    assert loose["coupling"] == 0.0


def test_chunks_and_the_whole_agree() -> None:
    log = steady_log("overload", seed=1)
    k, state = detected(log, 0.05)  # at rest: the ramp of the command lies in a chunk border's neighbourhood
    whole = open_loop(log, k, state, RIG)
    mixture = Mixture(RIG, state, before=cut(log, 0, k))
    parts = [mixture.advance(cut(log, a, min(a + 61, log.t.size))) for a in range(k, log.t.size, 61)]
    np.testing.assert_allclose(np.concatenate([p.nis for p in parts]), whole.nis, rtol=1e-6)
    np.testing.assert_allclose(np.concatenate([p.probability for p in parts]), whole.probability, atol=1e-6)
    np.testing.assert_array_equal(np.concatenate([p.active for p in parts]), whole.active)


def test_probabilities_sum_to_one_and_missing_channels_do_not_count() -> None:
    log = steady_log("overload", seed=2)
    k, state = detected(log)
    z = log.z.copy()
    z[k + 100 : k + 200] = np.nan
    z[k + 300 :, 0] = np.nan
    estimate = open_loop(replace(log, z=z), k, state, RIG)
    np.testing.assert_allclose(estimate.probability.sum(axis=1), 1.0)
    assert np.isnan(estimate.nis[100:200]).all()
    assert (estimate.probability[100:200] == estimate.probability[99]).all()  # nothing measured: they hold
    assert np.isfinite(estimate.nis[300:]).all()
    full = open_loop(log, k, state, RIG)
    assert (estimate.nis[300:] <= full.nis[300:] + 1e-9).all()  # the speed needs the voltage
