"""A log in, a verdict out: file -> chunks -> bank -> isolation -> Outcome, in memory that does not grow with the log."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from observer_fi.bank import Hypothesis
from observer_fi.bank import compiled_bank as kernels
from observer_fi.logs import (
    ABSENT,
    CHUNK_ROWS,
    ColumnMap,
    LogFile,
    Progress,
    Thinner,
    log_name,
    log_segments,
    open_log,
    quarter_of_a_ring,
    read_log,
    suspect_units,
)
from observer_fi.physics import NOMINAL, Rig, channel_of, commanded, label_of
from observer_fi.records import Array, Estimate, Event, Isolation, Log, Outcome, Traces
from observer_fi.settings import Settings
from observer_fi.verdict import explain
from observer_fi.verdict import traces as sketch
from observer_fi.verdict.cautions import cautions
from observer_fi.verdict.detectable import could_show, or_unseen
from observer_fi.verdict.drift import SURE, or_else, raised_friction, usual_rise
from observer_fi.verdict.drive_off import without_off
from observer_fi.verdict.isolate import (
    EventTracker,
    Isolator,
    Run,
    handed_on,
    healthy,
    log_verdict,
    tested,
)
from observer_fi.verdict.last_word import LastWord
from observer_fi.verdict.logger.as_followed import (
    NOT_FOLLOWED,
    as_followed,
    better,
    is_not_followed,
    may_not_be_followed,
)
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.logger.at_ticks import at_ticks, is_held
from observer_fi.verdict.logger.balance_at_rest import or_unbalanced
from observer_fi.verdict.logger.begun_at_the_limit import known_from
from observer_fi.verdict.logger.changed_noise import or_a_changed_noise
from observer_fi.verdict.logger.left_out import (
    TOLD_BY_ONE,
    is_of_the_actuator,
    left_out,
    may_be_a_channel,
    of_the_rest,
    told_alone,
    without,
)
from observer_fi.verdict.logger.no_command import with_its_servo
from observer_fi.verdict.logger.no_pitch import is_told_pitch, or_another_pitch, told_pitch, with_its_pitch
from observer_fi.verdict.logger.other_channels import not_the_sensor_alone, or_another, with_the_actuator
from observer_fi.verdict.moves.another_gain import or_another_gain
from observer_fi.verdict.moves.as_resistance import or_the_resistance
from observer_fi.verdict.moves.by_encoder import by_the_encoder
from observer_fi.verdict.moves.circuit import of_the_circuit
from observer_fi.verdict.moves.naming import FAR
from observer_fi.verdict.moves.one_alone import or_of_one_alone
from observer_fi.verdict.moves.unloaded import (
    or_dead_voltage,
    or_frozen,
    or_left_behind,
    or_let_go,
    or_stalled,
    or_still_turning,
    without_voltage,
)
from observer_fi.verdict.moves.whole_move import SETTLED_S
from observer_fi.verdict.moves.with_room import WithRoom
from observer_fi.verdict.moves.with_the_brake import or_the_brake
from observer_fi.verdict.onset import Filters, onset_in
from observer_fi.verdict.open_loop import Mixture
from observer_fi.verdict.stuck import of_a_jumping_sensor, of_a_stuck_sensor, stands_still
from observer_fi.verdict.testable import SURE_HZ, Testable, or_a_slip, or_an_obstacle, or_touched, untested
from observer_fi.verdict.wrong_rig import fits_at_first, or_never_fitted, or_unexplained, wrong_rig

ONSETS_AGREE_S = 0.02
ZOOM_BEFORE_S, ZOOM_AFTER_S = 0.15, 0.45
NEAR_S = 0.1  # shown on either side of a moment
ONE_SPAN_S = 1.0  # an onset and an isolation that are further apart are shown apart
MIXTURE_POINTS = 2000
SAMPLES_A_RING = 10.0  # of a servo, from which its answer to a load is seen


class AnyBank(Protocol):
    """What both engines offer."""

    hypotheses: tuple[Hypothesis, ...]

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples."""


