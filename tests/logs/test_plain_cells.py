"""Cells and rows of text tables as loggers, spreadsheets and printers write them; every one of these files is the same log."""

import re
from pathlib import Path

import numpy as np
import pytest
from scenarios import COLUMNS, csv_text, healthy_rows

from observer_fi.errors import InvalidLogError
from observer_fi.logs import read_log
from observer_fi.logs.columns import columns_from_table
from observer_fi.logs.inspection.inspection import inspect_log
from observer_fi.logs.plain_cells import no_sample, plain_cell

CLEAN = [[float(v) for v in row] for row in healthy_rows()]


@pytest.mark.parametrize(
    ("text", "decimal", "sure", "plain"),
    [
        ("1,234.5", ".", False, "1234.5"),
        ("1.234,5", ",", False, "1234.5"),
        ("-1 234 567,25", ",", False, "-1234567.25"),
        ("1\u00a0234,5", ",", False, "1234.5"),
        ("12'345.0", ".", False, "12345.0"),
        ("12\u2019345", ".", False, "12345"),
        ("1,234", ".", True, "1234"),
        ("1,234", ".", False, None),  # may be a decimal comma
        ("0,123", ".", True, None),  # no group begins with a zero
        ("1,23.5", ".", True, None),
        ("\u22120.5", ".", False, "-0.5"),
        ("1.5D-03", ".", False, "1.5e-03"),
        ("----", ".", False, ""),
        ("+OVER", ".", False, ""),
        ("#DIV/0!", ".", False, ""),
        ("No Data", ".", False, ""),
        ("+", ".", False, None),
        ("door", ".", False, None),
        ("\u0661", ".", False, None),
    ],
)
def test_a_cell_is_a_number_no_reading_or_neither(
    text: str, decimal: str, sure: bool, plain: str | None
) -> None:
    assert plain_cell(text, decimal, sure) == plain


def test_headers_and_summaries_are_no_samples() -> None:
    headers = ("time_s", "current_a")
    assert no_sample(["time_s ", "current_a"], headers) and no_sample(["Mean:", "0.1"], headers)
    assert not no_sample(["0.1", "mean"], headers) and not no_sample(["", "0.1"], headers)


def _lines(cell, separator: str = ",") -> list[str]:
    return [separator.join(COLUMNS), *(separator.join(map(cell, row)) for row in CLEAN)]


def _grouped(value: float, group: str, decimal: str) -> str:
    return f"{1e6 * value:,.3f}".translate({ord(","): group, ord("."): decimal})


MICRO = columns_from_table({"columns": {name: {"header": name, "factor": 1e-6} for name in COLUMNS}})


@pytest.mark.parametrize(
    ("separator", "group", "decimal", "quoted"),
    [
        (";", ",", ".", False),
        (";", ".", ",", False),
        ("\t", "'", ".", False),
        (";", "\u202f", ",", False),
        (",", ",", ".", True),
    ],
)
def test_digits_in_groups_are_the_same_numbers(
    tmp_path: Path, separator: str, group: str, decimal: str, quoted: bool
) -> None:
    mark = '"' if quoted else ""
    lines = _lines(lambda v: f"{mark}{_grouped(v, group, decimal)}{mark}", separator)
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    log = read_log(path, MICRO)
    np.testing.assert_allclose(log.t, np.array(CLEAN)[:, 0], atol=1e-9)
    np.testing.assert_allclose(log.z, np.array(CLEAN)[:, 1:4], atol=2e-9)
    assert log.rejected_count == 0


@pytest.mark.parametrize("word", ["OVERRANGE", "Bad", "----", "#VALUE!", "Err", "?"])
def test_a_word_for_no_reading_is_one_that_is_missing(tmp_path: Path, word: str) -> None:
    rows = [list(map(str, row)) for row in CLEAN]
    for k in (10, 500):
        rows[k][2] = word
    path = tmp_path / "log.csv"
    path.write_text(csv_text(rows))
    log = read_log(path)
    assert np.flatnonzero(np.isnan(log.z[:, 1])).tolist() == [10, 500] and log.rejected_count == 2
    assert inspect_log(str(path)).contents.rows == len(rows)


def test_headers_between_rows_and_summaries_behind_them_are_left_out(tmp_path: Path) -> None:
    rows = [list(map(str, row)) for row in CLEAN]
    rows.insert(500, list(COLUMNS))
    rows += [["Max", *rows[-1][1:]], ["Mean:", *rows[-1][1:]]]
    path = tmp_path / "log.csv"
    path.write_text(csv_text(rows))
    log = read_log(path)
    assert log.t.size == len(CLEAN) and log.rejected_count == 3
    assert {re.sub("row left out: ", "", r.reason) for r in log.rejected} == {
        "the header once more",
        "a summary of the columns",
    }


def test_another_text_is_still_refused(tmp_path: Path) -> None:
    rows = [list(map(str, row)) for row in CLEAN]
    rows[7][2], rows[3][2] = "door", "Bad"
    path = tmp_path / "log.csv"
    path.write_text(csv_text(rows))
    with pytest.raises(InvalidLogError, match=r"row 8 \(line 9\), column current_a: 'door' is not a number"):
        read_log(path)
