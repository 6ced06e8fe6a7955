"""fleet: every log has its report or its reason, whatever dies on the way; what is up to date is left alone."""

import contextlib
import json
import operator
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from observer_fi.cli.commands import main
from observer_fi.errors import InvalidLogError, LostClusterError, UsageError
from observer_fi.logs import SUFFIXES, read_log
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.physics.scenario import Fault, Move, Scenario, csv_bytes, synthesise
from observer_fi.serve import digests, fleet
from observer_fi.settings import Settings
from pipelines import fleet_summary

RIG = load_rig()
BROKEN = (b"", b"\n\n", b"time_s,current_a\n0,1\n", b"1,2,3\n4,5,6\n", b"PAR1 not parquet", bytes(range(256)) * 20,
          b"time_s,voltage_v,current_a,position_m,speed_cmd_rad_s\n", b"not a log at all",
          b"time_s,voltage_v,current_a,position_m,speed_cmd_rad_s\n0,0,0,0,0\n1,0,0,0,0\n",
          b"time_s,voltage_v,current_a,position_m,speed_cmd_rad_s\n" + b"0.5,a,b,c,d\n" * 50)  # fmt: skip


def one_log(seed: int, seconds: float = 0.5) -> bytes:
    """A short move with no fault, an overload or a lost coupling, in turn."""
    kind = ("none", "overload", "coupling_loss")[seed % 3]
    fault = Fault() if kind == "none" else Fault(kind, 0.15 + 0.3 * seconds)
    moves = (Move(0.1, 410.0, seconds),)
    return csv_bytes(synthesise(Scenario(moves, seconds + 0.2, fault=fault, seed=seed), RIG)[0])


def make_logs(folder: Path, good: int, broken: int) -> Path:
    """Good logs in two folders, broken ones among them."""
    for k in range(good):
        path = folder / f"rig{k % 2}" / f"move{k:03}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(one_log(k % 6))
    for k in range(broken):
        suffix = ".parquet" if BROKEN[k].startswith(b"PAR1") else ".csv"
        (folder / "rig1" / f"bad{k:02}{suffix}").write_bytes(BROKEN[k])
    return folder


def make_job(tmp_path: Path, **parts: Any) -> fleet.Job:
    return fleet.Job(tmp_path / "logs", tmp_path / "out", RIG, Settings(), **parts)


def all_at_once(job: fleet.Job, names: dict[str, str]) -> fleet.Rows:
    """The fleet without a cluster."""
    return [fleet.work(job, log, name) for log, name in names.items()]


def state_of(folder: Path) -> dict[str, int]:
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}


# --- which logs, and which of them again ---------------------------------------------------------


def test_logs_are_found_to_the_depth_and_named_apart(tmp_path: Path) -> None:
    for name in (
        "b.csv",
        "a/b.csv",
        "a/b.parquet",
        "a/b.csv.gz",
        "a/c/d.TDMS",
        "a/c.csv",
        "a/.hid.csv",
        ".x/e.csv",
        "n.txt",
    ):
        path = tmp_path / "logs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    job = fleet.Job(tmp_path / "logs", tmp_path / "logs" / "reports", RIG, Settings())
    (job.out / "a").mkdir(parents=True)
    (job.out / "a" / "old.csv").write_text("x")
    names = fleet.find_logs(job)
    assert names == {
        "a/b.csv": "a/b", "a/b.csv.gz": "a/b.csv.gz.report", "a/b.parquet": "a/b.parquet.report",
        "a/c.csv": "a/c.csv.report", "a/c/d.TDMS": "a/c/d", "b.csv": "b", "n.txt": "n",
    }  # fmt: skip
    assert fleet.find_logs(job, "*.parquet") == {"a/b.parquet": "a/b.parquet.report"}


@pytest.mark.parametrize(
    "folder, pattern, message", [("none", "*", "no such folder"), (".", "*.xyz", "no logs")]
)
def test_no_logs_is_a_usage_error(tmp_path: Path, folder: str, pattern: str, message: str) -> None:
    job = fleet.Job(tmp_path / folder, tmp_path / "out", RIG, Settings())
    with pytest.raises(UsageError, match=message):
        fleet.find_logs(job, pattern)


