"""A channel that contradicts the others from a log's first motion on is left out; one that fails later, or a machine, is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hidden import Fault, TruthSpec, draw_move_case, draw_severity_case, make_log

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig, with_values
from observer_fi.records import Consistency, Event, Isolation, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.left_out import left_out, or_another, told_alone, without

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


@pytest.mark.parametrize(("kind", "label"), [("position", "overload")])
def test_a_fault_is_found_without_the_channel(kind: str, label: str) -> None:
    found = verdict_of(label, kind, 3320001)
    assert found.isolation is not None
    verdict = found.isolation.verdict
    assert verdict.label == label
    assert verdict.probability <= 0.95
    assert any(SPOILT[kind][0] in words and "judged without it" in words for words in found.warnings)


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


@pytest.mark.parametrize("values", [{"Km": 0.8}, {"Rm": 2.0}, {"J": 3.0}])
def test_a_rig_file_of_another_machine_is_not_a_channel_that_is_wrong(values: dict[str, float]) -> None:
    log = log_from_frame(make_log(draw_move_case(3320006, "nominal"), 3320006)[0])
    other = with_values(RIG, {name: share * RIG.model[name] for name, share in values.items()})
    assert left_out(log, other, SETTINGS) is None


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


def verdict_on(frame: pd.DataFrame) -> Event:
    found = judged(frame).isolation
    assert found is not None
    return found.verdict


def failing(seed: int, kind: str, channel: str, size: float, onset_s: float) -> TruthSpec:
    fault = Fault("sensor_fault", onset_s, kind, channel, size)
    return replace(draw_move_case(seed, "nominal"), fault=fault)


def sure_of(label: str, onset_s: float, end_s: float) -> Event:
    return Event(label, None, 1.0, onset_s, (onset_s, onset_s), onset_s, onset_s, 0.3, end_s, {label: 1.0})


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


def test_a_current_that_stands_in_its_noise_is_no_jam() -> None:
    """It stood where the load was: what pitch and friction change from then on looks like a friction that rose by 2 %."""
    frame, _ = make_log(failing(51015, "frozen_noisy", "current", 0.0, 0.5935), 51015)
    verdict = verdict_on(frame)
    assert verdict.label == "nominal"
    assert verdict.alike == ("sensor_fault",)


@pytest.mark.parametrize(
    ("truth", "label", "other"),
    [("nominal", "coupling_loss", "sensor_fault"), ("overload", "slip", "overload"), ("slip", "slip", None)],
)
@pytest.mark.parametrize("seed", [3320032, 3320034])
def test_what_the_position_tells_alone_is_told_with_what_the_motor_says(
    truth: str, label: str, other: str | None, seed: int
) -> None:
    """A lost coupling of which the motor feels nothing, and a slip under a load that came, are as well something else."""
    spec = draw_move_case(seed, truth)
    log = log_from_frame(make_log(replace(spec, rig=replace(spec.rig, C=10.0 * spec.rig.C)), seed)[0])
    wrong = sure_of(label, spec.fault.onset_s or 1.0, float(log.t[-1]))
    found = Isolation(wrong, (wrong,), Consistency(3.0, 3.0, 0.5))
    told = or_another(Outcome("log", None, isolation=found), lambda: log, RIG, SETTINGS).isolation
    assert told is not None
    expected = (1.0, ()) if other is None else (0.5, (other,))
    assert (told.verdict.probability, told.verdict.alike) == expected
    assert told.events == (told.verdict,)


@pytest.mark.parametrize(("channel", "probability"), [("voltage", 0.5), ("current", 1.0)])
def test_of_voltage_and_current_the_one_that_is_wrong_is_not_cleared(
    channel: str, probability: float
) -> None:
    for seed in (3320051, 3320052):
        frame, _ = make_log(failing(seed, "gain", "current", 1.5, 0.9), seed)
        log = log_from_frame(frame)
        said = sure_of("sensor_fault", 0.9, float(log.t[-1]))._replace(channel=channel)
        found = Isolation(said, (said,), Consistency(3.0, 3.0, 0.5))
        told = or_another(Outcome("log", None, isolation=found), lambda log=log: log, RIG, SETTINGS).isolation
        assert told is not None
        assert told.verdict.probability == probability


def test_a_fault_without_a_name_may_be_of_a_recovered_command() -> None:
    frame, _ = make_log(draw_move_case(3330102, "nominal"), 3330102)
    drifting = frame.assign(**{V: frame[V] + 0.24 * frame["time_s"]}).drop(columns="speed_cmd_rad_s")
    assert verdict_on(drifting).probability <= 0.95


@pytest.mark.parametrize("seed", [5920000, 5920003])
def test_a_sensor_that_fails_before_the_actuator_does_not_hide_that(seed: int) -> None:
    """The position is read 25 times a second from shortly before an obstacle on: voltage and current feel that all the same."""
    frame, truth = make_log(draw_move_case(seed, "overload"), seed)
    rows, first = np.arange(len(frame)), int(np.searchsorted(frame["time_s"], truth["onset_s"] - 0.15))
    held = np.where(rows < first, rows, rows // 64 * 64)
    verdict = verdict_on(frame.assign(**{X: frame[X].to_numpy()[held]}))
    assert (verdict.label, verdict.probability) == ("sensor_fault", 0.5)
    assert "overload" in verdict.alike


def test_a_sensor_that_fails_alone_is_sure_to() -> None:
    frame, _ = make_log(failing(5920004, "bias", "position", 3e-4, 0.9), 5920004)
    verdict = verdict_on(frame)
    assert (verdict.label, verdict.channel, verdict.alike) == ("sensor_fault", "position", ())
    assert verdict.probability > 0.95
