"""The hypotheses of a bank side by side: hypothesis j is number j of every row (`rows.py`), whatever states it has.

A state that several hypotheses have stands in one place for all of them. Those that only one has come behind, and share
their places: a stop's indentation stands where another hypothesis has its free torque. A hypothesis without a state holds
its neutral value there, without variance.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import transition as tr
from observer_fi.bank.hypotheses import BankArrays, Hypothesis
from observer_fi.numerics import MOST, Wide, aligned_copy
from observer_fi.physics import equations
from observer_fi.records import Array
from observer_fi.settings import BankSettings


class BankRows(NamedTuple):
    """m hypotheses of n places, `common` of them of states that several have, in rows of L (a multiple of MOST) numbers.

    Rows without a hypothesis repeat the first. places (L, k) of the states of each, in its own order, -1 behind them; at
    (LAYOUT,) places of `transition.py`'s kinds, has (LAYOUT, L) who has them; movers (k,) places that enter the mass's speed;
    holds (n, L) who has a state; lacks (L, common) 1 where a source has it not; itself (m, L) 1 for hypothesis i in row i;
    parameters (VECTOR_SIZE, L); entry_mean, entry_var, diffusion (n, L); own (n, L) constants that the first hypothesis does
    not have, strained whether there are any; failed (3, L) 1 for the channel a hypothesis does not believe, failing whether
    there is one, failed_noise (1, L) its variance, else 0, repeat (1, L) see
    BankArrays; sizes (1, L) number of states; rates (m, m) per second; noise (3,);
    slow_at_rest (carried, L) what a mean carries that begins (see `transition.py`), mixed whether hypotheses mix that; delays
    (2,) of voltage and position sensor [s], delayed whether there is one.
    """

    m: int
    n: int
    common: int
    wide: Wide
    places: NDArray[np.int64]
    at: NDArray[np.int64]
    has: Array
    movers: NDArray[np.int64]
    holds: Array
    lacks: Array
    itself: Array
    parameters: Array
    entry_mean: Array
    entry_var: Array
    diffusion: Array
    own: Array
    strained: bool
    failed: Array
    failing: bool
    failed_noise: Array
    repeat: Array
    sizes: Array
    rates: Array
    noise: Array
    carried: int
    slow_at_rest: Array
    mixed: bool
    delays: Array
    delayed: bool


def find_places(hypotheses: tuple[Hypothesis, ...]) -> tuple[list[list[int]], int]:
    """Where each hypothesis has its states, and how many places are common."""
    names = list(dict.fromkeys(s for h in hypotheses for s in h.states))
    common = [s for s in names if len(hypotheses) == 1 or sum(s in h.states for h in hypotheses) > 1]
    common = ["w", "I", "x", *(s for s in common if s not in ("w", "I", "x"))]
    found = []
    for h in hypotheses:
        own = [s for s in h.states if s not in common]
        found.append([common.index(s) if s in common else len(common) + own.index(s) for s in h.states])
    return found, len(common)


def width(m: int) -> int:
    """Numbers of a row for m hypotheses."""
    return -(-m // MOST) * MOST


def bank_rows(hypotheses: tuple[Hypothesis, ...], b: BankArrays) -> BankRows:
    """A bank side by side (see BankRows)."""
    m, (found, common) = len(hypotheses), find_places(hypotheses)
    L, n = width(m), max(max(at) for at in found) + 1
    where = np.full((L, max(len(to) for to in found)), -1)
    at, has = np.full(tr.LAYOUT, -1), np.zeros((tr.LAYOUT, L))
    holds, own, sizes, kinds_of = np.zeros((n, L)), np.zeros((n, L)), np.zeros((1, L)), b.layout
    mean, var, diffusion = np.ones((n, L)), np.zeros((n, L)), np.zeros((n, L))
    for row in range(L):
        j = row if row < m else 0
        to = np.array(found[j])
        k = np.arange(to.size)
        where[row, k] = to
        holds[to, row], own[to, row], sizes[0, row] = 1.0, b.own[j, k], to.size
        mean[to, row], var[to, row], diffusion[to, row] = (
            b.entry_mean[j, k],
            b.entry_var[j, k],
            b.diffusion[j, k],
        )
        for kind in range(tr.LAYOUT):
            if kinds_of[j, kind] >= 0:
                at[kind], has[kind, row] = to[kinds_of[j, kind]], 1.0
    rows = np.array([j if j < m else 0 for j in range(L)])
    failed = np.array([[1.0 if b.failed[j] == c else 0.0 for j in rows] for c in range(3)])
    slow, delays = np.stack([tr.slow_at_rest(p) for p in b.parameters], axis=1), tr.delays(b.parameters[0])
    moving = [at[kind] for kind in (tr.AT_E, tr.AT_RATE) if at[kind] >= 0]
    return lined_up(BankRows(
        m, n, common, (0,) * L, where, at, has, np.unique(np.array(moving, dtype=np.int64)), holds,
        1.0 - holds[:common].T.copy(), np.array([(rows == i).astype(float) for i in range(m)]),
        b.parameters[rows].T.copy(), mean, var, diffusion, own, bool(own.any()), failed, bool(failed.any()),
        (b.noise @ failed)[None], (b.repeat @ failed)[None], sizes, b.rates, b.noise, slow.shape[0], slow[:, rows],
        bool(b.parameters[:, equations.EXTENDED].any()), delays, bool(delays.any()),
    ))  # fmt: skip


def lined_up(arrays: Any) -> Any:
    """A named tuple with every array of numbers, also of tuples in it, where rows may stand."""
    return type(arrays)(*(_lined_up(part) for part in arrays))


def _lined_up(part: Any) -> Any:
    if isinstance(part, tuple) and hasattr(part, "_fields"):
        return lined_up(part)
    return aligned_copy(part) if isinstance(part, np.ndarray) and part.dtype == float else part


class Tuning(NamedTuple):
    """Numbers of BankSettings that the loops need, as scalars and small arrays."""

    timing: float
    agility: float
    tick: float
    meanwhile: float
    bias_entry: float
    bias_diffusion: float
    failed: Array
    glitch: float
    glitch_samples: float
    glitch_nis: float
    longest: float
    mended: float


SKIPPED_S = 0.1  # of a gap in the clock that LogStream did not fill, this much is integrated


def tuning(settings: BankSettings) -> Tuning:
    """The loops' numbers from the settings."""
    failed = np.array([settings.repeat_weight, settings.noisy_weight, settings.noisy_scale])
    return Tuning(
        settings.timing,
        settings.agility,
        settings.tick_s,
        settings.meanwhile,
        settings.bias_entry,
        settings.bias_diffusion,
        failed,
        settings.glitch_sigma,
        float(settings.glitch_samples),
        settings.glitch_nis,
        SKIPPED_S,
        settings.mended,
    )
