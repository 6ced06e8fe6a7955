"""Motors whose winding has an inductance, of the independent truth: moves with the rig file that `identify` writes."""

from dataclasses import replace
from functools import cache

import hidden
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import identified_rig, identify, with_equation_errors
from observer_fi.logs import log_from_frame, with_command, with_logger
from observer_fi.physics import Rig, rig_of_sheet
from observer_fi.records import Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log


@cache
def learned(drive: str, seed: int, tau_s: float, rate_hz: float) -> tuple[hidden.Actuator, Rig]:
    """A drawn actuator, and its rig as data sheet and campaign tell it. tau_s: of its winding."""
    drawn = hidden.draw_actuator(seed, drive)
    actuator = replace(
        drawn,
        rig=replace(drawn.rig, L=tau_s * (drawn.rig.Rm + drawn.rig.Rs)),
        logger=replace(drawn.logger, rate_hz=rate_hz),
    )
    rig = rig_of_sheet(drawn_sheet(actuator, drive)).rig
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    log = with_command(log_from_frame(frame), rig)
    found = identified_rig(identify([log], rig), rig)
    log = with_command(log, found)
    return actuator, with_equation_errors(with_logger(found, [log]), [log])


def said(actuator: hidden.Actuator, rig: Rig, label: str) -> Outcome:
    frame, _ = hidden.actuator_log(
        actuator, hidden.fault_spec(actuator, label, actuator.seed), actuator.seed + 1
    )
    return diagnose_log(with_command(log_from_frame(frame), rig), rig, Settings())


def named(outcome: Outcome, label: str) -> bool:
    assert outcome.isolation is not None
    verdict = outcome.isolation.verdict
    return verdict.label == label or label in verdict.alike


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "tau_s", "rate_hz"), [(810_006, 3e-3, 2000.0), (830_002, 1.5e-3, 500.0)])
@pytest.mark.first(1)
def test_a_start_behind_an_inductance_is_no_failed_sensor(seed: int, tau_s: float, rate_hz: float) -> None:
    """Both healthy moves were a failed current sensor for sure."""
    actuator, rig = learned("voltage", seed, tau_s, rate_hz)
    assert rig.inductance is not None
    assert rig.inductance.value == pytest.approx(actuator.rig.L, rel=0.05)
    outcome = said(actuator, rig, "nominal")
    assert named(outcome, "nominal")
    assert any("in the winding" in warning for warning in outcome.warnings)
    assert named(said(actuator, rig, "jam"), "jam")


@pytest.mark.slow
@pytest.mark.parametrize("label", ["nominal", "overload", "sensor_fault"])
@pytest.mark.first(1)
def test_a_servo_behind_an_inductance(label: str) -> None:
    """A voltage that freezes behind an inductance was a position sensor for sure, healthy moves an overload."""
    actuator, rig = learned("position_servo", 830_010, 1.5e-3, 500.0)
    outcome = said(actuator, rig, label)
    assert named(outcome, label)
    assert outcome.isolation is not None
    assert label != "sensor_fault" or outcome.isolation.verdict.channel == "voltage"
