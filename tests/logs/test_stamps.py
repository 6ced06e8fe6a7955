"""Absolute time stamps: every style of them gives the seconds of the same log, in every format."""

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nptdms import ChannelObject, TdmsWriter
from scenarios import csv_text, healthy_rows

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.columns import ColumnMap, columns_from_table
from observer_fi.logs.formats.stamps import is_stamp
from observer_fi.logs.ingest import log_from_frame, open_log, read_log

START = datetime(2026, 3, 28, 23, 59, 59, 500_000)  # half a second before midnight
ROWS = healthy_rows()[:1600]
SECONDS = np.array([float(row[0]) for row in ROWS])


def at(k: int) -> datetime:
    return START + timedelta(microseconds=round(SECONDS[k] * 1e6))


STYLES = {
    "iso": lambda d: d.isoformat(timespec="microseconds"),
    "blank": lambda d: d.strftime("%Y-%m-%d %H:%M:%S.%f"),
    "zulu": lambda d: d.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
    "zone": lambda d: d.strftime("%Y-%m-%dT%H:%M:%S.%f+01:00"),
    "comma": lambda d: d.strftime("%Y-%m-%d %H:%M:%S,%f"),
    "german": lambda d: d.strftime("%d.%m.%Y %H:%M:%S,%f"),
    "american": lambda d: d.strftime("%m/%d/%Y %I:%M:%S.%f %p"),
    "british": lambda d: d.strftime("%d/%m/%Y %H:%M:%S.%f"),
    "time of day": lambda d: d.strftime("%H:%M:%S.%f"),
    "colon": lambda d: d.strftime("%H:%M:%S:%f"),
    "month": lambda d: d.strftime("%d-%b-%Y %H:%M:%S.%f"),
    "month and blanks": lambda d: d.strftime("%d %B %Y %H:%M:%S.%f"),
    "named zone": lambda d: d.strftime("%Y-%m-%d %H:%M:%S.%f CET"),
    "nanoseconds": lambda d: d.strftime("%Y-%m-%dT%H:%M:%S.%f000"),
}
MAP = {"columns": {"time_s": {"header": "Zeitpunkt", "unit": "datetime"}}}
HEADER = ("Zeitpunkt", "voltage_v", "current_a", "position_m", "pitch_deg", "speed_cmd_rad_s")


