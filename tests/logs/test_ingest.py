"""Every format and every spoilt log: what is read, what is listed, and the one line of a refusal."""

import gzip
import hashlib
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenarios import (
    COLUMNS,
    EXAMPLES,
    MAPS,
    RATE_HZ,
    SCENARIOS,
    Scenario,
    csv_text,
    healthy_move,
    healthy_rows,
)

from observer_fi.bank.log_feed import LogStream
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.columns import COLUMNS as KINDS
from observer_fi.logs.columns import columns_from_table, load_columns
from observer_fi.logs.ingest import log_from_frame, log_name, open_log, read_log
from observer_fi.logs.moves import log_segments
from observer_fi.logs.tables import LISTED, plain
from observer_fi.logs.units import suspect_units
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import csv_bytes
from observer_fi.records import SAMPLES, Log
from observer_fi.verdict.open_loop import cut


def same(a: Log, b: Log) -> bool:
    pairs = [(getattr(a, name), getattr(b, name)) for name in SAMPLES]
    return all((p is None and q is None) or np.array_equal(p, q, equal_nan=True) for p, q in pairs)


def map_of(scenario: Scenario, folder: Path):
    path = scenario.column_map(folder)
    return None if path is None else load_columns(path)


def write_rows(path: Path, rows, header=COLUMNS) -> Path:
    path.write_text(csv_text(rows, header))
    return path


# --- scenarios -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", [s for s in SCENARIOS if not s.error], ids=lambda s: s.name)
def test_a_log_that_can_be_used(scenario: Scenario, tmp_path: Path) -> None:
    log = read_log(scenario.write(tmp_path), map_of(scenario, tmp_path))
    assert np.all(np.diff(log.t) > 0.0)
    assert log.rejected_count == scenario.rejected
    assert len(log.rejected) == min(scenario.rejected, LISTED)
    assert len(log.gaps) == scenario.gaps
    assert scenario.samples in (None, log.t.size)
    for wanted in scenario.notes:
        assert any(wanted in note for note in log.notes), log.notes
    if not scenario.notes and not scenario.rejected:
        assert log.notes == ()
    assert np.isfinite(log.pitch).all()
    assert np.isfinite(log.w_cmd).all() or scenario.name == "no command"
    for name in ("t", "z", "w_cmd", "pitch"):
        array = getattr(log, name)
        assert array.dtype == np.float64 and array.flags.c_contiguous and array.flags.writeable


@pytest.mark.parametrize("scenario", [s for s in SCENARIOS if s.error], ids=lambda s: s.name)
def test_a_log_that_cannot_be_used_is_refused_in_one_line(scenario: Scenario, tmp_path: Path) -> None:
    path = scenario.write(tmp_path)
    with pytest.raises(InvalidLogError) as caught:
        read_log(path, map_of(scenario, tmp_path))
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    assert re.search(scenario.error, message)


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s.name)
@pytest.mark.parametrize("rows", [7, 640])
def test_chunks_say_what_the_whole_file_says(scenario: Scenario, rows: int, tmp_path: Path) -> None:
    path, column_map = scenario.write(tmp_path), map_of(scenario, tmp_path)
    if scenario.error:
        with pytest.raises(InvalidLogError, match=scenario.error):
            list(open_log(path, column_map).chunks(rows))
        return
    file = open_log(path, column_map)
    logs = list(file.chunks(rows))
    whole = read_log(path, column_map)
    assert [log.first_row for log in logs] == list(np.cumsum([0, *(log.t.size for log in logs[:-1])]))
    assert np.allclose(np.concatenate([log.t for log in logs]), whole.t, rtol=0, atol=1e-12)
    assert np.array_equal(np.concatenate([log.z for log in logs]), whole.z, equal_nan=True)
    assert file.summary.samples == whole.t.size
    assert file.summary.rejected_count == whole.rejected_count == sum(log.rejected_count for log in logs)
    if scenario.name not in ("jitter", "coarse clock"):  # a median of seven intervals is not that of the file
        assert file.summary.gaps == whole.gaps == tuple(gap for log in logs for gap in log.gaps)


def test_a_healthy_log_is_read_to_the_last_digit(tmp_path: Path) -> None:
    path = write_rows(tmp_path / "log.csv", healthy_rows())
    log, table = read_log(path), healthy_move()
    assert np.array_equal(log.t, table[:, 0]) and np.array_equal(log.z, table[:, 1:4])
    assert np.array_equal(log.w_cmd, table[:, 5]) and not log.pitch.any()
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert log.rate_hz == pytest.approx(RATE_HZ)
    assert log.path == str(path)


