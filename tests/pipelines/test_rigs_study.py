"""The study of other actuators, on one of them; and what it draws."""

from pathlib import Path

import hidden
import numpy as np
import pandas as pd
import pytest

from pipelines import rigs_study


@pytest.mark.parametrize("drive", hidden.DRIVEN_BY)
def test_actuators_are_drawn_over_decades_and_their_moves_fit(drive: str) -> None:
    drawn = [hidden.draw_actuator(seed, drive) for seed in range(40)]
    power = [a.power_w for a in drawn]
    assert min(power) < 3.0 and max(power) > 300.0
    for a in drawn:
        spec = hidden.healthy_spec(a)
        assert all(m.hold_s > abs(m.speed) / a.rig.accel for m in spec.profile.moves)
        top = a.rig.Vmax / a.rig.Km
        assert 0.5 * a.rig.Km * a.rig.Vmax / a.rig.Rm > a.rig.A and a.speed < top


def test_a_sheet_is_near_the_truth_and_not_on_it() -> None:
    a = hidden.draw_actuator(7, "voltage")
    sheet = hidden.data_sheet(a)
    printed = float(sheet[sheet.index("--resistance") + 1].split()[0])
    assert 0.0 < abs(printed / a.rig.Rm - 1.0) < 0.11


def test_a_log_has_the_columns_and_steps_of_its_drive() -> None:
    a = hidden.draw_actuator(3, "current")
    frame, truth = hidden.actuator_log(a, hidden.fault_spec(a, "jam", 1), 1)
    assert list(frame.columns) == ["time_s", "current_a", "position_m"] and truth["label"] == "jam"
    steps = frame["current_a"].to_numpy() / a.steps[1]
    assert np.abs(steps - np.round(steps)).max() < 1e-3


@pytest.mark.study
@pytest.mark.slow
def test_one_actuator_from_data_sheet_to_report(tmp_path: Path) -> None:
    out = tmp_path / "rigs.md"
    options = ["--rigs", "1", "--first", "104", "--drives", "voltage", "--sheets", "--out", str(out)]
    assert rigs_study.main(options) == 0
    text = out.read_text(encoding="utf-8")
    assert "Right: 6 of 6 moves. Confident (above 0.95) and wrong: 0." in text


def test_intervals_are_counted_beside_the_truth(tmp_path: Path) -> None:
    out, rows = tmp_path / "intervals.md", tmp_path / "rows.csv"
    options = ["--intervals", "--rigs", "1", "--first", "104", "--drives", "current"]
    assert rigs_study.main([*options, "--out", str(out), "--rows", str(rows)]) == 0
    found = pd.read_csv(rows)
    inside = found["truth"].between(found["low"], found["high"])
    assert {"J", "A"} <= set(found["constant"]) and (found["held"] == inside).all()
    assert (found["held"] == (found["error"].abs() < 1.96)).all()
    assert f"current {inside.sum()} of {len(found)}." in out.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.study
def test_names_are_counted_beside_what_is_hidden(tmp_path: Path) -> None:
    out, rows = tmp_path / "causes.md", tmp_path / "rows.csv"
    options = ["--causes", "--rigs", "1", "--first", "852002", "--drives", "current"]
    assert rigs_study.main([*options, "--out", str(out), "--rows", str(rows)]) == 0
    found = pd.read_csv(rows, keep_default_na=False)
    assert list(found["hidden"]) == ["none", "viscous_friction"] == list(found["named"])
    text = out.read_text(encoding="utf-8")
    assert "current with none: 1 of 1, current with viscous_friction: 1 of 1." in text