def write(path: Path, stamps: list[str], header: tuple[str, ...] = HEADER) -> Path:
    rows = [[stamp, *row[1:]] for stamp, row in zip(stamps, ROWS, strict=True)]
    path.write_text(csv_text(rows, header, separator=";"), encoding="utf-8")
    return path


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("rows", [100, 10_000])
def test_a_style_gives_the_seconds_of_the_log(style: str, rows: int, tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", [STYLES[style](at(k)) for k in range(len(ROWS))])
    parts = list(open_log(path, columns_from_table(MAP)).chunks(rows))
    t = np.concatenate([part.t for part in parts])
    assert np.allclose(t, SECONDS - SECONDS[0], rtol=0, atol=1e-9)
    assert parts[0].rejected_count == 0
    start = (
        "23:59:59.5"
        if style in ("time of day", "colon")
        else "2026-03-28T22:59:59.5"
        if style == "zone"
        else "2026-03-28T23:59:59.5"
    )
    assert [n for n in parts[0].notes if f"time_s is 0 at {start}" in n]


def test_a_plain_time_column_may_hold_stamps_without_a_map(tmp_path: Path) -> None:
    path = write(
        tmp_path / "log.csv", [STYLES["iso"](at(k)) for k in range(len(ROWS))], ("time_s", *HEADER[1:])
    )
    assert np.allclose(read_log(path).t, SECONDS - SECONDS[0], rtol=0, atol=1e-9)


def test_a_date_and_a_time_of_day_in_two_columns(tmp_path: Path) -> None:
    rows = [[f"{at(k):%d.%m.%Y}", f"{at(k):%H:%M:%S,%f}", *row[1:]] for k, row in enumerate(ROWS)]
    path = tmp_path / "log.csv"
    path.write_text(csv_text(rows, ("Datum", "Uhrzeit", *HEADER[1:]), separator=";"), encoding="utf-8")
    entry = {"header": "Datum", "time_of_day": "Uhrzeit", "unit": "datetime"}
    assert np.allclose(
        read_log(path, columns_from_table({"columns": {"time_s": entry}})).t, SECONDS - SECONDS[0], atol=1e-9
    )
    with pytest.raises(InvalidLogError, match="'Zeit', the time_of_day of time_s, is missing"):
        read_log(path, columns_from_table({"columns": {"time_s": {**entry, "time_of_day": "Zeit"}}}))


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_an_epoch_in_any_unit(unit: str, factor: float, tmp_path: Path) -> None:
    begin = START.replace(tzinfo=UTC).timestamp()
    path = write(tmp_path / "log.csv", [f"{(begin + s) * factor:.6f}" for s in SECONDS])
    log = read_log(
        path, columns_from_table({"columns": {"time_s": {"header": "Zeitpunkt", "unit": f"epoch {unit}"}}})
    )
    assert np.allclose(log.t, SECONDS - SECONDS[0], rtol=0, atol=1e-6)
    assert any("2026-03-28T23:59:59.5" in note for note in log.notes)


@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
@pytest.mark.parametrize("unit", ["us", "ns"])
def test_parquet_types_of_time(zone: str | None, unit: str, tmp_path: Path) -> None:
    whole = pa.array([at(k) for k in range(len(ROWS))], pa.timestamp(unit)).cast(pa.timestamp(unit))
    times = (
        whole
        if zone is None
        else pa.array([at(k).replace(tzinfo=UTC) for k in range(len(ROWS))], pa.timestamp(unit, zone))
    )
    columns = {name: pa.array([float(row[k]) for row in ROWS]) for k, name in enumerate(HEADER) if k}
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time_s": times, **columns}), path)
    log = read_log(path)
    assert np.allclose(log.t, SECONDS - SECONDS[0], rtol=0, atol=1e-9)
    assert any("2026-03-28T23:59:59.5" in note for note in log.notes)


def test_tdms_time_stamps(tmp_path: Path) -> None:
    path = tmp_path / "log.tdms"
    stamps = np.array([np.datetime64(at(k), "us") for k in range(len(ROWS))])
    channels = [ChannelObject("g", "time_s", stamps)]
    channels += [
        ChannelObject("g", n, np.array([float(r[k]) for r in ROWS])) for k, n in enumerate(HEADER) if k
    ]
    with TdmsWriter(path) as writer:
        writer.write_segment(channels)
    assert np.allclose(
        read_log(path).t, SECONDS - SECONDS[0], rtol=0, atol=2e-6
    )  # npTDMS cuts to microseconds


def test_clocks_that_are_put_back_are_one_line_and_zones_are_no_jump(tmp_path: Path) -> None:
    summer, winter = timezone(timedelta(hours=2)), timezone(timedelta(hours=1))
    utc = [datetime(2026, 10, 25, 0, 59, 59, 500_000, UTC) + timedelta(seconds=s) for s in SECONDS]
    local = [u.astimezone(summer if u.hour < 1 else winter) for u in utc]
    zoned = write(tmp_path / "zoned.csv", [u.isoformat(timespec="microseconds") for u in local])
    assert np.allclose(read_log(zoned, columns_from_table(MAP)).t, SECONDS - SECONDS[0], atol=1e-9)
    bare = write(tmp_path / "bare.csv", [f"{u:%Y-%m-%dT%H:%M:%S.%f}" for u in local])
    with pytest.raises(InvalidLogError, match=r"row 801 .*time runs backward"):
        read_log(bare, columns_from_table(MAP))


def test_what_is_no_stamp_is_named_and_what_is_missing_is_masked(tmp_path: Path) -> None:
    stamps = [STYLES["iso"](at(k)) for k in range(len(ROWS))]
    stamps[700] = ""
    log = read_log(write(tmp_path / "hole.csv", stamps), columns_from_table(MAP))
    assert [(r.row, r.column) for r in log.rejected] == [(701, "time_s")]
    for wrong in ("yesterday", "2026-13-01T00:00:00", "2026-01-01T25:00:00", "12:00:00", "1.5"):
        stamps[20] = wrong
        with pytest.raises(InvalidLogError, match=r"row 21 \(line 22\), column time_s: .* is no time stamp"):
            read_log(write(tmp_path / "wrong.csv", stamps), columns_from_table(MAP))


def test_stamps_are_told_from_numbers() -> None:
    assert all(is_stamp(style(START)) for style in STYLES.values()) and is_stamp("2026-01-01")
    assert not any(map(is_stamp, ("", "1.5", "2026", "-3", "1e5", "12,5", "abc", "-", "+01")))


def test_a_map_says_stamps_of_the_time_only() -> None:
    for entry in (
        {"header": "t", "unit": "s", "time_of_day": "d"},
        {"header": "t", "unit": "datetime", "factor": 2.0},
    ):
        with pytest.raises(UsageError, match=r"columns\.time_s\."):
            columns_from_table({"columns": {"time_s": entry}})
    assert ColumnMap().source("time_s").stamps is False


@pytest.mark.parametrize("zone", [None, UTC])
def test_the_frame_of_a_user_may_have_stamps(zone: object, tmp_path: Path) -> None:
    frame = pd.DataFrame({name: [float(row[k]) for row in ROWS] for k, name in enumerate(HEADER) if k})
    frame["time_s"] = [at(k).replace(tzinfo=zone) for k in range(len(ROWS))]
    frame.to_parquet(tmp_path / "log.parquet")
    for log in (read_log(tmp_path / "log.parquet"), log_from_frame(frame)):
        assert np.allclose(log.t, SECONDS - SECONDS[0], atol=1e-9)
        assert any("2026-03-28T23:59:59.5" in note for note in log.notes)
