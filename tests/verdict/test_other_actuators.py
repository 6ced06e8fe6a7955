"""Actuators that were judged wrong, each for another reason: from their data sheets to six verdicts."""

import hidden
import numpy as np
import pytest

from observer_fi.logs import acquisition_of, log_from_frame, with_command
from pipelines.rigs_study import Job, _learned, judged


def wrong(drive: str, seed: int) -> list[str]:
    return [f"{row['label']}: {row['said']}" for row in judged(Job(drive, seed)) if not row.get("right")]


# A current alone whose noise repeats readings by their steps (100 and 250 samples a second); a lost coupling and a jam that
# the bank takes for a current that lies.
@pytest.mark.parametrize(
    ("drive", "seed"),
    [
        ("current", 300007),
        pytest.param("current", 300009, marks=pytest.mark.slow),
        pytest.param("voltage", 301003, marks=pytest.mark.slow),
    ],
)
def test_a_current_is_not_said_to_lie(drive: str, seed: int) -> None:
    assert wrong(drive, seed) == []


# A voltage that reads more while the mass is as fast; a start that the rig file tells less well; sensors that stand still; a
# campaign in which a motor seemed to come loose.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("drive", "seed"),
    [
        ("pi_servo", 300006),
        ("position_servo", 300006),
        ("position_servo", 300012),
        ("position_servo", 300011),
        ("position_servo", 300014),
        ("pi_servo", 300013),
        ("current", 301000),
        ("pi_servo", 301004),
    ],
)
def test_an_actuator_is_judged_right(drive: str, seed: int) -> None:
    assert wrong(drive, seed) == []


def test_a_motor_that_still_settles_after_its_move_is_no_noise_that_wanders() -> None:
    """Its first rest has 98 samples, where 100 are a rest; after the move the position loop creeps on for half a second."""
    actuator = hidden.draw_actuator(300014, "position_servo")
    frame, _ = hidden.actuator_log(
        actuator, hidden.fault_spec(actuator, "nominal", actuator.seed), actuator.seed + 1
    )
    log = with_command(log_from_frame(frame), _learned(actuator))
    for seen in acquisition_of(log, np.array([2e-3, 5e-3, 4e-6]))[:3]:
        assert seen.correlation_s is None and abs(seen.offset) < seen.noise_std
