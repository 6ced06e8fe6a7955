"""Obstacles of other laws than the paper's: a linear spring, a ball, a wall, a load in front of a spring."""

from dataclasses import replace

import hidden
import pytest
from hidden.faults import Obstacle

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG = load_rig()
FRICTION = hidden.TABLE_1.A


def verdict(seed: int, obstacle: Obstacle) -> tuple[Event, float]:
    """Verdict on a move that meets the obstacle, and when it did [s]."""
    spec = hidden.draw_move_case(seed, "overload")
    spec = replace(spec, fault=replace(spec.fault, obstacle=obstacle))
    found = diagnose_log(log_from_frame(hidden.make_log(spec, seed)[0]), RIG, Settings()).isolation
    assert found is not None and spec.fault.onset_s is not None
    return found.verdict, spec.fault.onset_s


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "share"), [(70215, 20.0), pytest.param(70102, 200.0, marks=pytest.mark.slow)]
)
@pytest.mark.first(1)
def test_a_spring_is_an_overload_and_tells_its_stiffness(seed: int, share: float) -> None:
    """Of 20 and 200 times the friction at 1 mm; by the square law alone both were faults without a name."""
    v, onset = verdict(seed, Obstacle(share * FRICTION, 1.0, share_lost=0.52))
    assert v.label == "overload" and v.probability > 0.95 and v.onset_s == pytest.approx(onset, abs=0.01)
    stiffness = next(s for s in v.severity if s.name == "stiffness")
    assert stiffness.unit == "N m/m"
    assert stiffness.value == pytest.approx(share * FRICTION / 1e-3, rel=0.03)
    newton = share * FRICTION / 1e-3 / hidden.TABLE_1.D * 1e-3
    number, unit = stiffness.words.split(" of ")[1].split(" ")
    assert float(number) * {"N/mm": 1.0, "kN/mm": 1e3}[unit] == pytest.approx(newton, rel=0.06)


@pytest.mark.parametrize(
    ("seed", "obstacle"),
    [
        pytest.param(70219, Obstacle(20.0 * FRICTION, 1.5, share_lost=0.52), marks=pytest.mark.slow),
        pytest.param(70103, Obstacle(2000.0 * FRICTION, 1.0, share_lost=0.52), marks=pytest.mark.slow),
        (70104, Obstacle(FRICTION, 1.0, preload=0.5 * FRICTION, share_lost=0.52)),
    ],
    ids=["ball", "wall", "load"],
)
@pytest.mark.slow
@pytest.mark.first(1)
def test_obstacles_of_no_law_in_particular_are_overloads(seed: int, obstacle: Obstacle) -> None:
    v, onset = verdict(seed, obstacle)
    assert v.label == "overload" and v.probability > 0.95 and v.onset_s == pytest.approx(onset, abs=0.02)


@pytest.mark.slow
def test_a_spring_that_the_mass_follows_into_may_as_well_be_a_jam_that_grows() -> None:
    """At one speed a load that grows with the travel also grows with time; it was a jam with certainty."""
    v, _ = verdict(70203, Obstacle(20.0 * FRICTION, 1.0))
    assert {v.label, *v.alike} == {"overload", "jam"} and v.probability == pytest.approx(0.5)
