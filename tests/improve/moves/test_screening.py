"""Scores of causes on simulated moves: linear gains against refits, sizes against the truth, and what is projected off."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.improve.moves.screening import (
    Projector,
    columns_of,
    coverage_of,
    free_of,
    penalty,
    refit,
    screen,
    start_values,
    without,
)
from observer_fi.improve.moves.simulated_moves import SimulatedMoves, shortlist, simulated_moves
from observer_fi.physics.effects import CAUSES, MOVES, Coverage
from observer_fi.physics.rigs import load_rig, with_values

RIG = load_rig()
OFFSET = 4e-6  # N m


@pytest.fixture(scope="module")
def problem() -> SimulatedMoves:
    """Four moves of a plant whose constant load the rig file lacks."""
    plant = with_values(RIG, {"torque_offset": OFFSET})
    return simulated_moves([campaign(plant, seed=2, speeds=(410.0,), hold=0.4)], RIG)


@pytest.fixture(scope="module")
def scores(problem):
    causes = ("torque_offset", "viscous_friction", "current_offset", "integrator_clamp")
    fitted = problem.baseline()
    return screen(
        problem.experiment, fitted, causes, coverage_of(problem.experiment, fitted.model, fitted.nuisance)
    )


def test_the_hidden_cause_scores_best_with_its_size(problem, scores):
    assert scores[0].cause.name == "torque_offset"
    one_error = scores[0].detectable["torque_offset"] / 5.0
    assert abs(scores[0].size["torque_offset"] - OFFSET) < 4.0 * one_error
    assert scores == sorted(scores, key=lambda c: -c.gain)


def test_a_linear_score_is_what_the_refit_gains(problem, scores):
    fitted = problem.baseline()
    exact = refit(problem.experiment, fitted, scores[0], exact=True)
    assert fitted.objective - exact.objective == pytest.approx(scores[0].gain, rel=0.02)
    assert exact.model["torque_offset"] == pytest.approx(scores[0].size["torque_offset"], rel=0.02)


def test_each_parameter_is_paid_for(problem, scores):
    prices = {c.cause.name: c.gain - c.net for c in scores}
    n = int((problem.experiment.weight > 0.0).sum())
    assert prices["torque_offset"] == pytest.approx(0.5 * np.log(n) + np.log(len(scores)))
    assert prices["viscous_friction"] - prices["torque_offset"] == pytest.approx(0.5 * np.log(n))
    assert penalty(problem.experiment, 2, 10) > penalty(problem.experiment, 2, 5)


def test_what_went_in_comes_out_again(problem, scores):
    fitted = problem.baseline()
    inside = refit(problem.experiment, fitted, scores[0], exact=True)
    outside = without(problem.experiment, inside, scores[0].variant)
    assert [f.name for f in outside.free] == [f.name for f in fitted.free]
    assert outside.model["torque_offset"] == 0.0
    assert outside.objective == pytest.approx(fitted.objective, abs=0.5)


def test_what_the_refit_can_do_is_projected_off(problem):
    fitted = problem.baseline()
    project = Projector(problem.experiment, fitted)
    inner = [k for k, f in enumerate(fitted.free) if f.name == "A"]
    column = fitted.columns[inner[0]]
    left = project(column)[: column.size]
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(column)  # what is left is the prior's
    rng = np.random.default_rng(0).normal(size=column.shape) * (problem.experiment.weight > 0.0)
    assert np.linalg.norm(project(rng)) > 0.9 * np.linalg.norm(rng)


def test_a_column_is_the_change_of_the_readings_by_one_start(problem):
    fitted, experiment = problem.baseline(), problem.experiment
    variant = CAUSES["current_offset"].variants(Coverage(current_noise=3e-4), MOVES)[0]
    ((column,),) = columns_of(experiment, fitted, [variant])
    start = variant.terms[0].start
    seen = experiment.weight[:, 1] > 0.0
    assert np.median(column[seen, 1]) == pytest.approx(start * experiment.weight[seen, 1].max(), rel=0.02)
    assert np.abs(column[:, 2]).max() < 1e-3 * np.abs(column[:, 1]).max()


def test_coverage_is_that_of_the_log(problem):
    fitted = problem.baseline()
    c = coverage_of(problem.experiment, fitted.model, fitted.nuisance)
    x = problem.logs[0].z[:, 2]
    assert c.travel == pytest.approx(np.ptp(x), rel=0.1)
    assert (c.speed, c.step_s, c.pitch) == pytest.approx((410.0, 1 / 1600, 8.0), rel=1e-3)
    assert c.position_noise == pytest.approx(1e-5, rel=0.1)
    assert c.torque == fitted.model["A"] and not c.screw_is_shaft


def test_a_limit_starts_just_below_what_was_reached():
    variant = CAUSES["integrator_clamp"].variants(Coverage(integral=2.0), MOVES)[0]
    (free,) = free_of(variant)
    assert start_values(variant) == {"integrator_limit": pytest.approx(1.98)}
    assert 1.98 < free.high < 2.0 and free.low < 0.01


def test_the_shortlist_holds_two_forms_of_each_of_the_best_causes(problem, scores):
    forms = [replace(scores[0], gain=100.0 - k) for k in range(3)]
    other = replace(next(c for c in scores if c.cause.name != "torque_offset"), gain=50.0)
    hopeless = replace(other, cause=CAUSES["backlash"], gain=1.0)
    listed = shortlist([*forms, other, hopeless], 0.0, problem.settings)
    assert listed == [*forms[:2], other]
    assert shortlist([*forms, other], 60.0, problem.settings) == forms[:2]
    assert shortlist([*forms, other], 0.0, replace(problem.settings, rivals=1)) == forms[:2]


def test_a_signed_cause_cannot_score_with_the_wrong_sign(problem):
    """Viscous friction only brakes: a plant with less of it than its rig file says shows none."""
    fitted, experiment = problem.baseline(), problem.experiment
    variant = CAUSES["viscous_friction"].variants(
        coverage_of(experiment, fitted.model, fitted.nuisance), MOVES
    )[0]
    assert all(t.low == 0.0 for t in variant.terms)
    (columns,) = columns_of(experiment, fitted, [variant])
    driving = replace(fitted, residuals=-50.0 * columns.sum(axis=0))
    found = screen(
        experiment, driving, ["viscous_friction"], coverage_of(experiment, fitted.model, fitted.nuisance)
    )
    assert not found or found[0].gain < 1e-3 * 0.5 * float(np.sum(driving.residuals**2))


@pytest.mark.parametrize("exact", [False, True])
def test_a_rival_whose_simulation_runs_away_is_none(problem, scores, monkeypatch, exact):
    """Its normal equations have no numbers; that ended the command."""

    def runs_away(*_args, **_known):
        return np.linalg.pinv(np.full((2, 2), np.nan))

    fitted = problem.baseline()
    monkeypatch.setattr(import_module("observer_fi.learn.output_error"), "search", runs_away)
    assert refit(problem.experiment, fitted, scores[0], exact=exact) is None
    assert problem.trials(fitted, scores) == []
