"""What a better model is worth to `diagnose`: a plant with a ripple that the rig file lacks."""

import math

import pytest

from observer_fi.improve.diagnosis_gain import DiagnosisGain, measure_diagnosis_gain
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.settings import Settings

RIG = load_rig()
PLANT = with_values(RIG, {"screw_ripple_sin": 1.6e-4, "A": 4.3e-4})


@pytest.fixture(scope="module")
def both() -> tuple[DiagnosisGain, DiagnosisGain]:
    before, after = (measure_diagnosis_gain(PLANT, rig, Settings(), cases=12) for rig in (RIG, PLANT))
    return before, after


@pytest.mark.slow
@pytest.mark.study
def test_the_right_model_ends_the_false_alarms(both: tuple[DiagnosisGain, DiagnosisGain]) -> None:
    before, after = both
    assert before.false_alarms > 0 == after.false_alarms
    assert before.healthy == after.healthy == 4


@pytest.mark.slow
@pytest.mark.study
def test_the_right_model_isolates_every_fault_and_sooner(both: tuple[DiagnosisGain, DiagnosisGain]) -> None:
    before, after = both
    assert after.right == after.faults == 8 >= before.right
    assert after.delay_s["overload"] < 0.06 and after.delay_s["coupling_loss"] < 0.02
    slow = before.delay_s["overload"]
    assert math.isnan(slow) or slow > after.delay_s["overload"]
