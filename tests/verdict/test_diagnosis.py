"""A log in, a verdict out: on every spoilt log, whole and in chunks, at two rates, with and without what may be missing."""

import tracemalloc
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hidden import Fault, TruthSpec, campaign, draw_move_case, make_log, rich_campaign, single_move, write_log
from moves import move
from scenarios import SCENARIOS, Scenario

from observer_fi.bank import Bank
from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import load_columns
from observer_fi.logs.ingest import log_from_frame, read_log
from observer_fi.physics.faults import LABELS
from observer_fi.physics.rigs import Rig, load_rig
from observer_fi.records import Consistency, Event, Isolation, Log, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import explain
from observer_fi.verdict.diagnosis import Diagnosis, diagnose, diagnose_log
from observer_fi.verdict.last_word import LastWord

RIG = load_rig()
SETTINGS = Settings()
FAULTS = ("nominal", "overload", "coupling_loss")


def event_of(outcome: Outcome) -> Event:
    assert outcome.isolation is not None
    return outcome.isolation.verdict


def frame_of(seed: int, label: str) -> tuple[pd.DataFrame, dict]:
    return make_log(draw_move_case(seed, label), seed)


def part_of(log: Log, first: int, last: int) -> Log:
    part = slice(first, last)
    return replace(log, t=log.t[part], z=log.z[part], w_cmd=log.w_cmd[part], pitch=log.pitch[part])


def alike(one: Outcome, two: Outcome) -> None:
    """The same verdicts at the same times; numbers to the rounding of compiled loops."""
    assert one.isolation is not None and two.isolation is not None
    names = ("label", "channel", "detected_s", "isolated_s", "start_s", "end_s", "reasons")
    for a, b in zip(one.isolation.events, two.isolation.events, strict=True):
        assert [getattr(a, name) for name in names] == [getattr(b, name) for name in names]
        assert a.posterior == pytest.approx(b.posterior, rel=1e-9)
    np.testing.assert_allclose(one.isolation.consistency, two.isolation.consistency, rtol=1e-9)


# --- scenarios -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s.name)
@pytest.mark.first(12)
def test_every_scenario_gets_its_verdict_or_its_one_line(scenario: Scenario, tmp_path: Path) -> None:
    path = scenario.write(tmp_path)
    column_map = scenario.column_map(tmp_path)
    columns = load_columns(column_map) if column_map else None
    if scenario.error:
        with pytest.raises(InvalidLogError, match=scenario.error):
            diagnose(path, RIG, SETTINGS, columns=columns)
        return
    outcome = diagnose(path, RIG, SETTINGS, columns=columns)
    v = event_of(outcome)
    assert v.label in (*LABELS, "not_tested")
    assert sum(v.posterior.values()) == pytest.approx(float(v.label in LABELS))
    assert outcome.log is not None and len(outcome.log.sha256) == 64
    if scenario.label is not None:
        assert v.label == scenario.label
    for note in scenario.notes:
        assert any(note in given for given in outcome.log.notes), outcome.log.notes
    assert len(outcome.log.gaps) == scenario.gaps
    assert outcome.log.rejected_count >= scenario.rejected
    if scenario.samples is not None and not scenario.rejected:
        assert outcome.samples == scenario.samples


def test_a_stuck_position_sensor_is_named(tmp_path: Path) -> None:
    stuck = next(s for s in SCENARIOS if s.name == "stuck sensor")
    v = event_of(diagnose(stuck.write(tmp_path), RIG, SETTINGS))
    assert (v.label, v.channel) == ("sensor_fault", "position")


# --- one log, many ways --------------------------------------------------------------------------


@pytest.mark.parametrize("label", FAULTS)
@pytest.mark.first(1)
def test_a_file_and_a_log_in_memory_end_alike(label: str, tmp_path: Path) -> None:
    frame, truth = frame_of(3, label)
    path = write_log(frame, tmp_path / "move.csv.gz")
    from_file, in_memory = diagnose(path, RIG, SETTINGS), diagnose_log(read_log(path), RIG, SETTINGS)
    alike(from_file, in_memory)
    assert from_file.explanation == in_memory.explanation
    assert (from_file.samples, from_file.rate_hz) == (in_memory.samples, in_memory.rate_hz)
    v = event_of(from_file)
    assert v.label == truth["label"]
    if label == "nominal":
        assert (v.onset_s, from_file.open_loop) == (None, None)
    else:
        assert v.onset_s == pytest.approx(truth["onset_s"], abs=0.02) and from_file.open_loop is not None
        assert truth["onset_s"] < v.detected_s <= v.isolated_s


