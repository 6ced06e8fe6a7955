"""When a fault began: the nominal filter until tau, the fault's filter from tau on, over every tau of a window.

Uses samples after tau (smoothing). With a flat prior over tau the likelihoods of all tau are the posterior of the onset;
its median and its 95 % interval are what a report states.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import (
    Bank,
    Hypothesis,
    HypothesisState,
    LogSamples,
    Visits,
    arrays,
    bank_rows,
    bank_state_of,
    entries,
    start,
    state_of,
    state_places,
    states_of,
    tuning,
    visits_of,
    work_arrays,
    write_state,
)
from observer_fi.bank import compiled_bank as kernels
from observer_fi.numerics import MOST
from observer_fi.physics import INDEX, Rig
from observer_fi.records import Array
from observer_fi.settings import BankSettings

ROOM = 1600  # samples that filters take at once
STRIDE = 4  # samples between the taus of the first pass


class Onset(NamedTuple):
    """Posterior median of the onset and its central 95 % interval [s]."""

    median: float
    low: float
    high: float


class _SideBySide:
    """`count` filters of one hypothesis over windows of at most n samples: they give each other nothing."""

    def __init__(self, hypothesis: Hypothesis, rig: Rig, settings: BankSettings, count: int, n: int) -> None:
        hypotheses = (hypothesis,) * count
        b = arrays(hypotheses, rig, settings)
        self.rows, self.room = bank_rows(hypotheses, b), n
        self.seats = state_places(self.rows, 0)  # all have the same
        self.state = bank_state_of(self.rows, start(hypotheses, b, np.zeros(3), 0.0, rig.watched))
        self.tuning, self.scratch = tuning(settings), work_arrays(self.rows)
        self.prior, self.noise = (b.entry_mean[0], b.entry_var[0]), b.noise
        self.unvisited = visits_of(self.rows, [])
        self.still, self.out = np.zeros(n, dtype=np.bool_), kernels.written(n, count)

    def begin(self, memory: HypothesisState) -> None:
        """The filters with the first of them there; the others may hold anything until they are put in."""
        self.state.z[:], self.state.t[:], self.state.stopped[:] = memory.z, memory.t, memory.stopped
        self.put(0, memory)

    def put(self, row: int, memory: HypothesisState) -> None:
        """One more filter."""
        write_state(self.state, row, self.seats, memory)

    def memory(self) -> HypothesisState:
        """What the first filter remembers."""
        return state_of(self.state, 0, self.seats)

    def density(self, w: LogSamples, first: int, last: int) -> Array:
        """Log-densities of samples first:last, (last - first, count), a step of all filters; of any number of samples a copy."""
        if last - first > self.room:
            return np.concatenate([self.density(w, a, b).copy() for a, b in self._pieces(first, last)])
        return self._run(w, first, last, self.unvisited)

    def _run(self, w: LogSamples, first: int, last: int, visits: Visits) -> Array:
        out = self.out.cut(0, last - first)
        feed = w.cut(first, last)._replace(active=self.still[: last - first])
        kernels.run(self.rows, self.tuning, self.state, self.scratch, feed, out, visits)
        return out.density

    def joined(self, w: LogSamples, entered: Mapping[int, HypothesisState], last: int) -> Array:
        """Log-densities of the samples from the first of `entered` to `last`, (k, count): a filter for each, from its sample on.

        Before its sample a filter gives numbers that mean nothing.
        """
        samples = sorted(entered)
        self.begin(entered[samples[0]])
        found = []
        for a, b in self._pieces(samples[0], last):
            here = [k for k in samples if a <= k < b]
            visits = self.unvisited
            if here:
                visits = entries(self.rows, [k - a for k in here], self.seats, [entered[k] for k in here])
                visits.row[:] = [samples.index(k) for k in here]
            found.append(self._run(w, a, b, visits).copy())
        return np.concatenate(found) if found else np.empty((0, self.out.density.shape[1]))

    def followed(
        self, w: LogSamples, memory: HypothesisState, samples: Sequence[int]
    ) -> tuple[list[HypothesisState], Array, Array]:
        """What the first filter remembers before each of these samples but the first, where it begins.

        And the log-density and misfit of every sample up to the last of them.
        """
        self.begin(memory)
        memories, densities, misfits = [], [], []
        for a, b in self._pieces(samples[0], samples[-1]):
            visits = visits_of(self.rows, [k - a for k in samples if a < k <= b])
            densities.append(self._run(w, a, b, visits)[:, 0].copy())
            misfits.append(self.misfit(b - a)[:, 0].copy())
            memories += states_of(visits, self.seats)
        return memories, np.concatenate(densities), np.concatenate(misfits)

    def _pieces(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        return itertools.pairwise([*range(first, last, self.room), last])

    def misfit(self, samples: int) -> Array:
        """Normalised innovation squared of the samples that `density` last took, (samples, count)."""
        return self.out.nis[:samples]

    def normalised(self, samples: int) -> Array:
        """Innovations of the first filter over their deviations, of the samples that `density` last took, (samples, 3)."""
        return self.out.normalised[:samples]


class Filters:
    """The filters that searches for onsets share: making them costs as much as a search."""

    def __init__(self, rig: Rig, settings: BankSettings) -> None:
        self.rig, self.settings = rig, settings
        self.made: dict[tuple[Hypothesis, int], _SideBySide] = {}

    def of(self, hypothesis: Hypothesis, count: int, n: int) -> _SideBySide:
        """`count` filters of a hypothesis for windows of n samples."""
        found = self.made.get((hypothesis, count))
        if found is None or found.room < n:
            found = _SideBySide(hypothesis, self.rig, self.settings, count, n)
            self.made[hypothesis, count] = found
        return found


class Entry:
    """How a hypothesis is entered from another: shared states are kept, the others come from their entry prior, or from `known`.

    known: what `kept` remembered of states that the source does not have, nominal's friction while the coupling was lost.
    near: what the target itself found of its fault's constants: they begin there, where its equations are linear enough, with
    the width of their prior. `far`: nats that this is from the mean of the prior, which the first sample does not pay.
    within_s: time within which the fault sets in, and with it a torque like friction's and a mass that stops following.
    """

    def __init__(
        self,
        source: Hypothesis,
        target: Hypothesis,
        filters: Filters,
        known: tuple[Hypothesis, HypothesisState] | None = None,
        near: HypothesisState | None = None,
        within_s: float = 0.0,
    ) -> None:
        self.within_s = within_s
        f = filters.of(target, 1, ROOM)
        n, (mean, var) = len(target.states), f.prior
        self.x, self.P, self.bias = mean[:n].copy(), np.diag(var[:n]), np.zeros(2)
        if target.failed >= 0:
            self.bias[1] = filters.settings.bias_entry**2 * f.noise[target.failed]
        self.far = self._begin_near(target, near) if near is not None else 0.0
        if known is not None:
            self._fill(target, *known, [s for s in known[0].states if s not in source.states])
        self.to, self.at = _places(target, source, list(source.states))
        self.jumps = target.model["A"] / target.model["J"], target.model["D"]
        self.w, self.position = target.states.index("w"), target.states.index("x")

    def _begin_near(self, target: Hypothesis, near: HypothesisState) -> float:
        constants = [
            k for k, s in enumerate(target.states) if s in INDEX and s in {o.name for o in target.own}
        ]
        far = near.x[constants] - self.x[constants]
        self.x[constants] += far
        return float(0.5 * (far**2 / self.P[constants, constants]).sum())

    def _fill(self, target: Hypothesis, kept: Hypothesis, memory: HypothesisState, states: list[str]) -> None:
        to, at = _places(target, kept, states)
        self.x[to] = memory.x[at]
        self.P[to[:, None], to] = memory.P[at[:, None], at]

    def __call__(self, source: HypothesisState) -> HypothesisState:
        """The target's memory from the source's."""
        x, P = self.x.copy(), self.P.copy()
        x[self.to] = source.x[self.at]
        P[self.to[:, None], self.to] = source.P[self.at[:, None], self.at]
        if self.within_s:
            P[self.w, self.w] += (self.jumps[0] * self.within_s) ** 2 / 12.0
            P[self.position, self.position] += (self.jumps[1] * x[self.w] * self.within_s) ** 2 / 12.0
        return source._replace(x=x, P=P, bias=self.bias)


def _places(
    target: Hypothesis, source: Hypothesis, states: list[str]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where target and source have those of the states that both have."""
    both = [state for state in target.states if state in source.states and state in states]
    to = np.array([target.states.index(s) for s in both], dtype=np.int64)
    return to, np.array([source.states.index(s) for s in both], dtype=np.int64)


