"""Actuators that were judged wrong, each for another reason: from their data sheets to six verdicts."""

from dataclasses import replace

import hidden
import numpy as np
import pytest

from observer_fi.learn import identified_rig, identify, with_equation_errors
from observer_fi.logs import acquisition_of, log_from_frame, with_command, with_logger
from observer_fi.physics import Rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.rigs_study import Job, _from_sheet, _learned, judged


def wrong(drive: str, seed: int) -> list[str]:
    return [f"{row['label']}: {row['said']}" for row in judged(Job(drive, seed)) if not row.get("right")]


# A current alone whose noise repeats readings by their steps (100 and 250 samples a second); a lost coupling and a jam that
# the bank takes for a current that lies.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("drive", "seed"),
    [
        ("current", 300007),
        pytest.param("current", 300009, marks=pytest.mark.slow),
        pytest.param("voltage", 301003, marks=pytest.mark.slow),
    ],
)
@pytest.mark.first(1)
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
        (
            "pi_servo",
            600000,
        ),  # at 250 samples a second a jam was a second fault, behind a sensor's of its first 32 samples
    ],
)
@pytest.mark.first(1)
def test_an_actuator_is_judged_right(drive: str, seed: int) -> None:
    assert wrong(drive, seed) == []


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("share", [1.0, 0.05])
def test_a_loop_that_is_fed_forward_is_judged_as_one_that_nobody_knows(share: float) -> None:
    """Its command was none to speak of: no move, or a position sensor for sure; with 5 % a winding that was 20 % off."""
    actuator = hidden.draw_actuator(300014, "position_servo")

    def read(spec: hidden.TruthSpec, seed: int, rig: Rig) -> Log:
        frame, _ = hidden.actuator_log(actuator, replace(spec, speed_forward=share), seed)
        return with_command(log_from_frame(frame), rig)

    sheet = _from_sheet(actuator)
    log = read(hidden.healthy_spec(actuator), actuator.seed, sheet)
    found = identified_rig(identify([log], sheet), sheet)
    assert found.model["Rm"] == pytest.approx(actuator.rig.Rm, rel=0.01) and not found.watched.servo
    log = with_command(log, found)
    rig = with_equation_errors(with_logger(found, [log]), [log])
    for label in ("nominal", "overload", "coupling_loss", "slip", "jam"):
        spec = hidden.fault_spec(actuator, label, actuator.seed)
        outcome = diagnose_log(read(spec, actuator.seed + 1, rig), rig, Settings())
        assert outcome.isolation is not None
        verdict = outcome.isolation.verdict
        assert label in (verdict.label, *verdict.alike), label


@pytest.mark.slow
def test_a_motor_that_still_settles_after_its_move_is_no_noise_that_wanders() -> None:
    """Its first rest has 98 samples, where 100 are a rest; after the move the position loop creeps on for half a second."""
    actuator = hidden.draw_actuator(300014, "position_servo")
    frame, _ = hidden.actuator_log(
        actuator, hidden.fault_spec(actuator, "nominal", actuator.seed), actuator.seed + 1
    )
    log = with_command(log_from_frame(frame), _learned(actuator))
    for seen in acquisition_of(log, np.array([2e-3, 5e-3, 4e-6]))[:3]:
        assert seen.correlation_s is None and abs(seen.offset) < seen.noise_std