def test_fleet_takes_every_file_that_diagnose_takes(tmp_path: Path) -> None:
    job = make_job(tmp_path)
    job.folder.mkdir()
    for suffix in SUFFIXES:
        (job.folder / f"log{suffix}").write_bytes(b"")
        with pytest.raises(InvalidLogError) as caught:  # empty, but of a known kind
            read_log(job.folder / f"log{suffix}")
        assert "unknown kind" not in str(caught.value)
    (job.folder / "log.xyz").write_bytes(b"")
    assert set(fleet.find_logs(job)) == {f"log{suffix}" for suffix in SUFFIXES}


@pytest.mark.slow
def test_only_what_changed_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_logs(tmp_path / "logs", 3, 2)
    job = make_job(tmp_path)
    names = fleet.find_logs(job)
    assert fleet.split(job, names) == ([], names)
    rows = all_at_once(job, names)
    again, todo = fleet.split(job, names)
    assert not todo
    assert fleet.worst_first(again) == fleet.worst_first(rows)  # a bad log is known to be bad

    changed = tmp_path / "logs" / "rig0" / "move000.csv"
    content = changed.read_bytes()
    changed.write_bytes(content + b"\n")
    assert list(fleet.split(job, names)[1]) == ["rig0/move000.csv"]
    changed.write_bytes(content)
    assert not fleet.split(job, names)[1]
    (job.out / "rig1" / "move001" / "report.html").unlink()
    (job.out / "rig0" / "move002" / "fleet.json").write_text("{")
    assert list(fleet.split(job, names)[1]) == ["rig0/move002.csv", "rig1/move001.csv"]

    for other in (
        replace(job, engine="filterpy"),
        replace(job, filter_kind="ukf"),
        replace(job, rig=with_values(RIG, {"A": 5e-4})),
        replace(job, settings=Settings(decision=replace(Settings().decision, isolated=0.9))),
    ):
        assert fleet.split(other, names)[1] == names
    monkeypatch.setattr(fleet, "__version__", "999")
    assert fleet.split(job, names)[1] == names


def test_another_pattern_overwrites_no_report_and_drops_no_row(tmp_path: Path) -> None:
    folder = make_logs(tmp_path / "logs", 2, 0)
    frame = pd.read_csv(folder / "rig0" / "move000.csv", comment="#")
    frame.to_parquet(folder / "rig0" / "move000.parquet")
    job = make_job(tmp_path)
    rows = all_at_once(job, fleet.find_logs(job, "*.csv"))
    before = (job.out / "rig0" / "move000" / "report.json").read_bytes()
    names = fleet.find_logs(job, "*.parquet")
    others = fleet.other_rows(job, names, "*.parquet")
    assert fleet.worst_first(others) == fleet.worst_first(rows)
    (row,) = all_at_once(job, names)
    assert row["report"] == "rig0/move000.parquet.report/report.html"
    assert (job.out / "rig0" / "move000" / "report.json").read_bytes() == before
    fleet.write_summary(job, [row, *others])
    assert len(pq.read_table(job.out / "fleet.parquet")) == 3


def test_the_summary_of_another_folder_is_not_replaced(tmp_path: Path) -> None:
    job = make_job(tmp_path)
    (tmp_path / "logs").mkdir()
    fleet.write_summary(job, [fleet.bad_row("a.csv", "bad", "empty")])
    fleet.check_summary(job)
    (tmp_path / "others").mkdir()
    with pytest.raises(UsageError, match="holds the fleet of .*logs"):
        fleet.check_summary(replace(job, folder=tmp_path / "others"))


