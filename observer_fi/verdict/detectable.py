"""What a healthy move could have shown: of each fault the smallest severity that the whole move would have told.

A fault held at some sizes is entered in the middle of the move. What it costs in likelihood on the healthy samples is, for
models that differ by their means, what nominal would lose if there were one: half the squared distance of the two, in
which constants that either may still move have moved already (Kullback and Leibler 1951).
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, Hypothesis, HypothesisState, LogSamples, of_a_move
from observer_fi.numerics import MOST
from observer_fi.physics import FAULTS, PARAMETERS, FaultRow, Least, OwnState, Rig
from observer_fi.records import Array, CouldShow, Detectable, Event
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import TIMES_S
from observer_fi.verdict.last_word import CLEAN_S, FITS, PASSES_S
from observer_fi.verdict.onset import ROOM, Entry, Filters
from observer_fi.verdict.whole_move import CHANGE_NATS, LEFT, window_of

# What shows later than this after its begin is not counted: what grows slowly must first be doubted.
SEEN_S = 2.0 * max(TIMES_S)
SURE = 1.645  # standard deviations of the evidence: 19 such faults of 20 give as much


class Half(NamedTuple):
    """A healthy move from its middle on: samples, what nominal remembers before them, its log-densities (n,).

    direction: sign of the speed; interval: between samples [s].
    """

    window: LogSamples
    memory: HypothesisState
    nominal: Array
    direction: float
    interval: float


def could_show(
    event: Event, bank: Bank, rig: Rig, filters: Filters, settings: DecisionSettings
) -> CouldShow | None:
    """What the move of an all-clear could have shown; None where it is not at hand, too short, or not what the rig file says."""
    hypotheses = of_a_move(rig, filters.settings)
    half = _second_half(event, bank, hypotheses[0], filters)
    if half is None:
        return None
    least, blind = [], []
    for label, row in FAULTS.items():
        if row.least is None:
            continue
        fault = _held(next(h for h in hypotheses if h.label == label), row)
        lost = _losses(row, row.least, Entry(hypotheses[0], fault, filters, within_s=half.interval), fault, half, rig, filters)
        value = (_shortest if row.least.lasts else _smallest)(row, row.least, lost, half, settings)
        if value is None:
            blind.append(label)
        else:
            least.append(_told(row, row.least, value, rig))
    return CouldShow(float(half.window.t[0]), tuple(least), tuple(blind))


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
    misfit = float(np.nan_to_num(alone.misfit(n)[:, 0]).mean())
    if misfit > FITS * float(np.isfinite(rest.z).mean(axis=0).sum()):
        return None
    return Half(rest, before, density, float(np.sign(window.w_cmd[middle])), float(np.median(np.diff(rest.t))))


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


def _held(fault: Hypothesis, row: FaultRow) -> Hypothesis:
    """The hypothesis with its own constants known and not changing."""
    own = [o._replace(std=0.0, growth=0.0) if _is_constant(o) else o for o in row.sizes]
    return replace(fault, own=tuple(own))


def _is_constant(own: OwnState) -> bool:
    """Whether a state that a fault adds says how severe it is."""
    return bool(own.tells)


def _losses(row: FaultRow, least: Least, entry: Entry, fault: Hypothesis, half: Half, rig: Rig, filters: Filters) -> Array:
    """Nats that the fault has lost to nominal up to each sample, (n, k) for the k values that it is tried with.

    Where these leave room, the mean over both signs: what the noise of these samples adds to one it takes from the other.
    """
    signs = (1.0,) if 2 * len(least.tried) > MOST else (1.0, -1.0)
    side_by_side, entered = filters.of(fault, MOST, ROOM), entry(half.memory)
    side_by_side.begin(entered)
    for k, value in enumerate(sign * tried for sign in signs for tried in least.tried):
        x, sizes = entered.x.copy(), {**least.held, least.constant: value}
        for own in filter(_is_constant, row.sizes):
            x[fault.states.index(own.name)] = sizes[own.name] * _unit(own, half.direction, rig)
        side_by_side.put(k, entered._replace(x=x))
    density = side_by_side.density(half.window, 0, half.window.t.size)
    lost = np.cumsum(half.nominal[:, None] - density, axis=0)
    return lost[:, : len(signs) * len(least.tried)].reshape(len(lost), len(signs), -1).mean(axis=1)


def _needed(nats: Array) -> Array:
    """Expected evidence of a fault of which one in twenty gives less than `nats`: it scatters by the root of twice its mean."""
    return 0.25 * (math.sqrt(2.0) * SURE + np.sqrt(2.0 * SURE**2 + 4.0 * nats)) ** 2


def _smallest(row: FaultRow, least: Least, lost: Array, half: Half, settings: DecisionSettings) -> float | None:
    """The least value of a fault's constant that is told if it lasts to the end; None where the largest tried is not.

    None below what is believable of it is told. A size that is not known beforehand costs what its posterior is narrower than its prior (Dickey 1971). Evidence grows with the
    square of the size, hence is a straight line in logarithms.
    """
    own, sizes = next(o for o in row.sizes if o.name == least.constant), np.array(least.tried)
    evidence = np.maximum.accumulate(np.maximum(lost[-1], 1e-9))
    prior = own.std or 1.0
    unknown = np.log(np.maximum(prior * np.sqrt(2.0 * evidence) / sizes, 1.0)) + 0.5 * ((sizes - own.mean) / prior) ** 2
    share = evidence / _needed(settings.move_nats + CHANGE_NATS + unknown)
    if share[-1] < 1.0:
        return None
    if share[0] >= 1.0:
        return max(float(sizes[0] / math.sqrt(share[0])), own.low)
    return max(float(np.exp(np.interp(0.0, np.log(share), np.log(sizes)))), own.low)


def _shortest(row: FaultRow, least: Least, lost: Array, half: Half, settings: DecisionSettings) -> float | None:
    """How long a fault must last to be told [s], whichever of the values its constant has; None where the move is too short."""
    needed = _needed(np.array(settings.move_nats + 2.0 * CHANGE_NATS))
    below = np.flatnonzero(lost.min(axis=1) < needed)
    enough = int(below[-1]) + 1 if below.size else 0
    if enough >= len(lost):
        return None
    return max(float(half.window.t[enough] - half.window.t[0]) + half.interval, PASSES_S)


def _told(row: FaultRow, least: Least, value: float, rig: Rig) -> Detectable:
    """The value as it is told, with its unit and words."""
    own = next(o for o in row.sizes if o.name == least.constant)
    unit = "s" if least.lasts else "1" if own.absolute or own.of_friction else PARAMETERS[own.name][0]
    value = least.told(rig.model, value)
    return Detectable(row.label, least.name, value, unit, least.words.format(least.scale * value))


def _unit(own: OwnState, direction: float, rig: Rig) -> float:
    """What turns the value of a fault's constant into the state of a filter."""
    return 1.0 / own.mean if own.absolute else direction * rig.model["A"] if own.of_friction else 1.0
