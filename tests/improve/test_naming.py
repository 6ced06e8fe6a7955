"""In which order causes and stops are asked."""

from dataclasses import replace

import hidden
import pytest
from drawn_sheets import drawn_sheet
from hidden.effects import effect

from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.naming import named
from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import rig_of_sheet, with_values

CONSTANTS = ("Rm", "Rs", "Km", "D", "Vmax", "Kp", "Ki", "J", "A", "B")


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(("lag", "accel"), [(0.01, 6.5), (0.02, 1.0)])
def test_a_position_that_lags_by_far_is_no_stop(lag: float, accel: float) -> None:
    """What a sensor shows of every end of the travel looked like one, and beside two of them no cause was believed, or one that
    left three nats a sample. accel: of the rig file's ramp over that of the command.
    """
    actuator = hidden.draw_actuator(862000, "pi_servo")
    spec = replace(hidden.healthy_spec(actuator), effects=(effect("position_lag", lag=lag),))
    rig = rig_of_sheet(drawn_sheet(actuator, "pi_servo")).rig
    rig = with_values(rig, {name: getattr(actuator.rig, name) for name in CONSTANTS}, {}, "identified")
    rig = with_values(rig, {"accel_cmd": accel * actuator.rig.accel})
    log = log_from_frame(hidden.actuator_log(actuator, spec, 862001)[0])
    _, ladder = named(simulated_moves([with_command(log, rig)], rig), lambda text: None)
    assert [step.trial.causes for step in ladder.steps] == [("position_lag",)]
    assert ladder.extended.model["position_lag"] == pytest.approx(lag, rel=0.02)
    assert ladder.extended.model["x_stop_high"] == rig.model["x_stop_high"]
