"""A stream comes back from `unknown`: the whole move says what it was, at the same sample however the samples came."""

from functools import cache

import hidden
import numpy as np
import pytest

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.serve.live import Live
from observer_fi.serve.stream_word import ANSWER_S, ASK_S
from observer_fi.settings import Settings

RIG, MOVE = load_rig(), hidden.single_move(speed=410.0, hold_s=3.2, pitch_deg=4.0)


@cache
def streamed(
    fault: hidden.Fault, batch: int, profile: hidden.Profile = MOVE
) -> tuple[Live, list[tuple[float, str]]]:
    """A stream at its end, and what it told when."""
    return streamed_truth(hidden.TruthSpec(profile, hidden.TABLE_1, fault, start_integral_rad=0.02), 3, batch)


def streamed_truth(truth: hidden.TruthSpec, seed: int, batch: int) -> tuple[Live, list[tuple[float, str]]]:
    """A stream of a log at its end, and what it told when."""
    log = log_from_frame(hidden.make_log(truth, seed)[0])
    table = np.column_stack((log.t, log.z, log.pitch, log.w_cmd))
    live, told = Live(RIG, Settings()), []
    for k in range(0, len(table), batch):
        for _, changes in live.add(table[k : k + batch]):
            told += [(change.time_s, change.event.label) for change in changes]
    for _, changes in live.finish():
        told += [(change.time_s, change.event.label) for change in changes]
    return live, told


JAM = hidden.Fault("jam", 1.5, size=1.0)


def test_a_jam_has_its_name_while_the_motor_still_turns() -> None:
    live, told = streamed(JAM, 64)
    verdict = live.verdict()
    assert verdict.label == "jam" and verdict.onset_s == pytest.approx(1.5, abs=0.02)
    unknown = next(t for t, label in told if label == "unknown")
    named = next(t for t, label in told if label == "jam")
    assert named == pytest.approx(unknown + ASK_S + ANSWER_S, abs=0.01)
    assert named < MOVE.moves[0].brake_s


def test_it_is_told_at_the_same_sample_whatever_the_batches() -> None:
    assert streamed(JAM, 64)[1] == streamed(JAM, 1000)[1]


@pytest.mark.slow
def test_a_coupling_that_let_go_for_a_while_is_no_all_clear_of_a_stream() -> None:
    live, told = streamed(hidden.Fault("coupling_loss", 1.7, duration_s=0.3), 64)
    verdict = live.verdict()
    assert verdict.label == told[-1][1] == "coupling_loss"
    assert verdict.over_s == pytest.approx(2.0, abs=0.02)


def test_what_is_asked_of_a_move_is_told_before_the_next_one() -> None:
    there_and_back = hidden.there_and_back((410.0,), (2.0,), (0.0,))
    live, told = streamed(hidden.Fault("coupling_loss", 1.2, duration_s=0.3), 64, there_and_back)
    begins = there_and_back.moves[1].start_s
    assert ("coupling_loss", True) in [(label, t <= begins + 0.01) for t, label in told if t > 2.2]
    assert live.verdict().label == told[-1][1] == "nominal" and live.faulty == 1


def test_a_healthy_stream_is_asked_nothing() -> None:
    assert [label for _, label in streamed(hidden.NO_FAULT, 64)[1]] == ["nominal"]


@pytest.mark.slow
def test_a_fault_long_before_the_end_of_its_move_is_asked_about_while_it_is_remembered() -> None:
    long = hidden.single_move(speed=205.0, hold_s=14.0, pitch_deg=4.0)
    live, told = streamed(hidden.Fault("coupling_loss", 1.7, duration_s=0.3), 256, long)
    assert live.verdict().label == told[-1][1] == "coupling_loss"
    assert told[-1][0] < long.moves[0].brake_s


@pytest.mark.slow
def test_a_slip_is_told_from_a_sensor_by_the_rest_after_the_move() -> None:
    live, told = streamed(hidden.Fault("slip", 1.5, size=0.3), 64)
    assert live.verdict().label == told[-1][1] == "slip"
    assert live.verdict().probability > 0.95 and not live.verdict().alike


@pytest.mark.first(1)
@pytest.mark.parametrize(("seed", "kind"), [(92007, "coupling_for_a_while"), (92010, "slip_growing")])
def test_what_the_bank_forgot_as_the_move_ended_is_no_all_clear(seed: int, kind: str) -> None:
    """One lost its name and was healthy again before the answer came, one was an overload for 40 ms before the stop."""
    truth = hidden.draw_severity_case(seed, kind)
    live, told = streamed_truth(truth, seed, 64)
    assert live.verdict().label == told[-1][1] == truth.fault.label
