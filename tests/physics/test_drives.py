"""The table of drives: what a row promises is what a rig file and a bank get, and a broken row is an error when it is made."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from observer_fi.bank.hypotheses import arrays, bank
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.columns import COLUMNS
from observer_fi.logs.ingest import read_log
from observer_fi.physics.drives import DRIVES, Drive, table
from observer_fi.physics.equations import KI, KM, NAMES, PARAMETERS, A
from observer_fi.physics.rigs import commanded, load_rig, rig_toml, with_values
from observer_fi.physics.scenario import Fault, Move, Scenario, csv_bytes, synthesise
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict.diagnosis import diagnose, diagnose_log

ROWS = tuple(DRIVES.values())
TABLE_1 = load_rig()
FREE = {name: q for name, q in TABLE_1.quantities.items() if name not in DRIVES["position_servo"].excludes}
LOOP = with_values(replace(TABLE_1, drive="position_servo", quantities=FREE), {"Kx": 20.0, "x_window": 4e-7})


def rig_file(folder: Path, drive: str, names: tuple[str, ...]) -> Path:
    plant = load_rig().model
    given = "\n".join(f"{n} = {plant[n] or 1.0}" for n in names)
    path = folder / f"{drive}.toml"
    path.write_text(f'drive = "{drive}"\n[parameters]\n{given}\n', encoding="utf-8")
    return path


def test_a_row_has_no_defaults_so_a_forgotten_column_fails_at_import() -> None:
    columns = {f.name: getattr(ROWS[0], f.name) for f in fields(Drive)}
    for name in columns:
        with pytest.raises(TypeError, match=name):
            Drive(**{k: v for k, v in columns.items() if k != name})  # type: ignore[arg-type]


@pytest.mark.parametrize(("changes", "what"), [
    ({"columns": ()}, "columns"),
    ({"requires": ()}, "requires"),
    ({"requires": ("Jm",)}, "Jm"),
    ({"plant": {"kp": 0.0}}, "kp"),
    ({"in_doubt": ("j",)}, "'j'"),
    ({"motor": False}, "motor"),
])  # fmt: skip
def test_a_broken_row_is_refused(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        replace(DRIVES["pi_servo"], **changes)
    with pytest.raises(ValueError, match="one name"):
        table(*ROWS, ROWS[0])


@pytest.mark.parametrize("row", ROWS, ids=tuple(DRIVES))
def test_a_rig_gives_what_its_drive_requires(row: Drive, tmp_path: Path) -> None:
    assert set(row.columns) <= set(COLUMNS) and set(row.requires) <= set(NAMES)
    rig = load_rig(rig_file(tmp_path, row.name, row.requires))
    assert rig.driven is row
    for name in row.requires:
        with pytest.raises(UsageError, match=f"missing for drive '{row.name}': {name}"):
            load_rig(rig_file(tmp_path, row.name, tuple(n for n in row.requires if n != name)))
    for name in row.excludes:
        with pytest.raises(UsageError, match=f"drive '{row.name}' has not: {name}"):
            load_rig(rig_file(tmp_path, row.name, (*row.requires, name)))


@pytest.mark.parametrize("row", ROWS, ids=tuple(DRIVES))
def test_a_bank_takes_the_plant_and_the_doubts_of_the_row(row: Drive) -> None:
    """Without a servo the integral is a random walk that the current sensor pins; without a motor there is no bank."""
    rig, settings = replace(load_rig(), drive=row.name), BankSettings()
    if not row.motor:
        with pytest.raises(UsageError, match=f'drive = "{row.name}"'):
            bank(rig, settings)
        return
    hypotheses = bank(rig, settings)
    for h in hypotheses:
        assert {name: h.model[name] for name in row.plant} == dict(row.plant)
        assert h.states[3 : 3 + len(row.in_doubt)] == row.in_doubt
    walk = arrays(hypotheses, rig, settings).diffusion[0, 1] ** 0.5 * hypotheses[0].model["Ki"]
    free = settings.free_current
    assert walk == pytest.approx(settings.diffusion["I"] * rig.model["Ki"] if row.servo else free)
    assert all(PARAMETERS[name][1] is None for name in row.in_doubt)  # constants of Table 1


@pytest.mark.parametrize("row", ROWS, ids=tuple(DRIVES))
def test_only_a_servo_can_be_simulated(row: Drive) -> None:
    rig = replace(load_rig(), drive=row.name)
    if row.servo:
        assert synthesise(Scenario(), rig)[0].t.size
    else:
        with pytest.raises(UsageError, match="needs a servo .*pi_servo"):
            synthesise(Scenario(), rig)


@pytest.mark.parametrize("row", ROWS, ids=tuple(DRIVES))
def test_a_motor_at_rest_is_driven_as_its_row_says(row: Drive) -> None:
    """A servo's integral makes the measured current, within the band of friction; nothing presses on what has no motor."""
    p = load_rig().model.vector
    rest = row.at_rest(np.array([0.02, -0.01]), p)
    np.testing.assert_allclose(rest.c, [0.02, -0.01] if row.motor else [0.0, 0.0])
    np.testing.assert_allclose(p[KI] * rest.I, rest.c)
    assert rest.I_std == pytest.approx(0.5 * p[A] / (p[KM] * p[KI]) if row.motor else 0.0)


