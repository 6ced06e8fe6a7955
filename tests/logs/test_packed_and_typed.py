"""The same log, however it is packed, encoded or typed, is the same log; what is no log says so in one line."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, make_log
from spreadsheets import spreadsheet

from observer_fi.errors import InvalidLogError
from observer_fi.logs import read_log
from observer_fi.logs.columns import ColumnMap, Source
from observer_fi.logs.inspection.contents import contents_of

FRAME = make_log(draw_move_case(8_110_000, "nominal"), 8_110_000)[0].iloc[:700].round(6)
Write = Callable[[Path, pd.DataFrame], object]


def zipped(path: Path, frame: pd.DataFrame) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("run/", b"")
        archive.writestr("run/log.csv", frame.to_csv(index=False))
        archive.writestr("__MACOSX/run/._log.csv", b"\x00\x05")


def quoted_commas(separator: str) -> Write:
    def write(path: Path, frame: pd.DataFrame) -> None:
        cells = frame.map(lambda v: f'"{v:.6f}"'.replace(".", ","))
        rows = [separator.join(row) for row in cells.to_numpy()]
        path.write_text("\n".join([separator.join(frame.columns), *rows]) + "\n", encoding="utf-8")

    return write


def encoded(encoding: str) -> Write:
    return lambda path, frame: path.write_bytes(frame.to_csv(index=False).encode(encoding))


def plain(path: Path, frame: pd.DataFrame) -> None:
    frame.to_csv(path, index=False)


def as_json(path: Path, frame: pd.DataFrame, orient: str = "records", lines: bool = False) -> None:
    frame.to_json(path, orient=orient, lines=lines, double_precision=15)  # type: ignore[call-overload]


def nested(path: Path, frame: pd.DataFrame, encoding: str = "utf-8") -> None:
    document = {"rig": "a", "meta": {"hz": 1600}, "data": {"samples": frame.to_dict("list")}}
    path.write_text(json.dumps(document), encoding=encoding)


def long(frame: pd.DataFrame) -> pd.DataFrame:
    """A row a reading: every signal at times of its own, half of its readings each."""
    parts = [frame.iloc[k % 2 :: 2][["time_s", c]].set_axis(["time_s", "value"], axis=1).assign(signal=c)
             for k, c in enumerate(frame.columns[1:])]  # fmt: skip
    return pd.concat(parts).sort_values("time_s", kind="stable")[["time_s", "signal", "value"]]


WRITERS: dict[str, tuple[str, Write]] = {
    "xz": ("log.csv.xz", plain),
    "bzip2": ("log.txt.bz2", plain),
    "zip of pandas": ("log.csv.zip", plain),
    "zip with a folder": ("log.zip", zipped),
    "gzip under another name": ("log.csv", lambda path, frame: frame.to_csv(path, index=False, compression="gzip")),
    "feather": ("log.feather", lambda path, frame: frame.to_feather(path)),
    "feather, not packed": ("log.arrow", lambda path, frame: frame.to_feather(path, compression="uncompressed")),
    "JSON, rows": ("log.json", as_json),
    "JSON, columns": ("log.json", lambda path, frame: as_json(path, frame, "columns")),
    "JSON, split": ("log.json", lambda path, frame: as_json(path, frame, "split")),
    "JSON, numbered rows": ("log.json", lambda path, frame: as_json(path, frame, "index")),
    "JSON, within": ("log.json", lambda path, frame: nested(path, frame, "utf-16")),
    "JSON under another name": ("log.txt", nested),
    "JSON, lines": ("log.jsonl", lambda path, frame: as_json(path, frame, lines=True)),
    "JSON, lines, packed": ("log.ndjson.gz", lambda path, frame: as_json(path, frame, lines=True)),
    "spreadsheet": ("log.xlsx", lambda path, frame: spreadsheet(path, run=frame)),
    "spreadsheet with a page of notes": ("log.xlsx", lambda path, frame: spreadsheet(path, notes=frame[:3], run=frame)),
    "spreadsheet under another name": ("log.csv", lambda path, frame: spreadsheet(path, run=frame)),
    "decimal commas in quotes": ("log.csv", quoted_commas(",")),
    "decimal commas in quotes, semicolons": ("log.csv", quoted_commas(";")),
    "UTF-16 without a mark": ("log.csv", encoded("utf-16-le")),
    "UTF-16 without a mark, big end first": ("log.csv", encoded("utf-16-be")),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITERS)
def test_it_is_the_same_log(kind: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    write(tmp_path / name, FRAME)
    FRAME.to_csv(tmp_path / "plain.csv", index=False)
    found, expected = read_log(tmp_path / name), read_log(tmp_path / "plain.csv")
    assert np.array_equal(found.t, expected.t)
    assert np.array_equal(found.z, expected.z, equal_nan=True)
    assert found.rejected == expected.rejected == ()


@pytest.mark.parametrize("kind", WRITERS)
def test_inspect_shows_its_columns(kind: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    write(tmp_path / name, FRAME)
    shown = contents_of(str(tmp_path / name))
    assert [column.header for column in shown.columns] == list(FRAME.columns)
    assert shown.rows == len(FRAME)
    for column in shown.columns:
        assert np.allclose(column.values, FRAME[column.header])


def archive(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w") as made:
        for name in names:
            made.writestr(name, FRAME.to_csv(index=False))
    return path


def test_an_archive_of_several_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidLogError, match=r"two\.zip: this is an archive of 2 files; unpack it"):
        read_log(archive(tmp_path / "two.zip", "a.csv", "b.csv"))
    with pytest.raises(InvalidLogError, match=r"none\.zip: "):
        read_log(archive(tmp_path / "none.zip"))


def test_a_spreadsheet_of_two_logs_is_refused(tmp_path: Path) -> None:
    spreadsheet(tmp_path / "log.xlsx", one=FRAME, two=FRAME[:600])
    with pytest.raises(
        InvalidLogError, match=r"log\.xlsx: this spreadsheet has 2 tables \(one, two\); save each by itself"
    ):
        read_log(tmp_path / "log.xlsx")


def test_objects_within_objects_are_columns(tmp_path: Path) -> None:
    rows = [{"time_s": row.pop("time_s"), "ch": row} for row in FRAME.to_dict("records")]
    del rows[9]["ch"]["current_a"]  # type: ignore[attr-defined]
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    shown = contents_of(str(tmp_path / "log.jsonl"))
    assert [column.header for column in shown.columns] == [
        "time_s",
        *(f"ch.{c}" for c in FRAME.columns if c != "time_s"),
    ]
    assert np.flatnonzero(np.isnan(shown.columns[2].values)).tolist() == [9]


def test_the_last_line_of_a_logger_that_was_switched_off_is_told(tmp_path: Path) -> None:
    as_json(tmp_path / "log.jsonl", FRAME, lines=True)
    text = (tmp_path / "log.jsonl").read_text(encoding="utf-8")
    (tmp_path / "log.jsonl").write_text(text[:-30], encoding="utf-8")
    assert read_log(tmp_path / "log.jsonl").t.size == len(FRAME) - 1
    assert contents_of(str(tmp_path / "log.jsonl")).metadata == ("left out: the last line, which is cut off",)
    (tmp_path / "log.jsonl").write_text(text.replace("}\n{", "}\n", 1), encoding="utf-8")
    with pytest.raises(InvalidLogError, match=r"log\.jsonl: no JSON of a table"):
        read_log(tmp_path / "log.jsonl")


def influx(rows: pd.DataFrame) -> str:
    """As InfluxDB annotates its CSV: one table a signal, each with the header, and times as stamps."""
    text = "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,double,string\n"
    for k, (name, part) in enumerate(rows.groupby("signal")):
        stamps = pd.Timestamp("2026-05-04T10:00:00Z") + pd.to_timedelta(part["time_s"], unit="s")
        text += ",result,table,_start,_time,_value,_field\n"
        for stamp, value in zip(stamps, part["value"], strict=True):
            text += (
                f",,{k},2026-05-04T00:00:00Z,{stamp.isoformat().replace('+00:00', 'Z')},{value!r},{name}\n"
            )
        text += "\n"
    return text


def historian(rows: pd.DataFrame) -> str:
    """Decimal commas, units in a column, milliamperes."""
    current = rows["signal"] == "current_a"
    rows = rows.assign(
        unit=np.where(current, "mA", ""), value=rows["value"].where(~current, rows["value"] * 1000.0)
    )
    rows["signal"] = rows["signal"].replace("current_a", "Strom")
    named = rows[["time_s", "signal", "value", "unit"]].set_axis(
        ["Zeit [s]", "Kanal", "Wert", "Einheit"], axis=1
    )
    return str(named.to_csv(sep=";", decimal=",", index=False))


STAMPED = ColumnMap({"time_s": Source("_time", stamps=True)})
MILLIAMPERES = ColumnMap({"time_s": Source("Zeit [s]"), "current_a": Source("Strom [mA]", 1e-3)})
NUMBERED = ColumnMap({"current_a": Source("Motor #1")})
LONG: dict[str, tuple[Callable[[pd.DataFrame], str], ColumnMap | None]] = {
    "plain": (lambda rows: rows.to_csv(index=False), None),
    "JSON": (lambda rows: rows.to_json(orient="records", double_precision=15), None),
    "signal by signal": (lambda rows: rows.sort_values("signal", kind="stable").to_csv(index=False), None),
    "InfluxDB": (influx, STAMPED),
    "historian": (historian, MILLIAMPERES),
    "a name with #, lines of old Macs": (
        lambda rows: (
            "# rig a\r" + rows.replace("current_a", "Motor #1").to_csv(index=False, lineterminator="\r")
        ),
        NUMBERED,
    ),
}


@pytest.mark.parametrize("kind", LONG)
def test_a_row_a_reading_becomes_a_row_a_time(kind: str, tmp_path: Path) -> None:
    write, column_map = LONG[kind]
    path = tmp_path / ("log.json" if kind == "JSON" else "log.csv")
    path.write_bytes(write(long(FRAME)).encode())
    found, expected = read_log(path, column_map), read_log(wide(tmp_path / "wide.csv"))
    assert np.allclose(found.t - found.t[0], expected.t, atol=1e-9)
    assert np.allclose(found.z, expected.z, equal_nan=True, atol=1e-9)
    assert found.rejected_count == expected.rejected_count


def wide(path: Path) -> Path:
    """The same readings with blanks where a signal was not read."""
    frame = FRAME.copy()
    for k, column in enumerate(frame.columns[1:]):
        frame.loc[frame.index % 2 != k % 2, column] = np.nan
    frame.to_csv(path, index=False)
    return path


def test_two_readings_of_a_signal_with_one_time_are_two_rows(tmp_path: Path) -> None:
    rows = long(FRAME)
    pd.concat([rows, rows[rows["signal"] == "voltage_v"]]).to_csv(tmp_path / "log.csv", index=False)
    shown = contents_of(str(tmp_path / "log.csv"))
    assert shown.rows == len(FRAME) + len(FRAME) // 2
    assert shown.kind == "text, a row a reading"


@pytest.mark.parametrize(
    "text", ['{"a": 1}', "[1, 2]", "[[1, 2], [3, 4]]", '{"a": [1, 2', '{"a": [1], "b": [1, 2]}', "[]", "{}"]
)
def test_json_without_a_table_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "log.json").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidLogError, match=r"log\.json: no .*export the log") as told:
        read_log(tmp_path / "log.json")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    "kind", ["xz", "bzip2", "zip of pandas", "feather", "feather, not packed", "spreadsheet"]
)
@pytest.mark.parametrize("spoil", ["cut", "changed"])
def test_a_damaged_file_is_one_line(kind: str, spoil: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    path = tmp_path / name
    write(path, FRAME)
    whole = bytearray(path.read_bytes())
    if spoil == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    else:
        whole[len(whole) // 3 : len(whole) // 3 + 400] = b"\xa5" * 400
        path.write_bytes(whole)
    try:
        read_log(path)
    except InvalidLogError as error:
        assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    else:
        assert kind == "feather, not packed" and spoil == "changed"  # nothing in it guards its numbers
