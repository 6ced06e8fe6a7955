"""Tables between blanks: columns by their place, where values may be left out."""

from pathlib import Path

import numpy as np
import pytest
from scenarios import COLUMNS, healthy_rows

from observer_fi.logs import load_columns, read_log
from observer_fi.logs.blank_columns import BlankColumns, blank_headers
from observer_fi.logs.inspection.inspection import inspect_log

CLEAN = np.array([[float(v) for v in row] for row in healthy_rows()])


def printed(cells, width: int, right: bool) -> str:
    return "".join(f"{cell:>{width}}" if right else f"{cell:<{width}}" for cell in cells)


@pytest.mark.parametrize("right", [True, False])
def test_columns_of_fixed_width_keep_their_place_where_a_value_is_left_out(
    tmp_path: Path, right: bool
) -> None:
    lines = [printed(COLUMNS, 18, right)]
    for k, row in enumerate(CLEAN):
        cells = [f"{v:.9f}" for v in row]
        if k % 7 == 5:
            cells[2] = ""
        lines.append(printed(cells, 18, right))
    path = tmp_path / "log.txt"
    path.write_text("\n".join(lines) + "\n")
    log = read_log(path)
    gone = np.arange(len(CLEAN)) % 7 == 5
    assert np.isnan(log.z[:, 1]).tolist() == gone.tolist()
    np.testing.assert_allclose(log.z[:, (0, 2)], CLEAN[:, (1, 3)], atol=1e-8)
    np.testing.assert_allclose(log.z[~gone, 1], CLEAN[~gone, 2], atol=1e-8)


def test_names_with_blanks_and_exponents_of_fortran_through_a_proposed_map(tmp_path: Path) -> None:
    names = ["Time [s]", "Volt [V]", "Current [A]", "Pos [m]", "Pitch [deg]", "Cmd [rad/s]"][: len(COLUMNS)]
    rows = [printed([f"{v:.9E}".replace("E", "D") for v in row], 20, True) for row in CLEAN]
    path, column_map = tmp_path / "log.dat", tmp_path / "map.toml"
    path.write_text("\n".join([printed(names, 20, True), *rows]) + "\n")
    column_map.write_text(inspect_log(str(path)).column_map)
    log = read_log(path, load_columns(column_map))
    np.testing.assert_allclose(log.z, CLEAN[:, 1:4], atol=1e-8)


def test_a_word_that_stands_under_two_columns_is_put_under_none() -> None:
    columns = BlankColumns(2)
    assert (
        b"".join(columns.tabbed([b"1.0  2.0\n     3.0\n  55555\n# 1 2 3\n"]))
        == b"1.0\t2.0\n\t3.0\n55555\n# 1 2 3\n"
    )


def test_names_are_words_or_what_stands_farther_apart() -> None:
    assert blank_headers(" a b", 2) == ["a", "b"]
    assert blank_headers("Time base  Volt", 2) == ["Time base", "Volt"]
    assert blank_headers("Time [s] Volt [V]", 2) == ["Time [s]", "Volt [V]"]
