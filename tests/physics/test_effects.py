"""The table of causes: complete, consistent, and neutral where it says so."""

import math

import numpy as np
import pytest

from observer_fi.learn.move_data import prepare, simulate
from observer_fi.physics.effects import CAUSES, FORCE, MOVES, Coverage, bounds
from observer_fi.physics.equations import PARAMETERS
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

CONTRACT = {
    "torque": "viscous_friction stribeck_friction asymmetric_friction load_dependent_friction "
    "position_dependent_friction friction_warmup shaft_ripple gear_ripple screw_ripple gravity_nonlinearity torque_offset",
    "electrical": "winding_heating brush_drop supply_sag",
    "servo": "current_lag input_delay dead_zone integrator_clamp acceleration_limit",
    "kinematics": "backlash partial_slip",
    "contact": "contact_exponent contact_damping",
    "sensor:position": "position_lag position_delay position_gain position_periodic_error",
    "sensor:current": "current_offset current_gain",
    "sensor:voltage": "voltage_delay voltage_offset",
    "sensor:pitch": "pitch_offset",
}
COVERED = Coverage(
    -5e-5, 2e-4, speed=300.0, pitch=5.0, torque=4.6e-4, current=0.022, resistance=20.2, heat=1.0, length_s=1.0,
    step_s=1.0 / 1600.0, voltage_noise=1e-2, current_noise=3e-4, position_noise=1e-5, turn=1.2e-5, lead=1e-3,
    integral=1.0, acceleration=5e4, orders=(0.27,),
)  # fmt: skip
VARIANTS = [(c, v) for c in CAUSES.values() for v in c.variants(COVERED, MOVES)]


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
        assert cause.forms(COVERED) or cause.aliases


@pytest.mark.parametrize(
    ("cause", "variant"),
    [(c, v) for c in CAUSES.values() for v in c.forms(COVERED)],
    ids=lambda x: getattr(x, "name", ""),
)
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
    plain = simulate(experiment, rig.model, still)
    assert np.abs(simulate(experiment, override(rig.model, "moved", **values), still) - plain).max() > 1e-9


def test_starts_follow_the_rig_and_what_its_log_covers():
    """Ten times the travel, speed and friction: every start that has a length, a speed or a torque grows with it."""
    bigger = COVERED._replace(
        low=10 * COVERED.low, high=10 * COVERED.high, speed=10 * COVERED.speed, torque=10 * COVERED.torque
    )
    grown = {"N m": 10.0, "rad/s": 10.0, "m": 10.0, "N m/m": 1.0, "N m/m^2": 0.1, "N m s/rad": 1.0}
    checked = set()
    for cause in ("viscous_friction", "stribeck_friction", "position_dependent_friction", "shaft_ripple"):
        pairs = zip(CAUSES[cause].forms(COVERED), CAUSES[cause].forms(bigger), strict=True)
        for one, two in ((a, b) for v, w in pairs for a, b in zip(v.terms, w.terms, strict=True)):
            assert two.start == pytest.approx(grown[one.unit] * one.start), one.parameter
            checked.add(one.unit)
    assert checked == grown.keys()


def test_rough_spots_are_looked_for_where_the_log_has_been_and_nowhere_else():
    forms = CAUSES["position_dependent_friction"].variants(COVERED, FORCE)
    places = [t.start for v in forms for t in v.terms if t.parameter == "bump_position"]
    assert min(places) == pytest.approx(COVERED.low) and max(places) == pytest.approx(COVERED.high)
    widths = {t.start for v in forms for t in v.terms if t.parameter == "bump_width"}
    assert np.diff(sorted(places)).max() <= max(widths) * 1.001  # no gap between them


def test_a_screw_that_turns_with_the_motor_or_is_unknown_has_no_ripple_of_its_own():
    screw = CAUSES["screw_ripple"]
    assert screw.forms(COVERED)[1].fixed == (("screw_lead", 5e-4),)
    assert screw.forms(COVERED._replace(turn=1e-3)) == ()
    assert screw.forms(COVERED._replace(lead=math.nan)) == ()


def test_bounds_of_a_given_effect():
    assert bounds("viscous_positive", 1e-7) == (0.0, math.inf)
    assert bounds("contact_exponent", 1.5) == (0.5, 4.0)
    assert bounds("bump_width", 2e-4) == pytest.approx(
        (2e-5, 2e-3)
    )  # scales with the rig: around its own value
    assert bounds("bump_position", 2e-4) == bounds("no_effect", 1.0) == (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("order", "cause"), [(5.003, "shaft_ripple"), (10.0, "shaft_ripple"), (4.76, "gear_ripple")]
)
def test_every_order_that_a_torque_shows_has_a_name(order: float, cause: str):
    """Whole orders beyond those that are always tried had none: neither a shaft's, nor a gear's."""
    variants = {
        name: {v.name for v in CAUSES[name].variants(COVERED._replace(orders=(order,)), MOVES)}
        - {v.name for v in CAUSES[name].variants(COVERED._replace(orders=()), MOVES)}
        for name in ("shaft_ripple", "gear_ripple")
    }
    assert {name for name, more in variants.items() if more} == {cause}


@pytest.mark.parametrize(
    ("travel", "periods"), [(9e-4, {1e-3}), (1.9e-3, {1e-3, 5e-4}), (5e-3, {1e-3, 5e-4, 2e-3})]
)
def test_a_period_of_a_scale_is_one_that_the_travel_has_twice(travel: float, periods: set[float]):
    """A sensor that is not linear was a periodic error of 2 mm, of which the log held half a period."""
    variants = CAUSES["position_periodic_error"].variants(COVERED._replace(low=0.0, high=travel), MOVES)
    assert {dict(v.fixed)["position_period"] for v in variants} == periods
