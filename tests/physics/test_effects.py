"""The table of causes: complete, consistent, and neutral where it says so."""

import math

import numpy as np
import pytest

from observer_fi.learn.move_data import prepare, simulate
from observer_fi.physics.effects import CAUSES
from observer_fi.physics.equations import PARAMETERS
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

CONTRACT = {
    "torque": "viscous_friction stribeck_friction asymmetric_friction load_dependent_friction "
    "position_dependent_friction shaft_ripple screw_ripple gravity_nonlinearity torque_offset",
    "electrical": "winding_heating brush_drop supply_sag",
    "servo": "current_lag input_delay integrator_clamp acceleration_limit",
    "kinematics": "backlash partial_slip",
    "contact": "contact_exponent contact_damping",
    "sensor:position": "position_lag position_delay position_gain position_periodic_error",
    "sensor:current": "current_offset current_gain",
    "sensor:voltage": "voltage_delay voltage_offset",
    "sensor:pitch": "pitch_offset",
}
VARIANTS = [(c, v) for c in CAUSES.values() for v in c.variants]


def short_log(seed: int = 1) -> Log:
    """Two moves of 0.3 s, there and back, with noise and nothing in it that a test relies on."""
    t = np.arange(1600) / 1600.0
    knots = [0.0, 0.1, 0.105, 0.4, 0.405, 0.6, 0.605, 0.9, 0.905, 1.0]
    w_cmd = np.interp(t, knots, [0.0, 0.0, 300.0, 300.0, 0.0, 0.0, -300.0, -300.0, 0.0, 0.0])
    z = np.random.default_rng(seed).normal(size=(t.size, 3)) * [1e-2, 3e-4, 1e-5]
    return Log("short", t, z, w_cmd, np.full(t.size, 5.0))


def test_every_cause_of_the_contract_has_its_equation():
    assert {n: c.equation for n, c in CAUSES.items()} == {
        name: equation for equation, names in CONTRACT.items() for name in names.split()
    }


def test_aliases_and_rivals_exist_and_each_cause_can_be_separated():
    for cause in CAUSES.values():
        assert set(cause.aliases) | set(cause.confused_with) <= CAUSES.keys()
        assert cause.separate_by
        assert cause.variants or cause.aliases


@pytest.mark.parametrize(("cause", "variant"), VARIANTS, ids=lambda x: getattr(x, "name", ""))
def test_terms_are_parameters_with_starts_inside_their_bounds(cause, variant):
    for term in variant.terms:
        assert term.parameter in PARAMETERS
        assert term.low <= term.start <= term.high or not math.isfinite(term.neutral)
    assert set(dict(variant.fixed)) <= PARAMETERS.keys()
    assert variant.sizes


@pytest.mark.parametrize(("cause", "variant"), VARIANTS, ids=lambda x: getattr(x, "name", ""))
def test_shapes_change_nothing_while_the_size_is_neutral(cause, variant):
    rig = load_rig()
    experiment = prepare([short_log()], rig)
    shapes = {t.parameter: t.start for t in variant.terms if t.shape} | dict(variant.fixed)
    still = np.zeros((experiment.moves, 2))
    plain = simulate(experiment, rig.model, still)
    shaped = simulate(experiment, override(rig.model, "shaped", **shapes, servo_delay=0.0), still)
    assert np.abs(shaped - plain).max() < 1e-12


@pytest.mark.parametrize(
    ("cause", "variant"),
    [v for v in VARIANTS if v[0].equation != "contact"],
    ids=lambda x: getattr(x, "name", ""),
)
def test_a_size_away_from_neutral_moves_the_readings(cause, variant):
    rig = load_rig()
    experiment = prepare([short_log()], rig)
    still = np.zeros((experiment.moves, 2))
    values = {t.parameter: t.start for t in variant.terms} | dict(variant.fixed)
    limits = {"integrator_limit": 1.0, "accel_limit": 5e4}
    values |= {n: v for n, v in limits.items() if n in values}
    if "bump_position" in values:
        values["bump_position"] = 1e-4
    plain = simulate(experiment, rig.model, still)
    assert np.abs(simulate(experiment, override(rig.model, "moved", **values), still) - plain).max() > 1e-9
