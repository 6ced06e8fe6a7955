"""A command that the servo did not follow: late, held, rounded, noisy, or without its ramp."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hidden import (
    draw_failing_case,
    draw_move_case,
    draw_severity_case,
    make_log,
    make_log_with,
    write_log,
)

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig, with_values
from observer_fi.records import Consistency, Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose, diagnose_log
from observer_fi.verdict.logger.as_followed import (
    NOT_FOLLOWED,
    _is_rounded,
    as_followed,
    better,
    is_not_followed,
)

RIG, SETTINGS = load_rig(), Settings()
CLASSES = ("nominal", "overload", "coupling_loss")
Spoil = Callable[[Log, int], np.ndarray]

SPOILT: dict[str, Spoil] = {
    "late": lambda log, seed: np.interp(log.t - 0.01 - 0.03 * (seed % 2), log.t, log.w_cmd),
    "held": lambda log, seed: np.interp(np.floor(log.t * (15 + seed % 40)) / (15 + seed % 40), log.t, log.w_cmd),
    "without its ramp": lambda log, _: np.sign(log.w_cmd) * np.abs(log.w_cmd).max(),
    "rounded": lambda log, seed: np.round(log.w_cmd / (8.0 + seed % 5)) * (8.0 + seed % 5),
    "noisy": lambda log, seed: log.w_cmd + np.random.default_rng(seed).normal(0.0, 2.0, log.t.size),
}  # fmt: skip


def spoilt(kind: str, seed: int) -> Log:
    frame, _ = make_log(draw_move_case(seed, CLASSES[seed % 3]), seed)
    log = log_from_frame(frame)
    return replace(log, w_cmd=SPOILT[kind](log, seed))


def said_of(kind: str, seed: int) -> tuple[str, bool]:
    outcome = diagnose_log(spoilt(kind, seed), RIG, SETTINGS)
    assert outcome.isolation is not None
    return outcome.isolation.verdict.label, NOT_FOLLOWED in outcome.warnings


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(("kind", "seed"), list(zip(SPOILT, range(41_000, 41_005), strict=True)))
@pytest.mark.first(1)
def test_what_the_servo_followed_is_asked_of_the_servo(kind: str, seed: int) -> None:
    assert said_of(kind, seed)[0] == CLASSES[seed % 3]


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("kind", SPOILT)
@pytest.mark.first(1)
def test_whatever_was_logged_for_the_command(kind: str) -> None:
    seeds = range(41_100, 41_105)
    said = [said_of(kind, seed) for seed in seeds]
    assert sum(label == CLASSES[seed % 3] for (label, _), seed in zip(said, seeds, strict=True)) >= 4
    assert any(told for _, told in said)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("shape", ["s_curve", "without_rests", "soft_ramps"])
@pytest.mark.parametrize("kind", ["late", "held", "without its ramp", "noisy"])
@pytest.mark.first(2)
def test_whatever_shape_it_has(kind: str, shape: str) -> None:
    """Health and a fault; of such logs one of four was right while the servo's equation was asked of what it had recovered."""
    for seed, label in ((99_410_000, "nominal"), (99_410_001, "coupling_loss")):
        log = log_from_frame(make_log(draw_severity_case(seed, label, shape), seed)[0])
        found = diagnose_log(replace(log, w_cmd=SPOILT[kind](log, seed)), RIG, SETTINGS).isolation
        assert found is not None and label in (found.verdict.label, *found.verdict.alike)


@pytest.mark.parametrize("kind", ["late", "held", "without its ramp"])
def test_a_first_start_leaves_no_doubt_of_it(kind: str) -> None:
    log = log_from_frame(make_log(draw_severity_case(99_410_002, "nominal", "soft_ramps"), 99_410_002)[0])
    assert is_not_followed(replace(log, w_cmd=SPOILT[kind](log, 0)), RIG)


@pytest.mark.parametrize(
    "trait", ["ideal", "noise_3", "voltage_late", "low_pass", "drive_400hz", "no_command"]
)
@pytest.mark.parametrize("shape", ["", "s_curve", "without_rests", "uneven"])
def test_readings_that_are_late_or_held_are_no_other_command(trait: str, shape: str) -> None:
    seed = 99_410_003
    log = log_from_frame(make_log_with(trait, draw_severity_case(seed, "nominal", shape), seed)[0])
    assert not is_not_followed(log, RIG)


@pytest.mark.parametrize("off", [0.7, 0.85, 1.15, 1.4])
@pytest.mark.parametrize("constant", ["Rm", "Kp", "Ki"])
def test_a_rig_file_that_is_off_leaves_a_command_what_it_is(constant: str, off: float) -> None:
    rig = with_values(RIG, {constant: off * RIG.model[constant]})
    for shape in ("s_curve", "soft_ramps"):
        log = log_from_frame(make_log(draw_severity_case(99_610_000, "nominal", shape), 99_610_000)[0])
        assert not is_not_followed(log, rig), shape


@pytest.mark.parametrize(
    ("onset_s", "nis", "taken"), [(1.2, 3.0, True), (None, 3.0, True), (0.31, 3.0, False), (1.2, 9.0, False)]
)
def test_another_machine_is_not_told_as_a_fault_from_the_first_motion_on(
    onset_s: float | None, nis: float, taken: bool
) -> None:
    """A light actuator was a lost coupling for sure once its servo was not asked."""
    verdict = SimpleNamespace(label="coupling_loss", onset_s=onset_s, start_s=0.3)
    two = SimpleNamespace(isolation=SimpleNamespace(verdict=verdict, consistency=Consistency(nis, 3.0, 0.5)))
    one = SimpleNamespace()
    assert (better(one, two) is two) == taken


