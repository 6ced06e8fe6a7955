"""The bank and its verdicts on a stream: the numbers of a whole log, one sample or a small batch at a time.

`LiveBank` allocates nothing per sample and remembers its state and the last samples. `Live` adds the verdicts, and reports a
change at the same sample whatever the batches were.
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import BankState, state_of
from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank import first_state as beginning
from observer_fi.bank import log_feed as feed
from observer_fi.logs import NO_PITCH, Row
from observer_fi.physics import NOMINAL, NOT_TESTED, Rig, channel_of, label_of
from observer_fi.records import Array, Estimate, Event, Log
from observer_fi.serve.recent import EVERY, Recent
from observer_fi.serve.stream_word import StreamWord
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict import (
    FEWEST_MOVING,
    LEARNABLE,
    SETTLING,
    AsLogged,
    EventTracker,
    Isolator,
    another_pitch,
    at_the_limit,
    for_readings,
    known_from,
    log_verdict,
    make_bank,
    moving_samples,
    or_as_well,
    tested,
    with_its_pitch,
)

MOST = 1024  # samples of a batch: what it costs whatever its size is then a tenth of it
REST_ROWS = 4096  # samples before the first move that are kept to learn from
START_S = 0.26  # of that move: what shows how late channels are
STOP_S = 0.2  # of its stop: what shows a wrong zero
BACK_S = 0.5  # of the first motion the other way: what tells a pitch that nobody logged from friction
MOVE_ROWS = 1 << 15  # samples of a move that are kept for that


class LiveBank(kernels.Bank):
    """A bank whose arrays for up to MOST samples exist once: what `step` returns is overwritten by the next call."""

    def __init__(self, rig: Rig, settings: BankSettings, filter_kind: str = "ekf") -> None:
        super().__init__(rig, settings, filter_kind=filter_kind)
        self.w_cmd = np.empty(MOST)
        self.feed = self._room(1)
        self.ring = Recent(1, MOST)
        self.out = kernels.written(MOST, len(self.hypotheses))
        self.views: dict[int, tuple[Array, kernels.LogSamples, kernels.Written, Estimate]] = {}

    def _room(self, substeps: int) -> kernels.LogSamples:
        one = np.empty(MOST)
        return kernels.LogSamples(
            one, np.empty((MOST, 2 * substeps)), one.copy(), one.copy(), np.empty((MOST, 3)), np.empty(MOST, dtype=np.bool_)
        )  # fmt: skip

    def advance(self, log: Log) -> Estimate:
        """As the bank of a log, without the samples that it keeps for onsets."""
        estimate = super().advance(log)
        if self.feed.interval.shape[1] != 2 * self.commands.substeps:
            self.feed = self._room(self.commands.substeps)
            self.ring = Recent(self.commands.substeps, MOST)
            self.views.clear()
        for t, memory in self.snapshots:
            self.ring.remember(t, memory)
        if self.recent is not None:
            for first in range(0, self.recent.t.size, MOST):
                self.ring.add(self.recent.cut(first, first + MOST))
        self.recent = None
        self.snapshots.clear()
        return estimate

    def step(self, rows: Array) -> Estimate:
        """Estimate of at most MOST samples behind those of `advance`. rows: (n, 6) as in `Row`."""
        if self.state is None or not self._placed(rows):
            return self.advance(log_of(rows))
        w_cmd, now, out, estimate = self._views(len(rows))
        self.commands.fill(now.t, w_cmd, now.w_cmd, now.interval)
        now.active[:] = kernels.under_way(now.interval, now.w_cmd, now.t, self.state.t[0], self.soft)
        self._remembered(now, out, self.state)
        self.samples.t, self.samples.w, self.samples.theta = now.t[-1], w_cmd[-1], now.theta[-1]
        return estimate

    def _remembered(self, now: kernels.LogSamples, out: kernels.Written, state: BankState) -> None:
        """Run over the samples and keep them, and nominal's memory at every so many samples of the stream."""
        first, n = 0, now.t.size
        while first < n:
            wanted = self.ring.until_memory()
            if not wanted:
                self.ring.remember(float(now.t[first]), state_of(state, 0, self.seats[0]))
            last = min(first + (wanted or EVERY), n)
            whole = first == 0 and last == n
            part = now if whole else now.cut(first, last)
            self._run(part, out if whole else out.cut(first, last))
            self.ring.add(part)
            first = last

    def _placed(self, rows: Array) -> bool:
        """Put samples into the arrays; whether `LogStream` would take them as they are."""
        before, longest = self.samples.t, self.samples.longest * (1.0 + 1e-6)
        return bool(feed.place(rows, before, longest, self.feed.t, self.feed.z, self.feed.theta, self.w_cmd))

    def _views(self, n: int) -> tuple[Array, kernels.LogSamples, kernels.Written, Estimate]:
        """The arrays for n samples, and the estimate made of them; kept until n is another."""
        if n not in self.views:
            now, out = self.feed.cut(0, n), self.out.cut(0, n)
            self.views = {n: (self.w_cmd[:n], now, out, self._estimate(now, out))}
        return self.views[n]


