"""What a plan says: moves that decide where usual ones do not, what no move decides, and which limit stands in the way."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from campaigns import behind_a_loop

from observer_fi.cli import main
from observer_fi.errors import UsageError
from observer_fi.physics import load_rig
from observer_fi.plan import (
    DECISIVE,
    asked_by,
    limits_of,
    moves_csv,
    parse,
    plan_causes,
    plan_constants,
    plan_faults,
    to_json,
)
from pipelines.plan_study_cases import PAIRS, decided, profile_of, run_pair, summary

RIG = load_rig()


@pytest.fixture(scope="module")
def play():
    """Backlash against a lag, within half a millimetre."""
    asked = parse("backlash:backlash=3e-6,position_lag:position_lag=3e-3")
    return plan_causes(asked, RIG, limits_of(RIG, 8.0, travel=(-1e-4, 4e-4)))


@pytest.mark.slow
def test_the_planned_moves_decide_where_the_usual_ones_do_not(play):
    assert play.before.log_odds < play.planned.log_odds
    assert play.decides and min(c.log_odds for c in play.confirmed) > DECISIVE
    assert {c.truth for c in play.confirmed} == {"backlash", "position_lag"}


@pytest.mark.slow
def test_the_command_keeps_every_limit(play):
    table = pd.read_csv(io.StringIO(moves_csv(play)))
    t, w = table["time_s"].to_numpy(), table["speed_cmd_rad_s"].to_numpy()
    assert list(table.columns) == ["time_s", "speed_cmd_rad_s", "pitch_deg"]
    assert t[0] == 0.0 and t[-1] <= 8.0 and w[0] == w[-1] == 0.0
    assert np.abs(np.diff(w) / np.diff(t)).max() < 1.001 * RIG.model["accel_cmd"]
    x = RIG.model["D"] * np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))))
    assert x.min() > -1e-4 and x.max() < 4e-4


@pytest.mark.slow
def test_a_plan_is_json_without_what_json_has_not(play):
    result = json.loads(json.dumps(to_json(play), allow_nan=False))
    assert result["schema"] == "observer-fi/plan/1"
    assert result["rivals"][0]["parameters"] == {"backlash": {"value": 3e-6, "unit": "m"}}
    assert set(result["log_odds"]) == {"needed", "before", "planned", "simpler"}
    assert sum(m["times"] for m in result["moves"]) == len(play.planned.blocks)


def test_exact_aliases_are_told_at_once():
    plan = plan_causes(parse("torque_offset,asymmetric_friction"), RIG, limits_of(RIG))
    assert not plan.decides and "exactly the same way" in plan.why and not plan.planned.blocks
    assert moves_csv(plan).splitlines() == ["time_s,speed_cmd_rad_s,pitch_deg"]


@pytest.mark.slow
@pytest.mark.study
def test_where_the_pitch_binds_the_plan_says_so():
    asked = parse("load_dependent_friction:load_friction=0.004,none")
    level = plan_causes(asked, RIG, limits_of(RIG, 4.0))
    assert not level.decides and "the pitch binds" in level.why
    tilted = plan_causes(asked, RIG, limits_of(RIG, 4.0, (0.0, 10.0, -10.0)))
    assert tilted.decides
    assert {block.pitch for block in tilted.planned.blocks} - {0.0}


@pytest.mark.slow
def test_where_the_time_binds_the_plan_says_so():
    plan = plan_causes(parse("viscous_friction:viscous_positive=1e-9,none"), RIG, limits_of(RIG, 3.0))
    assert not plan.decides and "the time binds" in plan.why


@pytest.mark.slow
def test_a_lost_coupling_and_a_frozen_sensor_are_told_at_the_blind_pitch_by_going_both_ways():
    plan = plan_faults("coupling_loss,sensor_fault:position", RIG, limits_of(RIG, 3.0, (-5.2,)))
    assert plan.decides
    speeds = {np.sign(leg.speed) for block in plan.planned.blocks for leg in block.legs} - {0.0}
    assert speeds == {1.0, -1.0}


@pytest.mark.slow
def test_constants_that_need_a_pitch_get_one():
    plan = plan_constants(("B",), RIG, limits_of(RIG, 4.0, (0.0, 8.0)))
    before, planned, _ = plan.std["B"]
    assert planned < 0.01 * before and plan.decides
    with pytest.raises(UsageError, match="no constant"):
        plan_constants(("Q",), RIG, limits_of(RIG))


@pytest.mark.slow
@pytest.mark.study
def test_a_position_servo_gets_positions():
    rig = behind_a_loop()
    plan = plan_causes(parse("backlash,position_lag"), rig, limits_of(rig, 4.0))
    table = pd.read_csv(io.StringIO(moves_csv(plan)))
    assert table["position_cmd_m"].iloc[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(table["position_cmd_m"]) > 1e-5


def test_a_finding_of_improve_brings_its_rivals(tmp_path):
    path = tmp_path / "improve.json"
    found = {
        "cause": "backlash",
        "parameters": {"backlash": {"value": 4e-6}},
        "indistinguishable_from": ["position_lag"],
    }
    path.write_text(
        json.dumps(
            {"findings": [{**found, "cause": "viscous_friction", "indistinguishable_from": []}, found]}
        )
    )
    assert asked_by(path) == [("backlash", {"backlash": 4e-6}), ("position_lag", {})]
    path.write_text('{"findings": []}')
    with pytest.raises(UsageError, match="found no cause"):
        asked_by(path)
    path.write_text("[]")
    with pytest.raises(UsageError, match="not an improve.json"):
        asked_by(path)


@pytest.mark.parametrize(
    "words",
    [
        ["--between", "backlash,wear"], ["--between", "backlash:wear=1"], ["--between", "backlash:backlash=x"],
        ["--between", "backlash,backlash"], ["--between", "gear_ripple"], ["--faults", "coupling_loss"], ["--faults", "a,b"],
        ["--faults", "sensor_fault,none"], ["--for", ","], ["--from", "missing.json"], ["--between", "backlash", "--rig", "emps"],
        ["--between", "backlash", "--travel", "1:2"], ["--between", "backlash", "--pitches", "x"], ["--between", "none"],
    ],
)  # fmt: skip
def test_bad_use_is_one_line_and_leaves_nothing(words, tmp_path, capsys):
    assert main(["plan", *words, "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_command_writes_moves_and_json(tmp_path, capsys):
    words = ["plan", "--between", "torque_offset,asymmetric_friction", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "not decided" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "plan").iterdir()} >= {"moves.csv", "plan.json", "plan.html"}


@pytest.mark.slow
def test_the_truth_plays_a_plan_at_its_pitches(play):
    blocks = tuple(replace(b, pitch=p) for b, p in zip(play.planned.blocks[:2], (0.0, 5.0), strict=True))
    text = moves_csv(play, replace(play.planned, blocks=blocks))
    profile = profile_of(text)
    assert [level for _, level in profile.pitch_steps] == [0.0, 5.0]
    t, w = profile.curve
    inside = profile.pitch_steps[1][0]
    assert np.interp([inside - 0.1, inside + 0.1], t, w).tolist() == [
        0.0,
        0.0,
    ]  # at rest, well before the move
    assert profile.moves[0].start_s == pytest.approx(0.3) and len(profile.moves) >= 4


@pytest.mark.slow
def test_an_independent_truth_is_told_by_the_planned_moves():
    row = run_pair(PAIRS[0], 7100)
    assert row["decides"] and decided(row["after"])
    assert "1 of 1" in summary([row])


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("pair", PAIRS[1::4], ids=lambda pair: " or ".join(pair.causes))
def test_pairs_of_the_study_are_told_or_said_not_to_be(pair):
    row = run_pair(pair, 7200)
    assert decided(row["after"]) or not row["decides"]
