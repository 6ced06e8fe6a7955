"""Verdicts through converters, buses and historians: steps that grow with the reading, dead bands, pulses, packets, ranges."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, draw_severity_case, make_log

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

SIGMA = {"voltage_v": 10e-3, "current_a": 0.3e-3, "position_m": 10e-6}


def ranging(frame: pd.DataFrame) -> pd.DataFrame:
    """A converter of ten bits whose range follows the reading."""
    top = {"voltage_v": 20.0, "current_a": 1.0, "position_m": 5e-3}
    for column, most in top.items():
        octave = np.clip(np.ceil(np.log2(np.abs(frame[column]) / most + 1e-12)), -8, 0)
        step = most * 2.0**octave / 2**9
        frame[column] = np.round(frame[column] / step) * step
    return frame


def reported(frame: pd.DataFrame) -> pd.DataFrame:
    """What has changed by more than four standard deviations of its noise."""
    for column, sigma in SIGMA.items():
        out = frame[column].to_numpy().copy()
        for k in range(1, out.size):
            out[k] = out[k] if abs(out[k] - out[k - 1]) > 4.0 * sigma else out[k - 1]
        frame[column] = out
    return frame


def pulses(frame: pd.DataFrame) -> pd.DataFrame:
    """A converter's pulses, folded to 137 Hz, as large as the voltage is."""
    line = 0.15e-3 * frame["voltage_v"].abs() * np.sin(2.0 * np.pi * 137.0 * frame["time_s"] + 1.0)
    return frame.assign(current_a=frame["current_a"] + line)


def packets(frame: pd.DataFrame) -> pd.DataFrame:
    """Sixteen rows at a time, stamped as they arrive."""
    row, late = np.arange(len(frame)), np.random.default_rng(1).exponential(3e-4, len(frame))
    end = frame["time_s"].to_numpy()[np.minimum(row // 16 * 16 + 15, row[-1])]
    return frame.assign(time_s=end + 2e-5 * (row % 16) + late[row // 16])


def clipped(frame: pd.DataFrame) -> pd.DataFrame:
    """A current sensor whose range ends at six tenths of the largest current."""
    end = 0.6 * frame["current_a"].abs().max()
    return frame.assign(current_a=frame["current_a"].clip(-end, end))


LOGGERS = (ranging, reported, pulses, packets, clipped)


def right(logger: Callable[[pd.DataFrame], pd.DataFrame], label: str, seed: int) -> bool:
    frame, _ = make_log(draw_move_case(seed, label), seed)
    found = diagnose_log(log_from_frame(logger(frame.copy())), load_rig(), Settings()).isolation
    assert found is not None
    verdict = found.verdict
    assert verdict.label in (label, "not_tested") or label in verdict.alike or verdict.probability <= 0.95
    return verdict.label == label and verdict.probability > 0.95


@pytest.mark.parametrize("logger", LOGGERS)
def test_a_healthy_move_is_one(logger: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    assert right(logger, "nominal", 83_001)


@pytest.mark.slow
@pytest.mark.parametrize("logger", LOGGERS)
@pytest.mark.first(1)
def test_verdicts_depend_on_the_actuator(logger: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Of six moves none is confidently wrong, and at least five are right."""
    labels = ("nominal", "overload", "coupling_loss")
    assert sum(right(logger, labels[k % 3], 83_010 + k) for k in range(6)) >= 5


def of_the_reading(frame: pd.DataFrame, share: float, seed: int) -> pd.DataFrame:
    """Noise of so much of the voltage and of the current, as of a gain that is not steady."""
    rng = np.random.default_rng([seed, 5])
    for column in ("voltage_v", "current_a"):
        frame[column] += share * frame[column].abs() * rng.standard_normal(len(frame))
    return frame


def said_of_the_reading(kind: str, shape: str, share: float, seed: int) -> tuple[bool, float]:
    """Whether a verdict is right, or shared with what is, and its probability."""
    frame, _ = make_log(draw_severity_case(seed, kind, shape), seed)
    found = diagnose_log(log_from_frame(of_the_reading(frame, share, seed)), load_rig(), Settings()).isolation
    assert found is not None
    return kind in (found.verdict.label, *found.verdict.alike), found.verdict.probability


@pytest.mark.parametrize("shape", ["", "s_curve", "staircase", "without_rests"])
def test_noise_that_grows_with_the_reading_is_no_fault(shape: str) -> None:
    """Of fifty moves with 1 % a quarter were wrong for sure: a failed sensor, or no fault with a name."""
    assert said_of_the_reading("nominal", shape, 0.01, 83_101)[0]


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.003, 0.01, 0.03])
@pytest.mark.first(1)
def test_a_fault_shows_through_noise_that_grows_with_the_reading(share: float) -> None:
    cases = [
        (kind, shape) for kind in ("overload", "coupling_loss", "jam") for shape in ("", "soft_ramps", "sine")
    ]
    found = [said_of_the_reading(*case, share, 83_110 + k) for k, case in enumerate(cases)]
    assert sum(right for right, _ in found) >= len(cases) - 2
