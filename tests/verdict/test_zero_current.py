"""The zero of the current sensor, told by motion in both directions; never made up, and no fault taken for one."""

from dataclasses import replace
from functools import cache

import hidden
import numpy as np
import pytest

from observer_fi.logs import log_from_frame, with_command
from observer_fi.physics import load_rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import AsLogged, diagnose_log
from pipelines.rigs_study import _learned, _read

RIG, SETTINGS = load_rig(), Settings()
SPEEDS, HOLDS, PITCHES = (410.0, 200.0), (0.5, 0.5), (0.0, 5.0)
SIGMA = float(RIG.noise_std[1])


@cache
def healthy(seed: int, trait: str = "ideal", one_way: bool = False) -> Log:
    """There and back at two speeds and two pitches, on a rig of the paper's spread."""
    spec = hidden.draw_effects_case(seed, (), 0.0)
    profile = hidden.there_and_back(SPEEDS, HOLDS, PITCHES)
    if one_way:
        profile = replace(
            profile, moves=tuple(replace(move, speed=abs(move.speed)) for move in profile.moves)
        )
    return log_from_frame(hidden.make_log_with(trait, replace(spec, profile=profile), seed)[0])


def off_by(log: Log, voltage: float, current: float) -> Log:
    return replace(log, z=log.z + np.array([voltage, current, 0.0]))


def zero_of(log: Log) -> float:
    return AsLogged(log, RIG, SETTINGS.bank).zero


@pytest.mark.parametrize("voltage", [-0.03, 0.0, 0.05])
@pytest.mark.parametrize("current", [-5e-3, -1e-3, 2e-3])
@pytest.mark.first(3)
def test_it_is_found_beside_any_offset_of_the_voltage(voltage: float, current: float) -> None:
    for seed in (8100, 8101):
        assert zero_of(off_by(healthy(seed), voltage, current)) == pytest.approx(current, abs=0.5 * SIGMA)


@pytest.mark.parametrize("trait", ["noise_3", "position_averaged", "steps_all"])
def test_it_is_found_through_other_traits(trait: str) -> None:
    assert zero_of(off_by(healthy(8102, trait), 0.04, -2e-3)) == pytest.approx(-2e-3, abs=SIGMA)


def test_a_sensor_whose_zero_is_right_has_none() -> None:
    for seed in range(8110, 8116):
        assert zero_of(healthy(seed)) == 0.0, seed


def test_moves_in_one_direction_tell_it_as_they_stop() -> None:
    """There a servo turns back; without the stop a wrong zero and another friction are one."""
    for seed in (8103, 8104):
        log = off_by(healthy(seed, one_way=True), 0.03, 2e-3)
        assert zero_of(log) == pytest.approx(2e-3, abs=0.5 * SIGMA), seed
        stop = int(np.flatnonzero(np.diff((log.w_cmd != 0.0).astype(int)) == -1)[0])
        assert zero_of(log.part(slice(0, stop))) == 0.0, seed


@pytest.mark.slow
@pytest.mark.parametrize("label", ["overload", "coupling_loss", "sensor_fault"])
@pytest.mark.parametrize("move", [1, 3])
@pytest.mark.first(1)
def test_a_fault_is_told_beside_it_as_without_it_and_is_no_zero(label: str, move: int) -> None:
    """In the second move: before any two healthy ones that tell the zero."""
    kind, channel, size = ("bias", "current", 9e-3) if label == "sensor_fault" else ("", None, None)
    for seed in (8120,) if move == 1 else (8121,):
        spec = hidden.draw_effects_case(seed, (), 0.0)
        profile = hidden.there_and_back(SPEEDS, HOLDS, PITCHES)
        fault = hidden.Fault(label, profile.moves[move].start_s + 0.2, kind, channel, size)
        log = log_from_frame(hidden.make_log(replace(spec, profile=profile, fault=fault), seed)[0])
        ideal, off = (labels_of(seen) for seen in (log, off_by(log, 0.03, 2e-3)))
        assert ideal[:move] == off[:move] == [("nominal", None)] * move, seed
        named = {(label, channel), ("slip", None)} if label == "overload" else {(label, channel)}
        assert ideal[move] == off[move] and off[move] in named, (
            seed
        )  # what gives way by half may have slipped


def labels_of(log: Log) -> list[tuple[str, str | None]]:
    isolation = diagnose_log(log, RIG, SETTINGS).isolation
    return [(event.label, event.channel) for event in isolation.events]


@pytest.mark.slow
@pytest.mark.study
def test_healthy_campaigns_with_two_zero_offsets_are_healthy() -> None:
    """Of 19 campaigns through such loggers 17 had been called faulty."""
    for seed in range(8130, 8138):
        spec = hidden.draw_effects_case(seed, (), 0.0)
        trait = ("offsets", "position_averaged+offsets", "noise_3+current_late+offsets")[seed % 3]
        log = log_from_frame(hidden.make_log_with(trait, spec, seed)[0])
        labels = {event.label for event in diagnose_log(log, RIG, SETTINGS).isolation.events}
        assert labels == {"nominal"}, (seed, trait)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drive", "seed"), [("pi_servo", 500002), ("position_servo", 500001), ("voltage", 500002)]
)
@pytest.mark.study
def test_it_is_found_on_other_actuators(drive: str, seed: int) -> None:
    """With a rig file learned through sensors that were right: other motors, screws, friction, rates and servos."""
    actuator = hidden.draw_actuator(seed, drive)
    rig = _learned(actuator)
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed + 7)
    log = with_command(_read(frame, rig), rig)
    off = off_by(log, 4.0 * float(rig.noise_std[0]), -8.0 * float(rig.noise_std[1]))
    assert AsLogged(log, rig, SETTINGS.bank).zero == 0.0
    found = AsLogged(off, rig, SETTINGS.bank).zero
    assert found == pytest.approx(-8.0 * rig.noise_std[1], abs=0.5 * rig.noise_std[1])
    assert {event.label for event in diagnose_log(off, rig, SETTINGS).isolation.events} == {"nominal"}


def test_a_zero_that_shows_from_afar_alone_is_found() -> None:
    """A motor that sticks hides a zero that is a little off: one of a hundred logs gained 5 nats of it, and 559 of all of it."""
    spec = hidden.draw_move_case(760261, "nominal")
    log = log_from_frame(hidden.make_log_with("offsets", spec, 760261)[0])
    outcome = diagnose_log(log, RIG, Settings())
    assert outcome.isolation.verdict.label == "nominal"
    off = hidden.acquisition_of("offsets", spec, 760261).chains["current"].offset
    assert any("mA off its zero" in words for words in outcome.warnings) and abs(off) > 1e-3
