"""Estimates to verdicts: one decision rule for the bank and for the open-loop mixture.

A verdict belongs to a move (an event): what a stop and a rest say cannot overturn it, except that they can show a sensor
to be dead. Everything is causal and works on chunks of any length, one sample included, so that a log, an hour in chunks
and a stream end in the same verdict.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import usual_step
from observer_fi.numerics import count_in_rows, runs
from observer_fi.physics import FAULTS, LABELS, NOMINAL, UNKNOWN, channel_of, label_of, words_of
from observer_fi.records import CHANNELS, Array, Consistency, Estimate, Event, Isolation
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.drift import STOP_S, TINY, Drift
from observer_fi.verdict.testable import NO_MOVE, not_tested

Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]
SPIKE = 50.0  # standard deviations that no fault reaches from one sample to the next and back
SETTLING = 8  # samples after a change of winner
LEAST = 40  # samples of a mean: of a right hypothesis that of fewer is often beyond the limits
STARTING = (
    4  # samples of a move: when between two of them it began, and so what is there at first, nobody knows
)
SHOWN_AT_REST = "the stop and the rest after the move show it"
AT_START_S = 0.02  # of a move: a fault may have been there before it


class Run(NamedTuple):
    """Since when a hypothesis has been certain, and since when nominal was doubted before that [s]."""

    since: float
    detected: float


def tested(estimate: Estimate, settings: DecisionSettings) -> Estimate:
    """The estimate with its mode probabilities after the absolute test of constants.

    A hypothesis whose own constants are beyond what rigs show explains the data with a plant that does not exist: its
    probability goes to "none of these".
    """
    if UNKNOWN not in estimate.modes or not estimate.strain.size:
        return estimate
    unknown = estimate.modes.index(UNKNOWN)
    strained = estimate.strain > settings.strain_limit
    strained[:, unknown] = False
    if not strained.any():
        return estimate
    p = estimate.probability.copy()
    p[:, unknown] += np.where(strained, p, 0.0).sum(axis=1)
    p[strained] = 0.0
    return replace(estimate, probability=p)


class Measured:
    """Which channels a log measures, as the innovations of the winner show; a failed sensor shows none of its own."""

    def __init__(self) -> None:
        self.there = np.zeros(len(CHANNELS), dtype=np.bool_)
        self.missed = np.zeros(len(CHANNELS), dtype=np.bool_)

    def add(self, e: Estimate) -> None:
        """Take more samples."""
        if self.there.all():
            return
        there = np.isfinite(e.normalised)
        self.there |= there.any(axis=0)
        if self.there.all():
            return
        winner = e.probability.argmax(axis=1)
        of_sensors = {channel_of(mode): j for j, mode in enumerate(e.modes)}
        for c, name in enumerate(CHANNELS):
            failed = of_sensors.get(name, -1)
            self.missed[c] |= bool((~there[:, c] & (winner != failed)).any())

    def lacks(self, channel: str) -> bool:
        """Whether the channel was missing wherever it could have been seen."""
        c = CHANNELS.index(channel)
        return bool(self.missed[c] and not self.there[c])


class EventTracker:
    """Follows one move through its chunks: `add` the samples of the move, then `verdict`."""

    def __init__(
        self,
        modes: tuple[str, ...],
        start_s: float,
        settings: DecisionSettings,
        channels: "Measured | None" = None,
        drift: Drift | None = None,
    ) -> None:
        self.modes = modes
        self.settings = settings
        self.drift = drift
        self.start_s = self.end_s = start_s
        self.step = 0.0
        self.certain: dict[int, Run] = {}
        self.latched: dict[int, Run] = {}
        self.doubted = np.nan
        self.first_doubt: float | None = None
        self.final: Array | None = None
        self.ratios = np.empty(0)
        self.nominal_ratios = np.empty(0)
        self.not_nominal = -np.inf
        self.winner = -1
        self.held = 0  # samples of the last winner in motion
        self.settled: Array | None = None  # what there was before it
        self.closed: dict[int, Run] = {}  # the last run of each that ended
        self.unsettled = np.zeros(SETTLING - 1, dtype=np.bool_)
        self.misfits: dict[int, float] = {}
        self.strained: set[int] = set()
        self.stop_nats = np.zeros(len(modes))
        self.stop_doubt: float | None = None
        self.rest_nis = np.zeros(len(modes))
        self.rest_samples = 0
        self.dof = 3.0  # channels
        self.channels = Measured() if channels is None else channels

    def add(self, e: Estimate, step: float) -> None:
        """Take the next samples of this move, its stop and the rest after it. step: from one to the next [s], 0 not known yet."""
        if not e.t.size:
            return
        self.end_s, self.step = float(e.t[-1]), step
        self.channels.add(e)
        if e.active.all():
            self._add_motion(e, step)
            return
        if e.active.any():
            self._add_motion(rows_of(e, _where(e.active)), step)
        still = _where(~e.active)
        self._add_stop(rows_of(e, still), step)
        self._add_rest(e.nis[still])

    def _add_motion(self, e: Estimate, step: float) -> None:
        p = e.probability
        winner = p.argmax(axis=1)
        self.strained |= set(
            np.flatnonzero((e.strain > self.settings.strain_limit).any(axis=0)).tolist()
            if e.strain.size
            else ()
        )
        self._misfit(e, winner, max(LEAST, round(self.settings.window_s / step)) if step else 0)
        if self.drift is not None and step:
            ours = np.where((winner == 0)[:, None], e.normalised, 0.0)
            self.drift.add(e.t, ours, step)
        nominal = p[:, 0] >= 0.5
        certain = p > self.settings.isolated
        for j in {*self.certain, *np.flatnonzero(certain.any(axis=0)).tolist()}:
            self._runs(j, e.t, certain[:, j], nominal)
        sure = np.flatnonzero(nominal)
        if sure.size:
            after = sure[-1] + 1
            self.doubted = float(e.t[after]) if after < e.t.size else np.nan
        elif np.isnan(self.doubted):
            self.doubted = float(e.t[0])
        self._settle(p, winner)

    def _settle(self, p: Array, winner: Rows) -> None:
        """Keep how long the winner has been it, and the probabilities before that."""
        bounds = [0, *(np.flatnonzero(np.diff(winner)) + 1).tolist(), len(p)]
        for first, last in pairwise(bounds):
            if self.final is not None and winner[first] != int(self.final.argmax()):
                self.settled = self.final if self.held >= SETTLING else self.settled
                self.held = 0
            self.held += last - first
            self.final = p[last - 1].copy()  # a stream's next samples stand in the same array

    def _at_the_end(self) -> Array | None:
        """The last probabilities in motion; those before it, where another winner came up just as the motion ended."""
        if self.rest_samples and self.held < SETTLING and self.settled is not None:
            return self.settled
        return self.final

    def _runs(self, j: int, t: Array, sure: Mask, nominal: Mask) -> None:
        """Update since when hypothesis j is certain; a long run that ends stays on record."""
        if not sure[0]:
            self._close(j, float(t[0]))
        elif j not in self.certain:
            self.certain[j] = Run(float(t[0]), self._doubted_before(0, t, nominal))
        for k in (np.flatnonzero(np.diff(sure)) + 1).tolist():
            if sure[k]:
                self.certain[j] = Run(float(t[k]), self._doubted_before(k, t, nominal))
            else:
                self._close(j, float(t[k]))

    def _close(self, j: int, now: float) -> None:
        run = self.certain.pop(j, None)
        self._doubt(j, run, now)
        if run is not None:
            self.closed[j] = run
        if run is None or j in self.latched or now - run.since < self.settings.latch_s:
            return
        if run.since - self.start_s < STARTING * self.step:
            return
        heals = FAULTS[label_of(self.modes[j])].heals  # nominal is entered from it, and so fits all the time
        if heals or self.not_nominal >= run.since:
            self.latched[j] = run

    def _doubt(self, j: int, run: Run | None, now: float) -> None:
        """Keep when a fault was first certain for a moment, though it may have come to nothing."""
        if j and run is not None and self.first_doubt is None and now - run.since >= self.settings.doubt_s:
            self.first_doubt = run.detected

    def _doubted_before(self, k: int, t: Array, nominal: Mask) -> float:
        """First sample after nominal was last more likely than not, up to sample k."""
        sure = np.flatnonzero(nominal[: k + 1])
        if sure.size:
            return float(t[min(sure[-1] + 1, t.size - 1)]) if sure[-1] < k else float(t[k])
        return float(t[0]) if np.isnan(self.doubted) else self.doubted

    def _misfit(self, e: Estimate, winner: Rows, window: int) -> None:
        """When the winner's mean NIS over a window, over its expectation, first exceeded what a right model shows.

        Samples on which no hypothesis is certain, or has only just become so, are not held against the winner.
        """
        measured = count_in_rows(np.isfinite(e.normalised))
        self._no_nominal(e, measured, window)
        here = np.arange(e.t.size)
        ratio = np.where(measured > 0, e.nis[here, winner] / np.maximum(measured, 1), 1.0)
        changed = np.diff(winner, prepend=self.winner) != 0
        changed |= e.probability[here, winner] <= self.settings.isolated
        changed = np.concatenate((self.unsettled, changed))
        settling = np.convolve(changed, np.ones(SETTLING), "valid") > 0
        joined = np.concatenate((self.ratios, np.where(settling, 1.0, ratio)))
        if joined.size >= window > 0:
            mean = np.convolve(joined, np.ones(window) / window, "valid")
            over = np.flatnonzero(mean > self.settings.nis_limit) + window - 1 - self.ratios.size
            wrong, first = np.unique(winner[over], return_index=True)
            for j, k in zip(wrong.tolist(), over[first].tolist(), strict=True):
                self.misfits.setdefault(j, float(e.t[k]))
        self.winner, self.unsettled = int(winner[-1]), changed[1 - SETTLING :]
        self.ratios = joined[-(window - 1) :]

    def _no_nominal(self, e: Estimate, measured: Rows, window: int) -> None:
        """When the mean NIS of nominal over a window last exceeded what the start of a rig that is off shows.

        measured (n,): channels that a sample has.
        """
        ratios = np.nan_to_num(e.nis[:, 0] / np.maximum(measured, 1))
        joined = np.concatenate((self.nominal_ratios, ratios))
        if joined.size >= window > 0:
            mean = np.convolve(joined, np.ones(window) / window, "valid")
            over = np.flatnonzero(mean > self.settings.latch_nis)
            if over.size:
                self.not_nominal = float(e.t[over[-1] + window - 1 - self.nominal_ratios.size])
        self.nominal_ratios = joined[-(window - 1) :]

    def _add_stop(self, e: Estimate, step: float) -> None:
        """Doubt a move where its stop makes a fault likely that its motion did not: it began as the motor was being stopped.

        What a stop says condemns no move; the whole move is asked about it.
        """
        p = self._at_the_end()
        left = round(STOP_S / step) - self.rest_samples if step else 0
        if self.drift is None or p is None or left <= 0:
            return
        ours = np.where((e.probability[:left].argmax(axis=1) == 0)[:, None], e.normalised[:left], 0.0)
        self.drift.add(e.t[:left], ours, step)
        if not e.density.size:
            return
        gains = np.nan_to_num(e.density[:left] - e.density[:left, :1]).cumsum(axis=0) + self.stop_nats
        self.stop_nats = gains[-1]
        faults = self._faults()
        odds = np.log(np.maximum(p[faults], TINY) / max(float(p[0]), TINY)) + gains[:, faults]
        likely = np.flatnonzero((odds > np.log(self.settings.stop_odds)).any(axis=1))
        if likely.size and self.stop_doubt is None:
            self.stop_doubt = float(e.t[likely[0]])

    def _add_rest(self, nis: Array) -> None:
        """Sum the NIS of every hypothesis over the stop and rest, at most ten times its expectation a sample."""
        self.rest_nis += self._capped(nis).sum(axis=0)
        self.rest_samples += nis.shape[0]

    def _capped(self, nis: Array) -> Array:
        return np.minimum(np.nan_to_num(nis), 10.0 * self.dof)

    def _rest_misfits(self, nis: Any, samples: Any) -> Any:
        """Whether the NIS of a hypothesis, summed over samples at rest, is beyond what a right one shows."""
        return nis >= self.settings.rest_limit * self.dof * samples

    def grounds(self) -> tuple[object, ...]:
        """What the label of the verdict depends on, besides the winner in motion and the evidence at rest."""
        there, missed = self.channels.there.tolist(), self.channels.missed.tolist()
        return tuple(self.latched), tuple(self.misfits), there, missed

    def rests_calmly(self, nis: Array) -> bool:
        """Whether more samples at rest, nis (n, m), leave the verdict of the motion as it is after each of them."""
        p = self._at_the_end()
        sums = self.rest_nis + self._capped(nis).cumsum(axis=0)
        samples = self.rest_samples + np.arange(1, len(nis) + 1)
        return p is not None and not self._rest_misfits(sums[:, int(p.argmax())], samples).any()

    def verdict(self) -> Event:
        """The verdict on the move so far."""
        p = self._at_the_end()
        p = np.eye(len(self.modes))[0] if p is None else p
        j = int(p.argmax())
        run = self.certain.get(j) or self.closed.get(j)
        reasons: list[str] = []
        if self.modes[j] == NOMINAL:
            came_and_went = {
                k: r for k, r in self.latched.items() if label_of(self.modes[k]) not in (NOMINAL, UNKNOWN)
            }
            if came_and_went:
                j, run = min(came_and_went.items(), key=lambda item: item[1].since)
                p = self._given(j, self.settings.isolated)
                reasons.append("the fault came and went within the move")
            else:
                j, run, p = self._after_rest(j, run, p, reasons)
        j, p = self._measured(j, p, reasons)
        if self.modes[j] == UNKNOWN and self.strained:
            names = ", ".join(words_of(self.modes[k]) for k in sorted(self.strained))
            reasons.append(f"{names} would fit only with constants that no rig shows")
        if j in self.misfits and self.modes[j] != UNKNOWN and UNKNOWN in self.modes:
            since = self.misfits[j]
            reasons.append(
                f"the best hypothesis, {words_of(self.modes[j])}, does not explain the innovations from {since:.3f} s on"
            )
            j, run = self.modes.index(UNKNOWN), Run(since, since)
            p = self._given(j, self.settings.isolated)
        return self._event(j, run, p, tuple(reasons))

    def _measured(self, j: int, p: Array, reasons: list[str]) -> tuple[int, Array]:
        """A sensor that is not there cannot have failed: what it would explain is something else."""
        channel = channel_of(self.modes[j])
        if channel is None or UNKNOWN not in self.modes or not self.channels.lacks(channel):
            return j, p
        reasons.append(f"the {channel} is not measured, so its sensor cannot be what is wrong")
        unknown, p = self.modes.index(UNKNOWN), p.copy()
        p[unknown] += p[j]
        p[j] = 0.0
        return unknown, p

    def _after_rest(
        self, j: int, run: Run | None, p: Array, reasons: list[str]
    ) -> tuple[int, Run | None, Array]:
        """A stop and rest that nominal cannot explain and one failed sensor can; a fault that can as well has its share."""
        sensors = [k for k, mode in enumerate(self.modes) if channel_of(mode)]
        if (
            not sensors
            or self.rest_samples == 0
            or not self._rest_misfits(self.rest_nis[j], self.rest_samples)
        ):
            return j, run, p
        best = self._of_a_rest(sensors)
        if 0.5 * (self.rest_nis[j] - self.rest_nis[best]) < self.settings.rest_evidence:
            return j, run, p
        reasons.append(SHOWN_AT_REST)
        worse = 0.5 * (self.rest_nis - self.rest_nis[best])
        alike = [k for k in self._faults() if worse[k] < self.settings.move_nats]
        p = self._given(best, self.settings.isolated)
        p[[best, *alike]] = p[best] / (1 + len(alike))
        return best, None, p

    def _of_a_rest(self, sensors: Sequence[int]) -> int:
        """The sensor that explains a rest: of several that do, as where one of two stood still, that which explains the stop."""
        fit = [k for k in sensors if not self._rest_misfits(self.rest_nis[k], self.rest_samples)]
        return (
            max(fit, key=lambda k: self.stop_nats[k]) if fit else min(sensors, key=lambda k: self.rest_nis[k])
        )

    def _faults(self) -> list[int]:
        """Hypotheses of a fault with a name that is no sensor's."""
        named = ((k, label_of(mode)) for k, mode in enumerate(self.modes) if not channel_of(mode))
        return [k for k, label in named if label not in (NOMINAL, UNKNOWN)]

    def _given(self, j: int, probability: float) -> Array:
        p = np.full(len(self.modes), (1.0 - probability) / (len(self.modes) - 1))
        p[j] = probability
        return p

    def _event(self, j: int, run: Run | None, p: Array, reasons: tuple[str, ...]) -> Event:
        mode = self.modes[j]
        posterior = dict.fromkeys(LABELS, 0.0)
        for name, value in zip(self.modes, p, strict=True):
            posterior[label_of(name)] += float(value)
        fault = label_of(mode) != NOMINAL
        even = [
            k for k in posterior if k != label_of(mode) and posterior[k] >= posterior[label_of(mode)] > 0.0
        ]
        return Event(
            label_of(mode), channel_of(mode), posterior[label_of(mode)], None, (None, None),
            run.detected if fault and run else None, run.since if run else None, self.start_s, self.end_s, posterior, reasons,
            alike=tuple(even), doubted_s=self._first_doubt(),
        )  # fmt: skip

    def _first_doubt(self) -> float | None:
        """When nominal was first doubted: by another hypothesis for a moment, by innovations that stay on one side, or a stop."""
        doubts = (self.first_doubt, self.drift.since if self.drift else None, self.stop_doubt)
        return min((s for s in doubts if s is not None), default=None)


