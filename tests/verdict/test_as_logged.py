"""What filters take of a log: the very log where the logger is ideal, the same numbers whatever the chunks."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hidden import draw_effects_case, draw_move_case, draw_severity_case, make_log_with

from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Move, Scenario, synthesise
from observer_fi.records import Acquisition, ChannelTraits, Clock, Log
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.as_logged import AsLogged, electrical_offset, fastest_current

RIG, SETTINGS = load_rig(), BankSettings()
LABELS = ("nominal", "overload", "coupling_loss")


@cache
def through(name: str, seed: int = 7603) -> Log:
    return log_from_frame(make_log_with(name, draw_move_case(seed, LABELS[seed % 3]), seed)[0])


@cache
def known_of(name: str, seed: int = 7603) -> AsLogged:
    return AsLogged(through(name, seed), RIG, SETTINGS)


def rows_of(log: Log) -> np.ndarray:
    return np.column_stack((log.t, log.z, log.pitch, log.w_cmd))


@pytest.mark.parametrize("seed", range(4))
def test_an_ideal_logger_leaves_rig_bank_and_log_as_they_are(seed: int) -> None:
    log = synthesise(Scenario((Move(0.3, 410.0, 0.6),), 1.2, seed=seed), RIG)[0]
    known = AsLogged(log, RIG, SETTINGS)
    assert known.rig is RIG and known.settings is SETTINGS and known.offset == 0.0 and not any(known.late)
    assert known.take(log) is log
    table = rows_of(log)
    assert known.take_rows(table) is table
    assert known.same_as(None, SETTINGS) and known.same_as(known, SETTINGS)


def test_the_digits_of_a_file_change_nothing() -> None:
    for seed in range(7601, 7607):
        known = known_of("ideal", seed)
        assert known.rig is RIG and known.same_as(None, SETTINGS)


@pytest.mark.parametrize(
    "name", ["noise_3", "steps_3_all", "position_100hz", "hum_50hz", "wandering", "voltage_late"]
)
def test_other_loggers_change_what_filters_take(name: str) -> None:
    known = known_of(name)
    assert known.rig is RIG or known.rig.logger == known.acquisition
    assert (known.rig.noise_std >= RIG.noise_std).all()
    assert not known.same_as(None, SETTINGS)
    assert not known.same_as(known_of("ideal"), SETTINGS)


def test_a_held_reading_is_news() -> None:
    assert not known_of("position_100hz").same_as(known_of("ideal"), SETTINGS)


def test_filters_take_the_noise_that_was_seen() -> None:
    ratio = known_of("noise_3").rig.noise_std / RIG.noise_std
    assert (ratio > 2.4).all() and (ratio < 3.6).all()
    assert (
        known_of("noise_third").rig.noise_std == RIG.noise_std
    ).all()  # the file's, which is also doubt of the model


CHUNKED = (
    "position_100hz+current_late",
    "offsets+drive_400hz",
    "twelve_bits+voltage_late",
    "milliseconds+steps_all",
)


@pytest.mark.parametrize("name", CHUNKED)
@pytest.mark.parametrize("size", [1, 7, 500])
@pytest.mark.first(2)
def test_chunks_make_no_difference_to_readings(name: str, size: int) -> None:
    log = through(name)
    log = replace(log, t=log.t[:2000], z=log.z[:2000], w_cmd=log.w_cmd[:2000], pitch=log.pitch[:2000])
    whole, many = AsLogged(log, RIG, SETTINGS), AsLogged(log, RIG, SETTINGS)
    parts = [
        many.take(replace(log, t=log.t[k : k + size], z=log.z[k : k + size], w_cmd=log.w_cmd[k : k + size],
                          pitch=log.pitch[k : k + size]))
        for k in range(0, 2000, size)
    ]  # fmt: skip
    np.testing.assert_array_equal(np.concatenate([part.z for part in parts]), whole.take(log).z)
    assert (np.diff(np.concatenate([part.t for part in parts])) > 0.0).all()


@pytest.mark.parametrize("name", CHUNKED)
def test_a_stream_takes_the_readings_of_the_log(name: str) -> None:
    log = through(name)
    one, two = AsLogged(log, RIG, SETTINGS), AsLogged(log, RIG, SETTINGS)
    table = rows_of(log)
    before = table.copy()
    taken = np.concatenate([two.take_rows(table[k : k + 64]) for k in range(0, len(table), 64)])
    np.testing.assert_array_equal(taken[:, 1:4], one.take(log).z)
    np.testing.assert_array_equal(taken[:, [0, 4, 5]], before[:, [0, 4, 5]])
    np.testing.assert_array_equal(table, before)


# --- offsets -------------------------------------------------------------------------------------


def logged(voltage: float, current: float, noise: float = 1.0) -> Acquisition:
    std = noise * RIG.file_noise_std
    channels = [
        ChannelTraits(s, s, offset=off) for s, off in zip(std.tolist(), (voltage, current, 0.0), strict=True)
    ]
    return Acquisition(*channels, Clock(0.0, None, 1.0 / 1600.0))


def test_at_rest_the_voltage_is_that_of_the_current() -> None:
    Rm = RIG.model["Rm"]
    assert electrical_offset(logged(Rm * 0.02, 0.02), RIG) == 0.0  # a motor that holds a weight
    assert electrical_offset(logged(Rm * 0.02 + 0.03, 0.02), RIG) == pytest.approx(0.03)
    assert electrical_offset(logged(0.0, 0.01), RIG) == pytest.approx(-0.01 * Rm)


def test_what_noise_may_be_is_no_offset() -> None:
    assert electrical_offset(logged(1e-3, 0.0), RIG) == 0.0
    assert electrical_offset(logged(0.03, 0.0, noise=20.0), RIG) == 0.0
    assert electrical_offset(logged(np.nan, 0.01), RIG) == 0.0


@pytest.mark.slow
def test_offsets_through_a_logger_are_taken_out() -> None:
    """Those of voltage and current together: 30 mV and 2 mA within a quarter; apart where the motion tells them."""
    for seed in range(7601, 7607):
        _, truth = make_log_with("offsets", draw_move_case(seed, LABELS[seed % 3]), seed)
        told = truth["acquisition"]
        expected = told["voltage_v"]["offset"] - RIG.model["Rm"] * told["current_a"]["offset"]
        known = known_of("offsets", seed)
        found = known.offset - RIG.model["Rm"] * known.zero
        assert known.zero in (0.0, pytest.approx(told["current_a"]["offset"], rel=0.25))
        assert found == pytest.approx(expected, abs=0.01) or abs(expected) < 0.01


# --- campaigns: what only many rests and moves tell ------------------------------------------------


@cache
def campaign(name: str, seed: int) -> Log:
    return log_from_frame(make_log_with(name, draw_effects_case(seed, (), 0.0), seed)[0])


@pytest.mark.parametrize("name", ["hum_50hz", "position_100hz+steps_all+hum_50hz"])
def test_lines_that_hold_through_a_campaign_are_taken_out(name: str) -> None:
    """Hum taken for white noise swings like a sensor that fails for a while."""
    known = AsLogged(campaign(name, 8300), RIG, SETTINGS)
    assert known.lines is not None and not known.plain
    assert [len(channel.lines) for channel in known.told[:3]] == [1, 1, 0]
    assert (known.rig.noise_std[:2] < 1.6 * RIG.noise_std[:2]).all()
    assert (
        known_of("hum_50hz").rig.noise_std[:2] > 2.0 * RIG.noise_std[:2]
    ).all()  # of one move nobody knows


@pytest.mark.slow
def test_lines_of_held_readings_stay_in_them() -> None:
    known = AsLogged(campaign("drive_400hz+hum_50hz", 8301), RIG, SETTINGS)
    assert known.lines is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coloured", "coloured+position_late"])
@pytest.mark.first(1)
def test_noise_that_wanders_is_no_filter(name: str) -> None:
    """A filter makes its noise white, which gained a thousand nats: in the rest as in the motion."""
    for seed in range(8302, 8306):
        assert not AsLogged(campaign(name, seed), RIG, SETTINGS).low_passes.any, seed


@pytest.mark.slow
@pytest.mark.parametrize("logger", ["no_voltage", "mid_move", "position_100hz+steps_all+hum_50hz"])
@pytest.mark.first(1)
def test_healthy_campaigns_are_healthy(logger: str) -> None:
    """Through each of these loggers one in three to six had been called faulty."""
    for seed in range(8310, 8316):
        labels = {e.label for e in diagnose_log(campaign(logger, seed), RIG, Settings()).isolation.events}
        assert labels == {"nominal"}, seed


# --- a servo that nobody knows ----------------------------------------------------------------------


def test_a_jump_of_a_sensor_is_no_fast_current() -> None:
    """A ramp of the current, as long as it lasts, is; its noise is next to none of it."""
    t = np.arange(2000) / 1600.0
    noise = np.random.default_rng(1).normal(0.0, 1e-3, t.size)

    def fastest(current: np.ndarray) -> float:
        z = np.stack([np.zeros(t.size), current, np.zeros(t.size)], axis=1)
        return fastest_current(Log("made", t, z, np.zeros(t.size), np.zeros(t.size)))

    ramp = np.interp(t, (0.5, 0.51), (0.0, 0.8))
    assert fastest(ramp + noise) == pytest.approx(0.8 / 16.0 * 40.0, rel=0.05)
    assert fastest(noise + (t > 0.5)) < 0.05 * fastest(ramp)
    assert fastest(np.full(t.size, np.nan)) == 0.0
    held = np.where(
        np.arange(t.size) % 2 == 0, ramp, np.nan
    )  # twice as far from one reading to the next, in twice the time
    assert fastest(held) == pytest.approx(np.sqrt(2.0) * fastest(ramp), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "logger"), [("nominal", "ideal"), ("nominal", "drive_400hz"), ("jam", "ideal")]
)
@pytest.mark.first(1)
def test_reversals_without_a_rest_of_an_unknown_servo_are_judged(kind: str, logger: str) -> None:
    """Healthy ones were faults without a name, and a jam between them an all-clear."""
    spec = draw_severity_case(95_800_000, kind, "without_rests")
    log = log_from_frame(make_log_with(logger, spec, 95_800_000)[0])
    assert diagnose_log(log, RIG.without_servo, Settings()).isolation.verdict.label == kind
