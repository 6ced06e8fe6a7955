"""Moves, phases and excitation against trapezoids of known corners; recovered commands against true ones."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenarios import END_S, RATE_HZ, SPEED, START_S, STOP_S, healthy_move

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs.command_recovery import is_recovered, recover_command, with_command
from observer_fi.logs.ingest import log_from_frame
from observer_fi.logs.moves import (
    Phase,
    excitation,
    log_phases,
    log_segments,
    mean_square_by_phase,
    moves_from_rest,
    phases,
    segments,
    settling_time,
)
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

RIG = load_rig()
MODEL = RIG.model
ACCEL = MODEL["accel_cmd"]


def clock(seconds: float, rate: float = RATE_HZ) -> np.ndarray:
    return np.arange(round(seconds * rate)) / rate


def command(t: np.ndarray, moves: list[tuple[float, float, float]]) -> np.ndarray:
    """Trapezoids (start, brake, speed) [s, s, rad/s]."""
    knots, speeds = [-1.0], [0.0]
    for start, brake, speed in moves:
        ramp = abs(speed) / ACCEL
        knots += [start, start + ramp, brake, brake + ramp]
        speeds += [0.0, speed, speed, 0.0]
    return np.interp(t, knots, speeds)


def healthy_log(rate_hz: int = RATE_HZ) -> Log:
    table = healthy_move(rate_hz)
    return Log("log", table[:, 0], table[:, 1:4].copy(), table[:, 5].copy(), table[:, 4].copy())


# --- moves ---------------------------------------------------------------------------------------


def test_one_move_lies_between_its_rests() -> None:
    t = clock(1.0)
    (move,) = segments(t, command(t, [(0.2, 0.7, 410.0)]), np.full(t.size, 3.0))
    assert (move.rest, move.end) == (0, t.size)
    assert t[move.start - 1] <= 0.2 < t[move.start]
    assert t[move.stop - 1] < 0.7 + 410.0 / ACCEL <= t[move.stop] + 1e-12
    assert move.peak == 410.0 and move.pitch == 3.0


@given(
    speeds=st.lists(st.sampled_from([410.0, -410.0, 205.0, -90.0, 10.0, 5.0]), min_size=1, max_size=6),
    pause=st.floats(0.02, 0.5),
    rate=st.sampled_from([400.0, 1600.0]),
)
def test_moves_are_found_as_they_were_commanded_and_share_no_sample(speeds, pause, rate) -> None:
    moves, start = [], pause
    for speed in speeds:
        moves.append((start, start + 0.15, speed))
        start += 0.15 + abs(speed) / ACCEL + pause
    t = clock(start, rate)
    found = segments(t, command(t, moves))
    assert [move.peak for move in found] == pytest.approx(speeds)
    assert [t[move.start] for move in found] == pytest.approx([m[0] for m in moves], abs=1.01 / rate)
    ends = [m[1] + abs(m[2]) / ACCEL for m in moves]
    assert [t[move.stop] for move in found] == pytest.approx(ends, abs=1.01 / rate)
    assert found[0].rest == 0 and found[-1].end == t.size
    assert all(a.end == b.rest == (a.stop + b.start) // 2 for a, b in zip(found, found[1:], strict=False))


def test_a_log_that_begins_and_ends_in_a_move() -> None:
    t = clock(1.0)
    first, second = segments(t, command(t + 0.5, [(0.2, 0.7, 410.0), (1.0, 3.0, -205.0)]))
    assert first.rest == first.start == 0 and second.stop == second.end == t.size
    assert first.peak == 410.0 and second.peak == -205.0


def test_a_reversal_without_rest_is_split_where_the_sign_changes() -> None:
    t = clock(1.0)
    w = np.interp(t, [0.1, 0.1 + 410 / ACCEL, 0.5, 0.5 + 820 / ACCEL], [0.0, 410.0, 410.0, -410.0])
    first, second = segments(t, w)
    assert first.stop == first.end == second.rest == second.start
    assert w[first.stop - 1] > 0.0 > w[second.start]
    assert second.stop == second.end == t.size


def test_no_move_no_segment() -> None:
    t = clock(0.5)
    assert segments(t, np.zeros(t.size)) == ()
    assert segments(t, np.full(t.size, 0.01)) == ()
    assert segments(t[:0], t[:0]) == ()


def test_a_pause_or_a_blip_of_a_few_samples_is_neither_rest_nor_move() -> None:
    t = clock(1.0)
    w = command(t, [(0.2, 0.7, 410.0)])
    w[800:804] = 0.0
    w[200:203] = 0.5
    assert len(segments(t, w)) == 1


def test_a_change_of_level_is_one_move() -> None:
    t = clock(1.0)
    w = np.interp(t, [0.1, 0.11, 0.5, 0.51, 0.8, 0.81], [0.0, 200.0, 200.0, 410.0, 410.0, 0.0])
    (move,) = segments(t, w)
    assert move.peak == 410.0


# --- phases --------------------------------------------------------------------------------------


def test_the_phases_of_a_full_start() -> None:
    log = healthy_log()
    (move,) = log_segments(log)
    codes = phases(move, log.t, log.w_cmd, log.z, MODEL)
    order = [Phase(code) for code in codes[np.flatnonzero(np.diff(codes, prepend=-1))]]
    assert order == [
        Phase.REST, Phase.ACCELERATION, Phase.SATURATION, Phase.STABILISATION, Phase.STEADY, Phase.STOP,
        Phase.REST,
    ]  # fmt: skip
    first = {phase: log.t[np.argmax(codes == phase)] for phase in order}
    # design: a full start saturates from 5.5 to 47.2 ms after its begin
    assert first[Phase.SATURATION] - START_S == pytest.approx(0.0055, abs=1e-3)
    assert first[Phase.STABILISATION] - START_S == pytest.approx(0.0472, abs=2e-3)
    settled = 0.0472 + settling_time(MODEL)
    assert first[Phase.STEADY] - START_S == pytest.approx(settled, abs=3e-3)
    assert first[Phase.STOP] == pytest.approx(STOP_S, abs=1.1 / RATE_HZ)


def test_without_a_voltage_nothing_counts_as_saturated() -> None:
    log = healthy_log()
    z = log.z.copy()
    z[:, 0] = np.nan
    (move,) = log_segments(log)
    codes = phases(move, log.t, log.w_cmd, z, MODEL)
    assert Phase.SATURATION not in codes and Phase.STEADY in codes


@given(a=st.floats(-0.2, 0.9), length=st.floats(0.01, 1.2), speed=st.sampled_from([410.0, -410.0, 90.0]))
def test_every_sample_of_any_cut_of_a_move_has_a_phase(a, length, speed) -> None:
    t = clock(1.0)
    w = command(t, [(a, a + length, speed)])
    z = np.full((t.size, 3), np.nan)
    for move in segments(t, w):
        codes = phases(move, t, w, z, MODEL)
        assert codes.size == move.end - move.rest
        assert np.all(codes[: move.start - move.rest] == Phase.REST)
        moving = codes[move.start - move.rest : move.stop - move.rest]
        assert not np.any(moving == Phase.REST)
        assert np.all(np.isin(codes[move.stop - move.rest :], (Phase.STOP, Phase.REST)))


def test_excitation_counts_what_the_moves_show() -> None:
    t = clock(4.0)
    w = command(t, [(0.1, 0.6, 410.0), (0.8, 1.3, -410.5), (1.5, 2.0, 200.0), (2.5, 3.0, 90.0)])
    log = Log("log", t, np.full((t.size, 3), np.nan), w, np.where(t > 1.4, 10.0, 0.2))
    shown = excitation(log, log_segments(log), MODEL)
    assert shown.moves == 4 and shown.directions == (-1, 1) and shown.reversals == 0
    assert shown.speeds == pytest.approx((90.0, 200.0, 410.0)) and shown.pitches == pytest.approx((0.2, 10.0))
    assert sum(shown.seconds.values()) == pytest.approx(4.0) and shown.seconds["saturation"] == 0.0
    reversal = np.interp(t, [0.1, 0.11, 0.5, 0.52], [0.0, 410.0, 410.0, -410.0])
    log = replace(log, w_cmd=reversal)
    assert excitation(log, log_segments(log), MODEL).reversals == 1


def test_a_reversal_is_one_move_from_rest_and_the_rests_belong_to_it_whole() -> None:
    t = np.arange(4000) / 1000.0
    w_cmd = np.interp(
        t, [0.5, 0.51, 1.0, 1.02, 1.5, 1.51, 2.5, 2.51, 3.0, 3.01], [0, 400, 400, -300, -300, 0, 0, 90, 90, 0]
    )
    log = Log("log", t, np.zeros((t.size, 3)), w_cmd, np.where(t < 2.0, 4.0, 8.0))
    there, back, slow = log_segments(log)
    one, two = moves_from_rest(log)
    assert (one.start, one.stop) == (there.start - 1, back.stop) and w_cmd[one.start] == 0.0 != w_cmd[
        one.start + 1
    ]
    assert (one.peak, one.pitch, two.peak, two.pitch) == (-300.0, 4.0, slow.peak, 8.0)
    assert (one.rest, one.end) == (0, two.start) and (two.rest, two.end) == (one.stop, t.size)
    assert moves_from_rest(replace(log, w_cmd=np.zeros(t.size))) == ()


def test_the_phases_of_a_log_are_those_of_its_moves() -> None:
    log = healthy_log()
    (move,) = log_segments(log)
    np.testing.assert_array_equal(
        log_phases(log, MODEL)[move.rest : move.end], phases(move, log.t, log.w_cmd, log.z, MODEL)
    )
    still = replace(log, w_cmd=np.zeros(log.t.size))
    assert (log_phases(still, MODEL) == Phase.REST).all()


def test_mean_squares_by_phase() -> None:
    r = np.array([[1.0, 0.0], [3.0, 1.0], [2.0, 2.0]])
    found = mean_square_by_phase(r, np.array([Phase.REST, Phase.REST, Phase.STOP], dtype=np.int8))
    assert {name: y.tolist() for name, y in found.items()} == {"rest": [5.0, 0.5], "stop": [4.0, 4.0]}


# --- the command recovered -----------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [400, 1600, 3200])
def test_a_command_that_was_not_logged_is_recovered(rate_hz: int) -> None:
    log = healthy_log(rate_hz)
    found = recover_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), MODEL)
    (move,) = log_segments(found)
    assert move.peak == pytest.approx(SPEED, rel=5e-3)
    late = (log.w_cmd - found.w_cmd) / ACCEL * rate_hz  # samples, on the ramps
    assert np.abs(late).max() < 1.0
    assert any("recovered from voltage and current, 1 starts" in note for note in found.notes)


def test_missing_samples_do_not_stop_the_recovery() -> None:
    log = healthy_log()
    z = log.z.copy()
    z[np.random.default_rng(2).integers(0, log.t.size, 160)] = np.nan
    found = recover_command(replace(log, z=z, w_cmd=np.full(log.t.size, np.nan)), MODEL)
    assert np.abs(found.w_cmd - log.w_cmd).max() < ACCEL / RATE_HZ


def test_a_biased_sensor_at_rest_is_no_move() -> None:
    log = healthy_log()
    z = log.z.copy()
    z[:, 1] += 0.015
    found = recover_command(replace(log, z=z, w_cmd=np.full(log.t.size, np.nan)), MODEL)
    (move,) = log_segments(found)
    assert move.peak == pytest.approx(SPEED, rel=5e-3)
    assert not found.w_cmd[log.t < START_S - 0.01].any() and not found.w_cmd[log.t > END_S - 0.1].any()


def test_the_encoder_stands_in_for_the_voltage() -> None:
    log = healthy_log()
    w = (log.z[:, 0] - MODEL["Rm"] * log.z[:, 1]) / MODEL["Km"]
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(log.t))))
    z = log.z.copy()
    z[:, 0] = np.nan
    blank = replace(log, z=z, encoder=angle, w_cmd=np.full(log.t.size, np.nan))
    (move,) = log_segments(recover_command(blank, MODEL))
    assert move.peak == pytest.approx(SPEED, rel=5e-3)
    with pytest.raises(InvalidLogError, match="voltage_v"):
        recover_command(replace(blank, encoder=None), MODEL)


def test_only_rest_gives_a_command_of_zero() -> None:
    log = healthy_log()
    still = log.t < START_S
    cut = Log("log", log.t[still], log.z[still], np.full(still.sum(), np.nan), log.pitch[still])
    assert not recover_command(cut, MODEL).w_cmd.any()


def test_without_a_speed_loop_the_settled_speed_stands_for_the_command() -> None:
    log = healthy_log()
    found = recover_command(log, override(MODEL, "open", Kp=0.0, Ki=0.0, accel_cmd=0.0)).w_cmd
    steady = np.abs(log.w_cmd) == np.abs(log.w_cmd).max()
    assert np.median(found[steady]) == pytest.approx(log.w_cmd[steady][0], rel=0.01)
    assert np.abs((found != 0.0) ^ (log.w_cmd != 0.0)).mean() < 0.03


@pytest.mark.parametrize("sigmas", [0.9, 1.5, 2.5, 6.0])
def test_an_offset_of_the_voltage_is_no_speed(sigmas: float) -> None:
    """A rest of 0.2 s tells it to a twentieth of a reading's noise; below three of these it had stayed in the command."""
    log = healthy_log()
    offset = sigmas * float(np.std(log.z[: round(0.9 * START_S * RATE_HZ), 0]))
    blank = replace(log, w_cmd=np.full(log.t.size, np.nan), z=log.z + np.array([offset, 0.0, 0.0]))
    steady = (log.t > START_S + 0.4) & (log.t < STOP_S)
    off = np.median(recover_command(blank, MODEL).w_cmd[steady]) - SPEED
    assert abs(off) < 0.3 * offset / MODEL["Km"]


