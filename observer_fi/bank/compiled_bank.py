"""The bank, compiled: interacting multiple models of Kalman filters, one sample at a time, all hypotheses side by side.

A channel that is NaN is left out of every hypothesis alike; rates are per second. The state of a bank is O(1) in the length
of the log (`BankState`), so that a file in chunks, a stream and a whole log give the same numbers. The filterpy bank of
`observers.py` is the oracle.
"""

import copy
import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import ekf as extended
from observer_fi.bank import transition as tr
from observer_fi.bank import ukf as unscented
from observer_fi.bank.bank_state import (
    BankState,
    HypothesisState,
    bank_state_of,
    state_of,
    state_places,
    visits_of,
    write_state,
)
from observer_fi.bank.first_state import first_readings, held_at_first, start
from observer_fi.bank.hypotheses import MOTION, Hypothesis, arrays, bank
from observer_fi.bank.imm import mix, posterior
from observer_fi.bank.log_feed import CommandStream, LogStream
from observer_fi.bank.packing import bank_rows, tuning
from observer_fi.bank.work_arrays import rows_of, work_arrays
from observer_fi.numerics import (
    aligned_empty,
    any_of_rare,
    inlined,
    maximum,
    sqrt,
    uncounted,
    where_above,
    zeros_like,
)
from observer_fi.physics import Rig
from observer_fi.records import Array, Estimate, Log
from observer_fi.settings import BankSettings

BLOCK = 1600  # samples between two snapshots: a call of the kernel costs as much as fifty samples
LITTLE = 0.1  # of the friction's current: as much comes and goes in steady motion
TAIL_S = 3.0  # of the chunk before, kept so that an onset can be looked for across a boundary


class LogSamples(NamedTuple):
    """n samples as the loops take them.

    t (n,) s; interval (n, 2 m) command at the half-steps of the interval that ends at a sample, w_cmd (n,) at the sample
    [rad/s]; theta (n,) deg; z (n, 3) readings; active (n,) whether a sample counts as evidence.
    """

    t: Array
    interval: Array
    w_cmd: Array
    theta: Array
    z: Array
    active: NDArray[np.bool_]

    def cut(self, first: int, last: int) -> "LogSamples":
        """Samples first:last."""
        part = slice(first, last)
        return LogSamples(
            self.t[part], self.interval[part], self.w_cmd[part], self.theta[part], self.z[part], self.active[part]
        )  # fmt: skip

    def after(self, before: "LogSamples | None") -> "LogSamples":
        """These samples behind the tail of the ones before."""
        if before is None:
            return self
        tail = before.t >= before.t[-1] - TAIL_S
        return LogSamples(
            np.concatenate((before.t[tail], self.t)),
            np.concatenate((before.interval[tail], self.interval)),
            np.concatenate((before.w_cmd[tail], self.w_cmd)),
            np.concatenate((before.theta[tail], self.theta)),
            np.concatenate((before.z[tail], self.z)),
            np.concatenate((before.active[tail], self.active)),
        )


class Written(NamedTuple):
    """What the loops write of n samples: the arrays of Estimate that are no part of Feed, which see for shapes."""

    probability: Array
    nis: Array
    predicted: Array
    normalised: Array
    states: Array
    density: Array
    strain: Array

    def cut(self, first: int, last: int) -> "Written":
        """Samples first:last."""
        return Written(*(a[first:last] for a in self))


def written(n: int, m: int) -> Written:
    """Arrays for n samples of m hypotheses."""
    mu, nis, density, strain, y, seen, states = in_one_piece(
        (n, m), (n, m), (n, m), (n, m), (n, m, 3), (n, 3), (n, 4)
    )
    return Written(mu, nis, y, seen, states, density, strain)


@inlined
def _begin(b, tune, state, scr, r, dt, feed, k, first):
    """Mix the hypotheses where sample k counts as evidence, from r.x, r.P into r.to_x, r.to_P; whether it does."""
    mixing = feed.active[k] and not first
    if feed.w_cmd[k] == 0.0:
        state.stopped[0] = 1.0
    if mixing:
        mix(b, tune, scr, r, state, dt, state.stopped[0] == 1.0)
        state.stopped[0] = 0.0
    return mixing


@inlined
def _lost(b, r):
    """1 for a hypothesis beyond what any reading can have meant: its numbers would soon be no numbers."""
    far, wide, negative = zeros_like(r.x[0]), zeros_like(r.x[0]), zeros_like(r.x[0])
    for k in range(b.n):
        far, wide = far + abs(r.x[k]), wide + abs(r.P[k, k])
        negative = maximum(negative, -r.P[k, k])
    kept = where_above(tr.FARTHEST, far, 1.0, 0.0) * where_above(tr.WIDEST, wide, 1.0, 0.0)
    return 1.0 - kept * where_above(1.0, negative, 1.0, 0.0)


