"""A command that changes softly is linear between samples; a trapezoid keeps its corners."""

import numpy as np
import pytest

from observer_fi.physics.command import corners

ACCEL, T = 60_000.0, np.arange(200) / 1600.0


def area(w: np.ndarray) -> float:
    """Integral of the command that goes through these samples [rad]."""
    knots, values = corners(T, w, ACCEL)
    return float(np.trapezoid(values, knots))


@pytest.mark.parametrize("slope", [-5000.0, -300.0, 20.0, 600.0, 10_000.0])
def test_a_soft_ramp_is_no_staircase(slope: float) -> None:
    """But for its first interval, of which nobody knows yet what it is."""
    w = 100.0 + slope * T
    late = abs(slope) * (T[1] - T[0]) ** 2
    assert abs(area(w) - float(np.trapezoid(w, T))) <= late


def test_a_curve_is_no_staircase() -> None:
    w = 150.0 * np.sin(2.0 * np.pi * 4.0 * T)
    steps = np.abs(np.diff(w)).sum() * (T[1] - T[0]) / 2.0  # what corners in every interval would make of it
    assert abs(area(w) - float(np.trapezoid(w, T))) < 0.05 * steps


@pytest.mark.parametrize("begin", [0.0101, 0.0103, 0.0105])
def test_a_trapezoid_keeps_its_corners(begin: float) -> None:
    w = np.clip((T - begin) * ACCEL, 0.0, 410.0)
    fine = np.linspace(0.0, T[-1], 400_001)
    exact = float(np.trapezoid(np.clip((fine - begin) * ACCEL, 0.0, 410.0), fine))
    assert area(w) == pytest.approx(exact, abs=1e-4)
