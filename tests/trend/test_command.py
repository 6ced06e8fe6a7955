"""`observer-fi trend`: keys of the contract, resuming, order, bad input, many logs at once."""

import csv
import json

import numpy as np
import pandas as pd
import pytest
from trend_logs import cycle_frame

from observer_fi.cli import main
from observer_fi.serve import digests as digests_room


def written(folder, count, first=1, **given):
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(first, first + count):
        cycle_frame(seed=k, **given).to_csv(folder / f"cycle{k}.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def life(tmp_path_factory):
    """Twelve healthy cycles, then eight with more friction."""
    folder = written(tmp_path_factory.mktemp("life") / "logs", 12)
    return written(folder, 8, first=13, friction=1.1)


def run(capsys, *words):
    code = main(["trend", *map(str, words)])
    return code, *capsys.readouterr()


def test_json_has_the_keys_of_the_contract(life, tmp_path, capsys):
    code, out, err = run(capsys, life, "--out", tmp_path, "--workers", 1, "--json", "--limit", "friction=1.5")
    assert code == 0 and err == ""
    found = json.loads(out)
    assert found["schema"] == "observer-fi/trend/1" and found["false_alarm_rate"] == 0.001
    assert found["baseline"]["logs"] == 8  # the first third of twenty, but at least eight
    assert set(found["baseline"]["parameters"]["A"]) == {"value", "scatter", "unit"}
    logs = {log["path"].rpartition("/")[2]: log for log in found["logs"]}
    assert list(logs) == [f"cycle{k}.csv" for k in range(1, 21)]  # by name, numbers by value
    assert {"path", "time", "verdict", "score", "parameters", "changed"} <= set(logs["cycle1.csv"])
    assert logs["cycle1.csv"]["verdict"] == "unchanged" and logs["cycle20.csv"]["verdict"] == "changed"
    (moved, *_) = logs["cycle20.csv"]["changed"]
    assert set(moved) == {"name", "cause", "from", "to", "std", "unit"} and moved["name"] == "A"
    assert moved["from"] == pytest.approx(0.9, abs=0.02) and moved["to"] == pytest.approx(1.1, abs=0.02)
    (change, *_) = found["changes"]
    assert {"kind", "since", "cause", "equation", "size", "std", "unit", "rivals"} <= set(change)
    assert change["kind"] == "step" and change["since"].endswith("cycle13.csv")
    assert change["size"] == pytest.approx(0.2, abs=0.03)
    assert found["ahead"][0]["reached"] is None  # a step is no drift
    folder = tmp_path / "logs"
    assert json.loads((folder / "trend.json").read_text()) == found
    rows = list(csv.DictReader((folder / "trend.csv").read_text().splitlines()))
    assert (
        len(rows) == 20
        and rows[-1]["verdict"] == "changed"
        and float(rows[0]["A [N m]"]) == pytest.approx(0.9, abs=0.02)
    )
    page = (folder / "trend.html").read_text()
    assert "cycle13.csv" in page and 'id="charts-lanes"' in page
    assert 'src="' not in page and 'href="http' not in page  # nothing comes from a network


def test_a_second_run_reads_no_log(life, tmp_path, capsys, monkeypatch):
    assert run(capsys, life, "--out", tmp_path, "--workers", 1)[0] == 0
    first = (tmp_path / "logs" / "trend.json").read_bytes()

    def never(*words):
        raise AssertionError("a log was read again")

    monkeypatch.setattr(digests_room, "read_log", never)
    assert run(capsys, life, "--out", tmp_path, "--workers", 1)[0] == 0
    assert (tmp_path / "logs" / "trend.json").read_bytes() == first


def test_healthy_logs_that_were_given_are_the_baseline(life, tmp_path, capsys):
    healthy = written(tmp_path / "healthy", 10, first=50)
    words = (
        life / "cycle20.csv",
        "--baseline-logs",
        healthy,
        "--out",
        tmp_path / "out",
        "--workers",
        1,
        "--json",
    )
    code, out, _ = run(capsys, *words)
    found = json.loads(out)
    assert code == 0 and found["baseline"]["logs"] == 10 and len(found["logs"]) == 1
    assert found["logs"][0]["verdict"] == "changed"


def test_a_bad_log_stops_no_other_and_is_told_in_one_line(life, tmp_path, capsys):
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,current_a,position_m\n0,a,b\n")
    code, out, err = run(capsys, life, bad, "--out", tmp_path, "--workers", 1)
    assert code == 2 and "of 20 logs changed" in out
    assert err.count("\n") == 1 and "bad.csv" in err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--false-alarm-rate", "2"), "share of logs"),
        (("--limit", "friction"), "NAME=VALUE"),
        (("--limit", "wear=1"), "--limit wear"),
        (("--baseline", "emps", "--baseline-logs", "x.csv"), "give one of them"),
        (("--baseline-logs", "none.csv"), "none.csv"),
    ],
)
def test_bad_usage_is_one_line(life, tmp_path, capsys, words, told):
    try:
        code, _, err = run(capsys, life, "--out", tmp_path / "out", "--workers", 1, *words)
    except SystemExit as stop:
        code, err = stop.code, capsys.readouterr().err
    assert code == 2 and told in err
    assert not (tmp_path / "out" / "logs").exists()


def test_an_empty_folder_and_a_still_log_are_told(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    code, _, err = run(capsys, tmp_path / "empty", "--out", tmp_path / "out")
    assert code == 2 and "no logs" in err
    still = pd.DataFrame({"time_s": 0.04 * np.arange(200), "current_a": 0.0, "position_m": 0.0})
    still.to_csv(tmp_path / "still.csv", index=False)
    code, _, err = run(capsys, tmp_path / "still.csv", "--out", tmp_path / "out")
    assert code == 2 and "does not move" in err


@pytest.mark.slow
def test_many_logs_go_to_several_processes_and_say_the_same(life, tmp_path, capsys):
    pytest.importorskip("distributed")
    assert run(capsys, life, "--out", tmp_path / "one", "--workers", 1)[0] == 0
    assert run(capsys, life, "--out", tmp_path / "two", "--workers", 2)[0] == 0
    one, two = ((tmp_path / n / "logs" / "trend.json").read_text() for n in ("one", "two"))
    assert one == two
