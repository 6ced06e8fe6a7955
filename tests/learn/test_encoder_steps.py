"""The encoder of a position servo as its loop sees it on average, against the angle that the truth turned."""

import hidden
import numpy as np
import pytest
from hidden.truth import true_motion

from observer_fi.learn.servo.encoder_steps import without_steps
from observer_fi.learn.servo.servo_start import with_start
from pipelines import rigs_study


@pytest.mark.slow
def test_between_steps_the_angle_is_that_of_the_motor_and_never_half_a_step_off() -> None:
    actuator = hidden.draw_actuator(400012, "position_servo")
    rig = rigs_study._from_sheet(actuator)
    log = rigs_study._campaign(actuator, rig)
    even = without_steps(log, with_start([log], rig))
    assert log.encoder is not None and even.encoder is not None
    step = 2.0 * np.pi / actuator.logger.encoder_edges
    angle = true_motion(hidden.healthy_spec(actuator)).angle - 0.5 * step
    fast = np.abs(np.gradient(log.encoder)) > 4.0 * step
    left, was = (float(np.std((q - angle)[fast])) for q in (even.encoder, log.encoder))
    assert was == pytest.approx(step / np.sqrt(12.0), rel=0.1) and left < 0.5 * was
    assert np.abs(even.encoder - log.encoder).max() <= 0.5001 * step
    still = np.abs(np.diff(log.encoder, prepend=0.0, append=0.0)).reshape(-1)
    assert (even.encoder == log.encoder)[(still[1:] == 0.0) & (still[:-1] == 0.0)].all()


def test_a_log_without_a_position_loop_stays_as_it_is() -> None:
    actuator = hidden.draw_actuator(400008, "pi_servo")
    rig = rigs_study._from_sheet(actuator)
    log = rigs_study._campaign(actuator, rig)
    assert without_steps(log, rig) is log
