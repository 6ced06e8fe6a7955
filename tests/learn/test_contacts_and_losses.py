"""Contact points and coupling losses: found where the truth has them, and nowhere else."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import log_of

from observer_fi.learn.contacts_and_losses import (
    find_breaks,
    find_stops,
    motor_angle,
    speed_of,
    stops_of_travel,
)
from observer_fi.learn.move_data import prepare
from observer_fi.logs.moves import moves_from_rest
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

RIG = load_rig()
PAPER = RIG.model
HIGH, LOW = 6e-4, -5e-4
GRID = 4e-5  # m, between the places that `find_stops` tries on these logs


@pytest.fixture(scope="module")
def pressed() -> Log:
    return log_of(hidden.contact_campaign(), replace(hidden.TABLE_1, stop_low_m=LOW, stop_high_m=HIGH), 2)


@pytest.fixture(scope="module")
def free() -> Log:
    return log_of(hidden.campaign(), seed=3)


def breaks_of(log: Log):
    return find_breaks(log, moves_from_rest(log), PAPER, 1e-5)


# --- by travel -----------------------------------------------------------------------------------


def test_motor_angle_and_speed_bridge_missing_samples():
    t = np.arange(5) * 0.1
    z = np.column_stack([PAPER["Km"] * 100.0 * np.ones(5), np.zeros(5), np.zeros(5)])
    z[2, 0] = np.nan
    log = Log("gap", t, z, np.zeros(5), np.zeros(5))
    np.testing.assert_allclose(speed_of(log, PAPER), 100.0)
    np.testing.assert_allclose(motor_angle(t, np.full(5, 100.0)), 100.0 * t)


def test_the_low_stop_is_the_mirror_of_the_high_one(pressed):
    mirrored = replace(pressed, z=-pressed.z, w_cmd=-pressed.w_cmd, pitch=-pressed.pitch)
    one, other = breaks_of(pressed), breaks_of(mirrored)
    assert one.stop_high == pytest.approx(-other.stop_low)
    assert one.stop_low == pytest.approx(-other.stop_high)


@pytest.mark.slow
def test_backlash_and_a_lagging_sensor_are_neither_a_stop_nor_a_loss():
    for cause, values in (("backlash", 1.5e-4), ("backlash", 4e-4), ("position_lag", 0.04)):
        made = hidden.sized_effect(cause, 1.0, np.random.default_rng(1))
        made = replace(
            made,
            values=tuple((name, values) if k == 0 else (name, v) for k, (name, v) in enumerate(made.values)),
        )
        log = log_of(hidden.campaign(), seed=5, effects=(made,))
        assert breaks_of(log) == (None, None, None)


def test_a_loss_is_where_the_mass_stands_for_good():
    log = log_of(hidden.campaign(), seed=2, fault=hidden.Fault("coupling_loss", 11.0))
    found = breaks_of(log)
    assert log.t[found.loss] == pytest.approx(11.0, abs=0.03)
    assert (found.stop_high, found.stop_low) == (None, None)


def test_stops_of_travel_are_those_that_the_model_lacks(pressed, free):
    experiment = prepare([pressed], RIG)
    found = stops_of_travel(experiment, [pressed], PAPER)
    assert found == {"x_stop_high": pytest.approx(HIGH, abs=5e-5), "x_stop_low": pytest.approx(LOW, abs=5e-5)}
    known = override(PAPER, "one stop", x_stop_high=HIGH)
    assert set(stops_of_travel(experiment, [pressed], known)) == {"x_stop_low"}
    assert stops_of_travel(prepare([free], RIG), [free], PAPER) == {}


# --- by the steady torque ------------------------------------------------------------------------


def test_the_torque_of_steady_motion_shows_both_stops(pressed):
    model = find_stops(prepare([pressed], RIG), RIG)
    assert model["x_stop_high"] == pytest.approx(HIGH, abs=2.0 * GRID)
    assert model["x_stop_low"] == pytest.approx(LOW, abs=2.0 * GRID)


def test_a_campaign_that_leans_on_one_stop_shows_one():
    log = log_of(hidden.contact_campaign(), replace(hidden.TABLE_1, stop_high_m=HIGH), 2)
    model = find_stops(prepare([log], RIG), RIG)
    assert model["x_stop_high"] == pytest.approx(HIGH, abs=2.0 * GRID)
    assert model["x_stop_low"] == PAPER["x_stop_low"]


def test_without_a_contact_the_model_stays_as_it_is(free):
    assert find_stops(prepare([free], RIG), RIG) == PAPER


def test_a_torque_that_pulls_is_no_stop(free):
    z = free.z.copy()
    z[:, 1] -= 85.0 * np.maximum(z[:, 2] - 3e-4, 0.0) ** 2 / PAPER["Km"]
    assert find_stops(prepare([replace(free, z=z)], RIG), RIG) == PAPER


@pytest.mark.parametrize("offset", [2e-3, -2e-3, 8e-3])
def test_an_offset_of_the_current_is_no_stop(free, offset: float):
    """With as many moves forth as back it would be a stop beyond the travel, whose depth is nearly the same everywhere."""
    z = free.z.copy()
    z[:, 1] += offset
    assert find_stops(prepare([replace(free, z=z)], RIG), RIG) == PAPER


def test_a_log_too_short_for_steady_motion_says_nothing():
    log = log_of(hidden.there_and_back((410.0,), (0.3,), (0.0,)), seed=4)
    assert find_stops(prepare([log], RIG), RIG) == PAPER