def make_bank(rig: Rig, settings: Settings, engine: str = "compiled", filter_kind: str = "ekf") -> AnyBank:
    """The bank of an engine: "compiled" or, for comparison, "filterpy"; filter_kind "ekf" or "ukf"."""
    if engine == "filterpy":
        from observer_fi.bank import FilterpyBank  # filterpy is slow to import

        return FilterpyBank(rig, settings.bank, filter_kind=filter_kind)
    return kernels.Bank(rig, settings.bank, filter_kind=filter_kind)


def diagnose(
    path: str | Path,
    rig: Rig,
    settings: Settings,
    *,
    engine: str = "compiled",
    filter_kind: str = "ekf",
    columns: ColumnMap | None = None,
    detected_at: float | None = None,
    progress: Progress = lambda share: None,
) -> Outcome:
    """The verdict on one log file. detected_at: time of an external detection [s]; the verdict starts there.

    progress: is told what share of the log was judged. Raises InvalidLogError with the one line for the user.
    """
    begun = partial(
        Diagnosis, settings=settings, engine=engine, filter_kind=filter_kind, detected_at=detected_at
    )
    run, file, recovered = begun(rig), open_log(path, columns), None
    first = next(open_log(path, columns).chunks())
    thinner = Thinner(first, rig)
    as_it_is = cache(lambda: read_log(path, columns))
    begin = cache(lambda: next(thinner.chunks(open_log(path, columns))) if thinner.rows > 1 else first)
    if rig.law is None and (rig.driven.command or not file.has_command or is_not_followed(begin(), rig)):
        recovered, watched = with_its_servo(thinner.of(as_it_is()), rig)
        run, rig = (run if watched is rig else begun(watched)), watched
    if recovered is not None:
        recovered = at_ticks(recovered, rig)
    elif not rig.watched.servo and is_held(begin(), rig):
        recovered = at_ticks(thinner.of(as_it_is()), rig)
    filed, rig = rig, with_its_pitch(begin() if recovered is None else recovered, rig, settings.bank)
    run = run if rig is filed else begun(rig)
    run.add_all(_chunks(file, thinner, progress) if recovered is None else _pieces(recovered, progress))
    whole = file.summary if recovered is None else recovered
    notes = whole.notes + thinner.told() if recovered is None else whole.notes
    facts: dict[str, Any] = {
        "sha256": file.sha256, "metadata": file.metadata, "gaps": whole.gaps, "rejected": whole.rejected,
        "rejected_count": whole.rejected_count, "notes": told_pitch(_notes(notes, rig), rig, filed),
    }  # fmt: skip
    outcome = run.outcome(log_name(path), facts)
    read = cache(lambda: thinner.of(as_it_is()) if recovered is None else recovered)
    begin = begin if recovered is None else read
    outcome = or_a_changed_noise(or_another(outcome, begin, rig, settings), begin, rig)
    for other in _taken_otherwise(outcome, read, begin, rig, settings):
        again = begun(other.rig)
        again.add_all(_pieces(other.log, progress))
        notes = told_pitch(_notes(other.log.notes, rig), rig, filed)
        told = again.outcome(log_name(path), {**facts, "notes": notes})
        found = other.choose(outcome, told)
        if found is not outcome:
            outcome = found
            break
    samples = file.summary.samples if recovered is None else as_it_is().t.size
    return thinner.restored(_last_doubts(outcome, begin, rig, filed), samples)


def _last_doubts(outcome: Outcome, begin: Callable[[], Log], rig: Rig, filed: Rig) -> Outcome:
    told = by_the_encoder(or_unbalanced(outcome, begin, rig), begin, rig)
    return or_another_pitch(told, begin, rig, filed)


def _notes(notes: Sequence[str], rig: Rig) -> tuple[str, ...]:
    """Those that matter to a drive: a column that it has no use for is not missing."""
    return tuple(n for n in notes if rig.law is None or not n.startswith(ABSENT))


class _Otherwise(NamedTuple):
    """A log as it may be taken, the rig to judge it with, and what chooses between outcomes: as it is, and so."""

    log: Log
    rig: Rig
    choose: Callable[[Outcome, Outcome], Outcome]


