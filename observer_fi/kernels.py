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

from observer_fi import extended, unscented
from observer_fi import transition as tr
from observer_fi.bank_rows import bank_rows, tuning
from observer_fi.beginning import first_readings, start
from observer_fi.compiled import compiled, inlined, uncounted
from observer_fi.feed import CommandStream, LogStream
from observer_fi.hypotheses import Hypothesis, arrays, bank
from observer_fi.memory import BankState, Memory, memory_of, remembered
from observer_fi.mixing import mix, posterior
from observer_fi.models import Rig
from observer_fi.records import Array, Estimate, Log
from observer_fi.rows import above, larger, nothing, room, seldom, sqrt
from observer_fi.scratch import rows_of, scratch
from observer_fi.settings import BankSettings


@inlined
def _begin(b, tune, state, scr, r, dt, w_cmd, mixing):
    """Mix the hypotheses where the sample counts as evidence, from r.x, r.P into r.to_x, r.to_P."""
    if w_cmd == 0.0:
        state.stopped[0] = 1.0
    if mixing:
        mix(b, tune, scr, r, state, dt, state.stopped[0] == 1.0)
        state.stopped[0] = 0.0


@inlined
def _lost(b, r):
    """1 for a hypothesis beyond what any reading can have meant: its numbers would soon be no numbers."""
    far, wide, negative = nothing(r.x[0]), nothing(r.x[0]), nothing(r.x[0])
    for k in range(b.n):
        far, wide = far + abs(r.x[k]), wide + abs(r.P[k, k])
        negative = larger(negative, -r.P[k, k])
    kept = above(tr.FARTHEST, far, 1.0, 0.0) * above(tr.WIDEST, wide, 1.0, 0.0)
    return 1.0 - kept * above(1.0, negative, 1.0, 0.0)


@inlined
def _start_anew(b, r, state, lost):
    """Lost hypotheses at rest where the position sensor last saw the mass, everything else at the entry prior."""
    position = state.z[2]
    for k in range(b.n):
        for q in range(k, b.n):
            r.P[k, q] = above(lost, 0.0, r.entry_var[k] if q == k else nothing(lost), r.P[k, q])
        r.x[k] = above(lost, 0.0, r.entry_mean[k], r.x[k])
    if position == position:
        r.x[2] = above(lost, 0.0, position, r.x[2])
    for k in range(tr.SLOW):
        r.slow[k] = above(lost, 0.0, 0.0, r.slow[k])
    r.bias[0], r.bias[1] = above(lost, 0.0, 0.0, r.bias[0]), above(lost, 0.0, r.failed_noise[0], r.bias[1])


@inlined
def _strain(b, r):
    """How far hypotheses had to stretch constants that only they have, in prior standard deviations."""
    worst = nothing(r.x[0])
    for k in range(3, b.n):
        off = r.x[k] - r.entry_mean[k]
        worst = larger(r.own[k] * (off * off) / above(r.own[k], 0.0, r.entry_var[k], 1.0), worst)
    return sqrt(worst)


@inlined
def _finish(
    b, state, scr, r, k, z, w_cmd, out_mu, out_nis, out_y, out_seen, out_states, out_density, out_strain
):
    """Everything that is written of sample k."""
    if b.strained:
        r.strain[0] = _strain(b, r)
    for c in range(3):
        r.predicted[c] = r.y[c]
        if z[k, c] == z[k, c]:
            state.z[c] = z[k, c]
    best = 0
    for j in range(b.m):
        out_mu[k, j], out_nis[k, j] = state.mu[0, j], scr.nis[0, j]
        out_density[k, j], out_strain[k, j] = scr.density[0, j], scr.strain[0, j]
        if state.mu[0, j] > state.mu[0, best]:
            best = j
        for c in range(3):
            out_y[k, j, c] = scr.y[c, j]
    for c in range(3):
        doubtful = b.failed[c, best] != 0.0
        out_seen[k, c] = np.nan if doubtful else scr.e[c, best] / math.sqrt(scr.S[c, best])
        out_states[k, c] = state.x[c, best]
    out_states[k, 3] = w_cmd[k]


