"""The study of freed equations: what counts as right, and its recipe on one case."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipelines import freed_study
from pipelines.freed_study_cases import FreedCase, among_the_close, declared, right, summary

CASE = FreedCase(
    "position_lag", 3.0, 1, ["sensor:position"], "sensor:position", [], 900.0, {"sensor:position": 900.0}, 2.0
)


def test_right_declared_and_close_are_three_things():
    twin = replace(CASE, first="kinematics")
    wrong = replace(CASE, first="torque")
    near = replace(wrong, close=["sensor:position"])
    assert [right(c) for c in (CASE, twin, wrong, near)] == [True, False, False, False]
    assert [declared(c) for c in (CASE, twin, wrong, near)] == [True, True, False, False]
    assert [among_the_close(c) for c in (CASE, twin, wrong, near)] == [True, True, False, True]


def test_summary_counts_controls_and_cases():
    control = replace(CASE, cause="", size=0.0, equations=[], first="", gain=4.2)
    text = summary([control, replace(control, first="servo", gain=33.0), CASE, replace(CASE, first="torque")])
    assert "Controls: 1 of 2" in text and "33.0 nats" in text
    assert "| 3 x | position_lag | sensor:position | 2 | 2 | 1 | 1 | 1 | torque |" in text


@pytest.mark.slow
def test_the_recipe_writes_its_table_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    given = ["--causes", "position_lag", "--sizes", "3:1", "--first", "9000"]
    given += ["--results", str(tmp_path / "rows.jsonl"), "--out", str(tmp_path / "freed.md")]
    assert freed_study.main(given) == 0
    assert freed_study.main(given) == 0
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 1
    assert "| 3 x | position_lag | sensor:position | 1 | 1 |" in (tmp_path / "freed.md").read_text()
