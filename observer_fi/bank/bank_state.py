"""What a bank remembers between samples: the memories of its hypotheses side by side (`bank_rows.py`)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank.packing import BankRows, lined_up
from observer_fi.records import Array

UNLIKELY = 1e-9  # probability of every hypothesis but the first before the first sample


class BankState(NamedTuple):
    """Everything a bank remembers between samples, in rows of L numbers.

    x (n, L), P (n, n, L) on and above its diagonal, slow (carried, L), bias (2, L) mean and variance of a failed channel's bias,
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


class HypothesisState(NamedTuple):
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


def bank_state_of(b: BankRows, memories: list[HypothesisState]) -> BankState:
    """The memory of a bank from those of its hypotheses at one time; its probabilities are those of a bank that begins."""
    L, first = len(b.wide), memories[0]
    s = lined_up(BankState(
        b.entry_mean.copy(), np.zeros((b.n, b.n, L)), np.zeros((b.carried, L)), np.zeros((2, L)), np.zeros((3, L)),
        np.zeros((3, L)), np.full((1, L), UNLIKELY), first.z.copy(), first.t.copy(), first.stopped.copy(),
    ))  # fmt: skip
    s.mu[0, 0] = 1.0 - UNLIKELY * (b.m - 1)
    for row in range(L):
        write_state(s, row, state_places(b, row), memories[row if row < b.m else 0])
    return s


class StatePlaces(NamedTuple):
    """Where a hypothesis has its states, to (n,), and row and column of their covariances, low and high (n, n)."""

    to: NDArray[np.int64]
    low: NDArray[np.int64]
    high: NDArray[np.int64]


def state_places(b: BankRows, row: int) -> StatePlaces:
    """Those of one number of the rows."""
    to = b.places[row]
    to = to[to >= 0]
    return StatePlaces(to, np.minimum(to[:, None], to), np.maximum(to[:, None], to))


def write_state(s: BankState, row: int, at: StatePlaces, memory: HypothesisState) -> None:
    """The memory of one hypothesis into a number of the rows of a bank's."""
    s.x[at.to, row] = memory.x
    s.P[at.low, at.high, row] = memory.P
    s.slow[:, row], s.bias[:, row] = memory.slow, memory.bias
    s.predicted[:, row], s.glitches[:, row] = memory.predicted, memory.glitches


def state_of(s: BankState, row: int, at: StatePlaces) -> HypothesisState:
    """What the hypothesis in a number of the rows remembers, a copy."""
    return HypothesisState(
        s.x[at.to, row], s.P[at.low, at.high, row], s.slow[:, row].copy(), s.bias[:, row].copy(),
        s.predicted[:, row].copy(), s.glitches[:, row].copy(), s.z.copy(), s.t.copy(), s.stopped.copy(),
    )  # fmt: skip
