"""Each trait of a logger does what it says, measured with plain numpy on ramps, and an ideal logger adds nothing."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from . import (
    CHANNELS,
    FAILURES,
    IDEAL,
    NO_FAULT,
    PAIRS,
    TRAITS,
    TRIPLES,
    Fault,
    Logger,
    TruthSpec,
    combined,
    draw_failing_case,
    draw_move_case,
    make_log,
    make_log_through,
    make_log_with,
    single_move,
    trait_of,
)
from .acquisition import Scene, ideal, record_through, true_sizes
from .plant import Motion
from .sensors import COLUMNS, Sensors

SECONDS, STEP_S = 4.0, 1.0 / 48000.0
SLOPES = {"voltage": 1.0, "current": 0.05, "position": 5e-4}  # V/s, A/s, m/s
STARTS = {"voltage": 5.0, "current": 0.02, "position": 1e-3}
SIGMA = {"voltage": 10e-3, "current": 0.3e-3, "position": 10e-6}
EVERY = [*TRAITS, *PAIRS, *TRIPLES]
MOVE = TruthSpec(single_move(350.0, 1.2, pitch_deg=4.0), start_integral_rad=0.01)


def ramps(logger, fault=NO_FAULT):
    """A scene in which every channel is a straight line."""
    time = np.arange(int(SECONDS / STEP_S)) * STEP_S
    line = {channel: STARTS[channel] + SLOPES[channel] * time for channel in CHANNELS}
    none = np.zeros_like(time)
    motion = Motion(time, line["voltage"], line["current"], line["position"], none, none, none, none)
    moving = lambda times: np.where((times >= 1.0) & (times < 2.0), 300.0, 0.0)  # noqa: E731
    return Scene(motion, np.zeros_like, moving, 0.0, Sensors(), logger, fault)


def logged(name, seed=1, logger=None, fault=NO_FAULT):
    """Log, residuals from the true lines by channel, and true sizes of `ramps` through a logger."""
    logger = logger or Logger()
    acquisition = trait_of(name).apply(ideal(logger), seed)
    rate = acquisition.clock.rate_hz
    times = np.arange(int(SECONDS * rate)) / rate
    frame, spikes = record_through(ramps(logger, fault), acquisition, times, seed)
    rest = {
        channel: frame[column].to_numpy() - STARTS[channel] - SLOPES[channel] * frame["time_s"].to_numpy()
        for channel, column in COLUMNS.items()
        if column in frame
    }
    return frame, rest, true_sizes(acquisition, spikes)


def correlation(values, lag):
    values = values - values.mean()
    return float(values[lag:] @ values[:-lag] / (values @ values))


# --- as it was, and repeatable -----------------------------------------------------------------------


@pytest.mark.parametrize("label", ["nominal", "coupling_loss", "sensor_fault"])
def test_an_ideal_logger_writes_the_same_bits(label):
    logger = Logger(log_encoder=True, pitch_noise_deg=0.1)
    spec = replace(draw_move_case(7003, label), logger=logger)
    frame, truth = make_log(spec, 3)
    through, told = make_log_with("ideal", spec, 3)
    pd.testing.assert_frame_equal(through, frame, check_exact=True)
    assert {key: told[key] for key in truth} == truth
    assert IDEAL.apply(ideal(logger), 3) == ideal(logger)


@pytest.mark.parametrize("name", EVERY)
def test_a_seed_repeats_and_another_does_not(name):
    one, two, other = logged(name, 5)[0], logged(name, 5)[0], logged(name, 6)[0]
    pd.testing.assert_frame_equal(one, two, check_exact=True)
    assert not one["current_a"].equals(other["current_a"])
    assert (np.diff(one["time_s"]) > 0.0).all()
    assert np.isfinite(one.to_numpy()).all()


@pytest.mark.parametrize("name", [name for name in EVERY if name != "ideal"])
def test_every_trait_leaves_its_mark(name):
    frame, plain = make_log_with(name, MOVE, 5)[0], make_log(MOVE, 5)[0]
    assert not frame.equals(plain)
    assert trait_of(name).words


def test_combinations_hold_what_their_parts_do():
    assert (len(TRAITS) >= 25, len(PAIRS), len(TRIPLES)) == (True, 8, 4)
    spec = Logger()
    both = combined(["noise_3", "hum_50hz"]).apply(ideal(spec), 4)
    noise, hum = TRAITS["noise_3"].apply(ideal(spec), 4), TRAITS["hum_50hz"].apply(ideal(spec), 4)
    assert both.chains["current"].noise_std == noise.chains["current"].noise_std
    assert both.chains["current"].lines == hum.chains["current"].lines
    assert not combined(["noise_3", "position_5hz"]).keeps
    with pytest.raises(ValueError, match="no trait hum_55hz"):
        trait_of("noise_3+hum_55hz")


# --- noise -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ideal", "noise_3", "noise_third", "position_averaged", "low_pass"])
def test_noise_is_as_large_as_told(name):
    _, rest, told = logged(name)
    for channel, values in rest.items():
        smooth = name == "position_averaged" and channel == "position"  # 200 independent averages: 3 sigma
        late = values - np.mean(values)
        assert late.std() == pytest.approx(told[COLUMNS[channel]]["noise_std"], rel=0.2 if smooth else 0.06)


def test_colour_and_wander_have_their_correlation():
    _, rest, told = logged("coloured")
    for channel, values in rest.items():
        sizes = told[COLUMNS[channel]]
        assert values.std() == pytest.approx(SIGMA[channel], rel=0.1)
        assert correlation(values, 1) == pytest.approx(np.exp(-1 / 1600 / sizes["correlation_s"]), abs=0.05)
        assert sizes["noise_std"] == 0.0
    _, rest, told = logged("wandering")
    for channel, values in rest.items():
        sizes = told[COLUMNS[channel]]
        share = sizes["wander_std"] ** 2 / (sizes["wander_std"] ** 2 + SIGMA[channel] ** 2)
        expected = share * np.exp(-0.02 / sizes["correlation_s"])
        assert correlation(values, 32) == pytest.approx(expected, abs=0.2)  # 4 s hold 100 correlation times
        assert np.diff(values).std() == pytest.approx(
            SIGMA[channel] * np.sqrt(2.0), rel=0.2
        )  # white on top of it


@pytest.mark.parametrize("name", ["ideal", "coloured"])
def test_a_burst_is_of_the_noise_that_the_sensor_has(name):
    spec = draw_failing_case(3, "noise_burst", "voltage")
    frame, truth = make_log_with(name, spec, 3)
    quiet, _ = make_log_with(name, replace(spec, fault=NO_FAULT), 3)
    louder = (frame["voltage_v"] - quiet["voltage_v"])[frame["time_s"] > truth["onset_s"]]
    assert louder.std() == pytest.approx((truth["size"] - 1.0) * SIGMA["voltage"], rel=0.1)


def test_another_range_is_noisier_from_its_switch_on():
    acquisition = TRAITS["range_switched"].apply(ideal(Logger()), 1)
    switched = [channel for channel, chain in acquisition.chains.items() if chain.later_noise > 1.0]
    _, rest, _ = logged("range_switched")
    assert len(switched) == 1
    for channel, values in rest.items():
        ratio = values[int(0.75 * values.size) :].std() / values[: int(0.25 * values.size)].std()
        assert ratio == pytest.approx(4.0 if channel in switched else 1.0, rel=0.1)


def test_spikes_are_counted():
    hits = {channel: 0 for channel in CHANNELS}
    for seed in range(4):
        _, rest, told = logged("spikes", seed)
        for channel, values in rest.items():
            found = int((np.abs(values) > 12.0 * SIGMA[channel]).sum())
            assert found == told[COLUMNS[channel]]["spikes"]
            hits[channel] += found
    assert 40 < sum(hits.values()) < 120  # 77 expected, 9 the standard deviation


# --- lines, offsets, delays --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["hum_50hz", "hum_60hz", "pwm_line", "pwm_line+slow_200hz"])
def test_lines_stand_where_told(name):
    frame, rest, told = logged(name)
    time = frame["time_s"].to_numpy()
    for channel, values in rest.items():
        for hz, amplitude in told[COLUMNS[channel]]["lines"]:
            wave = np.column_stack((np.sin(2 * np.pi * hz * time), np.cos(2 * np.pi * hz * time)))
            found = np.hypot(*np.linalg.lstsq(wave, values, rcond=None)[0])
            assert found == pytest.approx(amplitude, rel=0.1)
    assert any(told[column]["lines"] for column in COLUMNS.values())


def test_offsets_are_added():
    _, rest, told = logged("offsets")
    for channel, values in rest.items():
        error = 4.0 * SIGMA[channel] / np.sqrt(values.size)
        assert values.mean() == pytest.approx(told[COLUMNS[channel]]["offset"], abs=error)
    assert 0.02 < abs(told["voltage_v"]["offset"]) < 0.04


@pytest.mark.parametrize(
    "name", ["current_late", "position_late", "voltage_late", "position_averaged", "low_pass"]
)
def test_delays_are_those_told(name):
    _, rest, told = logged(name, logger=Logger().noiseless())
    for channel, values in rest.items():
        lag = -values[320:].mean() / SLOPES[channel]  # what was before zero is past after 0.2 s
        assert lag == pytest.approx(told[COLUMNS[channel]]["delay_s"], abs=0.02 / 1600.0)
    assert max(told[column]["delay_s"] for column in COLUMNS.values()) > 0.1 / 1600.0


# --- steps and holds ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["steps_voltage", "steps_current", "steps_position", "steps_all", "steps_3_all", "csv_3_decimals"]
)
def test_readings_come_in_steps(name):
    frame, rest, told = logged(name)
    for channel, column in COLUMNS.items():
        step = told[column]["resolution"]
        if step is not None:
            moved = np.diff(frame[column]) / step
            assert np.abs(moved - np.round(moved)).max() < 1e-3
            assert set(np.round(np.abs(moved))) >= {0.0, 1.0}
            spread = np.hypot(SIGMA[channel], step / np.sqrt(12.0))  # noise is there before the rounding
            assert rest[channel].std() == pytest.approx(spread, rel=0.06)
    touched = [channel for channel, column in COLUMNS.items() if told[column]["resolution"] is not None]
    assert touched == (
        [name.removeprefix("steps_")] if name.startswith("steps_") and "all" not in name else list(CHANNELS)
    )


def test_twelve_bits_clip_at_their_range():
    acquisition = TRAITS["twelve_bits"].apply(ideal(Logger()), 1)
    narrow = replace(acquisition.chains["voltage"], limit=6.0)
    chains = {**acquisition.chains, "voltage": narrow}
    scene = ramps(Logger())
    frame, _ = record_through(scene, replace(acquisition, chains=chains), np.arange(6400) / 1600.0, 1)
    assert frame["voltage_v"].max() == pytest.approx(6.0, abs=0.01)
    assert frame["voltage_v"].max() < scene.motion.source_voltage.max() - 1.0
    assert frame["current_a"].max() > 0.2


@pytest.mark.parametrize(
    ("name", "channels", "hz"),
    [
        ("position_100hz", ["position"], 100.0),
        ("position_50hz", ["position"], 50.0),
        ("position_60hz", ["position"], 60.0),
        ("position_5hz", ["position"], 5.0),
        ("drive_400hz", ["voltage", "current"], 400.0),
    ],
)
def test_held_readings_change_at_their_own_rate(name, channels, hz):
    frame, rest, told = logged(name)
    for channel in channels:
        changes = np.flatnonzero(np.diff(frame[COLUMNS[channel]])) + 1
        runs = np.diff(changes)
        whole = 1600.0 / hz
        assert told[COLUMNS[channel]]["update_hz"] == hz
        assert np.isin(runs, (np.floor(whole), np.ceil(whole))).mean() > 0.98  # two readings may be equal
        assert runs.mean() == pytest.approx(whole, rel=0.02)
        fresh = rest[channel][changes]
        aged = SLOPES[channel] / 1600.0 + 5.0 * SIGMA[channel] / np.sqrt(changes.size)
        assert abs(fresh.mean()) < aged  # at most a sample old when it first shows
    if len(channels) > 1:  # one converter
        first, second = (np.flatnonzero(np.diff(frame[COLUMNS[channel]])) for channel in channels)
        assert len(set(first) ^ set(second)) < 0.02 * first.size


def test_two_seeds_hold_at_two_phases():
    first = [np.flatnonzero(np.diff(logged("position_50hz", seed)[0]["position_m"]))[0] for seed in range(6)]
    assert len(set(first)) > 2


# --- the clock, the columns, the drive ---------------------------------------------------------------


def test_clock_traits():
    stamps = logged("milliseconds")[0]["time_s"].to_numpy()
    assert np.abs(stamps * 1e3 - np.round(stamps * 1e3)).max() < 1e-6
    assert set(np.round(np.diff(stamps) * 1e3)) == {1.0, 2.0}
    frame, _, told = logged("jitter")
    off = frame["time_s"] - np.arange(len(frame)) / 1600.0
    assert off.std() == pytest.approx(told["clock"]["jitter_s"], rel=0.06)
    quiet = logged("jitter", logger=Logger().noiseless())[1]
    assert np.abs(quiet["position"]).max() < 1e-8  # read when stamped
    frame, _, told = logged("missing_rows")
    assert 1.0 - len(frame) / 6400 == pytest.approx(told["clock"]["missing_share"], abs=0.008)
    assert len(logged("slow_200hz")[0]) == 800
    begins = logged("mid_move")[0]["time_s"].iloc[0]
    assert 1.03 <= begins <= 1.2501


def test_columns_that_are_not_written():
    assert "voltage_v" not in logged("no_voltage")[0]
    assert "speed_cmd_rad_s" not in logged("no_command")[0]
    assert "voltage_v" not in logged("no_voltage")[2]


def test_a_drive_at_rest_is_switched_off():
    frame = logged("drive_off")[0]
    time = frame["time_s"]
    on = (time >= 1.0) & (time < 2.0 + 0.05 - 1e-3)
    assert frame.loc[~on & (time < 1.0), "current_a"].mean() == pytest.approx(0.0, abs=5e-5)
    assert frame.loc[time > 2.06, "voltage_v"].std() == pytest.approx(SIGMA["voltage"], rel=0.1)
    assert frame.loc[on, "voltage_v"].min() > 5.5
    assert frame["position_m"].iloc[-1] > 2.8e-3  # the position sensor is not the drive's


# --- sensors that fail -------------------------------------------------------------------------------


def test_a_failing_sensor_fails_before_it_is_held():
    fault = Fault("sensor_fault", 2.0, "bias", "position", 1e-3)
    frame, rest, _ = logged("position_50hz", fault=fault)
    jump = np.flatnonzero(np.abs(np.diff(rest["position"])) > 5e-4)
    assert jump.size == 1
    assert 2.0 - 1e-9 <= frame["time_s"].iloc[jump[0] + 1] <= 2.0 + 1.0 / 50.0 + 1e-3


def test_a_saturated_sensor_stays_below_what_it_read():
    rest = logged("ideal", fault=Fault("sensor_fault", 1.0, "saturation", "voltage", 0.5))[0]
    later = rest.loc[rest["time_s"] >= 1.0, "voltage_v"]
    assert later.max() == pytest.approx(5.5, abs=1e-6)
    assert rest.loc[rest["time_s"] < 1.0, "voltage_v"].max() > 5.95


def test_a_stuck_bit_is_right_every_other_time():
    """From 6 to 7 V the bit worth 1 V is 0, and stuck at 1: readings are 1 V high there, and right from 7 to 8 V."""
    _, rest, _ = logged("ideal", fault=Fault("sensor_fault", 1.5, "stuck_bit", "voltage", 1.0), seed=2)
    values = rest["voltage"]
    for first, last, error in ((0, 1.5, 0.0), (1.5, 1.9, 1.0), (2.1, 2.9, 0.0), (3.1, 3.9, 1.0)):
        part = values[int(1600 * first) : int(1600 * last)]
        assert np.abs(part - error).max() < 0.06


@pytest.mark.parametrize("kind", FAILURES)
def test_drawn_failures_fall_into_the_move(kind):
    spec = draw_failing_case(7001, kind, "current", 3.0)
    move = spec.profile.moves[0]
    assert (spec.fault.kind, spec.fault.channel) == (kind, "current")
    assert move.start_s + 0.25 < spec.fault.onset_s < move.brake_s - 0.99
    assert spec == draw_failing_case(7001, kind, "current", 3.0)
    with pytest.raises(ValueError, match="no failure"):
        draw_failing_case(7001, "melted", "current")


def test_a_position_servos_command_has_no_logger_as_it_is():
    with pytest.raises(ValueError, match="position servo"):
        make_log_through(ideal(Logger()), replace(MOVE, Kx=10.0, window_m=1e-4), 0)
