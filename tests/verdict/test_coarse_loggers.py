"""Loggers of vehicles and controllers: slow, in few digits, late or without the command; right, or not sure."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, make_log

from observer_fi.logs import log_from_frame, recover_command
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

EVERY, LATE = 16, 32  # samples at 1600 Hz from row to row, and by which a command is logged late
STEPS = {"voltage_v": 0.1, "current_a": 0.01, "position_m": 1e-4}
LABELS = ("nominal", "overload", "coupling_loss", "slip", "jam")
Logger = Callable[[pd.DataFrame], pd.DataFrame]


def rounded(frame: pd.DataFrame) -> pd.DataFrame:
    """As a vehicle's bus has them, at 100 Hz; the position at 50."""
    coarse = frame.assign(**{c: np.round(frame[c] / step) * step for c, step in STEPS.items()})
    held = np.arange(len(frame)) // LATE * LATE
    return coarse.assign(position_m=coarse["position_m"].to_numpy()[held])


def of_a_bus(frame: pd.DataFrame) -> pd.DataFrame:
    return rounded(frame).iloc[::EVERY].drop(columns="speed_cmd_rad_s")


def of_a_bus_with_a_late_command(frame: pd.DataFrame) -> pd.DataFrame:
    late = frame["speed_cmd_rad_s"].shift(LATE, fill_value=0.0).round()
    return rounded(frame).assign(speed_cmd_rad_s=late).iloc[::EVERY]


def of_a_controller(frame: pd.DataFrame) -> pd.DataFrame:
    """The mean current of a cycle in steps, and no voltage."""
    mean = frame["current_a"].rolling(EVERY, min_periods=1).mean()
    return frame.assign(current_a=np.round(mean / 0.0075) * 0.0075).iloc[::EVERY].drop(columns="voltage_v")


def log_of(logger: Logger, label: str, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What is logged, and the truth at every sample of it."""
    frame = make_log(draw_move_case(seed, label), seed)[0]
    return logger(frame).reset_index(drop=True), frame.iloc[::EVERY].reset_index(drop=True)


@pytest.mark.parametrize("seed", range(9_210_000, 9_210_006))
def test_a_command_is_recovered_from_few_digits_within_a_row(seed: int) -> None:
    logged, truth = log_of(of_a_bus, LABELS[seed % 5], seed)
    w = recover_command(log_from_frame(logged), load_rig().model).w_cmd
    told = truth["speed_cmd_rad_s"].to_numpy()
    assert np.count_nonzero((w != 0.0) != (told != 0.0)) <= 3  # a start and a stop, either by a row
    assert np.median(np.abs(w[told != 0.0])) == pytest.approx(
        np.abs(told).max(), abs=8.0
    )  # a step of the current is 9.5 rad/s


@pytest.mark.slow
@pytest.mark.parametrize("logger", [of_a_bus, of_a_bus_with_a_late_command, of_a_controller])
def test_a_verdict_is_right_or_not_sure(logger: Logger) -> None:
    wrong, right = [], 0
    for seed in range(9_240_000, 9_240_010):
        label = LABELS[seed % 5]
        outcome = diagnose_log(log_from_frame(log_of(logger, label, seed)[0]), load_rig(), Settings())
        verdict = outcome.isolation.verdict
        right += label in (verdict.label, *verdict.alike)
        if verdict.label not in (label, "not_tested") and verdict.probability > 0.95:
            wrong.append((seed, label, verdict.label, verdict.channel, verdict.probability))
    assert len(wrong) <= 1, wrong
    assert right >= 7
