"""Loggers of vehicles and controllers: slow, in few digits, late or without the command; right, or not sure."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, make_log
from moves import sure_of

from observer_fi.logs import log_from_frame, recover_command
from observer_fi.physics import load_rig
from observer_fi.records import Acquisition, ChannelTraits, Clock, Consistency, Severity
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.testable import or_a_slip
from observer_fi.verdict.wrong_rig import or_unexplained

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
@pytest.mark.first(1)
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


# --- what is shared ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("low", "shared"), [(-1.0, True), (0.5, False)])
def test_an_obstacle_that_may_press_back_with_nothing_may_be_a_slip(low: float, shared: bool) -> None:
    event = sure_of("overload", 1.0, 2.0)._replace(
        severity=(Severity("stiffness", 2.0, (low, 5.0), "N m/m^2", ""),)
    )
    told = or_a_slip(event, SimpleNamespace(recent=None), load_rig())
    assert told.alike == (("slip",) if shared else ()) and told.probability == (0.5 if shared else 1.0)


@pytest.mark.parametrize(("travel", "shared"), [(5e-4, True), (3e-3, False)])
def test_an_obstacle_of_less_than_a_step_of_the_current_may_be_a_slip(travel: float, shared: bool) -> None:
    """The paper's, C d^2 / Km: 1.4 mA in half a millimetre, 50 mA in three."""
    t = np.linspace(0.0, 2.0, 200)
    z = np.column_stack((0.0 * t, 0.0 * t, travel * np.maximum(t - 1.0, 0.0)))
    recent = SimpleNamespace(t=t, z=z, active=np.ones(t.size, dtype=bool))
    coarse = ChannelTraits(0.0, 4e-3, 0.01)
    fine = ChannelTraits(3e-4, 3e-4)
    for current, expected in ((coarse, shared), (fine, False)):
        rig = replace(load_rig(), logger=Acquisition(fine, current, fine, Clock(0.0, None, 0.01)))
        told = or_a_slip(sure_of("overload", 1.0, 2.0), SimpleNamespace(recent=recent), rig)
        assert ("slip" in told.alike) is expected


@pytest.mark.parametrize("label", ["nominal", "jam", "sensor_fault", "unknown"])
@pytest.mark.parametrize("times", [1.2, 4.0])
def test_the_least_bad_hypothesis_of_the_actuator_is_not_sure(label: str, times: float) -> None:
    (told,) = or_unexplained([sure_of(label, 1.0, 2.0)], Consistency(3.0 * times, 3.0, 0.5))
    doubted = times > 2.5 and label in ("nominal", "jam")
    assert (told.probability, told.alike) == ((0.5, ("unknown",)) if doubted else (1.0, ()))


def test_a_fault_that_the_whole_move_told_with_its_size_stands() -> None:
    event = sure_of("jam", 1.0, 2.0)._replace(severity=(Severity("friction_rise", 1.0, (0.9, 1.1), "1", ""),))
    assert or_unexplained([event], Consistency(12.0, 3.0, 0.5)) == (event,)
