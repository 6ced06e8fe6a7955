"""The commands of docs/new-rig.md, run on the logs of the rigs that it speaks of, say what the page says."""

import re
import shlex
from pathlib import Path

import documented_rigs
import pytest
from shown_commands import steps

from observer_fi.cli.commands import main

PAGE = Path(__file__).parents[1] / "docs" / "new-rig.md"
TEXT = PAGE.read_text(encoding="utf-8")
WALK = TEXT[TEXT.index("## 2.") : TEXT.index("## 6.")]


@pytest.mark.slow
def test_the_walk_from_data_sheet_to_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    documented_rigs.write(tmp_path)
    maps = re.findall(r"```toml\n(.*?)```", WALK, re.DOTALL)
    for name, text in zip(("slide_map.toml", "lift_map.toml"), maps, strict=True):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    ran = 0
    for command, lines in steps(WALK):
        program, *words = shlex.split(command)
        if program == "head":
            said = Path(words[-1]).read_text(encoding="utf-8")
        else:
            assert (program, main(words)) == ("observer-fi", 0)
            said = "".join(capsys.readouterr())
        ran += 1
        assert lines and all(line in said for line in lines), f"{command}\n{said}"
    assert ran >= 9
