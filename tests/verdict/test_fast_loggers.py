"""Verdicts on logs of many samples a second: as right as on those of fewer, of as many rows, and told of the log as it is."""

from dataclasses import replace

import hidden
import numpy as np
import pandas as pd
import pytest
from hidden.loggers import acquisition_of

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose, diagnose_log
from observer_fi.verdict.diagnosis import judged as judged_log

RIG, SETTINGS = load_rig(), Settings()
KINDS = ("nominal", "overload", "coupling_loss", "slip", "jam")
TRAITS = (
    "ideal",
    "position_100hz",
    "steps_3_all",
    "hum_50hz",
    "spikes",
    "pwm_line",
    "missing_rows",
    "no_command",
)


def logged(trait: str, rate_hz: float, kind: str, seed: int) -> pd.DataFrame:
    """A move with a fault of any size, through a logger of so many samples a second."""
    spec = hidden.draw_severity_case(seed, kind)
    logger = acquisition_of(trait, spec, seed)
    logger = replace(logger, clock=replace(logger.clock, rate_hz=rate_hz))
    return hidden.make_log_through(logger, spec, seed)[0]


def judged(trait: str, rate_hz: float, kind: str, seed: int) -> Outcome:
    return diagnose_log(log_from_frame(logged(trait, rate_hz, kind, seed)), RIG, SETTINGS)


def said(outcome: Outcome, kind: str) -> tuple[bool, float]:
    """Whether a verdict is right, or shared with what is, and its probability."""
    assert outcome.isolation is not None
    verdict = outcome.isolation.verdict
    return kind in (verdict.label, *verdict.alike), verdict.probability


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.first(2)
def test_a_fast_logger_is_judged_as_well(kind: str) -> None:
    assert said(judged("ideal", 9600.0, kind, 88_000_001), kind)[0]


@pytest.mark.parametrize("rate_hz", [4800.0, 9600.0, 48e3])
@pytest.mark.parametrize("trait", TRAITS)
@pytest.mark.slow
@pytest.mark.study
@pytest.mark.first(1)
def test_most_moves_are_right_through_any_fast_logger(rate_hz: float, trait: str) -> None:
    """None of them is wrong for sure."""
    first = 88_000_100 + int(rate_hz) + 100_000 * TRAITS.index(trait)
    found = [said(judged(trait, rate_hz, kind, first + k), kind) for k, kind in enumerate(KINDS)]
    assert sum(right for right, _ in found) >= len(KINDS) - 1
    assert all(right or probability <= 0.95 for right, probability in found)


@pytest.mark.slow
def test_a_lost_coupling_on_soft_ramps_is_no_dead_voltage() -> None:
    """At any rate the noise of a position that stands may be as fast behind the stop as before it."""
    spec = hidden.draw_severity_case(99_805_400, "coupling_loss", "soft_ramps")
    logger = acquisition_of("hum_50hz", spec, 99_805_400)
    logger = replace(logger, clock=replace(logger.clock, rate_hz=9600.0))
    frame = hidden.make_log_through(logger, spec, 99_805_400)[0]
    assert said(diagnose_log(log_from_frame(frame), RIG, SETTINGS), "coupling_loss") == (
        True,
        pytest.approx(1.0),
    )


@pytest.mark.slow
def test_the_log_and_its_logger_are_told_as_they_are(tmp_path) -> None:
    frame = logged("hum_50hz", 9600.0, "overload", 88_000_001)
    frame.to_csv(tmp_path / "fast.csv", index=False)
    in_memory = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    of_file = diagnose(tmp_path / "fast.csv", RIG, SETTINGS)
    for outcome in (in_memory, of_file):
        assert outcome.samples == len(frame)
        assert outcome.rate_hz == pytest.approx(9600.0, rel=1e-4)
        assert outcome.acquisition is not None
        assert outcome.acquisition.current.noise_std == pytest.approx(RIG.noise_std[1], rel=0.15)
        assert outcome.acquisition.current.lines[0].hz == pytest.approx(50.0, abs=0.2)
        assert outcome.log is not None
        assert any("judged as one" in note for note in outcome.log.notes)
    assert in_memory.isolation is not None and of_file.isolation is not None
    assert of_file.isolation.verdict.onset_s == pytest.approx(in_memory.isolation.verdict.onset_s, abs=2e-3)


@pytest.mark.parametrize("rate_hz", [4800.0, 9600.0, 48e3])
def test_no_more_rows_are_judged_than_of_a_usual_log(rate_hz: float) -> None:
    """Of 9600 samples a second a healthy move took forty times the processor's time of one of 1600, in searches over its rows."""
    log = log_from_frame(logged("ideal", rate_hz, "nominal", 99_802_000))
    _, estimate = judged_log(log, RIG, SETTINGS)
    rows_a_second = estimate.t.size / float(np.ptp(log.t))
    assert 1599.0 < rows_a_second < 2.0 * 1600.0
