"""Results on disk: whole or not at all, side by side, and in place of nothing that somebody else wrote."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from kill import kill_commands

from observer_fi.errors import UsageError
from observer_fi.report import result_folder
from observer_fi.report.result_folder import (
    MARKER,
    PART,
    Made,
    clear_leftovers,
    folder_name,
    folder_of,
    write_beside,
    write_file,
    write_folder,
    write_result,
)

HERE = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
FIRST, SECOND = Made("diagnose", {"one/a.csv": "1"}), Made("diagnose", {"two/a.csv": "2"})


@pytest.fixture(autouse=True)
def logs_that_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """one/a.csv and two/a.csv: a log that is gone may have been moved, these have not."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.csv").write_text(name)


def tree(folder: Path) -> dict[str, str]:
    """All files below a folder but the markers."""
    return {
        p.relative_to(folder).as_posix(): p.read_text()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name != MARKER
    }


def test_a_result_replaces_its_own_files_and_takes_back_those_it_no_longer_has(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert write_result(out, "a", FIRST, {"report.json": "1", "old.svg": "1"}) == out / "a"
    assert write_result(out, "a", FIRST, {"report.json": "2"}) == out / "a"
    assert tree(out) == {"a/report.json": "2"}


def test_commands_write_side_by_side(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for command in ("diagnose", "identify", "improve", "diagnose"):
        write_result(out, "a", Made(command, FIRST.logs), {f"{command}.json": command})
    assert tree(out) == {f"a/{c}.json": c for c in ("diagnose", "identify", "improve")}


def test_another_log_of_the_same_name_gets_a_number_and_finds_it_again(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for turn in "12":
        write_result(out, "a", FIRST, {"report.json": f"first {turn}"})
        assert write_result(out, "a", SECOND, {"report.json": f"second {turn}"}) == out / "a_2"
    assert tree(out) == {"a/report.json": "first 2", "a_2/report.json": "second 2"}
    # so do the results of other commands on it
    assert write_result(out, "a", Made("identify", SECOND.logs), {"rig.toml": ""}) == out / "a_2"
    assert folder_of(out, "a", SECOND) == out / "a_2"


def test_a_result_of_more_logs_does_not_replace_that_of_fewer(tmp_path: Path) -> None:
    one, both = Made("identify", {"one/a.csv": "1"}), Made("identify", {"one/a.csv": "1", "two/a.csv": "2"})
    turned = Made("identify", dict(reversed(list(both.logs.items()))))
    folders = [
        write_result(tmp_path / "out", "a", made, {"rig.toml": ""}).name for made in (one, both, turned)
    ]
    assert folders == ["a", "a_2", "a_2"]


def test_a_log_that_was_moved_keeps_its_folder(tmp_path: Path) -> None:
    write_result(tmp_path / "out", "a", FIRST, {"report.json": "1"})
    copied, changed = Made("diagnose", {"new/a.csv": "1"}), Made("diagnose", {"new/a.csv": "other bytes"})
    assert folder_of(tmp_path / "out", "a", copied).name == "a_2"  # the first is still there
    (tmp_path / "one" / "a.csv").unlink()
    assert folder_of(tmp_path / "out", "a", copied).name == "a"
    assert folder_of(tmp_path / "out", "a", changed).name == "a_2"


def test_a_folder_of_the_users_keeps_every_file(tmp_path: Path) -> None:
    theirs = tmp_path / "out" / "a"
    (theirs / "raw").mkdir(parents=True)
    (theirs / "raw" / "x.bin").write_text("raw")
    (theirs / "notes.txt").write_text("notes")
    assert write_result(tmp_path / "out", "a", FIRST, {"report.json": "1"}) == theirs
    assert tree(theirs) == {"notes.txt": "notes", "raw/x.bin": "raw", "report.json": "1"}


@pytest.mark.parametrize("kind", ["file", "folder", "link", "edited", "blocked"])
def test_what_is_not_ours_is_never_replaced(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "out" / "a"
    if kind == "blocked":
        folder.parent.mkdir()
        folder.write_text("a file of that name")
    elif kind == "edited":
        write_result(tmp_path / "out", "a", FIRST, {"rig.toml": "ours"})
        (folder / "rig.toml").write_text("tuned by hand")
    else:
        folder.mkdir(parents=True)
        (tmp_path / "target").write_text("target")
        {
            "file": lambda p: p.write_text("theirs"),
            "folder": lambda p: p.mkdir(),
            "link": lambda p: p.symlink_to(tmp_path / "target"),
        }[kind](folder / "rig.toml")
    before = tree(tmp_path)
    for _ in range(2):
        assert write_result(tmp_path / "out", "a", FIRST, {"rig.toml": "new"}).name == "a_2"
    assert tree(tmp_path) == before | {"out/a_2/rig.toml": "new"}


def test_a_spoilt_marker_makes_everything_foreign(tmp_path: Path) -> None:
    folder = write_result(tmp_path / "out", "a", FIRST, {"report.json": "1"})
    for text in (
        "",
        "[]",
        "{",
        "null",
        '{"schema": "observer-fi/folder/1", "results": {"diagnose": 3}}',
        "[" * 9999,
    ):
        (folder / MARKER).write_text(text)
        assert write_result(tmp_path / "out", "a", FIRST, {"report.json": "2"}).name == "a_2"
    assert (folder / "report.json").read_text() == "1"


def test_beside_other_files(tmp_path: Path) -> None:
    made = Made("simulate s", {})
    (tmp_path / "mine.csv").write_text("recorded")
    write_beside(tmp_path, made, {"s.csv": "1"})
    write_beside(tmp_path, made, {"s.csv": "2"})
    write_beside(tmp_path, made, {"s.csv.gz": "3"})
    assert tree(tmp_path)["s.csv.gz"] == "3"
    write_beside(tmp_path, made, {"s.csv": "2"})
    assert tree(tmp_path)["s.csv"] == "2" and tree(tmp_path)["mine.csv"] == "recorded"
    with pytest.raises(UsageError, match=r"mine.csv: this file was not written by observer-fi"):
        write_beside(tmp_path, Made("simulate mine", {}), {"mine.csv": "1", "mine.truth.json": "1"})
    assert "mine.truth.json" not in tree(tmp_path) and tree(tmp_path)["mine.csv"] == "recorded"
    write_beside(tmp_path, Made("fleet", {"one": ""}), {"index.html": "1"})
    with pytest.raises(UsageError, match="holds the fleet of .*one"):
        write_beside(tmp_path, Made("fleet", {"two": ""}), {"index.html": "2"})


@pytest.mark.parametrize(
    "name", ["", ".", "..", "...", " ", "../other", "a/b", "/etc", "a\\b", "a\0", "a\n", "x" * 256]
)
def test_names_that_climb_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "keep").write_text("1")
    with pytest.raises(UsageError, match="--name"):
        folder_name(name, "log.csv")
    with pytest.raises(UsageError, match="--name"):
        write_result(tmp_path / "out", name, FIRST, {"report.json": "1"})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "log, name",
    [
        ("a/..csv", "log"),
        ("...csv.gz", "log"),
        (".csv", "log"),
        ("a\nb.csv", "a_b"),
        ("a b.tdms", "a b"),
        (".x.csv", ".x"),
    ],
)
def test_a_log_always_has_a_name(log: str, name: str) -> None:
    assert folder_name(None, log) == name


def test_long_names_and_names_that_are_no_text(tmp_path: Path) -> None:
    long = "ä" * 120 + "x" * 15  # 255 bytes
    odd = os.fsdecode(b"m\xfcll")
    for made, suffix in ((FIRST, ""), (SECOND, "_2")):
        folder = write_result(tmp_path / "out", long, made, {"report.json": "{}"})
        assert folder.name.endswith(suffix) and len(os.fsencode(folder.name)) <= 255
    folder = write_result(
        tmp_path / "out", odd, Made("diagnose", {f"{odd}.csv": ""}), {"report.json": json.dumps(odd)}
    )
    assert json.loads((folder / "report.json").read_text()) == odd
    text = write_result(
        tmp_path / "out", odd, Made("diagnose", {f"{odd}.csv": ""}), {"report.json": f'"{odd}"'}
    )
    assert json.loads((text / "report.json").read_text()) == odd


# --- kills -----------------------------------------------------------------------------------------------------


class KilledError(BaseException):
    """Stands for a kill: nothing after it runs."""


@pytest.mark.parametrize("step", range(14))
def test_a_kill_at_any_step_leaves_whole_files_and_is_mended_by_the_next_run(
    tmp_path: Path, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = {"a": "old", "b": "old", "gone": "old"}, {"a": "new", "b": "new", "fresh": "new"}
    folder = write_result(tmp_path / "out", "a", FIRST, old)
    (folder / "theirs").write_text("theirs")
    calls = 0

    def dies(name: str, real: object) -> object:
        def call(*args: object, **words: object) -> object:
            nonlocal calls
            calls += 1
            if calls > step:
                raise KilledError(name)
            return real(*args, **words)  # type: ignore[operator]

        return call

    with monkeypatch.context() as patch:
        for owner, name in ((Path, "replace"), (Path, "unlink"), (result_folder, "_part")):
            patch.setattr(owner, name, dies(name, getattr(owner, name)))
        try:
            write_result(tmp_path / "out", "a", FIRST, new)
        except KilledError:
            pass
        else:
            assert step > 10
    found = {p.name: p.read_text() for p in folder.iterdir() if not p.name.startswith(".")}
    assert found["theirs"] == "theirs" and {"a", "b"} <= found.keys()
    assert set(found.values()) <= {"old", "new", "theirs"}
    assert write_result(tmp_path / "out", "a", FIRST, new) == folder
    assert tree(folder) == new | {"theirs": "theirs"}
    assert not list((tmp_path / "out").rglob(PART.format("*")))


def test_leftovers_of_a_first_run_are_cleared_with_their_folder(tmp_path: Path) -> None:
    folder = tmp_path / "out" / "a"
    folder.mkdir(parents=True)
    (folder / PART.format("0123")).write_text("half")
    clear_leftovers(folder)
    assert not folder.exists()
    clear_leftovers(folder)
    folder.mkdir()
    (folder / "theirs").write_text("1")
    clear_leftovers(folder)
    assert tree(folder) == {"theirs": "1"}


def test_processes_that_write_at_once_share_the_names(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from observer_fi.report import Made, write_result\n"
        "for k in range(30):\n"
        "    write_result(Path('out'), 'a', Made('diagnose', {sys.argv[1]: ''}), {'report.json': sys.argv[1]})"
    )
    runs = [
        subprocess.Popen([sys.executable, "-c", code, f"{name}/a.csv"], cwd=tmp_path, env=HERE)
        for name in ("one", "two")
    ]
    assert [run.wait(timeout=60) for run in runs] == [0, 0]
    assert sorted(tree(tmp_path / "out").values()) == ["one/a.csv", "two/a.csv"]


@pytest.mark.slow
def test_kills_at_random_moments_of_writing() -> None:
    counts, broken = kill_commands.run(25, ["write"], seed=1)
    assert broken == [] and counts["write", "killed"] == 25


@pytest.mark.slow
@pytest.mark.study
def test_kills_at_random_moments_of_commands() -> None:
    counts, broken = kill_commands.run(40, ["diagnose", "identify", "simulate", "compare", "fleet"], seed=1)
    assert broken == [] and sum(counts.values()) == 40


# --- plain files -----------------------------------------------------------------------------------------------


def test_a_failed_write_leaves_what_was_there_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_folder(out, {"a": "1"})
    write_result(out, "r", FIRST, {"a": "1"})
    with pytest.raises(AttributeError):
        write_folder(out, {"a": "2", "c": 3})  # type: ignore[dict-item]
    with pytest.raises(AttributeError):
        write_result(out, "r", FIRST, {"a": "2", "c": 3})  # type: ignore[dict-item]
    assert tree(out) == {"a": "1", "r/a": "1"}


def test_a_disk_that_fills_leaves_the_earlier_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    write_result(out, "a", FIRST, {"a": "1", "b": "1"})
    real, written = os.fsync, []

    def full(handle: int) -> None:
        written.append(handle)
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        real(handle)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UsageError, match="No space left on device"):
        write_result(out, "a", FIRST, {"a": "2", "b": "2"})
    assert tree(out) == {"a/a": "1", "a/b": "1"}
    written.clear()
    with pytest.raises(UsageError, match="No space left on device"):
        write_result(out, "b", FIRST, {"a": "2", "b": "2"})
    assert not (out / "b").exists()


def test_a_place_that_cannot_be_written_is_the_users_to_mend(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match="--out"):
        write_folder(tmp_path / "file" / "out", {"a": "1"})
    with pytest.raises(UsageError, match="--out"):
        write_file(tmp_path / "file" / "a", "1")
    with pytest.raises(UsageError, match="--out"):
        write_result(tmp_path / "file", "a", FIRST, {"a": "1"})


def test_a_life_that_grows_keeps_its_folder(tmp_path: Path) -> None:
    lives = [Made("trend", {f"{k}.csv": str(k) for k in range(n)}, grows=True) for n in (2, 3)]
    other = Made("trend", {"9.csv": "9", "1.csv": "1"}, grows=True)
    folders = [
        write_result(tmp_path / "out", "life", made, {"trend.csv": ""}).name for made in (*lives, other)
    ]
    assert folders == ["life", "life", "life_2"]
