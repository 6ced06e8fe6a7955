"""Rigs from data sheets: units as printed, contradictions, guesses that are marked, and what a rig file leaves out."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from observer_fi.errors import UsageError
from observer_fi.physics import (
    KINDS,
    DataSheet,
    Fault,
    Scenario,
    load_rig,
    rederived,
    rig_of_sheet,
    rig_toml,
    synthesise,
    value_of,
    with_values,
)

SHEET = DataSheet(
    name="mine", drive="voltage", lead=4e-3, resistance=2.3, speed_constant=184.0 * math.pi / 30.0,
    rotor_inertia=5.2e-5, mass=6.0, travel=0.5, supply=24.0,
)  # fmt: skip
BARE = """
drive = "voltage"
[parameters]
D = 6.4e-4
J = 6e-5
A = 0.03
Rm = 2.3
Km = 0.052
"""


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("2.3 ohm", "resistance", 2.3), ("2,3 Ω", "resistance", 2.3), ("850 mΩ", "resistance", 0.85),
        ("17.5 mNm/A", "torque_constant", 0.0175), ("0.05 N m/A", "torque_constant", 0.05),
        ("184 rpm/V", "speed_constant", 19.26843), ("184 min⁻¹/V", "speed_constant", 19.26843),
        ("19.3 rad/(s V)", "speed_constant", 19.3), ("5.4 V/krpm", "back_emf", 0.0515662),
        ("5.4 V/1000 rpm", "back_emf", 0.0515662), ("520 g cm²", "inertia", 5.2e-5), ("520 gcm2", "inertia", 5.2e-5),
        ("5.2e-5 kg m^2", "inertia", 5.2e-5), ("14:1", "gear", 14.0), ("14", "gear", 14.0),
        ("1:14", "gear", 14.0), ("i = 14", "gear", 14.0), ("1 : 2.5", "gear", 2.5), ("0.5:1", "gear", 0.5),
        ("80 %", "efficiency", 0.8),
        ("4 mm", "lead", 4e-3), ("0.2 in", "lead", 5.08e-3), ("500 mm", "travel", 0.5), ("4400 U/min", "speed", 460.7669),
        ("12 lbf", "force", 53.37866), ("24 V", "voltage", 24.0), ("18 V DC", "voltage", 18.0),
        ("≈ 4,2 Ohm", "resistance", 4.2), ("4.2Ω ±10 %", "resistance", 4.2), ("4.2 (+/- 0.2) ohm", "resistance", 4.2),
        ("typ. 4.2 Ω @ 25 °C", "resistance", 4.2), ("max. 4.2 Ω", "resistance", 4.2), ("500 mA max", "current", 0.5),
        ("2.6×10⁻⁷ kg m²", "inertia", 2.6e-7), ("2.6 x 10^-7 kg m2", "inertia", 2.6e-7), ("9 000 min-1", "speed", 942.4778),
        ("2.48 oz-in/A", "torque_constant", 0.01751265), ("0.155 lb-in/A", "torque_constant", 0.01751265),
        ("178 gcm/A", "torque_constant", 0.017455837), ("17.5 mNm A-1", "torque_constant", 0.0175),
        ("1.42e-3 oz-in²", "inertia", 2.597177e-8), ("2.3e-6 lb-in-s²", "inertia", 2.598651e-7),
        ("184 RPM/Volt", "speed_constant", 19.26843), ("1'000 g", "mass", 1.0),
    ],
)  # fmt: skip
def test_values_as_data_sheets_print_them(text: str, kind: str, value: float) -> None:
    assert value_of(text, kind, "--it")[0] == pytest.approx(value, rel=1e-6)


def test_a_limit_is_told_to_be_taken_for_the_value_and_a_range_is_refused() -> None:
    assert "is a limit" in value_of("max. 4.2 Ω", "resistance", "--it")[1]
    assert not value_of("184 min-1/V", "speed_constant", "--it")[1]
    with pytest.raises(UsageError, match="no unit"):
        value_of("3.8-4.6 Ω", "resistance", "--it")


@pytest.mark.parametrize("kind", KINDS)
def test_every_example_is_understood(kind: str) -> None:
    value, note = value_of(KINDS[kind].example, kind, "--it")
    assert KINDS[kind].least <= value <= KINDS[kind].most and not note


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("2.3 henry", "resistance", "no unit 'henry'"), ("184", "speed_constant", "has no unit"),
        ("abc", "mass", "does not begin with a number"), ("1,234 rpm/V", "speed_constant", "a thousand or a fraction"),
        ("-3 kg", "mass", "no mass of an actuator"), ("1e999 kg", "mass", "no mass"), ("80", "efficiency", "no efficiency"),
        ("4", "lead", "no lead"), ("", "mass", "does not begin"), ("nan kg", "mass", "does not begin"),
    ],
)  # fmt: skip
def test_what_is_no_value_is_refused_in_one_line(text: str, kind: str, says: str) -> None:
    with pytest.raises(UsageError, match=says) as error:
        value_of(text, kind, "--it")
    assert "\n" not in str(error.value) and "--it" in str(error.value)


def test_a_length_without_a_unit_is_taken_in_metres_and_told() -> None:
    assert value_of("0.004", "lead", "--lead") == (0.004, "--lead 0.004 has no unit and is taken as 0.004 m")


def test_printed_derived_and_guessed_values_are_told_apart(tmp_path: Path) -> None:
    made = rig_of_sheet(SHEET)
    q = made.rig.quantities
    assert not made.warnings
    assert (q["Rm"].method, q["J"].method, q["A"].method) == ("data sheet", "derived", "guess")
    assert q["Km"].value == pytest.approx(0.0518983, rel=1e-5) and q["Km"].spread == 0.05
    assert q["D"].value == pytest.approx(4e-3 / (2.0 * math.pi))
    assert q["J"].value == pytest.approx(1.15 * 5.2e-5 + 6.0 * q["D"].value ** 2)
    assert q["A"].spread >= 1.0 and all(q[n].spread > 0.0 and q[n].source for n in q)
    assert all(q[name].value > 0.0 for name in ("B", "C", "E", "A_decoupled", "J_decoupled"))
    path = tmp_path / "mine.toml"
    path.write_text(rig_toml(made.rig), encoding="utf-8")
    assert load_rig(path) == made.rig


@pytest.mark.parametrize("drive", ["pi_servo", "position_servo", "voltage", "current", "force"])
def test_every_drive_gets_a_file_that_loads(drive: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(rig_toml(rig_of_sheet(replace(SHEET, drive=drive)).rig), encoding="utf-8")
    assert load_rig(path).drive == drive


def test_a_current_drive_needs_no_winding() -> None:
    bare = DataSheet(
        name="a", drive="current", lead=1e-3, torque_constant=0.0175, rotor_inertia=2.6e-7, gear=14.0
    )
    rig = rig_of_sheet(bare).rig
    assert rig.model["D"] == pytest.approx(1e-3 / (2.0 * math.pi * 14.0)) and rig.model["Rm"] == 0.0
    assert rig.model["A"] > 0.0


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"torque_constant": 0.09}, "they are one number"), ({"resistance": None}, "needs --resistance"),
        ({"speed_constant": None}, "needs --torque-constant"), ({"lead": None}, "needs --lead"),
        ({"rotor_inertia": 0.52}, "mechanical time constant"), ({"nominal_current": 20.0}, "not below that at stall"),
        ({"stall_current": 0.0104}, "stall current"), ({"drive": "volts"}, "no drive"),
        ({"orientation": "vertical", "mass": 6000.0}, "cannot lift"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(changes: dict, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        rig_of_sheet(replace(SHEET, **changes))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"torque_constant": 0.0545}, "5% apart"), ({"stall_current": 8.0}, "of another voltage"),
        ({"rotor_inertia": 2.6e-7}, "unusual"), ({"lead": 0.4}, "would drive the mass"),
    ],
)  # fmt: skip
def test_what_is_odd_is_told_and_kept(changes: dict, says: str) -> None:
    made = rig_of_sheet(replace(SHEET, **changes))
    assert any(says in warning for warning in made.warnings)
    assert says in made.rig.description


def test_weight_is_a_torque_of_a_vertical_screw() -> None:
    rig = rig_of_sheet(replace(SHEET, orientation="vertical")).rig
    assert rig.model["torque_offset"] == pytest.approx(6.0 * 9.80665 * rig.model["D"])
    assert rig_of_sheet(SHEET).rig.model["torque_offset"] == 0.0


def test_what_a_rig_file_leaves_out_is_derived_and_wide(tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text(BARE, encoding="utf-8")
    rig = load_rig(path)
    for name in ("B", "C", "E", "A_decoupled", "J_decoupled"):
        assert rig.model[name] > 0.0 and rig.spread(name) >= 0.3
    again = tmp_path / "again.toml"
    again.write_text(rig_toml(rig), encoding="utf-8")
    assert load_rig(again).quantities == rig.quantities


def test_guesses_follow_what_was_learned_and_learned_values_stay(tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text(BARE + "A_decoupled = 0.011\n", encoding="utf-8")
    learned = rederived(with_values(load_rig(path), {"A": 0.06}))
    assert learned.model["C"] == pytest.approx(2.0 * load_rig(path).model["C"])
    assert learned.model["A_decoupled"] == 0.011


def test_an_overload_of_a_bare_rig_is_one(tmp_path: Path) -> None:
    """A stiffness that was missing made a log without a fault of it."""
    path = tmp_path / "bare.toml"
    servo = "Vmax = 24.0\nKp = 0.05\nKi = 2.0\nRs = 0.1\naccel_cmd = 5000.0\n"
    path.write_text(BARE.replace('"voltage"', '"pi_servo"') + servo, encoding="utf-8")
    rig = load_rig(path)
    logs = [synthesise(Scenario(fault=Fault(kind, 1.0)), rig, "log")[0] for kind in ("none", "overload")]
    late = logs[0].t > 2.0
    assert abs(logs[1].z[late, 1]).mean() > 1.5 * abs(logs[0].z[late, 1]).mean()
