"""Rigs of data sheets alone: where their fits begin, and what their intervals are worth."""

from dataclasses import replace

import hidden
import pytest

from observer_fi.learn import identified_rig, identify
from observer_fi.learn.servo.servo_start import with_crawl, with_start
from observer_fi.physics import Rig
from observer_fi.records import Fit, Log
from pipelines import rigs_study


def learnt_from(seed: int, drive: str) -> tuple[hidden.Actuator, Rig, Log]:
    """An actuator, the rig file of its data sheet, and its healthy campaign."""
    actuator = hidden.draw_actuator(seed, drive)
    rig = rigs_study._from_sheet(actuator)
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    return actuator, rig, rigs_study._read(frame, rig)


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [61009, 61013])
def test_the_loop_of_a_position_servo_is_found_with_its_gains(seed: int) -> None:
    actuator, rig, log = learnt_from(seed, "position_servo")
    found = with_start([log], rig).model
    assert found["Kx"] == pytest.approx(actuator.loop, rel=6e-5)  # on it rests the scale of every speed
    for name in ("Kp", "Ki"):
        assert found[name] == pytest.approx(getattr(actuator.rig, name), rel=0.05), name


@pytest.mark.slow
def test_a_speed_that_is_fed_forward_is_no_proportional_loop() -> None:
    """A loop whose speed and torque are fed forward has no error to speak of: what was found of Kx was hundreds of times it."""
    actuator, rig, _ = learnt_from(61009, "position_servo")
    spec = replace(hidden.healthy_spec(actuator), speed_forward=1.0, torque_forward=1.0)
    log = rigs_study._read(hidden.actuator_log(actuator, spec, 61009)[0], rig)
    begun = with_start([log], rig)
    assert begun.model["Kx"] == rig.model["Kx"] and begun.quantities["Kx"].method == "guess"
    assert begun.quantities["J"].method == "from the logs" and begun.law is None
    assert rig.law is not None  # of a data sheet: nobody knows yet


@pytest.mark.slow
@pytest.mark.parametrize("seed", [70006])
def test_the_gains_of_a_stiff_speed_servo_are_found_with_a_motor_constant_that_is_off(seed: int) -> None:
    """A thousandth of Km outgrows the integral of the error within a move: Ki came out as nothing."""
    actuator, rig, log = learnt_from(seed, "pi_servo")
    found = with_start([log], rig).model
    for name in ("Kp", "Ki"):
        assert found[name] == pytest.approx(getattr(actuator.rig, name), rel=0.2), name


def test_a_command_counts_from_the_first_move_of_its_goal() -> None:
    _, rig, log = learnt_from(61013, "position_servo")
    whole = with_crawl(log, rig)
    assert log.position_cmd is not None
    assert (whole.w_cmd != 0.0).argmax() < (log.w_cmd != 0.0).argmax()
    assert (whole.w_cmd[-5:] == log.w_cmd[-5:]).all()  # and not while the goal stands


@pytest.mark.parametrize("seed", [400012, 400015])
@pytest.mark.slow
@pytest.mark.first(1)
def test_a_position_loop_that_goes_on_in_its_rests_moves_no_gain(seed: int) -> None:
    """The current of a rest is none of the start, and a step of the encoder none of the command: gains were 8 to 17 std off."""
    actuator, rig, log = learnt_from(seed, "position_servo")
    found = {p.name: p for p in identify([log], rig).parameters}
    for name in ("J", "A", "Kp", "Ki", "Rm", "Km"):
        assert abs(found[name].value - getattr(actuator.rig, name)) < 3.5 * found[name].std, name


def test_a_log_of_a_hundred_samples_a_second_says_what_lies_between_them() -> None:
    """Rm and J were 2.5 % off, six and seven standard errors: what every second sample changes tells of what is lost."""
    actuator, rig, log = learnt_from(412006, "voltage")
    found = {p.name: p for p in identify([log], rig).parameters}
    for name in ("Rm", "Km", "J", "A"):
        assert found[name].low < getattr(actuator.rig, name) < found[name].high, name
    assert found["Rm"].high - found["Rm"].low < 0.25 * actuator.rig.Rm


@pytest.mark.slow
def test_a_short_ramp_over_two_samples_of_a_slow_log_is_no_softer_one() -> None:
    """One of ten ramps began in one interval of 4 ms and ended in the next: J was 0.3 % off, seven standard errors."""
    actuator, rig, log = learnt_from(410012, "pi_servo")
    found = {p.name: p for p in identify([log], rig).parameters}
    for name in ("J", "A", "Kp", "Ki", "Rm", "Km", "Rs", "Vmax"):
        assert abs(found[name].value - getattr(actuator.rig, name)) < 3.5 * found[name].std, name
    assert abs(found["J"].value / actuator.rig.J - 1.0) < 5e-4


@pytest.mark.parametrize("seed", [61003, 61009, 61013])
def test_torques_of_a_log_without_a_voltage_are_as_good_as_the_makers_constant(seed: int) -> None:
    actuator, rig, log = learnt_from(seed, "current")
    fit = identify([log], rig)
    found = {p.name: p for p in fit.parameters}
    for name in ("J", "A"):
        assert found[name].low < getattr(actuator.rig, name) < found[name].high, name
        half = found[name].high - found[name].value
        assert 0.08 < half / found[name].value < 0.4
        assert found[name].std < 0.5 * half  # of the rig file, which has that constant as well
    assert "no voltage" in fit.not_identifiable["Km"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [61005, 61009, 61013])
@pytest.mark.first(1)
def test_a_position_servo_is_learnt_from_its_data_sheet(seed: int) -> None:
    actuator, rig, log = learnt_from(seed, "position_servo")
    fit: Fit = identify([log], rig)
    found = {p.name: p for p in fit.parameters}
    for name in ("Kp", "Ki", "J", "A", "Km", "D"):
        true = getattr(actuator.rig, name)
        # Between samples nobody knows how the loop's steps rang: gains are told to a percent, the rest to half of one.
        assert abs(found[name].value / true - 1.0) < (1e-2 if name in ("Kp", "Ki") else 5e-3), name
        assert abs(found[name].value - true) < 6.0 * found[name].std, name


def test_viscous_friction_that_was_fitted_both_ways_is_there_on_the_way_back() -> None:
    """It was written for the way forth alone: a healthy move back looked jammed from its first sample on."""
    actuator, rig, _ = learnt_from(621001, "current")
    size = 0.6 * actuator.rig.A / actuator.speed
    effects = (hidden.effect("viscous_friction", plus=size, minus=size),)
    spec = replace(hidden.healthy_spec(actuator), effects=effects)
    log = rigs_study._read(hidden.actuator_log(actuator, spec, 621001)[0], rig)
    found = identified_rig(identify([log], rig), rig).model
    for name in ("viscous_positive", "viscous_negative"):
        assert found[name] == pytest.approx(size, rel=0.05), name
