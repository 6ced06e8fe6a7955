"""A second fault in one move: where the first one stops explaining the samples, another one has begun, or come back.

What was found of the first fault holds until there. From its begin on it takes the place of nominal, and the rest of the
move is asked as a whole move is (`whole_move.py`): the first fault until the second one begins.
"""

from typing import NamedTuple

import numpy as np

from observer_fi.bank import Hypothesis, HypothesisState, LogSamples, on_top
from observer_fi.records import Array
from observer_fi.verdict.moves.whole_move import LEFT, Path, WholeMove

WINDOW_S = 0.05  # over which a misfit is averaged
# Times the expected NIS over it: right filters reach 1.5, and so does one whose fault grows at will where another one sets in.
MISFIT, SUSPECT = 1.8, 1.25
SOON_S = 0.06  # after its begin and end a fault is not held to it: what it is like has to be found


class Lasted(NamedTuple):
    """A first fault as long as it explains the move.

    until: sample from which it does not. base, memory: the hypothesis that holds there, nominal where the fault is over, with
    what it remembered before the sample `since`.
    """

    until: int
    base: Hypothesis
    since: int
    memory: HypothesisState


def lasted(path: Path, whole: WholeMove, misfit: float = MISFIT) -> Lasted | None:
    """How long a path explains its move; None where until the motor stops: what a stop adds is no second fault.

    misfit: times the expected NIS that is none any more.
    """
    h = path.hypothesis
    if path.begin >= whole.moving:
        return None
    stop = whole.moving if path.end is None else min(path.end, whole.moving)
    until = None
    for near in (None, path.memory):  # a wall is not found soon: what is no misfit from either is none
        entered = whole.entered(path, near)
        _, nis = whole.followed(h, entered, path.begin)
        until = first_misfit(nis[: stop - path.begin], whole.expected(h), whole, misfit)
        if until is None:
            break
    if until is not None:
        return Lasted(path.begin + until, h, path.begin, entered)
    if path.end is None or whole.lasts(path):
        return None
    back = whole.healed(path)
    _, later = whole.followed(whole.nominal, back, path.end)
    until = first_misfit(later[: whole.moving - path.end], whole.expected(whole.nominal), whole, misfit)
    return None if until is None else Lasted(path.end + until, whole.nominal, path.end, back)


def first_misfit(nis: Array, expected: float, whole: WholeMove, misfit: float = MISFIT) -> int | None:
    """First sample of a window over which the mean NIS is beyond what a right filter shows, None where there is none."""
    window = max(LEFT, round(WINDOW_S / whole.interval))
    soon = round(SOON_S / whole.interval)
    if nis.size < soon + window:
        return None
    mean = np.convolve(nis[soon:], np.ones(window) / window, "valid")
    over = np.flatnonzero(mean > misfit * expected)
    return int(over[0]) + soon if over.size else None


def until(whole: WholeMove, sample: int) -> WholeMove | None:
    """The move as far as a sample, None where that is too short to say anything."""
    if sample < 2 * LEFT:
        return None
    window: LogSamples = whole.window.cut(0, sample)
    return WholeMove((whole.nominal, *whole.faults), window, whole.memories[0], whole.filters, whole.laws)


def behind(first: Lasted, whole: WholeMove) -> WholeMove | None:
    """The move from a first fault on, or from its end, which takes nominal's place; None where too little is left of it."""
    if whole.n - first.since < 4 * LEFT:
        return None
    others = tuple(on_top(first.base, h) for h in whole.faults if h.label != first.base.label)
    laws = tuple(on_top(first.base, h) for h in whole.laws if h.label != first.base.label)
    rest = whole.window.cut(first.since, whole.n)
    return WholeMove((first.base, *others), rest, first.memory, whole.filters, laws)
