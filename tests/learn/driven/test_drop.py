"""Brushes and the dead time of a converter take a voltage that turns with the current: no inductance, and no channel is late."""

from dataclasses import replace
from functools import cache
from typing import Any

import hidden
import pytest
from drawn_sheets import drawn_sheet
from hidden.effects import effect

from observer_fi.learn import identified_rig, identify
from observer_fi.learn.equation_errors import with_equation_errors
from observer_fi.logs import filtered_logger, log_from_frame, with_command, with_logger
from observer_fi.physics import rig_of_sheet
from observer_fi.records import Fit, Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

KNEES = (0.02, 0.1, 0.4)  # of the current that friction takes
GROSS = 0.3  # of the voltage that friction takes


def drops(actuator: hidden.Actuator, share: float, spec: Any, seed: int) -> tuple[Log, float]:
    """A log, and the drop in it [V]."""
    friction = actuator.rig.A / actuator.rig.Km
    volts = share * friction * actuator.rig.Rm
    brushes = (effect("brush_drop", drop=volts, knee=KNEES[actuator.seed % 3] * friction),) if share else ()
    frame, _ = hidden.actuator_log(actuator, replace(spec, effects=(*spec.effects, *brushes)), seed)
    return log_from_frame(frame), volts


@cache
def learned(seed: int, share: float) -> tuple[hidden.Actuator, Fit, float]:
    actuator = hidden.draw_actuator(seed, "voltage")
    log, volts = drops(actuator, share, hidden.healthy_spec(actuator), seed)
    return actuator, identify([log], rig_of_sheet(drawn_sheet(actuator, "voltage")).rig), volts


def of(fit: Fit, name: str) -> tuple[float, float]:
    p = next(p for p in fit.parameters if p.name == name)
    return p.value, (p.high - p.low) / 3.92


@pytest.mark.slow
@pytest.mark.first(2)
@pytest.mark.parametrize("seed", [863740, 863743, 863745, 863502, 863505, 863750, 863752])
def test_a_gross_drop_is_told_with_its_size_and_moves_no_constant(seed: int) -> None:
    actuator, fit, volts = learned(seed, GROSS)
    assert of(fit, "brush_drop")[0] == pytest.approx(volts, rel=0.15)
    for name in ("Rm", "Km", "J", "A"):
        value, std = of(fit, name)
        assert abs(value - getattr(actuator.rig, name)) < 3.0 * std + 1e-3 * value, name
    assert not fit.filters and fit.inductance is None
    assert any("brush_drop" in text for text in fit.warnings)


@pytest.mark.slow
@pytest.mark.first(2)
@pytest.mark.parametrize("seed", [863503, 863504, 863507, 863501, 863500, 863506])
def test_a_small_drop_is_no_channel_that_is_late_and_no_inductance(seed: int) -> None:
    actuator, fit, _ = learned(seed, 0.05)
    value, std = of(fit, "Rm")
    assert 0.0 < value / actuator.rig.Rm - 1.0 < 0.08, "as a resistance it is a twentieth"
    assert not fit.filters and fit.inductance is None
    if actuator.logger.rate_hz > 100.0:
        assert abs(value - actuator.rig.Rm) < 4.0 * std
    value, std = of(fit, "Km")
    assert abs(value - actuator.rig.Km) < 3.0 * std


@pytest.mark.parametrize("seed", [863740, 863502, 863506])
def test_none_is_told_of_a_winding_without_one(seed: int) -> None:
    _, fit, _ = learned(seed, 0.0)
    assert not {p.name for p in fit.parameters} & {"brush_drop", "brush_current"}


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("label", ["nominal", "overload", "coupling_loss"])
@pytest.mark.parametrize("seed", [863740, 863750, 863751, 863752])
def test_verdicts_of_moves_with_a_drop(seed: int, label: str) -> None:
    actuator, fit, _ = learned(seed, GROSS)
    campaign, _ = drops(actuator, GROSS, hidden.healthy_spec(actuator), seed)
    found = identified_rig(fit, rig_of_sheet(drawn_sheet(actuator, "voltage")).rig)
    campaign = with_command(campaign, found)
    logged = filtered_logger(with_logger(found, [campaign]), fit.filters, campaign.rate_hz)
    rig = with_equation_errors(logged, [campaign], fit.filters)
    log, _ = drops(actuator, GROSS, hidden.fault_spec(actuator, label, seed), seed + 1)
    told = diagnose_log(log, rig, Settings()).isolation
    assert told is not None
    assert (told.verdict.label, told.verdict.probability > 0.95) == (label, True)