# --- what is listed ------------------------------------------------------------------------------


def test_rows_are_counted_from_the_line_after_the_header(tmp_path: Path) -> None:
    rows = healthy_rows()
    rows[9:9] = [["broken"], ["again"]]  # rows 10 and 11
    rows[11][2] = rows[12][2] = "nan"  # rows 12 and 13, the 10th and 11th samples
    rows.insert(14, ["1", "2"])  # row 15
    rows[15][2] = "nan"  # row 16, the 13th sample
    path = tmp_path / "log.csv"
    path.write_text("# a line of metadata\n" + csv_text(rows))
    log = read_log(path)
    assert [(r.row, r.column) for r in log.rejected] == [
        (10, "time_s"), (11, "time_s"), (12, "current_a"), (13, "current_a"), (15, "time_s"),
        (16, "current_a"),
    ]  # fmt: skip
    assert np.flatnonzero(np.isnan(log.z[:, 1])).tolist() == [9, 10, 12]


def test_a_gap_says_where_and_how_many_are_missing(tmp_path: Path) -> None:
    rows = healthy_rows()
    del rows[800:840]
    gap = read_log(write_rows(tmp_path / "log.csv", rows)).gaps[0]
    assert gap.start_s == 799 / RATE_HZ and gap.end_s == 840 / RATE_HZ and gap.samples == 40


def test_the_second_of_two_equal_times_is_masked_and_placed_between_its_neighbours(tmp_path: Path) -> None:
    rows = healthy_rows()
    rows[500][0] = rows[499][0]
    log = read_log(write_rows(tmp_path / "log.csv", rows))
    assert log.t[500] == pytest.approx(500 / RATE_HZ)
    assert np.isnan(log.z[500]).all() and not np.isnan(log.z[499]).any() and log.gaps == ()
    assert log.rejected[0][:2] == (501, "time_s")


def test_the_list_of_masked_values_is_capped_and_the_count_is_not(tmp_path: Path) -> None:
    rows = healthy_rows()
    for row in rows[:-1]:
        row[1] = "inf"
    log = read_log(write_rows(tmp_path / "log.csv", rows))
    assert len(log.rejected) == LISTED and log.rejected_count == len(rows) - 1


def test_a_hole_in_the_command_is_filled_from_both_sides_also_across_chunks(tmp_path: Path) -> None:
    rows = healthy_rows()
    for row in rows[800:1000]:
        row[5] = ""
    path = write_rows(tmp_path / "log.csv", rows)
    assert np.array_equal(read_log(path).w_cmd, healthy_move()[:, 5])
    chunked = np.concatenate([log.w_cmd for log in open_log(path).chunks(100)])
    assert np.array_equal(chunked, healthy_move()[:, 5])


def test_a_clock_that_stands_still_for_long_is_an_error_not_a_memory_leak(tmp_path: Path) -> None:
    rows = healthy_rows()
    rows += [list(rows[-1]) for _ in range(12_000)]
    with pytest.raises(InvalidLogError, match="row 1601 .*time stands still"):
        for _ in open_log(write_rows(tmp_path / "log.csv", rows)).chunks(1000):
            pass


def test_the_summary_is_not_there_before_the_last_chunk(tmp_path: Path) -> None:
    file = open_log(write_rows(tmp_path / "log.csv", healthy_rows()))
    with pytest.raises(RuntimeError, match="after the last chunk"):
        _ = file.summary


def test_force_instead_of_current(tmp_path: Path) -> None:
    header = tuple("force_cmd_n" if name == "current_a" else name for name in COLUMNS)
    log = read_log(write_rows(tmp_path / "log.csv", healthy_rows(), header))
    assert log.force is not None and np.isnan(log.z[:, 1]).all()
    assert any("force_cmd_n" in note for note in log.notes)