def log_likelihood(e: Estimate) -> float:
    """Of the readings in motion under a whole bank [nats]: each sample's densities by the probabilities before it."""
    before = np.log(np.maximum(e.probability[:-1], TINY))
    nats = np.logaddexp.reduce(before + e.density[1:], axis=1)
    return float(nats[e.active[1:]].sum())


def rows_of(e: Estimate, rows: slice | Mask) -> Estimate:
    """Some samples of an estimate."""
    return Estimate(
        e.t[rows], e.modes, e.probability[rows], e.nis[rows], e.predicted[rows], e.normalised[rows], e.states[rows],
        e.active[rows], e.density[rows] if e.density.size else e.density, e.strain[rows] if e.strain.size else e.strain,
    )  # fmt: skip


def _where(mask: Mask) -> slice | Mask:
    """The mask, or the slice that it is where it has one run: of a slice nothing has to be copied."""
    first, last = runs(mask)
    return slice(int(first[0]), int(last[0])) if first.size == 1 else mask


class Isolator:
    """Cuts the stream of estimates into moves and keeps a verdict for each; O(1) in the length of a move.

    consistent: whether `result` will be asked for the consistency, which costs a fifth of a live sample.
    """

    def __init__(self, modes: tuple[str, ...], settings: DecisionSettings, consistent: bool = True) -> None:
        self.modes = modes
        self.settings = settings
        self.channels = Measured()
        self.current: EventTracker | None = None
        self.events: list[Event] = []
        self.fit = Whiteness() if consistent else None
        self.was_active = self.stopped = False
        self.step = 0.0

    def add(self, e: Estimate) -> Iterator[EventTracker]:
        """Take the next samples; yields the tracker of the current move after each piece of a move."""
        if not self.step and e.t.size > 1:
            self.step = usual_step(e.t)
        e = tested(e, self.settings)
        if self.fit is not None:
            self.fit.add(e)
        starts = self._new_moves(e)
        edges = [0, *starts, e.t.size]
        for k, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            if k > 0:
                self._finish()
                drift = None if self.fit is None else Drift()
                self.current = EventTracker(self.modes, float(e.t[a]), self.settings, self.channels, drift)
            if self.current is not None and b > a:
                self.current.add(rows_of(e, slice(a, b)), self.step)
                yield self.current

    def _new_moves(self, e: Estimate) -> list[int]:
        """Samples at which a move begins. A pause in the evidence that is no stop (a slower command) ends none."""
        if not e.t.size:
            return []
        still = np.flatnonzero(e.states[:, 3] == 0.0)
        begins: list[int] = []
        last = 0
        for k in np.flatnonzero(e.active & ~np.append(self.was_active, e.active[:-1])).tolist():
            self.stopped |= bool(np.searchsorted(still, k) > np.searchsorted(still, last))
            if self.stopped or (self.current is None and not begins):
                begins.append(k)
            self.stopped, last = False, k
        self.stopped |= bool(still.size and still[-1] >= last)
        self.was_active = bool(e.active[-1])
        return begins

    def _finish(self) -> None:
        if self.current is not None:
            self.events.append(self.current.verdict())

    def result(self) -> Isolation:
        """Verdicts on all moves so far. The log's verdict is its first fault, or its last move where there is none."""
        events = [*self.events, *([self.current.verdict()] if self.current is not None else [])]
        return Isolation(log_verdict(events), tuple(events), (self.fit or Whiteness()).result())


