"""What is left of moves: a curve that stands for the most of it, or the equation that the data want free."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.improve.moves.left_over import left_over
from observer_fi.improve.moves.misfit import dust, excess, position_dust
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.steps import Ladder, Smooth
from observer_fi.physics import load_rig

LEFT_OVER = sys.modules["observer_fi.improve.moves.left_over"]


@pytest.mark.parametrize(
    ("explained", "wanted", "told"),
    [
        (3e4, "servo", ["servo", "torque"]),
        (3e4, "torque", ["torque"]),  # its own term tells more than the equation alone
        (1.2e5, "servo", ["torque"]),
        (None, "servo", ["servo"]),
    ],
)
def test_a_curve_that_explains_little_does_not_hide_the_equation_that_is_wanted(
    explained: float | None, wanted: str, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A torque constant that differs by direction was a voltage sensor's curve over the speed, of half the misfit."""
    problem = simulated_moves([campaign()], load_rig())
    fitted = problem.baseline()
    nothing = np.empty(0)
    gain = explained or 0.0
    term = Smooth("torque", "load", False, gain, gain, 0.5, nothing, nothing, nothing, 9)
    monkeypatch.setattr(LEFT_OVER, "_smooth_rest", lambda *_: () if explained is None else (term,))
    monkeypatch.setattr(LEFT_OVER, "slow_excess", lambda *_: 1e6)
    monkeypatch.setattr(LEFT_OVER, "raw_excess", lambda *_: 1e6)
    rows = [SimpleNamespace(equation=wanted, gain=1e5), SimpleNamespace(equation="electrical", gain=1e4)]
    found = left_over(problem.experiment, Ladder(fitted, fitted, (), (), (), ()), lambda _: (tuple(rows), ()))
    assert [row.equation for row in found] == told


@pytest.mark.parametrize(
    ("equation", "told"), [("sensor:position", True), ("kinematics", True), ("torque", False)]
)
def test_what_only_the_position_shows_is_told_from_less_on(
    equation: str, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Timing of a servo, which everything else has to be larger than, does not reach the position."""
    problem = simulated_moves([campaign()], load_rig())
    fitted, experiment = problem.baseline(), problem.experiment
    most = excess(experiment, fitted.residuals)
    gain = 0.5 * (position_dust(experiment, most) + dust(experiment, most))
    term = Smooth(
        equation, "position", False, 2.0 * gain, gain, 0.5, np.empty(0), np.empty(0), np.empty(0), 1
    )
    monkeypatch.setattr(LEFT_OVER, "smooth_terms", lambda *_: [term])
    monkeypatch.setattr(LEFT_OVER, "rest_steps", lambda *_: [])
    monkeypatch.setattr(LEFT_OVER, "slow_excess", lambda *_: 1e6)
    found = left_over(experiment, Ladder(fitted, fitted, (), (), (), ()), lambda _: ((), ()))
    assert [row.equation for row in found] == [equation] * told


@pytest.mark.parametrize(("noise", "told"), [(0.2, []), (0.3, ["electrical"])])
def test_a_clear_misfit_is_said_however_gross_the_effect_was_that_it_is_left_of(
    noise: float, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """noise: share of it that the equation, set free, takes out of the readings; the effect was of a million nats."""
    problem = simulated_moves([campaign()], load_rig())
    fitted, experiment = problem.baseline(), problem.experiment
    gain = 0.5 * noise**2 * int((experiment.weight > 0.0).sum())
    monkeypatch.setattr(LEFT_OVER, "excess", lambda *_: 1e9)
    monkeypatch.setattr(LEFT_OVER, "raw_excess", lambda *_: gain)
    monkeypatch.setattr(LEFT_OVER, "slow_excess", lambda *_: gain)
    monkeypatch.setattr(LEFT_OVER, "smooth_terms", lambda *_: [])
    monkeypatch.setattr(LEFT_OVER, "rest_steps", lambda *_: [])
    rows = (SimpleNamespace(equation="electrical", gain=gain),)
    ladder = Ladder(fitted, fitted, (SimpleNamespace(),), (), (), ())
    found = left_over(experiment, ladder, lambda _: (rows, ()))
    assert [(row.equation, row.regressor) for row in found] == [(name, "unknown") for name in told]
