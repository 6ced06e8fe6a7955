"""A stream learns its logger as it goes: at the first rest, and at the first start, with the verdict of the whole log."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hidden import (
    draw_effects_case,
    draw_move_case,
    draw_severity_case,
    make_log,
    make_log_with,
    there_and_back,
)
from scipy.signal import butter, lfilter, lfilter_zi

from observer_fi.bank import compiled_bank as kernels
from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import Event, Log
from observer_fi.serve.live import BACK, BACK_S, MOVE_ROWS, REST_ROWS, START_S, STOP_S, Lesson, Live
from observer_fi.settings import Settings
from observer_fi.verdict import isolate
from observer_fi.verdict.diagnosis import Diagnosis

RIG, SETTINGS = load_rig(), Settings()
BATCHES = (1, 64, 1000)
LABELS = ("nominal", "overload", "coupling_loss")


def table_of(log: Log) -> np.ndarray:
    return np.column_stack((log.t, log.z, log.pitch, log.w_cmd))


@cache
def through(name: str, label: str, seed: int) -> Log:
    return log_from_frame(make_log_with(name, draw_move_case(seed, label), seed)[0])


def streamed(log: Log, batch: int = 64) -> tuple[Live, list[tuple[float, str]]]:
    """A stream at its end, and the changes of verdict it told."""
    live, table, told = Live(RIG, SETTINGS), table_of(log), []
    for k in range(0, len(table), batch):
        for _, changes in live.add(table[k : k + batch]):
            told += [(change.time_s, change.event.label) for change in changes]
    for _, changes in live.finish():
        told += [(change.time_s, change.event.label) for change in changes]
    return live, told


def of_the_bank(log: Log) -> Event:
    """The verdict of the bank on a whole log, before the last word on its move."""
    run = Diagnosis(RIG, SETTINGS)
    run.add(log)
    return run.isolator.result().verdict


def what(event: Event) -> tuple[str, str | None]:
    return event.label, event.channel


THROUGH = (
    "noise_3",
    "steps_all",
    "position_100hz",
    "hum_50hz",
    "voltage_late",
    "offsets",
    "position_averaged",
    "wandering",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "label"), [(name, LABELS[(k + j) % 3]) for k, name in enumerate(THROUGH) for j in range(2)]
)
@pytest.mark.first(2)
def test_a_stream_ends_in_the_verdict_of_the_whole_log(name: str, label: str) -> None:
    log = through(name, label, 7610)
    assert what(streamed(log)[0].verdict()) == what(of_the_bank(log))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["position_100hz", "voltage_late+offsets", "hum_50hz"])
@pytest.mark.first(1)
def test_the_size_of_batches_does_not_matter(name: str) -> None:
    log = through(name, "coupling_loss", 7611)
    ends = [streamed(log, batch) for batch in BATCHES]
    assert len({what(live.verdict()) for live, _ in ends}) == 1
    assert len({live.samples for live, _ in ends}) == 1 and ends[0][0].samples == log.t.size
    first = ends[0][1]
    assert all(told == first for _, told in ends[1:])
    assert all(live.as_logged.late == ends[0][0].as_logged.late for live, _ in ends if live.as_logged)


@pytest.mark.parametrize("kind", ["none", "coupling_loss"])
def test_an_ideal_stream_is_what_it_was(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit the bank of the rig file, made once."""
    fault = Fault() if kind == "none" else Fault(kind, 1.4)
    log = synthesise(
        Scenario((Move(0.2, 410.0, 0.6), Move(1.1, -300.0, 0.6)), 2.0, fault=fault, seed=3), RIG
    )[0]
    made = []
    make = Live._make_bank
    monkeypatch.setattr(Live, "_make_bank", lambda self, *given: made.append(1) or make(self, *given))
    live = Live(RIG, SETTINGS)
    found = np.concatenate([e.probability.copy() for e, _ in live.add(table_of(log))])
    whole = isolate.tested(kernels.Bank(RIG, SETTINGS.bank).advance(log), SETTINGS.decision)
    np.testing.assert_allclose(found, whole.probability, rtol=0.0, atol=1e-11)  # as `test_watch.py`
    assert len(made) == 1 and live.as_logged is None and live.lesson is None


@pytest.mark.slow
def test_what_a_move_said_before_the_start_was_known_is_not_counted_twice() -> None:
    live, _ = streamed(through("voltage_late", "overload", 7612))
    assert (live.moves, live.samples) == (1, through("voltage_late", "overload", 7612).t.size)


# --- lessons -------------------------------------------------------------------------------------


def rows(n: int, moving_from: int, first: int = 0) -> np.ndarray:
    k = np.arange(first, first + n)
    table = np.zeros((n, 6))
    table[:, 0] = k / 1600.0
    table[:, 5] = np.where(k >= moving_from, 100.0, 0.0)
    return table


