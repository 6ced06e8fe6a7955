"""A name is taken back where what it leaves shows that another law is at work."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import hidden
import numpy as np
import pytest

from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.refuted import unrefuted
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.steps import Candidate, HeldOut, Ladder, Smooth, Step, Trial, nameless
from observer_fi.learn import with_servo
from observer_fi.logs import log_from_frame
from observer_fi.physics import CAUSES, Coverage, load_rig

REFUTED = sys.modules["observer_fi.improve.moves.refuted"]
EXPERIMENT = SimpleNamespace(weight=np.ones((1000, 3)))
NOTHING = np.empty(0)
FAINT = ("position_hysteresis", "lead_swing")  # what is told of them at their detectable size already


def curve(equation: str, gain: float) -> Smooth:
    at = np.array([0.0, 1.0])
    return Smooth(equation, "speed", False, gain, gain, 0.9, at, at, at, 9)


def line(equation: str, gain: float) -> Smooth:
    """A line over the motor's angle, which has a gain and no curve."""
    return replace(nameless(equation, gain, gain), regressor="shaft_angle", order=9.0)


def step_of(cause: str, gain: float) -> Step:
    named = Candidate(CAUSES[cause], CAUSES[cause].forms(Coverage())[0], gain, gain, {}, {})
    return Step(Trial((named,), None, gain, (gain,)), HeldOut(1.0, {}), {cause: ()})


