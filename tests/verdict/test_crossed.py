"""What a test of one thing holds still: a fault on another day, in a log that begins in motion, of a servo with other gains."""

from dataclasses import replace

import numpy as np
import pytest
from hidden import SURROUNDINGS, TruthSpec, draw_failing_case, draw_severity_case, make_log_with

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG = load_rig()
SEEDS = range(95_600_000, 95_600_004)


def verdict(spec: TruthSpec, logger: str, seed: int, day: str = "usual") -> Event:
    """What is said of a move on a day, through a logger."""
    spec = SURROUNDINGS[day].change(spec, 1.0, np.random.default_rng([seed, 17]))
    outcome = diagnose_log(log_from_frame(make_log_with(logger, spec, seed)[0]), RIG, Settings())
    assert outcome.isolation is not None
    return outcome.isolation.verdict


def named(event: Event, label: str) -> bool:
    return label in (event.label, *event.alike)


@pytest.mark.slow
@pytest.mark.parametrize("day", ["warm winding, swell", "ripple of the screw, 3 %"])
def test_a_swelling_torque_is_no_first_fault_of_two(day: str) -> None:
    said = [
        (seed, verdict(draw_severity_case(seed, "overload", "uneven"), "noise_3+drive_400hz", seed, day))
        for seed in SEEDS
    ]
    assert not [(seed, e.label) for seed, e in said if e.label == "jam" and e.probability > 0.95]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["frozen_noisy", "drift"])
def test_a_current_that_fails_in_a_log_which_begins_in_motion_has_no_offset(kind: str) -> None:
    """Its only rest is behind the failure."""
    said = [verdict(draw_failing_case(seed, kind, "current", 3.0), "mid_move", seed) for seed in SEEDS]
    assert sum(named(e, "sensor_fault") for e in said) >= len(said) - 1
    assert not [e.label for e in said if e.probability > 0.94 and not named(e, "sensor_fault")]


def test_offsets_of_a_log_that_begins_in_motion_are_known() -> None:
    assert verdict(draw_severity_case(SEEDS[0], "nominal"), "mid_move+offsets", SEEDS[0]).label == "nominal"


@pytest.mark.slow
def test_a_burst_of_noise_on_held_readings_is_no_health() -> None:
    said = [verdict(draw_failing_case(seed, "noise_burst", "voltage"), "drive_400hz", seed) for seed in SEEDS]
    assert all(named(e, "sensor_fault") for e in said)


@pytest.mark.slow
def test_a_slip_is_told_whatever_the_stop_of_another_servo_looks_like() -> None:
    wrong = []
    for seed in SEEDS:
        spec = draw_severity_case(seed, "slip")
        small = replace(
            spec, fault=replace(spec.fault, size=0.06, onset_s=spec.profile.moves[0].brake_s - 0.8)
        )
        event = verdict(small, "no_voltage+steps_position", seed, "gains 20 % higher")
        wrong += [] if named(event, "slip") else [(seed, event.label, event.probability)]
    assert len(wrong) <= 1
    assert not [one for one in wrong if one[2] > 0.95]
