"""Filters before readings, against digital filters of another kind than the one that is taken out, and readings without them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hidden import Fault, draw_move_case, make_log, make_log_with
from logged_signals import RATE, signal
from scipy.signal import butter, lfilter, lfilter_zi

from observer_fi.logs.ingest import log_from_frame
from observer_fi.logs.logger.low_pass import LowPasses
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Log
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.logger.as_logged import AsLogged

RIG, SETTINGS = load_rig(), BankSettings()
NOISE = (0.01, 3e-4, 1e-5)
NONE = LowPasses()


def filtered(
    seed: int, label: str, channels: tuple[int, ...], hz: float, order: int, noisy: bool = False
) -> Log:
    """A move whose channels went through a Butterworth filter; noisy: with the sensors' noise behind it once more."""
    log = log_from_frame(make_log(draw_move_case(seed, label), seed)[0])
    b, a = butter(order, hz, fs=RATE)
    z, rng = log.z.copy(), np.random.default_rng(seed)
    for c in channels:
        z[:, c] = lfilter(b, a, z[:, c], zi=lfilter_zi(b, a) * z[0, c])[0]
        z[:, c] += rng.normal(0.0, NOISE[c], len(z)) * noisy
    return replace(log, z=z)


def found(log: Log) -> LowPasses:
    return AsLogged(log, RIG, SETTINGS).low_passes


def failing(fault: Fault, seed: int, after_s: float) -> Log:
    """A move through an ideal logger, with a fault so long after its start."""
    spec = draw_move_case(seed, "nominal")
    begins = replace(fault, onset_s=spec.profile.moves[0].start_s + after_s)
    return log_from_frame(make_log(replace(spec, fault=begins), seed)[0])


# --- what is found -------------------------------------------------------------------------------

CASES = [
    ((1,), 60.0, 1, False),
    ((1,), 30.0, 2, False),
    ((1,), 30.0, 1, True),
    ((1,), 10.0, 2, False),
    ((0, 1), 60.0, 1, False),
    ((0, 1, 2), 30.0, 1, False),
]


@pytest.mark.slow
@pytest.mark.parametrize("channels, hz, order, noisy", CASES)
@pytest.mark.first(1)
def test_the_filter_before_a_current_is_found(
    channels: tuple[int, ...], hz: float, order: int, noisy: bool
) -> None:
    told = found(filtered(7700 + int(hz), "nominal", channels, hz, order, noisy))
    assert [c for c, own in enumerate(told) if math.isfinite(own.corner_hz)] == list(channels)
    assert all(told[c].order == order and told[c].corner_hz == pytest.approx(hz, rel=0.05) for c in channels)


def test_an_ideal_logger_has_none() -> None:
    for k, label in enumerate(("nominal", "overload", "coupling_loss")):
        assert found(log_from_frame(make_log(draw_move_case(7720 + k, label), 7720 + k)[0])) == NONE


@pytest.mark.slow
def test_a_fast_filter_before_coarse_readings_shows_by_the_colour_of_the_others() -> None:
    """Steps of the current of three standard deviations hide its noise; the start alone is explained without a filter."""
    corners = [
        through("low_pass+csv_3_decimals+jitter", seed).current.corner_hz for seed in range(7450, 7458)
    ]
    found_ones = [hz for hz in corners if math.isfinite(hz)]
    assert len(found_ones) >= 5, corners
    assert found_ones == pytest.approx([400.0] * len(found_ones), rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("trait", ["coloured", "coloured+csv_3_decimals", "wandering+steps_3_all"])
@pytest.mark.first(1)
def test_coloured_noise_alone_is_no_filter(trait: str) -> None:
    assert [through(trait, seed) for seed in range(7440, 7446)] == [NONE] * 6


def through(trait: str, seed: int) -> LowPasses:
    """The filters that are found behind a logger."""
    label = ("nominal", "overload", "coupling_loss")[seed % 3]
    return found(log_from_frame(make_log_with(trait, draw_move_case(seed, label), seed)[0]))


IN_THE_START = [
    (Fault("overload", 0.0), 7730, 0.02),
    (Fault("overload", 0.0), 7731, 0.1),
    (Fault("coupling_loss", 0.0), 7730, 0.02),
    (Fault("coupling_loss", 0.0), 7731, 0.1),
    (Fault("sensor_fault", 0.0, "frozen", "position"), 7730, 0.02),
    (Fault("sensor_fault", 0.0, "frozen", "current"), 7731, 0.1),
    (Fault("sensor_fault", 0.0, "bias", "current", 9e-3), 7730, 0.02),
]


@pytest.mark.parametrize(("fault", "seed", "after_s"), IN_THE_START)
@pytest.mark.first(3)
def test_a_fault_in_the_start_is_no_filter(fault: Fault, seed: int, after_s: float) -> None:
    assert found(failing(fault, seed, after_s)) == NONE


# --- what is made of it --------------------------------------------------------------------------

VERDICTS = [
    ((1,), 30.0, 2, False),
    ((1,), 30.0, 1, True),
    ((2,), 30.0, 2, False),
    ((0, 1, 2), 60.0, 2, False),
]


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("channels, hz, order, noisy", VERDICTS)
def test_verdicts_are_right_behind_a_filter(
    channels: tuple[int, ...], hz: float, order: int, noisy: bool
) -> None:
    """The current's had been sensor faults at more than 0.9999, healthy moves too."""
    for k, label in enumerate(("nominal", "overload", "coupling_loss")):
        verdict = diagnose_log(
            filtered(7750 + k, label, channels, hz, order, noisy), RIG, Settings()
        ).isolation.verdict
        assert verdict.label == label or label in verdict.alike, (7750 + k, verdict)


@pytest.mark.slow
def test_a_healthy_move_behind_a_filter_is_healthy_and_its_filter_told() -> None:
    outcome = diagnose_log(filtered(7741, "nominal", (1,), 30.0, 1), RIG, Settings())
    assert outcome.isolation.verdict.label == "nominal"
    assert outcome.acquisition is not None
    assert outcome.acquisition.current.low_pass_hz == pytest.approx(30.0, rel=0.05)
    assert any("current_a comes through a low-pass filter of" in line for line in outcome.warnings)


@pytest.mark.slow
def test_noise_and_steps_behind_a_filter_are_told_as_they_were_read() -> None:
    log = filtered(7742, "nominal", (1,), 30.0, 1, noisy=True)
    still = log.z[: int(np.flatnonzero(log.w_cmd)[0]), 1]
    known = AsLogged(log, RIG, SETTINGS)
    assert known.low_passes.any
    assert known.told.current.noise_std == pytest.approx(float(still.std()), rel=0.1)
    assert known.acquisition.current.noise_std > 2.0 * known.told.current.noise_std


@pytest.mark.slow
def test_an_ideal_log_is_taken_as_it_is() -> None:
    assert AsLogged(signal(), RIG, SETTINGS).low_passes == NONE
