"""Logs without a pitch: gravity acts on the mass all the same, and what it does is no fault."""

import importlib
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hidden import draw_severity_case, make_log, make_log_with, write_log

from observer_fi.logs import NO_PITCH, log_from_frame
from observer_fi.physics import Rig, load_rig, with_values
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose, diagnose_log
from observer_fi.verdict.logger.no_pitch import with_its_pitch

RIG, SETTINGS = load_rig(), Settings()
SHAPES = ("without_rests", "", "s_curve")


def without_pitch(seed: int, label: str, shape: str = "") -> tuple[pd.DataFrame, float]:
    """A log without its pitch, and what that was at first [deg]."""
    frame, _ = make_log(draw_severity_case(seed, label, shape), seed)
    return frame.drop(columns="pitch_deg"), float(frame["pitch_deg"].iloc[0])


@pytest.mark.parametrize("seed", range(99_750_000, 99_750_003))
def test_a_motion_both_ways_tells_the_pitch(seed: int) -> None:
    frame, pitch = without_pitch(seed, "nominal", "without_rests")
    known = with_its_pitch(log_from_frame(frame), RIG, SETTINGS.bank)
    assert -known.model["pitch_offset"] == pytest.approx(pitch, abs=1.5)


@pytest.mark.parametrize(
    ("trait", "heavier"), [("steps_all", 1.0), ("noise_3", 1.0), ("hum_50hz", 0.5), ("ideal", 4.0)]
)
def test_whatever_the_logger_and_however_heavy_the_mass(trait: str, heavier: float) -> None:
    seed = 99_750_001
    spec = draw_severity_case(seed, "nominal", "without_rests")
    frame, _ = make_log_with(trait, replace(spec, rig=replace(spec.rig, B=heavier * spec.rig.B)), seed)
    rig = with_values(RIG, {"B": heavier * RIG.model["B"]})
    known = with_its_pitch(log_from_frame(frame.drop(columns="pitch_deg")), rig, SETTINGS.bank)
    assert -known.model["pitch_offset"] == pytest.approx(float(frame["pitch_deg"].iloc[0]), abs=1.5)


@pytest.mark.parametrize(
    "seed", [99_750_003, *(pytest.param(s, marks=pytest.mark.slow) for s in range(99_750_004, 99_750_008))]
)
def test_a_healthy_reversal_without_a_pitch_is_no_jam(seed: int) -> None:
    """Six of eight were jams or obstacles for sure, the others not of this machine."""
    found = diagnose_log(
        log_from_frame(without_pitch(seed, "nominal", "without_rests")[0]), RIG, SETTINGS
    ).isolation
    assert found is not None and "nominal" in (found.verdict.label, *found.verdict.alike)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("label", ["overload", "coupling_loss", "slip", "jam"])
@pytest.mark.parametrize("shape", SHAPES)
def test_faults_are_told_without_a_pitch(label: str, shape: str) -> None:
    right, wrong = 0, 0
    same = {"overload", "slip"} if label in ("overload", "slip") else {label}  # as with a pitch
    for seed in range(99_750_010, 99_750_014):
        found = diagnose_log(log_from_frame(without_pitch(seed, label, shape)[0]), RIG, SETTINGS).isolation
        assert found is not None
        told = bool(same & {found.verdict.label, *found.verdict.alike})
        right, wrong = right + told, wrong + (not told and found.verdict.probability > 0.95)
    assert right >= 2 and wrong <= 1  # one obstacle is not touched: health with a pitch too


@pytest.mark.slow
def test_a_file_says_what_a_log_in_memory_says(tmp_path: Path) -> None:
    frame, _ = without_pitch(99_750_001, "nominal", "without_rests")
    outcomes = (
        diagnose(write_log(frame, tmp_path / "move.csv"), RIG, SETTINGS),
        diagnose_log(log_from_frame(frame), RIG, SETTINGS),
    )
    for outcome in outcomes:
        found = outcome.isolation
        assert found is not None and "nominal" in (found.verdict.label, *found.verdict.alike)
        (told,) = [note for note in outcome.log.notes if note.startswith(NO_PITCH)]
        assert told in outcome.warnings and "Log the pitch" in told
    assert outcomes[0].log.notes == outcomes[1].log.notes


@pytest.mark.slow
def test_a_friction_that_had_risen_is_no_all_clear() -> None:
    """In one direction a pitch looks the same."""
    spec = draw_severity_case(99_750_030, "nominal", "")
    level = replace(spec, profile=replace(spec.profile, pitch_steps=((0.0, 0.0),), pitch_wave_deg=0.0))
    stiff = replace(level, rig=replace(level.rig, A=1.5 * level.rig.A))
    found = diagnose_log(
        log_from_frame(make_log(stiff, 99_750_030)[0].drop(columns="pitch_deg")), RIG, SETTINGS
    ).isolation
    assert found is not None and not (found.verdict.label == "nominal" and found.verdict.probability > 0.95)


@pytest.mark.slow
def test_where_it_is_level_or_weighs_nothing_it_is_taken_as_0() -> None:
    frame, _ = without_pitch(99_750_001, "nominal", "without_rests")
    log = log_from_frame(frame)
    light = with_values(RIG, {"B": 0.0})
    assert with_its_pitch(log, light, SETTINGS.bank) is light
    spec = draw_severity_case(99_750_020, "nominal", "without_rests")
    level = replace(spec, profile=replace(spec.profile, pitch_steps=((0.0, 0.0),), pitch_wave_deg=0.0))
    flat = make_log(level, 99_750_020)[0].drop(columns="pitch_deg")
    outcome = diagnose_log(log_from_frame(flat), RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label == "nominal"
    assert f"{NO_PITCH} as 0" in outcome.log.notes


@pytest.mark.parametrize("friction", [20.0, 150.0, 355.0])
def test_no_pitch_is_steeper_than_a_wall(friction: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """However much friction outweighs gravity, of which it is that of so many degrees: looks went to 445."""
    module = importlib.import_module("observer_fi.verdict.logger.no_pitch")
    asked: list[float] = []
    given = module.said_by_nominal

    def said(log: Log, rig: Rig, *rest: Any) -> Any:
        asked.append(rig.model["pitch_offset"])
        return given(log, rig, *rest)

    monkeypatch.setattr(module, "said_by_nominal", said)
    heavy = with_values(RIG, {"B": math.copysign(RIG.model["A"] / friction, RIG.model["B"])})
    with_its_pitch(log_from_frame(without_pitch(99_750_002, "nominal")[0]), heavy, SETTINGS.bank)
    assert len(asked) > 5 and max(map(abs, asked)) <= 90.0


def test_a_pitch_that_was_logged_is_left_alone() -> None:
    log = log_from_frame(make_log(draw_severity_case(99_750_001, "nominal", "without_rests"), 99_750_001)[0])
    assert with_its_pitch(log, RIG, SETTINGS.bank) is RIG
