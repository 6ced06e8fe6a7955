"""Tables of residuals: a residual that was put somewhere shows there, by phase, over its regressor, in its spectrum."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import campaign
from force_rig import DRAG, VISCOUS, D, Truth, log, rig

from observer_fi.improve.force.calculated_force import calculated_force
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.residual_tables import CHANNELS, residual_tables
from observer_fi.learn.move_data import run
from observer_fi.logs.moves import Phase
from observer_fi.physics import simulation as s
from observer_fi.physics.rigs import load_rig

RIG = load_rig()


@pytest.fixture(scope="module")
def fitted():
    problem = simulated_moves([campaign(seed=6, speeds=(410.0,), hold=0.6)], RIG)
    return problem.experiment, problem.baseline()


def with_residual(fitted, values):
    return replace(fitted, residuals=values)


def test_a_good_model_leaves_white_noise_everywhere(fitted):
    found = residual_tables(*fitted)
    assert found.channels == CHANNELS and found.unit == "noise"
    for name in ("steady", "rest", "saturation"):
        assert found.by_phase[name] == pytest.approx(np.ones(3), abs=0.35), name
    power = found.spectrum[1][5:400]
    assert (power.mean(axis=0) > 0.5).all()  # the even grid takes some of the fast noise away
    assert power.max() < 6.0  # a mean of four exponential variables, the largest of 1200


def test_phases_follow_the_command(fitted):
    experiment, _ = fitted
    phase = experiment.phase
    rows = experiment.rows(0)
    names = [Phase(k).name.lower() for k in dict.fromkeys(phase[rows].tolist())]
    assert names[0] == "rest" and names[-1] == "stop"
    assert {"saturation", "stabilisation", "steady"} <= set(names)
    since = experiment.t[rows] - experiment.t[rows][experiment.moving[0]]
    assert (phase[rows][since < 0.0] == Phase.REST).all()


def test_a_residual_of_one_phase_is_told_in_that_phase(fitted):
    experiment, one = fitted
    steady = experiment.phase == Phase.STEADY
    r = np.zeros_like(one.residuals)
    r[steady, 1] = 3.0
    found = residual_tables(experiment, with_residual(one, r)).by_phase
    assert found["steady"] == pytest.approx([0.0, 9.0, 0.0])
    assert all(np.all(mean == 0.0) for name, mean in found.items() if name != "steady")


def test_a_friction_follows_the_speed_and_a_load_does_not(fitted):
    """Curves are turned into the direction of motion: what changes sign with it adds up, the rest cancels."""
    experiment, one = fitted
    states, _ = run(experiment, one.model, one.nuisance)
    sign = np.sign(states[:, s.W])
    friction, load = np.zeros_like(one.residuals), np.zeros_like(one.residuals)
    friction[:, 1], load[:, 1] = 2.0 * sign, 2.0
    means = [
        residual_tables(experiment, with_residual(one, r)).curves["pitch"].mean[:, 1]
        for r in (friction, load)
    ]
    assert (means[0] > 1.0).all()
    assert (np.abs(means[1]) < 0.2).all()
    curve = residual_tables(experiment, with_residual(one, load)).curves["direction"]
    assert curve.mean[:, 1] == pytest.approx(2.0) and curve.count.sum() == experiment.t.size


def test_a_wave_stands_in_its_order_and_its_frequency(fitted):
    experiment, one = fitted
    states, _ = run(experiment, one.model, one.nuisance)
    r = np.zeros_like(one.residuals)
    r[:, 0] = np.sin(2.0 * np.pi * 50.0 * experiment.t)
    r[:, 1] = np.sin(3.0 * states[:, s.PHI])
    found = residual_tables(experiment, with_residual(one, r))
    frequency, power = found.spectrum
    assert frequency[np.argmax(power[:, 0])] == pytest.approx(50.0, abs=2.0)
    order, power = found.orders
    assert order[np.argmax(power[:, 1])] == pytest.approx(3.0, abs=0.1)


def test_force_tables_show_a_ripple_in_its_order():
    force = calculated_force([log(Truth(DRAG, DRAG, ripple=4.0), 10.0)], rig(**VISCOUS))
    found = force.tables(force.baseline())
    assert (found.channels, found.unit) == (("force",), "N")
    assert set(found.by_phase) == {"ramp", "steady"}
    assert found.z_minus_y.shape == (found.t.size, 1)
    order, power = found.orders
    assert order[np.argmax(power[:, 0] * (order > 0.5))] == pytest.approx(1.0, abs=0.1)
    assert found.curves["speed"].count.sum() == found.t.size
    assert found.curves["speed"].at.max() * D < 1.0  # rad/s of the motor, not m/s
