"""How far equations are off on healthy logs, and what a bank makes of it."""

from dataclasses import replace
from pathlib import Path

import hidden
import numpy as np
import pytest
from documented_rigs import lift

from observer_fi.bank import Bank, bank, between_samples, usual_errors
from observer_fi.learn import with_equation_errors
from observer_fi.learn.equation_errors import PEAK
from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import Rig, load_rig, rig_toml, with_values
from observer_fi.records import Log
from observer_fi.settings import BankSettings


def swelling(share: float) -> Log:
    """A move of the paper's rig with a torque that swells by up to 3 % of its friction."""
    profile = hidden.single_move(hold_s=2.0)
    frame, _ = hidden.log_in(
        hidden.SURROUNDINGS["torque swells, 3 % at 1.1 Hz"], hidden.TruthSpec(profile), 7, share
    )
    return log_from_frame(frame)


def test_a_torque_that_swells_widens_the_room_of_the_friction_and_nothing_else() -> None:
    rig, usual = load_rig(), usual_errors(BankSettings(), load_rig())
    calm = with_equation_errors(rig, [swelling(0.0)]).errors
    swell = with_equation_errors(rig, [swelling(1.0)]).errors
    assert calm["friction"] < 2.0 * usual["friction"] < 4.0 * usual["friction"] < swell["friction"]
    assert swell["servo"] < 3.0 * usual["servo"] and swell["travel"] < 3.0 * usual["travel"]


@pytest.mark.parametrize("seed", [1, 2])
def test_spikes_of_a_logger_are_no_errors_of_the_machine(seed: int) -> None:
    """With a tenth of a millimetre of room for the travel an obstacle would be health."""
    spec = hidden.TruthSpec(hidden.there_and_back((410.0,), (0.8,), (0.0,)))
    spiky = log_from_frame(hidden.make_log_with("spikes", spec, seed)[0])
    errors, usual = with_equation_errors(load_rig(), [spiky]).errors, usual_errors(BankSettings(), load_rig())
    assert {name: errors[name] <= 10.0 * usual[name] for name in usual} == dict.fromkeys(usual, True)


def test_a_start_of_an_unknown_servo_is_no_glitch() -> None:
    """A small motor whose current rises within a sample by more than the usual room for a servo that nobody knows."""
    actuator = lift()
    actuator = replace(actuator, rig=replace(actuator.rig, Kp=0.01, Ki=1.0, accel=5e4))
    spec = hidden.healthy_spec(actuator)
    frame, _ = hidden.actuator_log(actuator, replace(spec, logger=replace(spec.logger, rate_hz=250.0)), 3)
    constants = {"J": actuator.rig.J, "A": actuator.rig.A, "D": actuator.rig.D, "Km": actuator.rig.Km}
    known = {n: q for n, q in load_rig().quantities.items() if n in constants or n in ("B", "C", "E")}
    rig = with_values(replace(load_rig(), drive="current", quantities=known), constants)
    rig = replace(rig, noise={"voltage": 1e-2, "current": 1e-3, "position": 4e-6})
    log = with_command(log_from_frame(frame), rig)
    learned = with_equation_errors(rig, [log])
    before, after = (peak_of_current(log, one) for one in (rig, learned))
    assert before > BankSettings().glitch_sigma > PEAK >= after


def peak_of_current(log: Log, rig: Rig) -> float:
    """The farthest innovation of the current in motion, in standard deviations, without a gate."""
    settings = between_samples(replace(BankSettings(), glitch_samples=0), rig, log.rate_hz)
    e = Bank(rig, settings, hypotheses=bank(rig, settings)[:1]).advance(log)
    return float(np.nanmax(np.abs(e.normalised[10:, 1][e.active[10:]])))


def test_errors_are_in_the_rig_file_and_reach_the_bank(tmp_path: Path) -> None:
    errors = {"torque": 1e-6, "servo": 2e-5, "change": 0.1, "travel": 1e-6, "friction": 0.02}
    rig = replace(load_rig(), errors=errors)
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(rig))
    assert load_rig(path) == rig
    settings = between_samples(BankSettings(), rig, 1600.0)
    assert (settings.agility, settings.wander["A"]) == (0.1, 0.02)
    assert usual_errors(settings, rig) == pytest.approx(errors)


def test_a_servo_of_a_data_sheet_is_watched_as_an_unknown_one() -> None:
    rig = load_rig()
    sheet = {name: replace(q, method="data sheet") for name, q in rig.quantities.items() if name == "Vmax"}
    unknown: Rig = replace(rig, quantities=rig.quantities | sheet)
    assert rig.watched is rig.driven and rig.watched.servo
    assert unknown.driven.servo and not unknown.watched.servo
    assert unknown.law is None


def test_a_position_loop_that_crawls_asks_for_nothing() -> None:
    rig = load_rig()
    quantities = {n: q for n, q in rig.quantities.items() if n != "accel_cmd"}
    loop = with_values(replace(rig, drive="position_servo", quantities=quantities), {"Kx": 5.0})
    sheet = replace(loop.quantities["Rs"], method="guess")
    unknown = replace(loop, quantities=loop.quantities | {"Rs": sheet})
    top = rig.model["Vmax"] / rig.model["Km"]
    goal = rig.model["D"] / 5.0 * top
    assert loop.law is not None and unknown.law is not None
    for share, taken in ((0.02, 0.0), (0.5, 0.5 * top)):
        known = float(loop.law.of(share * goal, 0.0, loop.model.vector))
        assert known == pytest.approx(share * top)
        assert float(unknown.law.of(share * goal, 0.0, unknown.model.vector)) == pytest.approx(taken)
