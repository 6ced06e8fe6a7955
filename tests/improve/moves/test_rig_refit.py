"""What a refit may move: the stops stay on their own sides, and the age of held readings is open."""

import math

import pytest

from observer_fi.improve.moves.rig_refit import base_parameters
from observer_fi.physics import load_rig, override, with_values

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


def test_a_constant_that_is_given_as_none_at_all_is_not_refitted() -> None:
    """A screw that lies has no gravity; its prior had no width, and a division by it ended the command."""
    names = {f.name for f in base_parameters(with_values(RIG, {"B": 0.0}), RIG.model)}
    assert "B" not in names and {"A", "J"} < names


def test_without_a_servo_its_constants_are_not_free_and_makers_values_are_as_wide_as_identify_takes_them() -> (
    None
):
    every = {f.name: f for f in base_parameters(RIG, RIG.model)}
    own = {f.name: f for f in base_parameters(RIG, RIG.model, 1e-3, ("servo", "sensor:current"))}
    assert not {"Kp", "Ki", "Vmax", "Rs", "servo_delay", "tick_share"} & own.keys()
    assert own["Km"].prior_std > 3.0 * every["Km"].prior_std
    winding = {f.name for f in base_parameters(RIG, RIG.model, 1e-3, ("servo", "electrical"))}
    assert not {"Rm", "Km"} & winding  # a scale of the current and of every torque
