"""What a better model is worth to `diagnose`: a plant with a ripple that the rig file lacks."""

import math

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.improve.diagnosis_gain import DiagnosisGain, measure_diagnosis_gain, pieces
from observer_fi.logs import moves_from_rest
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.settings import Settings

RIG = load_rig()
PLANT = with_values(RIG, {"screw_ripple_sin": 4e-5, "A": 4.3e-4})


@pytest.fixture(scope="module")
def both() -> tuple[DiagnosisGain, DiagnosisGain]:
    logs = [campaign(PLANT, seed=11)]
    before, after = (measure_diagnosis_gain(logs, PLANT, rig, Settings(), cases=12) for rig in (RIG, PLANT))
    return before, after


def test_the_right_model_ends_the_false_alarms(both: tuple[DiagnosisGain, DiagnosisGain]) -> None:
    before, after = both
    assert before.moves == after.moves > 3
    assert before.alarms > 0 == after.alarms
    assert after.false_alarms == 0 and after.healthy == 4


def test_the_right_model_isolates_every_fault_and_sooner(both: tuple[DiagnosisGain, DiagnosisGain]) -> None:
    before, after = both
    assert after.right == after.faults == 8 >= before.right
    assert after.delay_s["overload"] < 0.06 and after.delay_s["coupling_loss"] < 0.02
    slow = before.delay_s["overload"]
    assert math.isnan(slow) or slow > after.delay_s["overload"]


def test_a_long_log_is_judged_in_parts_that_begin_at_a_rest() -> None:
    log = campaign(PLANT, seed=11)
    assert [part.t.size for part in pieces(log)] == [log.t.size]
    parts = pieces(log, log.t.size // 4)
    assert len(parts) > 2 and np.array_equal(np.concatenate([part.z for part in parts]), log.z)
    assert sum(len(moves_from_rest(part)) for part in parts) == len(moves_from_rest(log))
    assert all(not part.w_cmd[[0, -1]].any() for part in parts)