@pytest.mark.parametrize("rows", [7, 640])
def test_a_load_survives_chunks_gaps_and_cuts(rows: int, tmp_path: Path) -> None:
    table = healthy_rows()
    loads = np.linspace(-2.0, 3.0, len(table))
    given = [[*row, f"{load:.6f}"] for row, load in zip(table, loads, strict=True)]
    given[17][-1] = ""  # a model needs it at every sample
    path = write_rows(tmp_path / "log.csv", given, (*COLUMNS, "Last"))
    column_map = columns_from_table({"columns": {"load_n": {"header": "Last", "unit": "kN"}}})
    log = read_log(path, column_map)
    assert log.load is not None and np.allclose(log.load, 1e3 * loads, atol=0.01)
    assert [(r.row, r.column) for r in log.rejected] == [(18, "load_n")]
    parts = [part.load for part in open_log(path, column_map).chunks(rows)]
    assert np.array_equal(np.concatenate([part for part in parts if part is not None]), log.load)
    assert np.array_equal(cut(log, 100, 900).load, log.load[100:900])
    kept = np.append(np.arange(700), np.arange(760, log.t.size))  # a gap, which a bank fills
    holed = replace(log, **{f: getattr(log, f)[kept] for f in SAMPLES if getattr(log, f) is not None})
    filled, own = LogStream().take(holed)
    assert filled.load is not None and filled.load.size == filled.t.size == own.size > holed.t.size
    assert np.allclose(filled.load, np.interp(filled.t, log.t, log.load), atol=1e-6)
    assert read_log(write_rows(tmp_path / "without.csv", table)).load is None


def test_a_load_is_written_and_read_again(tmp_path: Path) -> None:
    log = read_log(write_rows(tmp_path / "log.csv", healthy_rows()))
    path = tmp_path / "again.csv"
    path.write_bytes(csv_bytes(replace(log, load=np.full(log.t.size, 12.5))))
    assert np.array_equal(read_log(path).load, np.full(log.t.size, 12.5))


def test_a_unit_that_cannot_be_right_for_the_rig_is_noted(tmp_path: Path) -> None:
    log = read_log(write_rows(tmp_path / "log.csv", healthy_rows()))
    model = load_rig().model
    assert suspect_units(log, log_segments(log), model) == ()
    for channel, word in ((0, "voltage_v"), (1, "current_a"), (2, "position_m")):
        z = log.z.copy()
        z[:, channel] *= 1e3
        wrong = replace(log, z=z)
        assert [word in note for note in suspect_units(wrong, log_segments(wrong), model)] == [True]
    rpm = replace(log, w_cmd=log.w_cmd * 30 / np.pi)
    assert "rpm" in suspect_units(rpm, log_segments(rpm), model)[0]


SHIPPED = Path(__file__).parents[2] / "data"


@pytest.mark.parametrize("name", ["overload_steady", "false_alarm_steady", "coupling_loss_steady"])
def test_a_current_without_its_sign_and_a_position_that_starts_anew_are_noted(name: str) -> None:
    log = read_log(SHIPPED / f"{name}.csv.gz")
    model, moves = load_rig().model, log_segments(log)
    assert suspect_units(log, moves, model) == ()
    magnitude = replace(log, z=log.z * [1.0, 0.0, 1.0] + np.abs(log.z) * [0.0, 1.0, 0.0])
    assert ["current_a" in note for note in suspect_units(magnitude, moves, model)] == [True]
    travel = float(np.ptp(log.z[:, 2]))
    for turn, way in ((0.6 * travel, 1.0), (0.8 * travel, -1.0)):
        anew = log.z.copy()
        anew[:, 2] = np.mod(way * log.z[:, 2] + 0.2 * turn, turn)
        assert "does it start anew" in suspect_units(replace(log, z=anew), moves, model)[0]


def test_sensors_that_fail_have_no_wrong_unit() -> None:
    """Nothing read, nothing but one value, a drop-out to zero at the far end, single spikes."""
    log = read_log(SHIPPED / "overload_steady.csv.gz")
    model, moves = load_rig().model, log_segments(log)
    late = log.t > log.t[-1] - 0.8
    begun = log.t > log.t[np.flatnonzero(log.w_cmd)[0]] + 0.02
    for channel, value in ((1, 0.0), (1, 0.4), (2, 0.0), (1, np.nan), (2, np.nan)):
        for part in (late, begun, slice(None), slice(1000, None, 500)):
            z = log.z.copy()
            z[part, channel] = value
            notes = suspect_units(replace(log, z=z), moves, model)
            assert not [note for note in notes if "magnitude" in note or "anew" in note]


@pytest.mark.parametrize("noise_m", [1e-6, 1e-5, 5e-5])
def test_a_position_that_drops_to_zero_under_noise_does_not_start_anew(noise_m: float) -> None:
    """What noise does in 20 samples is no motion: three drop-outs of twelve had been taken for a sensor that wraps."""
    log = read_log(SHIPPED / "overload_steady.csv.gz")
    model, moves = load_rig().model, log_segments(log)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        away = log.t > rng.uniform(log.t[0] + 0.6, log.t[-1] - 0.6)
        z = log.z.copy()
        z[away, 2] = noise_m * rng.standard_normal(np.count_nonzero(away))
        assert not suspect_units(replace(log, z=z), moves, model)


