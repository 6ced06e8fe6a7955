"""Sensors that stand still to the last digit, and what only looks like one."""

from dataclasses import replace

import hidden
import numpy as np
import pytest

from observer_fi.logs import stuck_from
from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.stuck import jump_in
from pipelines import rigs_study


def verdict_on(spec: hidden.TruthSpec, seed: int, logger: str = "ideal") -> Event:
    frame, _ = hidden.make_log_with(logger, spec, seed)
    isolation = diagnose_log(log_from_frame(frame), load_rig(), Settings()).isolation
    assert isolation is not None
    return isolation.verdict


def noise(seed: int, n: int, step: float = 0.0) -> np.ndarray:
    z = np.random.default_rng(seed).normal(size=n)
    return np.round(z / step) * step if step else z


@pytest.mark.parametrize("step", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("seed", range(5))
def test_readings_that_stand_far_longer_than_ever_before_are_stuck(step: float, seed: int) -> None:
    z = noise(seed, 3000, step)
    z[2000:] = z[2000]
    found = stuck_from(z)
    assert found is not None and 1990 <= found <= 2000


@pytest.mark.parametrize(
    "z",
    [
        noise(1, 3000),
        noise(2, 3000, 3.0),  # steps so coarse that readings stand by themselves
        np.repeat(noise(3, 100), 30),  # held readings
        np.zeros(500),  # the same from the first sample on: no sensor that failed
        np.append(noise(4, 500), np.full(30, 2.0)),  # too few to tell
        np.full(400, np.nan),
    ],
)
def test_what_noise_steps_and_holds_do_is_not_stuck(z: np.ndarray) -> None:
    assert stuck_from(z) is None


def test_missing_readings_do_not_hide_a_stuck_one() -> None:
    z = noise(5, 3000)
    z[2000:] = z[2000]
    z[::7] = np.nan
    found = stuck_from(z)
    assert found is not None and 2000 <= found <= 2002


@pytest.mark.parametrize("channel", hidden.CHANNELS)
@pytest.mark.parametrize(("logger", "seed"), [("ideal", 320001), ("steps_all", 320000)])
@pytest.mark.first(2)
def test_a_frozen_sensor_has_its_name_and_its_begin(channel: str, logger: str, seed: int) -> None:
    spec = hidden.draw_failing_case(seed, "frozen", channel)
    told = verdict_on(spec, seed, logger)
    assert (told.label, told.channel) == ("sensor_fault", channel)
    assert told.onset_s is not None and abs(told.onset_s - float(spec.fault.onset_s or 0.0)) < 5e-3


@pytest.mark.parametrize(
    ("label", "logger"),
    [
        ("nominal", "steps_3_all"),
        ("nominal", "csv_3_decimals"),
        ("overload", "ideal"),
        ("overload", "steps_3_all"),
        ("overload", "position_50hz"),
        ("coupling_loss", "steps_3_all"),
        ("coupling_loss", "csv_3_decimals"),
        ("coupling_loss", "drive_off"),
    ],
)
@pytest.mark.first(2, 3)
def test_a_mass_that_stands_is_no_sensor_that_does(label: str, logger: str) -> None:
    told = verdict_on(hidden.draw_move_case(320100, label), 320100, logger)
    assert label in (told.label, *told.alike)
    assert "stands still to the last digit" not in " ".join(told.reasons)


@pytest.mark.slow
def test_a_position_that_froze_under_its_noise_is_not_surely_a_lost_coupling() -> None:
    """The friction that is left would be to a percent what it was with the mass."""
    told = verdict_on(hidden.draw_failing_case(310003, "frozen_noisy", "position", 3.0), 310003)
    assert "sensor_fault" in (told.label, *told.alike) and told.probability < 0.95


def travelled(seed: int, rate_hz: float, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and a mass that goes 0.2 m within a second between two rests."""
    t = np.arange(0.0, 2.0, 1.0 / rate_hz)
    return t, 0.2 * np.clip(t - 0.5, 0.0, 1.0) + np.random.default_rng(seed).normal(0.0, noise_m, t.size)


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0, 4800.0])
@pytest.mark.parametrize("change", [lambda x: 1.5 * x, lambda x: x - 0.08, lambda x: 0.0 * x, lambda x: -x])
def test_a_position_that_jumps_farther_than_the_mass_can_go_is_found(rate_hz: float, change) -> None:
    t, x = travelled(11, rate_hz, 1e-5)
    k = t.size // 2
    assert jump_in(t, np.where(t > t[k], change(x), x), 0.0, 1e-5, 0.3) == k


def test_what_spikes_holds_gaps_and_turns_do_is_no_jump() -> None:
    t, x = travelled(12, 1000.0, 1e-5)
    spiked = x.copy()
    spiked[900:902] += 0.1
    held = np.repeat(x[::50], 50)
    gone = (t < 0.7) | (t > 1.2)
    assert jump_in(t, x, 0.0, 1e-5, 0.3) is None
    assert jump_in(t, spiked, 0.0, 1e-5, 0.3) is None
    assert jump_in(t, held, 0.05, 1e-5, 0.3) is None
    assert jump_in(t[gone], x[gone], 0.0, 1e-5, 0.3) is None
    assert jump_in(t, np.round(x / 0.02) * 0.02, 0.0, 0.02, 0.3) is None  # in steps
    assert jump_in(t, np.mod(x, 0.04), 0.0, 1e-5, 0.3) is None  # starts anew with each turn
    assert jump_in(t, 1e3 * x, 0.0, 1e-2, 0.3) is None  # in mm: whoever wrote the rig file thinks in m
    assert jump_in(t[:4], x[:4], 0.0, 1e-5, 0.3) is None


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("seed", [840006, 846001, 846002])
@pytest.mark.parametrize("gain", [1.3, 0.5])
def test_a_gain_of_the_position_far_from_its_zero_is_no_lost_coupling(seed: int, gain: float) -> None:
    """One of 1.3 was, for sure, where the mass had gone 0.2 m of its travel."""
    actuator = hidden.draw_actuator(seed, "current")
    rig = rigs_study._learned(actuator)
    spec = hidden.fault_spec(actuator, "sensor_fault", seed)
    fault = hidden.Fault("sensor_fault", spec.fault.onset_s, "gain", "position", gain)
    frame, truth = hidden.actuator_log(actuator, replace(spec, fault=fault), seed + 1)
    isolation = diagnose_log(rigs_study._read(frame, rig), rig, Settings()).isolation
    assert isolation is not None
    verdict = isolation.verdict
    assert (verdict.label, verdict.channel) == ("sensor_fault", "position")
    assert verdict.onset_s == pytest.approx(truth["onset_s"], abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kept", [1.0, 0.97])
@pytest.mark.parametrize("sigmas", [0.0, 1.5])
@pytest.mark.parametrize("share", [0.3, 0.7])
@pytest.mark.parametrize("seed", [864230, 864231, 864232])
@pytest.mark.first(4)
def test_a_position_that_stands_to_the_last_digit_is_its_sensor_where_it_alone_tells_the_motion(
    seed: int, share: float, sigmas: float, kept: float
) -> None:
    """To such a rig the mass rests from there on: it was told as no fault, for sure, as no command, or as a lost coupling too."""
    actuator = hidden.draw_actuator(seed, "current")
    rig = rigs_study._learned(actuator)
    spec = hidden.healthy_spec(actuator)
    frame, _ = hidden.actuator_log(actuator, spec, seed + 1)
    moving = np.flatnonzero(np.abs(hidden.true_motion(spec).speed) > 0.0)
    first = int(moving[0] + share * (moving[-1] - moving[0]))
    step, x = sigmas * actuator.logger.position_noise_m, frame["position_m"].to_numpy()
    x = np.round(x / step) * step if step else x
    frame["position_m"] = np.where(np.arange(x.size) < first, x, x[first])
    rows = np.sort(np.random.default_rng(seed).permutation(len(frame))[: round(kept * len(frame))])
    onset = float(frame["time_s"][first])
    isolation = diagnose_log(
        rigs_study._read(frame.iloc[rows].reset_index(drop=True), rig), rig, Settings()
    ).isolation
    assert isolation is not None
    verdict = isolation.verdict
    assert (verdict.label, verdict.channel, verdict.alike) == ("sensor_fault", "position", ())
    assert verdict.onset_s == pytest.approx(onset, abs=0.02)
