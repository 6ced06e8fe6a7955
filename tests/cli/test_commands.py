"""The command: what it prints, writes and returns, for good logs, bad logs and bad usage."""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest
from force_rig import COULOMB, MASS, D, Truth
from force_rig import log as force_log

from observer_fi.cli.commands import COMMANDS, main
from observer_fi.cli.options import BUG, FAULT, OK, USAGE
from observer_fi.cli.progress import tell_when_compiling
from observer_fi.physics.rigs import load_rig

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data"
SAMPLES = json.loads((DATA / "samples.json").read_text())
HEADER = "time_s,voltage_v,current_a,position_m,pitch_deg,speed_cmd_rad_s\n"


def sample(name: str) -> str:
    return str(DATA / f"{name}.csv.gz")


class Ran:
    """Exit code and both outputs of one command."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]):
    def go(*words: object) -> Ran:
        try:
            code = main([str(word) for word in words])
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return Ran(code, captured.out, captured.err)

    return go


@pytest.mark.study
@pytest.mark.slow
def test_what_a_logger_hides_is_told_above_the_verdict(run, tmp_path: Path) -> None:
    table = pd.read_csv(sample("overload_steady"), comment="#")
    held = table["position_m"].to_numpy()
    table["position_m"] = held[np.arange(held.size) // 16 * 16]
    path = tmp_path / "held.csv"
    table.to_csv(path, index=False)
    ran = run("diagnose", path, "--out", tmp_path)
    *warnings, last = ran.out.splitlines()
    assert ran.code == OK and last.startswith("held: overload")
    assert warnings and all(line.startswith("held: warning: ") for line in warnings)
    assert any("position_m is held, fresh 100 times a second" in line for line in warnings)
    assert run("diagnose", path, "--out", tmp_path, "--quiet").out == ""
    told = json.loads(run("diagnose", path, "--out", tmp_path, "--json").out)
    assert told["acquisition"]["position_m"]["update_hz"] == pytest.approx(100.0, rel=1e-4)
    assert [f"held: warning: {sentence}" for sentence in told["warnings"]] == warnings


@pytest.mark.first(3, 6)
@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_the_sample_logs_get_the_right_verdict(name: str, kind: str, run, tmp_path: Path) -> None:
    ran = run("diagnose", sample(name), "--filter", kind, "--json", "--out", tmp_path)
    result = json.loads(ran.out)
    assert (ran.code, ran.err) == (OK, "")
    assert result["verdict"]["label"] == SAMPLES[name]["label"]
    if SAMPLES[name]["onset_s"] is not None:
        assert result["verdict"]["onset_s"] == pytest.approx(SAMPLES[name]["onset_s"], abs=0.015)
    assert result == json.loads((tmp_path / name / "report.json").read_text())
    assert (tmp_path / name / "report.html").stat().st_size > 10_000
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]


@pytest.mark.slow
def test_one_line_for_a_person(run, tmp_path: Path) -> None:
    ran = run("diagnose", sample("overload_steady"), "--out", tmp_path)
    assert ran.out.count("\n") == 1
    assert "overload since 1.6" in ran.out and "report.html" in ran.out
    assert run("diagnose", sample("overload_steady"), "--out", tmp_path, "--quiet").out == ""


@pytest.mark.slow
def test_fail_on_fault(run, tmp_path: Path) -> None:
    quiet = ("--quiet", "--fail-on-fault", "--out", tmp_path)
    assert run("diagnose", sample("overload_steady"), *quiet).code == FAULT
    assert run("diagnose", sample("false_alarm_steady"), *quiet).code == OK


BAD = {
    "missing.csv": None,
    "empty.csv": "",
    "header.csv": HEADER,
    "text.csv": HEADER + "0.0,1,0.1,0,0,0\n0.001,1,oops,0,0,0\n0.002,1,0.1,0,0,0\n",
    "column.csv": "time_s,voltage_v,current_a\n0,1,2\n0.001,1,2\n",
    "backward.csv": HEADER + "0.0,1,0.1,0,0,0\n0.002,1,0.1,0,0,0\n0.001,1,0.1,0,0,0\n",
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_is_one_line_and_exit_2(name: str, run, tmp_path: Path) -> None:
    path = tmp_path / name
    if BAD[name] is not None:
        path.write_text(BAD[name])
    ran = run("diagnose", path, "--out", tmp_path / "out", "--json")
    assert (ran.code, ran.out) == (USAGE, "")
    assert ran.err.count("\n") == 1
    assert str(path) in ran.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_bad_log_among_many_stops_nothing_and_is_listed(run, tmp_path: Path) -> None:
    bad = tmp_path / "empty.csv"
    bad.write_text("")
    good = [sample("overload_steady"), sample("false_alarm_steady")]
    ran = run("diagnose", good[0], bad, good[1], "--out", tmp_path / "out", "--json")
    result = json.loads(ran.out)
    assert ran.code == USAGE
    assert [r.get("verdict", {}).get("label") for r in result] == ["overload", None, "nominal"]
    assert str(bad) in result[1]["error"] and str(bad) in ran.err and "1 of 3" in ran.err
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["false_alarm_steady", "overload_steady"]


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("diagnoze",),
        ("diagnose",),
        ("diagnose", "x.csv", "--engine", "magic"),
        ("diagnose", "x.csv", "--rig", "nowhere.toml"),
        ("diagnose", "x.csv", "--settings", "nowhere.toml"),
        ("diagnose", "x.csv", "--columns", "nowhere.toml"),
        ("simulate", "--fault", "overlaod"),
        ("simulate", "--fault", "overload", "--at", "99"),
        ("simulate", "--fault", "sensor_frozen", "--at", "1"),
        ("simulate", "--effect", "viscosity=1"),
        ("simulate", "--effect", "J"),
        ("simulate", "--moves", "0:1"),
        ("simulate", "--rate", "nan"),
        ("simulate", "--noise", "-1"),
        ("compare", "--cases", "0"),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(words: Sequence[str], run, tmp_path: Path) -> None:
    out = () if len(words) < 2 else ("--out", tmp_path)
    ran = run(*words, *out)
    assert (ran.code, ran.out) == (USAGE, "")
    assert ran.err.startswith("observer-fi") and ran.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_bad_usage(run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ran = run("diagnose", sample("overload_steady"), "--out", tmp_path / "file", "--quiet")
    assert ran.code == USAGE and ran.err.count("\n") == 1


@pytest.mark.slow
def test_an_external_detection_starts_the_verdict(run, tmp_path: Path) -> None:
    ran = run("diagnose", sample("overload_steady"), "--json", "--out", tmp_path, "--detected-at", "2.0")
    verdict = json.loads(ran.out)["verdict"]
    assert verdict["label"] == "overload" and verdict["isolated_s"] >= 2.0


@pytest.mark.slow
def test_simulate_repeats_itself_and_tells_the_truth(run, tmp_path: Path) -> None:
    words = (
        "simulate",
        "--moves",
        "0.2:300:1.2,1.4:-300:1.0",
        "--fault",
        "coupling_loss",
        "--at",
        "0.7",
        "--spread",
    )
    outs = [tmp_path / name for name in "abc"]
    for out, seed in zip(outs, (1, 1, 2), strict=True):
        assert run(*words, "--seed", seed, "--out", out, "--gzip", "--name", "s").code == OK
    a, b, c = ((out / "s.csv.gz").read_bytes() for out in outs)
    assert a == b != c
    truth = json.loads((outs[0] / "s.truth.json").read_text())
    assert (truth["label"], truth["onset_s"], truth["scenario"]["seed"]) == ("coupling_loss", 0.7, 1)
    result = json.loads(run("diagnose", outs[0] / "s.csv.gz", "--json", "--out", tmp_path / "r").out)
    assert result["verdict"]["label"] == "coupling_loss"


@pytest.mark.slow
def test_compare_writes_its_scores(run, tmp_path: Path) -> None:
    ran = run("compare", "--cases", 3, "--json", "--out", tmp_path)
    result = json.loads(ran.out)
    assert ran.code == OK and result["bank"]["cases"] == result["mixture"]["cases"] == 3
    assert json.loads((tmp_path / "compare" / "compare.json").read_text()) == result
    assert "<h1>" in (tmp_path / "compare" / "compare.html").read_text()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name: str, run) -> None:
    ran = run(name, "--help")
    assert ran.code == OK and f"observer-fi {name}" in ran.out


@pytest.mark.slow
def test_the_process_as_a_user_runs_it(tmp_path: Path) -> None:
    """From another folder, output to a pipe: nothing on standard error, and no progress bar."""
    command = [sys.executable, "-m", "observer_fi", "diagnose", sample("coupling_loss_steady"), "--json"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (ran.returncode, ran.stderr) == (OK, "")
    assert json.loads(ran.stdout)["verdict"]["label"] == "coupling_loss"
    assert (tmp_path / "reports" / "coupling_loss_steady" / "report.json").exists()


def test_starting_up_imports_nothing_heavy() -> None:
    code = "import sys, observer_fi.cli.commands; print([m for m in ('numpy', 'numba', 'pandas') if m in sys.modules])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ran.stdout.strip() == "[]"


@pytest.mark.parametrize("own", [None, "3"])
@pytest.mark.parametrize(
    ("name", "usual", "shown"),
    [
        ("NUMBA_OPT", "1", "import numba; print(int(numba.config.OPT))"),
        ("OPENBLAS_NUM_THREADS", "1", "import os; print(os.environ['OPENBLAS_NUM_THREADS'])"),
    ],
)
def test_kernels_compile_quickly_and_products_take_one_thread_unless_the_environment_says_otherwise(
    name: str, usual: str, shown: str, own: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(name, raising=False)
    if own:
        monkeypatch.setenv(name, own)
    code = f"from observer_fi.cli import main; main(['diagnose', 'none.csv']); {shown}"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ran.stdout.split() == [own or usual]


def test_a_bug_is_exit_1(tmp_path: Path) -> None:
    broken = "c.COMMANDS['compare'] = c.COMMANDS['compare']._replace(run=lambda a: 1 / 0)"
    code = f"import sys, observer_fi.cli.commands as c; {broken}"
    ran = subprocess.run(
        [sys.executable, "-c", f"{code}; sys.exit(c.main(['compare']))"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ran.returncode == BUG and "ZeroDivisionError" in ran.stderr


# --- learning a rig ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def force_rig(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Log and rig file of a carriage that is driven by a commanded force, with a viscous friction the file lacks."""
    folder = tmp_path_factory.mktemp("force")
    made = force_log(Truth(150.0, 150.0))
    table = pd.DataFrame({"time_s": made.t, "position_m": made.z[:, 2], "force_cmd_n": made.force})
    table.to_csv(folder / "bench.csv", index=False)
    (folder / "rig.toml").write_text(f"""name = "bench"
drive = "force"
[parameters]
D = {{ value = {D}, unit = "m/rad", method = "manufacturer" }}
J = {{ value = {0.9 * MASS * D**2}, unit = "kg m^2" }}
A = {{ value = {0.9 * COULOMB * D}, unit = "N m" }}
input_delay = {{ value = 5e-4, unit = "s", method = "known" }}
""")
    return folder / "bench.csv", folder / "rig.toml"


