"""Integrals of readings of a slow log: the regression itself is tested with the identification."""

import numpy as np
import pytest

from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.learn.driven.from_voltage import circuit, from_voltage
from observer_fi.learn.driven.integral_regression import DRAG, _drag_hides_friction, _unknowns
from observer_fi.learn.driven.least_squares import integral
from observer_fi.learn.driven.windows import Window
from observer_fi.physics import DataSheet, Rig, rig_of_sheet


def test_an_integral_of_a_ring_of_twelve_samples_is_that_of_its_curve() -> None:
    """By trapezoids it lost 2 %, and a winding learned at 250 Hz was 1 % off."""
    t = np.arange(60) / 250.0
    ring = 2.0 * np.pi * 250.0 / 12.0
    exact = (1.0 - np.cos(ring * t)) / ring
    off = np.abs(integral(t, np.sin(ring * t)) - exact).max()
    assert off < 0.3 * np.abs(motor_angle(t, np.sin(ring * t)) - exact).max()


def test_of_a_few_samples_it_is_by_trapezoids() -> None:
    t, y = np.array([0.0, 0.1, 0.3]), np.array([1.0, 2.0, 2.0])
    np.testing.assert_allclose(integral(t, y), [0.0, 0.15, 0.55])
    assert integral(t[:1], y[:1]) == 0.0


SHEET = DataSheet(
    "soft", "voltage", resistance=0.6, torque_constant=0.06, rotor_inertia=5e-5, lead=5e-3, mass=2.0, travel=0.5, supply=24.0
)  # fmt: skip


def soft_windows(rig: Rig, seed: int) -> list[Window]:
    """Softly started moves either way, a quarter of a second a window: the current hardly changes by more than its noise."""
    rng, p, windows = np.random.default_rng(seed), rig.model, []
    t = np.arange(250) / 1000.0
    for k in range(60):
        way, phase, top = (-1.0) ** k, rng.uniform(0.0, 2.0 * np.pi), rng.uniform(100.0, 300.0)
        w = way * top * (1.0 + 0.3 * np.sin(6.0 * t + phase))
        i = (p["J"] * np.gradient(w, t) + way * p["A"]) / p["Km"]
        V, x = p["Rm"] * i + p["Km"] * w, p["D"] * motor_angle(t, w)
        z = np.column_stack([V, i, x]) + np.array([5e-3, 30e-3, 1e-4]) * rng.normal(size=(t.size, 3))
        windows.append(Window(t, z, np.zeros(t.size), w, way))
    return windows


@pytest.mark.slow
def test_the_noise_of_the_current_makes_no_resistance_smaller() -> None:
    """Plain least squares took it for half of what it is, and every other constant with it."""
    rig = rig_of_sheet(SHEET).rig
    found = [circuit(w, _unknowns(w)).of(0) for w in (soft_windows(rig, seed) for seed in range(12))]
    Rm, std = np.array(found).T / rig.model["Rm"]
    assert abs(Rm.mean() - 1.0) < 3.0 * std.mean() / np.sqrt(Rm.size)
    assert np.abs((Rm - 1.0) / std).max() < 4.0
    windows = soft_windows(rig, 0)
    assert circuit(windows, _unknowns(windows), plain=True).x[0] / rig.model["Rm"] < 1.0 - 4.0 * std.mean()


@pytest.mark.slow
@pytest.mark.study
def test_what_the_position_tells_of_a_winding_is_told_with_it() -> None:
    """Softly started moves tell equation 2 less of a resistance than equation 8."""
    rig = rig_of_sheet(SHEET).rig
    off, narrower = [], []
    for seed in range(12):
        windows = soft_windows(rig, 20 + seed)
        s = from_voltage(windows, rig, _unknowns(windows))
        off.append((s.values[0] - rig.model["Rm"]) / np.sqrt(s.covariance[0, 0]))
        narrower.append(np.sqrt(s.covariance[0, 0]) / circuit(windows, _unknowns(windows)).of(0)[1])
    assert np.abs(off).max() < 4.0 and np.median(narrower) < 1.0


@pytest.mark.parametrize(
    ("friction", "drag", "hides"),
    [(1e-3, -2e-6, True), (1e-3, 1e-6, True), (1e-3, 9e-6, False), (4e-3, -2e-6, False)],
)
def test_a_drag_that_is_none_hides_no_friction(friction: float, drag: float, hides: bool) -> None:
    """Beside a drag that was free and less than none friction had no value, and each fault behind it was health for sure."""
    covariance = np.diag([1e-7, 6e-4, 3e-6]) ** 2
    assert _drag_hides_friction(("J", "A", DRAG), np.array([7e-6, friction, drag]), covariance) is hides
    assert not _drag_hides_friction(("J", "A"), np.array([7e-6, friction]), covariance[:2, :2])
