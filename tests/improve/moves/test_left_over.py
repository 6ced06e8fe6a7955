"""What is left of moves: a curve that stands for the most of it, or the equation that the data want free."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.improve.moves.left_over import left_over
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.steps import Ladder, Smooth
from observer_fi.physics import load_rig

LEFT_OVER = sys.modules["observer_fi.improve.moves.left_over"]


@pytest.mark.parametrize(
    ("share", "wanted", "told"),
    [
        (0.3, "servo", ["servo", "torque"]),
        (0.3, "torque", ["torque"]),
        (0.8, "servo", ["torque"]),
        (None, "servo", ["servo"]),
    ],
)
def test_a_curve_that_explains_little_does_not_hide_the_equation_that_is_wanted(
    share: float | None, wanted: str, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command behind a filter that the log does not show was a torque over the load, of a quarter of the misfit."""
    problem = simulated_moves([campaign()], load_rig())
    fitted = problem.baseline()
    nothing = np.empty(0)
    term = Smooth("torque", "load", False, 1e3, 1e3, share or 0.0, nothing, nothing, nothing, 9)
    monkeypatch.setattr(LEFT_OVER, "_smooth_rest", lambda *_: () if share is None else (term,))
    monkeypatch.setattr(LEFT_OVER, "slow_excess", lambda *_: 1e6)
    monkeypatch.setattr(LEFT_OVER, "raw_excess", lambda *_: 1e6)
    rows = [SimpleNamespace(equation=wanted, gain=1e5), SimpleNamespace(equation="electrical", gain=1e4)]
    monkeypatch.setattr(LEFT_OVER, "free_equations", lambda *_: (rows, ()))
    found = left_over(problem.experiment, Ladder(fitted, fitted, (), (), (), ()))
    assert [row.equation for row in found] == told