@pytest.mark.parametrize("after_s", [0.015, 0.03, 0.05, 0.09])
def test_a_log_that_begins_while_the_servo_brakes_has_the_right_sign(after_s: float) -> None:
    log, model = read_log(SHIPPED / "false_alarm_steady.csv.gz"), load_rig().model
    late = log.part(slice(int(np.flatnonzero(log.w_cmd)[0]) + round(after_s * log.rate_hz), None))
    assert suspect_units(late, log_segments(late), model) == ()


DEFECTS = st.lists(
    st.tuples(
        st.integers(0, 199),
        st.sampled_from([0, 1, 2, 3, 4, 5]),
        st.sampled_from(["", "nan", "inf", "1e7", "same"]),
    ),
    max_size=30,
)


@given(defects=DEFECTS, rows=st.integers(5, 250))
def test_any_defects_in_any_chunks_leave_one_clock_and_a_complete_list(
    tmp_path_factory, defects, rows
) -> None:
    table = healthy_rows()[300:500]
    for k, column, text in defects:
        if text == "same":
            table[k] = list(table[max(k - 1, 0)])
        elif not (column == 0 and text == "1e7"):
            table[k][column] = text
    path = write_rows(tmp_path_factory.mktemp("logs") / "log.csv", table)
    file = open_log(path)
    logs = list(file.chunks(rows))
    whole = read_log(path)
    t = np.concatenate([log.t for log in logs])
    z = np.concatenate([log.z for log in logs])
    assert t.size == whole.t.size <= 200 and np.all(np.diff(t) > 0.0)
    assert np.array_equal(z, whole.z, equal_nan=True)
    assert not np.isinf(z).any() and np.nanmax(np.abs(z)) <= 1e3
    assert file.summary.rejected_count == whole.rejected_count >= np.isnan(z).any(axis=1).sum()


# --- nothing is lost, in any format ---------------------------------------------------------------

CELLS = st.sampled_from(
    ["", "nan", "1.0", "-2.5e-3", "1e400", "1e308", '"', '"1', '1"', '"1"', "#", "x", "\u2028", "\x0c"]
)
LINES = st.lists(
    st.one_of(
        st.lists(CELLS, min_size=0, max_size=8), st.sampled_from([[""], ["  "], ["# a"], ["\r"], ["#", "", "", "", "", ""]])
    ),
    max_size=12,
)  # fmt: skip


def rows_in(body: str) -> int:
    """Lines of a text that are not blank: the oracle of the readers, which know no csv."""
    lines = re.split("\r\n|\r|\n", body)
    return sum(bool(line.strip(" \t\x0b\x0c")) for line in lines)


def kept_rows(path: Path, rows: int, columns=None) -> tuple[int, int] | None:
    """Samples, and rows listed as left out; None where the log is refused."""
    file = open_log(path, columns)
    try:
        samples = sum(log.t.size for log in file.chunks(rows))
    except InvalidLogError as error:
        assert "were lost in reading" not in str(error)
        return None
    left_out = [r for r in file.summary.rejected if "row left out" in r.reason]
    assert len({r.row for r in left_out}) == len(left_out)
    return samples, len(left_out)


@given(
    lines=LINES,
    at=st.integers(0, 400),
    ending=st.sampled_from(["\n", "\r\n", "\r"]),
    rows=st.integers(50, 500),
)
@pytest.mark.parametrize("kind", [".csv", ".csv.gz", ".lvm"])
def test_rows_of_a_text_are_samples_or_left_out(tmp_path_factory, kind, lines, at, ending, rows) -> None:
    folder = tmp_path_factory.mktemp("logs")
    table = [",".join(row) for row in healthy_rows()[:400]]
    table[at:at] = [",".join(line) for line in lines]
    body = ending.join(table)
    if kind == ".lvm":
        head = (MAPS / "labview.lvm").read_bytes().decode().split("X_Value")[0].replace("\tTab", ",Comma")
        head = head.replace("Separator,Comma", "Separator,Comma\r\nDecimal_Separator,.")
        body, text = body, head.replace("\r\n", ending) + ",".join(("X_Value", *COLUMNS[1:])) + ending + body
        text = re.sub(r"(\*\*\*End_of_Header\*\*\*)\t*", r"\1", text)
    else:
        text = ",".join(COLUMNS) + ending + body
    raw = text.encode()
    path = folder / f"log{kind}"
    path.write_bytes(gzip.compress(raw) if kind == ".csv.gz" else raw)
    found = kept_rows(path, rows)
    assert found is None or sum(found) == rows_in(body)