@pytest.mark.parametrize("rows", [173, 1000])
@pytest.mark.parametrize("label", FAULTS)
@pytest.mark.first(2)
def test_chunks_end_in_the_same_verdict(label: str, rows: int) -> None:
    frame, _ = frame_of(4, label)
    log = log_from_frame(frame)
    whole = diagnose_log(log, RIG, SETTINGS)
    run = Diagnosis(RIG, SETTINGS)
    for first in range(0, log.t.size, rows):
        run.add(part_of(log, first, first + rows))
    chunked = run.outcome("move", {})
    one, two = event_of(whole), event_of(chunked)
    alike(whole, chunked)
    if label != "nominal":
        assert two.onset_s == pytest.approx(one.onset_s, abs=1e-3)  # the window begins at another snapshot


def test_a_move_is_asked_only_while_its_samples_are_at_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every move of a log was asked again with every chunk that came."""
    asked: Counter[float] = Counter()
    given = LastWord.doubting

    def doubting(word: LastWord, event: Event, bank: Bank) -> Event:
        asked[event.start_s] += 1
        return given(word, event, bank)

    monkeypatch.setattr(LastWord, "doubting", doubting)
    log = log_from_frame(make_log(TruthSpec(rich_campaign()), 5)[0])
    run = Diagnosis(RIG, SETTINGS)
    rows = round(log.rate_hz)
    for first in range(0, log.t.size, rows):
        run.add(part_of(log, first, first + rows))
    assert len(asked) > 8 and log.t.size / rows > 20
    assert max(list(asked.values())[:4]) < 12  # a second each, of which some are kept


@pytest.mark.slow
@pytest.mark.parametrize("label", FAULTS)
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.first(2)
def test_four_hundred_samples_a_second_say_the_same(label: str, seed: int) -> None:
    """Rates are per second and steps are kept short: the posterior at 400 Hz agrees with that at 1600 Hz."""
    spec = draw_move_case(seed, label)
    fast = diagnose_log(log_from_frame(make_log(spec, seed)[0]), RIG, SETTINGS)
    slow_spec = replace(spec, logger=replace(spec.logger, rate_hz=400.0))
    slow = diagnose_log(log_from_frame(make_log(slow_spec, seed)[0]), RIG, SETTINGS)
    one, two = event_of(fast), event_of(slow)
    assert one.label == two.label == label
    assert two.probability == pytest.approx(one.probability, abs=0.01)
    if label != "nominal":
        assert two.isolated_s - one.isolated_s < 0.08  # a quarter of the samples
        assert two.onset_s == pytest.approx(one.onset_s, abs=0.02)


@pytest.mark.first(1)
@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_engines_end_in_the_same_verdict(engine: str) -> None:
    spec = TruthSpec(
        single_move(350.0, 0.3, rest_before_s=0.1, rest_after_s=0.05), fault=Fault("coupling_loss", 0.3)
    )
    v = event_of(diagnose_log(log_from_frame(make_log(spec, 1)[0]), RIG, SETTINGS, engine=engine))
    assert v.label == "coupling_loss" and v.onset_s == pytest.approx(0.3, abs=2e-3)


# --- what may be missing -------------------------------------------------------------------------


@pytest.mark.parametrize("column", ["pitch_deg", "speed_cmd_rad_s", "voltage_v"])
@pytest.mark.parametrize("label", FAULTS)
@pytest.mark.first(1, 3)
def test_a_missing_column_is_noted_and_the_verdict_stands(label: str, column: str, tmp_path: Path) -> None:
    pitch = 0.0 if column == "pitch_deg" else 4.0
    fault = Fault() if label == "nominal" else Fault(label, 1.3)
    frame, _ = make_log(TruthSpec(single_move(-350.0, 1.6, pitch_deg=pitch), fault=fault), 8)
    outcome = diagnose(write_log(frame.drop(columns=column), tmp_path / "move.csv"), RIG, SETTINGS)
    assert event_of(outcome).label == label
    assert outcome.log is not None and any(column in note for note in outcome.log.notes)


@pytest.mark.parametrize("label", FAULTS)
def test_a_log_in_memory_without_its_command_gets_it_back(label: str) -> None:
    """No path may take a command that nobody logged for a rest: a faulty log would be called healthy."""
    fault = Fault() if label == "nominal" else Fault(label, 1.3)
    frame, _ = make_log(TruthSpec(single_move(-350.0, 1.6, pitch_deg=4.0), fault=fault), 8)
    outcome = diagnose_log(log_from_frame(frame.drop(columns="speed_cmd_rad_s")), RIG, SETTINGS)
    assert event_of(outcome).label == label and outcome.isolation.events
    assert outcome.log is not None and any("recovered from voltage" in note for note in outcome.log.notes)


def test_a_log_at_rest_says_nothing(tmp_path: Path) -> None:
    frame, _ = make_log(TruthSpec(single_move(300.0, 0.2, rest_before_s=0.6, rest_after_s=0.1)), 1)
    outcome = diagnose(write_log(frame.iloc[:900], tmp_path / "rest.csv"), RIG, SETTINGS)
    assert event_of(outcome).label == "not_tested" and outcome.isolation.events == ()
    assert outcome.explanation == "Not tested: the log holds no move, so it says nothing about the actuator."


# --- many moves ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_log() -> tuple[Log, dict]:
    """Eight moves; the coupling lets go in the fifth."""
    frame, truth = make_log(TruthSpec(campaign(), fault=Fault("coupling_loss", 11.0)), 2)
    return log_from_frame(frame), truth


@pytest.mark.slow
def test_every_move_of_a_campaign_has_its_verdict(long_log: tuple[Log, dict]) -> None:
    log, truth = long_log
    outcome = diagnose_log(log, RIG, SETTINGS)
    assert outcome.isolation is not None
    labels = [e.label for e in outcome.isolation.events]
    assert labels == ["nominal"] * 4 + ["coupling_loss"] * 4
    assert outcome.isolation.verdict.onset_s == pytest.approx(11.0, abs=2e-3)
    starts = [move["start_s"] for move in truth["moves"]]
    assert [e.start_s for e in outcome.isolation.events] == pytest.approx(starts, abs=2e-3)


@pytest.mark.slow
@pytest.mark.study
def test_memory_does_not_grow_with_the_log(long_log: tuple[Log, dict]) -> None:
    """A campaign four times over needs no more than twice (then what is drawn is full), in chunks of 2.5 s."""

    def peak(times: int) -> int:
        log, _ = long_log
        run = Diagnosis(RIG, SETTINGS)
        tracemalloc.start()
        for k in range(times):
            for first in range(0, log.t.size, 4000):
                part = part_of(log, first, first + 4000)
                run.add(replace(part, t=part.t + k * (log.t[-1] + 1.0 / 1600.0)))
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(1)  # compiles what it needs, whose memory is none of a log
    assert peak(4) < 1.1 * peak(2)


# --- detection from outside ----------------------------------------------------------------------


@pytest.mark.slow
def test_a_verdict_starts_where_detection_says(tmp_path: Path) -> None:
    frame, _ = make_log(TruthSpec(single_move(350.0, 1.6), fault=Fault("overload", 1.0)), 8)
    path = write_log(frame, tmp_path / "move.csv")
    v = event_of(diagnose(path, RIG, SETTINGS, detected_at=1.2))
    assert v.label == "overload" and v.start_s == pytest.approx(1.2, abs=1e-3)
    assert 1.2 <= v.isolated_s < 1.35 and v.onset_s is not None
    open_loop = diagnose(path, RIG, SETTINGS, detected_at=1.0).open_loop
    assert open_loop is not None and open_loop.verdict.label == "overload"


def test_a_false_alarm_from_outside_is_called_one(tmp_path: Path) -> None:
    frame, _ = make_log(TruthSpec(single_move(350.0, 1.6)), 8)
    outcome = diagnose(write_log(frame, tmp_path / "move.csv"), RIG, SETTINGS, detected_at=0.8)
    assert event_of(outcome).label == "nominal"
    assert outcome.open_loop is not None and outcome.open_loop.verdict.label == "nominal"


@pytest.mark.slow
@pytest.mark.study
def test_what_passes_does_not_condemn_the_move() -> None:
    """15 ms in which voltage and current contradict each other: whatever was thought of them, nominal comes back."""
    said = []
    for seed in range(60, 64):
        log = move(seed, "nominal")
        start = log.t[np.flatnonzero(log.w_cmd)[0]]
        spoilt = (log.t >= start + 0.6) & (log.t < start + 0.615)
        z = log.z + np.where(spoilt, 1.0, 0.0)[:, None] * (0.5, 0.02, 0.0)
        said.append(event_of(diagnose_log(replace(log, z=z), RIG, SETTINGS)).label)
    assert said.count("nominal") >= 3


@pytest.mark.slow
def test_a_wrong_unit_is_noted() -> None:
    """Current in mA under a header that says A: the verdict cannot say it as clearly as a note."""
    frame, _ = frame_of(3, "nominal")
    frame["current_a"] *= 1e3
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert any("is it in mA?" in note for note in outcome.log.notes)
    assert not diagnose_log(move(3, "nominal"), RIG, SETTINGS).log.notes


@pytest.mark.slow
def test_what_the_rig_file_has_fitted_once_is_asked_though_a_unit_is_suspected(
    long_log: tuple[Log, dict], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An odd size says that the rig file is another machine's only where no move says otherwise."""
    monkeypatch.setattr("observer_fi.verdict.diagnosis.suspect_units", lambda *_: ("the current is odd",))
    log, truth = long_log
    faulty = round((truth["moves"][4]["start_s"] - 0.3) * 1600)
    for first, asked in ((0, True), (faulty, False)):
        run = Diagnosis(RIG, SETTINGS)
        run.add(part_of(log, first, log.t.size))
        last = run.isolator.result().events[-1]
        assert last.label != "nominal" and (not run._is_foreign(last)) == asked


