"""Empirical curves: their values, their place in the equations, their table in a rig file, and their recovery."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaigns import campaign

from observer_fi.errors import UsageError
from observer_fi.improve.improvement import improve, to_json
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.physics import equations as a
from observer_fi.physics.empirical_curve import Curve, curve_of, from_table, parameters, to_table
from observer_fi.physics.faults import faulty
from observer_fi.physics.rigs import load_rig, override, rig_toml, with_curve

RIG = load_rig()
BUMP = Curve("torque", "position", False, -1e-3, 5e-4, (0.0, 1e-5, 6e-5, -2e-5, 0.0))


def vector(curve: Curve) -> np.ndarray:
    return override(RIG.model, "nominal", **parameters(curve)).vector


@pytest.mark.parametrize("r", [-5.0, -1e-3, -2.6e-4, 0.0, 9.9e-4, 1e-3, 2.0])
def test_a_curve_is_linear_between_its_points_and_constant_beyond(r):
    at = BUMP.first + BUMP.step * np.arange(5)
    assert a.curve_value(r, vector(BUMP)) == pytest.approx(np.interp(r, at, BUMP.values), abs=1e-12)


@pytest.mark.parametrize("turns", [-3.0, 0.0, 7.0])
def test_a_curve_over_an_angle_closes(turns):
    angles = np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
    p = vector(Curve("torque", "shaft_angle", False, 0.0, 2.0 * math.pi / 12, tuple(np.sin(angles))))
    for phi in np.linspace(0.0, 2.0 * math.pi, 37):
        there = a.curve_value(phi + 2.0 * math.pi * turns, p)
        assert there == pytest.approx(math.sin(phi), abs=0.04)  # (pi / 12)^2 / 2 of a sine between its points


@pytest.mark.parametrize(
    ("curve", "state"),
    [
        (BUMP, (300.0, 1e-4, 0.0, 2.0)),
        (replace(BUMP, directed=True), (-300.0, 1e-4, 0.0, 2.0)),
        (Curve("torque", "speed", False, 0.0, 400.0, (0.0, 4e-5)), (100.0, 0.0, 0.0, 0.0)),
        (Curve("torque", "pitch", True, -10.0, 20.0, (0.0, 4e-5)), (100.0, 0.0, 0.0, 5.0)),
        (Curve("torque", "shaft_angle", False, 0.0, math.pi, (0.0, 4e-5)), (100.0, 0.0, 1.0, 5.0)),
        (Curve("torque", "screw_angle", False, 0.0, math.pi, (0.0, 4e-5)), (100.0, 3e-4, 0.0, 5.0)),
    ],
)
def test_a_curve_adds_its_value_to_the_torque(curve, state):
    w, x, phi, theta = state
    s = math.copysign(1.0, w)
    added = a.applied_torque(s, w, x, 0.0, phi, theta, vector(curve)) - a.applied_torque(
        s, w, x, 0.0, phi, theta, RIG.model.vector
    )
    at = {
        "position": x,
        "speed": w,
        "pitch": theta,
        "shaft_angle": phi,
        "screw_angle": 2.0 * math.pi * x / 1e-3,
    }
    value = a.curve_value(at[curve.regressor], vector(curve))
    assert value > 0.0
    assert added == pytest.approx(s * value if curve.directed else value)


def test_without_the_mass_a_curve_over_its_position_is_gone():
    p = faulty(override(RIG.model, "nominal", **parameters(BUMP)), "coupling_loss").vector
    assert a.load_torque(100.0, 1e-4, 0.0, 0.0, 0.0, p) == 0.0


def test_sensors_show_their_curve():
    shown = Curve("sensor:position", "position", False, 0.0, 1e-3, (0.0, 1e-5))
    assert a.sensed_position(5e-4, vector(shown)) == pytest.approx(5e-4 + 5e-6)
    shown = Curve("sensor:current", "current", False, -1.0, 1.0, (-0.02, 0.0, 0.02))
    assert a.current_reading(0.5, vector(shown)) == pytest.approx(0.51)


def test_a_resistance_drops_its_voltage_and_limits_the_current():
    p = vector(Curve("electrical", "current", False, -1.0, 1.0, (2.0, 1.0, 2.0)))
    assert a.terminal_voltage(0.1, 300.0, 0.0, p) - a.terminal_voltage(
        0.1, 300.0, 0.0, RIG.model.vector
    ) == pytest.approx(1.1 * 0.1)
    i = a.limited_current(5.0, 0.0, 0.0, 0.0, p)
    assert i == pytest.approx(15.1 / (20.2 + 0.8 + 1.0 + i), rel=2e-3)
    assert a.limited_current(0.1, 300.0, 0.0, 0.0, p) == 0.1


@pytest.mark.parametrize("curve", [BUMP, replace(BUMP, directed=True, std=(1e-6,) * 5)])
def test_a_rig_file_keeps_it(curve, tmp_path: Path):
    path = tmp_path / "rig.toml"
    rig = with_curve(RIG, curve)
    path.write_text(rig_toml(rig))
    assert load_rig(path) == rig
    assert load_rig(path).curve == curve
    assert from_table(to_table(curve)) == curve
    assert curve_of({}) is None and RIG.curve is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"regressor": "time"}, "regressor of torque must be one of speed"),
        ({"equation": "servo"}, "equation must be one of torque"),
        ({"values": [1.0]}, "2 to 32 values"),
        ({"values": [1.0, "x"]}, "are numbers"),
        ({"values": [1.0, math.nan]}, "finite"),
        ({"step": 0.0}, "step must be above 0"),
        ({"std": [1.0]}, "as many std as values"),
        ({"unit": "m"}, "unit must be 'N m'"),
        ({"colour": 1}, "no key 'colour'"),
    ],
)
def test_a_wrong_table_says_what_is_wrong(change, says, tmp_path: Path):
    with pytest.raises(UsageError, match=says):
        from_table(to_table(BUMP) | change)
    with pytest.raises(UsageError, match="keys missing in curve: values"):
        from_table({k: v for k, v in to_table(BUMP).items() if k != "values"})


def test_a_curve_among_the_parameters_is_refused(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(RIG) + "\n[parameters.curve_00]\nvalue = 1.0\n")
    with pytest.raises(UsageError, match="table"):
        load_rig(path)


def test_a_rig_driven_by_force_takes_none(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(with_curve(replace(RIG, drive="force"), BUMP)))
    with pytest.raises(UsageError, match="drive 'force'"):
        load_rig(path)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.usefixtures("not_on_new_moves")
def test_what_no_cause_explains_is_kept_and_reaches_the_noise():
    """Bumps of the torque along the rails: the vocabulary has one of friction."""
    values = (0.0, 4e-5, 0.0, -4e-5, 0.0, 4e-5, 0.0, -4e-5, 0.0)
    hidden = Curve("torque", "position", False, -6e-4, 1.5e-4, values)
    speeds = (410.0, 200.0, 90.0)
    record = improve([campaign(with_curve(RIG, hidden), seed=5, speeds=speeds)], RIG, keep_unexplained=True)
    assert record.kept is not None
    assert (record.kept.curve.equation, record.kept.curve.regressor) == ("torque", "position")
    floor = simulated_moves([campaign(RIG, seed=5, speeds=speeds)], RIG)
    floor = floor.measure(floor.baseline()).nll_per_sample
    gain, possible = (record.baseline.nll_per_sample - end for end in (record.extended.nll_per_sample, floor))
    assert gain > 0.9 * possible > 0.1
    assert record.extended_rig.curve == record.kept.curve
    assert to_json(record)["kept"]["heldout_nll_drop_per_sample"] > 0.1