def test_only_a_command_that_is_missing_is_recovered() -> None:
    log = healthy_log()
    assert with_command(log, RIG) is log
    still = replace(
        log, w_cmd=np.zeros(log.t.size), notes=("speed_cmd_rad_s is absent: recovered, 0 starts",)
    )
    assert with_command(still, RIG) is still
    found = with_command(replace(log, w_cmd=np.full(log.t.size, np.nan)), RIG)
    assert np.abs(found.w_cmd - log.w_cmd).max() < ACCEL / RATE_HZ


def test_a_log_says_whether_its_command_was_recovered() -> None:
    log = healthy_log()
    assert not is_recovered(log)
    assert not is_recovered(replace(log, notes=("unit of current_a looks like mA",)))
    blank = replace(log, w_cmd=np.full(log.t.size, np.nan), notes=("another note",))
    assert is_recovered(recover_command(blank, MODEL)) and is_recovered(with_command(blank, RIG))
    assert is_recovered(with_command(with_command(blank, RIG), RIG))
    assert not is_recovered(with_command(log, RIG))


def test_a_rig_without_a_motor_has_no_command_to_recover() -> None:
    with pytest.raises(UsageError, match="without Km"):
        recover_command(healthy_log(), override(MODEL, "open", Km=0.0))


@pytest.mark.parametrize("trait", ["hum_50hz", "hum_60hz", "drive_400hz", "steps_3_all", "noise_3"])
def test_a_command_is_recovered_through_loggers(trait: str) -> None:
    """Hum and held readings hardly differ from sample to sample: that was their noise, and no level was level enough."""
    for seed in range(7700, 7706):
        spec = hidden.draw_move_case(seed, "nominal")
        frame, _ = hidden.make_log_with(f"{trait}+no_command", spec, seed)
        log = with_command(log_from_frame(frame), RIG)
        move = spec.profile.moves[0]
        on = np.flatnonzero(log.w_cmd)
        assert log.t[on[0]] == pytest.approx(move.start_s, abs=4e-3), seed
        assert float(np.median(log.w_cmd[on])) == pytest.approx(move.speed, rel=5e-3), seed
        assert any(note.endswith("1 starts") for note in log.notes), log.notes