@inlined
def _start_anew(b, r, state, lost):
    """Lost hypotheses at rest where the position sensor last saw the mass, everything else at the entry prior."""
    position = state.z[2]
    for k in range(b.n):
        for q in range(k, b.n):
            r.P[k, q] = where_above(lost, 0.0, r.entry_var[k] if q == k else zeros_like(lost), r.P[k, q])
        r.x[k] = where_above(lost, 0.0, r.entry_mean[k], r.x[k])
    if position == position:
        r.x[2] = where_above(lost, 0.0, position, r.x[2])
    for k in range(b.carried):
        r.slow[k] = where_above(lost, 0.0, r.slow_at_rest[k], r.slow[k])
    r.bias[0], r.bias[1] = (
        where_above(lost, 0.0, 0.0, r.bias[0]),
        where_above(lost, 0.0, r.failed_noise[0], r.bias[1]),
    )


@inlined
def _strain(b, r):
    """How far hypotheses had to stretch constants that only they have, in prior standard deviations."""
    worst = zeros_like(r.x[0])
    for k in range(3, b.n):
        off = r.x[k] - r.entry_mean[k]
        worst = maximum(r.own[k] * (off * off) / where_above(r.own[k], 0.0, r.entry_var[k], 1.0), worst)
    return sqrt(worst)


@inlined
def _finish(b, state, scr, r, feed, out, k):
    """Everything that is written of sample k."""
    if b.strained:
        r.strain[0] = _strain(b, r)
    for c in range(3):
        r.predicted[c] = r.y[c]
        if feed.z[k, c] == feed.z[k, c]:
            state.z[c] = feed.z[k, c]
    best = 0
    for j in range(b.m):
        out.probability[k, j], out.nis[k, j] = state.mu[0, j], scr.nis[0, j]
        out.density[k, j], out.strain[k, j] = scr.density[0, j], scr.strain[0, j]
        if state.mu[0, j] > state.mu[0, best]:
            best = j
        for c in range(3):
            out.predicted[k, j, c] = scr.y[c, j]
    for c in range(3):
        doubtful = b.failed[c, best] != 0.0
        out.normalised[k, c] = np.nan if doubtful else scr.e[c, best] / math.sqrt(scr.S[c, best])
        out.states[k, c] = state.x[c, best]
    out.states[k, 3] = feed.w_cmd[k]


@inlined
def _judge(b, state, scr, r, lost, mixing):
    """Densities, and what they make of the probabilities; hypotheses that numbers have failed start anew."""
    gone = where_above(r.density[0], tr.LOST, 0.0, 1.0)
    if any_of_rare(gone + lost):
        _start_anew(b, r, state, gone)
        r.density[0] = where_above(gone + lost, 0.0, tr.LOST, r.density[0])
    if mixing:
        posterior(b, state, scr, r)


@inlined
def _grow_biases(tune, r, dt):
    r.bias[1] = r.bias[1] + tune.bias_diffusion * tune.bias_diffusion * r.failed_noise[0] * dt


@inlined
def _interval(feed, k, before, tune):
    """Length of the interval that ends at sample k [s], NaN where none begins."""
    return min(feed.t[k] - before, tune.longest) if before == before else before


@inlined
def _visited(b, state, visits, q, k, before):
    """Make the visits from q on that are due before sample k; the first one that is not."""
    while q < visits.at.size and visits.at[q] == k:
        j = visits.row[q]
        if visits.enters[q]:
            _enter(b, state, visits, q, j)
        else:
            _give_out(b, state, visits, q, j)
            visits.t[q, 0] = before
        q += 1
    return q


@inlined
def _enter(b, state, visits, q, j):
    """Number j of the rows remembers what visit q brings."""
    for u in range(b.n):
        state.x[u, j] = visits.x[q, u]
        for v in range(u, b.n):
            state.P[u, v, j] = visits.P[q, u, v]
    for u in range(b.carried):
        state.slow[u, j] = visits.slow[q, u]
    for u in range(2):
        state.bias[u, j] = visits.bias[q, u]
    for u in range(3):
        state.predicted[u, j], state.glitches[u, j] = visits.predicted[q, u], visits.glitches[q, u]


@inlined
def _give_out(b, state, visits, q, j):
    """What number j of the rows remembers, into visit q."""
    for u in range(b.n):
        visits.x[q, u] = state.x[u, j]
        for v in range(u, b.n):
            visits.P[q, u, v] = state.P[u, v, j]
    for u in range(b.carried):
        visits.slow[q, u] = state.slow[u, j]
    for u in range(2):
        visits.bias[q, u] = state.bias[u, j]
    for u in range(3):
        visits.predicted[q, u], visits.glitches[q, u] = state.predicted[u, j], state.glitches[u, j]
        visits.z[q, u] = state.z[u]
    visits.stopped[q, 0] = state.stopped[0]


