"""A sensor that fails behind a logger whose noise hides it: the noise itself changes while the motor runs."""

import pandas as pd
import pytest
from hidden import draw_failing_case, draw_move_case, draw_severity_case, make_log, make_log_with

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.drift import SURE

RIG, SETTINGS = load_rig(), Settings()


def said_of(trait: str, spec, seed: int) -> Event:
    frame, _ = make_log_with(trait, spec, seed)
    found = diagnose_log(log_from_frame(frame), RIG, SETTINGS).isolation
    assert found is not None
    return found.verdict


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5_910_000, 5_910_001, 5_910_002])
@pytest.mark.first(1)
def test_a_burst_of_noise_behind_a_wandering_baseline_is_a_failing_sensor(seed: int) -> None:
    spec = draw_failing_case(seed, "noise_burst", "voltage", 3.0)
    said = said_of("wandering", spec, seed)
    assert (said.label, said.channel) == ("sensor_fault", "voltage")
    assert said.onset_s == pytest.approx(spec.fault.onset_s, abs=0.1)


@pytest.mark.slow
def test_a_voltage_at_the_end_of_its_range_behind_a_wandering_baseline_is_no_all_clear() -> None:
    said = said_of("wandering", draw_failing_case(5_300_159, "saturation", "voltage", 3.0), 5_300_159)
    assert said.probability <= SURE and "sensor_fault" in (said.label, *said.alike)


@pytest.mark.parametrize(
    ("trait", "channel"),
    [("steps_3_all", "current"), ("csv_3_decimals", "current"), ("steps_all", "voltage")],
)
def test_a_burst_of_noise_behind_coarse_steps_is_no_all_clear(trait: str, channel: str) -> None:
    said = said_of(trait, draw_failing_case(5_910_007, "noise_burst", channel), 5_910_007)
    assert said.probability <= SURE and "sensor_fault" in (said.label, *said.alike)


@pytest.mark.first(1)
@pytest.mark.parametrize("channel", ["current", "voltage"])
def test_a_loud_sensor_beside_a_servo_that_nobody_knows_is_not_the_other_one(channel: str) -> None:
    """A burst of the current was a failed voltage at 1.0, four of four."""
    frame, _ = make_log_with("ideal", draw_failing_case(5_910_008, "noise_burst", channel, 3.0), 5_910_008)
    said = diagnose_log(log_from_frame(frame), RIG.without_servo, SETTINGS).isolation.verdict
    assert (said.label, said.channel) == ("sensor_fault", channel)


def test_noise_that_grows_under_way_is_another_range_or_a_failing_sensor() -> None:
    said = said_of("range_switched", draw_move_case(5_910_004, "nominal"), 5_910_004)
    assert said.label == "nominal" and said.probability <= SURE and said.alike == ("sensor_fault",)


@pytest.mark.parametrize(
    "trait", ["wandering", "coloured", "hum_60hz", "noise_3", "missing_rows", "steps_3_all"]
)
@pytest.mark.first(2)
def test_a_healthy_move_stays_one(trait: str) -> None:
    said = said_of(trait, draw_move_case(5_910_005, "nominal"), 5_910_005)
    assert said.label == "nominal" and said.probability > SURE


@pytest.mark.parametrize("seed", [99_774_400, 99_774_410, 99_774_420])
@pytest.mark.first(1)
def test_a_position_that_comes_when_it_left_a_dead_band_has_no_noise_to_change(seed: int) -> None:
    frame, _ = make_log(draw_severity_case(seed, "nominal"), seed)
    found = diagnose_log(log_from_frame(in_a_dead_band(frame, 15e-6)), RIG, SETTINGS).isolation
    assert found is not None and found.verdict.label == "nominal"


def in_a_dead_band(frame: pd.DataFrame, half: float) -> pd.DataFrame:
    """The log with a position that is told anew only where it has left a band [m] about what was told."""
    told = frame["position_m"].to_numpy().copy()
    for k in range(1, told.size):
        told[k] = min(max(told[k - 1], told[k] - half), told[k] + half)
    return frame.assign(position_m=told)