def log_verdict(events: list[Event]) -> Event:
    """One verdict for a log: the first move with a fault; else the least certain of the healthy ones; not tested
    without any."""
    faults = [e for e in events if e.label != NOMINAL]
    if faults:
        return faults[0]
    if events:
        return min(events, key=lambda e: e.probability)
    return not_tested(NO_MOVE)


# Why a move whose rest no hypothesis explains is unknown.
OF_THE_REST = ("something happened in the rest after the move that no hypothesis explains",)


def handed_on(events: list[Event]) -> list[Event]:
    """Verdicts of moves in order, where a fault of the rest between two moves is told of the second one only.

    A rest alone makes a failed sensor of it, or something unknown; the move behind it, faulty from its start on, says what it is.
    """
    out = list(events)
    for k, (event, after) in enumerate(pairwise(events)):
        begin = after.onset_s
        of_rest = shown_by_rest(event) and after.label not in (NOMINAL, UNKNOWN, event.label)
        if of_rest and begin is not None and begin - after.start_s < AT_START_S:
            out[k] = healthy(event)
    return out


def shown_by_rest(event: Event) -> bool:
    """Whether only the rest after a move made a failed sensor of it, or a fault without a name."""
    return (event.channel is not None and event.detected_s is None) or event.reasons == OF_THE_REST