@pytest.mark.parametrize(
    ("left", "rest", "instead", "kept"),
    [
        (900.0, [nameless("servo", 600.0, 900.0)], 0.0, ["viscous_friction"]),
        (1100.0, [nameless("servo", 600.0, 1100.0)], 0.0, []),  # more stays in the dark than the name explains
        (1100.0, [nameless("servo", 600.0, 1100.0), curve("sensor:current", 500.0)], 0.0, []),  # a curve of another equation
        (1100.0, [curve("sensor:current", 900.0)], 1100.0, ["viscous_friction"]),  # an effect of its own beside it
        (1100.0, [curve("sensor:current", 900.0)], 1900.0, []),  # which in its place does for both
        (300.0, [nameless("torque", 250.0, 300.0)], 0.0, []),  # its own equation is not yet right
        (300.0, [nameless("servo", 250.0, 300.0)], 0.0, ["viscous_friction"]),
        (300.0, [nameless("torque", 0.0, 0.0)], 0.0, ["viscous_friction"]),  # only bent, not wanted
        (1.5, [nameless("torque", 1.5, 1.5)], 0.0, ["viscous_friction"]),  # a thousandth: the timing of a servo
        (300.0, [line("torque", 250.0)], 0.0, []),
        (300.0, [line("electrical", 250.0)], 0.0, ["viscous_friction"]),
    ],
)  # fmt: skip
def test_a_name_stands_by_what_it_leaves(
    left: float, rest: list[Smooth], instead: float, kept: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name gains 1000 nats. left: misfit that it leaves; instead: what the best curve gains without it."""
    monkeypatch.setattr(REFUTED, "missed", lambda *_: left)
    monkeypatch.setattr(REFUTED, "smooth_terms", lambda *_: [curve("torque", instead)])
    baseline, extended = SimpleNamespace(objective=1000.0 + left), SimpleNamespace(objective=left)
    ladder = Ladder(baseline, extended, (step_of("viscous_friction", 1000.0),), (extended,), (), ())
    found = unrefuted(EXPERIMENT, ladder, rest, lambda *_: baseline)
    assert [name for step in found.steps for name in step.trial.causes] == kept
    assert found.extended is (extended if kept else baseline)
    assert found.refused == (() if kept else (("viscous_friction", 1000.0),))


@pytest.mark.parametrize(
    ("cause", "equation", "regressor", "stays"),
    [
        ("position_gain", "sensor:position", "position", False),
        ("partial_slip", "kinematics", "screw_angle", False),
        ("position_gain", "kinematics", "speed", True),
        ("position_gain", "torque", "position", True),
        ("viscous_friction", "sensor:position", "position", True),
    ],
)
def test_a_scale_that_is_not_the_same_along_the_travel_is_none(
    cause: str, equation: str, regressor: str, stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A screw whose lead swings was a position_gain for sure."""
    monkeypatch.setattr(REFUTED, "missed", lambda *_: 100.0)
    monkeypatch.setattr(REFUTED, "smooth_terms", lambda *_: [curve("torque", 0.0)])
    baseline, extended = SimpleNamespace(objective=1100.0), SimpleNamespace(objective=100.0)
    ladder = Ladder(baseline, extended, (step_of(cause, 1000.0),), (extended,), (), ())
    left = replace(curve(equation, 100.0), regressor=regressor)
    assert bool(unrefuted(EXPERIMENT, ladder, [left], lambda *_: baseline).steps) == stays


def test_a_weaker_name_goes_and_a_stronger_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(REFUTED, "missed", lambda *_: 500.0)
    fits = [SimpleNamespace(objective=objective) for objective in (3300.0, 800.0, 500.0)]
    steps = (step_of("viscous_friction", 2500.0), step_of("brush_drop", 300.0))
    ladder = Ladder(fits[0], fits[2], steps, tuple(fits[1:]), (), ())
    without = {"brush_drop": fits[1], "viscous_friction": fits[0]}
    found = unrefuted(
        EXPERIMENT, ladder, [nameless("servo", 400.0, 500.0)], lambda _, s: without[s.trial.causes[0]]
    )
    assert found.steps == steps[:1] and found.extended is fits[1]
    assert found.refused == (("brush_drop", 300.0),)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(
    ("cause", "seed"),
    [
        ("km_by_direction", 7110007), ("lead_heating", 7110010), ("square_drag", 7110013), ("kp_by_error", 7110020),
        ("position_hysteresis", 7110033), ("lead_swing", 99100040),
    ],
)  # fmt: skip
def test_what_is_outside_the_vocabulary_has_its_equation_told_and_no_name(cause: str, seed: int) -> None:
    """They were voltage_offset, position_gain, viscous_friction, load_dependent_friction, and position_gain twice."""
    spec = hidden.draw_effects_case(seed, (cause,), 1.0 if cause in FAINT else 3.0)
    log, rig = log_from_frame(hidden.make_log(spec, seed)[0]), load_rig()
    problem = simulated_moves([log], with_servo([log], rig))
    ladder = problem.reconsidered(name_causes(problem))
    assert ladder.steps == ()
    assert problem.unexplained(ladder)[0].equation in hidden.ALL[cause].equations


def stands_beside(cause: str, rest: Smooth, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether a name that gains 1000 nats and leaves 300 stands beside what is told of these."""
    monkeypatch.setattr(REFUTED, "missed", lambda *_: 300.0)
    monkeypatch.setattr(REFUTED, "smooth_terms", lambda *_: [curve("torque", 0.0)])
    baseline, extended = SimpleNamespace(objective=1300.0), SimpleNamespace(objective=300.0)
    ladder = Ladder(baseline, extended, (step_of(cause, 1000.0),), (extended,), (), ())
    return bool(unrefuted(EXPERIMENT, ladder, [rest], lambda *_: baseline).steps)


@pytest.mark.parametrize(("cause", "kept"), [("input_delay", False), ("viscous_friction", True)])
def test_what_a_servo_misses_over_its_own_error_refutes_a_name_of_the_servo(
    cause: str, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command behind a low-pass was an `input_delay`, which explains 98 % of it."""
    assert stands_beside(cause, curve("servo", 250.0), monkeypatch) is kept


@pytest.mark.parametrize(
    ("cause", "regressor", "gain", "kept"),
    [
        ("load_dependent_friction", "load", 150.0, False),
        ("load_dependent_friction", "current", 150.0, False),
        ("load_dependent_friction", "load", 30.0, True),
        ("viscous_friction", "speed", 30.0, False),
        ("viscous_friction", "speed", 15.0, True),
        ("load_dependent_friction", "position", 150.0, True),
        ("position_periodic_error", "position", 150.0, False),
        ("position_periodic_error", "time", 150.0, True),
    ],
)
def test_a_curve_over_what_a_name_goes_with_says_that_its_law_is_another(
    cause: str, regressor: str, gain: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A friction that grows with the electrical power was one that grows with the load, beside a curve over the load."""
    rest = replace(curve(CAUSES[cause].equation, gain), regressor=regressor)
    assert stands_beside(cause, rest, monkeypatch) is kept
