"""Windings with inductance, and slow logs: constants of the independent truth, which has what the equations leave out."""

from dataclasses import replace

import hidden
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import identify
from observer_fi.learn.servo.inductance import behind_inductance, winding_of
from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import Rig, rig_of_sheet
from observer_fi.records import Fit, Parameter
from pipelines import rigs_study


def fitted(
    drive: str, seed: int, tau_s: float = 0.0, rate_hz: float = 0.0
) -> tuple[hidden.Actuator, Rig, Fit]:
    """A drawn actuator, what its data sheet says to 3 %, and what its campaign tells. tau_s: of its winding."""
    actuator = hidden.draw_actuator(seed, drive)
    actuator = replace(actuator, rig=replace(actuator.rig, L=tau_s * (actuator.rig.Rm + actuator.rig.Rs)))
    if rate_hz:
        actuator = replace(actuator, logger=replace(actuator.logger, rate_hz=rate_hz))
    rig = rig_of_sheet(drawn_sheet(actuator, drive)).rig
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    return actuator, rig, identify([with_command(log_from_frame(frame), rig)], rig)


@pytest.mark.slow
def test_a_loop_that_is_fed_forward_has_no_winding_of_seconds() -> None:
    """Its error makes no command: the campaign was one rest, which told a mean of 5614 voltages and 28 mH; `identify` failed."""
    actuator = hidden.draw_actuator(660_101, "position_servo")
    rig = rigs_study._from_sheet(actuator)
    spec = replace(hidden.healthy_spec(actuator), speed_forward=1.0, torque_forward=1.0)
    log = rigs_study._read(hidden.actuator_log(actuator, spec, 660_101)[0], rig)
    assert winding_of([log], rig) is None


@pytest.mark.parametrize(("left", "winding"), [(1.05, True), (1.45, False)])
def test_a_winding_that_makes_the_current_worse_is_none(left: float, winding: bool) -> None:
    """A motor without an inductance that starts softly had one: its Kp was 3 % off, and a healthy move a jam for sure."""
    found = Parameter("inductance", 4e-3, 9e-4, 0.0, "H", 2e-3, 6e-3)
    before = Fit((), None, {}, 9.9, {"current_a": 1.33e-3, "speed_rad_s": 0.07}, {})
    behind = replace(before, nll_per_sample=-11.0, rmse={"current_a": left * 1.33e-3, "speed_rad_s": 0.2})
    told = behind_inductance(behind, before, replace(before, inductance=found))
    assert (told.inductance is not None) is winding


def holds(actuator: hidden.Actuator, fit: Fit, *names: str) -> int:
    """How many of these intervals hold the truth, of those that were told."""
    return sum(p.low <= getattr(actuator.rig, p.name) <= p.high for p in fit.parameters if p.name in names)


@pytest.mark.parametrize(("seed", "tau_s"), [(720_000, 5e-4), (720_001, 1.5e-3), (720_003, 3e-3)])
@pytest.mark.first(1)
def test_an_inductance_makes_no_resistance_smaller_and_is_told(seed: int, tau_s: float) -> None:
    """Rm was up to 16 % low and J 30 % high, with intervals of a few percent."""
    actuator, _, fit = fitted("voltage", seed, tau_s)
    assert holds(actuator, fit, "Rm", "Km", "J", "A") >= 3
    found = {p.name: p.value for p in fit.parameters}
    assert abs(found["Rm"] / actuator.rig.Rm - 1.0) < 0.03
    assert abs(found["J"] / actuator.rig.J - 1.0) < 0.08
    assert any("mH in the winding" in told for told in fit.warnings)


def test_a_winding_without_one_is_told_nothing_of() -> None:
    actuator, _, fit = fitted("voltage", 720_000)
    assert not fit.warnings and not fit.filters and holds(actuator, fit, "Rm", "Km", "J", "A") >= 3


@pytest.mark.parametrize("seed", [720_001, 720_002, 720_004])
@pytest.mark.first(1)
def test_a_log_of_fifty_samples_a_second_tells_no_more_than_it_can(seed: int) -> None:
    """What lies between its samples widens the intervals, and the data sheet counts where the log says less."""
    actuator, rig, fit = fitted("voltage", seed, rate_hz=50.0)
    told = {p.name: p for p in fit.parameters}
    constants = told.keys() & {"Rm", "Km", "J", "A"}
    assert holds(actuator, fit, *constants) == len(constants)
    assert told["Rm"].std < 0.12 * rig.model["Rm"]
    assert all(p.std < 0.3 * abs(p.value) for name, p in told.items() if name in constants)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("drive", ["pi_servo", "position_servo"])
def test_a_servo_is_learned_behind_the_inductance_of_its_motor(drive: str) -> None:
    """Taken for a resistance and a servo, it made Rm 0.6 %, J 2 % and Ki 16 % of the truth off, at intervals a tenth of that."""
    actuator, _, fit = fitted(drive, 700_000, 1.5e-3)
    found = {p.name: p.value for p in fit.parameters}
    assert any("mH in the winding" in told for told in fit.warnings)
    assert all(abs(found[n] / getattr(actuator.rig, n) - 1.0) < 2e-3 for n in ("Rm", "Km", "A", "J"))
    assert holds(actuator, fit, "Rm", "Km", "A", "J", "Kp", "Ki") >= 5
