"""Ramps that their samples do not show are put where the motion has them, and all others stay.

The truth is the independent one, whose ramps begin between samples.
"""

from dataclasses import fields, replace
from functools import cache

import hidden
import numpy as np
import pytest
from campaigns import RIG, log_of

from observer_fi.learn import Experiment, Free, doubtful, timed
from observer_fi.learn.move_data import prepare
from observer_fi.learn.servo.command_timing import (
    MOST_CORNERS,
    RECOVERED_S,
    Command,
    Ramp,
    _cornered,
    _steepened,
)
from observer_fi.logs import recover_command
from observer_fi.physics import corners
from observer_fi.physics.rigs import override

ACCEL = RIG.model["accel_cmd"]
# The servo of the truth has 8 kHz, which a log of 200 Hz hardly tells.
SERVO = override(RIG.model, "rig", servo_delay=0.5 / 8000.0)
FREE = [Free(name, 1e-3 * RIG.model[name]) for name in ("J", "A", "Kp", "Ki")]
NEAR_S = 5e-5  # a hundredth of a sample of 200 Hz


def to_and_fro(
    rate: float, seed: int, speeds: tuple[float, ...] = (200.0, -150.0), within: bool = True
) -> hidden.Profile:
    """Moves whose ramps begin anywhere: `within` a sampling interval, which they do not leave, or not."""
    rng, moves = np.random.default_rng(seed), []
    for k, speed in enumerate(speeds):
        room = 1.0 / rate - (abs(speed) / ACCEL if within else 0.0)
        start, brake = np.round((0.3 + k, 0.8 + k) + rng.uniform(0.05, 0.95, 2) * room, 6)
        moves.append(hidden.Move(float(start), speed, float(brake - start)))
    return hidden.Profile(tuple(moves), len(speeds) + 0.2, ((0.0, 4.0),))


@cache
def experiment_of(profile: hidden.Profile, rate: float, seed: int) -> Experiment:
    log = log_of(profile, seed=seed, logger=hidden.Logger(rate_hz=rate))
    return replace(prepare([log], RIG), steps=8)


def starts_of(profile: hidden.Profile) -> np.ndarray:
    return np.array([t for move in profile.moves for t in (move.start_s, move.brake_s)])


