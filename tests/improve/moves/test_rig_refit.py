"""What a refit may move: the stops stay on their own sides, and the age of held readings is open."""

import importlib
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from observer_fi.improve.moves.rig_refit import base_parameters, with_stops
from observer_fi.learn import Free
from observer_fi.physics import Model, load_rig, override, with_values

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


ENDED = override(RIG.model, RIG.model.name, x_stop_low=-1e-3)
LEFT = {False: 50.0, True: 20.0}  # standard deviations that every reading is off, with and without the stop


@pytest.mark.parametrize(
    ("behind_a_loop", "scale", "believed"),
    [(False, 1.0, True), (True, 1.0, False), (True, 0.05, True)],
    ids=["a servo of its own", "a gross misfit behind a loop", "a small one there"],
)
def test_stops_that_leave_a_gross_misfit_behind_a_loop_are_put_off(
    monkeypatch: pytest.MonkeyPatch, behind_a_loop: bool, scale: float, believed: bool
) -> None:
    module = importlib.import_module("observer_fi.improve.moves.rig_refit")
    fitted: list[tuple[str, ...]] = []

    def refit(experiment: Any, model: Model, free: Sequence[Free]) -> Any:
        fitted.append(tuple(f.name for f in free))
        r = np.full((400, 3), scale * LEFT[math.isfinite(model["x_stop_low"])])
        return SimpleNamespace(residuals=r, objective=0.5 * float(np.sum(r**2)))

    monkeypatch.setattr(module, "find_stops", lambda experiment, rig: ENDED)
    monkeypatch.setattr(module, "stops_of_travel", lambda experiment, logs, model: {})
    monkeypatch.setattr(module, "_with_a_spring", refit)
    driven = np.zeros((400, 2)) if behind_a_loop else np.empty(0)
    experiment: Any = SimpleNamespace(weight=np.ones((400, 3)), driven=driven, older_s=1e-3, silent=())
    assert with_stops(experiment, [], RIG) == (ENDED if believed else RIG.model)
    drag = override(RIG.model, RIG.model.name, viscous_positive=1e-6)
    beside: Any = SimpleNamespace(
        model=drag, free=(*base_parameters(RIG, drag), Free("viscous_positive", 1e-9))
    )
    assert with_stops(experiment, [], RIG, beside=beside) == ENDED
    assert "viscous_positive" in fitted[-1] and "viscous_positive" not in fitted[0]