@inlined
def _judge(b, state, scr, r, lost, mixing):
    """Densities, and what they make of the probabilities; hypotheses that numbers have failed start anew."""
    gone = above(r.density[0], tr.LOST, 0.0, 1.0)
    if seldom(gone + lost):
        _start_anew(b, r, state, gone)
        r.density[0] = above(gone + lost, 0.0, tr.LOST, r.density[0])
    if mixing:
        posterior(b, state, scr, r)


@uncounted
def run(
    b, tune, state, scr, t, interval, w_cmd, theta, z, active,
    out_mu, out_nis, out_y, out_seen, out_states, out_density, out_strain,
):  # fmt: skip
    """Advance a bank of extended filters over n samples; every out array is filled and `state` updated in place.

    t (n,) s; interval (n, 2 m) command at the half-steps of the interval that ends at a sample, w_cmd (n,) at the
    sample [rad/s]; theta (n,) deg; z (n, 3); active (n,) whether a sample counts as evidence.
    out_mu (n, m) probabilities, out_nis (n, m), out_y (n, m, 3), out_seen (n, 3) of the winner, out_states (n, 4),
    out_density (n, m) log-densities, out_strain (n, m) see `_strain`.
    """
    r, before = rows_of(b, state, scr), state.t[0]
    for k in range(t.size):
        dt = min(t[k] - before, tune.longest) if before == before else before
        first, before = before != before, t[k]
        mixing = active[k] and not first
        _begin(b, tune, state, scr, r, dt, w_cmd[k], mixing)
        from_x, from_P = (r.to_x, r.to_P) if mixing else (r.x, r.P)
        if not first:
            extended.predict(b, tune, r, from_x, from_P, dt, interval, k, w_cmd[k], theta[k])
            r.bias[1] = r.bias[1] + tune.bias_diffusion * tune.bias_diffusion * r.failed_noise[0] * dt
        lost = _lost(b, r)
        if seldom(lost):
            _start_anew(b, r, state, lost)
        if b.n > 3 and (first or seldom(lost)):
            tr.load_parameters(r.x, b.at, r.has, r.parameters, r.p)
        extended.update(b, tune, r, z, k, state.z, w_cmd[k])
        _judge(b, state, scr, r, lost, mixing)
        _finish(
            b,
            state,
            scr,
            r,
            k,
            z,
            w_cmd,
            out_mu,
            out_nis,
            out_y,
            out_seen,
            out_states,
            out_density,
            out_strain,
        )
    state.t[0] = before


