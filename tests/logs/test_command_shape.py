"""A command that is no trapezoid with the rig's ramps, recovered from what its servo shows of it."""

import numpy as np
import pytest
from hidden import SHAPES, SURROUNDINGS, draw_severity_case, make_log_with
from hidden.profiles import command_at

from observer_fi.logs import log_from_frame, moves_from_rest, with_command
from observer_fi.logs.command_recovery import SHOWN
from observer_fi.physics import load_rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG = load_rig()
OTHER = [
    shape for shape in SHAPES if shape not in ("short", "creeping")
]  # those are steep, or as small as their noise
SEEDS = range(95_300_000, 95_300_004)


def recovered(shape: str, day: str, seed: int) -> tuple[Log, float]:
    """A log whose command was not logged, and the rms error of what is recovered, over the highest speed."""
    spec = draw_severity_case(seed, "nominal", shape)
    spec = SURROUNDINGS[day].change(spec, 1.0, np.random.default_rng(seed))
    log = with_command(log_from_frame(make_log_with("no_command", spec, seed)[0]), RIG)
    told = command_at(spec.profile, spec.rig.accel, log.t)
    return log, float(np.sqrt(np.mean((log.w_cmd - told) ** 2)) / np.abs(told).max())


@pytest.mark.parametrize("shape", OTHER)
def test_any_command_is_recovered_as_it_was(shape: str) -> None:
    assert max(recovered(shape, "usual", seed)[1] for seed in SEEDS) < 0.003


@pytest.mark.parametrize("shape", OTHER)
def test_a_rest_is_exactly_0_however_softly_a_move_begins(shape: str) -> None:
    """Whoever looks for calm samples before a start takes them from there."""
    for seed in SEEDS:
        log, _ = recovered(shape, "usual", seed)
        assert (log.w_cmd[: moves_from_rest(log)[0].start // 2] == 0.0).all(), seed


def test_a_log_may_end_in_a_ramp() -> None:
    """The last samples have no others behind them, and their mean would be of an earlier command."""
    for seed in SEEDS:
        spec = draw_severity_case(seed, "nominal", "soft_ramps")
        frame = make_log_with("no_command", spec, seed)[0]
        times, speeds = spec.profile.curve
        frame = frame[frame.time_s < 0.5 * (times[-2] + times[-1])]
        log = with_command(log_from_frame(frame), RIG)
        off = (log.w_cmd - np.interp(log.t, times, speeds))[-4:]
        assert SHOWN in log.notes and abs(off.mean()) < 0.002 * max(map(abs, speeds)), seed


def test_corners_are_as_sharp_as_they_were() -> None:
    """Means over a quarter of a ring round them, and a command that is not 0 yet is motion."""
    for seed in SEEDS:
        log, _ = recovered("soft_ramps", "usual", seed)
        spec = draw_severity_case(seed, "nominal", "soft_ramps")
        told = command_at(spec.profile, spec.rig.accel, log.t)
        stands = (told == 0.0) & (log.t > spec.profile.curve[0][-1] + 0.002)
        assert SHOWN in log.notes and (log.w_cmd[stands] == 0.0).all(), seed
        assert np.abs(log.w_cmd - told).max() < 0.005 * np.abs(told).max(), seed


def test_a_last_rest_may_be_short() -> None:
    for seed in SEEDS:
        spec = draw_severity_case(seed, "nominal", "soft_ramps")
        frame = make_log_with("no_command", spec, seed)[0]
        log = with_command(log_from_frame(frame[frame.time_s < spec.profile.curve[0][-1] + 0.02]), RIG)
        assert SHOWN in log.notes and (log.w_cmd[-16:] == 0.0).all(), seed


@pytest.mark.parametrize("day", ["winding 30 K warmer", "supply 12 % lower", "gains 20 % higher"])
def test_steep_ramps_stay_what_the_rig_file_says_on_any_day(day: str) -> None:
    assert not any(SHOWN in recovered("", day, seed)[0].notes for seed in SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["soft_ramps", "s_curve", "without_rests", "uneven"])
@pytest.mark.first(1)
def test_a_log_without_a_command_of_another_shape_is_judged_as_one_with_it(shape: str) -> None:
    sure, right, seeds = [], 0, SEEDS[:2]
    for seed in seeds:
        for kind in ("nominal", "coupling_loss"):
            spec = draw_severity_case(seed, kind, shape)
            verdict = diagnose_log(
                log_from_frame(make_log_with("no_command", spec, seed)[0]), RIG, Settings()
            ).isolation.verdict
            alike = kind in (verdict.label, *verdict.alike)
            right += alike
            sure += [] if alike or verdict.probability <= 0.95 else [(seed, kind, verdict.label)]
    assert not sure
    assert right >= 2 * len(seeds) - 1