def _taken_otherwise(
    outcome: Outcome, read: Callable[[], Log], begin: Callable[[], Log], rig: Rig, settings: Settings
) -> Iterator[_Otherwise]:
    """A log in other ways, where its outcome asks for them.

    read: the log; begin: its first chunk at least.

    With the command that its servo followed; without a channel that contradicts the others from the first motion on, and
    without one that alone tells a fault of the actuator, or has failed with a fault beside it.
    """
    followed = as_followed(read(), rig) if may_not_be_followed(outcome) else None
    if followed is not None:
        yield _Otherwise(at_ticks(followed, rig.without_servo), rig.without_servo, better)
    if may_be_a_channel(outcome):
        channel = left_out(read(), rig, settings)
        if channel is not None:
            yield _Otherwise(
                without(read(), channel), rig, partial(of_the_rest, channels=(channel,), rig=rig)
            )
    found = outcome.isolation
    if found is not None and found.verdict.label == "sensor_fault":
        failed = not_the_sensor_alone(begin(), found.verdict, rig, settings)
        if failed is not None:
            yield _Otherwise(without(read(), failed), rig, partial(with_the_actuator, rig=rig))
    if found is not None and is_of_the_actuator(found.verdict):
        alone = told_alone(begin(), found.verdict, rig, settings)
        if alone:
            choose = partial(of_the_rest, channels=alone, rig=rig, words=TOLD_BY_ONE)
            yield _Otherwise(without(read(), alone[0]), rig, choose)


def _chunks(file: LogFile, thinner: Thinner, progress: Progress) -> Iterator[Log]:
    for log in thinner.chunks(file):
        yield log
        progress(file.share_read)


def _pieces(log: Log, progress: Progress) -> Iterator[Log]:
    for first in range(0, log.t.size, CHUNK_ROWS):
        yield log.part(slice(first, first + CHUNK_ROWS))
        progress(min(1.0, (first + CHUNK_ROWS) / log.t.size))


def diagnose_log(
    log: Log, rig: Rig, settings: Settings, *, engine: str = "compiled", filter_kind: str = "ekf"
) -> Outcome:
    """The verdict on a log in memory."""
    return judged(log, rig, settings, engine, filter_kind)[0]


def judged(
    log: Log, rig: Rig, settings: Settings, engine: str = "compiled", filter_kind: str = "ekf"
) -> tuple[Outcome, Estimate]:
    """The verdict on a log in memory, and the bank's estimate that it rests on; a command that it lacks is recovered."""
    thinner = Thinner(log, rig)
    outcome, estimate = _judged_thinned(thinner.of(log), rig, settings, engine, filter_kind)
    return thinner.restored(outcome, log.t.size), estimate


def _judged_thinned(
    log: Log, rig: Rig, settings: Settings, engine: str, filter_kind: str
) -> tuple[Outcome, Estimate]:
    """As `judged`, of a log with no more rows than are needed."""
    given, rig = with_its_servo(log, rig)
    given, filed = at_ticks(given, rig), rig
    rig = with_its_pitch(given, rig, settings.bank)
    given = replace(given, notes=told_pitch(given.notes, rig, filed))
    outcome, estimate = _judged(given, rig, settings, engine, filter_kind)
    outcome = or_a_changed_noise(or_another(outcome, lambda: given, rig, settings), lambda: given, rig)
    for other in _taken_otherwise(outcome, lambda: given, lambda: given, rig, settings):
        again, told = _judged(other.log, other.rig, settings, engine, filter_kind)
        found = other.choose(outcome, again)
        if found is not outcome:
            rests_on = told if found.acquisition is again.acquisition else estimate
            return _last_doubts(found, lambda: given, rig, filed), rests_on
    return _last_doubts(outcome, lambda: given, rig, filed), estimate


def _judged(
    log: Log, rig: Rig, settings: Settings, engine: str, filter_kind: str
) -> tuple[Outcome, Estimate]:
    run = Diagnosis(rig, settings, engine, filter_kind)
    estimate = run.add(log)
    facts = {
        k: getattr(log, k) for k in ("sha256", "metadata", "gaps", "rejected", "rejected_count", "notes")
    }
    return run.outcome(log_name(log.path), facts), estimate


