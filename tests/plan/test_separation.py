"""What `improve` says to record next: the planner's move where a finding has rivals, and that none decides where none can."""

from dataclasses import dataclass
from typing import cast

import pytest
from campaigns import campaign

from observer_fi.improve import FoundCause, Improvement
from observer_fi.improve.improvement import Value
from observer_fi.logs import Excitation, excitation, log_segments
from observer_fi.physics import Rig, load_rig
from observer_fi.plan import with_moves
from observer_fi.records import Log

RIG = load_rig()
FIXED = "what the table of causes says"


@dataclass(frozen=True)
class Found:
    """What of an Improvement is read."""

    rig: Rig
    excitations: tuple[Excitation, ...]
    findings: tuple[FoundCause, ...]


@pytest.fixture(scope="module")
def log() -> Log:
    return campaign()


def said(log: Log, cause: str, sizes: dict[str, float], *rivals: str, most_s: float = 600.0) -> str:
    """What separates a finding from its rivals, after a plan without haste."""
    values = {name: Value(size, 0.0, 0.0, "") for name, size in sizes.items()}
    finding = FoundCause(1, cause, "torque", "", "", values, 0.0, 0.0, {}, rivals, FIXED)
    record = Found(RIG, (excitation(log, log_segments(log), RIG.model),), (finding,))
    return with_moves(cast(Improvement, record), [log], most_s).findings[0].separate_by


@pytest.mark.slow
def test_a_move_that_decides_is_told_with_its_length_and_its_odds(log: Log) -> None:
    told = said(log, "backlash", {"backlash": 2e-5}, "position_lag")
    assert "rad/s" in told and " deg, " in told and "to 1 are expected (backlash or position lag)" in told


@pytest.mark.slow
def test_causes_that_move_the_readings_alike_are_told_apart_by_no_move(log: Log) -> None:
    told = said(log, "torque_offset", {"torque_offset": 2e-5}, "asymmetric_friction", "pitch_offset")
    assert told.startswith("no move tells torque offset from asymmetric friction or pitch offset")
    assert "inclinometer" in told and "odds" not in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "rivals"),
    [("backlash", ()), ("contact_damping", ("contact_exponent",)), ("gear_ripple", ("gear_ripple",))],
)
def test_the_table_speaks_where_the_planner_has_nothing_to_say(
    log: Log, cause: str, rivals: tuple[str, ...]
) -> None:
    """No rival, a stop that must be touched, a question that the planner refuses."""
    assert said(log, cause, {}, *rivals) == FIXED


@pytest.mark.slow
def test_the_table_speaks_where_the_time_is_over(log: Log) -> None:
    assert said(log, "backlash", {"backlash": 2e-5}, "position_lag", most_s=-1.0) == FIXED
