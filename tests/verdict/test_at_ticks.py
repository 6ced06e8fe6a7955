"""Held voltage and current beside a servo that nobody knows are judged where they are fresh; all other logs row by row."""

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, draw_severity_case, make_log

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose, diagnose_log
from observer_fi.verdict.drift import SURE
from observer_fi.verdict.logger.at_ticks import at_ticks

KNOWN, UNKNOWN = load_rig(), load_rig().without_servo
BOTH = ("voltage_v", "current_a")
LABELS = ("nominal", "overload", "coupling_loss", "slip", "jam")


def held(
    frame: pd.DataFrame, hz: float, columns: tuple[str, ...] = BOTH, late_s: float = 0.0
) -> pd.DataFrame:
    """Readings that stand from tick to tick of a bus, whose first one comes so late."""
    t = frame["time_s"].to_numpy()
    ticks = np.floor((t - t[0] - late_s) * hz + 1e-6)
    first = np.searchsorted(ticks, ticks)
    return frame.assign(**{column: frame[column].to_numpy()[first] for column in columns})


def move(seed: int = 6_420_000, label: str = "nominal") -> pd.DataFrame:
    return make_log(draw_move_case(seed, label), seed)[0]


@pytest.mark.parametrize("hz", [60.0, 100.0, 400.0, 533.0])
@pytest.mark.parametrize("columns", [BOTH, ("current_a",)])
def test_rows_are_those_at_which_readings_are_fresh(hz: float, columns: tuple[str, ...]) -> None:
    frame = held(move(), hz, columns)
    if columns != BOTH:
        frame = frame.drop(columns="voltage_v")
    log = log_from_frame(frame)
    shown = at_ticks(log, UNKNOWN)
    lasts = log.t[-1] - log.t[0]
    assert shown.t.size == pytest.approx(hz * lasts, rel=0.03)
    new = np.flatnonzero(np.diff(log.z[:, 1])) + 1
    assert np.isin(log.t[new], shown.t).all()
    assert "rows" in shown.notes[-1]


def test_what_a_known_servo_foretells_is_judged_row_by_row() -> None:
    log = log_from_frame(held(move(), 400.0))
    assert at_ticks(log, KNOWN) is log


@pytest.mark.parametrize(
    "change",
    [
        lambda frame: frame,
        lambda frame: held(frame, 100.0, ("position_m",)),
        lambda frame: held(frame, 400.0, ("current_a",)),
        lambda frame: held(held(frame, 400.0, ("current_a",)), 400.0, ("voltage_v",), late_s=1.0 / 800.0),
        lambda frame: frame.assign(**{c: frame[c].round(d) for c, d in (("voltage_v", 1), ("current_a", 3))}),
    ],
)
def test_other_logs_stay_as_they_are(change) -> None:
    log = log_from_frame(change(move()))
    assert at_ticks(log, UNKNOWN) is log


def test_a_file_is_judged_as_a_log_in_memory(tmp_path) -> None:
    frame = held(make_log(draw_severity_case(6_420_001, "jam"), 6_420_001)[0], 400.0)
    frame.to_csv(tmp_path / "log.csv", index=False)
    told = [
        one.isolation.verdict
        for one in (
            diagnose(tmp_path / "log.csv", UNKNOWN, Settings()),
            diagnose_log(log_from_frame(frame), UNKNOWN, Settings()),
        )
    ]
    assert told[0].label == told[1].label and told[0].onset_s == pytest.approx(told[1].onset_s, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("hz", [160.0, 400.0, 640.0])
@pytest.mark.first(1)
def test_small_faults_of_an_unknown_servo_show_through_held_readings(hz: float) -> None:
    """A jam of a fifth to two fifths of the friction was an all-clear at 1.0, three of ten of them."""
    right, sure = 0, []
    for seed in range(6_430_000, 6_430_003):
        for label in LABELS:
            frame = held(make_log(draw_severity_case(seed, label), seed)[0], hz)
            said = diagnose_log(log_from_frame(frame), UNKNOWN, Settings()).isolation.verdict
            right += label in (said.label, *said.alike)
            if label not in (said.label, *said.alike) and said.probability > SURE:
                sure.append((seed, label, said.label, said.channel))
    assert right >= 14 and not sure, sure