@given(
    holes=st.lists(st.tuples(st.integers(0, 199), st.integers(0, 6)), max_size=40),
    rows=st.integers(5, 250),
    cut=st.integers(0, 30),
)
@pytest.mark.parametrize("kind", [".parquet", ".tdms"])
def test_rows_of_a_binary_file_are_samples_or_left_out(tmp_path_factory, kind, holes, rows, cut) -> None:
    table = np.array(healthy_move()[300:500])
    for k, column in holes:
        table[k, slice(None) if column == 6 else column] = np.nan
    path = tmp_path_factory.mktemp("logs") / f"log{kind}"
    if kind == ".parquet":
        pd.DataFrame(table, columns=list(COLUMNS)).to_parquet(path, row_group_size=37)
    else:
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(str(path)) as writer:
            ends = [None, -cut or None, None, None, None, None]
            writer.write_segment(
                [ChannelObject("g", n, v[:e]) for n, v, e in zip(COLUMNS, table.T, ends, strict=True)]
            )
    found = kept_rows(path, rows)
    assert found is None or sum(found) == 200


def test_a_reader_that_loses_a_row_is_found_out(tmp_path: Path, monkeypatch) -> None:
    from observer_fi.logs.formats import text_rows

    table = text_rows._Reader.block
    monkeypatch.setattr(text_rows._Reader, "block", lambda self, text: cut_block(table(self, text)))
    with pytest.raises(InvalidLogError, match="of its 1600 rows 1599 are samples and 0 were left out"):
        read_log(write_rows(tmp_path / "log.csv", healthy_rows()))


def cut_block(block):
    return block._replace(rows=block.rows[1:], values={name: v[1:] for name, v in block.values.items()})


# --- the file itself -----------------------------------------------------------------------------


def touched_later(path: Path) -> None:
    later = path.stat().st_mtime_ns + 10**9
    os.utime(path, ns=(later, later))


@pytest.mark.parametrize("how", ["written to", "replaced", "removed", "touched"])
@pytest.mark.parametrize("when", ["before the rows", "between the rows"])
def test_a_log_that_changes_while_it_is_read_is_noticed(how: str, when: str, tmp_path: Path) -> None:
    path = write_rows(tmp_path / "log.csv", healthy_rows())
    file = open_log(path)
    chunks = file.chunks(100)
    if when == "between the rows":
        next(chunks)
    if how == "replaced":
        write_rows(tmp_path / "other.csv", healthy_rows()[::-1]).replace(path)
    elif how == "written to":
        with path.open("a") as stream:
            stream.write("0,0,0,0,0,0\n")
    elif how == "removed":
        path.unlink()
    else:
        touched_later(path)
    with pytest.raises(InvalidLogError, match="changed while it was read|cannot read the log"):
        list(chunks)
    with pytest.raises(InvalidLogError, match="changed while it was read|cannot read the log"):
        _ = file.sha256


def test_a_refused_log_leaves_nothing_behind(tmp_path: Path) -> None:
    import tracemalloc

    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(csv_text(healthy_rows()).encode())[:9000])

    def refuse() -> None:
        with pytest.raises(InvalidLogError):
            read_log(path)

    refuse()
    tracemalloc.start()
    try:
        refuse()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(20):
            refuse()
        assert tracemalloc.get_traced_memory()[0] - before < 100_000  # bytes; one piece of the file is 9 kB
    finally:
        tracemalloc.stop()


def test_what_a_reader_of_others_warns_of_is_a_note(tmp_path: Path, capfd, monkeypatch) -> None:
    import logging
    import warnings

    from nptdms import TdmsFile

    opened = TdmsFile.open

    def noisy(stream):
        warnings.warn("a strange property", UserWarning, stacklevel=1)
        logging.getLogger("nptdms.reader").warning("a strange \x1b[31msegment")
        return opened(stream)

    monkeypatch.setattr(TdmsFile, "open", noisy)
    log = read_log(MAPS / "waveform.tdms", load_columns(MAPS / "waveform.toml"))
    assert "the reader says: a strange property" in log.notes
    assert "the reader says: a strange \\x1b[31msegment" in log.notes
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "spoil",
    [
        lambda f: pd.concat([f, f[["current_a"]]], axis=1),
        lambda f: f.assign(current_a=1j),
        lambda f: f.assign(current_a=[[1]] * len(f)),
        lambda f: f.iloc[:0],
        lambda f: f.assign(time_s=1.0),
        lambda f: f.assign(current_a="x"),
        lambda f: f.assign(time_s=f.time_s * 1e-9),
        lambda f: f.assign(current_a=pd.Timestamp("2024-01-01")),
    ],
)
def test_hostile_frames_are_refused_in_one_line(spoil) -> None:
    frame = spoil(pd.DataFrame(healthy_move(), columns=list(COLUMNS)))
    with pytest.raises(InvalidLogError) as caught:
        log_from_frame(frame, "frame")
    assert str(caught.value).startswith("frame: ") and str(caught.value).isprintable()


