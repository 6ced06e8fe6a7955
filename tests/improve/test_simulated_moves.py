"""What a refit may move: the stops stay on their own sides."""

import math

import pytest

from observer_fi.improve.simulated_moves import base_parameters
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
