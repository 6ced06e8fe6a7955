"""The same log, however it is packed, encoded or typed, is the same log; what is no log says so in one line."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, make_log

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


WRITERS: dict[str, tuple[str, Write]] = {
    "xz": ("log.csv.xz", plain),
    "bzip2": ("log.txt.bz2", plain),
    "zip of pandas": ("log.csv.zip", plain),
    "zip with a folder": ("log.zip", zipped),
    "gzip under another name": ("log.csv", lambda path, frame: frame.to_csv(path, index=False, compression="gzip")),
    "feather": ("log.feather", lambda path, frame: frame.to_feather(path)),
    "feather, not packed": ("log.arrow", lambda path, frame: frame.to_feather(path, compression="uncompressed")),
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


def test_a_spreadsheet_under_the_name_of_a_table_is_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidLogError, match="this is a spreadsheet; export the log from it as CSV"):
        read_log(archive(tmp_path / "log.csv", "[Content_Types].xml", "xl/workbook.xml"))


@pytest.mark.parametrize("kind", ["xz", "bzip2", "zip of pandas", "feather", "feather, not packed"])
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
