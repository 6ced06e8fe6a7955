"""What a bank remembers between samples: the memories of its hypotheses side by side (`bank_rows.py`)."""

from collections.abc import Sequence
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


class StatePlaces(NamedTuple):
    """Where a hypothesis has its states, to (n,), and row and column of their covariances, low and high (n, n)."""

    to: NDArray[np.int64]
    low: NDArray[np.int64]
    high: NDArray[np.int64]


class Visits(NamedTuple):
    """Moments of a run at which one number of the rows takes in what a hypothesis remembers, or gives out what it does.

    at (r,) samples in increasing order, before each of which it happens (n: after the last); row (r,); enters (r,) whether it
    takes in. What comes in or goes out: x (r, n), P (r, n, n) on and above its diagonal, slow (r, carried), bias (r, 2),
    predicted and glitches (r, 3); z (r, 3), t and stopped (r, 1) of the bank go out only.
    """

    at: NDArray[np.int64]
    row: NDArray[np.int64]
    enters: NDArray[np.bool_]
    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    z: Array
    t: Array
    stopped: Array


def visits_of(b: BankRows, at: Sequence[int]) -> Visits:
    """So many visits of the first number, which give out what it remembers."""
    r = len(at)
    shapes = ((b.n,), (b.n, b.n), (b.carried,), (2,), (3,), (3,), (3,), (1,), (1,))
    return Visits(
        np.array(at, dtype=np.int64), np.zeros(r, dtype=np.int64), np.zeros(r, dtype=np.bool_),
        *(np.zeros((r, *shape)) for shape in shapes),
    )  # fmt: skip


def entries(
    b: BankRows, at: Sequence[int], places: StatePlaces, memories: Sequence[HypothesisState]
) -> Visits:
    """Visits of the numbers in their order, which take in the memories of hypotheses with the same places."""
    made = visits_of(b, at)
    made.row[:], made.enters[:] = np.arange(len(at)), True
    made.x[:, places.to] = [m.x for m in memories]
    made.P[:, places.low, places.high] = [m.P for m in memories]
    made.slow[:], made.bias[:] = [m.slow for m in memories], [m.bias for m in memories]
    made.predicted[:], made.glitches[:] = [m.predicted for m in memories], [m.glitches for m in memories]
    return made


def states_of(v: Visits, places: StatePlaces) -> list[HypothesisState]:
    """What visits gave out of a hypothesis with these places."""
    given = (
        v.x[:, places.to], v.P[:, places.low, places.high], v.slow, v.bias, v.predicted, v.glitches, v.z, v.t, v.stopped
    )  # fmt: skip
    return [HypothesisState(*one) for one in zip(*given, strict=True)]


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
