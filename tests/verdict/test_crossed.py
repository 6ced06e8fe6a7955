"""What a test of one thing holds still: a fault on another day, in a log that begins in motion, of a servo with other gains."""

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
CROSSED = [  # seed, fault, command, logger, day
    (94_100_017, "overload", "uneven", "noise_3+drive_400hz", "warm winding, swell"),  # a jam before it
    (
        94_301_071,
        "coupling_loss",
        "s_curve",
        "low_pass+noise_3+jitter",
        "warm winding, swell",
    ),  # an overload before it
    (94_100_052, "slip", "", "no_voltage+steps_position", "gains 20 % higher"),  # health
    (94_300_120, "overload", "", "noise_third+position_100hz+steps_3_all", "usual"),  # a position sensor
    (94_100_053, "jam", "soft_ramps", "voltage_late+steps_position+csv_3_decimals", "usual"),  # an overload
    (94_200_065, "slip", "staircase", "wandering+twelve_bits", "usual"),  # an overload
    (94_201_073, "slip", "slow", "ideal", "usual"),  # health
]


def verdict(spec: TruthSpec, logger: str, seed: int, day: str = "usual") -> Event:
    """What is said of a move on a day, through a logger."""
    spec = SURROUNDINGS[day].change(spec, 1.0, np.random.default_rng([seed, 17]))
    outcome = diagnose_log(log_from_frame(make_log_with(logger, spec, seed)[0]), RIG, Settings())
    assert outcome.isolation is not None
    return outcome.isolation.verdict


def named(event: Event, label: str) -> bool:
    return label in (event.label, *event.alike)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kind", "shape", "logger", "day"), CROSSED)
@pytest.mark.first(1)
def test_what_was_told_as_another_thing_for_sure_is_among_what_is_told(
    seed: int, kind: str, shape: str, logger: str, day: str
) -> None:
    event = verdict(draw_severity_case(seed, kind, shape), logger, seed, day)
    assert named(event, kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["frozen_noisy", "drift"])
@pytest.mark.first(1)
def test_a_current_that_fails_in_a_log_which_begins_in_motion_has_no_offset(kind: str) -> None:
    """Its only rest is behind the failure."""
    said = [verdict(draw_failing_case(seed, kind, "current", 3.0), "mid_move", seed) for seed in SEEDS]
    assert sum(named(e, "sensor_fault") for e in said) >= len(said) - 1
    assert not [e.label for e in said if e.probability > 0.94 and not named(e, "sensor_fault")]


@pytest.mark.slow
def test_offsets_of_a_log_that_begins_in_motion_are_known() -> None:
    assert verdict(draw_severity_case(SEEDS[0], "nominal"), "mid_move+offsets", SEEDS[0]).label == "nominal"


@pytest.mark.slow
def test_a_burst_of_noise_on_held_readings_is_no_health() -> None:
    said = [verdict(draw_failing_case(seed, "noise_burst", "voltage"), "drive_400hz", seed) for seed in SEEDS]
    assert all(named(e, "sensor_fault") for e in said)