# --- formats -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_of_each_foreign_layout_is_the_healthy_move(name: str) -> None:
    log = read_log(MAPS / name, load_columns((MAPS / name).with_suffix(".toml")))
    table = healthy_move()
    assert np.allclose(log.t, table[:, 0], rtol=0, atol=1e-12)
    assert np.allclose(log.z, table[:, 1:4], rtol=0, atol=1e-12)
    assert np.allclose(log.w_cmd, table[:, 5], rtol=0, atol=1e-6)
    assert log.rejected_count == 0 and log.metadata or name == "units_row.txt"


@pytest.mark.parametrize("name", EXAMPLES)
def test_each_format_streams(name: str) -> None:
    column_map = load_columns((MAPS / name).with_suffix(".toml"))
    logs = list(open_log(MAPS / name, column_map).chunks(300))
    assert [log.t.size for log in logs] == [300] * 5 + [100]
    assert np.array_equal(np.concatenate([log.z for log in logs]), read_log(MAPS / name, column_map).z)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_are_what_their_script_writes(name: str, tmp_path: Path) -> None:
    EXAMPLES[name](tmp_path / name)
    column_map = load_columns((MAPS / name).with_suffix(".toml"))
    assert same(read_log(tmp_path / name, column_map), read_log(MAPS / name, column_map))


def test_csv_gzip_and_parquet_hold_the_same_log(tmp_path: Path) -> None:
    frame = pd.DataFrame(healthy_move(), columns=list(COLUMNS))
    frame.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress((tmp_path / "log.csv").read_bytes()))
    frame.to_parquet(tmp_path / "log.parquet", row_group_size=100)
    plain = read_log(tmp_path / "log.csv")
    assert same(plain, read_log(tmp_path / "log.csv.gz")) and same(plain, read_log(tmp_path / "log.parquet"))