class Diagnosis:
    """One log under way: `add` its chunks in order, then `outcome`."""

    def __init__(
        self,
        rig: Rig,
        settings: Settings,
        engine: str = "compiled",
        filter_kind: str = "ekf",
        detected_at: float | None = None,
    ) -> None:
        self.rig, self.settings, self.detected_at = rig, settings, detected_at
        self.logged = rig
        self.as_logged: AsLogged | None = None
        self.left_out_s = 0.0  # of the log's begin
        self.engine, self.filter_kind = engine, filter_kind
        self._make_banks()
        modes = tuple(h.name for h in self.bank.hypotheses)
        self.isolator, self.testable = Isolator(modes, settings.decision), Testable()
        self.onsets: dict[tuple[float, int], Any] = {}
        self.told: dict[float, Event] = {}  # what whole moves said, by their start
        self.fitted = False  # whether the rig file explains the start of a move with a fault
        self.overview, self.samples_near, self.evidence = (
            sketch.Overview(),
            sketch.Samples(),
            sketch.Evidence(),
        )
        self.samples, self.first, self.last, self.rate = 0, np.nan, np.nan, np.nan
        self.path = ""
        self.suspects: tuple[str, ...] | None = None

    def _make_banks(self) -> None:
        rig, settings = self.logged, self.settings
        self.bank = make_bank(rig, settings, self.engine, self.filter_kind)
        # the onset is looked for with the compiled nominal filter, whatever the engine of the bank
        self.keeper: kernels.Bank = (
            self.bank
            if isinstance(self.bank, kernels.Bank)
            else kernels.Bank(rig, settings.bank, hypotheses=self.bank.hypotheses[:1])
        )
        self.memory, self.filters = self.keeper, Filters(rig, settings.bank)
        self.last_word = LastWord(rig, self.filters, settings.decision)
        self.with_room = WithRoom(rig, settings)
        self.baseline = Baseline(rig, settings)

    def add_all(self, logs: Iterable[Log]) -> None:
        """Take chunks in order; while one is judged, the bank is at the next one on a thread of its own."""
        with ThreadPoolExecutor(1) as thread:
            before: tuple[Log, Log, Future[tuple[Estimate, kernels.Bank]]] | None = None
            for log in logs:
                given = self._begun(commanded(log, self.rig))
                taken = self._taken(given)
                ahead = given, taken, thread.submit(self._advanced, taken)
                if before is not None:
                    self._judge(*before[:2], *before[2].result())
                before = ahead
            if before is not None:
                self._judge(*before[:2], *before[2].result())

    def add(self, log: Log) -> Estimate:
        """Take the next chunk; the bank's estimate of it."""
        given = self._begun(commanded(log, self.rig))
        taken = self._taken(given)
        estimate, memory = self._advanced(taken)
        self._judge(given, taken, estimate, memory)
        return estimate

    def _advanced(self, log: Log) -> tuple[Estimate, kernels.Bank]:
        """The bank's estimate of the next chunk, and what it remembers after it."""
        estimate = self.bank.advance(log)
        if self.keeper is not self.bank:
            self.keeper.advance(log)
        return estimate, self.keeper.memory()

    def _begun(self, log: Log) -> Log:
        """The chunk; the first one from where the servo is known."""
        if self.as_logged is not None:
            return log
        first = known_from(log, self.rig)
        self.left_out_s = float(log.t[first] - log.t[0])
        return log.part(slice(first, None)) if first else log

    def _taken(self, log: Log) -> Log:
        """The next chunk as filters may take it; the first one says what its logger does, and the bank is fitted to that."""
        if self.as_logged is None:
            self.as_logged = AsLogged(log, self.rig, self.settings.bank)
            known = self.as_logged
            if known.rig is not self.rig or known.settings is not self.settings.bank:
                self.settings, self.logged = replace(self.settings, bank=known.settings), known.rig
                self._make_banks()
        return self.as_logged.take(log)

    def _judge(self, given: Log, log: Log, estimate: Estimate, memory: kernels.Bank) -> None:
        """Make of an estimate what there is to say. given: what is drawn, log: as filters took it."""
        self.path, self.memory = log.path, memory
        if not self.samples:
            self.first, self.rate = float(log.t[0]), log.rate_hz
        self.samples, self.last = self.samples + log.t.size, float(log.t[-1])
        if self.suspects is None and log.w_cmd.any():
            self.suspects = suspect_units(given, log_segments(given), self.rig.model)
        if self.detected_at is not None:
            estimate = replace(estimate, active=estimate.active & (estimate.t >= self.detected_at))
        self.testable.add(log, estimate)
        starts = []
        for tracker in self.isolator.add(without_off(estimate, log, self.logged.noise_std)):
            starts.append(tracker.start_s)
            self._look_for_onsets(tracker)
        self._ask_moves(self.isolator.events)
        judged = tested(estimate, self.settings.decision)
        told = self.evidence.add(estimate, log.z, self.logged.noise_std, starts)
        rows_of = partial(sketch.rows, log, judged, self.logged, given.z, told)
        self.overview.add(given.z, rows_of)
        self.samples_near.add(log.t, rows_of, self._spans())
        detected = self.detected_at if self.detected_at is not None else self._first_detection()
        self.baseline.add(log, estimate, detected)

    def _ask_moves(self, events: Iterable[Event]) -> None:
        """The last word on moves that have ended, while their samples are at hand."""
        at_hand = -math.inf if self.memory.recent is None else float(self.memory.recent.t[0])
        for event in events:
            if event.end_s < at_hand or event.start_s in self.told or self._is_foreign(event):
                continue
            self.fitted = self.fitted or self._fits_at_first(event)
            doubting = self.last_word.doubting(event, self.memory)
            asked = self.last_word.needed(doubting)
            told = self.last_word.on(doubting, self.memory) if asked else event
            told = event if doubting is not event and told.label == NOMINAL and not told.alike else told
            told = raised_friction(told, self.memory, self.settings.decision.strain_limit)
            told = or_frozen(of_a_stuck_sensor(told, self.memory, self.logged), self.memory)
            told = of_a_jumping_sensor(told, self.memory, self.logged)
            story = self.last_word.explained.get(event.start_s)
            told = self._of_the_circuit(self.with_room.on(told, self.memory, story))
            if self.detected_at is None and not any(e.start_s < event.start_s for e in self.isolator.events):
                told = or_another_gain(told, self.memory, self.logged, self.settings, story)
                told = or_the_brake(told, self.memory)
            if asked or told is not event:
                self.told[event.start_s] = told

    def _of_the_circuit(self, event: Event) -> Event:
        known = event if event.onset_s is not None else self._with_onset(event)
        told = of_the_circuit(known, self.memory, self.last_word)
        return event if told is known else told

    def _fits_at_first(self, event: Event) -> bool:
        whole = None if event.label == NOMINAL else self.last_word.move(event, self.memory)
        believable = self.settings.decision.strain_limit * self.logged.spread("A")
        return whole is not None and fits_at_first(whole, event.start_s, believable or math.inf)

    def _is_foreign(self, event: Event) -> bool:
        """Whether a suspected unit or sign is told instead of what a move says: not where the rig file fits it or one before."""
        before = (one for one in self.isolator.events if one.start_s < event.start_s)
        return bool(self.suspects) and not any(one.label == NOMINAL for one in (event, *before))

    def _look_for_onsets(self, tracker: EventTracker) -> None:
        """Find the onset of a fault as soon as it has been certain for a while, while its samples are at hand."""
        d = self.settings.decision
        for j, run in {**tracker.latched, **tracker.certain}.items():
            key, last = (tracker.start_s, j), run.since + d.onset_after_s
            if j == 0 or (key in self.onsets and self.onsets[key][0] == (run.since, True)):
                continue
            first = max(tracker.start_s, min(run.detected, run.since) - d.onset_before_s)
            found = onset_in(self.memory, self.bank.hypotheses[j], first, last, self.filters)
            if found is not None:
                self.onsets[key] = (
                    (run.since, self.last >= last),
                    found,
                )  # again, where samples are still to come

    def _spans(self) -> list[sketch.Span]:
        """What is known to matter so far [s]: the first start of a move, onsets, and when they became certain."""
        moves = (*self.isolator.events[:1], self.isolator.current)
        begun = [_around(moves[0].start_s + NEAR_S)] if moves[0] is not None else []
        return begun + [
            span for (since, _), found in self.onsets.values() for span in _shown(found.median, since)
        ]

    def _first_detection(self) -> float | None:
        """When nominal was first doubted on the way to a fault."""
        times = [e.detected_s for e in self.isolator.events if e.detected_s is not None]
        tracker = self.isolator.current
        if tracker is not None:
            times += [run.detected for j, run in {**tracker.latched, **tracker.certain}.items() if j != 0]
        return min(times) if times else None

    def _finished(self, event: Event) -> Event:
        """An event with what its whole move says, or with its onset."""
        told = self.told.get(event.start_s, event)
        found = self._with_onset(event)
        if told is event or (told.label == event.label and _agree(told.onset_s, found.onset_s)):
            low, high = found.onset_interval_s
            earliest = min((s for s in (low, told.onset_interval_s[0]) if s is not None), default=None)
            unseen = told.onset_s is not None and earliest is not None and earliest < told.start_s
            return told._replace(onset_s=found.onset_s, onset_interval_s=(earliest if unseen else low, high))
        return told

    def _of_the_day(self, event: Event) -> Event:
        """The event, healthy where its friction was up by no more than from one day to the next, and that explains little."""
        story = self.last_word.explained.get(event.start_s)
        explained = math.inf if story is None else story.gain
        event = or_the_resistance(or_none(event), self.memory, self.rig, explained)
        much = story is not None and story.gain >= FAR * self.settings.decision.move_nats
        return event if much else of_the_day(event, self.rig)

    def _with_onset(self, event: Event) -> Event:
        keys = [(start, j) for (start, j) in self.onsets if start == event.start_s]
        modes = self.isolator.modes
        for start, j in keys:
            if (label_of(modes[j]), channel_of(modes[j])) == (event.label, event.channel):
                found = self.onsets[start, j][1]
                return event._replace(onset_s=found.median, onset_interval_s=(found.low, found.high))
        if event.label != NOMINAL and event.detected_s is not None:
            return event._replace(
                onset_s=event.detected_s, onset_interval_s=(event.start_s, event.detected_s)
            )
        return event

    def outcome(self, name: str, facts: dict[str, Any]) -> Outcome:
        """What was found. facts: fields of Log that describe the whole file."""
        found = self.isolator.result()
        self._ask_moves(found.events[-1:])
        finished = [self._of_the_day(self._finished(e)) for e in found.events]
        finished = list(map(self._as_far_as_told, finished))
        isolated = list(map(isolated_again, finished, found.events))
        if self.detected_at is None:  # which may be anywhere in a move
            isolated[:1] = map(or_never_fitted, isolated[:1])
        events = or_unexplained(handed_on(isolated), found.consistency)
        verdict = log_verdict(list(events))
        foreign = wrong_rig(
            verdict, events, found.consistency, self.suspects or (), self.last_word.explained, self.fitted
        )
        lack = foreign or self.testable.lack(self.rate, self.rig, verdict.label)
        asked = (verdict, *events[-1:]) if verdict.label == NOMINAL and not lack else ()
        could = could_show(asked, self.memory, self.filters, self.settings.decision)
        seen = or_unseen(verdict, could, self.as_logged.unread if self.as_logged else (), self.rig)
        isolation = untested(lack) if lack else Isolation(seen, events, found.consistency, could)
        empty = np.empty(0)
        facts = {**facts, "notes": (*facts.get("notes", ()), *(self.suspects or ()))}
        log = Log(self.path, empty, np.empty((0, 3)), empty, empty, **facts)
        overview, zoom = self._drawn(verdict, events)
        return Outcome(
            name, log, self.samples, self.rate, self.last - self.first, self.isolator.modes, isolation,
            None if lack else self.baseline.isolation(), overview, None if lack else zoom,
            explain.explanation(isolation, self.rig, log),
            {"engine": self.engine, "filter": self.filter_kind, "rig": self.rig.name, "drive": self.rig.drive,
             "detected_at": self.detected_at, **asdict(self.settings)},
            acquisition=self.as_logged.told if self.as_logged else None, warnings=self._warnings(isolation, foreign, log),
        )  # fmt: skip

    def _as_far_as_told(self, event: Event) -> Event:
        """An event with what the channels that are logged, their rate and their steps leave open beside it."""
        memory, rig, alike = self.memory, self.logged, self.settings.decision.alike
        if stands_still(event):
            return event
        if self.isolator.channels.lacks("voltage") and not self._servo_tells():
            event = without_voltage(event, memory, rig, alike)
            event = or_left_behind(event, memory, rig, alike)
        event = or_of_one_alone(or_dead_voltage(event, memory, rig), memory, rig)
        event = or_stalled(or_still_turning(event, memory, rig, alike), memory)
        event = or_touched(or_a_slip(or_an_obstacle(event, self.rate, self.rig), memory, rig), memory)
        slow = self.rate < SURE_HZ and not self.rig.watched.servo
        return or_let_go(event, memory) if slow else event

    def _servo_tells(self) -> bool:
        """Whether a known servo tells its motor: samples show the ring by which it answers a load, and no sensor's fault."""
        ring_s = 4.0 * quarter_of_a_ring(self.rig.model)
        return self.rig.watched.servo and self.rate * ring_s > SAMPLES_A_RING

    def _drawn(self, verdict: Event, events: tuple[Event, ...]) -> tuple[Traces, ...]:
        """The whole log with every sample near the moments that matter, and those around the verdict's onset."""
        for event in events:
            if event.label != NOMINAL:
                self.samples_near.keep(_moments(event))
        at, m, mixture = verdict.onset_s, len(self.isolator.modes), self.baseline.traces()
        if at is None or verdict.label == NOMINAL:
            at = min(max(verdict.start_s + NEAR_S, self.first), self.last)
            self.samples_near.keep([_around(at)])
        span = _shown(at, verdict.isolated_s)[0]
        near = self.samples_near.result()
        whole = sketch.together(self.overview.result(), near)
        return tuple(
            replace(
                traces,
                posterior=sketch.as_judged(traces, self.isolator.modes, events),
                evidence=sketch.since_onsets(traces.evidence, traces.t, events),
                spared=sketch.since_onsets(traces.spared, traces.t, events),
            )
            for traces in (sketch.unpacked(table, m, mixture) for table in (whole, _within(near, span)))
        )

    def _warnings(self, isolation: Isolation, foreign: str, log: Log) -> tuple[str, ...]:
        known = cautions(self.as_logged, isolation, self.rate, self.left_out_s) if self.as_logged else ()
        return (
            *([NOT_FOLLOWED] if NOT_FOLLOWED in log.notes else []),
            *(note for note in log.notes if is_told_pitch(note)),
            *([foreign] if foreign else []),
            *(self.suspects or ()),
            *explain.second_faults(isolation),
            *known,
        )


