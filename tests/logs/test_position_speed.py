"""The speed and the command of a log that has no more than a current and a position."""

import numpy as np
import pytest
from documented_rigs import lift
from hidden import actuator_log, fault_spec, healthy_spec, true_motion

from observer_fi.logs import log_from_frame, position_speed, recover_command
from observer_fi.physics import load_rig, override

ACTUATOR = lift()
MODEL = override(load_rig().model, "lift", Kp=0.0, Ki=0.0, D=ACTUATOR.rig.D, Km=ACTUATOR.rig.Km)


def test_the_slope_is_the_speed_within_its_noise() -> None:
    spec = healthy_spec(ACTUATOR)
    frame, _ = actuator_log(ACTUATOR, spec, 3)
    found = position_speed(frame["time_s"].to_numpy(), frame["position_m"].to_numpy(), ACTUATOR.rig.D)
    true = true_motion(spec).speed
    steady = np.convolve(np.abs(np.gradient(true)), np.ones(101), "same") < 1e-3
    assert np.std((found.w - true)[steady]) < 1.5 * found.std < 0.05 * np.abs(true).max()


def test_readings_without_noise_and_a_mass_that_stands() -> None:
    t = np.arange(1000) / 500.0
    assert (position_speed(t, np.zeros(1000), 1e-5).w == 0.0).all()
    assert position_speed(t, 1e-3 * t, 1e-5).w == pytest.approx(100.0)


def test_moves_are_where_the_mass_moves() -> None:
    spec = healthy_spec(ACTUATOR)
    log = recover_command(log_from_frame(actuator_log(ACTUATOR, spec, 3)[0]), MODEL)
    true = true_motion(spec).speed
    assert np.mean((log.w_cmd != 0.0) == (true != 0.0)) > 0.97
    assert "recovered from the position, 10 starts" in " ".join(log.notes)


def test_a_mass_that_is_lost_leaves_a_motor_that_is_told_to_move() -> None:
    spec = fault_spec(ACTUATOR, "coupling_loss", 1)
    frame, truth = actuator_log(ACTUATOR, spec, 3)
    log = recover_command(log_from_frame(frame), MODEL)
    brake = spec.profile.moves[0].brake_s
    after = (log.t > truth["onset_s"] + 0.2) & (log.t < brake - 0.05)
    assert after.any() and (log.w_cmd[after] != 0.0).all()
    assert (log.w_cmd[log.t > brake + 0.3] == 0.0).all()