def true_knots(profile: hidden.Profile, late: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the command; late: of each ramp [s]."""
    speeds = np.repeat([move.speed for move in profile.moves], 2)
    begin = starts_of(profile) + late
    t = np.column_stack((begin, begin + np.abs(speeds) / ACCEL)).ravel()
    v = np.ravel([(0.0, move.speed, move.speed, 0.0) for move in profile.moves])
    return np.concatenate(([0.0], t, [profile.duration_s])), np.concatenate(([0.0], v, [0.0]))


def begun(experiment: Experiment, log: int = 0) -> np.ndarray:
    """When the ramps of a command begin [s]."""
    t, v = experiment.knots[log]
    return t[:-1][np.abs(np.diff(v)) > 1.0]


# --- what is in doubt ----------------------------------------------------------------------------


@pytest.mark.parametrize("rate, speed", [(1600.0, 410.0), (1600.0, 100.0), (400.0, 410.0)])
@pytest.mark.parametrize("seed", range(2))
def test_of_a_ramp_with_samples_on_it_nothing_is_in_doubt(rate: float, speed: float, seed: int) -> None:
    profile = to_and_fro(rate, seed, (speed, -speed), within=False)
    assert doubtful(experiment_of(profile, rate, seed), [False]) == []


@pytest.mark.parametrize("rate", [160.0, 200.0, 250.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_between_two_samples_may_be_anywhere_between_them(rate: float, seed: int) -> None:
    profile = to_and_fro(rate, seed)
    experiment = experiment_of(profile, rate, seed)
    (command,) = doubtful(experiment, [False])
    assert [ramp.move for ramp in command.ramps] == [0, 0, 1, 1]
    for ramp, start in zip(command.ramps, starts_of(profile), strict=True):
        at, v = (knots[ramp.first : ramp.first + 2] for knots in command.knots)
        before = np.floor(start * rate) / rate
        assert at[0] + ramp.low == pytest.approx(before, abs=1e-8)  # a file has nanoseconds
        assert at[1] + ramp.high == pytest.approx(before + 1.0 / rate, abs=1e-8)
        assert ramp.low <= start - at[0] <= ramp.high
        assert abs(v[1] - v[0]) / (at[1] - at[0]) == pytest.approx(ACCEL, rel=1e-3)


# Behind the only sample on a ramp `corners` does not know where that ends: see the test of such ramps.
@pytest.mark.parametrize(("rate", "within"), [(200.0, True), (1600.0, True), (1600.0, False)])
def test_the_corners_of_a_command_are_the_command(rate: float, within: bool) -> None:
    experiment, at = experiment_of(to_and_fro(200.0, 0), 200.0, 0), np.arange(round(2.2 * rate)) / rate
    for seed in range(8):
        profile = to_and_fro(rate, seed, (200.0, -90.0), within)
        logged = corners(at, hidden.profiles.command_at(profile, ACCEL, at), ACCEL)
        (command,) = doubtful(replace(experiment, knots=(logged,)), [True])
        t = np.union1d(np.linspace(0.0, 2.2, 5000), logged[0])
        np.testing.assert_allclose(np.interp(t, *command.knots), np.interp(t, *logged), atol=1e-6)
        assert command.knots[0].size <= 2 + 4 * 4


@pytest.mark.parametrize("speed", [150.0, -200.0, 300.0, 410.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_ramp_with_a_sample_on_it_is_known_to_its_end(speed: float, seed: int) -> None:
    """At 200 samples a second, and whatever the sample is of."""
    at, ramp = np.arange(400) / 200.0, abs(speed) / ACCEL
    last = float(np.random.default_rng(seed).uniform(0.05, 0.95)) * min(
        ramp, 5e-3
    )  # of the ramp behind a sample
    corner = 0.5 + last - ramp
    knots = np.array([0.0, corner, corner + ramp, 2.0]), np.array([0.0, 0.0, speed, speed])
    logged = corners(at, np.interp(at, *knots), ACCEL)
    found = _steepened(*_cornered(*logged), ACCEL, 5e-3)
    fine = np.linspace(0.4, 0.6, 4001)
    np.testing.assert_allclose(np.interp(fine, *found), np.interp(fine, *knots), atol=1e-3 * abs(speed))


@pytest.mark.parametrize("seed", range(3))
def test_every_ramp_of_a_recovered_command_is_in_doubt(seed: int) -> None:
    profile = to_and_fro(1600.0, seed, (410.0, -410.0), within=False)
    (command,) = doubtful(experiment_of(profile, 1600.0, seed), [True])
    ramps = {(ramp.move, ramp.low, ramp.high) for ramp in command.ramps}
    assert len(command.ramps) == 4 and ramps == {(m, -RECOVERED_S, RECOVERED_S) for m in (0, 1)}


@pytest.mark.parametrize("apart", [1e-3, 4e-3])
def test_recovered_ramps_near_each_other_never_meet(apart: float) -> None:
    experiment = experiment_of(to_and_fro(1600.0, 0, within=False), 1600.0, 0)
    t = [0.0, 0.3, 0.303, 0.303 + apart, 0.306 + apart, 0.8, 0.803, 2.2]
    v = [0.0, 0.0, 100.0, 100.0, 200.0, 200.0, 0.0, 0.0]
    (command,) = doubtful(replace(experiment, knots=((np.array(t), np.array(v)),)), [True])
    first, second, last = command.ramps
    assert first.high == pytest.approx(0.5 * apart) and second.low == pytest.approx(-0.5 * apart)
    assert last.high == RECOVERED_S


@pytest.mark.parametrize("recovered", [True, False])
def test_a_command_of_many_corners_is_no_trapezoid(recovered: bool) -> None:
    experiment = experiment_of(to_and_fro(200.0, 1), 200.0, 1)
    t = np.linspace(0.0, 2.2, 4 * MOST_CORNERS)
    curve = t, 100.0 * np.sin(2.0 * np.pi * t)
    assert doubtful(replace(experiment, knots=(curve,)), [recovered]) == []


# --- where the motion has it ---------------------------------------------------------------------


@pytest.mark.parametrize("rate", [160.0, 200.0, 250.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_between_two_samples_is_found(rate: float, seed: int) -> None:
    """From constants that are some percent off, which are fitted with it."""
    profile = to_and_fro(rate, seed)
    experiment = experiment_of(profile, rate, seed)
    off = {name: (1.0 + 0.03 * (-1) ** k) * SERVO[name] for k, name in enumerate(("J", "A", "Kp", "Ki"))}
    found = timed(experiment, doubtful(experiment, [False]), override(SERVO, "off", **off), FREE)
    assert np.abs(begun(experiment) - starts_of(profile)).max() > 5.0 * NEAR_S
    np.testing.assert_allclose(begun(found), starts_of(profile), atol=NEAR_S)


@pytest.mark.parametrize("seed", range(3))
def test_ramps_of_a_recovered_command_are_found(seed: int) -> None:
    """Here each is off by a random share of what it may be."""
    profile = to_and_fro(1600.0, seed, (410.0, -410.0), within=False)
    late = RECOVERED_S * np.random.default_rng([seed, 2]).uniform(-0.8, 0.8, 4)
    experiment = replace(experiment_of(profile, 1600.0, seed), knots=(true_knots(profile, late),))
    found = timed(experiment, doubtful(experiment, [True]), SERVO, FREE)
    np.testing.assert_allclose(begun(found), starts_of(profile), atol=NEAR_S)


@pytest.mark.parametrize("rate", [400.0, 800.0])
@pytest.mark.parametrize("seed", range(2))
def test_what_recovery_leaves_is_found(rate: float, seed: int) -> None:
    """A twentieth of a sample and more."""
    profile = to_and_fro(rate, seed, (410.0, -410.0), within=False)
    log = log_of(profile, seed=seed, logger=hidden.Logger(rate_hz=rate))
    blank = recover_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), RIG.model)
    experiment = replace(prepare([blank], RIG), steps=8)
    found = timed(experiment, doubtful(experiment, [True]), SERVO, FREE)
    np.testing.assert_allclose(begun(found), starts_of(profile), atol=0.01 / rate)


# --- what stays ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_a_ramp_without_room_is_not_shifted_however_wrong_it_is(seed: int) -> None:
    profile = to_and_fro(200.0, seed)
    experiment = experiment_of(profile, 200.0, seed)
    knots = true_knots(profile, np.array([0.0, 1e-3, -1e-3, 0.0]))
    fixed = Command(knots, tuple(Ramp(k // 2, 1 + 2 * k, 0.0, 0.0) for k in range(4)))
    found = timed(experiment, [fixed], SERVO, FREE)
    np.testing.assert_array_equal(found.knots[0][0], knots[0])


@pytest.mark.parametrize("seed", range(3))
def test_ramps_that_are_right_are_not_shifted(seed: int) -> None:
    profile = to_and_fro(200.0, seed)
    experiment = replace(experiment_of(profile, 200.0, seed), knots=(true_knots(profile),))
    found = timed(experiment, doubtful(experiment, [False]), SERVO, [])
    np.testing.assert_allclose(begun(found), starts_of(profile), atol=NEAR_S)


def test_no_ramp_leaves_its_room() -> None:
    """Where the truth is outside of it the shift stops at its end."""
    profile = to_and_fro(200.0, 1)
    late = 2e-3
    experiment = replace(experiment_of(profile, 200.0, 1), knots=(true_knots(profile, late),))
    tight = Command(experiment.knots[0], tuple(Ramp(k // 2, 1 + 2 * k, -1e-3, 1e-3) for k in range(4)))
    found = timed(experiment, [tight], SERVO, [])
    np.testing.assert_allclose(begun(found), starts_of(profile) + late - 1e-3, atol=1e-9)


@pytest.mark.parametrize("slow", [0, 1])
def test_only_the_command_of_the_slow_log_changes(slow: int) -> None:
    logs, profiles = [], []
    for k in range(2):
        rate = 200.0 if k == slow else 1600.0
        profiles.append(to_and_fro(rate, k, within=k == slow))
        logs.append(log_of(profiles[k], seed=k, logger=hidden.Logger(rate_hz=rate)))
    experiment = replace(prepare(logs, RIG), steps=8)
    commands = doubtful(experiment, [False, False])
    assert [len(command.ramps) for command in commands] == [4 * (k == slow) for k in range(2)]
    before = [(t.copy(), v.copy()) for t, v in experiment.knots]
    found = timed(experiment, commands, SERVO, [])
    np.testing.assert_allclose(begun(found, slow), starts_of(profiles[slow]), atol=NEAR_S)
    np.testing.assert_array_equal(found.knots[1 - slow], commands[1 - slow].knots)
    for kept, was in zip(experiment.knots, before, strict=True):
        np.testing.assert_array_equal(kept, was)
    others = [f.name for f in fields(Experiment) if f.name != "knots"]
    assert all(getattr(found, name) is getattr(experiment, name) for name in others)
