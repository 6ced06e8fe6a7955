"""Careless and hostile use of the command: nothing of the user's is lost, and what cannot be done is one line."""

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from observer_fi.cli import verdicts
from observer_fi.cli.commands import main
from observer_fi.cli.options import BUG, FAULT, OK, USAGE
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, csv_bytes, synthesise
from observer_fi.report.result_folder import MARKER

ROOT = Path(__file__).parents[2]
HERE = os.environ | {"PYTHONPATH": str(ROOT)}
RIG = load_rig()


def move(kind: str = "none") -> bytes:
    fault = Fault() if kind == "none" else Fault(kind, 0.4)
    return csv_bytes(synthesise(Scenario((Move(0.1, 410.0, 0.6),), 0.9, fault=fault, seed=2), RIG)[0])


HEALTHY, LOST = move(), move("coupling_loss")


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(path: str | bytes, content: bytes = HEALTHY) -> str:
    place = Path(os.fsdecode(path))
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(content)
    return str(place)


def tree(folder: str) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in Path(folder).rglob("*")
        if p.is_file() and p.name != MARKER
    }


def label(folder: str) -> str:
    return str(json.loads(Path(folder, "report.json").read_text())["verdict"]["label"])


# --- nothing of the user's is removed ----------------------------------------------------------------------------


def test_a_folder_beside_the_log_with_its_name_stays() -> None:
    log = put("A/run7.csv")
    put("A/run7/raw.bin", b"raw")
    put("A/run7/report.html", b"my own page")
    before = tree("A")
    assert main(["diagnose", log, "--out", "A", "--quiet"]) == OK
    assert tree("A").items() >= before.items()
    assert label("A/run7_2") == "nominal"  # a file of the report's name was in the way


@pytest.mark.parametrize("log", ["..csv", "...csv", ".csv", "..csv.gz"])
def test_logs_without_a_name_climb_nowhere(log: str) -> None:
    put("kept/earlier.txt", b"1")
    put("mine.txt", b"2")
    path = put(log, gzip.compress(HEALTHY) if log.endswith("gz") else HEALTHY)
    assert main(["diagnose", path, "--out", "kept/reports", "--quiet"]) == OK
    assert label("kept/reports/log") == "nominal"
    assert tree("kept")["earlier.txt"] == b"1" and Path("mine.txt").read_bytes() == b"2"


