"""Effects that are far too large for a score beside a refit are found with their sizes, on the independent truth."""

import hidden
import numpy as np
import pytest
from campaigns import RIG, log_of

from observer_fi.improve.moves.gross_starts import gross_fits
from observer_fi.improve.moves.rig_refit import base_parameters, causes_of
from observer_fi.improve.moves.screening import coverage_of
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.learn import openings, prepare

PROFILE = hidden.there_and_back((410.0, 200.0), (0.3, 0.3), (0.0, 0.0))


# A delay of 10 ms had stayed where a scan in steps of three had put it.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "effect", "parameter"),
    [
        ("input_delay", {"delay": 0.011}, "input_delay"),
        ("current_lag", {"lag": 0.0021}, "current_lag"),
        ("acceleration_limit", {"limit": 1.5e4}, "accel_limit"),
    ],
)
@pytest.mark.first(1)
def test_a_gross_time_or_limit_is_found_with_its_size(
    cause: str, effect: dict[str, float], parameter: str
) -> None:
    log = log_of(PROFILE, effects=(hidden.effect(cause, **effect),))
    problem = simulated_moves([log], RIG)
    best = min(problem.trials(problem.baseline(), []), key=lambda trial: trial.fitted.objective)
    assert best.causes == (cause,)
    fitted = problem.settled(problem.baseline(), best)
    (size,) = effect.values()
    assert fitted.model[parameter] == pytest.approx(size, rel=0.04)
    assert fitted.objective < 2.0 * problem.experiment.t.size
    assert all(abs(fitted.model[n] / RIG.model[n] - 1.0) < 0.002 for n in ("Rm", "Km", "D"))


@pytest.mark.slow
def test_a_loop_that_rings_for_good_is_named_by_what_makes_it_ring() -> None:
    """A lag of 5 ms: only the first move begins at rest, and simulations are out of step after some turns; it was friction."""
    problem = simulated_moves([log_of(PROFILE, effects=(hidden.effect("current_lag", lag=0.005),))], RIG)
    best, *others = sorted(problem.trials(problem.baseline(), []), key=lambda trial: trial.fitted.objective)
    assert problem.experiment.moves == 1
    assert best.causes == ("current_lag",)
    assert best.fitted.objective < 0.01 * min(t.fitted.objective for t in others if t.causes != best.causes)


def test_openings_are_the_rests_and_the_first_seconds_of_moves() -> None:
    experiment = prepare([log_of(PROFILE)], RIG)
    part = openings(experiment, 0.05)
    assert part.moves == experiment.moves
    for m in range(part.moves):
        t, whole = part.t[part.rows(m)], experiment.t[experiment.rows(m)]
        assert np.array_equal(t, whole[: t.size])
        assert t[-1] == pytest.approx(whole[experiment.moving[m]] + 0.05, abs=1e-3)
    assert openings(experiment, 9.0).t.size == experiment.t.size


@pytest.mark.slow
def test_of_a_healthy_rig_few_starts_are_better_than_none() -> None:
    experiment = prepare([log_of(PROFILE)], RIG)
    cover = coverage_of(experiment, RIG.model, np.zeros((experiment.moves, 2)))
    free = base_parameters(RIG, RIG.model)
    found = gross_fits(experiment, RIG.model, free, causes_of(RIG.model), cover)
    assert all(fitted.objective > 0.45 * 3 * experiment.t.size for _, fitted in found)
