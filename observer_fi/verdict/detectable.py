"""What a healthy move could have shown: of each fault the smallest severity that the whole move would have told.

A fault held at some sizes is entered in the middle of the move. What it costs in likelihood on the healthy samples is, for
models that differ by their means, what nominal would lose if there were one: half the squared distance of the two, in
which constants that either may still move have moved already (Kullback and Leibler 1951).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, Hypothesis, HypothesisState, LogSamples, of_a_move
from observer_fi.numerics import MOST
from observer_fi.physics import (
    FAULTS,
    NOMINAL,
    PARAMETERS,
    UNLEARNED,
    FaultRow,
    Least,
    OwnState,
    Rig,
    words_of,
)
from observer_fi.records import Array, CouldShow, Detectable, Event
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import LIMIT, TIMES_S, largest_means
from observer_fi.verdict.moves.naming import CLEAN_S, PASSES_S
from observer_fi.verdict.moves.whole_move import CHANGE_NATS, FITS, LEFT, window_of
from observer_fi.verdict.onset import ROOM, Entry, Filters

# What shows later than this after its begin is not counted: what grows slowly must first be doubted.
SEEN_S = 2.0 * max(TIMES_S)
TIMED = 2.0  # times the nats of a verdict, with which a fault is not only found but its begin told
GROSS_RISE = 0.5
SURE = 1.645  # standard deviations of the evidence: 19 such faults of 20 give as much


class Half(NamedTuple):
    """A healthy move from its middle on: samples, what nominal remembers before them, its log-densities (n,) and innovations
    over their deviations (n, 3).

    direction: sign of the speed; interval: between samples [s].
    """

    window: LogSamples
    memory: HypothesisState
    density: Array
    normalised: Array
    direction: float
    interval: float


def could_show(
    asked: Iterable[Event], bank: Bank, filters: Filters, settings: DecisionSettings
) -> CouldShow | None:
    """What the first of these healthy moves could have shown whose samples are at hand.

    None where there is none, it is too short, or the rig file does not describe it.
    """
    hypotheses = of_a_move(filters.rig, filters.settings)
    halves = (_second_half(event, bank, hypotheses[0], filters) for event in asked)
    half = next((half for half in halves if half is not None), None)
    if half is None:
        return None
    least, blind = [], []
    for label, row in FAULTS.items():
        if row.least is None:
            continue
        free = next(h for h in hypotheses if h.label == label)
        trial = _Trial(row, row.least, (hypotheses[0], free), half, filters)
        nats = TIMED * settings.move_nats
        told = trial.shortest(nats) if row.least.lasts else trial.smallest(nats)
        if told is None:
            blind.append(label)
        else:
            least.append(_told(row, row.least, told, filters.rig))
    return CouldShow(float(half.window.t[0]), tuple(least), tuple(blind))


def or_unseen(event: Event, could: CouldShow | None, unread: Sequence[str], rig: Rig) -> Event:
    """A healthy event, or as well what it shows at no size because channels tell nothing, or no log has shown the friction.

    unread: the columns of these channels.
    """
    if event.label != NOMINAL or event.alike or could is None:
        return event
    if could.blind and unread:
        why = f"without {' and '.join(unread)} nothing shows {' or '.join(map(words_of, could.blind))}"
        return _as_well(event, could.blind, why)
    hidden = tuple(dict.fromkeys((*could.blind, *(d.label for d in could.least if _is_gross(d)))))
    if hidden and "A" in rig.quantities and rig.quantities["A"].method in UNLEARNED:
        told = "; ".join(d.words for d in could.least if d.label in hidden) or "at no size"
        why = (
            f"the friction of the rig file is a guess, beside which {' or '.join(map(words_of, hidden))} would hardly show "
            f"({told}): learn the rig from healthy moves first (observer-fi identify)"
        )
        return _as_well(event, hidden, why)
    return event


def _is_gross(least: Detectable) -> bool:
    """Whether friction must rise by a half at least before a log shows it."""
    return least.name == "friction_rise" and least.value > GROSS_RISE


def _as_well(event: Event, alike: tuple[str, ...], why: str) -> Event:
    """A healthy event, or as likely one of these."""
    share = 1.0 / (1 + len(alike))
    posterior = dict.fromkeys(event.posterior, 0.0) | dict.fromkeys((NOMINAL, *alike), share)
    return event._replace(probability=share, posterior=posterior, alike=alike, reasons=(*event.reasons, why))


def _second_half(event: Event, bank: Bank, nominal: Hypothesis, filters: Filters) -> Half | None:
    """The longest motion of the move one way, from its middle on, as long as what happens there is looked for."""
    found = window_of(event, bank)
    if found is None:
        return None
    window, memory = found
    middle, n = _one_way(window, event.start_s)
    if n < LEFT:
        return None
    alone = filters.of(nominal, 1, max(n, ROOM))
    alone.begin(memory)
    alone.density(window, 0, middle)
    before = alone.memory()
    density = alone.density(window, middle, middle + n)[:, 0].copy()
    rest = window.cut(middle, middle + n)
    if float(np.nan_to_num(alone.misfit(n)).mean()) > FITS * float(np.isfinite(rest.z).mean(axis=0).sum()):
        return None
    direction, interval = float(np.sign(window.w_cmd[middle])), float(np.median(np.diff(rest.t)))
    return Half(rest, before, density, alone.normalised(n).copy(), direction, interval)


def _one_way(window: LogSamples, start_s: float) -> tuple[int, int]:
    """The middle of the longest motion one way, and the samples of it from there on, none where what is before is too short."""
    first = int(np.searchsorted(window.t, start_s))
    turns = np.flatnonzero(np.diff(np.sign(window.w_cmd[first:]))) + 1 + first
    edges = np.array([first, *turns, window.t.size])
    longest = int(np.diff(edges).argmax())
    begin, end = int(edges[longest]), int(edges[longest + 1])
    middle = (begin + end) // 2
    if window.t[middle] - window.t[begin] < CLEAN_S:
        return middle, 0
    return middle, min(end, int(np.searchsorted(window.t, window.t[middle] + SEEN_S))) - middle


class _Trial:
    """One fault tried on a healthy move. pair: nominal, and the fault with constants that nobody knows."""

    def __init__(
        self, row: FaultRow, least: Least, pair: tuple[Hypothesis, Hypothesis], half: Half, filters: Filters
    ) -> None:
        self.row, self.least, self.half, self.filters = row, least, half, filters
        self.nominal, self.free = pair
        known = [o._replace(std=0.0, growth=0.0) if o.tells else o for o in row.sizes]
        self.fault = replace(self.free, own=tuple(known))
        self.own = next(o for o in row.sizes if o.name == least.constant)
        self.entered = self._entered(self.fault)
        self.n = half.window.t.size

    def smallest(self, nats: float) -> float | None:
        """The least value of the fault's constant that is told if it lasts to the end; None where the largest tried is not.

        Evidence grows with the square of the size, a straight line in logarithms, and means of innovations with the size.
        """
        sizes, least = np.log(self.least.tried), self.own.low
        evidence = np.maximum.accumulate(np.maximum(self._lost()[-1], 1e-9))
        share = np.log(evidence / _expected(nats + CHANGE_NATS + self._price()))
        if share[-1] < 0.0:
            return None
        enough = sizes[0] - 0.5 * share[0] if share[0] > 0.0 else np.interp(0.0, share, sizes)
        value = float(np.exp(enough))
        shown = float(self._means(value).max())
        if shown <= 0.0:
            return None
        value *= max((LIMIT + SURE) / shown, 1.0)
        return max(value, least) if value <= self.least.tried[-1] else None

    def shortest(self, nats: float) -> float | None:
        """How long the fault must last to be told [s], whatever its constant is; None where the move is too short."""
        lost = self._lost()
        told = lost.min(axis=1) >= _expected(nats + 2.0 * CHANGE_NATS)
        hidden = self.least.tried[int(lost[int(told.argmax())].argmin())]
        told &= np.maximum.accumulate(self._means(hidden)) >= LIMIT + SURE
        if not told.any():
            return None
        return max((int(told.argmax()) + 1) * self.half.interval, PASSES_S)

    def _entered(self, fault: Hypothesis) -> HypothesisState:
        return Entry(self.nominal, fault, self.filters, within_s=self.half.interval)(self.half.memory)

    def _at(self, value: float) -> HypothesisState:
        """The fault's memory when it begins with a value of its constant."""
        x, sizes = self.entered.x.copy(), {**self.least.held, self.least.constant: value}
        for own in self.row.sizes:
            if own.tells:
                x[self.fault.states.index(own.name)] = sizes[own.name] * self._unit(own)
        return self.entered._replace(x=x)

    def _unit(self, own: OwnState) -> float:
        """What turns the value of a fault's constant into the state of a filter."""
        friction = self.half.direction * self.filters.rig.model["A"]
        return 1.0 / own.mean if own.absolute else friction if own.of_friction else 1.0

    def _lost(self) -> Array:
        """Nats that the fault has lost to nominal up to each sample, (n, k) for the k values that it is tried with.

        Where these leave room, the mean over both signs: what the noise of these samples adds to one it takes from the other.
        """
        signs = (1.0,) if 2 * len(self.least.tried) > MOST else (1.0, -1.0)
        side_by_side = self.filters.of(self.fault, MOST, ROOM)
        side_by_side.begin(self.entered)
        for k, value in enumerate(sign * tried for sign in signs for tried in self.least.tried):
            side_by_side.put(k, self._at(value))
        density = side_by_side.density(self.half.window, 0, self.n)[:, : len(signs) * len(self.least.tried)]
        lost = np.cumsum(self.half.density[:, None] - density, axis=0)
        return lost.reshape(self.n, len(signs), -1).mean(axis=1)

    def _price(self) -> float:
        """Nats that the fault loses because nobody knows its constants beforehand."""
        alone = self.filters.of(self.free, 1, ROOM)
        alone.begin(self._entered(self.free))
        return max(float((self.half.density - alone.density(self.half.window, 0, self.n)[:, 0]).sum()), 0.0)

    def _means(self, value: float) -> Array:
        """Means of innovations that the fault would have brought to nominal, over their deviations, at each sample (n,)."""
        alone = self.filters.of(self.fault, 1, max(self.n, ROOM))
        alone.begin(self._at(value))
        alone.density(self.half.window, 0, self.n)
        return largest_means(self.half.normalised - alone.normalised(self.n), self.half.interval)


def _expected(nats: float) -> float:
    """Expected evidence of a fault of which one in twenty gives less than `nats`: it scatters by the root of twice its mean."""
    return 0.25 * (math.sqrt(2.0) * SURE + math.sqrt(2.0 * SURE**2 + 4.0 * nats)) ** 2


def _told(row: FaultRow, least: Least, value: float, rig: Rig) -> Detectable:
    """The value as it is told, with its unit and words."""
    own = next(o for o in row.sizes if o.name == least.constant)
    unit = "s" if least.lasts else "1" if own.absolute or own.of_friction else PARAMETERS[own.name][0]
    value = least.told(rig.model, value)
    return Detectable(row.label, least.name, value, unit, least.says(value, unit))
