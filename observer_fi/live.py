"""The bank and its verdicts on a stream: the numbers of a whole log, one sample or a small batch at a time.

`LiveBank` allocates nothing per sample and remembers nothing but its state. `Live` adds the verdicts, and reports a
change at the same sample whatever the batches were.
"""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi import beginning, feed, kernels
from observer_fi.diagnose import make_bank
from observer_fi.isolate import Isolator, channel_of, label_of, log_verdict, tested
from observer_fi.models import Rig
from observer_fi.records import LABELS, Array, Estimate, Event, Log
from observer_fi.settings import BankSettings, Settings

MOST = 256  # samples of a batch


class Row(NamedTuple):
    """One sample, SI units and degrees; NaN marks a missing reading."""

    t: float
    voltage: float
    current: float
    position: float
    pitch: float
    w_cmd: float


class LiveBank(kernels.Bank):
    """A bank whose arrays for up to MOST samples exist once: what `step` returns is overwritten by the next call."""

    def __init__(self, rig: Rig, settings: BankSettings, filter_kind: str = "ekf") -> None:
        super().__init__(rig, settings, filter_kind=filter_kind)
        m = len(self.hypotheses)
        self.names = tuple(h.name for h in self.hypotheses)
        self.t, self.w_cmd, self.pitch, self.z = (
            np.empty(MOST),
            np.empty(MOST),
            np.empty(MOST),
            np.empty((MOST, 3)),
        )
        self.late, self.active = np.empty(MOST), np.empty(MOST, dtype=np.bool_)
        self.interval = np.empty((MOST, 2))
        shapes = ((m,), (m,), (m, 3), (3,), (4,), (m,), (m,))
        self.out = tuple(np.empty((MOST, *shape)) for shape in shapes)
        self.views: dict[int, tuple[tuple[Array, ...], Estimate]] = {}

    def advance(self, log: Log) -> Estimate:
        """As the bank of a log, without the samples that it keeps for onsets."""
        estimate = super().advance(log)
        self.recent = None
        self.snapshots.clear()
        if self.interval.shape[1] != 2 * self.commands.substeps:
            self.interval = np.empty((MOST, 2 * self.commands.substeps))
            self.views.clear()
        return estimate

    def step(self, rows: Sequence[Row]) -> Estimate:
        """Estimate of at most MOST samples behind those of `advance`."""
        n = len(rows)
        if self.state is None or not self._regular(rows):
            return self.advance(log_of(rows))
        for k, row in enumerate(rows):
            self.t[k] = row[0]
            self.z[k] = row[1:4]
            self.pitch[k], self.w_cmd[k] = row[4], row[5]
        (t, w_cmd, pitch, z, late, interval, active, *out), estimate = self._views(n)
        self.commands.fill(t, w_cmd, late, interval)
        active[:] = kernels.under_way(interval, late)
        self.run(
            self.rows, self.tuning, self.state, self.scratch, t, interval, late, pitch, z, active, *out,
        )  # fmt: skip
        self.samples.t, self.samples.w, self.samples.theta = rows[-1].t, rows[-1].w_cmd, rows[-1].pitch
        return estimate

    def _regular(self, rows: Sequence[Row]) -> bool:
        """Whether `LogStream` would take the rows as they are: no gap, nothing that can be no reading."""
        before, longest, largest = self.samples.t, self.samples.longest * (1.0 + 1e-6), feed.LARGEST
        for t, v, i, x, pitch, w_cmd in rows:
            if not (t - before <= longest and -180.0 <= pitch <= 180.0 and -largest <= w_cmd <= largest):
                return False
            if abs(v) >= largest or abs(i) >= largest or abs(x) >= largest:
                return False
            before = t
        return True

    def _views(self, n: int) -> tuple[tuple[Array, ...], Estimate]:
        if n not in self.views:
            arrays = (
                self.t, self.w_cmd, self.pitch, self.z, self.late, self.interval, self.active, *self.out
            )  # fmt: skip
            cut = tuple(a[:n] for a in arrays)
            t, active, (mu, nis, y, seen, states, density, strain) = cut[0], cut[6], cut[7:]
            self.views[n] = cut, Estimate(t, self.names, mu, nis, y, seen, states, active, density, strain)  # type: ignore[arg-type]
        return self.views[n]


def log_of(rows: Sequence[Row]) -> Log:
    """Samples as a log."""
    table = np.array(rows, dtype=np.float64).reshape(-1, len(Row._fields))
    t, z, pitch, w_cmd = table[:, 0].copy(), table[:, 1:4].copy(), table[:, 4].copy(), table[:, 5].copy()
    return Log("stream", t, z, w_cmd, pitch)