def healthy(event: Event) -> Event:
    """The event without its fault: with the one that came behind it, or healthy."""
    if event.then:
        return event.then[0]._replace(end_s=event.end_s, then=event.then[1:])
    return event._replace(
        label=NOMINAL, channel=None, probability=1.0, posterior={k: float(k == NOMINAL) for k in event.posterior},
        onset_s=None, onset_interval_s=(None, None), detected_s=None, isolated_s=None, alike=(), reasons=(),
    )  # fmt: skip


def _spikes(normalised: Array) -> Mask:
    """Readings that stand alone, or in twos, where no model is near: an interference on a wire says nothing of the fit. [n, c]"""
    gross = np.abs(normalised) > SPIKE
    if not gross.any():
        return gross
    lasting = np.zeros((len(gross) + 4, gross.shape[1]), dtype=bool)
    three = gross[:-2] & gross[1:-1] & gross[2:]
    for k in range(3):
        lasting[k : k + len(three)] |= three
    return gross & ~lasting[: len(gross)]


class Whiteness:
    """Mean NIS of the winner while moving, and Ljung-Box whiteness of its innovations in steady motion, accumulated.

    Transients are left out of the whiteness: there the filter widens its noise by what the timing of a sampled servo puts
    in doubt, so innovations are smaller than their standard deviation and smooth, by design.
    """

    LAGS = 10
    STEADY = 0.02  # speed within this share of the command

    def __init__(self) -> None:
        self.nis = self.expected = 0.0
        self.samples = 0
        self.products = np.zeros((self.LAGS + 1, len(CHANNELS)))
        self.counts = np.zeros(len(CHANNELS))
        self.last = np.empty((0, len(CHANNELS)))

    def add(self, e: Estimate) -> None:
        """Take the next samples."""
        v = e.normalised[e.active]
        if not v.size:
            return
        good = np.isfinite(v) & ~_spikes(v)
        self.nis += float((np.where(good, v, 0.0) ** 2).sum())
        self.expected += float(good.sum())
        self.samples += int(np.count_nonzero(count_in_rows(good)))
        speed, command = e.states[e.active, 0], e.states[e.active, 3]
        good &= (np.abs(speed - command) < self.STEADY * np.abs(command))[:, None]
        u = np.clip(np.where(good, v, 0.0), -5.0, 5.0)
        self.counts += good.sum(axis=0)
        old, joined = self.last.shape[0], np.concatenate((self.last, u))
        for lag in range(min(self.LAGS + 1, joined.shape[0])):
            first = max(old, lag)
            self.products[lag] += (joined[first:] * joined[first - lag : joined.shape[0] - lag]).sum(axis=0)
        self.last = joined[-self.LAGS :]

    def result(self) -> Consistency:
        """Ljung-Box (1978) over 10 lags: the smallest of the channels' p-values times their number (Bonferroni)."""
        if not self.samples:
            return Consistency(float("nan"), 3.0, float("nan"))
        p = []
        for c in np.flatnonzero(self.counts > 5 * self.LAGS):
            n = self.counts[c]
            rho = (
                self.products[1:, c] / self.products[0, c]
                if self.products[0, c] > 0.0
                else np.zeros(self.LAGS)
            )
            q = n * (n + 2.0) * (rho**2 / (n - np.arange(1, self.LAGS + 1))).sum()
            p.append(_chi_square_tail(float(q), self.LAGS))
        return Consistency(
            self.nis / self.samples,
            self.expected / self.samples,
            min(1.0, min(p) * len(p)) if p else float("nan"),
        )


def _chi_square_tail(q: float, freedoms: int) -> float:
    """Probability that a chi-square with an even number of degrees of freedom exceeds q.

    It is the chance of fewer than half as many events where q / 2 are expected (Poisson); scipy.special has it for any
    number, and takes a tenth of a second to import.
    """
    terms = np.cumprod(np.concatenate(([1.0], 0.5 * q / np.arange(1, freedoms // 2))))
    return float(np.exp(-0.5 * q) * terms.sum())
