"""Delays between channels, against loggers that have them, and readings set back to one time."""

import math
from dataclasses import replace

import hidden
import numpy as np
import pytest
from hidden import Fault, draw_move_case, make_log, make_log_with
from hypothesis import given
from hypothesis import strategies as st
from logged_signals import RATE, clock, log_of, signal

from observer_fi.logs import Lateness, SetBack
from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.drives import DRIVES
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Move, Scenario, synthesise
from observer_fi.records import Log
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.logger import lateness
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.logger.lateness import lateness_of, set_right
from observer_fi.verdict.logger.no_command import with_its_servo

RIG, SETTINGS = load_rig(), BankSettings()
SEEDS = range(7601, 7607)
LABELS = ("nominal", "overload", "coupling_loss")
NONE = Lateness()


def through(name: str, seed: int) -> tuple[Lateness, np.ndarray]:
    """What is found of a move through a logger, and the true delays, samples."""
    frame, truth = make_log_with(name, draw_move_case(seed, LABELS[seed % 3]), seed)
    late = AsLogged(log_from_frame(frame), RIG, SETTINGS).late
    told = truth["acquisition"]
    return late, np.array([told[c]["delay_s"] * RATE for c in ("voltage_v", "current_a", "position_m")])


# --- delays through loggers ----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["current_late", "voltage_late"])
@pytest.mark.first(1)
def test_one_late_channel_is_measured(name: str) -> None:
    """Against the other two within a seventh of a sample each, a tenth on average; the other two are hardly late."""
    errors = []
    for seed in SEEDS:
        late, true = through(name, seed)
        assert np.argmax(late) == np.argmax(true) and min(late[:2]) == late.position <= 0.15, seed
        errors.append(np.ptp(late) - true.max())
    assert np.abs(errors).max() < 0.15 and abs(np.mean(errors)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["current_late", "voltage_late", "voltage_late+hum_50hz", "hum_50hz"])
@pytest.mark.first(1)
def test_without_a_command_voltage_and_current_are_late_against_each_other(name: str) -> None:
    """Where no servo is known its current may be anything: only the winding tells, and hum covers some of that."""
    errors = []
    for seed in SEEDS:
        spec = draw_move_case(seed, "nominal")
        frame, truth = make_log_with(f"no_command+{name}", spec, seed)
        late = AsLogged(*with_its_servo(log_from_frame(frame), RIG), SETTINGS).late
        told = [truth["acquisition"][c]["delay_s"] * RATE for c in ("voltage_v", "current_a")]
        assert late.position == min(late), seed
        errors.append((late.current - late.voltage) - (told[1] - told[0]))
    assert np.abs(errors).max() < 0.35 and abs(np.mean(errors)) < 0.15


@pytest.mark.slow
def test_the_first_stop_tells_where_the_log_begins_under_way() -> None:
    """There is no start; the stop of a healthy machine had been a voltage sensor that fails."""
    for seed in (7602, 7605):
        spec = draw_move_case(seed, "nominal")
        for name, least in (("mid_move+voltage_late", 0.5), ("mid_move", 0.0)):
            frame, truth = make_log_with(name, spec, seed)
            log = log_from_frame(frame)
            late, true = (
                AsLogged(log, RIG, SETTINGS).late,
                truth["acquisition"]["voltage_v"]["delay_s"] * RATE,
            )
            assert log.w_cmd[0] != 0.0 and true >= least
            assert late.voltage - late.current == pytest.approx(true, abs=0.25) and late.position <= 0.15, (
                seed
            )
            assert diagnose_log(log, RIG, Settings()).isolation.verdict.label == "nominal", (name, seed)


def test_a_stop_that_is_not_there_tells_nothing() -> None:
    log = log_from_frame(make_log_with("mid_move+voltage_late", draw_move_case(7602, "nominal"), 7602)[0])
    brakes = int(np.flatnonzero(log.w_cmd != log.w_cmd[0])[0])
    for last in (brakes, brakes + 50, brakes - 400):
        assert AsLogged(log.part(slice(0, last)), RIG, SETTINGS).late == NONE