class _Scores:
    """Log-likelihood of a window with an onset at a sample: nominal before it, the fault from it on."""

    def __init__(
        self,
        start: HypothesisState,
        nominal: Hypothesis,
        fault: Hypothesis,
        window: LogSamples,
        filters: Filters,
    ) -> None:
        n = window.t.size
        self.window, self.n = window, n
        self.own, self.others = filters.of(nominal, 1, n), filters.of(fault, MOST, n)
        self.entry = Entry(nominal, fault, filters)
        samples = [*range(0, n, STRIDE), n]
        later, density, _ = self.own.followed(window, start, samples)
        self.memories = [start, *later]
        self.until = np.concatenate(([0.0], np.cumsum(density)))[samples].tolist()

    def _before(self, k: int) -> tuple[HypothesisState, float]:
        """The nominal filter before sample k, and its log-likelihood until then."""
        memory, past, extra = self.memories[k // STRIDE], self.until[k // STRIDE], k % STRIDE
        if extra:
            self.own.begin(memory)
            past += float(self.own.density(self.window, k - extra, k).sum())
            memory = self.own.memory()
        return memory, past

    def at(self, samples: list[int]) -> dict[int, float]:
        """Of onsets at increasing samples: MOST filters side by side, which join one after the other."""
        found: dict[int, float] = {}
        for first in range(0, len(samples), MOST):
            found |= self._together(samples[first : first + MOST])
        return found

    def _together(self, samples: list[int]) -> dict[int, float]:
        before = [self._before(k) for k in samples]
        entered = [self.entry(memory) for memory, _ in before]
        density = self.others.joined(self.window, dict(zip(samples, entered, strict=True)), self.n)
        return {
            k: past + float(density[k - samples[0] :, row].sum())
            for row, (k, (_, past)) in enumerate(zip(samples, before, strict=True))
        }


def find_onset(
    start: HypothesisState, nominal: Hypothesis, fault: Hypothesis, window: LogSamples, filters: Filters
) -> Onset:
    """Onset of `fault` within `window`, from the nominal hypothesis' memory before its first sample.

    Raises ValueError for a window of fewer than two samples.
    """
    n = window.t.size
    if n < 2:
        raise ValueError(f"an onset needs a window of at least 2 samples, got {n}")
    scores = _Scores(start, nominal, fault, window, filters)
    found = scores.at(list(range(0, n, STRIDE)))
    best = max(found, key=lambda k: found[k])
    near = [k for k in range(max(0, best - 2 * STRIDE), min(n, best + 2 * STRIDE + 1)) if k not in found]
    found |= scores.at(near)
    return _posterior(window.t, found, during=fault.failed < 0)


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


def onset_in(
    bank: Bank, fault: Hypothesis, first_s: float, last_s: float, filters: Filters | None = None
) -> Onset | None:
    """Onset of `fault` between two times, from the samples and snapshots that a bank keeps; None where they are gone.

    filters: those of earlier searches with the bank's rig and settings.
    """
    filters = filters or Filters(bank.rig, bank.settings)
    recent = bank.recent
    starts = [(t, state) for t, state in bank.snapshots if t <= first_s]
    if recent is None or not bank.snapshots or first_s >= recent.t[-1]:
        return None
    since, state = starts[-1] if starts else bank.snapshots[0]
    begin, end = (int(k) for k in np.searchsorted(recent.t, [since - 1e-9, last_s]))
    if end - begin < 2:
        return None
    nominal = bank.hypotheses[0]
    first = min(max(int(np.searchsorted(recent.t, first_s)), begin), end - 2)
    if first > begin:
        alone = filters.of(nominal, 1, first - begin)
        alone.begin(state)
        alone.density(recent, begin, first)
        state = alone.memory()
    return find_onset(state, nominal, fault, recent.cut(first, end), filters)
