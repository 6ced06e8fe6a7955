"""Section 3 step by step: each closed form against the truth that made the log, and against exact synthetic phases."""

from dataclasses import replace

import hidden
import numpy as np
import pytest

from observer_fi.learn import section3 as cf
from observer_fi.learn.contacts_and_losses import find_breaks
from observer_fi.logs.ingest import log_from_frame
from observer_fi.logs.moves import moves_from_rest
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

PAPER = load_rig().model


def log_of(spec: hidden.TruthSpec, seed: int = 1) -> Log:
    return log_from_frame(hidden.make_log(spec, seed)[0])


@pytest.fixture(scope="module")
def campaign() -> tuple[Log, tuple]:
    log = log_of(hidden.TruthSpec(hidden.campaign()))
    return log, moves_from_rest(log)


@pytest.fixture(scope="module")
def pressed() -> tuple[Log, tuple]:
    rig = replace(hidden.TABLE_1, stop_low_m=-5e-4, stop_high_m=6e-4)
    log = log_of(hidden.TruthSpec(hidden.contact_campaign(), rig), 2)
    return log, moves_from_rest(log)


def test_regression_is_the_textbook_one():
    rng = np.random.default_rng(3)
    H, unit = rng.normal(size=(50, 3)), np.array([1.0, 1e-6, 1e6])  # scales as far apart as kg m^2 and ohm
    y = H @ np.array([2.0, -3.0, 4.0]) + 0.1 * rng.normal(size=50)
    found, covariance = cf.regression(H * unit, y)
    x = np.linalg.solve(H.T @ H, H.T @ y)
    expected = np.linalg.inv(H.T @ H) * float((y - H @ x) @ (y - H @ x)) / 47
    np.testing.assert_allclose(found * unit, x, rtol=1e-10)
    np.testing.assert_allclose(covariance * np.outer(unit, unit), expected, rtol=1e-8, atol=1e-12)


def test_starts_at_full_speed_saturate_and_slow_ones_do_not(campaign):
    log, moves = campaign
    starts = cf.saturated_starts(log, moves, PAPER)
    assert {s.move for s in starts} >= {m for m in moves if abs(m.peak) == 410.0}
    slow = log_of(hidden.TruthSpec(hidden.there_and_back((90.0,), (1.0,), (0.0,))))
    assert cf.saturated_starts(slow, moves_from_rest(slow), PAPER) == []


def test_source_is_the_slope_and_intercept_of_voltage_against_current(campaign):
    log, moves = campaign
    step = cf.source(log, cf.saturated_starts(log, moves, PAPER))
    assert step is not None
    assert step.equation == "15"
    assert step.values["Vmax"] == pytest.approx(15.1, abs=5 * step.std["Vmax"] + 1e-3)
    assert step.values["Rs"] == pytest.approx(0.8, rel=0.03)
    assert cf.source(log, []) is None


def test_friction_is_the_line_of_torque_over_pitch(campaign):
    log, moves = campaign
    step = cf.friction(log, moves, PAPER)
    assert step is not None
    assert step.values["A"] == pytest.approx(4.6e-4, rel=2e-3)
    assert step.values["B"] == pytest.approx(2.3e-5, rel=5e-3)
    level = [m for m in moves if m.pitch == 0.0]
    only = cf.friction(log, level, PAPER)
    assert only is not None and set(only.values) == {"A"}  # one pitch says nothing of B


def test_inertia_from_the_saturated_exponential(campaign):
    log, moves = campaign
    step = cf.inertia(log, cf.saturated_starts(log, moves, PAPER), PAPER)
    assert step is not None
    assert step.values["J"] == pytest.approx(4.7e-7, rel=0.01)


def test_inertia_is_exact_on_an_exact_exponential():
    t = np.arange(0.0, 0.04, 1e-4)
    tau = (PAPER["Rm"] + PAPER["Rs"]) * 5e-7 / PAPER["Km"] ** 2
    w0 = (PAPER["Vmax"] - (PAPER["Rm"] + PAPER["Rs"]) * PAPER["A"] / PAPER["Km"]) / PAPER["Km"]
    w = w0 * (1.0 - np.exp(-t / tau))
    z = np.column_stack([PAPER["Km"] * w, np.zeros(t.size), np.zeros(t.size)])
    log = Log("exact", t, z, np.full(t.size, 410.0), np.zeros(t.size))
    move = moves_from_rest(replace(log, w_cmd=np.concatenate(([0.0], log.w_cmd[1:-1], [0.0]))))[0]
    step = cf.inertia(log, [cf.Start(0, t.size, move._replace(pitch=0.0))], PAPER)
    assert step is not None
    assert step.values["J"] == pytest.approx(5e-7, rel=1e-4)  # trapezoids over 0.1 ms


def test_gains_from_the_decaying_oscillation(campaign):
    log, moves = campaign
    step = cf.gains(log, moves, cf.saturated_starts(log, moves, PAPER), PAPER)
    assert step is not None
    assert step.values["Kp"] == pytest.approx(1.1e-3, rel=0.05)  # a sampled servo takes 3 % of the damping
    assert step.values["Ki"] == pytest.approx(0.45, rel=0.02)


def test_contact_is_the_quadratic_of_figure_4(pressed):
    log, moves = pressed
    breaks = find_breaks(log, moves, PAPER, 1e-5)
    assert breaks.stop_high == pytest.approx(6e-4, abs=5e-5)
    assert breaks.stop_low == pytest.approx(-5e-4, abs=5e-5)
    assert breaks.loss is None
    move = next(m for m in moves if m.peak == 410.0)
    step = cf.contact(log, move, PAPER, breaks.stop_high, 1.0)
    assert step is not None
    assert step.values["C"] == pytest.approx(85.0, rel=0.05)
    assert step.values["x_stop_high"] == pytest.approx(6e-4, abs=2e-5)
    squeeze = cf.compression(log, move, PAPER, breaks.stop_high, 1.0)
    assert squeeze is not None
    assert squeeze.values["E"] == pytest.approx(0.52, rel=0.01)


def test_decoupled_friction_and_inertia():
    spec = hidden.TruthSpec(
        hidden.there_and_back((410.0, 410.0), (1.5, 1.5), (0.0, 8.0)),
        fault=hidden.Fault("coupling_loss", 0.05),
    )
    log = log_of(spec, 4)
    moves = moves_from_rest(log)
    breaks = find_breaks(log, moves, PAPER, 1e-5)
    assert breaks.loss is not None
    drag = cf.friction(log, moves, PAPER, ("A_decoupled", ""))
    assert drag is not None and drag.equation == "13"
    assert drag.values["A_decoupled"] == pytest.approx(3.4e-4, rel=5e-3)
    mass = cf.inertia(log, cf.saturated_starts(log, moves, PAPER), PAPER, "J_decoupled")
    assert mass is not None
    assert mass.values["J_decoupled"] == pytest.approx(4.6e-7, rel=0.01)


def test_a_step_without_its_phase_gives_nothing(campaign):
    log, _ = campaign
    assert cf.friction(log, [], PAPER) is None
    assert cf.inertia(log, [], PAPER) is None
    assert cf.gains(log, [], [], PAPER) is None
    move = moves_from_rest(log)[0]
    assert cf.contact(log, move, override(PAPER, "far"), 1.0, 1.0) is None
    assert cf.compression(log, move, PAPER, 1.0, 1.0) is None