def test_improve_takes_a_rig_that_is_driven_by_a_force(force_rig, run, tmp_path: Path) -> None:
    log, rig = force_rig
    ran = run("improve", log, "--rig", rig, "--out", tmp_path, "--json")
    result = json.loads(ran.out)
    assert (ran.code, ran.err) == (OK, "")
    assert [f["cause"] for f in result["findings"]] == ["viscous_friction"]
    assert result == json.loads((tmp_path / "bench" / "improve.json").read_text())
    written = {p.name for p in (tmp_path / "bench").iterdir()}
    assert {"improve.json", "improve.html", "extended_rig.toml"} <= written


def test_identify_takes_a_rig_that_is_driven_by_a_force(force_rig, run, tmp_path: Path) -> None:
    log, rig = force_rig
    ran = run("identify", log, "--rig", rig, "--out", tmp_path, "--name", "learned")
    assert (ran.code, ran.err) == (OK, "") and "parameters learned" in ran.out
    learned = load_rig(tmp_path / "learned" / "rig.toml")
    assert learned.drive == "force" and learned.model["J"] == pytest.approx(MASS * D**2, rel=0.1)


def test_a_rig_without_motor_has_no_bank(force_rig, run, tmp_path: Path) -> None:
    log, rig = force_rig
    ran = run("diagnose", log, "--rig", rig, "--out", tmp_path)
    assert ran.code == USAGE and ran.err.count("\n") == 1 and "drive" in ran.err


@pytest.mark.parametrize(
    "terminal, quiet, told", [(True, False, True), (False, False, False), (True, True, False)]
)
def test_a_terminal_is_told_why_the_first_run_takes_longer(
    terminal: bool,
    quiet: bool,
    told: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    tell_when_compiling(argparse.Namespace(quiet=quiet, json=False))
    assert ("compiling the filters" in capsys.readouterr().err) == told