def test_a_rest_is_learned_up_to_its_move_and_then_the_start() -> None:
    lesson = Lesson()
    assert lesson.take(rows(300, 500)) == 300 and not lesson.complete
    assert lesson.take(rows(400, 500, 300)) == 200 and lesson.complete
    assert len(lesson.table) == 500 and not lesson.table[:, 5].any()
    start = lesson.next_one(None, pitch=True)
    assert start is not None and start.until == pytest.approx(499 / 1600.0 + START_S)
    assert start.take(rows(2000, 0, 500)) == round(START_S * 1600) and start.complete
    assert start.next_one(None, pitch=True) is None


def test_of_a_stream_without_a_pitch_all_is_kept_up_to_a_motion_the_other_way() -> None:
    start = Lesson(rows(500, 500), "start")
    start.take(rows(2000, 0, 500))
    back = start.next_one(None, pitch=False)
    assert back is not None and back.shows == BACK and back.way == 1.0
    assert back.take(rows(2000, 0, 916)) == 2000 and not back.complete
    other = rows(2000, 0, 2916)
    other[500:, 5] *= -1.0
    assert back.take(other) == 501 + round(BACK_S * 1600) and back.complete
    assert back.next_one(None, pitch=False) is None


def test_a_long_rest_is_kept_in_part_and_a_short_one_tells_nothing() -> None:
    lesson = Lesson()
    for k in range(10):
        lesson.take(rows(1000, 10**6, 1000 * k))
    assert len(lesson.table) == REST_ROWS and lesson.table[-1, 0] == pytest.approx(9999 / 1600.0)
    short = Lesson()
    short.take(rows(200, 20))
    assert (
        short.complete
        and short.learned(RIG, SETTINGS.bank) is None
        and short.next_one(None, pitch=True) is None
    )


def test_a_stream_that_begins_in_motion_learns_nothing_and_goes_on() -> None:
    log = through("ideal", "overload", 7610)
    moving = int(np.flatnonzero(log.w_cmd)[0]) + 300
    live = Live(RIG, SETTINGS)
    for _ in live.add(table_of(log)[moving:]):
        pass
    assert live.lesson is None and live.as_logged is None and live.samples == log.t.size - moving


def behind_a_filter(label: str) -> Log:
    """A move whose current comes through a filter of 30 Hz."""
    log = through("ideal", label, 7612)
    b, a = butter(1, 30.0, fs=log.rate_hz)
    z = log.z.copy()
    z[:, 1] = lfilter(b, a, z[:, 1], zi=lfilter_zi(b, a) * z[0, 1])[0]
    return replace(log, z=z)


@pytest.mark.slow
@pytest.mark.parametrize("label", ["nominal", "coupling_loss"])
@pytest.mark.first(1)
def test_a_filter_before_the_current_is_no_fault(label: str) -> None:
    """Six changes of verdict in the first 90 ms, all faults, and a sensor fault at the end of a healthy move: now none."""
    live, told = streamed(behind_a_filter(label))
    assert live.verdict().label == label
    assert {what for _, what in told} == {"nominal", label}


@pytest.mark.slow
def test_a_stream_that_ends_in_its_first_start_says_what_it_knows() -> None:
    log = behind_a_filter("nominal")
    start = float(log.t[np.flatnonzero(log.w_cmd)[0]])
    live, told = streamed(log.part(slice(0, int(np.searchsorted(log.t, start + 0.24)))))
    assert live.lesson is None and all(what == "nominal" for _, what in told)


@pytest.mark.parametrize("batch", [1, 7, 5000])
def test_a_start_beside_an_offset_is_learned_to_its_stop(batch: int) -> None:
    start = Lesson(rows(500, 500), "start")
    start.take(rows(416, 0, 500))
    assert start.next_one(SimpleNamespace(offset=0.0), pitch=True) is None
    stop = start.next_one(SimpleNamespace(offset=0.03), pitch=True)
    assert stop is not None and stop.shows == "stop"
    way = rows(3000, 0, 916)
    way[1500:, 5] = 0.0
    taken = 0
    while not stop.complete:
        taken += stop.take(way[taken : taken + batch])
    assert taken == pytest.approx(1500 + STOP_S * 1600, abs=1) and len(stop.table) == 916 + taken
    assert stop.next_one(SimpleNamespace(offset=0.03), pitch=True) is None


def test_a_move_without_end_is_not_kept() -> None:
    stop = Lesson(rows(500, 100), "stop")
    while not stop.too_long:
        stop.take(rows(5000, 0, 500))
    assert len(stop.table) < MOVE_ROWS + 5001 and not stop.complete


