"""The linearised plant against differences of the plant itself."""

import numpy as np
import pytest
from scipy.linalg import expm

from observer_fi.physics import equations as a
from observer_fi.physics import linear, plant
from observer_fi.physics.rigs import load_rig, override

PLANT = load_rig().model
FREE = plant.Free(0.0, 0.0)
WARM = plant.Slow(0.05, 0.2, 0.1, 0.0)
EFFECTS = {"viscous_positive": 2e-7, "stribeck_torque": 1e-4, "friction_slope": 0.3}


@pytest.mark.parametrize("w", [100.0, 410.0])
@pytest.mark.parametrize("I", [0.05, 1.5])
def test_slopes_are_those_of_the_rates(w: float, I: float) -> None:
    p = override(PLANT, "nominal", **EFFECTS).vector
    at = np.array([w, I, 1e-3])

    def rates(y: np.ndarray) -> np.ndarray:
        m = plant.Motion(y[0], y[1], y[2], 0.0, plant.inner_at(0.0, 0.0))
        r = plant.rates(1.0, m, WARM, 410.0, 410.0, 3.0, FREE, p)
        return np.array([r.w, r.x])

    m = plant.Motion(*at, 0.0, plant.inner_at(0.0, 0.0))
    by_w, by_I, by_x, x_by_w, *_ = linear.motion_slopes(m, WARM, 410.0, 3.0, FREE, p)
    differences = [(rates(at + d) - rates(at - d)) / (2.0 * d.max()) for d in np.diag([1e-3, 1e-5, 1e-7])]
    np.testing.assert_allclose([by_w, by_I, by_x], [d[0] for d in differences], rtol=5e-3, atol=1e-3)
    assert x_by_w == pytest.approx(differences[0][1], rel=1e-6)


def test_a_step_is_the_exponential_to_second_order() -> None:
    by_w, by_I, by_x, x_by_w, t = -50.0, 2e4, -30.0, 1.9e-6, 6e-4
    G = np.array([[by_w, by_I, by_x], [-1.0, 0.0, 0.0], [x_by_w, 0.0, 0.0]])
    f = linear.motion_transition(by_w, by_I, by_x, 0.0, x_by_w, t)
    F = np.array([[f[0], f[1], f[2]], [f[3], f[4], 0.0], [f[5], f[6], 1.0]])
    second = np.eye(3) + G * t + (G * t) @ (G * t) / 2.0
    second[1, 2] = 0.0  # left out: what a place does to the integral within one step
    np.testing.assert_allclose(F, second, atol=1e-12)
    np.testing.assert_allclose(F, expm(G * t), rtol=0.02, atol=1e-5)
    push = linear.constant_transition(by_w, by_x, 0.0, 3.0, 0.5, t)
    assert push == pytest.approx((G * t @ [3.0 * t, 0.0, 0.5 * t])[0] / 2.0 + 3.0 * t)


@pytest.mark.parametrize("I", [0.05, 1.5])
@pytest.mark.parametrize("effects", [{}, {"current_gain": 1.1, "current_offset": 1e-3}])
def test_slopes_of_voltage_and_current(I: float, effects: dict[str, float]) -> None:
    p = override(PLANT, "nominal", **effects).vector

    def read(w: float, integral: float, supply: float) -> np.ndarray:
        q = p.copy()
        q[a.VMAX] *= supply
        (V, *_), (i, *_) = linear.electrical_readings(w, integral, 0.0, WARM, 410.0, q, p[a.VMAX])
        return np.array([V, i])

    (_, *of_V), (_, *of_i) = linear.electrical_readings(300.0, I, 0.0, WARM, 410.0, p, p[a.VMAX])
    at = np.array([300.0, I, 1.0])
    for k, size in enumerate((1e-3, 1e-6, 1e-6)):
        d = np.eye(3)[k] * size
        slope = (read(*(at + d)) - read(*(at - d))) / (2.0 * size)
        np.testing.assert_allclose([of_V[k], of_i[k]], slope, rtol=1e-5, atol=1e-8)


def test_the_slope_of_a_periodic_error_is_seen() -> None:
    p = override(PLANT, "nominal", position_sin=5e-5, position_gain=1.02).vector
    x = 2.3e-4
    _, slope = linear.sensed_position(x, p)
    exact = 1.02 + 5e-5 * 2e3 * np.pi * np.cos(2e3 * np.pi * x)
    assert slope == pytest.approx(exact, rel=5e-3)
    assert linear.sensed_position(x, PLANT.vector) == (x, 1.0)
