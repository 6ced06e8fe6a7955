"""What stays without a name: a sensor that drifts or tilts between the moves, and nothing where nothing is left."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG, campaign

from observer_fi.improve.moves.rig_refit import base_parameters
from observer_fi.improve.moves.unexplained import KINDS, response, rest_steps, slow_excess, smooth_terms
from observer_fi.learn.linear import RESISTANCE, TORQUE, TRAVEL, linearised
from observer_fi.learn.move_data import prepare, run, simulate, whitened
from observer_fi.learn.output_error import fit
from observer_fi.logs import log_from_frame
from observer_fi.logs.moves import moves_from_rest
from observer_fi.physics.rigs import override

# What a servo may do that has no name, and what it goes with in words.
OF_A_SERVO = {
    "kp_by_error": "error of the speed [rad/s]",
    "frozen_integral": "error of the speed at the limit [rad/s]",
}
LOG = campaign(seed=21, speeds=(410.0, 200.0, 90.0))


def steps_of(error: np.ndarray) -> list:
    experiment = prepare([replace(LOG, z=LOG.z + error[:, None] * np.array([0.0, 0.0, 1.0]))], RIG)
    return rest_steps(experiment, fit(experiment, RIG.model, base_parameters(RIG, RIG.model)))


@pytest.mark.parametrize(
    "regressor, error",
    [("pitch", 1e-6 * LOG.pitch), ("time", 4e-5 * (1.0 - np.exp(-LOG.t / 5.0)))],
)
def test_drift_and_tilt_show_in_the_steps_between_moves(regressor, error):
    best = max(steps_of(error), key=lambda term: term.held_out)
    assert best.regressor == regressor
    assert best.held_out > 20.0
    assert best.share > 0.5


def test_steps_of_a_good_sensor_say_nothing():
    assert all(term.held_out < 5.0 for term in steps_of(np.zeros(LOG.t.size)))


def test_slow_excess_sees_slow_misfit_only():
    experiment = prepare([LOG], RIG)
    white = np.random.default_rng(2).normal(size=(experiment.t.size, 3))
    blocks = experiment.t.size * 3 / 8
    assert abs(slow_excess(experiment, white)) < 4.0 * np.sqrt(blocks / 2.0)
    assert slow_excess(experiment, white + 0.2) > 0.5 * 0.04 * 3 * experiment.t.size * 0.9


@pytest.mark.parametrize(
    ("equation", "kind", "parameter", "size"),
    [
        ("torque", TORQUE, "torque_offset", 1e-6),
        ("electrical", RESISTANCE, "Rm", 1e-2),
        ("kinematics", TRAVEL, "slip", -1e-4),
    ],
)
def test_the_response_is_what_the_simulation_shows(equation, kind, parameter, size):
    """A constant disturbance of an equation against the same change of a parameter of the simulated plant."""
    experiment = prepare([LOG], RIG)
    fitted = fit(experiment, RIG.model, base_parameters(RIG, RIG.model))
    states, plain = run(experiment, fitted.model, fitted.nuisance)
    linear = linearised(experiment, fitted.model, states)
    got = response(experiment, linear, kind, np.ones((1, experiment.t.size)))[0]
    changed = override(fitted.model, "changed", **{parameter: fitted.model[parameter] + size})
    exact = (simulate(experiment, changed, fitted.nuisance) - plain) / size * experiment.weight
    exact = whitened(experiment, exact)
    assert kind in KINDS[equation]
    for channel in range(3):
        scale = np.sqrt(np.mean(exact[:, channel] ** 2))
        if scale * size > 1e-6:
            error = np.sqrt(np.mean((got - exact)[:, channel] ** 2)) / scale
            assert error < 0.2, (channel, error)


def test_moves_that_no_fit_took_are_no_steps_of_the_sensor():
    cut = moves_from_rest(LOG)
    experiment = prepare([LOG], RIG, [cut[::2]])
    found = rest_steps(experiment, fit(experiment, RIG.model, base_parameters(RIG, RIG.model)))
    assert all(term.held_out < 5.0 for term in found)


@pytest.mark.parametrize("cause", OF_A_SERVO)
@pytest.mark.parametrize("seed", [7401, 7402])
@pytest.mark.slow
@pytest.mark.first(1)
def test_what_a_servo_misses_goes_with_its_own_error(cause: str, seed: int) -> None:
    """It was a torque over speed, load or pitch, or nothing."""
    spec = hidden.draw_effects_case(seed, (cause,), 10.0)
    experiment = prepare([log_from_frame(hidden.make_log(spec, seed)[0])], RIG)
    fitted = fit(experiment, RIG.model, base_parameters(RIG, RIG.model))
    best = smooth_terms(experiment, fitted, 1.0)[0]
    assert (best.equation, best.over) == ("servo", OF_A_SERVO[cause])
    assert best.unit in ("rad/s", "A")
    assert not best.can_be_kept


@pytest.mark.slow
def test_an_unbalance_that_gravity_turns_is_a_wave_over_the_angle_as_high_as_the_pitch() -> None:
    spec = hidden.draw_effects_case(7411, ("tilted_unbalance",), 10.0)
    experiment = prepare([log_from_frame(hidden.make_log(spec, 7411)[0])], RIG)
    fitted = fit(experiment, RIG.model, base_parameters(RIG, RIG.model))
    best = smooth_terms(experiment, fitted, 1.0)[0]
    assert (best.equation, best.regressor, best.order) == ("torque", "shaft_angle", 1.0)
