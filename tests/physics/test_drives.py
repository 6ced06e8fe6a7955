"""The table of drives: what a row promises is what a rig file and a bank get, and a broken row is an error when it is made."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from observer_fi.bank.hypotheses import arrays, bank
from observer_fi.errors import UsageError
from observer_fi.logs.columns import COLUMNS
from observer_fi.physics.drives import DRIVES, Drive, table
from observer_fi.physics.equations import NAMES, PARAMETERS
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Scenario, synthesise
from observer_fi.settings import BankSettings

ROWS = tuple(DRIVES.values())


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
        with pytest.raises(UsageError, match="needs the servo"):
            synthesise(Scenario(), rig)
