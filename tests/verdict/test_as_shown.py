"""Soft starts without a logged command, on rigs whose servo makes more of the noise of the readings than the current has."""

from dataclasses import replace
from functools import cache

import hidden
import pandas as pd
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import with_equation_errors
from observer_fi.logs import is_shown, log_from_frame, with_command, with_logger
from observer_fi.physics import Rig, load_rig, rig_of_sheet, with_values
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.as_shown import as_shown_to

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


def test_a_servo_says_nothing_where_it_makes_more_of_the_noise_than_the_current_has() -> None:
    rig = known(97_700_006)
    log = with_command(log_from_frame(soft(97_700_006, "nominal", 0.25)), rig)
    taken, other = as_shown_to(log, rig)
    assert is_shown(log) and rig.watched.servo and not other.watched.servo
    assert "servo" in rig.errors and "servo" not in other.errors
    assert len(taken.notes) == len(log.notes) + 1 and "one that nobody knows" in taken.notes[-1]


def test_the_papers_servo_is_believed_and_so_is_a_logged_command() -> None:
    rig = load_rig()
    spec = hidden.draw_severity_case(95_300_000, "nominal", "s_curve")
    log = with_command(log_from_frame(hidden.make_log_with("no_command", spec, 95_300_000)[0]), rig)
    assert is_shown(log) and as_shown_to(log, rig) == (log, rig)
    logged = replace(log, notes=())
    assert as_shown_to(logged, known(97_700_006)) == (logged, known(97_700_006))


# Each was sure and wrong, four with the equation of their servo (a failed sensor, a jam), two without it: behind a rest of 20 ms
# at the end, and where an obstacle had drawn the mass on.
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
def test_a_soft_start_without_a_command_is_judged_as_one_with_it(seed: int, label: str, share: float) -> None:
    assert said(seed, label, share).label == label
