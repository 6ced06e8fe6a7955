"""When a fault began: the nominal filter until tau, the fault's filter from tau on, over every tau of a window.

Uses samples after tau (smoothing). With a flat prior over tau the likelihoods of all tau are the posterior of the onset;
its median and its 95 % interval are what a report states.
"""

from typing import NamedTuple

import numpy as np

from observer_fi import kernels
from observer_fi.hypotheses import Hypothesis, arrays
from observer_fi.kernels import Bank, BankState, Recent
from observer_fi.models import Rig
from observer_fi.records import Array
from observer_fi.settings import BankSettings

STRIDE = 4  # samples between the taus of the first pass


class Onset(NamedTuple):
    """Posterior median of the onset and its central 95 % interval [s]."""

    median: float
    low: float
    high: float


class _Single:
    """One hypothesis as a bank of its own."""

    def __init__(self, hypothesis: Hypothesis, rig: Rig, settings: BankSettings) -> None:
        self.arrays = arrays((hypothesis,), rig, settings)
        self.tuning = kernels.tuning(settings)
        self.scratch = kernels.scratch(self.arrays)

    def density(self, state: BankState, w: Recent, first: int, last: int) -> Array:
        """Log-densities of samples first:last, (last - first,), from `state` on, which is overwritten."""
        n = last - first
        out = [np.empty((n, 1)) for _ in range(4)]
        part = slice(first, last)
        kernels.run(
            self.arrays, self.tuning, state, self.scratch, w.t[part], w.interval[part], w.w_cmd[part], w.theta[part], w.z[part],
            np.zeros(n, dtype=np.bool_), out[0], out[1], np.empty((n, 1, 3)), np.empty((n, 3)), np.empty((n, 4)), out[2], out[3],
        )  # fmt: skip
        return out[2][:, 0]


def copied(state: BankState) -> BankState:
    """A copy of a bank's memory."""
    return BankState(*(np.array(a) for a in state))


def entered(
    nominal: BankState, source: Hypothesis, target: Hypothesis, single: _Single, settings: BankSettings
) -> BankState:
    """The target's memory when it is entered from the source's: shared states kept, the others from their entry prior."""
    b = single.arrays
    n, room = len(target.states), kernels.padded(b)
    x, P = np.zeros((1, room)), np.zeros((1, room, room))
    x[0, :n], P[0, :n, :n] = b.entry_mean[0], np.diag(b.entry_var[0])
    for k, state in enumerate(target.states):
        if state not in source.states:
            continue
        at = source.states.index(state)
        x[0, k] = nominal.x[0, at]
        for q, other in enumerate(target.states):
            if other in source.states:
                P[0, k, q] = nominal.P[0, at, source.states.index(other)]
    bias = np.zeros((1, 2))
    if target.failed >= 0:
        bias[0, 1] = settings.bias_entry**2 * b.noise[target.failed]
    fresh = copied(nominal)
    return fresh._replace(x=x, P=P, bias=bias)


def find_onset(
    start: BankState, nominal: Hypothesis, fault: Hypothesis, window: Recent, rig: Rig, settings: BankSettings
) -> Onset:
    """Onset of `fault` within `window`, from the nominal hypothesis' memory before its first sample.

    Raises ValueError for a window of fewer than two samples.
    """
    n = window.t.size
    if n < 2:
        raise ValueError(f"an onset needs a window of at least 2 samples, got {n}")
    own, other = _Single(nominal, rig, settings), _Single(fault, rig, settings)
    states, until, state = [], [0.0], copied(start)
    for k in range(0, n, STRIDE):
        states.append(copied(state))
        until.append(until[-1] + float(own.density(state, window, k, min(k + STRIDE, n)).sum()))

    def score(k: int) -> float:
        before, past = copied(states[k // STRIDE]), until[k // STRIDE]
        if k % STRIDE:
            past += float(own.density(before, window, k - k % STRIDE, k).sum())
        after = entered(before, nominal, fault, other, settings)
        return past + float(other.density(after, window, k, n).sum())

    scores = {k: score(k) for k in range(0, n, STRIDE)}
    best = max(scores, key=lambda k: scores[k])
    near = [k for k in range(max(0, best - 2 * STRIDE), min(n, best + 2 * STRIDE + 1)) if k not in scores]
    scores |= {k: score(k) for k in near}
    return _posterior(window.t, scores, during=fault.failed < 0)


def _posterior(t: Array, scores: dict[int, float], during: bool) -> Onset:
    """Median and 95 % interval of the onset from the log-likelihoods at some samples, each standing for its cell.

    during: a fault of the plant, which the score of a sample has at work since the sample before; a failed sensor spoils
    the sample itself and began somewhere between the two.
    """
    k = np.array(sorted(scores))
    before = t[np.maximum(k - 1, 0)]
    middle = before if during else 0.5 * (before + t[k])
    edges = np.concatenate(([middle[0]], 0.5 * (middle[1:] + middle[:-1]), [middle[-1]]))
    width = np.maximum(np.diff(edges), 1e-12)
    value = np.array([scores[i] for i in k])
    mass = np.exp(value - value.max()) * width
    cumulative = np.concatenate(([0.0], np.cumsum(mass) / mass.sum()))
    low, median, high = np.interp([0.025, 0.5, 0.975], cumulative, edges)
    return Onset(float(median), float(low), float(high))


def onset_in(bank: Bank, fault: Hypothesis, first_s: float, last_s: float) -> Onset | None:
    """Onset of `fault` between two times, from the samples and snapshots that a bank keeps; None where they are gone."""
    recent = bank.recent
    starts = [(t, state) for t, state in bank.snapshots if t <= first_s]
    if recent is None or not bank.snapshots or first_s >= recent.t[-1]:
        return None
    since, state = starts[-1] if starts else bank.snapshots[0]
    begin, end = (int(k) for k in np.searchsorted(recent.t, [since - 1e-9, last_s]))
    if end - begin < 2:
        return None
    nominal = bank.hypotheses[0]
    single = _Single(nominal, bank.rig, bank.settings)
    state = copied(state)
    first = min(max(int(np.searchsorted(recent.t, first_s)), begin), end - 2)
    if first > begin:
        single.density(state, recent, begin, first)
    return find_onset(state, nominal, fault, recent.cut(first, end), bank.rig, bank.settings)