# --- a servo that nobody knows -------------------------------------------------------------------


@pytest.fixture(scope="module")
def servo_free() -> Rig:
    """The rig of an engineer who knows the motor and the mechanics."""
    servo = ("Kp", "Ki", "Rs", "Vmax", "accel_cmd")
    known = {name: q for name, q in RIG.quantities.items() if name not in servo}
    return replace(RIG, drive="voltage", quantities=known)


@pytest.mark.slow
@pytest.mark.parametrize("has_command", [True, False])
@pytest.mark.parametrize("label", FAULTS)
@pytest.mark.first(1)
def test_faults_are_told_without_the_servos_gains(
    label: str, has_command: bool, servo_free: Rig, tmp_path: Path
) -> None:
    for seed in (70, 71) if has_command else (72, 73):
        frame, truth = frame_of(seed, label)
        frame = frame if has_command else frame.drop(columns="speed_cmd_rad_s")
        outcome = diagnose(write_log(frame, tmp_path / f"{seed}.csv"), servo_free, SETTINGS)
        v = event_of(outcome)
        assert v.label == label
        assert outcome.open_loop is None  # nothing to run open loop
        if label != "nominal":
            assert v.onset_s == pytest.approx(truth["onset_s"], abs=0.05)


# --- what is drawn and said ----------------------------------------------------------------------


