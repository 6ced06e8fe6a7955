"""The winding's resistance from rests in which the servo drives."""

import numpy as np
import pytest

from observer_fi.learn.driven.at_rest import resistance_at_rest
from observer_fi.learn.driven.windows import Driven
from observer_fi.physics import load_rig
from observer_fi.records import Log

RATE_HZ = 250.0
PAPER = load_rig()
RM, KM = PAPER.model["Rm"], PAPER.model["Km"]


def holding(currents: list[float], rng: np.random.Generator, creeps: float = 0.0) -> Driven:
    """Half a second of motion and half a second of rest a current [A]; creeps: speed at rest [m/s]."""
    half = int(0.5 * RATE_HZ)
    i = np.repeat(currents, 2 * half)
    turns = np.tile(np.repeat([1.0, 0.0], half), len(currents))
    w, t = 100.0 * turns, np.arange(i.size) / RATE_HZ
    x = np.cumsum(PAPER.model["D"] * w + creeps * (1.0 - turns)) / RATE_HZ
    z = np.column_stack([RM * i + KM * w, i, x]) + rng.normal(size=(i.size, 3)) * [1e-3, 1e-3 / RM, 1e-6]
    log = Log("rests", t, z, np.zeros(i.size), np.zeros(i.size))
    return Driven(log, (t, z[:, 2]))


@pytest.mark.parametrize("seed", range(5))
def test_rests_with_several_currents_tell_it_within_its_standard_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    Rm, std = resistance_at_rest([holding(list(rng.normal(size=8) * 0.03), rng)], PAPER)
    assert abs(Rm - RM) < 4.0 * std < 0.05 * RM


def test_an_offset_of_a_channel_is_none_of_it() -> None:
    rng = np.random.default_rng(1)
    each = holding(list(rng.normal(size=8) * 0.03), rng)
    shifted = each._replace(log=type(each.log)(**{**vars(each.log), "z": each.log.z + [0.02, 0.0, 0.0]}))
    assert resistance_at_rest([shifted], PAPER)[0] == pytest.approx(
        resistance_at_rest([each], PAPER)[0], rel=1e-3
    )


def test_a_motor_that_creeps_is_no_rest() -> None:
    rng = np.random.default_rng(2)
    assert (
        resistance_at_rest([holding([0.01, 0.02, 0.03, -0.02, -0.01, 0.04], rng, creeps=1e-4)], PAPER) is None
    )


def test_few_rests_and_rests_of_one_current_tell_nothing_of_it() -> None:
    rng = np.random.default_rng(3)
    assert resistance_at_rest([holding([0.01, 0.02, 0.03], rng)], PAPER) is None
    _, std = resistance_at_rest([holding([0.02] * 6, rng)], PAPER)
    assert std > 0.2 * RM
