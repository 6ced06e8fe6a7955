"""The last word on a move of a stream, while it goes on: what has no name is asked as a whole move is.

The bank never comes back from `unknown`: the free hypothesis explains everything. A question runs on a thread of its own over
the samples kept so far, and its answer is told a fixed time of the stream's clock later: the same stream gives the same
lines, and no sample waits for it unless the machine is slower than that.
"""

import copy
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import FAULTS, NOMINAL, UNKNOWN, Rig
from observer_fi.records import Event
from observer_fi.serve.recent import Recent
from observer_fi.settings import Settings
from observer_fi.verdict import Filters, LastWord

ASK_S = 0.4  # after the verdict became unknown: what tells faults apart has shown by then
REST_S = 0.2  # after a move that was healthy in the end but doubted: its stop belongs to it
LONG_REST_S = 0.8  # after a move of which an answer left two: a sensor that drifts goes on at rest
ANSWER_S = 1.0  # from a question to its answer
BEFORE_S = 1.0  # of motion before the fault that are asked
MOST_PAUSE_S = 300.0  # between two questions, where answers bring nothing


class Question(NamedTuple):
    """What was asked of a move, when its answer is due [s], and the answer."""

    event: Event
    due_s: float
    answer: Future[Event]


class StreamWord:
    """Asks about the moves of a stream. next_s: when it wants to see the next sample [s]."""

    def __init__(self, rig: Rig, settings: Settings, bank: Bank) -> None:
        self.settings, self.bank = settings, bank
        self.last_word = LastWord(rig, Filters(rig, settings.bank), settings.decision)
        self.thread = ThreadPoolExecutor(1)
        self.question: Question | None = None
        self.told: tuple[str, Event] | None = None  # the label that was asked about, and the answer
        self.start_s, self.ask_s = np.nan, np.inf
        self.rests = 0  # how often the rest after the move was waited for
        self.doubted_s: float | None = (
            None  # when a fault was first detected in the move, which the bank may forget
        )
        self.pause: dict[str, float] = {}  # by the label that was asked about
        self.not_before: dict[str, float] = {}

    @property
    def next_s(self) -> float:
        """Time of the sample at which something is asked or told [s], infinite where none is known."""
        return min(self.ask_s, np.inf if self.question is None else self.question.due_s)

    def said(self, event: Event) -> Event:
        """The verdict of the bank, or what the whole move said of it."""
        if self.told is None:
            return event
        label, told = self.told
        if event.label != label or told.start_s != event.start_s:
            return event
        return told._replace(end_s=event.end_s)

    def follow(self, t: float, event: Event, under_way: bool, recent: Recent) -> None:
        """Look at a sample: t [s], the verdict of the bank on its move, whether the motor is driven."""
        if event.start_s != self.start_s:
            self.start_s, self.told, self.question = event.start_s, None, None
            self.ask_s, self.rests, self.doubted_s = np.inf, 0, None
        event = self._doubted(event)
        if self.question is not None and t < self.question.due_s:
            return
        self.answered()
        if not under_way and not self.rests and event.label == NOMINAL:
            self.ask_s = np.inf  # the rest after a move is the better time
        if self._settled(event, under_way) or not self._open(event, under_way):
            self.ask_s = np.inf
        elif t >= self.ask_s:
            self._ask(t, event, recent)
        elif self.ask_s == np.inf and (under_way or self.rests < self._most_rests()):
            self.rests += not under_way
            self.ask_s = self._when(t, event, under_way, recent)

    def at_the_end(self, t: float, event: Event, recent: Recent) -> Event | None:
        """What is said of the move with which a stream ends, asked now where that would have come later."""
        told, event = self.answered(), self._doubted(event)
        waits = self.ask_s < np.inf or not self.rests or self._unsure()
        if waits and not self._settled(event, False) and self._open(event, False):
            self._ask(t, event, recent)
        return self.answered() or told

    def _doubted(self, event: Event) -> Event:
        """The verdict of the bank with the first doubt of its move, be it forgotten in the end."""
        if self.doubted_s is None:
            self.doubted_s = event.detected_s
        forgotten = event.label == NOMINAL and event.doubted_s is None
        return event._replace(doubted_s=self.doubted_s) if forgotten else event

    def _when(self, t: float, event: Event, under_way: bool, recent: Recent) -> float:
        """When to ask about a move [s]: one that is healthy again but was doubted at its end, or before its samples are gone."""
        if under_way and event.label == NOMINAL:
            return recent.safe_until(self._first_s(event))
        wait = ASK_S if under_way else LONG_REST_S if self._unsure() else REST_S
        return max(t + wait, self.not_before.get(event.label, -np.inf))

    def _settled(self, event: Event, under_way: bool) -> bool:
        """Whether the verdict of the bank was asked about, and the answer is sure or waits for the rest after the move."""
        told = self.told is not None and self.told[0] == event.label
        return told and (under_way or not self._unsure())

    def _unsure(self) -> bool:
        """Whether an answer left two: a rest may tell them apart."""
        return self.told is not None and self.told[1].probability < self.settings.decision.isolated

    def _most_rests(self) -> int:
        return 2 if self._unsure() else 1

    @staticmethod
    def _first_s(event: Event) -> float:
        """From where on a move is asked about [s]."""
        doubted = event.detected_s or event.doubted_s
        return event.start_s if doubted is None else max(event.start_s, doubted - BEFORE_S)

    def _open(self, event: Event, under_way: bool) -> bool:
        """Whether a move has no name, is healthy after a doubt, or has ended with a fault that has a size."""
        if event.label == UNKNOWN:
            return event.probability > self.settings.decision.isolated
        if event.label == NOMINAL:
            return event.doubted_s is not None
        return not under_way and any(own.tells for own in FAULTS[event.label].sizes)

    def _ask(self, t: float, event: Event, recent: Recent) -> None:
        """Ask about the move as far as the sample at t [s]."""
        self.ask_s, doubted = np.inf, event.detected_s or event.doubted_s
        found = None if doubted is None else recent.between(self._first_s(event), t)
        if found is None:
            return
        window, memory = found
        begin = float(window.t[0])
        bank = copy.copy(self.bank)
        bank.recent, bank.snapshots = window, deque([(begin, memory)])
        asked = event._replace(start_s=max(event.start_s, begin))
        self.question = Question(event, t + ANSWER_S, self.thread.submit(self.last_word.on, asked, bank))

    def answered(self) -> Event | None:
        """The answer of the question that is open, for which the thread may still be at work; None where none is open.

        Where it says nothing new, the next such question waits longer.
        """
        if self.question is None:
            return None
        label = self.question.event.label
        told = self.question.answer.result()._replace(start_s=self.question.event.start_s)
        if told.label == label:
            self.pause[label] = min(2.0 * self.pause.get(label, ASK_S), MOST_PAUSE_S)
            self.not_before[label] = self.question.due_s + self.pause[label]
        else:
            self.pause[label], self.told = ASK_S, (label, told)
        self.question = None
        return told if told.label != label else None
