"""A servo that nobody knows, from the logs of the independent truth."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import log_of

from observer_fi.learn.servo.unknown_servo import shows_servo, with_servo
from observer_fi.physics.rigs import Rig, load_rig

PAPER = load_rig()


def unknown_servo() -> Rig:
    servo = ("Kp", "Ki", "Rs", "Vmax", "accel_cmd")
    return replace(
        PAPER, drive="voltage", quantities={n: q for n, q in PAPER.quantities.items() if n not in servo}
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6])
@pytest.mark.first(1)
def test_the_servo_is_found_from_far_away(seed: int) -> None:
    truth = hidden.draw_rig(np.random.default_rng(seed), 5.0)
    found = with_servo([log_of(hidden.campaign(), truth, seed)], unknown_servo())
    assert found.driven.servo and found.model["accel_cmd"] == pytest.approx(6e4, rel=1e-3)
    for name in ("Kp", "Ki", "Vmax", "J"):
        assert found.model[name] == pytest.approx(getattr(truth, name), rel=0.01), name


def test_a_rig_with_a_servo_stays_as_it_is() -> None:
    assert with_servo([], PAPER) is PAPER


def test_a_rig_whose_logs_show_no_servo_stays_as_it_is() -> None:
    log = log_of(hidden.single_move(hold_s=1.0), hidden.draw_rig(np.random.default_rng(1), 1.0), 1)
    current = replace(unknown_servo(), drive="current")
    assert not shows_servo([log], current) and with_servo([log], current) is current
    without = replace(log, notes=("speed_cmd_rad_s is absent: recovered",))
    voltage = unknown_servo()
    assert not shows_servo([log, without], voltage) and with_servo([log, without], voltage) is voltage
