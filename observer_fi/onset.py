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
    """One hypothesis as a bank of its own, over windows of at most n samples."""

    def __init__(self, hypothesis: Hypothesis, rig: Rig, settings: BankSettings, n: int) -> None:
        self.arrays = arrays((hypothesis,), rig, settings)
        self.tuning = kernels.tuning(settings)
        self.scratch = kernels.scratch(self.arrays)
        self.still = np.zeros(n, dtype=np.bool_)
        self.out = kernels.in_one_piece((n, 1), (n, 1), (n, 1, 3), (n, 3), (n, 4), (n, 1), (n, 1))

    def density(self, state: BankState, w: Recent, first: int, last: int) -> Array:
        """Log-densities of samples first:last, (last - first,), from `state` on, which is overwritten."""
        part, out = slice(first, last), [a[: last - first] for a in self.out]
        kernels.run(
            self.arrays, self.tuning, state, self.scratch, w.t[part], w.interval[part], w.w_cmd[part], w.theta[part], w.z[part],
            self.still[: last - first], *out,
        )  # fmt: skip
        return out[5][:, 0]


def copied(state: BankState) -> BankState:
    """A copy of a bank's memory."""
    return BankState(*(a.copy() for a in state))


class _Entry:
    """How a hypothesis is entered from another: shared states are kept, the others come from their entry prior."""

    def __init__(
        self, source: Hypothesis, target: Hypothesis, single: _Single, settings: BankSettings
    ) -> None:
        b = single.arrays
        n, room = len(target.states), kernels.padded(b)
        self.x, self.P, self.bias = np.zeros((1, room)), np.zeros((1, room, room)), np.zeros((1, 2))
        self.x[0, :n], self.P[0, :n, :n] = b.entry_mean[0], np.diag(b.entry_var[0])
        if target.failed >= 0:
            self.bias[0, 1] = settings.bias_entry**2 * b.noise[target.failed]
        shared = [state for state in target.states if state in source.states]
        self.to = np.array([target.states.index(state) for state in shared])
        self.at = np.array([source.states.index(state) for state in shared])

    def __call__(self, nominal: BankState) -> BankState:
        """The target's memory from the source's."""
        x, P = self.x.copy(), self.P.copy()
        x[0, self.to] = nominal.x[0, self.at]
        P[0, self.to[:, None], self.to] = nominal.P[0, self.at[:, None], self.at]
        return copied(nominal._replace(x=x, P=P, bias=self.bias))


def find_onset(
    start: BankState, nominal: Hypothesis, fault: Hypothesis, window: Recent, rig: Rig, settings: BankSettings
) -> Onset:
    """Onset of `fault` within `window`, from the nominal hypothesis' memory before its first sample.

    Raises ValueError for a window of fewer than two samples.
    """
    n = window.t.size
    if n < 2:
        raise ValueError(f"an onset needs a window of at least 2 samples, got {n}")
    own, other = _Single(nominal, rig, settings, n), _Single(fault, rig, settings, n)
    entry = _Entry(nominal, fault, other, settings)
    states, until, state = [], [0.0], copied(start)
    for k in range(0, n, STRIDE):
        states.append(copied(state))
        until.append(until[-1] + float(own.density(state, window, k, min(k + STRIDE, n)).sum()))

    def score(k: int) -> float:
        before, past = states[k // STRIDE], until[k // STRIDE]
        if k % STRIDE:
            before = copied(before)
            past += float(own.density(before, window, k - k % STRIDE, k).sum())
        return past + float(other.density(entry(before), window, k, n).sum())

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
    single = _Single(nominal, bank.rig, bank.settings, recent.t.size)
    state = copied(state)
    first = min(max(int(np.searchsorted(recent.t, first_s)), begin), end - 2)
    if first > begin:
        single.density(state, recent, begin, first)
    return find_onset(state, nominal, fault, recent.cut(first, end), bank.rig, bank.settings)
