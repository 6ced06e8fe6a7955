"""Two faults in one move, weighed as one story against what explains it alone.

`second_fault.py` has when the first one stops explaining the samples, and the move behind it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.physics import NOMINAL, UNKNOWN
from observer_fi.records import Event
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import EVERYDAY, of_every_day
from observer_fi.verdict.moves.naming import Naming
from observer_fi.verdict.moves.second_fault import MISFIT, SUSPECT, WINDOW_S, behind, lasted, until
from observer_fi.verdict.moves.stories import (
    Story,
    follows_whole,
    in_order,
    load_of_a_spring,
    takes_up_any_load,
    worth,
)
from observer_fi.verdict.moves.whole_move import LEFT, STRIDE, Path, WholeMove

BEFORE_S = 0.2  # that a second fault may have begun before the first one stops explaining the samples
SECONDS = 3  # labels that may be the second of two faults
TOGETHER_S = 0.1  # between the begins of two faults that may be one
# Times the nats of another fault, by which two must explain what one whose size changes does as well.
CLEARLY = 6.0


class Explained(NamedTuple):
    """nats: of the samples of a move in motion under what explains it best. gain: how much of that is over nominal."""

    nats: float
    gain: float


class Pair(NamedTuple):
    """A move with two faults, and what they explain of it."""

    event: Event
    explained: Explained


class Pairs:
    """Looks for second faults among what `naming` may call the paths of a move."""

    def __init__(self, naming: Naming, settings: DecisionSettings) -> None:
        self.naming, self.settings = naming, settings

    def of(
        self, paths: Sequence[Path], stories: Sequence[Story], event: Event, whole: WholeMove
    ) -> Pair | None:
        """The event with a second fault behind the first one, where that explains the move only until then; else None.

        Where the free hypothesis follows the move better than the best name does, two faults may have met there.
        """
        named = bool(stories) and not takes_up_any_load(stories[0].path)
        found = self._suspected(stories, event, whole) if named else None
        more = self.settings.move_nats
        if found or (named and paths[0].gain < stories[0].gain + more):
            return found
        firm = (
            p for p in reversed(paths) if not takes_up_any_load(p) and self.naming.counts(p, whole, event)
        )
        tried = sorted({p.hypothesis.label: p for p in firm}.values(), key=lambda p: -p.gain)
        # of a lesser fault before it a great one leaves no trace
        before = [p.first - STRIDE for p in tried[:SECONDS]]
        if tried and tried[0].end is not None:  # it seems over where another one takes its place
            before.insert(0, tried[0].end - STRIDE)
        found = self._behind(tried, before, stories, event, whole)
        at_will = named or (found is not None and (found.event, *found.event.then)[-1].label == UNKNOWN)
        least = -math.inf if not stories else stories[0].gain + more if at_will else worth(stories[0])
        return found if found and found.explained.gain >= least else None

    def _suspected(self, stories: Sequence[Story], event: Event, whole: WholeMove) -> Pair | None:
        """A second fault where the best story no longer explains the move, or only by a size that changes there."""
        told = [stories[0].path]
        found = self._behind(told, (), stories, event, whole)
        if found is not None or not any(own.growth for own in told[0].hypothesis.own):
            return found
        found = self._behind(told, (), stories, event, whole, SUSPECT)
        enough = stories[0].gain + CLEARLY * self.settings.move_nats
        return found if found and found.explained.gain >= enough else None

    def _behind(
        self,
        tried: Sequence[Path],
        before: Sequence[int],
        stories: Sequence[Story],
        event: Event,
        whole: WholeMove,
        misfit: float = MISFIT,
    ) -> Pair | None:
        """A second fault from where one of some paths no longer explains the move, or from one of some samples on."""
        ends = {found.until for p in tried if (found := lasted(p, whole, misfit)) is not None}
        stops = [end - round(WINDOW_S / whole.interval) for end in sorted(ends, reverse=True)[:SECONDS]]
        at_once: list[Pair] = []
        for stop in (*stops, *before):
            pair = self._pair(event, whole, stop)
            if pair is not None and not _together(pair.event):
                return pair
            at_once += [] if pair is None else [pair]
        one = bool(stories) and stories[0].mode != UNKNOWN  # an obstacle that comes with a load is one fault
        return at_once[0] if at_once and not one else None

    def _pair(self, event: Event, whole: WholeMove, stop: int, again: bool = True) -> Pair | None:
        """The event with the fault that explains the move as far as a sample, and another behind it; None without either.

        A load that has only risen as friction does on any day is no first fault: the one behind it is told.
        """
        shorter = until(whole, stop)
        if shorter is None:
            return None
        first = self._one(event, shorter, 0, shorter.n)
        if first is None or first[0].label == UNKNOWN:
            return None
        told, path = first
        held = lasted(path, whole)
        rest = None if held is None else behind(held, whole)
        if held is None or rest is None:
            return None
        about = held.until - held.since
        healthy = event._replace(label=NOMINAL, start_s=float(rest.window.t[0]))
        before, window = (round(time / whole.interval) for time in (BEFORE_S, WINDOW_S))
        second = self._one(healthy, rest, about - before, about + window + LEFT)
        if second is None:
            return None
        later = second[0]._replace(start_s=event.start_s)
        both = later if self._is_of_a_day(told, path) else _with(told, later)
        behind_it = rest.in_motion() - rest.in_motion(max(shorter.n - held.since, 0))
        nats = shorter.in_motion() + path.gain + behind_it + second[1].gain
        pair = Pair(both, Explained(nats, nats - whole.in_motion()))
        begun = held.since + second[1].begin
        # Where less than that is left to the first fault, the second one is all there is.
        alone = begun - path.begin >= LEFT
        if again and begun < stop:  # what came first is told from what was before the second one
            return self._pair(event, whole, begun, again=False) or (pair if alone else None)
        return pair if alone else None

    def _is_of_a_day(self, told: Event, path: Path) -> bool:
        """Whether what a first fault adds to the load, without taking any of the travel, is what friction rises by on any day."""
        if told.label == "overload" and follows_whole(path):
            return load_of_a_spring(path)[0] < EVERYDAY * self.naming.rig.model["A"]
        return told.label == "jam" and of_every_day(told)

    def _one(self, event: Event, whole: WholeMove, first: int, last: int) -> tuple[Event, Path] | None:
        """The event with the best story that begins between two samples, and its path; None where there is none."""
        stories = in_order(self.naming.told_by(whole.paths(first, last), whole, event))
        return (self.naming.told(event, stories, whole), stories[0].path) if stories else None


def _together(pair: Event) -> bool:
    """Whether two faults of a move begin at one time."""
    begins = [event.onset_s for event in (pair, *pair.then) if event.onset_s is not None]
    return len(begins) > 1 and float(np.ptp(begins)) < TOGETHER_S


def _with(told: Event, later: Event) -> Event:
    """The event with a second fault; of a position that stands behind a jam both that may be: a motor that turns freely may feel
    the jam, as with a dead sensor."""
    if told.label == "jam" and later.channel == "position" and not later.alike:
        posterior = dict.fromkeys(later.posterior, 0.0) | {later.label: 0.5, "coupling_loss": 0.5}
        later = later._replace(probability=0.5, posterior=posterior, alike=("coupling_loss",))
    return told._replace(then=(later,))
