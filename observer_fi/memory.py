"""What a bank remembers between samples: the memories of its hypotheses side by side (`bank_rows.py`)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi import transition as tr
from observer_fi.bank_rows import BankRows, lined_up
from observer_fi.records import Array

UNLIKELY = 1e-9  # probability of every hypothesis but the first before the first sample


class BankState(NamedTuple):
    """Everything a bank remembers between samples, in rows of L numbers.

    x (n, L), P (n, n, L) on and above its diagonal, slow (SLOW, L), bias (2, L) mean and variance of a failed channel's bias,
    predicted (3, L) the last predictions, glitches (3, L) how many samples in a row a channel was taken for a glitch,
    mu (1, L) probabilities, z (3,) last reading of each channel, t (1,) last time or NaN before the first sample,
    stopped (1,) 1 from a command of zero to the next sample that counts as evidence.
    """

    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    mu: Array
    z: Array
    t: Array
    stopped: Array


class Memory(NamedTuple):
    """What one hypothesis remembers, in its own order of states: x (n,), P (n, n), the others as in BankState."""

    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    z: Array
    t: Array
    stopped: Array


def remembered(b: BankRows, memories: list[Memory]) -> BankState:
    """The memory of a bank from those of its hypotheses at one time; its probabilities are those of a bank that begins."""
    L, first = len(b.wide), memories[0]
    s = lined_up(BankState(
        b.entry_mean.copy(), np.zeros((b.n, b.n, L)), np.zeros((tr.SLOW, L)), np.zeros((2, L)), np.zeros((3, L)),
        np.zeros((3, L)), np.full((1, L), UNLIKELY), first.z.copy(), first.t.copy(), first.stopped.copy(),
    ))  # fmt: skip
    s.mu[0, 0] = 1.0 - UNLIKELY * (b.m - 1)
    for row in range(L):
        put(b, s, row, memories[row if row < b.m else 0])
    return s


def put(b: BankRows, s: BankState, row: int, memory: Memory) -> None:
    """The memory of one hypothesis into a number of the rows of a bank's."""
    to, low, high = _places(b, row)
    s.x[to, row] = memory.x
    s.P[low, high, row] = memory.P
    s.slow[:, row], s.bias[:, row] = memory.slow, memory.bias
    s.predicted[:, row], s.glitches[:, row] = memory.predicted, memory.glitches


def memory_of(b: BankRows, s: BankState, j: int) -> Memory:
    """What hypothesis j of a bank remembers, a copy."""
    to, low, high = _places(b, j)
    return Memory(
        s.x[to, j], s.P[low, high, j], s.slow[:, j].copy(), s.bias[:, j].copy(), s.predicted[:, j].copy(),
        s.glitches[:, j].copy(), s.z.copy(), s.t.copy(), s.stopped.copy(),
    )  # fmt: skip


def _places(b: BankRows, row: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Where a hypothesis has its states (n,), and row and column of their covariances (n, n)."""
    to = b.places[row]
    to = to[to >= 0]
    return to, np.minimum(to[:, None], to), np.maximum(to[:, None], to)