def table_of(rows: Sequence[Row] | Array) -> Array:
    """Samples as an array, (n, 6)."""
    return np.asarray(rows, dtype=np.float64, order="C").reshape(-1, len(Row._fields))


def log_of(table: Array) -> Log:
    """Samples (n, 6) as a log."""
    t, z, pitch, w_cmd = table[:, 0].copy(), table[:, 1:4].copy(), table[:, 4].copy(), table[:, 5].copy()
    return Log("stream", t, z, w_cmd, pitch)


class Change(NamedTuple):
    """A verdict that is another than before: time [s] and number of the sample, the verdict, and the number of the move."""

    time_s: float
    event: Event
    moves: int
    samples: int


Judged = tuple[Estimate, list[Change]]


REST, START, STOP, BACK = "rest", "start", "stop", "back"


class Lesson:
    """The first rest of a stream, then the first start, that move to its stop, and all up to a motion the other way.

    From the first ones a logger is learned, from the last one a pitch that was not logged. shows: what is waited for; moved:
    whether the start is among the samples kept; complete: whether there is no more to wait for.
    """

    def __init__(self, table: Array | None = None, shows: str = REST) -> None:
        self.kept = [table_of([]) if table is None else table]
        self.moved, self.shows = shows != REST, shows
        self.until = np.inf
        if table is not None and len(table) and shows == START:
            self.until = table[-1, 0] + START_S
        elif table is not None and shows == BACK:
            self.until = self._end(table)
        self.complete = False

    def _end(self, rows: Array) -> float:
        """When what is waited for has shown, if it begins in these samples."""
        if self.shows == STOP:
            begun, lasts = rows[:, 5] == 0.0, STOP_S
        elif self.shows == BACK:
            begun, lasts = rows[:, 5] * self.way < 0.0, BACK_S
        else:
            return np.inf
        return float(rows[int(np.argmax(begun)), 0]) + lasts if begun.any() else np.inf

    @property
    def way(self) -> float:
        """Sign of the first command, 0 where there is none yet."""
        commanded = self.table[:, 5]
        return float(np.sign(commanded[np.flatnonzero(commanded)[:1]]).sum())

    def take(self, rows: Array) -> int:
        """Keep samples up to the end of the lesson; how many that were."""
        if np.isinf(self.until):
            self.until = self._end(rows)
        after = rows[:, 0] > self.until if self.moved else np.abs(rows[:, 5]) > 0.0
        self.complete = bool(after.any())
        taken = int(np.argmax(after)) if self.complete else len(rows)
        self.kept.append(rows[:taken].copy())
        if not self.moved and self._rows > 2 * REST_ROWS:
            self.kept = [self.table]
        return taken

    @property
    def table(self) -> Array:
        """(n, 6) samples kept."""
        joined = np.concatenate(self.kept)
        return joined if self.moved else joined[-REST_ROWS:]

    @property
    def _rows(self) -> int:
        return sum(map(len, self.kept))

    @property
    def too_long(self) -> bool:
        """Whether a move that goes on and on is no longer kept."""
        return self.shows in (STOP, BACK) and self._rows > MOVE_ROWS

    def learned(self, rig: Rig, settings: BankSettings) -> AsLogged | None:
        """What the samples kept show of the logger, None where they are too few."""
        return (
            AsLogged(log_of(self.table), rig, settings, causal=True) if len(self.table) >= LEARNABLE else None
        )

    def next_one(self, known: AsLogged | None, pitch: bool) -> "Lesson | None":
        """The lesson after this one, of which so much is known; None after the last.

        How a motor stops tells two zero offsets apart, where there are any. pitch: whether the stream has one.
        """
        if self.shows == REST:
            return Lesson(self.table, START) if len(self.table) >= LEARNABLE else None
        if self.shows == START and known is not None and known.offset:
            return Lesson(self.table, STOP)
        return None if pitch or self.shows == BACK else Lesson(self.table, BACK)


