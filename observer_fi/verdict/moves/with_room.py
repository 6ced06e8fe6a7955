"""A faulty move judged again with room for what a day brings: a torque of a few percent that swells, ripples or is told late.

Unlearned, how large the error of an equation is has two values: that of the paper's rig and that of a usual day. A move that
the second one explains as well as any fault with the first one is judged by it; what its room is too small for is a fault.
"""

import math
from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import ROOMS, Bank, HypothesisState, LogSamples, with_room
from observer_fi.physics import NOMINAL, UNKNOWN, Rig
from observer_fi.records import Estimate, Event
from observer_fi.settings import Settings
from observer_fi.verdict.drift import COMES_AND_GOES, Drift, of_every_day, or_else
from observer_fi.verdict.isolate import EventTracker, healthy, log_likelihood, rows_of, shown_by_rest, tested
from observer_fi.verdict.last_word import LastWord
from observer_fi.verdict.moves.pairs import Explained
from observer_fi.verdict.moves.whole_move import SETTLED_S, WholeMove, window_of
from observer_fi.verdict.onset import Filters

AT_WILL = ("jam", UNKNOWN)  # faults that follow any torque, and so also one of every day
STANDS = 8  # verdicts in a row that room did not change
# Probability from which another label is as good: what wanders is like the slow rise by which an obstacle differs from a slip.
ALIKE = 1e-4
LITTLE = 0.1  # of what a fault explains without room


class Banks(NamedTuple):
    """A bank with room, and the last word by its filters."""

    bank: Bank
    word: LastWord


class WithRoom:
    """Judges moves of a rig of which no healthy log has shown the errors of its equations; banks are made once a log."""

    def __init__(self, rig: Rig, settings: Settings) -> None:
        self.rig, self.settings = rig, settings
        self.usual: Bank | None = None
        self.rooms: list[Banks] = []
        self.stood: Counter[tuple[str, str | None]] = Counter()

    def on(self, event: Event, bank: Bank, found: Explained | None) -> Event:
        """The event as it is with room, where that explains the move. bank: with its samples at hand; found: the best story.

        A fault that stood so many times in a row is asked about no more in its log.
        """
        if self.stood[event.label, event.channel] >= STANDS:
            return event
        told = self._with_room(event, bank, found)
        self.stood[event.label, event.channel] = (
            self.stood[event.label, event.channel] + 1 if told is event else 0
        )
        return told

    def _with_room(self, event: Event, bank: Bank, story: Explained | None) -> Event:
        if self.rig.errors or event.label == NOMINAL or NOMINAL in event.alike or shown_by_rest(event):
            return event
        found = window_of(event, bank)
        if found is None:
            return event
        usual = self._made()
        known = max(log_likelihood(usual.again(*found)), -math.inf if story is None else story.nats)
        tried = [(room, room.bank.again(*found)) for room in self.rooms]
        best, estimate = max(tried, key=lambda one: log_likelihood(one[1]))
        margin = self.settings.decision.move_nats * (-1.0 if event.label in AT_WILL else 1.0)
        if log_likelihood(estimate) < known + margin:
            return event
        best.bank.recent = bank.recent
        told = self._judged(event, estimate, best)
        if told.label == "jam" and of_every_day(told) and of_every_day(event):
            return _or_a_day(event)
        same = (told.label, told.channel) == (event.label, event.channel)
        little = told.label == NOMINAL or _explains_little(best.word.explained.get(event.start_s), story)
        if same or (little and self._goes_on(event, *found, best.word)):
            return event
        return _or_a_day(event) if told.label == NOMINAL and event.label == "jam" else told

    def _made(self) -> Bank:
        """The usual bank; those with room are made with it."""
        if self.usual is None:
            self.usual = Bank(self.rig, self.settings.bank)
            decision = replace(self.settings.decision, alike=ALIKE)
            for settings in (with_room(self.settings.bank, room) for room in ROOMS):
                word = LastWord(self.rig, Filters(self.rig, settings), decision)
                self.rooms.append(Banks(Bank(self.rig, settings), word))
        return self.usual

    def _judged(self, event: Event, estimate: Estimate, room: Banks) -> Event:
        """The verdict of the bank with room, and the last word on it."""
        e = tested(estimate, self.settings.decision)
        tracker = EventTracker(e.modes, event.start_s, self.settings.decision, drift=Drift())
        step = float(np.median(np.diff(e.t)))
        tracker.add(rows_of(e, e.t >= event.start_s), step)
        told = tracker.verdict()._replace(end_s=event.end_s)
        doubts = (told.doubted_s, event.doubted_s, event.detected_s, event.onset_s)
        told = told._replace(doubted_s=min((s for s in doubts if s is not None), default=None))
        return room.word.on(told, room.bank)

    def _goes_on(self, event: Event, window: LogSamples, memory: HypothesisState, word: LastWord) -> bool:
        """Whether the friction of nominal goes farther within the move than it comes and goes."""
        whole = WholeMove(word.known()[:1], window, memory, word.filters)
        if "A" not in whole.nominal.states:
            return False
        k, settled = whole.nominal.states.index("A"), event.start_s + SETTLED_S
        friction = [float(m.x[k]) for m in whole.memories if m.t[0] > settled]
        return bool(friction) and float(np.ptp(friction)) > COMES_AND_GOES


def _explains_little(with_room: Explained | None, without: Explained | None) -> bool:
    """Whether what a fault explains is next to nothing beside what it does without room: then the room explains the move."""
    return with_room is not None and without is not None and with_room.gain < LITTLE * without.gain


def _or_a_day(event: Event) -> Event:
    """Health, or else the jam that the event has: a friction that rose a little, and one of that day, look alike."""
    health = healthy(event)
    if event.label != "jam" or health.label != NOMINAL:
        return health
    return or_else(health, "jam")
