"""The study of campaigns and moves through one logger: what it asks, and what counts as right."""

from types import SimpleNamespace
from typing import Any

import hidden
import pandas as pd
import pytest

from observer_fi.physics import load_rig
from pipelines import workflow_study
from pipelines.workflow_study import EVERY, Job, jobs_of, summary

FOUND: Any = SimpleNamespace(cause="backlash", indistinguishable_from=("partial_slip",))
LEFT: Any = SimpleNamespace(equation="torque", regressor="time")


def record(findings: tuple[Any, ...] = (), unexplained: tuple[Any, ...] = ()) -> Any:
    return SimpleNamespace(findings=findings, unexplained=unexplained)


def test_every_logger_has_a_rig_of_its_own_and_the_causes_take_turns() -> None:
    jobs = jobs_of(EVERY, 2, 7)
    assert len({job.seed for job in jobs}) == len(jobs) == 2 * len(EVERY)
    assert {job.cause for job in jobs} == set(hidden.CAUSES)
    first, second = jobs[0], jobs[len(EVERY)]
    assert first.trait == second.trait and first.cause != second.cause


def test_a_control_is_right_where_nothing_is_said() -> None:
    assert workflow_study._found("control", record(), None)["right"]
    named = workflow_study._found("control", record((FOUND,)), None)
    assert not named["right"] and named["confident"] and named["said"] == "backlash/partial_slip"
    left = workflow_study._found("control", record(unexplained=(LEFT,)), None)
    assert not left["right"] and not left["confident"] and left["said"] == "torque by time"


def test_a_hidden_cause_is_right_in_the_first_set() -> None:
    assert workflow_study._found("hidden", record((FOUND,)), "partial_slip")["right"]
    other = workflow_study._found("hidden", record((FOUND,)), "shaft_ripple")
    assert not other["right"] and other["confident"]
    missed = workflow_study._found("hidden", record(), "shaft_ripple")
    assert not missed["right"] and not missed["confident"]


@pytest.mark.slow
def test_three_new_moves_of_the_rig_of_the_campaign_are_judged_through_its_logger() -> None:
    truth = hidden.draw_effects_case(402000, (), 0.0).rig
    rows = list(workflow_study._moves(Job("steps_all", 402000, "backlash"), truth, "rig file", load_rig()))
    assert [row["label"] for row in rows] == list(workflow_study.CLASSES)
    assert all(row["right"] and row["of"] == "rig file" for row in rows)


def test_the_report_has_a_row_a_logger() -> None:
    about = {"seed": 1, "cause": "backlash", "confident": False, "cpu_s": 2.0}
    frame = pd.DataFrame([
        {**about, "trait": trait, "of": of, "label": "nominal", "said": said, "right": said == "nominal"}
        for trait in ("ideal", "noise_3+steps_all")
        for of, said in (("identify", "nominal"), ("improve", "jam"))
    ])  # fmt: skip
    text = summary(frame)
    assert "| noise_3+steps_all | 1 of 1 | 0 of 1 | 0 | improve, nominal: jam |" in text
    assert "| pairs and triples | 1 of 1 | 0 of 1 | 0 |" in text
