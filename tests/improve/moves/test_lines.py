"""Lines in a disturbing torque: the pass backwards is the transpose of the one forwards, and orders and frequencies are found."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG, campaign

from observer_fi.improve import improve
from observer_fi.improve.moves.lines import line_by_move, order_lines, time_lines
from observer_fi.improve.moves.rig_refit import refit_of_the_rig
from observer_fi.improve.moves.screening import Projector
from observer_fi.learn import RESISTANCE, TORQUE, gradient, linearised, prepare, response, run
from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig, with_values
from observer_fi.records import Log

ORDERS = (0.17, 0.43, 2.31)


def refitted(values: dict[str, float]):
    """As `around`, of a campaign with some effects in the plant."""
    return around(campaign(with_values(RIG, values), speeds=(410.0, 200.0), pitches=(0.0, 5.0), seed=5))


def around(log: Log):
    """An experiment, the fit of the rig to it, the linear motion around that, and its states."""
    experiment = prepare([log], RIG)
    fitted = refit_of_the_rig(experiment, RIG, RIG.model)
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    return experiment, fitted, linearised(experiment, fitted.model, states), states


def test_gradient_is_the_transpose_of_the_response() -> None:
    experiment, _, linear, _ = refitted({})
    rng = np.random.default_rng(3)
    forcing, r = rng.standard_normal((1, experiment.t.size)), rng.standard_normal((experiment.t.size, 3))
    forwards = float(np.sum(response(experiment, linear, TORQUE, forcing)[0] * r))
    backwards = float(forcing[0] @ gradient(experiment, linear, TORQUE, r))
    assert backwards == pytest.approx(forwards, rel=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_a_line_of_any_order_is_found_first(order: float) -> None:
    ripple = {"gear_ripple_sin": 8e-6, "gear_ripple_cos": 6e-6, "gear_order": order}
    experiment, fitted, linear, states = refitted(ripple)
    found = order_lines(experiment, Projector(experiment, fitted), linear, states)
    assert found[0].at == pytest.approx(order, abs=0.01)
    assert found[0].gain > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7311, 7312, 7313])
@pytest.mark.first(1)
def test_no_line_where_there_is_none(seed: int) -> None:
    frame, _ = hidden.make_log(hidden.draw_effects_case(seed, (), 0.0), seed)
    experiment, fitted, linear, states = around(log_from_frame(frame))
    projector = Projector(experiment, fitted)
    lines = [*order_lines(experiment, projector, linear, states), *time_lines(experiment, projector, linear)]
    assert all(line.gain < 20.0 for line in lines)


def hidden_line(seed: int, cause: str, **values: float):
    """As `around`, of the independent truth with a line over the motor's angle; its start is another in every move."""
    spec = replace(hidden.draw_effects_case(seed, (), 0.0), effects=(hidden.effect(cause, **values),))
    return around(log_from_frame(hidden.make_log(spec, seed)[0]))


def off_by(seed: int) -> float:
    """How far the order of a line is from that of a hidden ripple of a high order, NaN where no line is told."""
    order = float(np.random.default_rng(seed).uniform(5.0, 12.0))
    experiment, fitted, _, _ = hidden_line(seed, "shaft_ripple", amplitude=1.6e-5, order=order, phase=1.0)
    found = line_by_move(experiment, fitted, TORQUE)
    return found.at - order if found is not None else float("nan")


@pytest.mark.slow
def test_a_line_of_a_high_order_has_a_phase_of_its_own_in_every_move() -> None:
    """Orders above six were lower ones that took a part of them."""
    assert abs(off_by(7321)) < 0.01


@pytest.mark.slow
@pytest.mark.study
def test_a_line_of_a_high_order_is_told_with_its_order_or_not_at_all() -> None:
    """Near the highest order that the logger shows of the fastest moves another one was told: two of eight. Of these 16 one."""
    errors = np.abs([off_by(seed) for seed in (*range(7351, 7359), *range(7361, 7369))])
    assert (errors > 0.01).sum() <= 1
    assert (errors < 0.01).sum() >= 5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7331, 7332, 7333])
@pytest.mark.first(1)
def test_a_line_of_the_winding_is_found_with_its_order(seed: int) -> None:
    bars = float(np.random.default_rng(seed).integers(3, 9))
    experiment, fitted, _, _ = hidden_line(seed, "commutator_ripple", share=4.2e-3, bars=bars)
    found = line_by_move(experiment, fitted, RESISTANCE)
    assert found is not None
    assert found.at == pytest.approx(bars, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "size"),
    [
        ("supply_sag", 10.0),
        ("spring", 3.0),
        ("kp_by_error", 3.0),
        ("frozen_integral", 10.0),
        ("torque_bump", 10.0),
    ],
)
@pytest.mark.first(1)
def test_what_is_no_line_has_none_that_most_of_it_goes_with(cause: str, size: float) -> None:
    spec = hidden.draw_effects_case(7341, (cause,), size)
    experiment, fitted, _, _ = around(log_from_frame(hidden.make_log(spec, 7341)[0]))
    left = 0.5 * float(np.sum(fitted.residuals**2) - np.sum(experiment.weight > 0.0))
    for kind in (TORQUE, RESISTANCE):
        found = line_by_move(experiment, fitted, kind)
        assert found is None or found.gain < 0.5 * left


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.usefixtures("not_on_new_moves")
@pytest.mark.parametrize("seed", [7302])
def test_a_gear_ripple_of_the_hidden_plant_is_named_with_its_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    order, size = float(rng.uniform(0.12, 0.9)), float(rng.uniform(1e-5, 5e-5))
    effect = hidden.effect("shaft_ripple", amplitude=size, order=order, phase=float(rng.uniform(0.0, 6.0)))
    spec = replace(hidden.draw_effects_case(seed, (), 0.0), effects=(effect,))
    frame, _ = hidden.make_log(spec, seed)
    found = improve([log_from_frame(frame)], load_rig())
    assert [f.cause for f in found.findings] == ["gear_ripple"]
    values = found.findings[0].parameters
    assert values["gear_order"].value == pytest.approx(order, abs=2e-3)
    amplitude = np.hypot(values["gear_ripple_sin"].value, values["gear_ripple_cos"].value)
    assert amplitude == pytest.approx(size, rel=0.05)
