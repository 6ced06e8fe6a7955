"""watch: the numbers of a whole log, sample for sample, whatever the stream does."""

import gc
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from functools import cache
from pathlib import Path

import hidden
import numpy as np
import pytest
import scenarios
from campaigns import LOOP, behind_a_loop
from fuzz import watch_streams

from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank import log_feed as feed
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.columns import PLAIN, ColumnMap, Source
from observer_fi.logs.ingest import load_columns, open_log
from observer_fi.physics.rigs import commanded, load_rig, override
from observer_fi.physics.scenario import Fault, Move, Scenario, csv_bytes, synthesise
from observer_fi.records import Estimate, Event, Log
from observer_fi.serve import watch
from observer_fi.serve.live import Change, Live, Row
from observer_fi.serve.live import rows_of as part_of
from observer_fi.serve.watch import Options, Watch, posterior
from observer_fi.settings import Settings
from observer_fi.verdict import AsLogged, isolate
from observer_fi.verdict import diagnosis as diagnose

RIG, SETTINGS = load_rig(), Settings()
TWO_MOVES = (Move(0.2, 410.0, 0.6), Move(1.1, -300.0, 0.6))
EXACT = 1e-11  # same instructions whatever the chunks; at each call probabilities are rebuilt from their logs


@cache
def sample_log(kind: str = "coupling_loss", channel: str | None = None, seed: int = 3) -> Log:
    """Two moves; the fault in the second."""
    fault = Fault() if kind == "none" else Fault(kind, 1.4, channel)
    return synthesise(Scenario(TWO_MOVES, 2.0, fault=fault, seed=seed), RIG)[0]


def csv_lines(log: Log) -> list[str]:
    return csv_bytes(log).decode().splitlines(keepends=True)


def rows_of(log: Log) -> list[Row]:
    table = np.column_stack((log.t, log.z, log.pitch, log.w_cmd))
    return [Row(*values) for values in table.tolist()]


def fed(data: list[bytes], options: Options | None = None) -> tuple[list[dict], list[str]]:
    """Lines of output, and what was said, for pieces of a stream."""
    out, said = io.StringIO(), []
    flow = Watch(options or Options(RIG, SETTINGS), "stream", out, said.append)
    for piece in data:
        flow.take(piece)
    flow.finish("the stream ended")
    return [json.loads(line) for line in out.getvalue().splitlines()], said


@pytest.mark.parametrize("pitch", [True, False])
def test_a_stream_says_whether_it_has_a_pitch(pitch: bool) -> None:
    lines = [line for line in csv_lines(sample_log()) if not line.startswith("#")]
    head = lines[0].rstrip("\n").split(",")
    kept = [k for k, name in enumerate(head) if pitch or name != "pitch_deg"]
    flow = Watch(Options(RIG, SETTINGS), "stream", io.StringIO(), lambda text: None)
    flow.take(
        "".join(
            ",".join(np.array(line.rstrip("\n").split(","))[kept]) + "\n" for line in lines[:200]
        ).encode()
    )
    assert flow.live.without_pitch is (None if pitch else RIG)


def posteriors(lines: list[dict]) -> np.ndarray:
    return np.array([list(line["posterior"].values()) for line in lines if line["event"] == "sample"])


def told(line: dict) -> tuple:
    """A line without its probabilities."""
    return tuple(
        line.get(key) for key in ("event", "time_s", "label", "channel", "since_s", "samples", "move")
    )


def offline(log: Log) -> tuple[np.ndarray, Estimate]:
    """Posterior by label of every sample of a whole log."""
    e = isolate.tested(kernels.Bank(RIG, SETTINGS.bank).advance(log), SETTINGS.decision)
    return np.array([list(posterior(e.modes, p).values()) for p in e.probability]), e


def read_back(path: Path, columns: Path | None = None) -> list[Log]:
    return list(open_log(path, load_columns(columns) if columns else None).chunks())


class Nowhere(io.StringIO):
    """Output that is not kept."""

    def write(self, text: str) -> int:
        return len(text)


# --- the same numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [{}, {"input_delay": 0.0041}, {"accel_limit": 3e4}])
def test_the_command_is_the_same_sample_by_sample(effects: dict[str, float]) -> None:
    log = sample_log()
    model = override(RIG.model, "late", **effects)
    whole, by_one = feed.CommandStream(model, 2e-4), feed.CommandStream(model, 2e-4)
    w, interval = whole.intervals(log.t, log.w_cmd)
    first = feed.SETTLING + 1
    parts = [by_one.intervals(log.t[:first], log.w_cmd[:first])]
    parts += [by_one.intervals(log.t[k : k + 1], log.w_cmd[k : k + 1]) for k in range(first, log.t.size)]
    assert np.array_equal(w, np.concatenate([p[0] for p in parts]))
    assert np.array_equal(interval, np.concatenate([p[1] for p in parts]))


