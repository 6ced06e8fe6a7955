"""Moves to choose from: short sequences that end where they began, and the profile that they make."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import NamedTuple

import numpy as np

from observer_fi.numerics import digits
from observer_fi.physics import Move, trapezoids
from observer_fi.plan.limits import Limits
from observer_fi.records import Array

LEAD_S = 0.3  # of rest in front of the first move
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of the top speed
_HOLDS_S = (0.3, 1.2)
_TURN_SHARES = (0.5, 0.25, 0.1)  # a reversal asks of the supply what a start to twice the speed does
_STAIRS = (0.1, 0.25, 0.5, 1.0)
_PULSE_S, _STEP_S, _STAIR_S = 0.05, 0.05, 0.2
_FULL_SHARE = 0.35  # of the whole time: a way over the travel
_SHORTEST_S = 0.03  # a move that the travel leaves less of is none
_ROOM = 0.9  # of the travel: the mass goes on a little after a stop


class Leg(NamedTuple):
    """A commanded speed [rad/s], 0 for a rest, and for how long after its ramp [s]."""

    speed: float
    seconds: float


@dataclass(frozen=True)
class Block:
    """Moves that end where they began, at one pitch [deg], with a rest behind them."""

    words: str
    legs: tuple[Leg, ...]
    pitch: float


class Placed(NamedTuple):
    """A block within a log: from when to when [s]."""

    block: Block
    begin: float
    end: float


def seconds_of(block: Block, accel: float) -> float:
    """How long a block lasts, ramps included [s]."""
    speeds = [0.0, *(leg.speed for leg in block.legs)]
    ramps = sum(abs(b - a) for a, b in zip(speeds[:-1], speeds[1:], strict=True)) / accel
    return ramps + sum(leg.seconds for leg in block.legs)


def lay_out(blocks: Sequence[Block], accel: float) -> tuple[tuple[Move, ...], tuple[Placed, ...], float]:
    """The blocks one after another: commanded moves, when each block runs, and the end [s]."""
    moves, placed, t = [], [], LEAD_S
    for block in blocks:
        begin, last = t, 0.0
        for leg in block.legs:
            stop = t + abs(leg.speed - last) / accel + leg.seconds
            if leg.speed:
                moves.append(Move(t, leg.speed, stop - t))
            t, last = stop, leg.speed
        placed.append(Placed(block, begin, t))
    return tuple(moves), tuple(placed), t


def corners_of(blocks: Sequence[Block], accel: float) -> tuple[Array, Array]:
    """Times [s] and commanded speeds [rad/s] of the corners of a profile, from 0 to its end, linear in between."""
    moves, _, end = lay_out(blocks, accel)
    t, w = trapezoids(moves, accel, end)
    again = (np.diff(t, prepend=-1.0) < 1e-9) & (np.diff(w, prepend=np.nan) == 0.0)
    inside = (t < end - 1e-9) & ~again
    return np.append(t[inside], end), np.append(w[inside], 0.0)


def in_order(blocks: Sequence[Block], limits: Limits) -> tuple[Block, ...]:
    """The same blocks with as few changes of pitch as there can be, equal ones together."""
    return tuple(sorted(blocks, key=lambda b: (limits.pitches.index(b.pitch), b.words)))


def by_pitch(blocks: Sequence[Block]) -> list[tuple[float, tuple[Block, ...]]]:
    """Runs of one pitch."""
    return [(pitch, tuple(run)) for pitch, run in groupby(blocks, key=lambda b: b.pitch)]


# --- the family --------------------------------------------------------------------------------------


def family(limits: Limits) -> tuple[Block, ...]:
    """Every block that the limits allow, at every pitch."""
    found = [b for pitch in limits.pitches for b in _at(limits, pitch)]
    allowed = [b for b in found if LEAD_S + seconds_of(b, limits.accel) <= limits.seconds and fits(b, limits)]
    return tuple(dict.fromkeys(allowed))


def standard(limits: Limits) -> tuple[Block, ...]:
    """What is usually recorded: there and back at the top speed, a second each, at the first pitch, as often as there is time."""
    block = _there_and_back(limits, 1.0, 1.0, limits.pitches[0])
    return repeated([block], limits)


def campaign(limits: Limits) -> tuple[Block, ...]:
    """There and back at three speeds at every pitch, a second each: what shows most causes."""
    return tuple(_there_and_back(limits, share, 1.0, p) for p in limits.pitches for share in (1.0, 0.5, 0.22))


def repeated(blocks: Sequence[Block], limits: Limits) -> tuple[Block, ...]:
    """The blocks in turn, as often as there is time, at least once."""
    one = sum(seconds_of(b, limits.accel) for b in blocks)
    times = max(int((limits.seconds - LEAD_S) / one + 1e-9), 1)
    return in_order(tuple(blocks) * times, limits)


def excursion(blocks: Sequence[Block], limits: Limits) -> tuple[float, float]:
    """How far the commanded motion goes from its start, down and up [m]."""
    t, w = corners_of(blocks, limits.accel)
    x = limits.unit * np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))))
    return float(x.min()), float(x.max())


def fits(block: Block, limits: Limits) -> bool:
    """Whether the mass keeps within its travel."""
    low, high = excursion([block], limits)
    return low >= limits.low and high <= limits.high


def _at(limits: Limits, pitch: float) -> Iterator[Block]:
    for share, hold in product(_SHARES, _HOLDS_S):
        yield _there_and_back(limits, share, hold, pitch)
    yield _there_and_back(limits, 1.0, _FULL_SHARE * limits.seconds, pitch)
    for share in _TURN_SHARES:
        yield _reversals(limits, share, _HOLDS_S[0], pitch)
    yield _staircase(limits, pitch)
    yield _starts(limits, pitch)
    yield _small_steps(limits, pitch)


def _way(limits: Limits) -> float:
    """Which way there is more room."""
    return 1.0 if limits.high >= -limits.low else -1.0


def _hold(limits: Limits, speed: float, hold: float, ramps: float = 1.0) -> float:
    """As much of a hold [s] as the travel leaves, after the ramps there and to rest."""
    room = _ROOM * max(limits.high, -limits.low) / (limits.unit * abs(speed))
    return max(min(hold, room - ramps * abs(speed) / limits.accel), _SHORTEST_S)


def _there_and_back(limits: Limits, share: float, hold: float, pitch: float) -> Block:
    v, rest = _way(limits) * share * limits.speed, Leg(0.0, limits.rest_s)
    hold = _hold(limits, v, hold)
    words = f"from rest to {digits(abs(v))} rad/s and back, {digits(hold, 2)} s each"
    return Block(words, (Leg(v, hold), rest, Leg(-v, hold), rest), pitch)


def _reversals(limits: Limits, share: float, hold: float, pitch: float) -> Block:
    v, rest = _way(limits) * share * limits.speed, Leg(0.0, limits.rest_s)
    hold = _hold(limits, v, hold, 1.5)
    words = f"to and fro at {digits(abs(v))} rad/s three times without a rest, {digits(hold, 2)} s each way"
    return Block(words, (*(Leg(v, hold), Leg(-v, hold)) * 3, rest), pitch)


def _staircase(limits: Limits, pitch: float) -> Block:
    speeds = [_way(limits) * share * limits.speed for share in _STAIRS]
    whole = sum(map(abs, speeds)) / len(speeds)
    hold = _hold(limits, whole, _STAIR_S * len(speeds), 2.0) / len(speeds)
    rest = Leg(0.0, limits.rest_s)
    up, down = tuple(Leg(v, hold) for v in speeds), tuple(Leg(-v, hold) for v in speeds)
    words = f"in steps to {', '.join(digits(abs(v)) for v in speeds)} rad/s, {digits(hold, 2)} s each, and the same back"
    return Block(words, (*up, rest, *down, rest), pitch)


def _starts(limits: Limits, pitch: float) -> Block:
    rest, legs = Leg(0.0, limits.rest_s), []
    for share in (1.0, 0.5, 0.25):
        v = _way(limits) * share * limits.speed
        hold = _hold(limits, v, _PULSE_S)
        legs += [Leg(v, hold), rest, Leg(-v, hold), rest]
    speeds = f"{digits(limits.speed)}, {digits(limits.speed / 2)} and {digits(limits.speed / 4)} rad/s"
    words = f"short starts to {speeds} and back, {_PULSE_S:g} s each"
    return Block(words, tuple(legs), pitch)


def _small_steps(limits: Limits, pitch: float) -> Block:
    v, rest = _way(limits) * 0.25 * limits.speed, Leg(0.0, limits.rest_s)
    hold = _hold(limits, v, _STEP_S)
    words = f"three small steps there and back at {digits(abs(v))} rad/s, {digits(hold, 2)} s each, a rest after each"
    return Block(words, (Leg(v, hold), rest, Leg(-v, hold), rest) * 3, pitch)


def in_words(blocks: Sequence[Block]) -> list[tuple[int, Block]]:
    """Blocks in order, equal neighbours counted."""
    return [(len(list(run)), block) for block, run in groupby(blocks)]


def total_seconds(blocks: Sequence[Block], accel: float) -> float:
    """Of a whole profile, the rest in front of it included."""
    return LEAD_S + math.fsum(seconds_of(b, accel) for b in blocks)