@pytest.mark.slow
def test_a_low_pass_makes_all_channels_late_by_nearly_the_same() -> None:
    """By 0.6 samples, as a delay or, where the colour of the noise shows it, as a filter that is taken out."""
    found = []
    for seed in SEEDS:
        frame, truth = make_log_with("low_pass", draw_move_case(seed, LABELS[seed % 3]), seed)
        known = AsLogged(log_from_frame(frame), RIG, SETTINGS)
        own = [low.delay_s * RATE if math.isfinite(low.corner_hz) else 0.0 for low in known.low_passes]
        voltage, current, position = (a + b for a, b in zip(own, known.late, strict=True))
        true = truth["acquisition"]["current_a"]["delay_s"] * RATE
        assert position <= max(voltage, current) < true + 0.2 and abs(voltage - current) < 0.4
        found.append(max(voltage, current))
    assert np.median(found) == pytest.approx(0.6, abs=0.15)


def test_the_mean_of_32_samples_is_half_of_them_late() -> None:
    for seed in SEEDS:
        late, true = through("position_averaged", seed)
        assert late == Lateness(0.0, 0.0, 15.5) and true[2] == 16.0  # the last sample of it is of now


def test_an_ideal_logger_has_no_delays() -> None:
    for seed in SEEDS:
        assert through("ideal", seed)[0] == NONE


def failing(fault: Fault, seed: int, after_s: float) -> Log:
    """A move through an ideal logger, with a fault so long after its start."""
    spec = draw_move_case(seed, "nominal")
    begins = replace(fault, onset_s=spec.profile.moves[0].start_s + after_s)
    return log_from_frame(make_log(replace(spec, fault=begins), seed)[0])


IN_THE_START = tuple(zip(SEEDS, (0.0, 0.02, 0.04, 0.08, 0.12, 0.2), strict=True))


@pytest.mark.first(1)
@pytest.mark.parametrize("label", ["overload", "coupling_loss"])
def test_a_fault_of_the_actuator_in_the_start_makes_no_channel_late(label: str) -> None:
    """A coupling that is lost before the position has moved: see the next test."""
    for seed, after_s in IN_THE_START:
        late = AsLogged(failing(Fault(label, 0.0), seed, after_s), RIG, SETTINGS).late
        assert late == NONE or (label == "coupling_loss" and after_s < 0.03 and late.electrical == 0.0), seed


def test_nor_does_a_coupling_lost_before_the_start() -> None:
    for seed in SEEDS:
        assert AsLogged(failing(Fault("coupling_loss", 0.0), seed, 0.0), RIG, SETTINGS).late == NONE


FAILING = [
    Fault("sensor_fault", 0.0, "frozen", "position"),
    Fault("sensor_fault", 0.0, "frozen", "current"),
    Fault("sensor_fault", 0.0, "frozen", "voltage"),
    Fault("sensor_fault", 0.0, "bias", "current", 9e-3),
    Fault("sensor_fault", 0.0, "bias", "voltage", 0.3),
]
ONE, *MORE = FAILING


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [ONE, *(pytest.param(fault, marks=pytest.mark.slow) for fault in MORE)],
    ids=lambda fault: f"{fault.kind}-{fault.channel}",
)
@pytest.mark.first(1)
def test_nor_does_a_sensor_that_fails_in_the_start(fault: Fault) -> None:
    for seed, after_s in IN_THE_START:
        assert AsLogged(failing(fault, seed, after_s), RIG, SETTINGS).late == NONE, seed


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAILING[:4:2], ids=lambda fault: f"{fault.kind}-{fault.channel}")
@pytest.mark.first(1)
def test_a_sensor_that_fails_in_the_start_is_named(fault: Fault) -> None:
    for seed, after_s in IN_THE_START[::2]:
        outcome = diagnose_log(failing(fault, seed, after_s), RIG, Settings())
        verdict = outcome.isolation.verdict
        assert verdict.label == "sensor_fault", seed
        one = (
            {"voltage", "current"} if fault.kind == "bias" else {fault.channel}
        )  # at the start a bias of one is one of both
        assert verdict.channel in one, seed


