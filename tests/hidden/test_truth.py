"""The hidden truth against arithmetic on the paper's numbers, its own laws, and itself at half the step."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from . import (
    ALL,
    FAILURES,
    TABLE_1,
    UNKNOWN_SIZES,
    Fault,
    Logger,
    Move,
    Profile,
    TruthSpec,
    campaign,
    contact_campaign,
    draw_effect_case,
    draw_effects_case,
    draw_move_case,
    draw_rig,
    effect,
    make_log,
    rich_campaign,
    single_move,
    sized_effect,
    true_motion,
    without_noise,
    write_log,
)
from .detectability import VISIBLE_SIGMA, refit_directions, visible_sigma
from .faults import LABELS
from .sensors import COLUMNS

STD = {"voltage_v": 10e-3, "current_a": 0.3e-3, "position_m": 10e-6}
LINE = dict(zip(COLUMNS.values(), (1e-4, 1e-6, 1e-8), strict=True))  # what the logger resolves

# Forth and back with both stops near by: every effect has something to act on.
BUSY = TruthSpec(
    Profile((Move(0.1, 410.0, 1.0), Move(1.4, -300.0, 1.8)), 3.5, ((0.0, 8.0), (1.25, -6.0))),
    replace(TABLE_1, stop_low_m=-2e-5, stop_high_m=5.5e-4, C=2000.0),  # stiff: a short move shall feel it
    start_integral_rad=0.02,
)


@pytest.fixture(scope="module")
def busy_log():
    return clean(BUSY)


@pytest.fixture(scope="module")
def full_speed():
    return true_motion(TruthSpec(single_move(410.0, 3.0)))


def clean(spec):
    return make_log(without_noise(spec), 0)[0]


def worst(one, other, unit=STD):
    """Largest difference over channels and samples, in noise sigmas or the given unit."""
    return max(np.abs(one[column] - other[column]).max() / unit[column] for column in unit)


def window(motion, low, high, start=0.3):
    return (motion.time - start >= low) & (motion.time - start < high)


# --- the numbers of the rig ----------------------------------------------------------------------


def test_full_speed_start_saturates_as_the_rig_must(full_speed):
    m = full_speed
    first_move = window(m, 0.0, 1.0)
    saturated = m.time[first_move & (m.source_voltage > TABLE_1.Vmax - 1e-9)] - 0.3
    assert saturated[0] == pytest.approx(5.5e-3, abs=0.7e-3)  # a sample is 0.6 ms
    assert saturated[-1] == pytest.approx(47.2e-3, abs=1.0e-3)
    assert m.speed.max() == pytest.approx(600.0, abs=2.0)
    assert m.integral.max() == pytest.approx(3.38, abs=0.02)
    # The peak of 0.653 A falls between samples: look at ten times the rate.
    dense = true_motion(replace(TruthSpec(single_move(410.0, 0.5)), logger=Logger(rate_hz=16000.0)))
    assert dense.current.max() == pytest.approx(0.653, abs=0.004)


def test_saturated_speed_rises_with_the_time_constant_of_eq_17(full_speed):
    m, rig = full_speed, TABLE_1
    R = rig.Rm + rig.Rs
    phase = window(m, 8e-3, 45e-3)
    asymptote = (rig.Vmax - R * rig.A / rig.Km) / rig.Km
    slope = np.polyfit(m.time[phase], np.log(asymptote - m.speed[phase]), 1)[0]
    assert asymptote == pytest.approx(691.0, abs=1.0)
    assert -1.0 / slope == pytest.approx(R * rig.J / rig.Km**2, rel=1e-4)


def test_ringing_has_the_frequency_and_decay_of_eq_18(full_speed):
    m, rig = full_speed, TABLE_1
    free = window(m, 0.06, 0.25)
    error = m.speed[free] - 410.0
    times = m.time[free]
    crossings = np.flatnonzero(np.diff(np.sign(error)))
    at = times[crossings] - error[crossings] * np.diff(times)[crossings] / np.diff(error)[crossings]
    decay = 2 * rig.J / (rig.Km * rig.Kp)
    frequency = np.sqrt(rig.Km * rig.Ki / rig.J - decay**-2)
    assert np.pi / np.diff(at).mean() == pytest.approx(frequency, rel=5e-3)
    peaks = [np.abs(error[a:b]).max() for a, b in zip(crossings[:-1], crossings[1:], strict=True)]
    measured = -np.diff(at).mean() / np.polyfit(np.arange(len(peaks)), np.log(peaks), 1)[0]
    assert measured == pytest.approx(decay, rel=0.03)  # the sampled servo delays its proportional part


def test_steady_state_at_zero_pitch(full_speed):
    steady = window(full_speed, 2.0, 2.9)
    assert full_speed.current[steady].mean() == pytest.approx(21.7e-3, abs=0.05e-3)
    assert full_speed.source_voltage[steady].mean() == pytest.approx(9.15, abs=0.005)
    assert full_speed.integral[steady].mean() == pytest.approx(0.0482, abs=2e-4)
    assert np.gradient(full_speed.position, full_speed.time)[steady].mean() == pytest.approx(
        0.779e-3, rel=1e-4
    )


def test_logged_voltage_is_the_motor_terminal(full_speed):
    frame = clean(TruthSpec(single_move(410.0, 3.0)))
    terminal = full_speed.source_voltage - TABLE_1.Rs * full_speed.current
    assert np.abs(frame["voltage_v"] - terminal).max() <= 0.51e-4  # half of what the logger resolves


def test_energy_balance_of_a_start():
    m = true_motion(TruthSpec(single_move(410.0, 1.0), logger=Logger(rate_hz=48000.0)))
    # The current is held from step to step: its value at the left, times the mean speed.
    power = (TABLE_1.Km * m.current - m.applied_torque)[:-1] * (m.speed[1:] + m.speed[:-1]) / 2
    energy = np.concatenate([[0.0], np.cumsum(power * np.diff(m.time))])
    kinetic = 0.5 * TABLE_1.J * m.speed**2
    assert np.abs(energy - kinetic).max() < 1e-3 * kinetic.max()  # a saturated current moves within a step


# --- friction that sticks ------------------------------------------------------------------------


@pytest.mark.parametrize("integral", [-0.04, 0.0, 0.03])
def test_stuck_mass_keeps_its_integral_and_place(integral):
    m = true_motion(replace(BUSY, profile=single_move(410.0, 0.3), rig=TABLE_1, start_integral_rad=integral))
    before = m.time < 0.3
    assert np.all(m.integral[before] == integral)
    assert np.all(m.speed[before] == 0.0)
    after = m.time > 0.85
    assert np.ptp(m.integral[after]) == 0.0
    assert np.ptp(m.position[after]) == 0.0
    assert abs(m.integral[-1]) <= TABLE_1.A / (TABLE_1.Km * TABLE_1.Ki) + 1e-9


def test_static_friction_holds_until_break_away():
    rest = Profile((Move(0.1, 6e-3, 16.0),), 16.0)  # so slow that the integral creeps up to break-away
    m = true_motion(
        TruthSpec(rest, rig=replace(TABLE_1, accel=1.0), static_ratio=1.3, logger=Logger(rate_hz=400.0))
    )
    leaving = np.flatnonzero(m.speed)[0]
    assert TABLE_1.Km * m.current[leaving - 1] == pytest.approx(1.3 * TABLE_1.A, rel=0.01)


def test_mirrored_commands_and_pitch_give_mirrored_logs():
    spec = replace(BUSY, rig=TABLE_1)
    moves = tuple(replace(move, speed=-move.speed) for move in spec.profile.moves)
    pitch = tuple((start, -level) for start, level in spec.profile.pitch_steps)
    mirrored = replace(spec, profile=Profile(moves, 3.5, pitch), start_integral_rad=-0.02)
    one, other = true_motion(spec), true_motion(mirrored)
    for name in ("source_voltage", "current", "position", "speed", "angle", "integral"):
        assert np.array_equal(getattr(one, name), -getattr(other, name))


# --- effects -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cause", sorted(ALL))
def test_effect_at_zero_size_changes_nothing(cause, busy_log):
    pd.testing.assert_frame_equal(clean(replace(BUSY, effects=(sized_effect(cause, 0.0),))), busy_log)


@pytest.mark.parametrize("cause", sorted(ALL))
def test_effect_at_nonzero_size_changes_its_log(cause, busy_log):
    frame = clean(replace(BUSY, effects=(sized_effect(cause, 30.0),)))
    changed = [column for column in frame if not frame[column].equals(busy_log[column])]
    equation = ALL[cause].equation
    expected = {
        "sensor:position": {"position_m"},
        "sensor:current": {"current_a"},
        "sensor:voltage": {"voltage_v"},
        "sensor:pitch": {"pitch_deg"},
        "kinematics": {"position_m", "voltage_v", "current_a"},  # through the place of contact
    }.get(equation, set(STD))
    assert changed and set(changed) <= expected
    assert equation == "sensor:pitch" or worst(frame, busy_log) > 3.0


def test_every_cause_of_the_contract_is_here():
    assert len([cause for cause in ALL.values() if not cause.regressors]) == 31
    assert len([cause for cause in ALL.values() if cause.regressors]) >= 6
    allowed = {"time", "speed", "position", "shaft_angle", "screw_angle", "pitch", "current", "load"}
    for cause in ALL.values():
        assert cause.regressors <= allowed | {"temperature", "direction"}


def test_viscous_friction_adds_to_the_steady_current():
    spec = TruthSpec(single_move(-400.0, 1.5), effects=(effect("viscous_friction", minus=1e-7),))
    steady = window(true_motion(spec), 1.0, 1.4)
    extra = true_motion(spec).current[steady].mean() + TABLE_1.A / TABLE_1.Km
    assert extra == pytest.approx(-400.0 * 1e-7 / TABLE_1.Km, rel=2e-3)


def test_shaft_ripple_repeats_every_motor_turn():
    spec = TruthSpec(single_move(200.0, 3.0), effects=(effect("shaft_ripple", amplitude=2e-5),))
    m = true_motion(replace(spec, logger=Logger(rate_hz=8000.0)))
    steady = window(m, 1.0, 2.9)
    spectrum = np.abs(np.fft.rfft(m.current[steady] * np.hanning(steady.sum())))
    frequency = np.fft.rfftfreq(steady.sum(), 1 / 8000.0)[10 + spectrum[10:].argmax()]
    assert frequency == pytest.approx(200.0 / (2 * np.pi), abs=0.6)  # one bin


def test_screw_ripple_repeats_every_millimetre():
    spec = TruthSpec(single_move(410.0, 4.0), effects=(effect("screw_ripple", amplitude=5e-5),))
    m = true_motion(spec)
    steady = window(m, 0.5, 3.9)
    load = m.applied_torque[steady] - TABLE_1.A
    expected = 5e-5 * np.sin(2 * np.pi * m.position[steady] / 1e-3)
    assert np.abs(load - expected).max() < 1e-9


def test_a_gear_takes_its_share_of_the_motor_s_torque():
    """Km i (1 - loss) = A in a steady move, so that the current rises by 1 / (1 - loss)."""
    plain = TruthSpec(single_move(300.0, 1.5))
    steady = window(true_motion(plain), 1.0, 1.4)
    lossy = true_motion(replace(plain, effects=(effect("load_dependent_friction", loss=0.1),)))
    assert lossy.current[steady].mean() == pytest.approx(TABLE_1.A / TABLE_1.Km / 0.9, rel=2e-3)


@pytest.mark.parametrize("jump", [0.0, 1.0])
def test_a_dead_zone_drives_nothing_below_its_threshold(jump):
    asked = {}
    for threshold in (0.0, 5e-3):
        spec = TruthSpec(
            single_move(300.0, 3.0), effects=(effect("dead_zone", threshold=threshold, jump=jump),)
        )
        m = true_motion(replace(spec, start_integral_rad=5e-3))
        assert np.all((m.current == 0.0) | (np.abs(m.current) > threshold * jump)) or threshold == 0.0
        assert m.current[m.time < 0.05] == pytest.approx(0.0 if threshold else TABLE_1.Ki * 5e-3, abs=1e-9)
        steady = window(m, 1.5, 2.9)
        asked[threshold] = (m.current[steady].mean(), TABLE_1.Ki * m.integral[steady].mean())
    assert asked[5e-3][0] == pytest.approx(asked[0.0][0], abs=2e-5)  # what the motion needs, the servo finds
    assert asked[5e-3][1] - asked[0.0][1] == pytest.approx(5e-3 * (1.0 - jump), abs=5e-5)


def test_friction_falls_as_grease_warms():
    spec = TruthSpec(single_move(300.0, 3.0), effects=(effect("friction_warmup", rise=0.5, time=1.0),))
    m = true_motion(spec)
    steady = window(m, 0.5, 2.9)
    assert m.applied_torque[steady] == pytest.approx(
        TABLE_1.A * (1.0 + 0.5 * np.exp(-m.time[steady])), rel=1e-9
    )


def test_backlash_loses_its_width_at_a_reversal():
    spec = TruthSpec(BUSY.profile, effects=(effect("backlash", width=5e-5),))
    plain, loose = true_motion(replace(spec, effects=())), true_motion(spec)
    behind = loose.position - plain.position
    assert np.abs(behind[plain.time < 1.0]).max() < 1e-9
    assert behind[(plain.time > 1.8) & (plain.time < 3.0)] == pytest.approx(5e-5, rel=1e-3)


def test_position_delay_and_lag_shift_a_steady_move():
    spec = TruthSpec(single_move(410.0, 2.0))
    steady = window(true_motion(spec), 1.0, 1.9)
    behind = 410.0 * TABLE_1.D * 4e-3
    for item in (effect("position_delay", delay=4e-3), effect("position_lag", lag=4e-3)):
        shift = clean(spec)["position_m"] - clean(replace(spec, effects=(item,)))["position_m"]
        assert shift[steady].mean() == pytest.approx(behind, rel=1e-3)


def test_misspelt_effect_names_what_exists():
    with pytest.raises(ValueError, match="viscous_friction"):
        effect("viscous_fricton")
    with pytest.raises(ValueError, match="minus"):
        effect("viscous_friction", size=1.0)
    with pytest.raises(ValueError, match="twice"):
        make_log(replace(BUSY, effects=(effect("backlash"), effect("backlash"))), 0)


@pytest.mark.slow
@pytest.mark.study
def test_small_sizes_stand_out_as_they_should():
    directions = cache(refit_directions)  # of one rig and campaign for most
    for cause in list(ALL)[::2]:  # half of them, for time
        spec = replace(draw_effect_case(7, cause, 1.0), effects=())
        seen = visible_sigma(spec, (sized_effect(cause, 1.0),), directions(spec))
        at_least = 0.0 if cause == "position_gain" else VISIBLE_SIGMA / 3  # D hides a gain
        assert at_least <= seen < VISIBLE_SIGMA * 30, cause


# --- convergence ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "spec",
    [
        BUSY,
        replace(BUSY, static_ratio=1.3),
        replace(
            BUSY,
            effects=tuple(sized_effect(c, 8.0) for c in ("stribeck_friction", "supply_sag", "current_lag")),
        ),
        replace(
            BUSY, effects=tuple(sized_effect(c, 30.0) for c in ("shaft_ripple", "brush_drop", "backlash"))
        ),
        replace(BUSY, fault=Fault("overload", 0.13)),
        replace(BUSY, fault=Fault("coupling_loss", 0.7)),
        replace(BUSY, servo_hz=2000.0),
    ],
)
def test_half_the_step_gives_the_same_log(spec):
    halved = clean(replace(spec, substep_hz=2 * spec.substep_hz))
    assert worst(halved, clean(spec)) < 0.15  # of one noise sigma; heat and sag are first order in the step


# --- faults --------------------------------------------------------------------------------------


def test_overload_begins_at_its_onset_and_compresses():
    spec = TruthSpec(single_move(-300.0, 3.0), fault=Fault("overload", 1.0))
    m, (_, truth) = true_motion(spec), make_log(spec, 0)
    assert truth["contact_m"] == pytest.approx(np.interp(1.0, m.time, m.position), abs=1e-8)
    late = (m.time > 2.5) & (m.time < 3.2)
    rate = np.gradient(m.position, m.time)[late] / m.speed[late]
    assert rate == pytest.approx(TABLE_1.D * (1 - TABLE_1.E), rel=1e-2)
    depth = truth["contact_m"] - m.position[late]
    assert m.applied_torque[late] == pytest.approx(-TABLE_1.A - TABLE_1.C * depth**2, rel=1e-9)


def test_overload_at_full_speed_meets_the_force_ceiling():
    spec = TruthSpec(single_move(410.0, 26.0), fault=Fault("overload", 1.0), logger=Logger(rate_hz=400.0))
    m = true_motion(spec)
    ceiling = np.flatnonzero((m.source_voltage > TABLE_1.Vmax - 1e-9) & (m.time > 2.0))[0]
    depth = m.position[ceiling] - np.interp(1.0, m.time, m.position)
    assert m.current[ceiling] == pytest.approx(0.305, abs=0.001)
    assert depth == pytest.approx(8.41e-3, rel=2e-3)


def test_coupling_loss_freezes_the_mass_and_lightens_the_motor():
    m = true_motion(TruthSpec(single_move(410.0, 3.0, pitch_deg=7.0), fault=Fault("coupling_loss", 1.0)))
    assert np.ptp(m.position[m.time > 1.001]) == 0.0
    assert m.current[window(m, 2.0, 2.9)].mean() == pytest.approx(TABLE_1.A_loose / TABLE_1.Km, rel=1e-3)


@pytest.mark.parametrize("label", ["overload", "coupling_loss", *UNKNOWN_SIZES])
def test_nothing_happens_before_the_onset(label):
    spec = TruthSpec(single_move(350.0, 1.2))
    fault = Fault("unknown", 0.9, label) if label in UNKNOWN_SIZES else Fault(label, 0.9)
    healthy, faulty = clean(spec), clean(replace(spec, fault=fault))
    before = healthy["time_s"] < 0.9
    pd.testing.assert_frame_equal(healthy[before], faulty[before])
    assert worst(healthy, faulty) > 3.0


def test_slipping_nut_leaves_the_motor_alone():
    spec = TruthSpec(single_move(350.0, 1.2))
    healthy, slipping = clean(spec), clean(replace(spec, fault=Fault("unknown", 0.9, "half_slip")))
    assert slipping["current_a"].equals(healthy["current_a"])
    speed = np.gradient(slipping["position_m"], slipping["time_s"])[
        (healthy["time_s"] > 1.0) & (healthy["time_s"] < 1.4)
    ]
    assert speed.mean() == pytest.approx(350.0 * TABLE_1.D / 2, rel=1e-3)


@pytest.mark.parametrize("channel", COLUMNS)
@pytest.mark.parametrize("kind", FAILURES)
def test_sensor_fault_touches_its_channel_while_it_lasts(kind, channel):
    spec = TruthSpec(single_move(-350.0, 1.2))
    fault = Fault("sensor_fault", 0.6, kind, channel, duration_s=0.5)
    healthy, faulty = make_log(spec, 3)[0], make_log(replace(spec, fault=fault), 3)[0]
    during = (healthy["time_s"] >= 0.6) & (healthy["time_s"] < 1.1)
    column = COLUMNS[channel]
    pd.testing.assert_frame_equal(healthy[~during], faulty[~during])
    pd.testing.assert_frame_equal(healthy.drop(columns=column), faulty.drop(columns=column))
    spread = faulty.loc[during, column].std()
    assert not faulty.loc[during, column].equals(healthy.loc[during, column])
    assert (faulty.loc[during, column].nunique() == 1) == (kind in ("frozen", "saturation"))
    if kind in ("frozen_noisy", "dropout"):
        assert spread == pytest.approx(STD[column], rel=0.15)  # 800 samples: 4 sigma of a standard deviation


def test_impossible_faults_are_refused():
    for arguments in (("overlaod", 1.0), ("overload", None), ("nominal", 1.0), ("sensor_fault", 1.0, "bias")):
        with pytest.raises(ValueError):
            Fault(*arguments)


# --- the logger ----------------------------------------------------------------------------------


def test_noise_is_white_and_as_large_as_asked():
    spec = TruthSpec(single_move(300.0, 1.0))
    residual = make_log(spec, 1)[0] - clean(spec)
    for column, std in STD.items():
        noise = residual[column].to_numpy()
        assert noise.std() == pytest.approx(std, rel=0.06)  # 2880 samples: 4.5 sigma
        assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.08


def test_same_seed_same_log_and_rounded_like_a_daq():
    one, two = make_log(BUSY, 5)[0], make_log(BUSY, 5)[0]
    pd.testing.assert_frame_equal(one, two)
    assert not one["voltage_v"].equals(make_log(BUSY, 6)[0]["voltage_v"])
    for column, step in LINE.items():
        ticks = one[column] / step
        assert np.abs(ticks - ticks.round()).max() < 1e-4


def test_slow_logger_sees_the_same_motion(busy_log):
    slow = clean(replace(BUSY, logger=Logger(rate_hz=400.0)))
    pd.testing.assert_frame_equal(slow, busy_log.iloc[::4].reset_index(drop=True))


def test_encoder_counts_the_motor_angle():
    spec = replace(BUSY, logger=Logger(log_encoder=True))
    gap = true_motion(spec).angle - clean(spec)["encoder_rad"]
    assert gap.min() > -1e-6 and gap.max() < 2 * np.pi / 128 + 1e-6


def test_servo_on_encoder_steps_still_holds_the_speed():
    m = true_motion(TruthSpec(single_move(410.0, 2.0), servo_encoder=True))
    steady = window(m, 1.0, 1.9)
    assert m.speed[steady].mean() == pytest.approx(410.0, abs=0.5)
    assert m.current[steady].mean() == pytest.approx(TABLE_1.A / TABLE_1.Km, rel=0.02)


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz", "log.parquet"])
def test_written_logs_read_back_and_repeat_byte_for_byte(name, tmp_path):
    frame, _ = make_log(TruthSpec(single_move(300.0, 0.2)), 0)
    path = write_log(frame, tmp_path / name)
    first = path.read_bytes()
    read = pd.read_parquet(path) if name.endswith("parquet") else pd.read_csv(path)
    pd.testing.assert_frame_equal(read, frame)
    assert write_log(frame, path).read_bytes() == first


# --- profiles and draws --------------------------------------------------------------------------


def test_profiles_are_as_long_as_they_say():
    assert campaign().duration_s == pytest.approx(20.0, abs=0.01)
    assert [move.speed for move in campaign().moves[::2]] == [410.0, 205.0, 300.0, 410.0]
    assert len(rich_campaign().moves) == 18
    m = true_motion(
        replace(BUSY, profile=contact_campaign(), rig=replace(TABLE_1, stop_low_m=-5e-4, stop_high_m=5e-4))
    )
    assert (
        m.position.max() > 1.5e-3 and m.position.min() < -1.5e-3
    )  # a millimetre of indentation at both ends


@pytest.mark.parametrize("label", LABELS)
def test_drawn_moves_keep_their_promises(label):
    specs = [draw_move_case(seed, label) for seed in range(200)]
    moves = [spec.profile.moves[0] for spec in specs]
    assert all(205.0 <= abs(move.speed) <= 410.0 for move in moves)
    assert 60 < sum(move.speed > 0 for move in moves) < 140
    assert all(abs(spec.profile.pitch_steps[0][1]) <= 12.0 for spec in specs)
    assert specs == [draw_move_case(seed, label) for seed in range(200)]
    if label == "nominal":
        assert all(spec.fault.onset_s is None for spec in specs)
        return
    since = np.array([spec.fault.onset_s - move.start_s for spec, move in zip(specs, moves, strict=True)])
    left = np.array([move.hold_s for move in moves]) - since
    assert since.min() >= 0.0 and left.min() >= 1.0
    assert 0.2 < (since < 0.25).mean() < 0.4  # three in ten, 200 draws: 3 sigma


def test_drawn_moves_move_and_rest():
    for seed in range(6):
        spec = draw_move_case(seed, "nominal")
        frame, truth = make_log(spec, seed)
        move = spec.profile.moves[0]
        travelled = frame["position_m"].iloc[-1] - frame["position_m"].iloc[0]
        assert travelled == pytest.approx(TABLE_1.D * move.speed * move.hold_s, abs=8e-5)
        assert (frame["speed_cmd_rad_s"].iloc[-1], truth["label"]) == (0.0, "nominal")


def test_rig_spread_is_the_papers():
    rigs = [draw_rig(np.random.default_rng(seed), identification_percent=3.0) for seed in range(800)]
    spread = {"A": 0.10, "B": 0.10, "A_loose": 0.10, "C": 0.15, "E": 0.05, "J": 0.03, "Vmax": 0.03}
    for name, sigma in spread.items():
        values = np.array([getattr(rig, name) for rig in rigs]) / getattr(TABLE_1, name)
        assert values.std() == pytest.approx(sigma, rel=0.12)  # 800 draws: 4.5 sigma
    assert np.std([rig.stop_high_m for rig in rigs]) == pytest.approx(1e-3, rel=0.12)
    assert {rig.Km for rig in rigs} == {TABLE_1.Km}


def test_drawn_effect_cases_carry_their_effect():
    spec = draw_effect_case(1, "shaft_ripple", 3.0)
    assert spec == draw_effect_case(1, "shaft_ripple", 3.0)
    assert (
        dict(spec.effects[0].values)["phase"]
        != dict(draw_effect_case(2, "shaft_ripple", 3.0).effects[0].values)["phase"]
    )
    assert draw_effect_case(1, None, 3.0).effects == ()
    assert [item.cause for item in draw_effects_case(4, ("backlash", "torque_offset"), 1.0).effects] == [
        "backlash",
        "torque_offset",
    ]
    signs = {
        np.sign(dict(draw_effect_case(s, "torque_offset", 1.0).effects[0].values)["offset"])
        for s in range(20)
    }
    assert signs == {-1.0, 1.0}


def test_no_code_is_shared_with_the_package():
    package = "observer" + "_fi"
    for path in Path(__file__).parent.glob("*.py"):
        assert package not in path.read_text()
