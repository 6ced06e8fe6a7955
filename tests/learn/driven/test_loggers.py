"""Constants of rigs without a known servo from what real loggers keep of a campaign."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import hidden
import numpy as np
import pandas as pd
import pytest
from drawn_sheets import drawn_sheet
from scipy.signal import lfilter

from observer_fi.learn import identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, rig_of_sheet
from observer_fi.records import Fit

CURRENT, VOLTAGE, POSITION = "current_a", "voltage_v", "position_m"
Logger = Callable[[pd.DataFrame], pd.DataFrame]


def held(*columns: str, rows: int) -> Logger:
    def logger(frame: pd.DataFrame) -> pd.DataFrame:
        stands = np.arange(len(frame)) // rows * rows
        return frame.assign(**{column: frame[column].to_numpy()[stands] for column in columns})

    return logger


def late(column: str, samples: float) -> Logger:
    def logger(frame: pd.DataFrame) -> pd.DataFrame:
        t = frame["time_s"].to_numpy()
        return frame.assign(**{column: np.interp(t - samples * np.median(np.diff(t)), t, frame[column])})

    return logger


def filtered(frame: pd.DataFrame, corner: float) -> pd.DataFrame:
    """The current behind a low-pass. corner: of the sampling rate."""
    keep = np.exp(-2.0 * np.pi * corner)
    current = frame[CURRENT].to_numpy()
    return frame.assign(**{CURRENT: current[0] + lfilter([1.0 - keep], [1.0, -keep], current - current[0])})


LOGGERS: dict[str, tuple[Logger, tuple[str, ...], tuple[tuple[str, float], ...]]] = {
    "as it is": (lambda frame: frame, ("voltage", "current"), ()),
    "position held for 3 rows": (held(POSITION, rows=3), ("voltage", "current"), ()),
    "current held for 4 rows": (held(CURRENT, rows=4), ("voltage", "current"), ()),
    "voltage held for 4 rows": (held(VOLTAGE, rows=4), ("voltage",), ()),
    "all held, at rates of their own": (
        lambda frame: held(POSITION, rows=5)(held(CURRENT, VOLTAGE, rows=2)(frame)),
        ("voltage",),
        (),
    ),
    "current half a sample late": (late(CURRENT, 0.5), ("voltage",), (("current", 0.5),)),
    "voltage a sample late": (late(VOLTAGE, 1.0), ("voltage",), (("voltage", 1.0),)),
    "position a sample late": (late(POSITION, 1.0), ("voltage", "current"), ()),
    "current filtered": (partial(filtered, corner=0.1), ("voltage", "current"), ()),
}
CASES = [
    (name, drive, seed)
    for name, (_, drives, _) in LOGGERS.items()
    for drive in drives
    for seed in (863006, 863009)
]


@cache
def learned(name: str, drive: str, seed: int) -> tuple[hidden.Actuator, Fit]:
    actuator = hidden.draw_actuator(seed, drive)
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    rig = rig_of_sheet(drawn_sheet(actuator, drive)).rig
    return actuator, identify([log_from_frame(LOGGERS[name][0](frame))], rig)


def in_standard_errors(rig: Rig, fit: Fit) -> dict[str, float]:
    return {
        p.name: (p.value - getattr(rig, p.name)) / ((p.high - p.low) / 3.92)
        for p in fit.parameters
        if p.name in ("Rm", "Km", "J", "A")
    }


@pytest.mark.parametrize(("name", "drive", "seed"), CASES)
@pytest.mark.first(2, 8)
def test_constants_are_as_good_as_they_say(name: str, drive: str, seed: int) -> None:
    """Rm was off by up to 28 standard errors behind a current that is late, J by 6 behind a position that is held."""
    actuator, fit = learned(name, drive, seed)
    off = in_standard_errors(actuator.rig, fit)
    assert {"J", "A"} <= off.keys() and max(map(abs, off.values())) < 4.0
    assert fit.inductance is None


@pytest.mark.parametrize("name", [name for name, (_, _, told) in LOGGERS.items() if told])
@pytest.mark.parametrize("seed", [863006, 863009])
@pytest.mark.first(1, 2)
def test_a_channel_that_is_late_is_told(name: str, seed: int) -> None:
    told = {f.channel: f.late for f in learned(name, "voltage", seed)[1].filters}
    for channel, samples in LOGGERS[name][2]:
        assert told[channel] == pytest.approx(samples, abs=0.1)


@pytest.mark.parametrize("seed", [863006, 863009])
@pytest.mark.first(1, 2)
def test_no_channel_is_late_in_a_log_that_is_as_it_is(seed: int) -> None:
    assert learned("as it is", "voltage", seed)[1].filters == ()


@pytest.mark.parametrize(("seed", "late_by"), [(863301, 0.0), (863301, 0.5), (863302, 0.5), (863306, 0.5)])
@pytest.mark.first(1, 2)
def test_an_inductance_beside_a_current_that_is_late_makes_no_constant_wrong(
    seed: int, late_by: float
) -> None:
    """An inductance is told; a winding that nothing tells from a lateness widens what is said of it."""
    actuator = hidden.draw_actuator(seed, "voltage")
    R = actuator.rig.Rm + actuator.rig.Rs
    actuator = replace(actuator, rig=replace(actuator.rig, L=1.5e-3 * R))
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    rig = rig_of_sheet(drawn_sheet(actuator, "voltage")).rig
    fit = identify([log_from_frame(late(CURRENT, late_by)(frame))], rig)
    assert max(map(abs, in_standard_errors(actuator.rig, fit).values())) < 4.0
    assert fit.inductance is not None
    assert abs(fit.inductance.value - 1.5e-3 * R) < 4.0 * fit.inductance.std + 0.15e-3 * R
