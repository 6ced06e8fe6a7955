"""What a refit says of makers, and moves that go on from those before them."""

from dataclasses import replace
from types import SimpleNamespace

import hidden
import numpy as np
import pytest
from campaigns import log_of

from observer_fi.improve.moves.misfit import bent, held_out_residuals
from observer_fi.improve.moves.rig_refit import base_parameters
from observer_fi.learn import Free, fit, prepare
from observer_fi.physics import load_rig, override

RIG = load_rig()


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
            said[off, voltage] = bent(prepare([read], RIG), SimpleNamespace(free=free, model=model))
    assert said[4.0, True] == said[4.0, False] == ()
    assert said[6.0, True] == (equation,)
    assert said[6.0, False] == (() if equation == "electrical" else (equation,))


def test_held_out_moves_within_a_play_go_on_from_where_the_mass_was_left() -> None:
    """Slow moves shorter than the play: what they show depends on every move since the mass last moved."""
    profile = hidden.there_and_back((410.0, 90.0, 90.0), (0.5, 0.5, 0.9), (0.0, 0.0, 0.0))
    experiment = prepare([log_of(profile, effects=(hidden.effect("backlash", width=2e-4),))], RIG)
    model = override(RIG.model, "play", backlash=2e-4)
    fitted = fit(experiment, model, (*base_parameters(RIG, RIG.model), Free("backlash", 2e-6, 0.0, 1e-3)))
    off = held_out_residuals(experiment, fitted)[experiment.rows(4), 2]
    assert np.sqrt(np.mean(off**2)) < 2.0