def _around(at: float) -> sketch.Span:
    return at - ZOOM_BEFORE_S, at + ZOOM_AFTER_S


def _shown(onset: float, isolated: float | None) -> list[sketch.Span]:
    """The span around an onset, which reaches past the isolation; far from each other, one span each."""
    low, high = _around(onset)
    if isolated is None:
        return [(low, high)]
    if isolated - onset <= ONE_SPAN_S:
        return [(low, max(high, isolated + NEAR_S))]
    return [(low, high), (isolated - NEAR_S, isolated + NEAR_S)]


def _within(table: Array, span: sketch.Span) -> Array:
    return table[(table[:, 0] >= span[0]) & (table[:, 0] <= span[1])] if table.size else table


def _moments(event: Event) -> list[sketch.Span]:
    """What matters of a fault: its onset, its isolation, its end, and where the move told it only at its end."""
    onset = event.onset_s if event.onset_s is not None else event.detected_s
    spans = [] if onset is None else _shown(onset, event.isolated_s)
    return spans + [(at - NEAR_S, at + NEAR_S) for at in (event.over_s, event.end_s) if at is not None]


def isolated_again(told: Event, event: Event) -> Event:
    """What is told in the end, with the time from which the bank was sure of just that: another label may have stood between."""
    same = (told.label, told.channel) == (event.label, event.channel) and told.isolated_s is None
    return told._replace(isolated_s=event.isolated_s) if same and told.probability > SURE else told


