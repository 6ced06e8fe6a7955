"""Readings that are a share more or less than the rig file says: of the voltage it is learned, of the position it is in doubt."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, draw_severity_case, make_log
from hidden.faults import Fault

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.moves.of_the_day import FirstStart

RIG, SETTINGS = load_rig(), Settings()
CLASSES = ("nominal", "overload", "coupling_loss")


def scaled(column: str, gain: float, seed: int, label: str | None = None) -> pd.DataFrame:
    frame, _ = make_log(draw_move_case(seed, label or CLASSES[seed % 3]), seed)
    return frame.assign(**{column: gain * frame[column]})


def said(frame: pd.DataFrame) -> tuple[Event, tuple[str, ...]]:
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert outcome.isolation is not None
    return outcome.isolation.verdict, outcome.warnings


@pytest.mark.parametrize(
    ("seed", "gain"), list(zip(range(75_000, 75_009), (0.87, 0.94, 0.975, 0.988, 1.006, 1.013, 1.04, 1.07, 1.13), strict=True))
)  # fmt: skip
@pytest.mark.first(1)
def test_a_voltage_of_another_gain_changes_no_verdict(seed: int, gain: float) -> None:
    frame = scaled("voltage_v", gain, seed)
    assert AsLogged(log_from_frame(frame), RIG, BankSettings()).day.voltage == pytest.approx(gain, abs=5e-4)
    verdict, warnings = said(frame)
    assert verdict.label == CLASSES[seed % 3]
    assert any(warning.startswith("voltage_v reads") for warning in warnings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(75_040, 75_046))
@pytest.mark.first(1)
def test_gains_of_both_are_told_or_in_doubt(seed: int) -> None:
    frame = scaled("voltage_v", 1.04, seed)
    verdict, _ = said(frame.assign(current_a=0.95 * frame["current_a"]))
    assert verdict.label == CLASSES[seed % 3] or not verdict.probability > 0.5


def test_an_offset_and_a_gain_of_the_voltage_are_told_apart() -> None:
    frame = scaled("voltage_v", 1.04, 75_010, "nominal")
    known = AsLogged(log_from_frame(frame.assign(voltage_v=frame["voltage_v"] + 0.05)), RIG, BankSettings())
    assert known.day.voltage == pytest.approx(1.04, abs=1e-3)
    assert known.offset == pytest.approx(0.05 / 1.04, abs=0.01)


@pytest.mark.slow
def test_a_voltage_sensor_that_changes_its_gain_on_the_way_has_failed() -> None:
    frame, _ = make_log(draw_move_case(75_011, "nominal"), 75_011)
    late = frame["time_s"] > 1.5
    verdict, _ = said(frame.assign(voltage_v=np.where(late, 1.1, 1.0) * frame["voltage_v"]))
    assert (verdict.label, verdict.channel) == ("sensor_fault", "voltage")


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.9, 0.98, 0.99, 1.01, 1.02, 1.06])
@pytest.mark.parametrize("seed", [75_020, 75_021])
@pytest.mark.first(2)
def test_a_position_of_another_gain_is_not_surely_a_fault(gain: float, seed: int) -> None:
    verdict, _ = said(scaled("position_m", gain, seed, "nominal"))
    assert verdict.label == "nominal" or (verdict.probability == 0.5 and "nominal" in verdict.alike)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "share"), [(75_030, 0.05), (75_031, 0.1), (75_032, 0.3), (75_033, 0.6)])
@pytest.mark.first(1)
def test_a_nut_that_begins_to_slip_on_the_way_does(seed: int, share: float) -> None:
    spec = draw_move_case(seed, "overload")
    frame, truth = make_log(replace(spec, fault=Fault("slip", 1.2, size=share)), seed)
    verdict, _ = said(frame)
    assert verdict.label == "slip" and "nominal" not in verdict.alike and verdict.probability > 0.95
    assert verdict.onset_s == pytest.approx(truth["onset_s"], abs=0.1)


@pytest.mark.parametrize(("shape", "seed"), [("uneven", 99_775_700), ("uneven", 99_775_711)])
@pytest.mark.parametrize("gain", [1.02, 0.985])
@pytest.mark.first(2)
def test_a_gain_between_those_that_are_tried_first_is_found(shape: str, seed: int, gain: float) -> None:
    """A voltage that is 1 % off explains nothing of a start: two gains on either side of the right one say so alike."""
    log = log_from_frame(make_log(draw_severity_case(seed, "nominal", shape), seed)[0])
    first = FirstStart(
        replace(log, z=log.z * np.array([gain, 1.0, 1.0])), RIG, Settings().bank, lambda rig, times: 0.0
    )
    assert first.day().voltage == pytest.approx(gain, abs=1e-3)


@pytest.mark.slow
def test_a_soft_start_tells_the_gain_of_its_voltage_once_it_has_risen() -> None:
    seed = 99_775_700
    for label in ("nominal", "jam"):
        log = log_from_frame(make_log(draw_severity_case(seed, label, "s_curve"), seed)[0])
        found = diagnose_log(replace(log, z=log.z * np.array([1.02, 1.0, 1.0])), RIG, Settings()).isolation
        assert found is not None and found.verdict.label == label
