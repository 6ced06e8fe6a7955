"""The problem of simulated moves: no name beside a gross misfit, and no stop where a torque grows along the travel."""

from dataclasses import replace

import hidden
import pytest
from campaigns import campaign, log_of

from observer_fi.improve.moves.simulated_moves import (
    MoveSettings,
    SimulatedMoves,
    simulated_moves,
)
from observer_fi.improve.steps import Candidate, HeldOut, Ladder, Step, Trial
from observer_fi.learn import prepare
from observer_fi.physics import CAUSES, Coverage, Curve, with_curve
from observer_fi.physics.rigs import load_rig, override

RIG = load_rig()


@pytest.mark.parametrize(
    ("before", "left", "bent", "kept"),
    [(10.0, 1.0, 0.0, True), (10.0, 2.0, 0.0, True), (10.0, 5.0, 0.0, False), (10.0, 2.0, 6.0, False),
     (10.0, 1.0, 6.0, True), (100.0, 2.0, 0.0, True), (100.0, 6.0, 0.0, False), (10.0, 1.0, 600.0, False)],
)  # fmt: skip
def test_no_cause_is_named_that_leaves_a_gross_misfit(
    before: float, left: float, bent: float, kept: bool
) -> None:
    """before, left: residuals over the noise, without and with a name. bent: standard deviations of Km."""
    log = log_of(hidden.there_and_back((410.0,), (0.3,), (0.0,)))
    problem = SimulatedMoves((log,), RIG, prepare([log], RIG), RIG.model, MoveSettings())
    well = problem.baseline()
    baseline = replace(well, residuals=before * well.residuals)
    Km = next(f for f in well.free if f.name == "Km")
    model = override(well.model, "bent", Km=Km.prior + bent * Km.prior_std)
    extended = replace(well, residuals=left * well.residuals, model=model)
    cause = CAUSES["brush_drop"]
    named = Candidate(cause, cause.forms(Coverage())[0], 0.0, 0.0, {}, {})
    steps = (Step(Trial((named,), extended, 1e4, (1e4,)), HeldOut(1.0, {}), {"brush_drop": ()}),)
    found = problem._believed(Ladder(baseline, extended, steps, (extended,), (), ()))
    assert (found.steps == steps) is kept
    assert found.extended is (extended if kept else baseline)
    assert found.refused == (() if kept else (("brush_drop", 1e4),))


@pytest.mark.slow
def test_a_torque_that_grows_along_the_travel_is_no_stop() -> None:
    """A spring, or a rail whose slope changes: a soft stop explained it, whose share of the travel then bent the position."""
    spring = Curve("torque", "position", False, -1e-3, 2e-3, (-2.5e-5, 2.5e-5))
    truth = with_curve(RIG, spring)
    problem = simulated_moves([campaign(truth)], RIG)
    assert problem.model == RIG.model
    left = problem.unexplained(Ladder(problem.baseline(), problem.baseline(), (), (), (), ()))
    assert left and left[0].equation == "torque"
