"""Settings: frozen, from TOML, with errors that name the right keys."""

from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

from observer_fi.errors import UsageError
from observer_fi.settings import BankSettings, DecisionSettings, Settings, load_settings


def written(folder: Path, text: str) -> Path:
    path = folder / "settings.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_no_file_is_the_defaults() -> None:
    assert load_settings(None) == Settings() == Settings(BankSettings(), DecisionSettings())


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path: Path) -> None:
    path = written(
        tmp_path, "[bank]\nfault_rate = 0.5\ndiffusion = { w = 0.2 }\n[decision]\nisolated = 0.99\n"
    )
    settings = load_settings(path)
    assert (settings.bank.fault_rate, settings.decision.isolated) == (0.5, 0.99)
    default = BankSettings()
    assert settings.bank.diffusion == default.diffusion | {"w": 0.2}
    assert settings.bank.doubt == default.doubt
    assert load_settings(written(tmp_path, "")) == Settings()


@pytest.mark.parametrize(("text", "message"), [
    ("[bnak]\nfault_rate = 1", r"no settings 'bnak' \(known: bank, decision\)"),
    ("[bank]\nfault_rat = 1", r"no setting 'fault_rat' \(known: .*fault_rate"),
    ("[decision]\nwindow = 1", r"no setting 'window' \(known: .*window_s"),
    ("[bank", "not a TOML file"),
])  # fmt: skip
def test_a_misspelt_key_is_one_line_with_the_right_ones(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=message) as error:
        load_settings(written(tmp_path, text))
    assert "settings.toml" in str(error.value) and "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere.toml: cannot read the settings"):
        load_settings(tmp_path / "nowhere.toml")


def test_settings_are_frozen_and_share_no_tables() -> None:
    with pytest.raises(FrozenInstanceError):
        BankSettings().fault_rate = 1.0  # type: ignore[misc]
    assert BankSettings().diffusion is not BankSettings().diffusion