def test_a_held_reading_is_set_back_though_none_stands_before_it() -> None:
    log = synthesise(Scenario((Move(0.3, 410.0, 0.6),), 1.2, seed=3), RIG)[0]
    held = log.z.copy()
    held[np.arange(len(held)) % 16 != 0, 2] = np.nan
    out = SetBack(Lateness(0.0, 0.3, 0.0)).take(replace(log, z=held)).z
    assert np.isfinite(out[:, 2]).sum() == np.isfinite(held[:, 2]).sum()
    np.testing.assert_allclose(out[::16, 2], held[::16, 2], rtol=1e-12)


# --- where nothing can be told -------------------------------------------------------------------


def test_what_is_known_stays_where_there_is_no_start() -> None:
    known = Lateness(0.0, 0.0, 15.5)
    log = signal()
    rest = replace(log, w_cmd=np.zeros(log.t.size))
    assert lateness_of(rest, RIG, SETTINGS, known) is known
    log.z[:, 0] = np.nan
    assert lateness_of(log, RIG, SETTINGS, known) is known
    without_servo = replace(
        RIG, drive=next(name for name, drive in DRIVES.items() if not drive.servo and drive.motor)
    )
    assert lateness_of(signal(), without_servo, SETTINGS, known) is known


def test_a_log_that_begins_in_motion_has_no_start_to_learn_from() -> None:
    log = signal()
    moving = log.t > 0.75
    late = replace(log, t=log.t[moving], z=log.z[moving], w_cmd=log.w_cmd[moving], pitch=log.pitch[moving])
    assert lateness.first_start(late) is None
    cut = lateness.first_start(log)
    assert (
        cut is not None
        and cut.t[0] == pytest.approx(0.58, abs=0.002)
        and cut.t[-1] == pytest.approx(0.95, abs=0.002)
    )


# --- readings set back ---------------------------------------------------------------------------

SAMPLES = st.floats(0.0, 3.0)


def straight(n: int = 200) -> Log:
    t = clock(n / RATE)
    return log_of(t, np.outer(t * RATE, (1.0, -2.0, 0.5)))


@given(voltage=SAMPLES, current=SAMPLES, position=SAMPLES)
def test_straight_lines_are_set_back_to_the_sample(voltage: float, current: float, position: float) -> None:
    late = Lateness(voltage, current, position)
    log = straight()
    back = [max(late.electrical - own, 0.0) for own in late]
    expected = (np.arange(200)[:, None] - back) * (1.0, -2.0, 0.5)
    np.testing.assert_allclose(SetBack(late).take(log).z[4:], expected[4:], atol=1e-9)


def test_without_delays_it_is_the_very_log() -> None:
    log = straight()
    assert SetBack(NONE).take(log) is log
    assert SetBack(Lateness(0.0, 0.0, 15.5)).take(log) is log  # a late position is a delay of the model


@given(cuts=st.lists(st.integers(1, 199), max_size=30), voltage=SAMPLES, current=SAMPLES)
def test_chunks_make_no_difference(cuts: list[int], voltage: float, current: float) -> None:
    log = signal(3)
    log = replace(log, t=log.t[:200], z=log.z[:200], w_cmd=log.w_cmd[:200], pitch=log.pitch[:200])
    log.z[50:55, 1] = np.nan
    late = Lateness(voltage, current)
    many, edges = SetBack(late), [0, *sorted(set(cuts)), 200]
    parts = [
        many.take(replace(log, t=log.t[a:b], z=log.z[a:b], w_cmd=log.w_cmd[a:b], pitch=log.pitch[a:b])).z
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    np.testing.assert_array_equal(np.concatenate(parts), SetBack(late).take(log).z)


def test_the_rig_takes_what_is_left() -> None:
    assert set_right(RIG, NONE, 1.0 / RATE) is RIG
    model = set_right(RIG, Lateness(0.25, 1.0, 16.0), 1.0 / RATE).model
    assert model["input_delay"] == pytest.approx(RIG.model["input_delay"] + 1.0 / RATE)
    assert model["position_delay"] == pytest.approx(RIG.model["position_delay"] + 15.0 / RATE)


def test_what_is_late_by_how_much_and_the_parts_of_it_are_the_same_thing() -> None:
    for late in (NONE, Lateness(0.5, 1.25, 4.5), Lateness(2.0, 0.25, 0.25)):
        assert lateness._shifted(**lateness._parts(late)) == late
    assert set(hidden.CHANNELS) == set(Lateness._fields)
