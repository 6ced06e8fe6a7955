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
