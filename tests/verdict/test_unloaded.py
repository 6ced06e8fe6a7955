"""Without a voltage: a mass that was let go changes the current, a position sensor that died does not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import hidden
import numpy as np
import pytest
from hidden import Fault

from observer_fi.physics import load_rig
from observer_fi.records import ChannelTraits
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.diagnosis import isolated_again
from observer_fi.verdict.moves.unloaded import (
    or_dead_voltage,
    or_left_behind,
    or_stalled,
    or_still_turning,
    without_voltage,
)
from observer_fi.verdict.stuck import of_a_stuck_sensor
from observer_fi.verdict.testable import not_tested
from pipelines import rigs_study

RIG = load_rig()
ALIKE = Settings().decision.alike


def event(label: str, channel: str | None) -> Any:
    posterior = dict.fromkeys(not_tested("").posterior, 0.0) | {label: 1.0}
    return not_tested("")._replace(
        label=label,
        channel=channel,
        probability=1.0,
        posterior=posterior,
        onset_s=2.0,
        start_s=0.0,
        end_s=4.0,
    )


def bank(share: float, rate_hz: float = 250.0, noise: float = 1e-3) -> Any:
    """A current of 20 mA that is multiplied at 2 s."""
    t = np.arange(0.0, 4.0, 1.0 / rate_hz)
    z = np.full((t.size, 3), np.nan)
    z[:, 1] = 0.02 * np.where(t > 2.0, share, 1.0) + noise * np.random.default_rng(3).standard_normal(t.size)
    return SimpleNamespace(recent=SimpleNamespace(t=t, z=z, active=np.ones(t.size, dtype=bool)))


@pytest.mark.parametrize("said", [("coupling_loss", None), ("sensor_fault", "position")])
@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_the_current_decides(said: tuple[str, str | None], rate_hz: float) -> None:
    fallen = RIG.model["A_decoupled"] / RIG.model["A"]
    let_go = without_voltage(event(*said), bank(fallen, rate_hz), RIG, ALIKE)
    dead = without_voltage(event(*said), bank(1.0, rate_hz), RIG, ALIKE)
    assert (let_go.label, let_go.channel) == ("coupling_loss", None)
    assert (dead.label, dead.channel) == ("sensor_fault", "position")
    for told in (let_go, dead):
        assert sum(told.posterior.values()) == pytest.approx(1.0)
        assert told.probability == told.posterior[told.label]


def test_both_are_named_where_the_current_is_too_noisy_to_tell() -> None:
    told = without_voltage(event("coupling_loss", None), bank(0.95, noise=0.05), RIG, ALIKE)
    assert told.alike == ("sensor_fault",) and told.probability < 0.8


def test_other_verdicts_stay() -> None:
    overload = event("overload", None)
    assert without_voltage(overload, bank(0.7), RIG, ALIKE) is overload


def moved(stands: bool, change: float) -> Any:
    """A bank whose position stands from 2 s on or goes on slower, and whose current is multiplied there."""
    memory = bank(change)
    t = memory.recent.t
    memory.recent.z[:, 2] = 0.01 * (np.minimum(t, 2.0) + (0.0 if stands else 0.5) * np.maximum(t - 2.0, 0.0))
    return memory


def test_an_obstacle_that_takes_all_the_travel_is_a_mass_that_was_let_go() -> None:
    fallen = without_voltage(event("overload", None), moved(True, 0.5), RIG, ALIKE)
    assert fallen.label == "coupling_loss" and fallen.probability < 0.95 and "overload" in fallen.alike
    same = without_voltage(event("overload", None), moved(True, 1.0), RIG, ALIKE)
    assert (same.label, same.channel) == ("sensor_fault", "position")
    assert without_voltage(event("overload", None), moved(False, 2.0), RIG, ALIKE).label == "overload"


def test_a_position_that_goes_on_is_no_coupling() -> None:
    wrong = event("sensor_fault", "position")
    assert without_voltage(wrong, moved(False, 1.0), RIG, ALIKE) is wrong


def test_a_motor_that_is_stopped_soon_after_its_position_sensor_died_was_not_let_go() -> None:
    memory = moved(True, 1.0)
    memory.recent.z[memory.recent.t > 2.25, 1] = -0.02
    told = without_voltage(event("coupling_loss", None), memory, RIG, ALIKE)
    assert (told.label, told.channel) == ("sensor_fault", "position")


@pytest.mark.parametrize(("label", "change"), [("unknown", 1.0), ("jam", 1.0), ("slip", 1.5)])
def test_the_one_current_that_is_measured_may_misread(label: str, change: float) -> None:
    told = without_voltage(event(label, None), moved(False, change), RIG, ALIKE)
    assert told.label == label and told.alike == ("sensor_fault",) and told.probability < 0.95


@pytest.mark.parametrize(
    ("share", "goes_on", "dead"), [(0.0, 1.0, True), (0.0, 0.0, False), (0.9, 1.0, False)]
)
def test_a_mass_that_goes_on_without_a_current_has_a_dead_current_sensor(
    share: float, goes_on: float, dead: bool
) -> None:
    """A current of nothing and a mass that stands is a motor without one; and what still reads is no dead sensor."""
    memory = bank(share, noise=1e-4)
    t = memory.recent.t
    memory.recent.z[:, 2] = 7e-4 * (np.minimum(t, 2.0) + goes_on * np.maximum(t - 2.0, 0.0))
    told = without_voltage(event("overload", None), memory, RIG, ALIKE)
    assert ((told.label, told.channel) == ("sensor_fault", "current")) is dead
    if dead:
        assert told.onset_s == pytest.approx(2.0, abs=0.01) and told.alike == ()
    health = event("nominal", None)
    assert without_voltage(health, memory, RIG, ALIKE) is health


def test_a_slip_whose_current_stays_is_one() -> None:
    slip = event("slip", None)
    assert without_voltage(slip, moved(False, 1.0), RIG, ALIKE) is slip


@pytest.mark.parametrize(
    ("pace", "change", "alike"),
    [(1.0, 1.5, "sensor_fault"), (1.3, 1.0, "sensor_fault"), (0.6, 1.0, "slip"), (0.6, 1.5, None)],
)
def test_an_obstacle_slows_its_mass_and_loads_its_motor(
    pace: float, change: float, alike: str | None
) -> None:
    """A gain of either sensor was an obstacle for sure, one that a mass passes as fast as before, or faster; so was a slip."""
    memory = bank(change)
    t = memory.recent.t
    memory.recent.z[:, 2] = 0.01 * (np.minimum(t, 2.0) + pace * np.maximum(t - 2.0, 0.0))
    told = without_voltage(event("overload", None), memory, RIG, ALIKE)
    assert told.alike == ((alike,) if alike else ())
    assert told.probability == (0.5 if alike else 1.0)


@pytest.mark.parametrize("rate_hz", [20.0, 25.0])
def test_a_slow_log_has_its_current_and_its_speeds_seen(rate_hz: float) -> None:
    """A third of a second is too few samples there: a mass that went on without a current was an obstacle for sure."""
    memory = bank(0.0, rate_hz, noise=1e-4)
    memory.recent.z[:, 2] = 7e-4 * memory.recent.t
    told = without_voltage(event("overload", None), memory, RIG, ALIKE)
    assert (told.label, told.channel) == ("sensor_fault", "current")


@pytest.mark.parametrize(("pace", "read", "dead"), [(1.0, 0.0, True), (0.0, 0.0, False), (1.0, 0.5, False)])
def test_a_mass_that_goes_on_without_a_voltage_has_a_dead_voltage_sensor(
    pace: float, read: float, dead: bool
) -> None:
    """At 100 Hz a voltage that was lost was no fault with a name, for sure."""
    memory = bank(1.0, 100.0)
    t = memory.recent.t
    memory.recent.z[:, 0] = 9.0 * np.where(t > 2.0, read, 1.0)
    memory.recent.z[:, 2] = 7e-4 * (np.minimum(t, 2.0) + pace * np.maximum(t - 2.0, 0.0))
    told = or_dead_voltage(event("unknown", None), memory, RIG)
    assert ((told.label, told.channel) == ("sensor_fault", "voltage")) is dead
    assert or_dead_voltage(event("nominal", None), memory, RIG).label == "nominal"


@pytest.mark.parametrize("seed", range(12))
def test_a_mass_that_stands_goes_nowhere_while_its_motor_stops(seed: int) -> None:
    """The noise of a position that stood was as fast before the voltage ended as behind it: a lost coupling was a dead sensor."""
    memory = bank(1.0, 1600.0)
    t = memory.recent.t
    memory.recent.z[:, 0] = 9.0 * (t < 3.0)
    memory.recent.z[:, 2] = 10e-6 * np.random.default_rng(seed).standard_normal(t.size)
    told = or_dead_voltage(event("coupling_loss", None), memory, RIG)
    assert told.label == "coupling_loss"


@pytest.mark.parametrize(
    ("stands", "change", "alike"), [(True, 4.0, True), (True, 0.5, False), (False, 4.0, False)]
)
def test_a_mass_that_stands_while_its_motor_pulls_was_stopped(
    stands: bool, change: float, alike: bool
) -> None:
    """A motor that an obstacle stalled within eight samples was no fault with a name, for sure."""
    told = or_stalled(event("unknown", None), moved(stands, change))
    assert (told.alike == ("overload", "jam")) is alike
    assert told.label == "unknown" and told.probability == (pytest.approx(1.0 / 3.0) if alike else 1.0)


@pytest.mark.parametrize(
    ("emf", "stands", "shared"), [(1.0, True, True), (0.9, True, False), (1.0, False, False)]
)
def test_a_motor_that_turns_on_beside_a_mass_that_stands(emf: float, stands: bool, shared: bool) -> None:
    """At 25 Hz a lost coupling was a voltage sensor for sure, whose readings fell by just what the winding takes less."""
    memory = moved(stands, 0.5)
    after = memory.recent.t > 2.0
    memory.recent.z[:, 0] = RIG.model["Rm"] * memory.recent.z[:, 1] + 8.0 * np.where(after, emf, 1.0)
    told = or_still_turning(event("sensor_fault", "voltage"), memory, RIG, ALIKE)
    assert (told.alike == ("coupling_loss",)) is shared and told.label == "sensor_fault"


def slow_log(falls_s: float, loses: float) -> Any:
    """At 25 Hz, a mass that loses a share of its speed at 2 s, and a current that goes on until it falls, told so long."""
    memory = bank(1.0, 25.0, noise=1e-4)
    t = memory.recent.t
    memory.recent.w_cmd = np.where(t < falls_s, np.where(t < 2.0, 1.0, 1.0 - loses or 1.0) * 400.0, 0.0)
    memory.recent.z[t >= 2.0, 1] *= 1.0 if loses < 1.0 else 0.7  # a motor that lost its mass needs less
    memory.recent.z[t >= falls_s, 1] *= -0.3
    moving = np.minimum(t, falls_s)
    travel = np.minimum(moving, 2.0) + (1.0 - loses) * np.maximum(moving - 2.0, 0.0)
    memory.recent.z[:, 2] = 400.0 * RIG.model["D"] * travel + 1e-6 * np.random.default_rng(4).normal(
        size=t.size
    )
    return memory


@pytest.mark.parametrize(
    ("falls_s", "loses", "alike"),
    [(3.2, 1.0, "coupling_loss"), (3.2, 0.5, "slip"), (3.2, 0.0, None), (2.1, 1.0, None), (5.0, 1.0, None)],
)
def test_a_mass_that_slows_without_its_motor_is_no_all_clear(
    falls_s: float, loses: float, alike: str | None
) -> None:
    """Between two slow samples a current may do anything, and nominal explained every loss of speed: 0.99 of health.

    A motor that is stopped with its mass, and a servo that goes on to hold it, are healthy.
    """
    health, memory = event("nominal", None), slow_log(falls_s, loses)
    told = or_left_behind(health, memory, RIG, ALIKE)
    assert (told is health) is (alike is None)
    assert alike is None or (told.label == "nominal" and alike in told.alike and told.probability <= 0.5)


def test_a_current_that_slows_its_motor_explains_a_slower_mass() -> None:
    memory = slow_log(3.2, 0.5)
    t, taken_s = memory.recent.t, 0.12
    braking = (t >= 1.98) & (t < 1.98 + taken_s)
    memory.recent.z[braking, 1] -= 200.0 * RIG.model["J"] / RIG.model["Km"] / taken_s
    health = event("nominal", None)
    assert or_left_behind(health, memory, RIG, ALIKE) is health


@pytest.mark.slow
@pytest.mark.parametrize("seed", [97100, 97103, 97104])
@pytest.mark.first(1)
def test_a_drive_that_logs_no_voltage(seed: int) -> None:
    """From the data sheet to both verdicts, on the independent truth; where the current leaves both, both are named."""
    actuator = hidden.draw_actuator(seed, "current")
    rig = rigs_study._learned(actuator)
    lost = hidden.fault_spec(actuator, "coupling_loss", seed)
    dead = replace(lost, fault=Fault("sensor_fault", lost.fault.onset_s, "frozen", "position"))
    for spec, label in ((lost, "coupling_loss"), (dead, "sensor_fault")):
        frame, _ = hidden.actuator_log(actuator, spec, seed + 1)
        isolation = diagnose_log(rigs_study._read(frame, rig), rig, Settings()).isolation
        assert isolation is not None
        verdict = isolation.verdict
        assert verdict.label == label or (label in verdict.alike and verdict.probability < 0.95)


def quantised(share: float, dead: bool) -> Any:
    """A bank whose current of 20 mA is read in steps of 1 mA, and is multiplied at 2 s; a dead one stands from there on."""
    memory = bank(share)
    t, i = memory.recent.t, memory.recent.z[:, 1]
    i[:] = np.where((t > 2.0) & dead, 0.02 * share, np.round(i, 3))
    return memory


@pytest.mark.parametrize("said", [("coupling_loss", None), ("sensor_fault", "position"), ("nominal", None)])
def test_a_current_that_stands_to_the_last_digit_is_that_of_a_dead_sensor(
    said: tuple[str, str | None],
) -> None:
    current = ChannelTraits(1e-3, 1e-3, 1e-3)
    logged: Any = SimpleNamespace(logger=(current, current, current), repeats=np.array([0.0, 0.3, 0.0]))
    dead = of_a_stuck_sensor(event(*said), quantised(1.0, True), logged)
    assert (dead.label, dead.channel) == ("sensor_fault", "current")
    assert dead.onset_s == pytest.approx(2.0, abs=0.02) and sum(dead.posterior.values()) == pytest.approx(1.0)
    assert without_voltage(dead, quantised(1.0, True), logged, ALIKE) is dead
    assert of_a_stuck_sensor(event(*said), quantised(1.0, False), logged) == event(*said)
    silent = ChannelTraits(0.0, 0.0)  # nothing is known of its noise: what stands has no steps to hide in
    quiet: Any = SimpleNamespace(logger=(silent, silent, silent), repeats=np.array([0.0, 0.3, 0.0]))
    assert of_a_stuck_sensor(event(*said), quantised(1.0, True), quiet).channel == "current"
    logged.repeats[1] = 0.99  # a logger whose readings stand at rest, too
    assert of_a_stuck_sensor(event("nominal", None), quantised(1.0, True), logged).label == "nominal"
    coarse = current._replace(resolution=2.5e-3)
    rough: Any = SimpleNamespace(logger=(coarse, coarse, coarse), repeats=np.array([0.0, 0.3, 0.0]))
    assert of_a_stuck_sensor(event("nominal", None), quantised(1.0, True), rough).label == "nominal"


def test_a_current_that_reads_more_may_also_be_more() -> None:
    misread = event("sensor_fault", "current")
    assert without_voltage(misread, bank(1.5), RIG, ALIKE).alike == ("jam",)
    assert without_voltage(misread, bank(0.3), RIG, ALIKE) is misread  # no jam takes less


def test_what_the_bank_was_sure_of_in_time_keeps_that_time_when_it_is_told_in_the_end() -> None:
    """Another label may have stood between: the whole move said sensor, the current that the mass is gone."""
    bank_said = event("coupling_loss", None)._replace(isolated_s=1.3)
    told = bank_said._replace(isolated_s=None, probability=0.99)
    assert isolated_again(told, bank_said).isolated_s == 1.3
    assert isolated_again(told._replace(probability=0.7), bank_said).isolated_s is None
    assert isolated_again(told, event("sensor_fault", "position")._replace(isolated_s=1.3)).isolated_s is None
