"""Logs without a commanded speed, whose servo nobody can check."""

from dataclasses import replace
from functools import cache

import hidden
import numpy as np
import pandas as pd
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import with_equation_errors
from observer_fi.logs import log_from_frame, with_command, with_logger
from observer_fi.physics import Rig, load_rig, rig_of_sheet, with_values
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.no_command import NOT_CHECKED, with_its_servo

TRUE = ("Rm", "Rs", "Km", "D", "Vmax", "Kp", "Ki", "J", "A", "B", "C", "E")


@cache
def known(seed: int) -> Rig:
    """The rig file of a drawn actuator whose logs have told every constant, and how far its equations are off."""
    actuator = hidden.draw_actuator(seed, "pi_servo")
    truth = {name: getattr(actuator.rig, name) for name in TRUE}
    told = {
        **truth,
        "accel_cmd": actuator.rig.accel,
        "A_decoupled": actuator.rig.A_loose,
        "J_decoupled": actuator.rig.J_loose,
    }
    rig = with_values(rig_of_sheet(drawn_sheet(actuator, "pi_servo")).rig, told, {}, "identified")
    healthy = [log_from_frame(hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)[0])]
    return with_equation_errors(with_logger(rig, healthy), healthy)


def soft(seed: int, label: str, share: float) -> pd.DataFrame:
    """A move whose ramps take `share` of the time at speed, without its command."""
    actuator = hidden.draw_actuator(seed, "pi_servo")
    spec = hidden.fault_spec(actuator, label, seed)
    move = spec.profile.moves[0]
    ramp = share * move.hold_s
    times = (0.0, move.start_s, move.start_s + ramp, move.brake_s, move.brake_s + ramp)
    profile = replace(spec.profile, curve=(times, (0.0, 0.0, move.speed, move.speed, 0.0)))
    return hidden.actuator_log(actuator, replace(spec, profile=profile), seed + 1)[0].drop(
        columns="speed_cmd_rad_s"
    )


def said(seed: int, label: str, share: float) -> Event:
    return diagnose_log(log_from_frame(soft(seed, label, share)), known(seed), Settings()).isolation.verdict


@pytest.mark.slow
def test_without_a_command_the_servo_is_one_that_nobody_knows() -> None:
    rig = known(97_700_006)
    log = log_from_frame(soft(97_700_006, "nominal", 0.25))
    taken, other = with_its_servo(log, rig)
    assert rig.watched.servo and not other.watched.servo
    assert "servo" in rig.errors and "servo" not in other.errors
    assert taken.notes[-1] == NOT_CHECKED and np.isfinite(taken.w_cmd).all()
    again, same = with_its_servo(with_command(log, rig), rig)  # recovered before
    assert again.notes == taken.notes and not same.watched.servo


def test_the_servo_of_a_logged_command_is_asked() -> None:
    spec = hidden.draw_severity_case(95_300_000, "nominal", "s_curve")
    log = log_from_frame(hidden.make_log(spec, 95_300_000)[0])
    assert with_its_servo(log, load_rig()) == (log, load_rig())


# Each was sure and wrong, four with the equation of their servo (a failed sensor, a jam), two without it: behind a rest of 20 ms
# at the end, and where an obstacle had drawn the mass on.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "label", "share"),
    [
        (97_700_006, "nominal", 0.25),
        (97_700_005, "nominal", 0.1),
        (97_700_011, "nominal", 0.1),
        (97_710_010, "nominal", 0.25),
        (97_710_000, "coupling_loss", 0.25),
        (97_700_008, "coupling_loss", 0.25),
    ],
)
@pytest.mark.first(1)
def test_a_soft_start_without_a_command_is_judged_as_one_with_it(seed: int, label: str, share: float) -> None:
    assert said(seed, label, share).label == label


# Held readings of 400 Hz, slow logs, a late voltage: with the equation of the servo a healthy move was a failed current for sure,
# and faults were not tested, `unknown`, or health for sure (a jam).
@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "shape", "label", "trait"),
    [
        (99_200_000, "without_rests", "jam", "drive_400hz"),
        (99_210_001, "sine", "nominal", "drive_400hz"),
        (99_210_001, "uneven", "nominal", "drive_400hz"),
        (99_210_001, "uneven", "coupling_loss", "drive_400hz"),
        (99_200_000, "sine", "jam", "slow_200hz"),
        (99_200_002, "uneven", "overload", "slow_200hz"),
        (99_220_000, "soft_ramps", "jam", "slow_200hz"),
        (99_230_000, "", "nominal", "voltage_late"),
    ],
)
@pytest.mark.first(1)
def test_a_move_without_its_command_is_told_through_one_more_trait(
    seed: int, shape: str, label: str, trait: str
) -> None:
    spec = hidden.draw_severity_case(seed, label, shape)
    log = log_from_frame(hidden.make_log_with(f"no_command+{trait}", spec, seed)[0])
    verdict = diagnose_log(log, load_rig(), Settings()).isolation.verdict
    assert label in (verdict.label, *verdict.alike)


# A recovered corner is off by up to a sample: its ring was an obstacle for sure, which came and went within 0.1 s (three of 16).
STAIRS = (99_812_060, 99_812_110, 99_811_006, 99_821_000, 99_821_001, 99_821_002)


@pytest.mark.parametrize("seed", STAIRS)
@pytest.mark.first(2)
def test_the_ring_of_a_recovered_corner_is_no_obstacle_for_sure(seed: int) -> None:
    spec = hidden.draw_severity_case(seed, "nominal", "staircase")
    log = log_from_frame(hidden.make_log_with("no_command", spec, seed)[0])
    verdict = diagnose_log(log, load_rig(), Settings()).isolation.verdict
    assert "nominal" in (verdict.label, *verdict.alike)
    assert verdict.label == "nominal" or verdict.probability <= 0.5


@pytest.mark.slow
@pytest.mark.parametrize("also", ["", "+hum_50hz"])
@pytest.mark.first(1)
def test_a_voltage_that_is_late_makes_no_command_late(also: str) -> None:
    """The command is made of voltage and current: later by a sample, it had begun two samples too late, and every stop too."""
    late = []
    for seed in (874011, 874013, 874016):
        spec = hidden.draw_move_case(seed, "nominal")
        log = log_from_frame(hidden.make_log_with(f"no_command+voltage_late{also}", spec, seed)[0])
        with_its_command, _ = with_its_servo(log, load_rig())
        (move,) = spec.profile.moves
        begun = float(log.t[np.argmax(with_its_command.w_cmd != 0.0)])
        late.append((begun - move.start_s) * log.rate_hz)
        again, _ = with_its_servo(with_its_command, load_rig())
        assert again.w_cmd == pytest.approx(with_its_command.w_cmd, abs=0.05 * abs(move.speed))
        assert len(set(again.notes)) == len(again.notes)
    assert np.abs(late).max() <= 1.0, late