@pytest.mark.slow
@pytest.mark.parametrize("batch", [64, 4096])
@pytest.mark.first(1)
def test_a_stream_with_two_zero_offsets_stays_healthy(batch: int) -> None:
    """From the first stop on it knows both; moves at other speeds and pitches had been faults."""
    for seed in (8400, 8401):
        spec = draw_effects_case(seed, (), 0.0)
        profile = there_and_back((410.0, 200.0), (0.5, 0.5), (0.0, 5.0))
        log = log_from_frame(make_log(replace(spec, profile=profile), seed)[0])
        log = replace(log, z=log.z + np.array([0.03, -2e-3, 0.0]))
        live, told = streamed(log, batch)
        assert live.as_logged is not None and live.as_logged.zero == pytest.approx(-2e-3, rel=0.2), seed
        assert live.verdict().label == "nominal" and live.faulty == 0, seed
        assert live.samples == log.t.size, seed


@cache
def begun_in_a_start(seed: int, begin_s: float, label: str = "nominal") -> Log:
    """Moves there and back through an ideal logger, from a while after the first one began."""
    profile = there_and_back((410.0, 200.0), (0.4, 0.4), (0.0, 5.0))
    spec = replace(draw_effects_case(seed, (), 0.0), profile=profile)
    log = log_from_frame(make_log(spec, seed)[0])
    return log.part(slice(int(np.searchsorted(log.t, profile.moves[0].start_s + begin_s)), None))


@pytest.mark.parametrize("begin_s", [0.012, 0.03, 0.1])
def test_a_stream_that_begins_at_the_limit_of_the_supply_is_healthy(begin_s: float) -> None:
    """Filters that began there took the integral that they do not know for half the inertia."""
    for seed in (8200, 8201, 8202):
        log = begun_in_a_start(seed, begin_s)
        live, told = streamed(log)
        assert {label for _, label in told} == {"nominal"} and live.verdict().label == "nominal", (seed, told)
        assert live.samples == log.t.size


@pytest.mark.parametrize("batch", [1, 7, 1000])
def test_what_is_left_out_does_not_depend_on_batches(batch: int) -> None:
    log = begun_in_a_start(8203, 0.02)
    assert streamed(log, batch)[1] == streamed(log)[1]


def test_a_stream_that_ends_at_the_limit_says_nothing_of_it() -> None:
    log = begun_in_a_start(8204, 0.012)
    live, told = streamed(log.part(slice(0, 12)), 1)
    assert told == [] and live.samples == 12


# --- without a pitch -----------------------------------------------------------------------------


def told_without_pitch(
    seed: int, label: str, shape: str, batch: int = 64
) -> tuple[Event, list[tuple[float, Event]]]:
    """The verdict at the end of a stream without a pitch, and what was told before."""
    log = log_from_frame(make_log(draw_severity_case(seed, label, shape), seed)[0])
    table, live, told = table_of(replace(log, pitch=np.zeros(log.t.size))), Live(RIG, SETTINGS), []
    live.without_pitch = RIG
    for k in range(0, len(table), batch):
        for _, changes in live.add(table[k : k + batch]):
            told += [(change.time_s, change.event) for change in changes]
    for _, changes in live.finish():
        told += [(change.time_s, change.event) for change in changes]
    return live.verdict(), told


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(99_760_100, 99_760_103))
def test_a_healthy_reversal_without_a_pitch_is_healthy(seed: int) -> None:
    """They ended as jams for sure: a pitch taken as 0 is a friction that is more one way and less the other."""
    verdict, told = told_without_pitch(seed, "nominal", "without_rests")
    assert verdict.label == "nominal"
    assert not [e for _, e in told if e.label in ("unknown", "jam") and e.probability > 0.95]


@pytest.mark.slow
@pytest.mark.parametrize("label", ["overload", pytest.param("coupling_loss", marks=pytest.mark.slow)])
@pytest.mark.first(1)
def test_a_fault_is_told_without_a_pitch_or_not_for_sure_another(label: str) -> None:
    verdict, _ = told_without_pitch(99_760_102, label, "without_rests")
    assert verdict.label == label or verdict.probability <= 0.5
    assert told_without_pitch(99_760_102, label, "")[0].label == label


@pytest.mark.slow
def test_what_is_told_without_a_pitch_does_not_depend_on_batches() -> None:
    said = [told_without_pitch(99_760_102, "jam", "without_rests", batch) for batch in (1, 64, 1000)]
    told = [[(time, *what(event)) for time, event in changes] for _, changes in said]
    assert told[0] == told[1] == told[2]
    assert len({what(verdict) for verdict, _ in said}) == 1