@pytest.mark.slow
def test_what_is_drawn_shows_the_fault() -> None:
    frame, truth = frame_of(3, "overload")
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    zoom, overview = outcome.zoom, outcome.overview
    assert zoom is not None and overview is not None
    assert zoom.t[0] < truth["onset_s"] < zoom.t[-1] and np.diff(zoom.t).max() < 1.01 / 1600.0
    assert (overview.t[0], overview.t[-1]) == (
        pytest.approx(0.0),
        pytest.approx(frame["time_s"].iloc[-1], abs=0.01),
    )
    assert zoom.probability.shape == (zoom.t.size, len(outcome.modes)) and zoom.mixture_t.size > 100
    np.testing.assert_allclose(zoom.probability.sum(axis=1), 1.0, atol=1e-9)


def said(
    label: str, channel: str | None = None, reasons: tuple[str, ...] = (), events: int = 1, **times: float
) -> str:
    posterior = dict.fromkeys(LABELS, 0.0) | {label: 1.0}
    low, high = times.get("low"), times.get("high")
    v = Event(
        label,
        channel,
        0.9996,
        times.get("onset"),
        (low, high),
        None,
        times.get("isolated"),
        0.2,
        3.0,
        posterior,
        reasons,
    )
    empty = np.empty(0)
    log = Log("log", empty, np.empty((0, 3)), empty, empty)
    return explain.explanation(Isolation(v, (v,) * events, Consistency(3.0, 3.0, 0.5)), RIG, log)


def test_explanations_say_what_when_how_sure_and_what_to_do() -> None:
    text = said("overload", onset=1.0, low=0.99, high=1.01, isolated=1.04)
    assert text.startswith("The mass pressed against an obstacle or a travel limit")
    for part in (
        "It began at 1.000 s (95 % between 0.990 and 1.010 s) and was certain from 1.040 s on.",
        "above 99.9 %",
        "Stop the move",
    ):
        assert part in text
    assert "1.000 s (to the millisecond)" in said(
        "overload", onset=1.0, low=0.9998, high=1.0002, isolated=1.04
    )
    assert "blind" not in text and "-5.2 deg" in said("coupling_loss", onset=1.0)
    assert "It began at" not in said("nominal") and "No action is needed." in said("nominal")
    assert "cannot be placed" in said("unknown") and "wrong pitch reading" in said("unknown")
    for channel in ("voltage", "current", "position"):
        assert f"Check the {channel} sensor" in said("sensor_fault", channel)
    assert "while the motor stays at one speed" in said("sensor_fault", "voltage")
    assert "Note: it came and went." in said("overload", reasons=("it came and went",))


def test_a_log_whose_moves_all_disagree_points_at_the_model() -> None:
    assert "points at the model" in said("unknown", events=4)
    assert "points at the model" not in said("unknown", events=2) + said("overload", events=4)
