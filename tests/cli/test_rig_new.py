"""`rig new`: the file, what it says of odd values, and one line for what cannot be."""

from pathlib import Path

import pytest

from observer_fi.cli.commands import main
from observer_fi.physics import load_rig

SLIDE = (
    "--drive", "voltage", "--resistance", "2.3 ohm", "--speed-constant", "184 rpm/V", "--inertia", "520 gcm2",
    "--lead", "4 mm", "--mass", "6 kg", "--travel", "500 mm", "--supply", "24 V", "--inductance", "0.7 mH",
)  # fmt: skip


def test_a_file_that_every_command_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "slide.toml"
    assert main(["rig", "new", "--to", str(path), *SLIDE]) == 0
    said = capsys.readouterr()
    assert "guessed: A" in said.out and "identify" in said.out and not said.err
    rig = load_rig(path)
    assert (rig.name, rig.drive) == ("slide", "voltage") and rig.quantities["A"].method == "guess"


def test_without_a_file_the_rig_goes_to_standard_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rig", "new", "--name", "mine", *SLIDE]) == 0
    path = tmp_path / "piped.toml"
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    assert load_rig(path).name == "mine"


def test_a_file_that_is_there_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "slide.toml"
    path.write_text("mine", encoding="utf-8")
    assert main(["rig", "new", "--to", str(path), *SLIDE]) == 2
    assert "is there already" in capsys.readouterr().err and path.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--resistance", "2.3 henry"), "--resistance: there is no unit 'henry'"),
        (("--torque-constant", "90 mNm/A"), "they are one number"),
        (("--drive", "steam"), "there is no drive 'steam'"), (("--lead", "0 mm"), "no lead of an actuator"),
        (("--friction-force", "much"), "does not begin with a number"),
    ],
)  # fmt: skip
def test_bad_values_end_in_one_line(
    more: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slide.toml"
    assert main(["rig", "new", "--to", str(path), *SLIDE, *more]) == 2
    said = capsys.readouterr().err
    assert says in said and len(said.strip().splitlines()) == 1 and not path.exists()


def test_a_suspicion_is_told_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "slide.toml"
    assert main(["rig", "new", "--to", str(path), *SLIDE, "--torque-constant", "54 mNm/A"]) == 0
    assert "warning: torque constant and speed constant" in capsys.readouterr().err
    assert "apart" in load_rig(path).description
