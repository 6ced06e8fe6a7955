"""Actuators that were judged wrong, each for another reason: from their data sheets to six verdicts."""

import pytest

from pipelines.rigs_study import Job, judged


def wrong(drive: str, seed: int) -> list[str]:
    return [f"{row['label']}: {row['said']}" for row in judged(Job(drive, seed)) if not row.get("right")]


# A current alone whose noise repeats readings by their steps (100 and 250 samples a second); a lost coupling and a jam that
# the bank takes for a current that lies.
@pytest.mark.parametrize(("drive", "seed"), [("current", 300007), ("current", 300009), ("voltage", 301003)])
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
