"""Voltage and current at rest tell a sensor that drifts in a log without a command, and nothing that happens to a motor does."""

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, make_log, make_log_with

from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, load_rig, with_values
from observer_fi.records import Acquisition, ChannelTraits, Clock, Consistency, Event, Isolation, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.balance_at_rest import or_unbalanced

RIG, SETTINGS = load_rig(), Settings()
QUIET = ChannelTraits(0.0, 0.0)
LOGGER = Acquisition(QUIET, QUIET, QUIET, Clock(0.0, None, 1.0 / 1600.0))
V, A = "voltage_v", "current_a"


def told_of(frame, label: str = "nominal", rig: Rig = RIG) -> Event:
    """What is said of a log of which a bank was sure that it is healthy, or has a fault of this label."""
    log = log_from_frame(frame)
    posterior = {"nominal": 0.0, "sensor_fault": 0.0, "overload": 0.0, "jam": 0.0} | {label: 1.0}
    end = float(log.t[-1])
    event = Event(label, None, 1.0, None, (None, None), None, None, 0.3, end, posterior)
    found = Isolation(event, (event,), Consistency(3.0, 3.0, 0.5))
    told = or_unbalanced(
        Outcome("log", None, isolation=found, acquisition=LOGGER), lambda: log, rig
    ).isolation
    assert told is not None
    return told.verdict


@pytest.mark.parametrize("seed", [5_950_000, 5_950_001])
@pytest.mark.parametrize(("column", "rate"), [(V, 0.08), (V, -0.08), (A, 6e-3)])
def test_a_sensor_that_drifts_shows_at_rest(column: str, rate: float, seed: int) -> None:
    frame, _ = make_log(draw_move_case(seed, "nominal"), seed)
    said = told_of(frame.assign(**{column: frame[column] + rate * frame["time_s"]}))
    assert (said.label, said.probability, said.alike) == ("nominal", 0.5, ("sensor_fault",))


@pytest.mark.parametrize(
    ("trait", "label"),
    [("ideal", "overload"), ("wandering", "nominal"), ("hum_50hz", "overload"), ("offsets", "nominal"), ("drive_off", "nominal"),
     ("steps_3_all", "nominal"), ("slow_200hz", "overload"), ("mid_move", "nominal"), ("no_voltage", "nominal")],
)  # fmt: skip
def test_no_fault_of_an_actuator_and_no_logger_does(trait: str, label: str) -> None:
    for seed in range(5_950_010, 5_950_014):
        frame, _ = make_log_with(trait, draw_move_case(seed, label), seed)
        assert told_of(frame, label).probability == 1.0, seed


@pytest.mark.slow
def test_a_voltage_that_drifts_from_the_first_sample_on_without_a_command_is_no_all_clear() -> None:
    frame, _ = make_log(draw_move_case(3_330_100, "nominal"), 3_330_100)
    drifting = frame.assign(**{V: frame[V] + 0.12 * frame["time_s"]}).drop(columns="speed_cmd_rad_s")
    found = diagnose_log(log_from_frame(drifting), RIG, SETTINGS).isolation
    assert found is not None
    assert found.verdict.probability <= 0.95 and "sensor_fault" in (found.verdict.label, *found.verdict.alike)


@pytest.mark.parametrize("ways", [(1.0, -1.0, 1.0), (1.0, 1.0, 1.0)])
def test_a_drop_of_brushes_turns_with_the_current_and_a_drift_does_not(ways: tuple[float, ...]) -> None:
    frame = holding(ways, drop=0.3)
    assert told_of(frame).probability == (1.0 if len(set(ways)) == 2 else 0.5)


def test_a_drop_that_the_rig_file_knows_is_none_to_wonder_at() -> None:
    frame = holding((1.0, 1.0, 1.0), drop=0.3)
    knows = with_values(RIG, {"brush_drop": 0.3, "brush_current": 1e-3}, {}, "identified")
    assert told_of(frame, rig=knows).probability == 1.0


def holding(ways: tuple[float, ...], drop: float) -> pd.DataFrame:
    """A rest without a current, then moves and rests in which friction holds a current in the directions `ways`."""
    half, i = 800, 0.03
    parts = [(0.0, 0.0), *(pair for way in ways for pair in ((way, way), (0.0, way)))]
    turns, flows = (np.repeat([pair[k] for pair in parts], half) for k in (0, 1))
    t, w, m = np.arange(turns.size) / 1600.0, 300.0 * turns, RIG.model
    current = i * flows
    noise = np.random.default_rng(4).normal(size=(t.size, 2)) * [2e-3, 1e-4]
    volts = m["Rm"] * current + m["Km"] * w + drop * np.sign(flows)
    columns = (
        t,
        volts + noise[:, 0],
        current + noise[:, 1],
        np.cumsum(m["D"] * w) / 1600.0,
        w,
        np.zeros(t.size),
    )
    names = ("time_s", V, A, "position_m", "speed_cmd_rad_s", "pitch_deg")
    return pd.DataFrame(dict(zip(names, columns, strict=True)))
