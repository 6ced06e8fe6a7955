"""A channel that contradicts the others from a log's first motion on is left out; one that fails later, or a machine, is not."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from hidden import draw_move_case, draw_severity_case, make_log
from moves import failing, sure_of

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig, with_values
from observer_fi.records import Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.left_out import left_out, told_alone, without

RIG, SETTINGS = load_rig(), Settings()
V, A, X = "voltage_v", "current_a", "position_m"

Spoil = Callable[[pd.DataFrame], pd.DataFrame]

# What an amplifier does to the current, and a current to the voltage's leads; a position that falls with the voltage.
SPOILT: dict[str, tuple[str, Spoil]] = {
    "leak": (A, lambda f: f.assign(**{A: f[A] + 4e-3 * f[V]})),
    "curved": (A, lambda f: f.assign(**{A: f[A] * (1.0 + f[A].abs())})),
    "peaks held": (A, lambda f: f.assign(**{A: f[A].rolling(6, min_periods=1).max()})),
    "leads": (V, lambda f: f.assign(**{V: f[V] - 1.5 * f[A]})),
    "position": (X, lambda f: f.assign(**{X: f[X] - 3e-5 * f[V]})),
}


def judged(frame: pd.DataFrame) -> Outcome:
    return diagnose_log(log_from_frame(frame), RIG, SETTINGS)


def verdict_of(label: str, kind: str, seed: int) -> Outcome:
    return judged(SPOILT[kind][1](make_log(draw_move_case(seed, label), seed)[0]))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "label"), [("position", "overload")])
def test_a_fault_is_found_without_the_channel(kind: str, label: str) -> None:
    found = verdict_of(label, kind, 3320001)
    assert found.isolation is not None
    verdict = found.isolation.verdict
    assert verdict.label == label
    assert verdict.probability <= 0.95
    assert any(SPOILT[kind][0] in words and "judged without it" in words for words in found.warnings)


@pytest.mark.slow
def test_health_without_the_channel_may_be_a_sensor_that_had_failed() -> None:
    found = verdict_of("nominal", "leak", 3320006)
    assert found.isolation is not None
    verdict = found.isolation.verdict
    assert {verdict.label, *verdict.alike} == {"nominal", "sensor_fault"}
    assert verdict.probability == 0.5


def test_no_channel_of_an_ordinary_log_is_left_out() -> None:
    log = log_from_frame(make_log(draw_move_case(3320006, "nominal"), 3320006)[0])
    assert left_out(log, RIG, SETTINGS) is None
    found = diagnose_log(log, RIG, SETTINGS)
    assert found.isolation is not None
    verdict = found.isolation.verdict
    assert (verdict.label, verdict.alike, found.warnings) == ("nominal", (), ())
    assert verdict.probability > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("values", [{"Km": 0.8}, {"Rm": 2.0}, {"J": 3.0}])
@pytest.mark.first(1)
def test_a_rig_file_of_another_machine_is_not_a_channel_that_is_wrong(values: dict[str, float]) -> None:
    log = log_from_frame(make_log(draw_move_case(3320006, "nominal"), 3320006)[0])
    other = with_values(RIG, {name: share * RIG.model[name] for name, share in values.items()})
    assert left_out(log, other, SETTINGS) is None


@pytest.mark.slow
def test_a_channel_that_fails_later_stays_a_failed_sensor() -> None:
    frame, _ = make_log(draw_move_case(3320000, "nominal"), 3320000)
    late = frame["time_s"] > frame["time_s"].iloc[-1] * 0.4
    found = judged(frame.assign(**{A: frame[A] + 4e-3 * frame[V] * late}))
    assert found.isolation is not None
    verdict = found.isolation.verdict
    assert (verdict.label, verdict.channel) == ("sensor_fault", "current")
    assert verdict.probability > 0.95


def test_readings_of_a_channel_are_taken_away() -> None:
    log = log_from_frame(make_log(draw_move_case(3320006, "nominal"), 3320006)[0])
    left = without(log, 1)
    assert np.isnan(left.z[:, 1]).all()
    assert np.array_equal(left.z[:, ::2], log.z[:, ::2])
    assert np.isfinite(log.z[:, 1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3320011])
def test_a_current_that_alone_tells_a_load_leaves_no_fault_of_the_actuator(seed: int) -> None:
    """Its leak looks like friction in all of the move, of which the voltage shows nothing."""
    found = verdict_of("nominal", "leak", seed).isolation
    assert found is not None
    assert {found.verdict.label, *found.verdict.alike} == {"nominal", "sensor_fault"}
    assert found.verdict.probability == 0.5


@pytest.mark.parametrize("kind", ["jam", "jam_growing", "overload", "coupling_loss", "slip"])
def test_neither_voltage_nor_current_tells_a_fault_alone(kind: str) -> None:
    frame, truth = make_log(spec := draw_severity_case(3320021, kind), 3320021)
    log = log_from_frame(frame)
    event = sure_of(spec.fault.label, spec.fault.onset_s or 0.0, float(log.t[-1]))
    assert told_alone(log, event, RIG, SETTINGS) == (), truth


@pytest.mark.slow
def test_a_current_that_stands_in_its_noise_is_no_jam() -> None:
    """It stood where the load was: what pitch and friction change from then on looks like a friction that rose by 2 %."""
    frame, _ = make_log(failing(51015, "frozen_noisy", "current", 0.0, 0.5935), 51015)
    found = judged(frame).isolation
    assert found is not None
    verdict = found.verdict
    assert verdict.label == "nominal"
    assert verdict.alike == ("sensor_fault",)
