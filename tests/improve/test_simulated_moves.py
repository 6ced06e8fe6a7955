"""What a refit may move: the stops stay on their own sides, the age of held readings is open, and what it says of makers."""

import math
from dataclasses import replace
from types import SimpleNamespace

import hidden
import numpy as np
import pytest
from campaigns import log_of

from observer_fi.improve.misfit import held_out_residuals
from observer_fi.improve.problem import Candidate, HeldOut, Ladder, Step, Trial
from observer_fi.improve.simulated_moves import MoveSettings, SimulatedMoves, base_parameters
from observer_fi.learn import Free, fit, prepare
from observer_fi.physics import CAUSES, Coverage
from observer_fi.physics.rigs import load_rig, override

RIG = load_rig()


def stops(**places: float) -> dict[str, tuple[float, float]]:
    model = override(RIG.model, "nominal", **places)
    return {f.name: (f.low, f.high) for f in base_parameters(RIG, model) if f.name.startswith("x_stop")}


def test_two_stops_keep_half_of_their_distance():
    bounds = stops(x_stop_high=6e-4, x_stop_low=-2e-4)
    assert bounds["x_stop_high"][0] - bounds["x_stop_low"][1] == pytest.approx(4e-4)
    assert bounds["x_stop_high"][0] < 6e-4 and bounds["x_stop_low"][1] > -2e-4


def test_a_single_stop_is_free_and_none_is_none():
    assert stops(x_stop_high=6e-4) == {"x_stop_high": (-1.0, 1.0)}
    assert stops() == {}
    assert all(math.isfinite(f.step) for f in base_parameters(RIG, RIG.model))


@pytest.mark.parametrize("older_s", [1.0 / 1600.0, 1.0 / 400.0])
def test_readings_that_a_converter_holds_may_be_as_old_as_a_row(older_s: float):
    """Anywhere between fresh and a whole row old, on top of what lies between servo and logger."""
    fresh, held = ({f.name: f for f in base_parameters(RIG, RIG.model, older)} for older in (0.0, older_s))
    assert {name for name in fresh if fresh[name] != held[name]} == {"tick_phase"}
    usual, older = fresh["tick_phase"], held["tick_phase"]
    assert base_parameters(RIG, RIG.model) == tuple(fresh.values())
    assert (older.low, older.high) == (usual.low, usual.high + older_s)
    for age in (0.0, older_s):
        assert abs(usual.prior + age - older.prior) < 2.0 * older.prior_std
    assert older.prior == pytest.approx(usual.prior + 0.5 * older_s)
    assert older.prior_std**2 == pytest.approx(usual.prior_std**2 + older_s**2 / 12.0)


@pytest.mark.parametrize("name, equation", [("Rm", "electrical"), ("Km", "electrical"), ("D", "kinematics")])
def test_of_a_winding_only_a_voltage_says_that_its_maker_is_wrong(name: str, equation: str):
    log = log_of(hidden.single_move(410.0, 0.4))
    z = log.z.copy()
    z[:, 0] = np.nan
    free = base_parameters(RIG, RIG.model)
    prior = next(f for f in free if f.name == name)
    said = {}
    for off in (4.0, 6.0):
        model = override(RIG.model, "bent", **{name: prior.prior + off * prior.prior_std})
        for voltage, read in ((True, log), (False, replace(log, z=z))):
            problem = SimulatedMoves((read,), RIG, prepare([read], RIG), RIG.model, MoveSettings())
            said[off, voltage] = problem._bent(SimpleNamespace(free=free, model=model))
    assert said[4.0, True] == said[4.0, False] == ()
    assert said[6.0, True] == (equation,)
    assert said[6.0, False] == (() if equation == "electrical" else (equation,))


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


def test_held_out_moves_within_a_play_go_on_from_where_the_mass_was_left() -> None:
    """Slow moves shorter than the play: what they show depends on every move since the mass last moved."""
    profile = hidden.there_and_back((410.0, 90.0, 90.0), (0.5, 0.5, 0.9), (0.0, 0.0, 0.0))
    experiment = prepare([log_of(profile, effects=(hidden.effect("backlash", width=2e-4),))], RIG)
    model = override(RIG.model, "play", backlash=2e-4)
    fitted = fit(experiment, model, (*base_parameters(RIG, RIG.model), Free("backlash", 2e-6, 0.0, 1e-3)))
    off = held_out_residuals(experiment, fitted)[experiment.rows(4), 2]
    assert np.sqrt(np.mean(off**2)) < 2.0