@pytest.mark.parametrize("command", ["diagnose", "identify", "improve", "simulate"])
@pytest.mark.parametrize("name", [".", "..", "../other", "a/b", "", "/tmp/x"])
def test_names_that_climb_are_one_line(command: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    put("other/report.json", b"{}")
    put("reports/a/report.json", b"{}")
    before = tree(".")
    words = [] if command == "simulate" else [put("log.csv")]
    assert main([command, *words, "--name", name, "--out", "reports"]) == USAGE
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "--name" in said.err
    assert tree(".").items() >= before.items()


@pytest.mark.slow
def test_two_logs_of_one_name_have_two_reports(capsys: pytest.CaptureFixture[str]) -> None:
    first, second = put("sub1/a.csv"), put("sub2/a.csv", LOST)
    assert main(["diagnose", first]) == OK
    capsys.readouterr()
    for _ in range(2):
        assert main(["diagnose", second]) == OK
        said = capsys.readouterr()
        assert said.err == f"observer-fi: {second}: the name a is taken, its report is under a_2\n"
        assert "reports/a_2/report.html" in said.out
    assert (label("reports/a"), label("reports/a_2")) == ("nominal", "coupling_loss")
    assert main(["diagnose", second, first, "--name", "x", "--quiet"]) == OK
    assert (label("reports/x"), label("reports/x_2")) == ("coupling_loss", "nominal")


def test_simulate_replaces_no_recorded_log(capsys: pytest.CaptureFixture[str]) -> None:
    put("logs/s.csv", b"recorded")
    words = ["simulate", "--out", "logs", "--seconds", "0.3", "--moves", "0.1:100:0.1", "--name"]
    assert main([*words, "s"]) == USAGE
    assert "was not written by observer-fi" in capsys.readouterr().err
    assert tree("logs") == {"s.csv": b"recorded"}
    assert main([*words, "t"]) == main([*words, "t", "--seed", "3"]) == OK


# --- a bad log stops no other ------------------------------------------------------------------------------------


def test_every_kind_of_bad_log_among_good_ones(capsys: pytest.CaptureFixture[str]) -> None:
    Path("folder.csv").mkdir()
    Path("gone.csv").symlink_to("nowhere")
    bad = [put("broken.tdms", b"TDSm" + bytes(range(200))), put("broken.parquet", b"PAR1"), "folder.csv", "gone.csv",
           put("empty.csv", b""), "x" * 300 + ".csv", "nul\0.csv"]  # fmt: skip
    good = [put("a.csv"), put("y" * 250 + ".csv"), put("a\x1b[31m\nb.csv")]
    assert main(["diagnose", good[0], *bad[:4], good[1], *bad[4:], good[2], "--json"]) in (USAGE, BUG)
    said = capsys.readouterr()
    results = json.loads(said.out)
    assert [r["verdict"]["label"] for r in results if "verdict" in r] == ["nominal"] * 3
    assert len(said.err.splitlines()) == len(bad) + 1 and "7 of 10" in said.err and "\x1b" not in said.err
    assert sorted(p.name for p in Path("reports").iterdir()) == sorted(["a", "y" * 250, "a_[31m_b"])


def test_a_bug_over_one_log_stops_no_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from observer_fi import verdict

    real = verdict.diagnose

    def diagnose(path: str, *args: object, **words: object) -> object:
        return 1 / 0 if path == "b.csv" else real(path, *args, **words)  # type: ignore[arg-type]

    monkeypatch.setattr(verdict, "diagnose", diagnose)
    logs = [put(name) for name in ("a.csv", "b.csv", "c.csv")]
    assert main(["diagnose", *logs, "--quiet"]) == BUG
    said = capsys.readouterr().err
    assert "b.csv: a bug of observer-fi" in said and len(said.splitlines()) == 2
    assert label("reports/a") == label("reports/c") == "nominal"
    with pytest.raises(ZeroDivisionError):  # alone it is told in full
        main(["diagnose", "b.csv"])


@pytest.mark.slow
def test_a_name_that_is_no_text_has_its_report() -> None:
    log = put(b"m\xfcll.csv")
    ran = subprocess.run(
        [sys.executable, "-m", "observer_fi", "diagnose", os.fsencode(log)],
        capture_output=True,
        env=HERE,
        timeout=200,
    )
    assert (ran.returncode, ran.stderr) == (OK, b"")
    (folder,) = Path("reports").iterdir()
    assert json.loads((folder / "report.json").read_text())["log"]["path"] == log


# --- no all-clear where nothing was tested -----------------------------------------------------------------------


def test_not_tested_is_no_all_clear(capsys: pytest.CaptureFixture[str]) -> None:
    rest = put("rest.csv", b"".join(HEALTHY.splitlines(keepends=True)[:150]))
    assert main(["diagnose", rest, "--json", "--fail-on-fault"]) == FAULT
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert (verdict["label"], verdict["probability"]) == ("not_tested", None)
    assert main(["diagnose", rest]) == OK
    assert "not tested: the log holds no move" in capsys.readouterr().out
    log = put("log.csv", LOST)
    assert main(["diagnose", log, "--detected-at", "99", "--fail-on-fault", "--quiet"]) == FAULT
    assert label("reports/log") == "not_tested"


@pytest.mark.parametrize(
    "words",
    [
        *(["diagnose", "log.csv", "--detected-at", value] for value in ("nan", "inf", "-inf", "1e999", "soon")),
        *(["watch", "--heartbeat", value] for value in ("nan", "inf", "-1", "1e30", "x")),
        *(["watch", "--every", value] for value in ("-1", "1.5", "nan", "1" + "0" * 30)),
        *(["fleet", ".", "--workers", value] for value in ("0", "-3", "nan", "1e3")),
    ],
)  # fmt: skip
def test_numbers_of_options_are_checked(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    put("log.csv", LOST)
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert (stop.value.code, said.out) == (USAGE, "")
    assert said.err.count("\n") == 1 and words[-2] in said.err
    assert not Path("reports").exists()


# --- output that nobody takes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "redirect, said", [("> /dev/full", "No space left"), (">&-", "standard output is closed")]
)
def test_output_that_cannot_be_written_is_one_line(redirect: str, said: str) -> None:
    put("log.csv")
    command = f"{sys.executable} -m observer_fi diagnose log.csv --json {redirect}"
    ran = subprocess.run(command, shell=True, capture_output=True, text=True, env=HERE, timeout=200)
    assert ran.returncode == USAGE and said in ran.stderr and ran.stderr.count("\n") == 1


def test_the_module_under_test_is_this_one() -> None:
    assert Path(verdicts.__file__).is_relative_to(ROOT)
