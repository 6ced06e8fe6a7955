"""Samples of a servo that holds its current between two ticks: of any rate, and of any phase to the ticks.

The truth is the independent one, with ticks half a tick after time zero; another phase is a log of 48 kHz, of which rows are
taken.
"""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG
from drawn_sheets import drawn_sheet
from hidden.effects import effect

from observer_fi.learn import identify
from observer_fi.learn.identification import campaign_readings
from observer_fi.learn.servo.servo_ticks import Ticks
from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import rig_of_sheet, with_values
from observer_fi.records import Log

EVERY_HZ = 48e3
CONSTANTS = ("J", "A", "Kp", "Ki", "Rm", "Km")


def drawn(seed: int, rate_hz: float, servo_hz: float = 8000.0) -> tuple[Log, hidden.TruthSpec]:
    """A healthy campaign of a rig of the paper's spread."""
    substep = 48e3 if 48e3 % (2.0 * servo_hz) == 0.0 and 48e3 % rate_hz == 0.0 else 80e3
    spec = hidden.draw_effects_case(seed, (), 0.0)
    spec = replace(spec, logger=replace(spec.logger, rate_hz=rate_hz), servo_hz=servo_hz, substep_hz=substep)
    return log_from_frame(hidden.make_log(spec, seed)[0]), spec


def off_by(log: Log, spec: hidden.TruthSpec) -> np.ndarray:
    """How far constants of a fit are off, in standard errors."""
    found = {p.name: p for p in identify([log], RIG).parameters}
    return np.array([(found[n].value - getattr(spec.rig, n)) / found[n].std for n in CONSTANTS])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate_hz", "servo_hz"),
    [
        (1920.0, 8000.0),
        (3200.0, 8000.0),
        (1200.0, 8000.0),
        (1600.0, 5000.0),
        (1000.0, 1500.0),
    ],
)
@pytest.mark.first(1)
def test_ticks_that_a_log_does_not_divide_are_found(rate_hz: float, servo_hz: float) -> None:
    log, spec = drawn(871001, rate_hz, servo_hz)
    (ticks,) = campaign_readings([log], RIG).ticks
    assert ticks.rate_hz == pytest.approx(servo_hz, abs=0.01)
    assert f"{servo_hz:.0f} times a second" in ticks.told()
    if servo_hz >= 5e3:  # what a servo of fewer ticks does in between no model has
        assert np.abs(off_by(log, spec)).max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["acceleration_limit", "backlash", "viscous_friction"])
@pytest.mark.first(1)
def test_ticks_are_found_behind_a_fit_that_is_far_off(cause: str) -> None:
    spec = hidden.draw_effects_case(871003, (cause,), 3.0)
    spec = replace(spec, logger=replace(spec.logger, rate_hz=1920.0))
    (ticks,) = campaign_readings([log_from_frame(hidden.make_log(spec, 871003)[0])], RIG).ticks
    assert ticks.rate_hz == pytest.approx(8000.0, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [250.0, 1000.0, 1600.0, 4000.0])
@pytest.mark.first(1)
def test_a_log_whose_samples_are_as_old_as_each_other_stays_as_it_is(rate_hz: float) -> None:
    log, _ = drawn(871002, rate_hz)
    campaign = campaign_readings([log], RIG)
    assert campaign.ticks == ()
    assert campaign.known(RIG) is RIG
    np.testing.assert_array_equal(campaign.logs[0].z, log.z)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [871010, 871020, 871030])
def test_constants_do_not_ask_when_in_a_tick_a_log_samples(seed: int) -> None:
    """Six phases: without the age of the samples constants are up to 30 standard errors off."""
    spec = hidden.draw_effects_case(seed, (), 0.0)
    spec = replace(spec, logger=replace(spec.logger, rate_hz=EVERY_HZ))
    frame, _ = hidden.make_log(spec, seed)
    off = [off_by(log_from_frame(frame.iloc[first::30].reset_index(drop=True)), spec) for first in range(6)]
    assert np.abs(off).max() < 4.5
    assert np.sqrt(np.mean(np.square(off))) < 1.6


def test_age_is_the_time_since_a_tick() -> None:
    ticks = Ticks(8000.0, 0.25)
    since = np.array([0.0, 0.25, 0.5, 0.999])
    np.testing.assert_allclose(ticks.age((17.25 + since) / 8000.0), since / 8000.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.002, 0.02])
@pytest.mark.first(1)
def test_a_misfit_that_is_gross_makes_no_ticks(lag: float) -> None:
    """Of a position that lags rates of 4 to 14 kHz were told, and voltage and current changed by them."""
    actuator = hidden.draw_actuator(862000, "pi_servo")
    spec = replace(hidden.healthy_spec(actuator), effects=(effect("position_lag", lag=lag),))
    log = log_from_frame(hidden.actuator_log(actuator, spec, 862001)[0])
    names = ("Rm", "Rs", "Km", "D", "Vmax", "Kp", "Ki", "J", "A", "B")
    rig = with_values(
        rig_of_sheet(drawn_sheet(actuator, "pi_servo")).rig, {n: getattr(actuator.rig, n) for n in names}
    )
    assert campaign_readings([with_command(log, rig)], rig).ticks == ()