def test_reports_may_lie_among_the_logs(tmp_path: Path) -> None:
    """--out at the logs' own folder, or above it: what was written is no log, and nobody's file is touched."""
    folder = make_logs(tmp_path / "logs", 1, 0)
    (folder / "rig0" / "move000").mkdir()
    (folder / "rig0" / "move000" / "raw.bin").write_text("mine")
    for out in (folder, tmp_path):
        job = fleet.Job(folder, out, RIG, Settings())
        for _ in range(2):
            names = fleet.find_logs(job)
            assert list(names) == ["rig0/move000.csv"]
            fleet.write_summary(job, all_at_once(job, names))
    assert (folder / "rig0" / "move000" / "raw.bin").read_text() == "mine"


def test_a_log_that_turns_bad_keeps_its_earlier_report(tmp_path: Path) -> None:
    folder = make_logs(tmp_path / "logs", 1, 0)
    job = make_job(tmp_path)
    names = fleet.find_logs(job)
    all_at_once(job, names)
    (folder / "rig0" / "move000.csv").write_text("")
    (row,) = all_at_once(job, names)
    assert row["status"] == "bad" and (job.out / "rig0" / "move000" / "report.html").is_file()
    assert fleet.split(job, names) == ([row], {})  # known to be bad until it changes


def test_hostile_names_are_logs_like_others(tmp_path: Path) -> None:
    folder = make_logs(tmp_path / "logs", 1, 0)
    content = (folder / "rig0" / "move000.csv").read_bytes()
    odd = (b"..csv", b"x" * 246 + b".csv", b"fleet.parquet.csv", b"a\nb\x1b[31m.csv")
    for name in odd:
        (folder / os.fsdecode(name)).write_bytes(content)
    (folder / "folder.csv").mkdir()
    os.mkfifo(folder / "pipe.lvm")
    (folder / "gone.csv").symlink_to(tmp_path / "nowhere.csv")
    job = make_job(tmp_path)
    names = {log: name for log, name in fleet.find_logs(job).items() if log not in ("pipe.lvm", "gone.csv")}
    rows = all_at_once(job, names)
    assert len(rows) == len(odd) and all(row["status"] == "done" for row in rows)
    assert fleet.digest_of(folder / "pipe.lvm") == ""
    fleet.write_summary(job, rows)
    assert all((job.out / row["report"]).is_file() for row in rows)
    assert not fleet.split(job, names)[1]


def test_a_folder_that_cannot_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = make_logs(tmp_path / "logs", 2, 0)
    real = os.scandir

    def scandir(path: Any) -> Any:
        if str(path).endswith("rig1"):
            raise PermissionError(13, "Permission denied", str(path))
        return real(path)

    monkeypatch.setattr(os, "scandir", scandir)
    said: list[str] = []
    assert list(fleet.find_logs(fleet.Job(folder, tmp_path / "out", RIG, Settings()), say=said.append)) == [
        "rig0/move000.csv"
    ]
    assert len(said) == 1 and "rig1: cannot read this folder (Permission denied)" in said[0]


# --- the summary ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[fleet.Job, fleet.Rows]:
    """Six good logs and ten bad ones."""
    folder = tmp_path_factory.mktemp("fleet")
    make_logs(folder / "logs", 6, len(BROKEN))
    job = make_job(folder)
    rows = all_at_once(job, fleet.find_logs(job))
    rows.append(fleet.bad_row("rig0/gone.csv", "failed", "KilledWorker <b>"))
    fleet.write_summary(job, rows)
    return job, rows


def test_rows_say_what_the_reports_say(judged: tuple[fleet.Job, fleet.Rows]) -> None:
    job, rows = judged
    done = [row for row in rows if row["status"] == "done"]
    for row in done:
        found = json.loads((job.out / row["report"]).with_name("report.json").read_text())
        assert found["verdict"]["label"] == row["label"]
        assert found["log"]["path"] == row["log"] and found["log"]["sha256"] == row["sha256"]
    expected = {
        f"rig{k % 2}/move{k:03}.csv": ("nominal", "overload", "coupling_loss")[k % 3] for k in range(6)
    }
    assert {row["log"]: row["label"] for row in done} == expected