def of_the_day(event: Event, rig: Rig) -> Event:
    """The event, healthy where friction was up from the start on by no more than it is from one day to the next."""
    rises = [s.value for s in event.severity if event.label == "jam" and s.name == "friction_rise"]
    from_the_start = event.onset_s is not None and event.onset_s - event.start_s < SETTLED_S
    usual = bool(rises) and 0.0 <= rises[0] < usual_rise(rig)
    return healthy(event) if usual and from_the_start else event


def or_none(event: Event) -> Event:
    """The event, or else health where a jam lasts whose friction is not told from what it was before.

    What a ripple of every day brings is followed better by a friction that may be any, and comes back to where it was.
    """
    lasts = event.label == "jam" and event.over_s is None and not event.then and NOMINAL not in event.alike
    rises = [s for s in event.severity if lasts and s.name == "friction_rise"]
    if not any(s.interval[0] <= 0.0 <= s.interval[1] for s in rises):
        return event
    return or_else(healthy(event), "jam", "friction may have risen, by no more than leaves it as it was")


def _agree(whole: float | None, bank: float | None) -> bool:
    """Whether the whole move sees the onset where the bank does, whose interval is then the finer one."""
    return whole is None or (bank is not None and abs(whole - bank) <= ONSETS_AGREE_S)


