"""Whether a trial is believed: a ripple is a line among other orders, and Stribeck's friction falls somewhere."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.improve.moves.judgement import is_no_line, is_no_scale, only_bends
from observer_fi.improve.moves.lines import Line
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.steps import Candidate, Trial
from observer_fi.physics import CAUSES, MOVES, Coverage, load_rig, override

RIG = load_rig()
JUDGEMENT = sys.modules["observer_fi.improve.moves.judgement"]


@pytest.mark.parametrize(("line", "background", "is_line"), [(100.0, 30.0, True), (100.0, 90.0, False)])
def test_a_ripple_of_any_order_stands_out_from_other_orders(
    line: float, background: float, is_line: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes at each start comes at the same angles: a friction that ages at rest was a ripple of order 3.32."""
    problem = simulated_moves([campaign()], RIG)
    fitted = problem.baseline()
    found = [Line(3.3, line), *(Line(4.0 + k, background) for k in range(5))]
    monkeypatch.setattr(JUDGEMENT, "lines_of", lambda *_: found)
    monkeypatch.setattr(JUDGEMENT, "excess", lambda *_: 1e3)
    cause = CAUSES["gear_ripple"]
    model = override(fitted.model, fitted.model.name, gear_order=3.3)
    variant = cause.variants(Coverage(orders=(3.3,)), MOVES)[0]
    candidate = Candidate(cause, variant, 100.0, 90.0, {}, {})
    trial = Trial((candidate,), replace(fitted, model=model), 100.0, (90.0,))
    assert is_no_line(problem.experiment, fitted, trial) is not is_line
    assert not is_no_line(problem.experiment, fitted, replace(trial, gain=600.0))


@pytest.mark.parametrize(
    ("viscous", "stribeck", "below", "bends"),
    [(1.35e-7, 2.1e-5, 159.0, True), (2.4e-8, 9e-6, 60.0, False), (0.0, 2.1e-5, 159.0, False), (0.0, 2e-5, 350.0, False)],
)  # fmt: skip
def test_friction_of_low_speeds_falls_somewhere(
    viscous: float, stribeck: float, below: float, bends: bool
) -> None:
    """A drag that grows with the square of the speed was viscous friction, and Stribeck's beside it."""
    sizes = {"stribeck_torque": stribeck, "stribeck_speed": below}
    model = override(RIG.model, "drag", viscous_positive=viscous, viscous_negative=viscous, **sizes)
    cause = CAUSES["stribeck_friction"]
    candidate = Candidate(cause, cause.variants(Coverage(), MOVES)[0], 100.0, 90.0, {}, {})
    trial = Trial((candidate,), SimpleNamespace(model=model), 100.0, (90.0,))
    assert only_bends(SimpleNamespace(peak=np.array([-410.0, 200.0])), trial) is bends


@pytest.mark.parametrize(
    ("wave", "gain", "travel", "none"),
    [(8e-6, 1.1, 1.7e-3, True), (8e-6, 1.0, 1.7e-3, False), (0.0, 1.1, 1.7e-3, False), (8e-6, 1.1, 2.1e-3, False)],
)  # fmt: skip
def test_a_gain_and_a_part_of_a_period_are_a_sensor_that_is_not_linear(
    wave: float, gain: float, travel: float, none: bool
) -> None:
    """Together they do for any bend: the square of the position, or a screw whose lead swings over 3.2 mm."""
    model = override(RIG.model, "bent", position_sin=wave, position_gain=gain, position_period=1e-3)
    cause = CAUSES["position_gain"]
    candidate = Candidate(cause, cause.variants(Coverage(), MOVES)[0], 100.0, 90.0, {}, {})
    trial = Trial((candidate,), SimpleNamespace(model=model), 100.0, (90.0,))
    x = np.linspace(0.0, travel, 50)
    moved = SimpleNamespace(z=np.column_stack([x, x, x]), weight=np.ones((50, 3)))
    assert is_no_scale(moved, trial) is none