def test_bad_logs_are_listed_with_their_reason(judged: tuple[fleet.Job, fleet.Rows]) -> None:
    _, rows = judged
    bad = [row for row in rows if row["status"] == "bad"]
    assert len(bad) == len(BROKEN)
    assert all(row["error"] and "\n" not in row["error"] for row in bad)
    assert len(fleet.problems(rows)) == len(BROKEN) + 1


def test_worst_comes_first(judged: tuple[fleet.Job, fleet.Rows]) -> None:
    rows = fleet.worst_first(judged[1])
    assert [row["label"] for row in rows[:4]] == ["coupling_loss"] * 2 + ["overload"] * 2
    assert {row["status"] for row in rows[4:-2]} == {"bad", "failed"}
    assert [row["label"] for row in rows[-2:]] == ["nominal"] * 2
    ratios = [row["nis_ratio"] for row in rows[-2:]]
    assert ratios == sorted(ratios, reverse=True)


def test_parquet_holds_the_rows(judged: tuple[fleet.Job, fleet.Rows]) -> None:
    job, rows = judged
    table = pq.read_table(job.out / "fleet.parquet")
    assert table.column_names == list(fleet.COLUMNS)
    assert table.to_pylist() == fleet.worst_first(rows)


def test_index_needs_no_network_and_its_links_lead_somewhere(judged: tuple[fleet.Job, fleet.Rows]) -> None:
    job, rows = judged
    html = (job.out / "index.html").read_text(encoding="utf-8")
    assert 'src="' not in html and not re.search(r'(href="|url\()["\']?(http|//)', html)
    assert html.count("<tr data-what") == len(rows)
    links = re.findall(r'<a href="([^"]+)"', html)
    assert len(links) == 6 and all((job.out / link).is_file() for link in links)
    assert "KilledWorker &lt;b&gt;" in html
    assert html == fleet.page(job, fleet.worst_first(rows))  # the same bytes for the same rows