class Live:
    """One stream under way: `add` samples in order, take the changes of the verdict.

    The first samples are held until the sampling interval and the first readings are known (at most START_ROWS), and while the
    supply limits a servo whose start nobody saw.
    """

    def __init__(
        self, rig: Rig, settings: Settings, engine: str = "compiled", filter_kind: str = "ekf"
    ) -> None:
        self.rig, self.all_settings, self.engine, self.filter_kind = rig, settings, engine, filter_kind
        self.without_pitch: Rig | None = None  # the rig as filed, where the stream has no pitch
        self.way = 0.0  # sign of the first command of such a stream
        self.both_ways = False  # whether motion both ways told its pitch
        self._make_bank(settings, rig)
        modes = tuple(h.name for h in self.bank.hypotheses)
        self.settings = settings.decision
        self.labels = tuple((label_of(mode), channel_of(mode)) for mode in modes)
        self.isolator = Isolator(modes, settings.decision, consistent=False)
        self.moving = 0  # samples that the verdict rests on
        self.held: Array | None = table_of([])
        self.lesson: Lesson | None = Lesson()
        self.as_logged: AsLogged | None = None
        self.reported: tuple[str, str | None] | None = None
        self.samples = self.moves = self.faulty = 0
        self.last: Estimate | None = None

    def add(self, rows: Sequence[Row] | Array) -> Iterator[tuple[Estimate, list[Change]]]:
        """The estimate of the samples, with tested probabilities, and the changes that they bring, batch by batch."""
        table = table_of(rows)
        if self.held is not None:
            self.held = np.concatenate((self.held, table))
            if not self._ready(self.held) or at_the_limit(log_of(self.held), self.rig):
                return
            table = self._begun(self.held)
            yield from self._learning(table, self._first)
            return
        yield from self._learning(table, self._next)

    def _learning(self, table: Array, judge: Callable[[Array], Judged]) -> Iterator[Judged]:
        """What the samples say; where they complete what there is to learn of the logger, from the first rest on again."""
        while self.lesson is not None and len(table):
            taken = self.lesson.take(table)
            if taken:
                yield from self._batches(table[:taken], judge)
                table, judge = table[taken:], self._next
            if self.lesson.too_long:
                self.lesson = None
            elif self.lesson.complete:
                yield from self._taught(self.lesson)
        if len(table):
            yield from self._batches(table, judge)

    def _taught(self, lesson: Lesson) -> Iterator[Judged]:
        """What samples kept say of the logger, and with it of themselves; a start is told only now."""
        before, self.rig = self.rig, self._pitched(lesson)
        new = self.rig is not before
        known = lesson.learned(self.rig, self.all_settings.bank)
        self.lesson = lesson.next_one(known, self.without_pitch is None)
        if (lesson.shows == STOP and (known is None or not known.zero)) or (lesson.shows == BACK and not new):
            return
        if known is not None and (new or not known.same_as(self.as_logged, self.all_settings.bank)):
            e, changes = self._again(known, lesson.table)
            told = [change._replace(samples=self.samples) for change in changes[-1:]]  # others are past
            if lesson.shows == BACK:
                told = [change._replace(time_s=float(e.t[-1])) for change in told]
            yield rows_of(e, e.t.size, e.t.size), told  # the samples themselves were told before

    def _pitched(self, lesson: Lesson) -> Rig:
        """The rig with the pitch that the first motion of a stream without one shows, one way and then both."""
        if self.without_pitch is None or lesson.shows not in (START, BACK):
            return self.rig
        self.way, self.both_ways = lesson.way, lesson.shows == BACK
        log = replace(log_of(lesson.table), notes=(f"{NO_PITCH} as 0",))
        known = with_its_pitch(log, self.without_pitch, self.all_settings.bank)
        same = known.model["pitch_offset"] == self.rig.model["pitch_offset"]
        return self.rig if same else known

    def _or_another_pitch(self, event: Event) -> Event:
        """The event, shared where a stream without a pitch leaves open what it is."""
        if self.without_pitch is None or event.alike:
            return event
        going = self.lesson is not None and self.lesson.shows in (STOP, BACK)  # one way up to now
        ways = (self.way,) if going else ()
        other = another_pitch(event, self.rig, self.without_pitch, ways, one_way=not self.both_ways)
        return event if other is None else or_as_well(event, *other)

    @property
    def _in_first_start(self) -> bool:
        """Whether what the logger does is not known yet, though the motor runs: a fault may be a filter."""
        return self.lesson is not None and self.lesson.shows == START

    def _batches(self, table: Array, judge: Callable[[Array], Judged]) -> Iterator[Judged]:
        if judge == self._first:
            yield judge(table)
            return
        for first in range(0, len(table), MOST):
            yield judge(table[first : first + MOST])

    def _first(self, table: Array) -> Judged:
        """The samples that a stream begins with."""
        return self._judged(self.bank.advance(log_of(table)))

    def _next(self, table: Array) -> Judged:
        """At most MOST samples behind others."""
        if self.as_logged is not None:
            table = self.as_logged.take_rows(table)
        return self._judged(self.fast.step(table) if self.fast else self.bank.advance(log_of(table)))

    def _again(self, known: AsLogged, table: Array) -> Judged:
        """The samples kept so far, with what they show of the logger."""
        self.as_logged = known
        self._make_bank(replace(self.all_settings, bank=known.settings), known.rig)
        self.isolator = Isolator(self.isolator.modes, self.settings, consistent=False)
        self.samples -= len(table)
        self.moves = self.moving = self.faulty = 0  # what is judged again holds the first move, if any
        return self._first(known.take_rows(table))

    def finish(self) -> Iterator[tuple[Estimate, list[Change]]]:
        """What the samples say that were still held when the stream ended."""
        if self.held is not None and self.held.size:
            yield from self._batches(self._begun(self.held), self._first)
        yield from self._cut_short()
        yield from self._answered()

    def _cut_short(self) -> Iterator[Judged]:
        """What the first start says, where the stream ended in it."""
        if not self._in_first_start or self.lesson is None or self.last is None:
            return
        yield from self._taught(self.lesson)
        e, event = self.last, self.verdict()
        if event.label != NOT_TESTED and certainty(event) >= self.settings.isolated:
            yield rows_of(e, e.t.size, e.t.size), list(self._told_late(event, self.moves, e, e.t.size - 1))

    def _answered(self) -> Iterator[Judged]:
        """What a question that is open, or would have been asked, says of the last move."""
        tracker, last = self.isolator.current, self.last
        if self.word is None or self.fast is None or last is None or tracker is None:
            return
        told = self.word.at_the_end(float(last.t[-1]), tracker.verdict(), self.fast.ring)
        if told is not None:
            change = list(self._told_late(told, self.moves, last, last.t.size - 1))
            yield rows_of(last, last.t.size, last.t.size), change

    def _in_a_corner(self, event: Event, tracker: EventTracker) -> bool:
        """Whether a fault is that of a few samples only, where what a filter leaves at a corner of the command may be one."""
        filtered = self.as_logged is not None and self.as_logged.low_passes.any
        return filtered and event.label != NOMINAL and tracker.held < SETTLING

    def _told_before(self, word: StreamWord, e: Estimate, k: int) -> Iterator[Change]:
        """What a question that is still open says of the move before the one that begins at sample k."""
        asked = word.question
        told = word.answered()
        if asked is not None and told is not None:
            self.faulty += (told.label != NOMINAL) - (asked.event.label != NOMINAL)
            yield from self._told_late(told, self.moves - 1, e, k)

    def _told_late(self, told: Event, moves: int, e: Estimate, k: int) -> Iterator[Change]:
        """The verdict on a move that has ended, at sample k."""
        told = self._or_another_pitch(told)
        if not self._already_reported(told):
            self.reported = told.label, told.channel
            yield Change(float(e.t[k]), told, moves, self.samples - e.t.size + k + 1)

    def _begun(self, table: Array) -> Array:
        """The first samples, (n, 6), from where the servo is known on; the bank is fitted to what they show of the readings."""
        first = known_from(log_of(table), self.rig)
        self.held, self.samples, table = None, first, table[first:]
        bank = for_readings(self.all_settings.bank, self.rig, table[:, 1:4])
        if bank is not self.all_settings.bank:
            self._make_bank(replace(self.all_settings, bank=bank), self.rig)
        return table

    def _make_bank(self, settings: Settings, rig: Rig) -> None:
        compiled = self.engine == "compiled"
        self.fast = LiveBank(rig, settings.bank, self.filter_kind) if compiled else None
        self.bank = self.fast or make_bank(rig, settings, self.engine, self.filter_kind)
        self.word = StreamWord(rig, settings, self.fast) if self.fast else None

    @staticmethod
    def _ready(table: Array) -> bool:
        if len(table) >= beginning.START_ROWS:
            return True
        seen = np.isfinite(table[:, 1:4]).sum(axis=0)
        return len(table) > feed.SETTLING and bool((seen >= beginning.START_READINGS).all())

    def verdict(self) -> Event:
        """The verdict on the move under way, or on the last one."""
        tracker = self.isolator.current
        if tracker is None or not self._tested():
            return log_verdict([])
        event = self._said(tracker.verdict())
        return log_verdict([]) if self._waits(event) else event

    def _waits(self, event: Event) -> bool:
        """Whether a fault is not told yet: in the first start it may be what the logger does."""
        return self._in_first_start and event.label != NOMINAL

    def _said(self, event: Event) -> Event:
        """The bank's verdict on a move, or what the whole move said."""
        return self._or_another_pitch(event if self.word is None else self.word.said(event))

    def _tested(self) -> bool:
        return self.moving >= FEWEST_MOVING

    def _judged(self, e: Estimate) -> tuple[Estimate, list[Change]]:
        self.samples += e.t.size
        e = self.last = tested(e, self.settings)
        return e, list(self._changes(e) if e.t.size > 1 else self._sample(e, 0))

    def _changes(self, e: Estimate) -> Iterator[Change]:
        """Sample by sample where a move begins or ends, the stretches between them at once."""
        flips = np.flatnonzero(e.active != np.append(self.isolator.was_active, e.active[:-1]))
        first = 0
        for k in flips.tolist():
            yield from self._stretch(e, first, k)
            yield from self._sample(e, k)
            first = k + 1
        yield from self._stretch(e, first, e.t.size)

    def _stretch(self, e: Estimate, first: int, last: int) -> Iterator[Change]:
        """At once where no sample can change the verdict, else each half for itself."""
        due = last if self.word is None else first + int(np.searchsorted(e.t[first:last], self.word.next_s))
        if due < last and last - first > 2:
            yield from self._stretch(e, first, due)
            yield from self._sample(e, due)
            yield from self._stretch(e, due + 1, last)
            return
        if last - first > 2:
            if (e.active[first] and not self._tested()) or not self._quiet(rows_of(e, first, last)):
                middle = (first + last) // 2
                yield from self._stretch(e, first, middle)
                yield from self._stretch(e, middle, last)
            return
        for k in range(first, last):
            yield from self._sample(e, k)

    def _sample(self, e: Estimate, k: int) -> Iterator[Change]:
        """The verdict where it is certain, or its move has ended, and is another than the one last told."""
        row = rows_of(e, k, k + 1)
        self._track(self.isolator, row)
        self.moving += 0 if self._tested() else moving_samples(row)
        tracker = self.isolator.current
        if tracker is None or not self._tested():
            return
        event = of_bank = tracker.verdict()
        if self.word is not None and self.fast is not None:
            if event.start_s != self.word.start_s:
                yield from self._told_before(self.word, e, k)
            self.word.follow(float(e.t[k]), event, bool(e.active[k]), self.fast.ring)
        event = self._said(event)
        sure = event.probability if event is of_bank else certainty(event)
        if self._waits(event) or self._in_a_corner(event, tracker):
            return
        if self._already_reported(event) or (e.active[k] and sure < self.settings.isolated):
            return
        self.reported = event.label, event.channel
        yield Change(float(e.t[k]), event, self.moves, self.samples - e.t.size + k + 1)

    def _already_reported(self, event: Event) -> bool:
        return (event.label, event.channel) == self.reported

    def _quiet(self, e: Estimate) -> bool:
        """Take samples at once if none of them can change the verdict; else leave everything as it was.

        The samples go on as the one before them: all in motion, or all at rest.
        """
        before = self.isolator.current
        winner = e.probability.argmax(axis=1)
        if before is not None:
            calm = (winner == winner[0]).all() if e.active[0] else before.rests_calmly(e.nis)
            if not calm:
                return False
        trial = copy.deepcopy(self.isolator, {id(self.settings): self.settings})
        self._track(trial, e)
        now = trial.current
        if before is None or now is None:
            quiet = before is now
        else:
            quiet = now.grounds() == before.grounds() and self._silent(
                self._said(now.verdict()), e, int(winner[0])
            )
        if quiet:
            self.isolator = trial
        return quiet

    def _silent(self, event: Event, e: Estimate, winner: int) -> bool:
        """Whether no sample tells the verdict of the last one, where all of them have the same."""
        if self._already_reported(event):
            return True
        if not e.active[0] or event.probability >= self.settings.isolated:
            return False
        its = [j for j, (label, _) in enumerate(self.labels) if label == event.label or j == winner]
        return bool((e.probability[:, its].sum(axis=1) < self.settings.isolated).all())

    def _track(self, isolator: Isolator, e: Estimate) -> None:
        move = isolator.current
        for _ in isolator.add(e):
            pass
        self.moves += isolator.current is not move
        for event in isolator.events:
            self.faulty += self._said(event).label != NOMINAL
        isolator.events.clear()


def certainty(event: Event) -> float:
    """Probability of the verdict or of what cannot be told from it."""
    return sum(event.posterior[label] for label in (event.label, *event.alike))


def rows_of(e: Estimate, first: int, last: int) -> Estimate:
    """Samples first:last of an estimate."""
    if last - first == e.t.size:
        return e
    return replace(e, **{name: getattr(e, name)[first:last] for name in _ROWS})


_ROWS = ("t", "probability", "nis", "predicted", "normalised", "states", "active", "density", "strain")
