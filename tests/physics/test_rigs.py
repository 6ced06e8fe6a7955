"""Models and rigs: faults as overrides, rig files there and back, and errors that list the right names."""

import pickle
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.errors import UsageError
from observer_fi.physics import equations as a
from observer_fi.physics.drives import DRIVES
from observer_fi.physics.faults import faulty
from observer_fi.physics.rigs import (
    Quantity,
    Rig,
    load_rig,
    override,
    packaged_rigs,
    rig_toml,
    with_values,
)
from observer_fi.records import Acquisition, ChannelTraits, Clock

RIG = load_rig()
PLANT = RIG.model


def test_the_default_rig_is_table_1() -> None:
    assert (RIG.name, RIG.drive, PLANT.name) == ("mass_shifter", "pi_servo", "nominal")
    table_1 = {
        "Rm": 20.2, "Km": 21.2e-3, "D": 1.9e-6, "Vmax": 15.1, "accel_cmd": 6e4, "Kp": 1.1e-3, "Ki": 0.45, "J": 4.7e-7,
        "A": 4.6e-4, "B": 2.3e-5, "Rs": 0.8, "C": 85.0, "E": 0.52, "A_decoupled": 3.4e-4, "J_decoupled": 4.6e-7,
    }  # fmt: skip
    assert {name: q.value for name, q in RIG.quantities.items()} == table_1
    assert all(q.unit == a.PARAMETERS[name][0] and q.method for name, q in RIG.quantities.items())
    assert {name: RIG.spread(name) for name in table_1 if RIG.spread(name)} == {
        "A": 0.1, "B": 0.1, "A_decoupled": 0.1, "C": 0.15, "E": 0.05,
    }  # fmt: skip
    np.testing.assert_array_equal(RIG.noise_std, [0.01, 3e-4, 1e-5])


def test_faults_are_one_override() -> None:
    differences = {
        model.name: {n: model[n] for n in a.NAMES if model[n] != PLANT[n]}
        for model in (faulty(PLANT, "overload"), faulty(PLANT, "coupling_loss"))
    }
    assert differences == {"overload": {"contact": 1.0}, "coupling_loss": {"coupling": 0.0}}


def test_override_leaves_the_original_and_refuses_what_does_not_exist() -> None:
    heavy = override(PLANT, "heavy", J=1.0)
    assert (heavy["J"], PLANT["J"], heavy.name) == (1.0, 4.7e-7, "heavy")
    with pytest.raises(
        UsageError, match="no parameter 'J_decopled', did you mean 'J_decoupled'.*known: Rm, Km, D"
    ):
        override(PLANT, "x", J_decopled=1.0)
    with pytest.raises(UsageError, match="no parameter 'viscous'"):
        PLANT["viscous"]


def test_a_model_tells_which_parameters_it_has() -> None:
    model = load_rig().model
    assert "Rm" in model and "brush_drop" in model
    assert "Rn" not in model and 0 not in model


def test_models_compare_and_pickle() -> None:
    assert override(PLANT, "nominal") == PLANT != faulty(PLANT, "overload")
    assert pickle.loads(pickle.dumps(PLANT)) == PLANT
    assert hash(override(PLANT, "nominal")) == hash(PLANT)


@pytest.mark.parametrize(("changes", "effects"), [
    ({}, ()),
    ({"contact": 1.0, "coupling": 0.0, "x_stop_high": 0.01}, ()),
    ({"screw_lead": 2e-3, "stribeck_speed": 10.0}, ()),
    ({"torque_offset": 1e-5, "slip": 0.01}, ("torque_offset", "slip")),
    ({"J": 1e-6, "A": 1e-3}, ()),
])  # fmt: skip
def test_a_plain_plant_pays_for_no_effect(changes: dict[str, float], effects: tuple[str, ...]) -> None:
    model = override(PLANT, "changed", **changes)
    assert model.effects == effects
    vector = model.vector
    assert (vector.shape, vector[a.EXTENDED]) == ((a.VECTOR_SIZE,), float(bool(effects)))
    assert vector[: a.EXTENDED].tolist() == list(model.values)


# --- rig files -----------------------------------------------------------------------------------


@pytest.mark.parametrize("path", sorted(packaged_rigs().glob("*.toml")), ids=lambda p: p.stem)
def test_packaged_rigs_load_by_name_and_survive_saving(path: Path, tmp_path: Path) -> None:
    rig = load_rig(path.stem)
    assert rig == load_rig(path)
    copy = tmp_path / path.name
    copy.write_text(rig_toml(rig), encoding="utf-8")
    assert load_rig(copy) == rig
    assert set(rig.driven.requires) <= set(rig.quantities)


@given(
    values=st.dictionaries(
        st.sampled_from(("J", "A", "viscous_positive", "torque_offset", "x_stop_high")),
        st.floats(1e-15, 1e3), min_size=1,
    ),
    std=st.floats(1e-12, 1.0),
)  # fmt: skip
def test_fitted_values_survive_saving_to_the_last_bit(
    values: dict[str, float], std: float, tmp_path_factory
) -> None:
    rig = with_values(RIG, values, dict.fromkeys(values, std))
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    read = load_rig(path)
    assert read == rig
    for name, value in values.items():
        assert (read.model[name], read.quantities[name].std, read.quantities[name].method) == (
            value,
            std,
            "fit",
        )
    assert read.spread("A") == RIG.spread("A")
    assert with_values(RIG, {}) == RIG