@pytest.mark.slow
@pytest.mark.study
def test_a_file_says_what_a_log_in_memory_says(tmp_path: Path) -> None:
    frame, _ = make_log(draw_move_case(41_004, "overload"), 41_004)
    command = frame["speed_cmd_rad_s"]
    frame["speed_cmd_rad_s"] = np.sign(command) * command.abs().max()
    outcome = diagnose(write_log(frame, tmp_path / "move.csv"), RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label == "overload"
    assert NOT_FOLLOWED in outcome.warnings and NOT_FOLLOWED in outcome.log.notes


@pytest.mark.slow
@pytest.mark.study
def test_half_the_rate_says_the_same() -> None:
    log = spoilt("without its ramp", 41_006)
    slow = replace(log, t=log.t[::2], z=log.z[::2], w_cmd=log.w_cmd[::2], pitch=log.pitch[::2])
    outcome = diagnose_log(slow, RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label == CLASSES[41_006 % 3]


def test_a_command_that_breaks_off_behind_its_start_is_none_to_compare_with() -> None:
    log = spoilt("late", 41_007)
    first = int(np.flatnonzero(log.w_cmd)[0])
    assert (
        as_followed(replace(log, w_cmd=np.where(np.arange(log.t.size) < first, log.w_cmd, np.nan)), RIG)
        is None
    )


@pytest.mark.parametrize("seed", range(41_010, 41_013))
def test_a_command_that_is_followed_is_left_alone(seed: int) -> None:
    frame, _ = make_log(draw_move_case(seed, CLASSES[seed % 3]), seed)
    assert as_followed(log_from_frame(frame), RIG) is None


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bias", "gain", "drift", "frozen"])
@pytest.mark.first(1)
def test_a_voltage_that_fails_is_no_command_that_was_not_followed(kind: str) -> None:
    frame, _ = make_log(draw_failing_case(41_020, kind, "voltage", 3.0), 41_020)
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label != "nominal"
    assert NOT_FOLLOWED not in outcome.warnings


@pytest.mark.slow
def test_a_current_that_drops_out_behind_held_readings_is_no_command_that_was_not_followed() -> None:
    """Held readings make another ramp of it; a command that is recovered from a current that failed is wrong from there on."""
    spec = draw_failing_case(5_930_003, "dropout", "current", 3.0)
    frame, _ = make_log_with("drive_400hz", spec, 5_930_003)
    found = diagnose_log(log_from_frame(frame), RIG, SETTINGS).isolation
    assert found is not None and (found.verdict.label, found.verdict.channel) == ("sensor_fault", "current")


def rounded_to(step: float, log: Log) -> Log:
    return replace(log, w_cmd=np.round(log.w_cmd / step) * step)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "step"), [("uneven", 1.0472), ("s_curve", 5.0), ("sine", 20.0), ("uneven", 5.0)]
)
@pytest.mark.first(1)
def test_a_soft_command_that_is_rounded_is_not_what_the_servo_followed(shape: str, step: float) -> None:
    """Of 75 such moves 22 were sure and wrong while the servo was asked, most of them behind a filter that no log had."""
    for seed, label in ((99_780_310, "nominal"), (99_780_311, "coupling_loss")):
        log = log_from_frame(make_log(draw_severity_case(seed, label, shape), seed)[0])
        found = diagnose_log(rounded_to(step, log), RIG, SETTINGS)
        assert found.isolation is not None and found.isolation.verdict.label == label
        assert NOT_FOLLOWED in found.warnings


@pytest.mark.parametrize("shape", ["", "s_curve", "uneven"])
def test_a_command_that_is_rounded_finely_or_not_at_all_is_followed(shape: str) -> None:
    for seed in range(99_780_320, 99_780_326):
        log = log_from_frame(make_log(draw_severity_case(seed, "nominal", shape), seed)[0])
        assert not is_not_followed(log, RIG) and not is_not_followed(rounded_to(0.10472, log), RIG)


def test_a_voltage_that_is_late_or_reads_too_much_is_no_other_command() -> None:
    frame, _ = make_log_with(
        "position_100hz+offsets+voltage_late", draw_severity_case(99_770_205, "nominal", "uneven"), 99_770_205
    )
    assert not is_not_followed(log_from_frame(frame), RIG)
    log = log_from_frame(make_log(draw_severity_case(99_775_700, "nominal", "s_curve"), 99_775_700)[0])
    gained = replace(log, z=log.z * np.array([1.02, 1.0, 1.0]))
    assert not is_not_followed(gained, RIG)


@pytest.mark.parametrize("speeds", [(300.0, 600.0, 300.0), (75.0, 150.0, 75.0), (200.0, 400.0, 300.0)])
@pytest.mark.parametrize("rate_hz", [1600.0, 200.0])
def test_round_speeds_behind_ramps_of_round_slopes_are_not_rounded(
    speeds: tuple[float, ...], rate_hz: float
) -> None:
    t = np.arange(0.0, 8.0, 1.0 / rate_hz)
    w_cmd = np.zeros(t.size)
    for k, speed in enumerate(speeds):
        ramps = np.minimum((t - 0.5 - 2.0 * k) * 6e4, (2.0 + 2.0 * k - t) * 6e4)
        w_cmd += (-1.0) ** k * np.clip(ramps, 0.0, speed)
    log = Log("log", t, np.zeros((t.size, 3)), np.zeros(t.size), w_cmd)
    assert not _is_rounded(log, RIG)
    soft = np.round(300.0 * np.sin(t) ** 2 / 2.0) * 2.0
    assert _is_rounded(replace(log, w_cmd=soft), RIG)
