"""Output-error fits: recovery, masks, priors, and the shortcut that leaves moves out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import NOISE, RIG, campaign

from observer_fi.learn.gauss_newton import (
    FEWEST_MOVES,
    Free,
    Normal,
    Point,
    covariance_of,
    newton_step,
    project,
    scatter,
)
from observer_fi.learn.move_data import prepare, select, simulate
from observer_fi.learn.output_error import fit, without_moves
from observer_fi.logs.moves import moves_from_rest
from observer_fi.physics.command import corners
from observer_fi.physics.rigs import override, with_values
from observer_fi.physics.trapezoid import quarters


def parameters(*names: str, relative: float = 0.5) -> list[Free]:
    return [Free(n, 1e-3 * RIG.model[n], 0.0, np.inf, RIG.model[n], relative * RIG.model[n]) for n in names]


NAMES = ("Vmax", "Kp", "Ki", "J", "A", "B", "Rs")


def test_parameters_come_back_within_their_standard_errors():
    truth = {"J": 5e-7, "A": 4.2e-4, "B": 2.5e-5, "Kp": 1.05e-3, "Ki": 0.46, "Vmax": 15.3, "Rs": 0.6}
    result = fit(prepare([campaign(with_values(RIG, truth))], RIG), RIG.model, parameters(*NAMES))
    assert result.converged
    assert np.mean(result.residuals[result.residuals != 0.0] ** 2) == pytest.approx(1.0, abs=0.05)
    for name, value in truth.items():
        assert abs(result.values[name] - value) < 5.0 * result.std[name]
        assert result.std[name] < 0.05 * value


def test_missing_samples_are_left_out():
    log = campaign()
    z = log.z.copy()
    z[::7, 0], z[3::11, 2] = np.nan, np.nan
    z[2000:2100] = np.nan
    experiment = prepare([replace(log, z=z)], RIG)
    result = fit(experiment, RIG.model, parameters("J", "A"))
    assert np.isfinite(result.objective)
    assert (result.residuals[experiment.weight == 0.0] == 0.0).all()
    assert abs(result.values["J"] - RIG.model["J"]) < 5.0 * result.std["J"]


def test_a_fit_ends_where_it_will_not_come_to_its_goal():
    """And is then within what the steps that are left could gain; a goal that it reaches changes nothing."""
    experiment = prepare([campaign(with_values(RIG, {"J": 5e-7, "A": 4.2e-4}))], RIG)
    whole = fit(experiment, RIG.model, parameters(*NAMES), worth=1e-9)
    reached = fit(experiment, RIG.model, parameters(*NAMES), worth=1e-9, goal=1.01 * whole.objective)
    ended = fit(experiment, RIG.model, parameters(*NAMES), worth=1e-9, goal=0.9 * whole.objective)
    assert reached.values == whole.values and whole.converged and not ended.converged
    assert whole.objective < ended.objective < whole.objective + 0.1 * experiment.t.size


def test_a_parameter_that_the_log_cannot_see_keeps_its_prior():
    result = fit(prepare([campaign(pitches=(0.0,))], RIG), RIG.model, parameters("A", "B", relative=0.1))
    assert result.values["B"] == pytest.approx(RIG.model["B"], rel=1e-3)
    assert result.std["B"] == pytest.approx(0.1 * RIG.model["B"], rel=0.2)


def test_leaving_a_move_out_by_one_step_is_the_fit_without_it():
    experiment = prepare([campaign()], RIG)
    free = parameters(*NAMES)
    whole = fit(experiment, RIG.model, free)
    short = fit(select(experiment, [0, 1, 2, 4, 5, 6, 7]), RIG.model, free)
    guess = without_moves(whole, [3])
    for name in NAMES:
        assert abs(guess[name] - short.values[name]) < 0.2 * whole.std[name]


def test_simulated_log_has_the_readings_of_the_moves():
    experiment = prepare([campaign()], RIG)
    t, y = experiment.t, simulate(experiment, RIG.model, np.zeros((experiment.moves, 2)))
    assert y.shape == (t.size, 3)
    assert np.interp(0.6, t, y[:, 1]) == pytest.approx(RIG.model["A"] / RIG.model["Km"], rel=0.05)


def test_moves_are_cut_at_the_command():
    moves = moves_from_rest(campaign())
    assert [m.peak for m in moves] == [410.0, -410.0, 200.0, -200.0] * 2
    assert [m.pitch for m in moves] == [0.0] * 4 + [8.0] * 4


@pytest.mark.parametrize("delay", [0.0, 3.7e-4])
def test_quarters_hold_the_integral_of_the_command(delay):
    t = np.arange(400) / 1600.0
    w_cmd = np.interp(
        t, [0.0, 0.05, 0.05 + 410.0 / 6e4, 0.2, 0.2 + 410.0 / 6e4, 0.25], [0, 0, 410.0, 410.0, 0, 0]
    )
    knots, values = corners(t, w_cmd, 6e4)
    q = quarters(t, knots, values, delay)
    dt = 1.0 / 1600.0
    simpson = dt / 12.0 * (q[:-1, 0] + 4.0 * q[:-1, 1] + 2.0 * q[:-1, 2] + 4.0 * q[:-1, 3] + q[1:, 0])
    fine = np.linspace(0.0, t[-1], 400_001)
    exact = np.trapezoid(np.interp(fine - delay, knots, values), fine)
    assert simpson.sum() == pytest.approx(exact, rel=1e-7)


def test_an_acceleration_limit_makes_the_ramp_longer():
    t = np.arange(400) / 1600.0
    knots, values = np.array([0.0, 0.05, 0.0568333, 0.25]), np.array([0.0, 0.0, 410.0, 410.0])
    q = quarters(t, knots, values, accel=3e4)
    reached = t[np.argmax(q[:, 0] >= 409.9)]
    assert reached == pytest.approx(0.05 + 410.0 / 3e4, abs=1.0 / 1600.0)


def test_a_lag_behind_the_limit_is_told_from_one_before_it():
    plant = with_values(RIG, {"current_lag": 5e-4, "lag_behind_limit": 1.0})
    experiment = prepare([campaign(plant, seed=9)], RIG)
    lag = Free("current_lag", 1e-5, 6e-5, 0.05)
    fits = [
        fit(
            experiment,
            override(RIG.model, "lag", current_lag=3e-4, lag_behind_limit=place),
            [*parameters(*NAMES), lag],
        )
        for place in (0.0, 1.0)
    ]
    assert fits[1].objective < fits[0].objective - 100.0
    assert fits[1].model["current_lag"] == pytest.approx(5e-4, abs=4.0 * fits[1].std["current_lag"])


def test_more_steps_in_a_transient_change_little():
    experiment = prepare([campaign(seed=10)], RIG)
    still = np.zeros((experiment.moves, 2))
    y = [simulate(replace(experiment, steps=n), RIG.model, still) for n in (2, 8, 32)]
    assert np.abs((y[1] - y[2]) / NOISE).max() < 0.3 * np.abs((y[0] - y[2]) / NOISE).max()


def test_what_differs_from_move_to_move_widens_a_standard_error() -> None:
    free, moves = [Free("J", 0.1)], 20
    own = np.random.default_rng(2).normal(
        1.0, 0.3, moves
    )  # of each move, that counts as 400 samples of a unit step
    normal = Normal(
        np.full((moves, 1, 1), 400.0),
        400.0 * (own - own.mean())[:, None],
        np.zeros((moves, 2)),
        np.zeros((moves, 2, 1)),
    )
    expected = 0.1 * own.std(ddof=1) / np.sqrt(moves)
    assert scatter(free, {"J": 0.0}, normal)[0] == pytest.approx(expected, rel=1e-6)
    few = Normal(*(part[: FEWEST_MOVES - 1] for part in normal))
    assert scatter(free, {"J": 0.0}, few)[0] == 0.0


@pytest.mark.parametrize("far", [1e200, np.inf, np.nan])
def test_a_parameter_with_which_a_simulation_runs_away_stays_where_it_is(far: float) -> None:
    experiment = prepare([campaign()], RIG)
    free = parameters("J", "A")
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(2, experiment.t.size, 3))
    columns[1, 100, 0] = far
    problem: Any = type("Moves", (), {"bounds": experiment.bounds, "nuisance_std": experiment.nuisance_std})
    values = {f.name: f.prior for f in free}
    point = Point(values, np.zeros((experiment.moves, 2)), 3.0 * columns[0], 0.0)
    step = newton_step(free, values, project(problem, columns, rng.normal(size=columns.shape), point))
    assert step[1] == 0.0 and step[0] == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 1e-12], ids=["exactly", "but for rounding"])
def test_what_nothing_tells_is_wide(noise: float) -> None:
    """Of a fit that has lost the motion: nothing tells the inertia, and of two constants only their sum is told."""
    free = parameters("J", "A", "B", "Rm", relative=np.inf)
    H = np.diag([0.0, 1.0, 1.0, 4.0])
    H[1, 2] = H[2, 1] = 1.0
    H[0, 3] = H[3, 0] = noise
    covariance = covariance_of(free, Normal(H[None], np.zeros((1, 4)), np.zeros((1, 2)), np.zeros((1, 2, 4))))
    steps = np.sqrt(np.diag(covariance)) / [f.step for f in free]
    assert (steps[:3] > 1e5).all() and steps[3] == pytest.approx(0.5, rel=0.1)
    sum_of = np.array([0.0, 1.0, 1.0, 0.0]) / [f.step for f in free]
    assert float(sum_of @ covariance @ sum_of) == pytest.approx(1.0, rel=1e-3)