def test_the_command_between_samples_is_the_trapezoid() -> None:
    """Oracle: with substeps the half-steps lie on the commanded trapezoid, corners inside intervals included."""
    t = np.arange(800) / 1600.0
    accel = RIG.model["accel_cmd"]

    def trapezoid(at: np.ndarray) -> np.ndarray:
        return np.clip(np.minimum(accel * (at - 0.10031), accel * (0.3007 - at) + 410.0), 0.0, 410.0)

    _, interval = feed.CommandStream(RIG.model, 7e-4).intervals(t, trapezoid(t))
    fine = np.linspace(t[:-1], t[1:], 401, axis=1)
    area = np.trapezoid(trapezoid(fine), fine, axis=1)
    simpson = np.diff(t) / 6.0 * (interval[1:, 0] + 4.0 * interval[1:, 1] + trapezoid(t[1:]))
    assert np.allclose(simpson, area, atol=2e-4)  # the area of a corner between two points of the fine grid


@pytest.mark.parametrize(
    "kind, channel", [("none", None), ("coupling_loss", None), ("sensor_frozen", "current")]
)
@pytest.mark.parametrize("batch", [1, 7, 10_000])
@pytest.mark.first(1, 3)
def test_live_posterior_is_the_offline_posterior(kind: str, channel: str | None, batch: int) -> None:
    log = sample_log(kind, channel)
    expected, e = offline(log)
    live, rows = Live(RIG, SETTINGS), rows_of(log)
    found = [
        np.array([list(posterior(part.modes, p).values()) for p in part.probability])
        for k in range(0, len(rows), batch)
        for part, _ in live.add(rows[k : k + batch])
    ]
    assert np.allclose(np.vstack(found), expected, rtol=0.0, atol=EXACT)
    verdict = diagnose.diagnose_log(log, RIG, SETTINGS).isolation
    assert verdict is not None
    assert (live.verdict().label, live.verdict().channel) == verdict.events[-1][:2]
    assert live.verdict().isolated_s == verdict.events[-1].isolated_s


@pytest.mark.parametrize("filter_kind, engine", [("ukf", "compiled"), ("ekf", "filterpy")])
def test_other_filters_stream_too(filter_kind: str, engine: str) -> None:
    log = sample_log()
    log = log.part(slice(250, 500))  # from the last of the rest into the move
    live = Live(RIG, SETTINGS, engine, filter_kind)
    parts = [p for row in rows_of(log) for p, _ in live.add([row])]
    if engine == "compiled":
        whole = kernels.Bank(RIG, SETTINGS.bank, filter_kind=filter_kind).advance(log)
    else:
        whole = diagnose.make_bank(RIG, SETTINGS, engine, filter_kind).advance(log)
    expected = isolate.tested(whole, SETTINGS.decision).probability[-1]
    assert np.allclose(parts[-1].probability[-1], expected, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_output_does_not_depend_on_how_the_bytes_come() -> None:
    data = csv_bytes(sample_log())
    options = Options(RIG, SETTINGS, every=50)
    whole, _ = fed([data], options)
    for size in (1 << 16, 4099, 61):
        pieces = [data[k : k + size] for k in range(0, len(data), size)]
        found, _ = fed(pieces, options)
        assert [told(line) for line in found] == [told(line) for line in whole]
        assert np.allclose(posteriors(found), posteriors(whole), rtol=0.0, atol=EXACT)
    labels = [line["label"] for line in whole if line["event"] == "verdict"]
    assert labels == ["nominal", "coupling_loss"]
    assert whole[-1]["event"] == "end" and whole[-1]["label"] == "coupling_loss"


ODD_LINES = (
    "0.3,12.0,broken,0.1,0,410", "0.5;1", "\x00\xff", "", "   ", "# a comment", "1,2,3", "0.3,,,,,", ",,,,,", "\r",
    "{t},1,,0.1,0,", "{t},1,0.5,0.1,,410", "{t},nan(1),0.5,0.1,0,0", '"{t}",1,2,0.1,0,0', "nan,1,0.5,0.1,0,410",
    "{t},1e9,-inf,+0.1,0,0", "{t},1,0.5\r3,0.1,0,0", "{t},1_0,0.5,0.1,0,0", "-1,0,0,0,0,0", "{t},1,1,0.1,0,410\r",
    "time_s,voltage_v,current_a,position_m,pitch_deg,speed_cmd_rad_s", "{t},1,,0.1,0,410", "{t},,0.5,0.1,0,0",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 8])
