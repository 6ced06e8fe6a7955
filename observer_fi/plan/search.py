"""The blocks that say most per second: pairs to begin with, then one after another until the time is used."""

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement

import numpy as np

from observer_fi.records import Array

Value = Callable[[Array], float]

_SEEDS = 3  # beginnings that are followed to the end
_SINGLES = 24  # blocks, the best by themselves and the shortest, that pairs are made of
_LEAST = 1e-9  # nats by which a step must gain


def best_counts(value: Value, seconds: Array, most_s: float) -> Array:
    """(B,) how often each block stands in the best profile found of at most so many seconds."""
    starts = sorted(_beginnings(value, seconds, most_s), key=lambda c: -value(c) / float(c @ seconds))
    grown = [_swapped(value, _grown(value, c, seconds, most_s), seconds, most_s) for c in starts[:_SEEDS]]
    return max(grown, key=value) if grown else np.zeros(seconds.size)


def best_repeated(value: Value, seconds: Array, most_s: float) -> Array:
    """(B,) of the best profile that repeats one block."""
    each = [np.floor(most_s / seconds[b] + 1e-9) * _one(seconds.size, b) for b in range(seconds.size)]
    return max((c for c in each if c.any()), key=value, default=np.zeros(seconds.size))


def _one(count: int, b: int) -> Array:
    return np.eye(count)[b]


def _beginnings(value: Value, seconds: Array, most_s: float) -> list[Array]:
    """One block, or two, which a rival may need to be held against each other."""
    n = seconds.size
    rate = np.array([value(_one(n, b)) for b in range(n)]) / seconds
    chosen = np.argsort(-rate, kind="stable")[:_SINGLES].tolist()
    singles = [_one(n, b) for b in chosen]
    pairs = [_one(n, a) + _one(n, b) for a, b in combinations_with_replacement(chosen, 2)]
    return [c for c in (*singles, *pairs) if c @ seconds <= most_s]


def _grown(value: Value, counts: Array, seconds: Array, most_s: float) -> Array:
    """More blocks, each time the one that gains most per second, while there is time."""
    while True:
        options = _options(counts, seconds, most_s)
        if not options:
            return counts
        now = value(counts)
        gains = [(value(counts + _one(seconds.size, b)) - now) / seconds[b] for b in options]
        counts = counts + _one(seconds.size, options[int(np.argmax(gains))])


def _options(counts: Array, seconds: Array, most_s: float) -> list[int]:
    left = most_s - float(counts @ seconds) + 1e-9
    return [b for b in range(seconds.size) if seconds[b] <= left]


def _swapped(value: Value, counts: Array, seconds: Array, most_s: float) -> Array:
    """Each kind of block taken out once, and what is then best put in its place."""
    for b in np.flatnonzero(counts).tolist():
        without = counts - _one(seconds.size, b)
        other = _grown(value, without, seconds, most_s)
        if value(other) > value(counts) + _LEAST:
            counts = other
    return counts


def chosen(counts: Array, blocks: Sequence) -> tuple:
    """The blocks, each as often as counted."""
    return tuple(
        block for block, n in zip(blocks, counts.astype(int).tolist(), strict=True) for _ in range(n)
    )