def test_parquet_of_other_types(tmp_path: Path) -> None:
    frame = pd.DataFrame(healthy_move(), columns=list(COLUMNS)).astype({"voltage_v": "float32"})
    frame["pitch_deg"] = frame["pitch_deg"].astype("Int64")
    frame.loc[3, "pitch_deg"] = pd.NA
    frame["current_a"] = frame["current_a"].astype(str)
    frame.to_parquet(tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet")
    assert np.array_equal(log.z[:, 1], healthy_move()[:, 2]) and log.rejected_count == 1
    frame.loc[1200, "current_a"] = "overload"
    frame.to_parquet(tmp_path / "log.parquet")
    with pytest.raises(InvalidLogError, match="row 1201, column current_a: 'overload' is not a number"):
        read_log(tmp_path / "log.parquet")
    frame["current_a"] = pd.Timestamp("2024-01-01")
    frame.to_parquet(tmp_path / "log.parquet")
    with pytest.raises(InvalidLogError, match="current_a is of type timestamp"):
        read_log(tmp_path / "log.parquet")


def test_arrow_values_keep_their_place_in_a_slice() -> None:
    import pyarrow as pa

    array = pa.array([1.0, None, 3.0, 4.0, None, 6.0, 7.0, 8.0, 9.0, None, 11.0])
    assert np.array_equal(plain(array.slice(3)), [4, np.nan, 6, 7, 8, 9, np.nan, 11], equal_nan=True)
    assert np.array_equal(plain(array.slice(5, 4)), [6, 7, 8, 9]) and plain(array.slice(2, 0)).size == 0


def test_a_cut_parquet_file(tmp_path: Path) -> None:
    whole = (MAPS / "renamed.parquet").read_bytes()
    (tmp_path / "log.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidLogError, match="not a whole Parquet file"):
        read_log(tmp_path / "log.parquet")


def test_a_parquet_file_under_another_name(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes((MAPS / "renamed.parquet").read_bytes())
    with pytest.raises(InvalidLogError, match="rename it to end in .parquet"):
        read_log(tmp_path / "log.csv")


def test_lvm_with_a_decimal_comma_and_without_an_x_column(tmp_path: Path) -> None:
    text = (MAPS / "labview.lvm").read_text()
    head, body = text.split("Comment\n", 1)
    head = head.replace("Decimal_Separator\t.", "Decimal_Separator\t,").replace(
        "X_Columns\tOne", "X_Columns\tNo"
    )
    head = head.replace("0.0E+0", "0,0E+0").replace("0.000625", "0,000625")
    rows = ["\t" + line.split("\t", 1)[1].replace(".", ",") for line in body.splitlines()]
    path = tmp_path / "log.lvm"
    path.write_text(head + "Comment\n" + "\n".join(rows) + "\n")
    column_map = load_columns(MAPS / "labview.toml")
    log = read_log(path, column_map)
    assert np.allclose(log.t, healthy_move()[:, 0], atol=1e-12) and np.allclose(log.z, healthy_move()[:, 1:4])
    rows[7] = rows[7].replace(rows[7].split("\t")[2], "open")
    path.write_text(head + "Comment\n" + "\n".join(rows) + "\n")
    with pytest.raises(
        InvalidLogError, match=r"row 8 \(line 28\), column current_a \(header 'Current'\): 'open'"
    ):
        read_log(path, column_map)


def test_tdms_channels_of_two_groups_and_of_unequal_length(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    t, V, i, x, pitch, w = healthy_move().T
    with TdmsWriter(str(tmp_path / "log.tdms")) as writer:
        channels = {"time_s": t, "voltage_v": V, "current_a": i[:-5], "position_m": x, "speed_cmd_rad_s": w}
        writer.write_segment([ChannelObject("A", name, values) for name, values in channels.items()])
        writer.write_segment([ChannelObject("B", "current_a", 2.0 * i)])
    with pytest.raises(
        InvalidLogError, match="column current_a is missing; the columns are: time_s, voltage_v, A/"
    ):
        read_log(tmp_path / "log.tdms")
    (tmp_path / "map.toml").write_text('columns.current_a = "A/current_a"')
    log = read_log(tmp_path / "log.tdms", load_columns(tmp_path / "map.toml"))
    assert np.array_equal(log.z[:-5, 1], i[:-5]) and np.isnan(log.z[-5:, 1]).all() and log.rejected_count == 5


def test_tdms_with_texts(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(str(tmp_path / "log.tdms")) as writer:
        names = ("time_s", "current_a", "position_m")
        writer.write_segment([ChannelObject("A", name, np.array(["1", "2"])) for name in names])
    with pytest.raises(InvalidLogError, match="column time_s is of type object"):
        read_log(tmp_path / "log.tdms")


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("a/run.1.csv.gz", "run.1"),
        ("b.CSV", "b"),
        ("c.parquet", "c"),
        ("d.tdms", "d"),
        ("e.lvm", "e"),
        ("f", "f"),
    ],
)
def test_reports_are_filed_under_the_name_without_its_format(path: str, name: str) -> None:
    assert log_name(path) == name


# --- column maps ---------------------------------------------------------------------------------

MISTAKES = {
    "seperator = ';'": "no key 'seperator', did you mean 'separator'",
    "columns.curent_a = 'I'": "no column 'curent_a', did you mean 'current_a'",
    "columns.current_a = {header = 'I', units = 'mA'}": "no key of current_a 'units', did you mean 'unit'",
    "columns.current_a = {header = 'I', unit = 'ma'}": "no unit for current_a 'ma' (known: A, mA, uA)",
    "columns.current_a = {unit = 'mA', factor = 0}": "factor must be a number other than 0",
    "columns.current_a = 3": "give a header",
    "columns = 3": "must be a table",
    "limits.voltage = 3.0": "no column 'voltage', did you mean 'voltage_v'",
    "limits.voltage_v = 'x'": "must be a number",
    "separator = ';;'": "one character",
    "separator = ','\ndecimal_comma = true": "exclude each other",
    "header_line = -1": "header_line must be greater than or equal to 0",
    "header_line = true": "header_line must be a whole number",
    "header_line = 4\ndata_line = 4": "data_line must come after",
    "encoding = 'klingon'": "no encoding 'klingon'",
    "missing = 'OVL'": "missing must be a list",
    "columns.current_a = 'I'\ncolumns.voltage_v = 'I'": "mapped to two columns",
    "a = = 2": "not a TOML file",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_in_a_map_is_named_with_what_is_right(text: str, tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=re.escape(MISTAKES[text])) as caught:
        load_columns(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_a_map_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read the column map"):
        load_columns(tmp_path / "no.toml")


def test_units_turn_into_those_of_the_contract(tmp_path: Path) -> None:
    for column, kind in KINDS.items():
        assert kind.units[kind.unit] == 1.0
        for unit, factor in kind.units.items():
            path = tmp_path / "map.toml"
            by = 1.0 if unit == "datetime" else 2.0 if column == "time_s" else -2.0
            path.write_text(f'columns.{column} = {{ header = "h", unit = "{unit}", factor = {by} }}')
            assert load_columns(path).source(column)[:2] == ("h", by * factor)


def test_a_header_that_looks_right_is_suggested(tmp_path: Path) -> None:
    header = tuple("Motor current [mA]" if name == "current_a" else name for name in COLUMNS)
    with pytest.raises(InvalidLogError) as caught:
        read_log(write_rows(tmp_path / "log.csv", healthy_rows(), header))
    assert 'current_a = { header = "Motor current [mA]", unit = "mA" }' in str(caught.value)


def test_a_mapped_header_that_is_not_there_is_an_error_even_if_the_column_is_optional(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text('columns.voltage_v = "U"')
    path = write_rows(tmp_path / "log.csv", healthy_rows())
    with pytest.raises(InvalidLogError, match="voltage_v \\(mapped to header 'U'\\) is missing"):
        read_log(path, load_columns(tmp_path / "map.toml"))


def test_own_marks_for_no_value_and_own_limits(tmp_path: Path) -> None:
    rows = healthy_rows()
    rows[5][1], rows[6][1] = "OVL", "90.0"
    (tmp_path / "map.toml").write_text('missing = ["OVL"]\nlimits.voltage_v = 50')
    log = read_log(write_rows(tmp_path / "log.csv", rows), load_columns(tmp_path / "map.toml"))
    assert [(r.row, r.reason) for r in log.rejected] == [
        (6, "no value: masked"),
        (7, "90 is beyond 50 V: masked"),
    ]


def test_headers_differ_in_case_only(tmp_path: Path) -> None:
    header = tuple(name.upper() for name in COLUMNS)
    assert read_log(write_rows(tmp_path / "log.csv", healthy_rows(), header)).t.size == len(healthy_rows())


# --- frames: pandera judges as the reader does ---------------------------------------------------

IN_FRAMES = (
    "healthy",
    "gap",
    "no values",
    "wild values",
    "repeated row",
    "no pitch",
    "holes in command",
    "extra columns",
)


@pytest.mark.parametrize("name", IN_FRAMES)
def test_a_frame_gives_the_log_of_its_file(name: str, tmp_path: Path) -> None:
    path = next(s for s in SCENARIOS if s.name == name).write(tmp_path)
    log, from_frame = read_log(path), log_from_frame(pd.read_csv(path, index_col=None))
    assert same(log, from_frame) and log.notes == from_frame.notes and log.rejected == from_frame.rejected


@pytest.mark.parametrize("name", ["text", "late text", "no current", "time backward", "clock restart"])
def test_pandera_refuses_the_frame_where_the_reader_refuses_the_file(name: str, tmp_path: Path) -> None:
    scenario = next(s for s in SCENARIOS if s.name == name)
    frame = pd.read_csv(scenario.write(tmp_path))
    with pytest.raises(InvalidLogError, match="^frame: ") as caught:
        log_from_frame(frame)
    place = re.search(r"row \d+", scenario.error)
    assert "column" in str(caught.value) and (place is None or place[0] in str(caught.value))


# --- cost ----------------------------------------------------------------------------------------


def test_reading_a_csv_imports_neither_pandas_nor_pandera(tmp_path: Path) -> None:
    rows = healthy_rows()
    rows[3][2] = ""  # arrow turns a null into NaN by pandas unless asked otherwise
    path = write_rows(tmp_path / "log.csv", rows)
    code = (
        "import sys; from observer_fi.logs.ingest import read_log; read_log(sys.argv[1]); "
        "print({'pandas', 'pandera', 'nptdms'} & set(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(path)],
        capture_output=True,
        text=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        timeout=60,
    )
    assert run.stdout.strip() == "set()", run.stderr


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak of memory is read from /proc")
def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    code = (
        "import sys; from observer_fi.logs.ingest import open_log\n"
        "for log in open_log(sys.argv[1]).chunks(): pass\n"
        "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1])"
    )
    peaks = []
    for repeats in (600, 6000):  # 1 and 10 million samples: the chunks of the first already fill the pools
        n = 1600 * repeats
        frame = pd.DataFrame(np.tile(healthy_move(), (repeats, 1)), columns=list(COLUMNS))
        frame["time_s"] = np.arange(n) / RATE_HZ
        frame.to_parquet(tmp_path / "log.parquet", row_group_size=1 << 17)
        run = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "log.parquet")], capture_output=True, text=True
        )
        peaks.append(int(run.stdout))
    assert peaks[1] < peaks[0] + 50_000  # kB
