"""One step of the plant: its rules against each other and against textbooks, its small laws by hand."""

import math

import numpy as np
import pytest

from observer_fi.physics import equations as a
from observer_fi.physics import plant
from observer_fi.physics.rigs import load_rig, override

PLANT = load_rig().model
FREE = plant.Free(0.0, 0.0)
COLD = plant.Slow(0.0, 0.0, 0.0, 0.0)


def held(w_cmd: float) -> plant.Command:
    return plant.Command(*(w_cmd,) * 6)


def motion(w: float = 0.0, I: float = 0.0, c: float = 0.0) -> plant.Motion:
    return plant.Motion(w, I, 0.0, 0.0, plant.inner_at(0.0, c))


def run(rule, m: plant.Motion, p: np.ndarray, w_cmd: float, seconds: float, steps: int) -> plant.Motion:  # type: ignore[no-untyped-def]
    for _ in range(steps):
        m, _ = plant.step(rule, m, COLD, seconds / steps, held(w_cmd), 2.0, FREE, p)
    return m


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects",
    [{}, {"current_lag": 2e-3}, {"current_lag": 2e-3, "lag_behind_limit": 1.0}, {"integrator_limit": 0.5}],
)
@pytest.mark.first(1)
def test_both_rules_come_to_the_same_motion(effects: dict[str, float]) -> None:
    """From rest through break-away, saturation and, where there is one, the clamp, which no rule sees before it is there."""
    p = override(PLANT, "nominal", **effects).vector
    exact = run(plant.runge_kutta, motion(), p, 410.0, 0.02, 2000)
    coarse = run(plant.midpoint, motion(), p, 410.0, 0.02, 200)
    fine = run(plant.midpoint, motion(), p, 410.0, 0.02, 800)
    assert exact.w > 50.0
    close = 0.01 if "integrator_limit" in effects else 2e-4
    fine, coarse, exact = (np.array([*m[:-1], *m.inner]) for m in (fine, coarse, exact))
    np.testing.assert_allclose(fine, exact, rtol=close, atol=1e-8)
    np.testing.assert_allclose(coarse, exact, rtol=4.0 * close, atol=1e-8)


@pytest.mark.parametrize("rule", [plant.runge_kutta, plant.midpoint])
def test_friction_holds_what_it_can_and_no_more(rule) -> None:  # type: ignore[no-untyped-def]
    p = PLANT.vector
    within = 0.9 * p[a.A] / (p[a.KM] * p[a.KI])
    m, rests = plant.step(rule, motion(I=within), COLD, 1e-3, held(0.0), 0.0, FREE, p)
    assert rests == 1.0 and m.w == 0.0 and within == m.I
    m, rests = plant.step(rule, motion(I=1.2 / 0.9 * within), COLD, 1e-3, held(0.0), 0.0, FREE, p)
    assert rests == 0.0 and m.w > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("rule", [plant.runge_kutta, plant.midpoint])
def test_a_step_is_cut_where_the_motor_stops(rule) -> None:  # type: ignore[no-untyped-def]
    """Braked by friction alone (no servo): w = w0 - A t / J, then rest; the angle is that of a straight line in between."""
    p = override(PLANT, "nominal", Kp=0.0, Ki=0.0).vector
    m, rests = plant.step(rule, motion(w=0.5), COLD, 6e-4, held(0.0), 0.0, FREE, p)
    assert rests == 1.0 and m.w == 0.0
    assert m.inner.phi == pytest.approx(0.5 * 0.5**2 * p[a.J] / p[a.A], rel=0.2)


def test_the_integral_stops_at_its_clamp_and_comes_back_from_it() -> None:
    p = override(PLANT, "nominal", integrator_limit=0.5).vector
    assert plant.winding_up(1.0, 0.6, p) == 0.0
    assert plant.winding_up(-1.0, 0.6, p) == -1.0
    assert plant.winding_up(1.0, 0.4, p) == 1.0
    assert plant.winding_up(1.0, 0.6, PLANT.vector) == 1.0


def test_a_lag_is_behind_a_ramp_by_its_time() -> None:
    """T dy/dt = x - y for x = v t: x - y tends to v T, from 0 as v T (1 - exp(-t / T))."""
    behind = 0.0
    for _ in range(10):
        behind = plant.lag_behind(behind, 2.0 * 0.01, 0.01, 0.05)
    assert behind == pytest.approx(2.0 * 0.05 * (1.0 - math.exp(-0.1 / 0.05)), rel=1e-12)


def test_play_ends_at_either_side() -> None:
    p = override(PLANT, "nominal", backlash=2e-4).vector
    assert [plant.in_play(s, p) for s in (-3e-4, -5e-5, 0.0, 5e-5, 3e-4)] == [-1e-4, -5e-5, 0.0, 5e-5, 1e-4]


def test_slow_states_follow_current_and_clock() -> None:
    p = override(
        PLANT,
        "nominal",
        heating_gain=0.01,
        sag_resistance=2.0,
        sag_time=0.1,
        supply_drift=0.3,
        warmup_rise=0.5,
        warmup_time=40.0,
    ).vector
    slow = plant.settled(COLD, 0.5, 1e-3, 20.0, p)
    assert slow.h == pytest.approx(1e-3 * 0.01 * p[a.RM] * 0.25)
    assert slow.sag == pytest.approx(2.0 * 0.5 * (1.0 - math.exp(-0.01)))
    assert slow.drift == pytest.approx(6.0)
    assert slow.cold == pytest.approx(0.5 * math.exp(-0.5))
    assert plant.settled(COLD, 0.5, 1e-3, 20.0, PLANT.vector) == COLD


def test_a_force_drives_the_mass_by_newton() -> None:
    """F D - A = J dw/dt, semi-implicit Euler; the sign of friction builds up over SIGN_LENGTH."""
    p, s, m, force = PLANT.vector, 1.0, motion(w=100.0), 400.0
    after, later = plant.sampled_force(s, m, force, 1e-4, 0.0, p)
    assert after == 1.0
    assert later.w == pytest.approx(100.0 + 1e-4 * (force * p[a.D] - p[a.A]) / p[a.J])
    assert later.x == pytest.approx(1e-4 * p[a.D] * later.w)
    turned, _ = plant.sampled_force(-1.0, m, force, 1e-4, 0.0, p)
    assert -1.0 < turned < 1.0