@uncounted
def run(b, tune, state, scr, feed, out, visits):
    """Advance a bank of extended filters over n samples; every array of `out` is filled and `state` updated in place.

    b BankRows, tune Tuning, state BankState, scr Scratch, feed Feed, out Written, visits Visits.
    """
    r, before, q = rows_of(b, state, scr), state.t[0], 0
    for k in range(feed.t.size):
        q = _visited(b, state, visits, q, k, before)
        dt, first, before = _interval(feed, k, before, tune), before != before, feed.t[k]
        mixing = _begin(b, tune, state, scr, r, dt, feed, k, first)
        from_x, from_P = (r.to_x, r.to_P) if mixing else (r.x, r.P)
        if not first:
            extended.predict(
                b, tune, r, from_x, from_P, dt, feed.t[k], feed.interval, k, feed.w_cmd[k], feed.theta[k],
                tr.changed(feed.z, k, state.z, tune.meanwhile),
            )  # fmt: skip
            _grow_biases(tune, r, dt)
        lost = _lost(b, r)
        if any_of_rare(lost):
            _start_anew(b, r, state, lost)
        if b.n > 3 and (first or any_of_rare(lost)):
            tr.load_parameters(r.x, b.at, r.has, r.parameters, r.p)
        extended.update(b, tune, r, feed.z, k, state.z, feed.w_cmd[k])
        _judge(b, state, scr, r, lost, mixing)
        _finish(b, state, scr, r, feed, out, k)
    _visited(b, state, visits, q, feed.t.size, before)
    state.t[0] = before


@uncounted
def run_unscented(b, tune, state, scr, feed, out, visits):
    """As `run`, with unscented filters. A loop of its own, so that only the filter in use is compiled."""
    r, u, before, q = rows_of(b, state, scr), unscented.work_rows(b, scr.unscented), state.t[0], 0
    for k in range(feed.t.size):
        q = _visited(b, state, visits, q, k, before)
        dt, first, before = _interval(feed, k, before, tune), before != before, feed.t[k]
        mixing = _begin(b, tune, state, scr, r, dt, feed, k, first)
        from_x, from_P = (r.to_x, r.to_P) if mixing else (r.x, r.P)
        if not first:
            unscented.predict(
                b, tune, r, u, from_x, from_P, dt, feed.t[k], feed.interval, k, feed.w_cmd[k], feed.theta[k],
                tr.changed(feed.z, k, state.z, tune.meanwhile),
            )  # fmt: skip
            _grow_biases(tune, r, dt)
        lost = _lost(b, r)
        if any_of_rare(lost):
            _start_anew(b, r, state, lost)
        unscented.update(b, tune, r, u, feed.z, k, state.z, feed.w_cmd[k])
        _judge(b, state, scr, r, lost, mixing)
        _finish(b, state, scr, r, feed, out, k)
    _visited(b, state, visits, q, feed.t.size, before)
    state.t[0] = before


FILTER_KINDS = ("ekf", "ukf")


