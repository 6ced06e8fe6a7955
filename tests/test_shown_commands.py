"""Every command that a document shows is one: it parses, and where no other machine is needed it runs."""

import shutil
from pathlib import Path

import pandas as pd
import pytest
from shown_commands import DOCUMENTS, ROOT, shown, steps
from trend_logs import cycle_frame

from observer_fi import diagnose
from observer_fi.cli.commands import COMMANDS, _parser, main

SHOWN = [(path.name, words) for path in DOCUMENTS for words in shown(path)]
ELSEWHERE = {"new-rig.md", "first-verdict.md"}  # each runs whole, in a test of its own
NEEDS_MORE = (
    "watch",
    "--scheduler",
    "--help",
    "rig",
    "emps_published",
)  # a stream without end, a cluster, an exit; a file of its own test; recordings, which test_emps learns from
PLACEHOLDERS = {"LOG...": [f"logs/logs_{k:02d}.csv" for k in range(14)]}
FIRST = ROOT / "docs" / "first-verdict.md"


@pytest.mark.parametrize(("document", "words"), SHOWN, ids=[f"{d}:{' '.join(w)[:40]}" for d, w in SHOWN])
def test_a_command_that_is_shown_parses(document: str, words: list[str]) -> None:
    if "--help" in words:
        words = [word for word in words if word != "--help"] + ["log.csv"]
    assert _parser(words[0]).parse_args(words).command == words[0]


def test_every_command_of_the_package_is_shown() -> None:
    assert len(SHOWN) > 20
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"`observer-fi {name}" in readme for name in COMMANDS)


def sandbox(folder: Path) -> None:
    """The files that the commands name: healthy moves, faults, rig files, folders of cycles."""
    sample = ROOT / "data" / "false_alarm_steady.csv.gz"
    for name in ("campaign.csv.gz", "contact.csv.gz"):
        shutil.copy(sample, folder / name)
    healthy = pd.read_csv(sample, comment="#")
    for name in ("healthy.csv", "monday.csv", "before.csv", "after.csv"):
        healthy.to_csv(folder / name, index=False)
    foreign = healthy.rename(columns={"current_a": "I [mA]", "time_s": "t [s]"})
    foreign.assign(**{"I [mA]": 1e3 * foreign["I [mA]"]}).to_csv(folder / "run.csv", index=False)
    shutil.copytree(ROOT / "data" / "rigs", folder / "data" / "rigs")
    for name in ("rig.toml", "mine.toml"):
        shutil.copy(ROOT / "data" / "rigs" / "mass_shifter.toml", folder / name)
    for name, count, friction in (("logs", 14, 1.3), ("healthy", 10, 0.9), ("DIR", 2, 0.9)):
        (folder / name).mkdir()
        for k in range(count):
            frame = cycle_frame(k + (100 if name == "healthy" else 0), friction if k > 8 else 0.9)
            if name == "DIR":
                frame = healthy
            frame.to_csv(folder / name / f"{name}_{k:02d}.csv", index=False)


@pytest.mark.slow
def test_the_commands_that_are_shown_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sandbox(tmp_path)
    monkeypatch.chdir(tmp_path)
    ran = 0
    for document, words in SHOWN:
        if document in ELSEWHERE or set(words) & set(NEEDS_MORE):
            continue
        filled = [path for word in words for path in PLACEHOLDERS.get(word, [word])]
        if "--limit" in filled:  # of logs with a voltage; these have none, and a friction of 0.9
            filled[filled.index("--limit") + 1] = "friction=1.5"
        code = main(filled)
        said = capsys.readouterr()
        assert code == 0, f"{document}: {' '.join(filled)}\n{said.err}"
        ran += 1
    assert ran >= 12


@pytest.mark.slow
def test_the_first_verdict_is_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = 0
    for command, lines in steps(FIRST.read_text(encoding="utf-8")):
        program, *words = command.split()
        assert (program, main(words)) == ("observer-fi", 0)
        said = "".join(capsys.readouterr())
        assert lines and all(line in said for line in lines), f"{command}\n{said}"
        ran += 1
    assert ran == 6
    assert (tmp_path / "reports" / "monday" / "verdict.png").is_file()


@pytest.mark.slow
def test_the_python_of_the_pages_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of docs/first-verdict.md and docs/api.md, with the log and the frames that they speak of."""
    frame = pd.read_csv(ROOT / "data" / "overload_steady.csv.gz", comment="#")
    frame.to_csv(tmp_path / "monday.csv", index=False)
    monkeypatch.chdir(tmp_path)
    foreign = frame.rename(columns={"time_s": "t", "current_a": "I"})
    foreign["I"] *= 1e3
    ran = 0
    for path in (FIRST, ROOT / "docs" / "api.md"):
        for block in path.read_text(encoding="utf-8").split("```python\n")[1:]:
            code = block.split("```")[0]
            names = {"frame": foreign if "columns=" in code else frame, "diagnose": diagnose}
            exec(compile(code, path.name, "exec"), names)
            assert "found" not in code or names["found"].verdict.label == "overload"
            ran += 1
    assert ran == 4 and (tmp_path / "verdict.png").is_file()


@pytest.mark.slow
def test_the_demo_prints_what_the_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    said = [line for line in readme if line.endswith("/report.html") and ": " in line]
    logs = sorted((ROOT / "data").glob("*.csv.gz"))
    monkeypatch.chdir(tmp_path)
    assert main(["diagnose", *map(str, logs), "--out", "reports/demo"]) == 0
    assert len(said) == len(logs)
    assert capsys.readouterr().out.splitlines() == said
