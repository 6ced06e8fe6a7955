"""Residuals of equation 14 and the scalar of equation 19, by hand."""

import numpy as np
import pytest

from observer_fi.physics import equations as a
from observer_fi.physics.paper_residuals import residual_norm, residual_vector, sensor_std, speed
from observer_fi.physics.rigs import load_rig

RIG = load_rig()
P = RIG.model.vector


def test_speed_is_equation_16() -> None:
    V = a.terminal_voltage(0.1, 300.0, 0.0, P)
    assert speed(np.array([V, 0.1, 0.0]), P) == pytest.approx(300.0)
    assert speed(np.zeros((4, 2, 3)), P).shape == (4, 2)


def test_residuals_are_predicted_minus_measured_current_position_speed() -> None:
    predicted, z = np.array([9.0, 0.03, 2e-3]), np.array([8.788, 0.02, 1e-3])
    r = residual_vector(predicted, z, P)
    w = (0.212 - 20.2 * 0.01) / 0.0212
    np.testing.assert_allclose(r, [0.01, 1e-3, w], atol=1e-12)
    many = residual_vector(np.tile(predicted, (5, 3, 1)), np.tile(z, (5, 1, 1)), P)
    assert many.shape == (5, 3, 3)
    np.testing.assert_array_equal(many[2, 1], r)


def test_norm_is_equation_19_with_a_diagonal_covariance() -> None:
    r, std = np.array([[0.3, -4.0, 0.0], [1.0, np.nan, 2.0]]), np.array([0.1, 1.0, 2.0])
    np.testing.assert_allclose(residual_norm(r, std), [5.0, np.sqrt(101.0)])
    full = r[0] @ np.linalg.inv(np.diag(std**2)) @ r[0]
    assert residual_norm(r[0], std) == pytest.approx(np.sqrt(full))


def test_spread_of_the_residuals_is_that_of_simulated_noise() -> None:
    noise = np.random.default_rng(1).normal(size=(200_000, 3)) * RIG.noise_std
    r = residual_vector(np.zeros(3), noise, P)
    np.testing.assert_allclose(r.std(axis=0), sensor_std(RIG.noise_std, P), rtol=0.01)  # 0.2 % expected
    # why the bank scores V, i, x: the speed's error is correlated with the current's
    assert np.corrcoef(r[:, 0], r[:, 2])[0, 1] < -0.4
    assert P[a.RM] / P[a.KM] == pytest.approx(953.0, abs=0.5)
