"""A position servo's moves are simulated with all that its loop commands: what it creeps, too, drives the motor."""

from dataclasses import replace
from functools import cache

import hidden
import numpy as np
import pytest
from drawn_sheets import drawn_sheet
from hidden.effects import Effect, effect

from observer_fi.improve import Improvement, improve
from observer_fi.improve.moves.misfit import raw_excess
from observer_fi.improve.moves.simulated_moves import SimulatedMoves, simulated_moves
from observer_fi.learn import identified_rig, identify, with_crawl
from observer_fi.learn.output_error import residuals
from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import Rig, rig_of_sheet, with_values
from observer_fi.records import Log

TRUE = ("Rm", "Rs", "Km", "D", "Vmax", "Kp", "Ki", "J", "A", "B", "C", "E")
FINE, COARSE = (
    (850921, 850922),
    (850907, 850923),
)  # what steps of the encoder are in the voltage, beside its noise


@cache
def campaign(seed: int, *effects: Effect) -> tuple[Log, Rig]:
    """A healthy campaign of a drawn position servo, and the rig file that its user begins with."""
    actuator = hidden.draw_actuator(seed, "position_servo")
    spec = replace(hidden.healthy_spec(actuator), effects=effects)
    log = log_from_frame(hidden.actuator_log(actuator, spec, seed)[0])
    return log, rig_of_sheet(drawn_sheet(actuator, "position_servo")).rig


def true_rig(seed: int) -> Rig:
    """The rig file with the constants of the truth, whose servo counts as guessed as before."""
    actuator = hidden.draw_actuator(seed, "position_servo")
    truth = {name: getattr(actuator.rig, name) for name in TRUE} | {"Kx": hidden.healthy_spec(actuator).Kx}
    told = with_values(campaign(seed)[1], truth, {}, "identified")
    return with_values(told, {"Rs": truth["Rs"]}, {}, "guess")


def with_truth(seed: int) -> SimulatedMoves:
    rig = true_rig(seed)
    return simulated_moves([with_crawl(with_command(campaign(seed)[0], rig), rig)], rig)


@pytest.mark.parametrize("seed", (*FINE, *COARSE))
@pytest.mark.first(2)
def test_the_true_constants_leave_next_to_nothing(seed: int) -> None:
    """Moves that were cut where the command is too low to move a motor left 500 to 15 000 nats a sample."""
    problem = with_truth(seed)
    experiment = problem.experiment
    left = residuals(experiment, problem.model, np.zeros((experiment.moves, 2)))
    assert raw_excess(experiment, left) < (1.0 if seed in FINE else 3.0) * experiment.t.size


def test_steps_of_the_encoder_are_noise_of_what_the_servo_makes_of_them() -> None:
    rig = true_rig(COARSE[1])
    noise, step = with_truth(COARSE[1]).experiment.noise, 2.0 * np.pi / 2000.0
    current = rig.model["Kx"] * rig.model["Kp"] * step / np.sqrt(12.0)
    assert noise[1] > current and noise[0] > 0.9 * rig.model["Rm"] * current
    weight = with_truth(COARSE[1]).experiment.weight
    assert 1.0 / weight[weight[:, 0] > 0.0, 0].max() == pytest.approx(noise[0], rel=0.2)


def improved(seed: int, *effects: Effect) -> Improvement:
    """What is missing of a campaign, with a rig that was learned from a healthy one."""
    healthy, rig = campaign(seed)
    return improve([campaign(seed, *effects)[0]], identified_rig(identify([healthy], rig), rig))


@pytest.mark.slow
def test_a_healthy_position_servo_misses_nothing() -> None:
    found = improved(FINE[0])
    assert found.findings == () == found.unexplained
    assert found.baseline.nll_per_sample < found.baseline.noise_floor_nll + 0.3


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("seed", FINE)
def test_viscous_friction_of_a_position_servo_has_its_name_and_size(seed: int) -> None:
    actuator = hidden.draw_actuator(seed, "position_servo")
    size = 0.3 * actuator.rig.A / actuator.speed
    found = improved(seed, effect("viscous_friction", plus=size, minus=size))
    assert [one.cause for one in found.findings] == ["viscous_friction"]
    for value in found.findings[0].parameters.values():
        assert value.value == pytest.approx(size, rel=0.03)
    assert found.new_moves.best == "extended"