class Baseline:
    """The open-loop mixture beside the bank: runs from the first detection to the end of that move."""

    def __init__(self, rig: Rig, settings: Settings) -> None:
        self.rig, self.settings = rig, settings
        self.mixture: Mixture | None = None
        self.isolator: Isolator | None = None
        self.before: Log | None = None
        self.points: list[tuple[Array, Array, Array]] = []
        self.ended = False

    def add(self, log: Log, e: Estimate, detected_s: float | None) -> None:
        """Take the next chunk and the bank's estimate of it."""
        if not self.rig.driven.servo:
            return  # nothing to run open loop
        if self.mixture is None and detected_s is not None:
            first = min(int(np.searchsorted(log.t, detected_s)), log.t.size - 1)
            state = e.states[first, :3]
            self.mixture = Mixture(
                self.rig, state, before=log.part(slice(max(first - 80, 0), first)) if first else None
            )
            log, active = log.part(slice(first, None)), e.active[first:]
        else:
            active = e.active
        if self.mixture is None or self.ended or not log.t.size:
            return
        stopped = np.flatnonzero((log.w_cmd == 0.0) & ~active)
        if stopped.size:
            self.ended = True
            log = log.part(slice(None, max(int(stopped[0]), 1)))
        self._advance(log)

    def _advance(self, log: Log) -> None:
        assert self.mixture is not None
        estimate = self.mixture.advance(log)
        if self.isolator is None:
            self.isolator = Isolator(estimate.modes, self.settings.decision)
        for _ in self.isolator.add(estimate):
            pass
        every = slice(None, None, max(1, log.t.size // MIXTURE_POINTS))
        self.points.append((estimate.t[every], np.sqrt(estimate.nis[every]), estimate.predicted[every]))

    def isolation(self) -> Isolation | None:
        """The mixture's verdict, None where nothing was detected."""
        return None if self.isolator is None else self.isolator.result()

    def traces(self) -> tuple[Array, Array, Array] | None:
        """Times, residual norms (q, 3) and predictions (q, 3, 3) of the mixture, None where it did not run."""
        if not self.points:
            return None
        t, norm, y = (np.concatenate([p[k] for p in self.points]) for k in range(3))
        every = slice(None, None, max(1, t.size // MIXTURE_POINTS))
        return t[every], norm[every], y[every]


__all__ = ["Diagnosis", "Run", "diagnose", "diagnose_log", "judged", "make_bank"]
