"""What a bank remembers between samples: the memories of its hypotheses side by side (`bank_rows.py`)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi import transition as tr
from observer_fi.bank_rows import BankRows, lined_up, places
from observer_fi.hypotheses import Hypothesis
from observer_fi.records import Array

UNLIKELY = 1e-9  # probability of every hypothesis but the first before the first sample


class BankState(NamedTuple):
    """Everything a bank remembers between samples, in rows of L numbers.

    x (n, L), P (n, n, L) on and above its diagonal, slow (SLOW, L), bias (2, L) mean and variance of a failed channel's bias,
    predicted (3, L) the last predictions, glitches (3, L) how many samples in a row a channel was taken for a glitch, log_mu
    (L,), z (3,) last reading of each channel, t (1,) last time or NaN before the first sample, stopped (1,) 1 from a
    command of zero to the next sample that counts as evidence.
    """

    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    log_mu: Array
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


def remembered(hypotheses: tuple[Hypothesis, ...], b: BankRows, memories: list[Memory]) -> BankState:
    """The memory of a bank from those of its hypotheses at one time; its probabilities are those of a bank that begins."""
    L, found = len(b.wide), places(hypotheses)[0]
    first = memories[0]
    s = lined_up(BankState(
        b.entry_mean.copy(), np.zeros((b.n, b.n, L)), np.zeros((tr.SLOW, L)), np.zeros((2, L)), np.zeros((3, L)),
        np.zeros((3, L)), np.full(L, math.log(UNLIKELY)), first.z.copy(), first.t.copy(), first.stopped.copy(),
    ))  # fmt: skip
    s.log_mu[0] = math.log(1.0 - UNLIKELY * (b.m - 1))
    for row in range(L):
        j = row if row < b.m else 0
        put(s, row, np.array(found[j]), memories[j])
    return s


def put(s: BankState, row: int, to: NDArray[np.int64], memory: Memory) -> None:
    """The memory of one hypothesis, with its states in the places `to` (n,), into a number of the rows of a bank's."""
    s.x[to, row] = memory.x
    s.P[np.minimum(to[:, None], to), np.maximum(to[:, None], to), row] = memory.P
    s.slow[:, row], s.bias[:, row] = memory.slow, memory.bias
    s.predicted[:, row], s.glitches[:, row] = memory.predicted, memory.glitches


def memory_of(hypotheses: tuple[Hypothesis, ...], s: BankState, j: int) -> Memory:
    """What hypothesis j of a bank remembers, a copy."""
    to = np.array(places(hypotheses)[0][j])
    P = s.P[np.minimum(to[:, None], to), np.maximum(to[:, None], to), j]
    return Memory(
        s.x[to, j], P, s.slow[:, j].copy(), s.bias[:, j].copy(), s.predicted[:, j].copy(), s.glitches[:, j].copy(),
        s.z.copy(), s.t.copy(), s.stopped.copy(),
    )  # fmt: skip