def test_a_new_value_gets_its_unit() -> None:
    rig = with_values(RIG, {"input_delay": 1e-3})
    assert rig.quantities["input_delay"] == Quantity(1e-3, "s", "fit")
    with pytest.raises(UsageError, match="no parameter 'delay'"):
        with_values(RIG, {"delay": 1.0})


TABLE = tomllib.loads(rig_toml(RIG))
SERVO = "\n".join(f"{name} = {TABLE['parameters'][name]['value']}" for name in DRIVES["pi_servo"].requires)


@pytest.mark.parametrize(("text", "message"), [
    ("drvie = 'pi_servo'", "no key 'drvie', did you mean 'drive'.*known: name, description, drive"),
    ("drive = 'piservo'", "no drive 'piservo', did you mean 'pi_servo'.*known: pi_servo, position_servo, voltage"),
    ("[noise]\nvolts = 1", "no noise channel 'volts'.*known: voltage, current, position"),
    (f"[parameters]\n{SERVO}\nVmaxx = 1.0", "no parameter 'Vmaxx', did you mean 'Vmax'"),
    ("[parameters]\nA = 1\nJ = 1", "parameters missing for drive 'pi_servo': D, Rm, Km, Vmax, Kp, Ki, Rs, accel_cmd"),
    ("drive = 'force'\n[parameters]\nJ = 1\nA = 1", "parameters missing for drive 'force': D$"),
    ("[parameters]\nA = { value = 1, unti = 'N m' }", "no key of A 'unti', did you mean 'unit'.*known: value, unit"),
    ("[parameters]\nA = { value = 1, unit = 'mN m' }", "A: unit must be 'N m', got 'mN m'"),
    ("[parameters]\nA = { unit = 'N m' }", "parameters.A.value is missing"),
    ("[parameters]\nA = 'large'", "parameters.A.value must be a number, got 'large'"),
    ("[parameters]\nA = true", "parameters.A.value must be a number, got True"),
    ("[parameters]\nA = nan", "parameters.A.value must be a number from 0 to .* N m, got nan"),
    ("A ==", "not a TOML file"),
])  # fmt: skip
def test_a_wrong_rig_file_is_one_line_that_says_what_to_write(
    text: str, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=message) as error:
        load_rig(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_missing_rig_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere.toml: cannot read the rig file"):
        load_rig(tmp_path / "nowhere.toml")
    with pytest.raises(UsageError, match=r"emsp: .*did you mean 'emps'\? \(packaged: emps, emps_extended"):
        load_rig("emsp")
    binary = tmp_path / "rig.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="not a TOML file"):
        load_rig(binary)


def test_plain_numbers_and_defaults_are_enough(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"[parameters]\n{SERVO}", encoding="utf-8")
    rig = load_rig(path)
    assert (rig.name, rig.drive, rig.noise) == ("mine", "pi_servo", Rig("", "", "", {}).noise)
    assert rig.model["J"] == 4.7e-7 and 0.0 < rig.model["E"] < 1.0  # a zero would be no stop at all


# --- what a log has shown of the logger ----------------------------------------------------------


def logged(**fields: object) -> Rig:
    """The rig with a logger whose channels have these traits, noise as in the file."""
    channels = [ChannelTraits(std, std)._replace(**fields) for std in RIG.file_noise_std.tolist()]
    return replace(RIG, logger=Acquisition(*channels, Clock(0.0, None, 1.0 / 1600.0)))


def test_filters_take_the_noise_of_the_file_where_the_logger_does_not_need_more() -> None:
    usual = RIG.file_noise_std
    np.testing.assert_array_equal(RIG.noise_std, usual)
    for factor, taken in ((0.3, 1.0), (1.1, 1.0), (3.0, 3.0)):
        channels = [ChannelTraits(factor * std, factor * std) for std in usual.tolist()]
        rig = replace(RIG, logger=Acquisition(*channels, Clock(0.0, None, 1.0 / 1600.0)))
        np.testing.assert_allclose(rig.noise_std, taken * usual)
        np.testing.assert_array_equal(rig.file_noise_std, usual)


def test_a_channel_that_is_not_there_has_the_noise_of_the_file() -> None:
    rig = logged(as_white=np.nan, neighbour_std=np.nan)
    np.testing.assert_array_equal(rig.noise_std, RIG.noise_std)
    np.testing.assert_array_equal(rig.neighbour_std, RIG.noise_std)


def test_neighbours_differ_by_no_more_than_the_file_says_and_by_something() -> None:
    usual = RIG.file_noise_std
    np.testing.assert_array_equal(RIG.neighbour_std, usual)
    np.testing.assert_array_equal(logged(neighbour_std=1.0).neighbour_std, usual)
    np.testing.assert_allclose(logged(neighbour_std=0.0).neighbour_std, 1e-3 * usual)


def test_steps_and_repeats_are_zero_where_there_are_none() -> None:
    for rig in (RIG, logged()):
        np.testing.assert_array_equal(rig.step, 0.0)
        np.testing.assert_array_equal(rig.repeats, 0.0)
    np.testing.assert_array_equal(logged(resolution=1e-3, repeats=0.2).step, 1e-3)
    np.testing.assert_array_equal(logged(resolution=1e-3, repeats=0.2).repeats, 0.2)


def test_the_inductance_of_a_winding_stands_in_the_rig_file(tmp_path: Path) -> None:
    rig = replace(load_rig(), inductance=Quantity(1.4e-3, "H", "identified", std=2e-5))
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    assert load_rig(path).inductance == rig.inductance
    path.write_text(path.read_text(encoding="utf-8").replace("0.0014", "-0.0014"), encoding="utf-8")
    with pytest.raises(UsageError, match="inductance"):
        load_rig(path)