class Bank:
    """A bank and what it remembers: `advance` takes a log, or the next chunk of one, and returns its Estimate."""

    def __init__(
        self,
        rig: Rig,
        settings: BankSettings,
        hypotheses: tuple[Hypothesis, ...] | None = None,
        filter_kind: str = "ekf",
    ) -> None:
        if filter_kind not in FILTER_KINDS:
            raise ValueError(f"filter_kind must be one of {', '.join(FILTER_KINDS)}, got {filter_kind!r}")
        self.rig = rig
        self.settings = settings
        self.hypotheses = bank(rig, settings) if hypotheses is None else hypotheses
        self.arrays = arrays(self.hypotheses, rig, settings)
        self.rows = bank_rows(self.hypotheses, self.arrays)
        self.seats = [state_places(self.rows, j) for j in range(self.rows.m)]
        self.tuning = tuning(settings)
        self.run = run_unscented if filter_kind == "ukf" else run
        self.scratch, self.unvisited = work_arrays(self.rows), visits_of(self.rows, [])
        self.state: BankState | None = None
        self.recent: LogSamples | None = None
        self.snapshots: deque[tuple[float, HypothesisState]] = deque()
        self.samples = LogStream()
        self.commands = CommandStream(rig.model, settings.substep_s)
        self.soft = soft_stop(rig)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples (see Estimate for shapes); the same whether a log comes whole or in chunks."""
        log, own = self.samples.take(log)
        w_cmd, interval = self.commands.intervals(log.t, log.w_cmd)
        if self.state is None:
            self.state = self.start(log.z, w_cmd, log.pitch)
        active = under_way(interval, w_cmd, log.t, self.state.t[0], self.soft)
        now = LogSamples(log.t, interval, w_cmd, log.pitch, log.z, active)
        n, out = log.t.size, written(log.t.size, len(self.hypotheses))
        self.recent = now.after(self.recent)
        for first in range(0, n, BLOCK):
            if n > 1:
                self.snapshots.append((float(log.t[first]), state_of(self.state, 0, self.seats[0])))
            self._run(now.cut(first, first + BLOCK), out.cut(first, first + BLOCK))
        self._forget()
        return self._estimate(now, out).at(own)

    def again(self, samples: LogSamples, memory: HypothesisState) -> Estimate:
        """Estimate of samples at hand, of a bank that begins with what the first hypothesis of another remembers before them."""
        self.state = self.start(samples.z, samples.w_cmd, samples.theta)
        self.state.z[:], self.state.t[:], self.state.stopped[:] = memory.z, memory.t, memory.stopped
        for row, seat in enumerate(self.seats):
            there, same = (
                state_of(self.state, row, seat),
                self.hypotheses[row].states == self.hypotheses[0].states,
            )
            x = memory.x if same else np.concatenate((memory.x[: len(MOTION)], there.x[len(MOTION) :]))
            P = memory.P if same else there.P
            write_state(
                self.state, row, seat, there._replace(x=x, P=P, slow=memory.slow, predicted=memory.predicted)
            )
        self.recent, self.snapshots = samples, deque()
        out = written(samples.t.size, len(self.hypotheses))
        for first in range(0, samples.t.size, BLOCK):
            self.snapshots.append((float(samples.t[first]), state_of(self.state, 0, self.seats[0])))
            self._run(samples.cut(first, first + BLOCK), out.cut(first, first + BLOCK))
        return self._estimate(samples, out)

    def _run(self, feed: LogSamples, out: Written) -> None:
        self.run(self.rows, self.tuning, self.state, self.scratch, feed, out, self.unvisited)

    def _estimate(self, feed: LogSamples, out: Written) -> Estimate:
        names = tuple(h.name for h in self.hypotheses)
        return Estimate(feed.t, names, *out[:5], feed.active, *out[5:])

    def start(self, z: Array, w_cmd: Array, theta: Array) -> BankState:
        """The memory before the first of some samples (see `first_state.start`)."""
        held = held_at_first(z, w_cmd, theta, self.arrays.noise)
        first = first_readings(z, w_cmd[0])
        return bank_state_of(
            self.rows, start(self.hypotheses, self.arrays, first, w_cmd[0], self.rig.watched, held)
        )

    def memory(self) -> "Bank":
        """This bank as an onset sees it now, whatever `advance` does later."""
        now = copy.copy(self)
        now.snapshots = self.snapshots.copy()
        return now

    def _forget(self) -> None:
        """Keep the snapshots that fall into the samples kept in `recent`."""
        kept = self.recent.t[0] if self.recent is not None else -math.inf
        while len(self.snapshots) > 1 and self.snapshots[1][0] <= kept:
            self.snapshots.popleft()


def in_one_piece(*shapes: tuple[int, ...]) -> list[Array]:
    """Arrays of these shapes in one allocation, which the system gives in large pages: small ones cost more than a sample."""
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(aligned_empty(sum(sizes)), np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def soft_stop(rig: Rig) -> float:
    """Deceleration at which friction alone brakes the rig [rad/s^2]: a command that slows no faster is driven to its end.

    A speed servo that is not known slows its motor as it likes: what takes `LITTLE` of the current is driven.
    """
    guessed = rig.driven.servo and rig.driven.command is None and not rig.watched.servo
    return rig.model["A"] / rig.model["J"] * (LITTLE if guessed else 1.0)


def under_way(interval: Array, w_cmd: Array, t: Array, before: float, soft: float) -> NDArray[np.bool_]:
    """Whether each sample counts as evidence, (n,): the motor is commanded to turn and is not being stopped.

    t (n,) [s], before: of the sample before them, NaN where there is none. soft: what slows by no more than this is driven, and
    no stop [rad/s^2]. A stop and the rest after it say little about the move that ended and must not overturn its verdict.
    """
    out = np.empty(w_cmd.size, dtype=np.bool_)
    _under_way(interval, w_cmd, t, before, soft, out)
    return out


@uncounted
def _under_way(interval, w_cmd, t, before, soft, out):
    for k in range(w_cmd.size):
        was, dt = abs(interval[k, 0]), t[k] - before
        room = 1e-9 * was
        if dt > 0.0:
            room = max(room, soft * dt)
        out[k] = w_cmd[k] != 0.0 and abs(w_cmd[k]) >= was - room
        before = t[k]