@uncounted
def run_unscented(
    b, tune, state, scr, t, interval, w_cmd, theta, z, active,
    out_mu, out_nis, out_y, out_seen, out_states, out_density, out_strain,
):  # fmt: skip
    """As `run`, with unscented filters. A loop of its own, so that only the filter in use is compiled."""
    r, u, before = rows_of(b, state, scr), unscented.work_rows(b, scr.unscented), state.t[0]
    for k in range(t.size):
        dt = min(t[k] - before, tune.longest) if before == before else before
        first, before = before != before, t[k]
        mixing = active[k] and not first
        _begin(b, tune, state, scr, r, dt, w_cmd[k], mixing)
        from_x, from_P = (r.to_x, r.to_P) if mixing else (r.x, r.P)
        if not first:
            unscented.predict(b, tune, r, u, from_x, from_P, dt, interval, k, w_cmd[k], theta[k])
            r.bias[1] = r.bias[1] + tune.bias_diffusion * tune.bias_diffusion * r.failed_noise[0] * dt
        lost = _lost(b, r)
        if seldom(lost):
            _start_anew(b, r, state, lost)
        unscented.update(b, tune, r, u, z, k, state.z, w_cmd[k])
        _judge(b, state, scr, r, lost, mixing)
        _finish(
            b,
            state,
            scr,
            r,
            k,
            z,
            w_cmd,
            out_mu,
            out_nis,
            out_y,
            out_seen,
            out_states,
            out_density,
            out_strain,
        )
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
        self.tuning = tuning(settings)
        self.run = run_unscented if filter_kind == "ukf" else run
        self.scratch = scratch(self.rows)
        self.state: BankState | None = None
        self.recent: Recent | None = None
        self.snapshots: deque[tuple[float, Memory]] = deque()
        self.samples = LogStream()
        self.commands = CommandStream(rig.model, settings.substep_s)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples (see Estimate for shapes); the same whether a log comes whole or in chunks."""
        log, own = self.samples.take(log)
        w_cmd, interval = self.commands.intervals(log.t, log.w_cmd)
        if self.state is None:
            self.state = self.start(first_readings(log.z), w_cmd[0])
        n, m = log.t.size, len(self.hypotheses)
        active = under_way(interval, w_cmd)
        mu, nis, density, strain, y, seen, states = in_one_piece(
            (n, m), (n, m), (n, m), (n, m), (n, m, 3), (n, 3), (n, 4)
        )
        self.recent = Recent(log.t, interval, w_cmd, log.pitch, log.z).after(self.recent)
        for first in range(0, n, BLOCK):
            if n > 1:
                self.snapshots.append((float(log.t[first]), memory_of(self.rows, self.state, 0)))
            b = slice(first, first + BLOCK)
            self.run(
                self.rows, self.tuning, self.state, self.scratch, log.t[b], interval[b], w_cmd[b], log.pitch[b], log.z[b],
                active[b], mu[b], nis[b], y[b], seen[b], states[b], density[b], strain[b],
            )  # fmt: skip
        self._forget()
        names = tuple(h.name for h in self.hypotheses)
        return Estimate(log.t, names, mu, nis, y, seen, states, active, density, strain).at(own)

    def start(self, z0: Array, command0: float) -> BankState:
        """The memory before the first sample (see `beginning.start`)."""
        return remembered(self.rows, start(self.hypotheses, self.arrays, z0, command0))

    def moments(self) -> list[tuple[Array, Array]]:
        """Mean (n,) and covariance (n, n) of each hypothesis after the last sample, SI units; none before the first."""
        if self.state is None:
            return []
        memories = [memory_of(self.rows, self.state, j) for j in range(self.rows.m)]
        return [(memory.x, memory.P) for memory in memories]

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
    parts = np.split(room(sum(sizes)), np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


BLOCK = 1600  # samples between two snapshots: a call of the kernel costs as much as fifty samples
TAIL_S = 3.0  # of the chunk before, kept so that an onset can be looked for across a boundary


class Recent(NamedTuple):
    """The last samples in the arrays of `run`: t (n,), interval (n, 2 m), w_cmd (n,), theta (n,), z (n, 3)."""

    t: Array
    interval: Array
    w_cmd: Array
    theta: Array
    z: Array

    def after(self, before: "Recent | None") -> "Recent":
        """These samples behind the tail of the ones before."""
        if before is None:
            return self
        tail = before.t >= before.t[-1] - TAIL_S
        return Recent(*(np.concatenate((old[tail], new)) for old, new in zip(before, self, strict=True)))

    def cut(self, first: int, last: int) -> "Recent":
        """Samples first:last."""
        return Recent(*(a[first:last] for a in self))


@compiled
def under_way(interval, w_cmd):
    """Whether each sample counts as evidence, (n,): the motor is commanded to turn and is not being stopped.

    A stop and the rest after it say little about the move that ended and must not overturn its verdict.
    """
    out = np.empty(w_cmd.size, dtype=np.bool_)
    for k in range(w_cmd.size):
        out[k] = w_cmd[k] != 0.0 and abs(w_cmd[k]) >= abs(interval[k, 0]) * (1.0 - 1e-9)
    return out
