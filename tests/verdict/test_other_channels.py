"""A verdict that is sure of one channel, or told by one alone, is asked of the others."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hidden import draw_failing_case, draw_move_case, draw_severity_case, make_log, make_log_with
from moves import failing, sure_of

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Consistency, Event, Isolation, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.other_channels import or_another

RIG, SETTINGS = load_rig(), Settings()
V, X = "voltage_v", "position_m"


def verdict_on(frame: pd.DataFrame) -> Event:
    found = diagnose_log(log_from_frame(frame), RIG, SETTINGS).isolation
    assert found is not None
    return found.verdict


@pytest.mark.parametrize(
    ("truth", "label", "other"),
    [("nominal", "coupling_loss", "sensor_fault"), ("overload", "slip", "overload"), ("slip", "slip", None)],
)
@pytest.mark.parametrize("seed", [3320032, 3320034])
def test_what_the_position_tells_alone_is_told_with_what_the_motor_says(
    truth: str, label: str, other: str | None, seed: int
) -> None:
    """A lost coupling of which the motor feels nothing, and a slip under a load that came, are as well something else."""
    spec = draw_move_case(seed, truth)
    log = log_from_frame(make_log(replace(spec, rig=replace(spec.rig, C=10.0 * spec.rig.C)), seed)[0])
    wrong = sure_of(label, spec.fault.onset_s or 1.0, float(log.t[-1]))
    found = Isolation(wrong, (wrong,), Consistency(3.0, 3.0, 0.5))
    told = or_another(Outcome("log", None, isolation=found), lambda: log, RIG, SETTINGS).isolation
    assert told is not None
    expected = (1.0, ()) if other is None else (0.5, (other,))
    assert (told.verdict.probability, told.verdict.alike) == expected
    assert told.events == (told.verdict,)


@pytest.mark.parametrize(("channel", "probability"), [("voltage", 0.5), ("current", 1.0)])
def test_of_voltage_and_current_the_one_that_is_wrong_is_not_cleared(
    channel: str, probability: float
) -> None:
    for seed in (3320051, 3320052):
        frame, _ = make_log(failing(seed, "gain", "current", 1.5, 0.9), seed)
        log = log_from_frame(frame)
        said = sure_of("sensor_fault", 0.9, float(log.t[-1]))._replace(channel=channel)
        found = Isolation(said, (said,), Consistency(3.0, 3.0, 0.5))
        told = or_another(Outcome("log", None, isolation=found), lambda log=log: log, RIG, SETTINGS).isolation
        assert told is not None
        assert told.verdict.probability == probability


@pytest.mark.slow
def test_a_fault_without_a_name_may_be_of_a_recovered_command() -> None:
    frame, _ = make_log(draw_move_case(3330102, "nominal"), 3330102)
    drifting = frame.assign(**{V: frame[V] + 0.24 * frame["time_s"]}).drop(columns="speed_cmd_rad_s")
    assert verdict_on(drifting).probability <= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5920000, 5920003])
@pytest.mark.first(1)
def test_a_sensor_that_fails_before_the_actuator_does_not_hide_that(seed: int) -> None:
    """The position is read 25 times a second from shortly before an obstacle on: voltage and current feel that all the same."""
    frame, truth = make_log(draw_move_case(seed, "overload"), seed)
    rows, first = np.arange(len(frame)), int(np.searchsorted(frame["time_s"], truth["onset_s"] - 0.15))
    held = np.where(rows < first, rows, rows // 64 * 64)
    verdict = verdict_on(frame.assign(**{X: frame[X].to_numpy()[held]}))
    assert (verdict.label, verdict.probability) == ("sensor_fault", 0.5)
    assert "overload" in verdict.alike


@pytest.mark.slow
def test_a_sensor_that_fails_alone_is_sure_to() -> None:
    frame, _ = make_log(failing(5920004, "bias", "position", 3e-4, 0.9), 5920004)
    verdict = verdict_on(frame)
    assert (verdict.label, verdict.channel, verdict.alike) == ("sensor_fault", "position", ())
    assert verdict.probability > 0.95


@pytest.mark.slow
def test_an_obstacle_that_only_a_noisy_position_tells_may_be_its_sensor() -> None:
    """A bit of the position is stuck, behind a baseline that wanders: the motor would feel an obstacle."""
    spec = draw_failing_case(5_710_046, "stuck_bit", "position", 3.0)
    verdict = verdict_on(make_log_with("wandering", spec, 5_710_046)[0])
    assert "sensor_fault" in (verdict.label, *verdict.alike)


@pytest.mark.parametrize("seed", [5_960_006])
def test_an_obstacle_that_a_good_position_tells_is_sure(seed: int) -> None:
    """It is soft, and met shortly before the stop: the motor hardly feels it."""
    verdict = verdict_on(make_log(draw_severity_case(seed, "overload"), seed)[0])
    assert verdict.label == "overload" and verdict.alike == ()