class Change(NamedTuple):
    """A verdict that is another than before: time [s] and number of the sample, the verdict, and the number of the move."""

    time_s: float
    event: Event
    moves: int
    samples: int


class Live:
    """One stream under way: `add` samples in order, take the changes of the verdict.

    The first samples are held until the sampling interval and the first readings are known (at most START_ROWS).
    """

    def __init__(
        self, rig: Rig, settings: Settings, engine: str = "compiled", filter_kind: str = "ekf"
    ) -> None:
        compiled = engine == "compiled"
        self.fast = LiveBank(rig, settings.bank, filter_kind) if compiled else None
        self.bank = self.fast or make_bank(rig, settings, engine, filter_kind)
        modes = tuple(h.name for h in self.bank.hypotheses)
        self.settings = settings.decision
        self.labels = tuple((label_of(mode), channel_of(mode)) for mode in modes)
        self.isolator = Isolator(modes, settings.decision)
        self.held: list[Row] | None = []
        self.told: tuple[str, str | None] | None = None
        self.samples = self.moves = self.faulty = 0
        self.posterior: dict[str, float] = dict.fromkeys(LABELS, 0.0) | {"nominal": 1.0}

    def add(self, rows: Sequence[Row]) -> Iterator[tuple[Estimate, list[Change]]]:
        """The estimate of the samples, with tested probabilities, and the changes that they bring, batch by batch."""
        if self.held is not None:
            self.held.extend(rows)
            if not self._ready(self.held):
                return
            rows, self.held = self.held, None
            yield self._judged(self.bank.advance(log_of(rows)))
            return
        for first in range(0, len(rows), MOST):
            batch = rows[first : first + MOST]
            yield self._judged(self.fast.step(batch) if self.fast else self.bank.advance(log_of(batch)))

    def finish(self) -> Iterator[tuple[Estimate, list[Change]]]:
        """What the samples say that were still held when the stream ended."""
        rows, self.held = self.held, None
        if rows:
            yield self._judged(self.bank.advance(log_of(rows)))

    @staticmethod
    def _ready(rows: Sequence[Row]) -> bool:
        if len(rows) >= beginning.START_ROWS:
            return True
        seen = np.isfinite(np.array(rows)[:, 1:4]).sum(axis=0)
        return len(rows) > feed.SETTLING and bool((seen >= beginning.START_READINGS).all())

    def verdict(self) -> Event:
        """The verdict on the move under way, or on the last one."""
        tracker = self.isolator.current
        return log_verdict([]) if tracker is None else tracker.verdict()

    def _judged(self, e: Estimate) -> tuple[Estimate, list[Change]]:
        seen = self.samples
        self.samples += e.t.size
        e = tested(e, self.settings)
        if e.t.size > 2 and self._quiet(e):
            return e, []
        changes = []
        for k in range(e.t.size):
            self._track(self.isolator, row_of(e, k) if e.t.size > 1 else e)
            change = self._change(float(e.t[k]), bool(e.active[k]))
            if change is not None:
                changes.append(change._replace(samples=seen + k + 1))
        return e, changes

    def _quiet(self, e: Estimate) -> bool:
        """Take a batch at once if no sample of it can change the verdict; else leave everything as it was."""
        if not (e.active == self.isolator.was_active).all():
            return False
        sure = np.flatnonzero((e.probability > self.settings.isolated).any(axis=0))
        if e.active[0] and any(self.labels[j] != self.told for j in sure):
            return False
        trial = copy.deepcopy(self.isolator, {id(self.settings): self.settings})
        before = self.told
        self._track(trial, e)
        self.isolator, trial = trial, self.isolator
        if self._change(float(e.t[-1]), bool(e.active[-1])) is None:
            return True
        self.isolator, self.told = trial, before
        return False

    def _track(self, isolator: Isolator, e: Estimate) -> None:
        move = isolator.current
        for _ in isolator.add(e):
            pass
        self.moves += isolator.current is not move
        for event in isolator.events:
            self.faulty += event.label != "nominal"
        isolator.events.clear()

    def _change(self, now: float, active: bool) -> Change | None:
        """The verdict where it is certain, or its move has ended, and is another than the one last told."""
        tracker = self.isolator.current
        if tracker is None:
            return None
        event = tracker.verdict()
        which = (event.label, event.channel)
        if which == self.told or (active and event.probability < self.settings.isolated):
            return None
        self.told = which
        return Change(now, event, self.moves, self.samples)


def row_of(e: Estimate, k: int) -> Estimate:
    """One sample of an estimate."""
    return replace(e, **{name: getattr(e, name)[k : k + 1] for name in _ROWS})


_ROWS = ("t", "probability", "nis", "predicted", "normalised", "states", "active", "density", "strain")