def test_summary_pipeline_runs(
    judged: tuple[fleet.Job, fleet.Rows], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet_summary.main([str(judged[0].out / "fleet.parquet")]) == 0
    printed = capsys.readouterr().out
    assert "coupling_loss" in printed and "rig1" in printed


# --- on a cluster --------------------------------------------------------------------------------


Processes = list[subprocess.Popen[bytes]]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, Processes]]:
    """A scheduler and two workers, each a process of its own on the loopback address."""
    known = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    local = ["--scheduler-file", str(known), "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *local], **quiet)
    workers: Processes = []
    try:
        wait_for(known.is_file)
        wait_for(lambda: known.stat().st_size > 0)
        command = [*dask, "worker", *local, "--nthreads", "1", "--no-nanny", "--host", "127.0.0.1"]
        workers += [
            subprocess.Popen([*command, "--local-directory", str(tmp_path)], **quiet) for _ in range(2)
        ]
        yield json.loads(known.read_text())["address"], workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def wait_for(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.05)


def run_and_kill(job: fleet.Job, good: int, broken: int, address: str, workers: Processes) -> None:
    """A fleet over which a worker dies half-way, then the same fleet again."""
    names = fleet.find_logs(job)
    assert len(names) == good + broken
    rows = []
    for k, row in enumerate(fleet.run(job, names, scheduler=address)):
        if k == (good + broken) // 2:
            workers[0].send_signal(signal.SIGKILL)
        rows.append(row)
    assert workers[0].wait(timeout=10) == -signal.SIGKILL
    assert sorted(row["log"] for row in rows) == list(names)
    assert sum(row["status"] == "done" for row in rows) == good
    assert sum(row["status"] == "bad" for row in rows) == broken
    assert not list(job.out.rglob("*.part"))  # nothing half-written
    fleet.write_summary(job, rows)

    before = state_of(job.out)
    again, todo = fleet.split(job, names)
    assert not todo and fleet.worst_first(again) == fleet.worst_first(rows)
    assert not list(fleet.run(job, todo, scheduler="tcp://127.0.0.1:1"))  # nobody is asked
    assert state_of(job.out) == before


@pytest.mark.slow
@pytest.mark.study
def test_a_worker_is_killed_and_a_second_run_does_nothing(
    tmp_path: Path, cluster: tuple[str, Processes]
) -> None:
    make_logs(tmp_path / "logs", 12, 10)
    run_and_kill(make_job(tmp_path), 12, 10, *cluster)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("whole", [50, 190])
def test_many_logs_ten_of_them_broken(whole: int, tmp_path: Path, cluster: tuple[str, Processes]) -> None:
    make_logs(tmp_path / "logs", whole, 10)
    run_and_kill(make_job(tmp_path), whole, 10, *cluster)


@pytest.mark.slow
def test_a_log_that_no_worker_can_do_is_tried_again(tmp_path: Path, cluster: tuple[str, Processes]) -> None:
    make_logs(tmp_path / "logs", 2, 0)
    job = make_job(tmp_path)
    names = fleet.find_logs(job)
    (tmp_path / "logs" / "rig0" / "move000.csv").unlink()  # gone before a worker opens it
    rows = fleet.worst_first(list(fleet.run(job, names, scheduler=cluster[0])))
    assert {row["log"]: row["status"] for row in rows} == {
        "rig0/move000.csv": "failed",
        "rig1/move001.csv": "done",
    }
    (failed,) = [row for row in rows if row["status"] == "failed"]
    assert "shared folder" in failed["error"]
    assert list(fleet.split(job, names)[1]) == ["rig0/move000.csv"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "gone", ["scheduler", pytest.param("workers", marks=[pytest.mark.slow, pytest.mark.study])]
)  # waits a minute
def test_a_cluster_that_dies_leaves_what_is_done_and_resumes(
    gone: str, tmp_path: Path, cluster: tuple[str, Processes], monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    make_logs(tmp_path / "logs", 12, 0)
    address, workers = cluster
    monkeypatch.setattr(fleet, "WAIT_S", 60.0)  # a busy machine is slow to start
    real, seen = fleet._finished, []

    def finished(client: Any, under_way: Any) -> Iterator[Any]:
        for future in real(client, under_way):
            yield future
            seen.append(future)
            if len(seen) == 3:
                monkeypatch.setattr(fleet, "WAIT_S", 5.0)  # nobody comes back
                for process in [cluster_scheduler(address)] if gone == "scheduler" else workers:
                    os.kill(process if isinstance(process, int) else process.pid, signal.SIGKILL)

    monkeypatch.setattr(fleet, "_finished", finished)
    words = ["fleet", str(tmp_path / "logs"), "--out", str(tmp_path / "out")]
    assert main([*words, "--scheduler", address]) == 1
    said = capsys.readouterr()
    assert len(said.err.splitlines()) == 1 and "run the same command again" in said.err
    rows = pq.read_table(tmp_path / "out" / "fleet.parquet").to_pylist()
    assert len(rows) == 12 and 3 <= sum(row["status"] == "done" for row in rows) < 12
    job = make_job(tmp_path)
    assert len(fleet.split(job, fleet.find_logs(job))[0]) >= 3  # they are not done again


@pytest.mark.parametrize(
    ("status", "error", "said"),
    [
        ("finished", ConnectionResetError("reset"), LostClusterError),
        ("finished", CancelledError(), LostClusterError),
        ("cancelled", None, LostClusterError),
        ("finished", TimeoutError("late"), fleet._NotThereError),
        ("lost", None, fleet._NotThereError),
        ("pending", None, fleet._NotThereError),
    ],
)
def test_a_result_that_cannot_be_fetched(status: str, error: Exception | None, said: type[Exception]) -> None:
    """A log may be done just before its scheduler or its worker dies: its row is still on the worker then."""
    with pytest.raises(said):
        fleet._result_of(Held(status, error))


class Held:
    """A future as dask gives it: with a row, or with the error that asking for it ends in."""

    def __init__(self, status: str, error: Exception | None) -> None:
        self.status, self.error = status, error

    def exception(self, timeout: float) -> None:
        return None

    def result(self, timeout: float) -> str:
        if self.error is not None:
            raise self.error
        return "row"


def test_a_row_that_went_with_its_worker_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scheduler lives on and gives the log to another worker: no cluster is lost."""
    monkeypatch.setattr(fleet, "_missing", lambda _: "")
    monkeypatch.setattr(fleet, "POLL_S", 0.0)
    lost = Held("lost", None)

    class UnderWay:
        def __init__(self) -> None:
            self.ready = [Held("finished", None), lost]

        def is_empty(self) -> bool:
            return not self.ready

        def has_ready(self) -> bool:
            return bool(self.ready)

        def __next__(self) -> Held:
            return self.ready.pop(0)

        def add(self, future: Held) -> None:
            future.status = "finished"  # another worker did it
            self.ready.append(future)

    found = list(fleet._finished(None, UnderWay()))
    assert [row for _, row in found] == ["row", "row"] and found[-1][0] is lost


@pytest.mark.slow
def test_rows_that_wait_on_a_worker_that_dies_are_made_again(cluster: tuple[str, Processes]) -> None:
    """Rows are asked for one by one, and a quick fleet has most of them ready by then."""
    address, workers = cluster
    items = {str(k): (k,) for k in range(60)}
    rows = {}
    for name, row in fleet.spread(operator.add, 1, items, 2, address):
        if not rows:
            time.sleep(1.0)  # both workers are done, and hold half of the rows each
            workers[0].send_signal(signal.SIGKILL)
        rows[name] = row
    assert rows == {str(k): k + 1 for k in range(60)}


def test_trend_on_a_cluster_that_is_lost_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_logs(tmp_path / "logs", 3, 0)

    def lost(*_: Any) -> Iterator[Any]:
        raise LostClusterError("the last worker is gone")
        yield

    monkeypatch.setattr(digests, "ALONE", 0)
    monkeypatch.setattr(digests, "spread", lost)
    assert main(["trend", str(tmp_path / "logs"), "--out", str(tmp_path / "out"), "--workers", "2"]) == 1
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and "the last worker is gone: run the same command again" in said


def cluster_scheduler(address: str) -> int:
    """The process that listens on a port of this machine."""
    port = f":{int(address.rsplit(':', 1)[1]):04X}"
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    inode = next(line[9] for line in lines if line[1].endswith(port) and line[3] == "0A")
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            if os.readlink(link) == f"socket:[{inode}]":
                return int(link.parts[2])
    raise AssertionError(f"nobody listens on {address}")


@pytest.mark.slow
def test_command_on_local_workers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_logs(tmp_path / "logs", 2, 1)
    arguments = ["fleet", str(tmp_path / "logs"), "--out", str(tmp_path / "out"), "--workers", "1"]
    run = subprocess.run(
        [sys.executable, "-m", "observer_fi", *arguments], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 2  # one log cannot be read
    assert len(run.stderr.splitlines()) == 1 and "the file is empty" in run.stderr
    assert "3 logs: 1 overload, 1 bad, 1 nominal; 3 read now" in run.stdout
    (tmp_path / "logs" / "rig1" / "bad00.csv").unlink()
    assert main([*arguments, "--json", "--fail-on-fault"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert found["read"] == 0 and [row["label"] for row in found["logs"]] == ["overload", "nominal"]


def test_no_dask_and_no_scheduler_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = make_job(tmp_path)
    monkeypatch.setattr(fleet, "WAIT_S", 0.5)
    with pytest.raises(UsageError, match="no scheduler with a worker answers there"):
        list(fleet.run(job, {"a.csv": "a"}, scheduler="tcp://127.0.0.1:1"))
    monkeypatch.setitem(sys.modules, "dask", None)
    with pytest.raises(UsageError, match=re.escape("pip install 'observer-fi[fleet]'")):
        list(fleet.run(job, {"a.csv": "a"}))