# --- the position loop around the speed servo ------------------------------------------------------


def test_a_position_servo_follows_its_command_a_time_constant_late() -> None:
    """The lag of a proportional loop is v / Kx; at rest it is within its window, and commands no speed at all."""
    log, _ = synthesise(Scenario((Move(0.3, 300.0, 2.0),), 3.2, noise=0.0), LOOP)
    assert log.position_cmd is not None and log.encoder is not None
    at = np.searchsorted(log.t, 2.0)
    assert log.position_cmd[at] - log.z[at, 2] == pytest.approx(1.9e-6 * 300.0 / 20.0, rel=1e-3)
    assert log.w_cmd[at] == pytest.approx(300.0, rel=1e-3)
    assert log.position_cmd[-1] == pytest.approx(1.9e-6 * 300.0 * 2.0)
    assert abs(log.z[-1, 2] - log.position_cmd[-1]) < 4e-7 and log.w_cmd[-1] == 0.0


def test_the_simulated_loop_does_not_depend_on_the_sampling() -> None:
    fine, coarse = (
        synthesise(Scenario(fault=Fault("overload", 1.0), rate_hz=rate, noise=0.0), LOOP)[0] for rate in (4800.0, 1600.0)
    )  # fmt: skip
    off = np.abs(fine.z[::3][: coarse.t.size] - coarse.z).max(axis=0)
    assert (off < TABLE_1.noise_std).all(), off


@pytest.mark.slow
def test_the_command_is_made_from_the_columns(tmp_path: Path) -> None:
    """From a file as from memory; a column that the loop needs and the log has not is named."""
    log, _ = synthesise(Scenario(fault=Fault("coupling_loss", 1.0), seed=2), LOOP)
    path, rig = tmp_path / "log.csv", tmp_path / "rig.toml"
    path.write_bytes(csv_bytes(log))
    rig.write_text(rig_toml(LOOP), encoding="utf-8")
    back = commanded(read_log(path), load_rig(rig))
    np.testing.assert_allclose(back.w_cmd, log.w_cmd, atol=1e-5)
    outcome = diagnose(path, load_rig(rig), Settings())
    assert outcome.isolation is not None and outcome.isolation.verdict.label == "coupling_loss"
    assert outcome.log is not None and not any("recovered" in note for note in outcome.log.notes)
    for column in ("position_cmd", "encoder"):
        with pytest.raises(InvalidLogError, match=f"column {column}.* is missing"):
            commanded(replace(log, **{column: None}), LOOP)


@pytest.mark.parametrize(("kind", "channel"), [
    ("none", None), ("overload", None), ("coupling_loss", None), ("sensor_frozen", "position"), ("sensor_offset", "current"),
])  # fmt: skip
@pytest.mark.parametrize("at_s", [0.35, 1.2])
@pytest.mark.first(2)
def test_faults_are_told_behind_a_position_loop(kind: str, channel: str | None, at_s: float) -> None:
    seed = round(100 * at_s)
    scenario = Scenario(
        (Move(0.3, -300.0, 2.0),), 3.2, 1600.0, 4.0, Fault(kind, at_s, channel), {}, True, 1.0, seed
    )
    log, truth = synthesise(scenario, LOOP)
    found = diagnose_log(log, LOOP, Settings()).isolation
    assert found is not None and found.consistency.nis_mean < 3.3
    assert (found.verdict.label, found.verdict.channel) == (truth.label, truth.channel)
    if found.verdict.onset_s is not None:
        assert abs(found.verdict.onset_s - at_s) < 0.01