@pytest.mark.first(2)
def test_blocks_of_lines_say_what_lines_say(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Odd lines at random places, a clock that jumps back, random pieces: byte for byte the same output."""
    rng = np.random.default_rng(seed)
    lines = [line.rstrip("\n") for line in csv_lines(sample_log("coupling_loss"))]
    lines += lines[2 + int(rng.integers(1000)) :]
    for _ in range(int(rng.integers(1, 30))):
        k = int(rng.integers(2, len(lines)))
        odd = ODD_LINES[int(rng.integers(len(ODD_LINES)))]
        lines.insert(k, odd.replace("{t}", lines[k - 1].split(",")[0] + "3"))
    if seed % 3 == 1:  # tabs, and the current at the end of the line, where it may be empty
        lines = ["\t".join(f[:2] + f[3:] + f[2:3]) for f in (line.split(",") for line in lines)]
    text = ("\r\n" if seed % 2 else "\n").join(lines)
    if seed % 3 == 2:
        text = text.replace(",", ";").replace(".", ",")
    data = text.encode("latin-1")
    cuts = [0, *np.sort(rng.integers(0, len(data), 12)).tolist(), len(data)]
    pieces = [data[a:b] for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    options = Options(RIG, SETTINGS, every=7)
    at_once = fed(pieces, options)
    monkeypatch.setattr(watch, "FEW_BYTES", 1 << 30)
    assert fed(pieces, options) == at_once


@pytest.mark.slow
def test_blocks_of_lines_go_through_a_column_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """Units, limits, a column of text, no pitch, the first lines left out, and a number that stands for no value."""
    log = sample_log()
    rows = zip((1e3 * log.t).tolist(), log.z.tolist(), log.w_cmd.tolist(), strict=True)
    text = "ms\tok\tU\tI\tx\tw\n" + "".join(
        f"{t!r}\t(fine)\t{u!r}\t{1e3 * i!r}\t{-999 if k % 50 == 0 else x!r}\t{w!r}\n"
        for k, (t, (u, i, x), w) in enumerate(rows)
    )
    columns = {"time_s": Source("ms", 1e-3), "voltage_v": Source("U"), "current_a": Source("I", 1e-3)}
    columns |= {"position_m": Source("x"), "speed_cmd_rad_s": Source("w")}
    for missing in ((), ("-999",)):
        column_map = ColumnMap(columns, data_line=40, missing=missing, limits={"current_a": 0.9})
        plain_text = text.replace("(fine)", "fine").encode()
        found = [
            fed([data], Options(RIG, SETTINGS, column_map, every=9))[0]
            for data in (plain_text, text.encode())
        ]
        with monkeypatch.context() as patch:
            patch.setattr(watch, "FEW_BYTES", 1 << 30)
            assert found == [fed([plain_text], Options(RIG, SETTINGS, column_map, every=9))[0]] * 2
        assert found[0][-1]["samples"] == log.t.size - 38


def test_a_number_that_stands_for_no_value_is_none() -> None:
    """Under `missing`, whatever else the line holds: as in a file."""
    lines = csv_lines(sample_log())
    coded = [
        line if k < 2 or k % 9 else ",".join([*line.split(",")[:3], "-999", *line.split(",")[4:]])
        for k, line in enumerate(lines)
    ]
    empty = [line.replace("-999", "") for line in coded]
    found, _ = fed(["".join(coded).encode()], Options(RIG, SETTINGS, ColumnMap(missing=("-999",)), every=9))
    assert found == fed(["".join(empty).encode()], Options(RIG, SETTINGS, every=9))[0]


@pytest.mark.slow
def test_verdicts_change_at_the_same_sample_whatever_the_batches() -> None:
    """One estimate, cut in many ways: readings that come and go, so that verdicts do too."""
    rng = np.random.default_rng(5)
    for kind, channel in (
        ("none", None),
        ("overload", None),
        ("sensor_frozen", "current"),
        ("sensor_gain", "position"),
    ):
        log = sample_log(kind, channel)
        z = log.z.copy()
        first = int(rng.integers(500, 2500))
        z[first : first + int(rng.integers(20, 400)), int(rng.integers(3))] *= rng.uniform(-1.0, 2.0)
        e = kernels.Bank(RIG, SETTINGS.bank).advance(Log("spoilt", log.t, z, log.w_cmd, log.pitch))
        assert (
            changes_of(e, [9, *[1] * 3191])
            == changes_of(e, [9, 1000, 2191])
            == changes_of(e, [9, 500, 1, 37, 2653])
        )


def changes_of(e: Estimate, sizes: list[int]) -> tuple[list[Change], Event]:
    """The changes of the verdict, and the last one, for an estimate in pieces."""
    live, ends = Live(RIG, SETTINGS), np.cumsum(sizes).tolist()
    changes = [live._judged(part_of(e, a, b))[1] for a, b in zip([0, *ends], ends, strict=False)]
    assert live.samples == e.t.size
    return [change for some in changes for change in some], live.verdict()


def test_json_lines_say_what_csv_says() -> None:
    log = sample_log()
    names = ("time_s", "voltage_v", "current_a", "position_m", "pitch_deg", "speed_cmd_rad_s")
    table = np.column_stack((log.t, log.z, log.pitch, log.w_cmd)).tolist()
    objects = "".join(json.dumps(dict(zip(names, row, strict=True))) + "\n" for row in table)
    texts = ",".join(names) + "\n" + "".join(",".join(map(repr, row)) + "\n" for row in table)
    assert fed([objects.encode()])[0] == fed([texts.encode()])[0]


USABLE = [s for s in scenarios.SCENARIOS if not s.error]


@pytest.mark.parametrize("scenario", USABLE, ids=lambda s: s.name)
@pytest.mark.first(19, 31)
def test_spoilt_text_logs_stream_as_they_are_read(scenario: scenarios.Scenario, tmp_path: Path) -> None:
    path, columns = scenario.write(tmp_path), scenario.column_map(tmp_path)
    if path.suffix not in (".csv", ".txt", ".tsv", ".dat"):
        pytest.skip("no text")
    logs = read_back(path, columns)
    raw = path.read_bytes()
    if np.isnan(logs[0].w_cmd).any() or raw[:2] in (b"\xff\xfe", b"\xfe\xff") or raw[:2] == b"\x1f\x8b":
        pytest.skip("no command, or a coding that no stream has")
    bank = kernels.Bank(RIG, SETTINGS.bank)
    parts = [isolate.tested(bank.advance(log), SETTINGS.decision) for log in logs]
    expected = np.array([list(posterior(e.modes, p).values()) for e in parts for p in e.probability])
    column_map = load_columns(columns) if columns else PLAIN
    lines, _ = fed([raw], Options(RIG, SETTINGS, column_map, every=1))
    lines = [line for line in lines if line["event"] == "sample"]
    at = dict(zip(np.concatenate([e.t for e in parts]).tolist(), expected.tolist(), strict=True))
    # samples without a time, before the first and after the last that has one, are placed in a file only
    assert len(at) - 3 <= len(lines) <= len(at)
    if not AsLogged(logs[0], RIG, SETTINGS.bank).same_as(None, SETTINGS.bank):
        return  # a stream learns its logger as it goes: other numbers, of as many samples
    found = np.array([list(line["posterior"].values()) for line in lines])
    assert np.allclose(found, [at[line["time_s"]] for line in lines], rtol=0.0, atol=1e-9)


# --- what goes wrong -----------------------------------------------------------------------------


def test_broken_lines_are_skipped_and_named() -> None:
    lines = csv_lines(sample_log("none"))
    clean, _ = fed(["".join(lines).encode()])
    lines.insert(500, "0.3,12.0,broken,0.1,0,410\n")
    lines.insert(900, "0.5;1\n")
    lines.insert(1300, "\x00\xff\n")
    found, said = fed(["".join(lines).encode()])
    assert [s.split(": ")[1] for s in said] == ["line 501", "line 901", "line 1301"]
    assert "column current_a: 'broken' is not a number; skipped" in said[0]
    assert found[-1]["skipped"] == 3
    assert found[-1]["posterior"] == clean[-1]["posterior"]


def test_broken_json_is_skipped() -> None:
    names = ("time_s", "voltage_v", "current_a", "position_m", "speed_cmd_rad_s")
    rows = [dict(zip(names, (k / 1600, 0.0, 0.0, 0.0, 0.0), strict=True)) for k in range(100)]
    lines = [json.dumps(row) for row in rows]
    lines[50] = lines[50][:20]
    lines[60] = '{"time_s": 0.0375, "current_a": true}'
    lines[70] = "[1, 2]"
    found, said = fed([("\n".join(lines) + "\n").encode()])
    assert len(said) == 3 and found[-1]["samples"] == 97


def test_a_line_without_end_is_given_up() -> None:
    found, said = fed([csv_bytes(sample_log("none")), b"x" * 200_000, b"\n"])
    assert any("fields where the header has" in s for s in said)
    assert found[-1]["samples"] == sample_log("none").t.size


def test_one_time_astray_is_left_out_and_a_new_clock_starts_a_new_bank() -> None:
    first, second = csv_lines(sample_log("none")), csv_lines(sample_log("coupling_loss"))
    astray = first.copy()
    astray.insert(1000, "0.001,0,0,0,0,0\n")
    found, said = fed(["".join(astray).encode()])
    assert "restart" not in [line["event"] for line in found]
    assert len(said) == 1 and "is before" in said[0]
    found, said = fed(["".join(first + second[2:]).encode()])
    events = [(line["event"], line["label"]) for line in found]
    assert ("restart", "nominal") in events
    assert found[-1]["label"] == "coupling_loss" and found[-1]["move"] == 4
    assert any("clock jumped back from 1.999" in s for s in said)
    alone, _ = fed(["".join(second).encode()])
    assert found[-1]["posterior"] == alone[-1]["posterior"]


def test_a_second_header_is_a_new_writer() -> None:
    log = "".join(csv_lines(sample_log("none")))
    found, said = fed([(log + log).encode()])
    assert sum(line["event"] == "restart" for line in found) == 1
    assert any("header" in s for s in said)


@pytest.mark.parametrize(
    "text, message",
    [
        ("1,2,3\n", "holds numbers, not column names"),
        ("time_s,current_a\n", "position_m"),
        ("time_s,current_a,position_m\n", "speed_cmd_rad_s is missing; a stream needs it"),
        ('{"time_s": 0}\n', "current_a"),
        ("time_s,curr\rent_a,position_m\n", "line 1 is no header"),
    ],
)
def test_a_stream_that_cannot_be_used_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InvalidLogError, match=message):
        fed([text.encode()])


def test_an_empty_stream_has_a_last_verdict() -> None:
    found, _ = fed([b""])
    assert [line["event"] for line in found] == ["end"]
    assert (
        found[0]["time_s"] is None
        and (found[0]["label"], found[0]["probability"]) == ("not_tested", None)
        and found[0]["samples"] == 0
    )


def test_every_move_has_its_verdict_and_faults_are_counted() -> None:
    out = io.StringIO()
    flow = Watch(Options(RIG, SETTINGS), "stream", out, print)
    flow.take(csv_bytes(sample_log("overload")))
    assert flow.finish("done") is True
    assert flow.faulty == 1 and flow.moves == 2


@pytest.mark.study
@pytest.mark.slow
def test_eighty_moves_leave_no_object_behind() -> None:
    """What is held after 20 moves is what is held after 80, each of 1600 samples."""
    header, *lines = csv_lines(sample_log("none"))[1:]
    times, readings = zip(
        *((float(time), rest) for time, rest in (line.split(",", 1) for line in lines)), strict=True
    )
    flow = Watch(Options(RIG, SETTINGS), "stream", Nowhere(), print)
    flow.take(header.encode())

    def feed_two(turn: int) -> None:
        text = "".join(
            f"{t + 2.0 * turn:.7f},{rest}" for t, rest in zip(times, readings, strict=True)
        ).encode()
        for k in range(0, len(text), 1 << 16):
            flow.take(text[k : k + (1 << 16)])

    def held() -> np.ndarray:
        gc.collect()
        return np.array([len(gc.get_objects()), sys.getallocatedblocks()])

    for turn in range(10):
        feed_two(turn)
    before = held()
    for turn in range(10, 40):
        feed_two(turn)
    # less than an object a move; 300 blocks of text, caches of numba fill slowly
    assert (held() - before < (45, 700)).all()
    assert flow.live.moves == 80 and flow.live.samples == 40 * len(lines)


@pytest.mark.slow
@pytest.mark.parametrize("blocked", ["stdout", "stderr"])
def test_a_signal_ends_it_while_nobody_reads_what_it_writes(blocked: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = csv_lines(sample_log())
    path.write_text("".join(lines) if blocked == "stdout" else lines[1] + "a broken line\n" * 20_000)
    process = start_watch("--every", "1", "--follow", str(path))
    assert process.stdout is not None and process.stderr is not None
    process.stdout.read(1) if blocked == "stdout" else process.stderr.read(1)
    time.sleep(1.0)  # until the pipe is full
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=60) == 0
    process.stdout.close()
    process.stderr.close()


@pytest.mark.parametrize(
    "redirect, said",
    [
        ("> /dev/full", "standard output cannot be written (No space left on device)"),
        (">&-", "standard output is closed"),
        ("<&-", "standard input is closed"),
        ("--follow .", "not a plain file"),
    ],
)
def test_streams_that_cannot_be_used_are_one_line(redirect: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(csv_bytes(sample_log("none")))
    source = "" if "<" in redirect or "follow" in redirect else f"< {path}"
    ran = subprocess.run(
        f"{sys.executable} -m observer_fi watch {source} {redirect}", shell=True, text=True, capture_output=True,
        timeout=100,
    )  # fmt: skip
    assert ran.returncode == 2 and said in ran.stderr and ran.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.study
def test_a_process_fed_fast_does_not_grow(tmp_path: Path) -> None:
    """300 000 samples through the whole process: resident memory after the first tenth is that at the end."""
    lines = csv_lines(sample_log("none"))
    table = np.array([[float(v) for v in line.split(",")] for line in lines[2:]])
    process = start_watch(stdin=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    told: list[str] = []  # read as it comes: a full pipe would stop both sides
    reader = threading.Thread(target=lambda: told.extend(process.stdout or ()))
    reader.start()
    sizes = []
    process.stdin.write(lines[1])
    for turn in range(94):
        moved = table + np.array([2.0 * turn, 0, 0, 0, 0, 0])
        process.stdin.write("".join(",".join(f"{value:.7g}" for value in row) + "\n" for row in moved))
        process.stdin.flush()
        sizes.append(int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * 4096)
    process.stdin.close()
    reader.join(timeout=120)
    assert process.wait(timeout=10) == 0 and not process.stderr.read()
    process.stdout.close()
    process.stderr.close()
    assert json.loads(told[-1])["samples"] == 94 * len(table)
    assert max(sizes[20:]) < max(sizes[10:20]) + 5e6


NAMES = ("time_s", "voltage_v", "current_a", "position_m", "speed_cmd_rad_s")


def json_lines(*rows: str) -> bytes:
    return ("\n".join(rows) + "\n").encode()


def test_numbers_beyond_all_floats_and_deep_nesting_are_skipped_lines() -> None:
    good = [json.dumps(dict(zip(NAMES, (k / 1600, 0.0, 0.0, 0.0, 0.0), strict=True))) for k in range(100)]
    digits = "9" * 400
    odd = [
        f'{{"time_s": {digits}, "voltage_v": 1}}',
        f'{{"time_s": 0.0312, "voltage_v": -{digits}, "current_a": 0, "position_m": 0, "speed_cmd_rad_s": 0}}',
        "[" * 50_000,
        '{"time_s": ' * 5_000,
        '{"time_s": {"a": [' + "[" * 900 + "]" * 900 + "]}}",
        f'{{"time_s": {"9" * 5000}}}',
    ]
    found, said = fed([json_lines(*good[:50], *odd, *good[50:])])
    assert found[-1]["event"] == "end" and found[-1]["skipped"] == len(said) == 4
    assert all(len(line) < 200 and "\n" not in line for line in said)


def test_a_clock_that_stands_still_is_counted_to_the_last_sample() -> None:
    header, *lines = csv_lines(sample_log("none"))[1:]
    still = [f"0.5,{line.split(',', 1)[1]}" for line in lines]
    found, said = fed([(header + "".join(still)).encode()])
    assert found[-1]["samples"] + found[-1]["skipped"] == len(lines)
    assert found[-1]["skipped"] > len(lines) - 64 and any("no time of their own" in line for line in said)


@pytest.mark.parametrize("where", ["all", "first", "last", "middle"])
def test_samples_without_a_time_are_placed_or_counted(where: str) -> None:
    header, *lines = csv_lines(sample_log("none"))[1:]
    rows = {"all": range(3000), "first": range(30), "last": range(2900, 3000), "middle": range(700, 1500)}[
        where
    ]
    lines = [f",{line.split(',', 1)[1]}" if k in rows else line for k, line in enumerate(lines[:3000])]
    found, _ = fed([(header + "".join(lines)).encode()])
    assert found[-1]["samples"] + found[-1]["skipped"] == len(lines)
    assert where != "all" or found[-1]["samples"] == 0


@pytest.mark.slow
def test_times_that_no_clock_has_are_no_times(recwarn: pytest.WarningsRecorder) -> None:
    header, *lines = csv_lines(sample_log("none"))[1:]
    lines[500:500] = ["1e308,0,0,0,0,0\n", "-1e16,0,0,0,0,0\n", "inf,0,0,0,0,0\n"]
    found, _ = fed([(header + "".join(lines)).encode()])
    assert found[-1]["samples"] == len(lines) and found[-1]["time_s"] < 2.0
    assert not recwarn.list


def test_a_clock_that_begins_anew_counts_what_waited() -> None:
    header, *lines = csv_lines(sample_log("none"))[1:]
    waiting = [f",{line.split(',', 1)[1]}" for line in lines[1000:1020]]
    found, _ = fed([(header + "".join([*lines[:1000], *waiting, *lines])).encode()])
    assert found[-1]["samples"] + found[-1]["skipped"] == 1020 + len(lines)


def test_ten_samples_of_a_move_are_no_verdict() -> None:
    header, *lines = csv_lines(sample_log("none"))[1:]
    found, _ = fed([(header + "".join(lines[600:610])).encode()])
    assert [(line["event"], line["label"]) for line in found] == [("end", "not_tested")]
    assert found[0]["probability"] is None


def test_a_stream_without_noise_is_judged_as_its_file() -> None:
    log = synthesise(Scenario(TWO_MOVES, 2.0, fault=Fault(), noise=0.0), RIG)[0]
    found, _ = fed([csv_bytes(log)])
    assert found[-1]["label"] == "nominal"
    assert diagnose.diagnose_log(log, RIG, SETTINGS).isolation.verdict.label == "nominal"


def test_mutated_streams_end_in_a_last_line_or_in_one_of_refusal(tmp_path: Path) -> None:
    counts, slowest = watch_streams.run(200, seed=7, banks=0.05, finds=tmp_path / "finds")
    assert not [what for what in counts if "FOUND" in what] and slowest < watch_streams.SLOWEST_S
    assert counts["Watch nominal"] and counts["Lines refused"]


# --- files that do not only grow -----------------------------------------------------------------


def read_all(source: watch.Growing) -> bytes:
    """What the file gives now."""
    pieces = []
    read, write = os.pipe()
    try:
        while data := source.read(read, 0.0):
            pieces.append(data)
    finally:
        os.close(read)
        os.close(write)
    return b"".join(pieces)


def rewrite(path: Path, data: bytes, later_ns: int) -> None:
    """In place, with a change time that surely differs."""
    with path.open("r+b") as stream:
        stream.write(data)
    found = path.stat()
    os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns + later_ns))


@pytest.mark.parametrize("at", [0, 100_000, 199_999])
def test_a_file_rewritten_at_the_same_length_is_read_anew(tmp_path: Path, at: int) -> None:
    path, data = tmp_path / "log.csv", bytes(range(200)) * 1000
    path.write_bytes(data)
    source = watch.Growing(path)
    assert read_all(source) == data and read_all(source) == b"" and source.renewed() == ""
    other = data[:at] + b"#" + data[at + 1 :]
    rewrite(path, other, 10**6)
    assert read_all(source) == b"" and source.renewed() == "the file was rewritten"
    assert read_all(source) == other
    rewrite(path, other, 2 * 10**6)  # touched only
    assert read_all(source) == b"" and source.renewed() == ""
    with path.open("ab") as stream:
        stream.write(b"more")
    assert read_all(source) == b"more" and source.renewed() == ""
    rewrite(path, data[::-1] + b"morelonger", 3 * 10**6)
    assert read_all(source) == b"" and source.renewed() == "the file was rewritten"
    assert read_all(source) == data[::-1] + b"morelonger"
    source.close()


def test_what_is_no_file_is_not_followed(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(UsageError, match="not a plain file"):
            watch.Growing(path)
    path = tmp_path / "log.csv"
    path.write_bytes(b"a\n")
    source = watch.Growing(path)
    assert read_all(source) == b"a\n"
    path.unlink()
    path.mkdir()
    with pytest.raises(UsageError, match="not a plain file"):
        read_all(source)


# --- the process ---------------------------------------------------------------------------------


def start_watch(*arguments: str, stdin: int | None = None) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "observer_fi", "watch", *arguments],
        stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def next_line(process: subprocess.Popen[str], wanted: str) -> dict:
    """The next line of an event, within half a minute."""
    assert process.stdout is not None
    timer = threading.Timer(30.0, process.kill)
    timer.start()
    try:
        while True:
            line = process.stdout.readline()
            assert line, f"the output ended before {wanted}"
            found = json.loads(line)
            if found["event"] == wanted:
                return found
    finally:
        timer.cancel()


@pytest.mark.slow
def test_standard_input_stall_heartbeat_and_signal() -> None:
    lines = csv_lines(sample_log())
    process = start_watch("--heartbeat", "0.1", stdin=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    process.stdin.write("".join(lines[:2000]))
    process.stdin.flush()
    assert next_line(process, "verdict")["label"] == "nominal"
    beat = next_line(process, "heartbeat")
    while beat["samples"] < 1998:  # it had not read everything yet
        beat = next_line(process, "heartbeat")
    process.stdin.write("".join(lines[2000:]))
    process.stdin.flush()
    assert next_line(process, "verdict")["label"] == "coupling_loss"
    while next_line(process, "heartbeat")["samples"] < len(lines) - 2:
        pass
    process.send_signal(signal.SIGTERM)
    last = next_line(process, "end")
    assert last["label"] == "coupling_loss" and "stopped by a signal" in last["reasons"]
    assert process.wait(timeout=30) == 0
    assert process.stderr.read() == ""
    for stream in (process.stdin, process.stdout, process.stderr):
        stream.close()


@pytest.mark.slow
def test_following_a_file_that_is_cut_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    healthy, broken = csv_bytes(sample_log("none")), csv_bytes(sample_log("coupling_loss"))
    process = start_watch("--follow", str(path), "--every", "3200")  # the file comes later
    time.sleep(0.2)
    path.write_bytes(healthy)
    assert next_line(process, "sample")["time_s"] > 1.9
    os.truncate(path, 0)
    assert next_line(process, "restart")["label"] == "nominal"
    with path.open("ab") as stream:
        stream.write(broken[: len(broken) // 2 + 7])
        stream.flush()
        time.sleep(0.05)
        stream.write(broken[len(broken) // 2 + 7 :])
    assert next_line(process, "sample")["posterior"]["coupling_loss"] > 0.99
    new = tmp_path / "new.csv"
    new.write_bytes(healthy)
    new.replace(path)
    next_line(process, "restart")
    assert next_line(process, "sample")["posterior"]["nominal"] > 0.99
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "the file was cut" in err and "the file was replaced" in err
    assert json.loads(out.splitlines()[-1])["event"] == "end"


@pytest.mark.slow
def test_command_line_errors_and_fail_on_fault() -> None:
    process = start_watch(stdin=subprocess.PIPE)
    _, err = process.communicate("1,2,3\n", timeout=60)
    assert process.returncode == 2 and len(err.splitlines()) == 1 and "send a header" in err
    process = start_watch("--fail-on-fault", stdin=subprocess.PIPE)
    out, _ = process.communicate(csv_bytes(sample_log()).decode(), timeout=60)
    assert process.returncode == 3 and len(out.splitlines()) == 3


# --- behind a position loop ----------------------------------------------------------------------


@pytest.mark.parametrize("form", ["csv", "json"])
def test_the_command_of_a_position_servo_is_made_line_by_line(form: str, tmp_path: Path) -> None:
    """Position command and encoder of a log of the independent truth, as `diagnose` reads them; each is asked for by name."""
    rig = behind_a_loop()
    profile = hidden.there_and_back((300.0,), (1.0,), (4.0,))
    spec = dict(
        profile=profile, fault=hidden.Fault("coupling_loss", 2.0), Kx=LOOP["Kx"], window_m=LOOP["x_window"]
    )
    frame, _ = hidden.make_log(
        hidden.TruthSpec(logger=hidden.Logger(log_encoder=True, encoder_edges=4096), **spec), 3
    )
    assert "speed_cmd_rad_s" not in frame
    path = hidden.write_log(frame, tmp_path / "log.csv")
    text = path.read_bytes()
    if form == "json":
        text = "".join(json.dumps(row) + "\n" for row in frame.to_dict("records")).encode()
    lines, said = fed(
        [text[k : k + 9999] for k in range(0, len(text), 9999)], Options(rig, SETTINGS, every=1)
    )
    assert not said
    outcome = diagnose.diagnose(path, rig, SETTINGS)
    assert outcome.isolation is not None
    assert lines[-1]["label"] == outcome.isolation.verdict.label == "coupling_loss"
    log = commanded(read_back(path)[0], rig)
    e = isolate.tested(kernels.Bank(rig, SETTINGS.bank).advance(log), SETTINGS.decision)
    expected = np.array([list(posterior(e.modes, p).values()) for p in e.probability])
    np.testing.assert_allclose(posteriors(lines), expected, atol=1e-9)
    for column in ("position_cmd_m", "encoder_rad"):
        with pytest.raises(InvalidLogError, match=f"column {column} is missing; a stream needs it"):
            fed([frame.drop(columns=column).to_csv(index=False).encode()], Options(rig, SETTINGS))
