"""The bank, compiled: interacting multiple models of extended Kalman filters, one sample at a time.

Probabilities live in logs; rates are per second; a channel that is NaN is left out of every hypothesis alike; two
hypotheses mix only the states they share. The state of a bank is O(1) in the length of the log (`BankState`), so that a
file in chunks, a stream and a whole log give the same numbers. The filterpy bank of `observers.py` is the oracle.
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi import transition as tr
from observer_fi.compiled import compiled, inlined
from observer_fi.feed import CommandStream
from observer_fi.hypotheses import BankArrays, Hypothesis, arrays, bank
from observer_fi.models import Rig
from observer_fi.records import Array, Estimate, Log
from observer_fi.settings import BankSettings

REST_VARIANCE = 1e-6  # (rad/s)^2, of a motor that friction holds
NEGLIGIBLE = 1e-12  # mixing weight below which a hypothesis receives nothing from another


class BankState(NamedTuple):
    """Everything a bank remembers between samples (m hypotheses, at most n states).

    x (m, n), P (m, n, n), slow (m, 4), bias (m, 2), predicted (m, 3) the last predictions, glitches (m, 3) how many
    samples in a row a channel was taken for a glitch, log_mu (m,), z (3,) last reading of each channel, t (1,) last time
    or NaN before the first sample.
    """

    x: Array
    P: Array
    slow: Array
    bias: Array
    predicted: Array
    glitches: Array
    log_mu: Array
    z: Array
    t: Array


class Tuning(NamedTuple):
    """Numbers of BankSettings that the loop needs, as scalars and small arrays."""

    timing: float
    bias_entry: float
    bias_diffusion: float
    failed: Array
    glitch: float
    glitch_samples: float


def tuning(settings: BankSettings) -> Tuning:
    """The loop's numbers from the settings."""
    failed = np.array([settings.repeat_weight, settings.repeat_scale, settings.noisy_weight, settings.noisy_scale])
    return Tuning(
        settings.timing, settings.bias_entry, settings.bias_diffusion, failed, settings.glitch_sigma, float(settings.glitch_samples)
    )


def start(hypotheses: tuple[Hypothesis, ...], b: BankArrays, z0: Array, command0: float) -> BankState:
    """The bank before its first sample: at rest, or turning at the command, where the sensors say.

    z0: (3,) first finite reading of each channel (NaN where there is none). The integrator's prior at rest is the width
    of the friction band, +-A/(Km Ki) (design of the servo: no anti-windup), around what the current says.
    """
    m, n = b.entry_mean.shape
    x, P = np.zeros((m, n)), np.zeros((m, n, n))
    slow = np.zeros((m, tr.SLOW))
    z = np.where(np.isfinite(z0), z0, 0.0)
    for j, h in enumerate(hypotheses):
        model = h.model
        w = (z[0] - model["Rm"] * z[1]) / model["Km"] if command0 != 0.0 and model["Km"] else 0.0
        band = model["A"] / (model["Km"] * model["Ki"]) if model["Km"] * model["Ki"] else 0.05
        x[j, :3] = w, (z[1] / model["Ki"] if model["Ki"] else 0.0), z[2]
        P[j, 0, 0] = b.entry_var[j, 0] if command0 != 0.0 else REST_VARIANCE
        P[j, 1, 1] = (0.5 * band) ** 2
        P[j, 2, 2] = 10.0 * b.noise[2]
        for k in range(3, b.size[j]):
            x[j, k], P[j, k, k] = b.entry_mean[j, k], b.entry_var[j, k]
        slow[j, tr.LAGGED] = z[1]
    log_mu = np.log(np.array([1.0] + [1e-9] * (m - 1)))
    bias = np.zeros((m, 2))
    for j in range(m):
        if b.failed[j] >= 0:
            bias[j, 1] = b.noise[b.failed[j]]
    return BankState(x, P, slow, bias, np.full((m, 3), np.nan), np.zeros((m, 3)), log_mu, np.full(3, np.nan), np.full(1, np.nan))


@compiled
def _mix(state, b, M, tune, x, P, bias, log_c):
    """IMM mixing: moments of every hypothesis before the step, into x, P, bias; log_c (m,) gets log of the predicted mu.

    Source: Blom and Bar-Shalom (1988). States that a source lacks come from the target's entry prior.
    """
    m = b.size.size
    mu = np.exp(state.log_mu)
    for j in range(m):
        n = b.size[j]
        c = 0.0
        for i in range(m):
            c += M[i, j] * mu[i]
        log_c[j] = math.log(c)
        x[j, :] = 0.0
        bias[j, :] = 0.0
        for i in range(m):
            weight = M[i, j] * mu[i] / c
            if weight < NEGLIGIBLE:
                continue
            for k in range(n):
                at = b.source[j, i, k]
                x[j, k] += weight * (state.x[i, at] if at >= 0 else b.entry_mean[j, k])
            if i == j:
                bias[j, 0] += weight * state.bias[j, 0]
        P[j, :, :] = 0.0
        for i in range(m):
            weight = M[i, j] * mu[i] / c
            if weight < NEGLIGIBLE:
                continue
            for k in range(n):
                at = b.source[j, i, k]
                dk = (state.x[i, at] if at >= 0 else b.entry_mean[j, k]) - x[j, k]
                for q in range(k + 1):
                    to = b.source[j, i, q]
                    dq = (state.x[i, to] if to >= 0 else b.entry_mean[j, q]) - x[j, q]
                    cov = dk * dq
                    if at >= 0 and to >= 0:
                        cov += state.P[i, at, to]
                    elif at == -1 and k == q:
                        cov += b.entry_var[j, k]
                    P[j, k, q] += weight * cov
            if b.failed[j] >= 0:
                off = (state.bias[j, 0] if i == j else 0.0) - bias[j, 0]
                entry = tune.bias_entry * tune.bias_entry * b.noise[b.failed[j]]
                bias[j, 1] += weight * (off * off + (state.bias[j, 1] if i == j else entry))
        for k in range(n):
            for q in range(k):
                P[j, q, k] = P[j, k, q]


@inlined
def _predict(at, diffusion, base, p, x, P, slow, t, commands, last, theta, g, F, T):
    """Mean and covariance of one hypothesis a sample later: x (n,), P (n, n), slow in place. g, F, T (4, n): scratch."""
    n, at_d = at[tr.SIZE], at[tr.AT_D]
    tr.with_scales(x, at, base, p)
    tr.slopes(x, at, slow, commands[0], theta, p, base, g)
    resting = tr.propagate(x, at, slow, t, commands, last, theta, p)
    tr.transition(at, g, t, resting, F)
    rows = 4 if at_d >= 0 else 3
    for r in range(rows):
        for k in range(n):
            T[r, k] = 0.0
        for q in range(n):
            f = F[r, q]
            if f != 0.0:
                for k in range(n):
                    T[r, k] += f * P[q, k]
    for r in range(rows):
        to = r if r < 3 else at_d
        for k in range(3, n):
            P[to, k] = T[r, k]
            P[k, to] = T[r, k]
    for r in range(rows):
        to = r if r < 3 else at_d
        for s in range(r + 1):
            total = 0.0
            for q in range(n):
                total += T[r, q] * F[s, q]
            onto = s if s < 3 else at_d
            P[to, onto] = total
            P[onto, to] = total
    for k in range(n):
        P[k, k] += diffusion[k] * t
    if resting:
        P[0, 0] = REST_VARIANCE


@inlined
def _gate(S, e, c, glitches, tune):
    """Whether a reading is taken for a glitch: far off, and not for long. Counts in glitches (3,)."""
    far = e * e > tune.glitch * tune.glitch * S
    if not far:
        glitches[c] = 0.0
        return False
    if glitches[c] < tune.glitch_samples:
        glitches[c] += 1.0
        return True
    return False


@inlined
def _update(at, failed, noise, base, p, x, P, slow, bias, z, previous, last_y, glitches, w_cmd, theta, tune, y, H, seen, work):
    """Scalar updates of one hypothesis, channel by channel; returns its log-density and NIS.

    Fills y (3,) the prediction and seen (3,) the innovations over their standard deviations. work (5, n): scratch.
    A glitch counts as one at the gate and moves nothing.
    """
    n, at_v = at[tr.SIZE], at[tr.AT_VOLTAGE]
    tr.with_scales(x, at, base, p)
    tr.channels(x, at, slow, w_cmd, theta, p, y, H)
    start, Ph = work[0], work[1]
    for k in range(n):
        start[k] = x[k]
    log_density, nis, product = 0.0, 0.0, 1.0
    for c in range(3):
        seen[c] = np.nan
        if z[c] != z[c] or c == failed:
            continue
        h0, h1, h2 = H[c, 0], H[c, 1], H[c, 2]
        hv = 1.0 if c == 0 and at_v >= 0 else 0.0
        e = z[c] - y[c] - h0 * (x[0] - start[0]) - h1 * (x[1] - start[1]) - h2 * (x[2] - start[2])
        for k in range(n):
            Ph[k] = P[k, 0] * h0 + P[k, 1] * h1 + P[k, 2] * h2
        if hv != 0.0:
            e -= x[at_v] - start[at_v]
            for k in range(n):
                Ph[k] += P[k, at_v]
        change = tune.timing * (y[c] - last_y[c]) if last_y[c] == last_y[c] else 0.0
        S = noise[c] + change * change + h0 * Ph[0] + h1 * Ph[1] + h2 * Ph[2] + (Ph[at_v] if hv != 0.0 else 0.0)
        seen[c] = e / math.sqrt(S)
        product *= S
        log_density -= tr.LOG_2PI
        if _gate(S, e, c, glitches, tune):
            nis += tune.glitch * tune.glitch
            continue
        nis += e * e / S
        for k in range(n):
            gain = Ph[k] / S
            x[k] += gain * e
            for q in range(k + 1):
                P[k, q] -= gain * Ph[q]
        for k in range(n):
            for q in range(k):
                P[q, k] = P[k, q]
    log_density = 0.5 * (log_density - nis - math.log(product))
    if failed >= 0 and z[failed] == z[failed]:
        h0, h1, h2 = H[failed, 0], H[failed, 1], H[failed, 2]
        expected = y[failed] + h0 * (x[0] - start[0]) + h1 * (x[1] - start[1]) + h2 * (x[2] - start[2])
        spread = h0 * h0 * P[0, 0] + h1 * h1 * P[1, 1] + h2 * h2 * P[2, 2]
        spread += 2.0 * (h0 * h1 * P[0, 1] + h0 * h2 * P[0, 2] + h1 * h2 * P[1, 2])
        change = tune.timing * (y[failed] - last_y[failed]) if last_y[failed] == last_y[failed] else 0.0
        before = previous[failed] if previous[failed] == previous[failed] else np.inf
        sigma = math.sqrt(noise[failed] + change * change)
        log_density += tr.failed_channel(z[failed], before, expected, spread, sigma, bias, tune.failed)
    return log_density, nis


@compiled
def _normalise(log_mu):
    top = log_mu.max()
    log_mu -= top + math.log(np.exp(log_mu - top).sum())


@compiled
def run(b, tune, state, t, interval, w_cmd, theta, z, active, out_mu, out_nis, out_y, out_seen, out_states):
    """Advance the bank over n samples; every out array is filled and `state` updated in place.

    t (n,) s; interval (n, 2 m) command at the half-steps of the interval that ends at a sample, w_cmd (n,) at the
    sample [rad/s]; theta (n,) deg; z (n, 3); active (n,) whether a sample counts as evidence.
    out_mu (n, m) log probabilities, out_nis (n, m), out_y (n, m, 3), out_seen (n, 3) of the winner, out_states (n, 4).
    """
    m, n = state.x.shape
    x, P, bias = state.x.copy(), state.P.copy(), state.bias.copy()
    M, mixed_dt = np.eye(m), -1.0
    p = b.parameters.copy()
    y, seen = np.empty((m, 3)), np.empty((m, 3))
    log_density, log_c = np.empty(m), np.empty(m)
    g, F, T, H, work = np.zeros((m, 3, n)), np.zeros((4, n)), np.zeros((4, n)), np.zeros((3, 3)), np.zeros((2, n))
    for j in range(m):
        g[j, 1, 0] = -1.0
    for k in range(t.size):
        dt = t[k] - state.t[0]
        first = dt != dt
        mixing = active[k] and not first
        if mixing:
            if abs(dt - mixed_dt) > 1e-9 * dt:
                tr.mode_transition(b.rates, dt, M)
                mixed_dt = dt
            _mix(state, b, M, tune, x, P, bias, log_c)
        else:
            x[:, :] = state.x
            P[:, :, :] = state.P
            bias[:, :] = state.bias
        for j in range(m):
            at, failed, base = b.layout[j], b.failed[j], b.parameters[j]
            if not first:
                _predict(
                    at, b.diffusion[j], base, p[j], x[j], P[j], state.slow[j], dt, interval[k], w_cmd[k], theta[k], g[j], F, T
                )
                if failed >= 0:
                    bias[j, 1] += tune.bias_diffusion * tune.bias_diffusion * b.noise[failed] * dt
            log_density[j], out_nis[k, j] = _update(
                at, failed, b.noise, base, p[j], x[j], P[j], state.slow[j], bias[j], z[k], state.z, state.predicted[j],
                state.glitches[j], w_cmd[k], theta[k], tune, y[j], H, seen[j], work,
            )  # fmt: skip
        if active[k] and not first:
            state.log_mu[:] = log_c + log_density
            _normalise(state.log_mu)
        state.x[:, :] = x
        state.P[:, :, :] = P
        state.bias[:, :] = bias
        state.predicted[:, :] = y
        state.t[0] = t[k]
        for c in range(3):
            if z[k, c] == z[k, c]:
                state.z[c] = z[k, c]
        best = int(np.argmax(state.log_mu))
        out_mu[k] = state.log_mu
        out_y[k] = y
        out_seen[k] = seen[best]
        out_states[k, :3] = state.x[best, :3]
        out_states[k, 3] = w_cmd[k]


class Bank:
    """A bank and what it remembers: `advance` takes a log, or the next chunk of one, and returns its Estimate."""

    def __init__(self, rig: Rig, settings: BankSettings, hypotheses: tuple[Hypothesis, ...] | None = None) -> None:
        self.rig = rig
        self.settings = settings
        self.hypotheses = bank(rig, settings) if hypotheses is None else hypotheses
        self.arrays = arrays(self.hypotheses, rig, settings)
        self.tuning = tuning(settings)
        self.state: BankState | None = None
        self.commands = CommandStream(rig.model, settings.substep_s)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples (see Estimate for shapes); the same whether a log comes whole or in chunks."""
        w_cmd, interval = self.commands.intervals(log.t, log.w_cmd)
        if self.state is None:
            self.state = start(self.hypotheses, self.arrays, first_readings(log.z), w_cmd[0])
        n, m = log.t.size, len(self.hypotheses)
        active = (log.w_cmd != 0.0) | (interval[:, 0] != 0.0)
        log_mu, nis, y = np.empty((n, m)), np.empty((n, m)), np.empty((n, m, 3))
        seen, states = np.empty((n, 3)), np.empty((n, 4))
        run(self.arrays, self.tuning, self.state, log.t, interval, w_cmd, log.pitch, log.z, active, log_mu, nis, y, seen, states)
        return Estimate(log.t, tuple(h.name for h in self.hypotheses), np.exp(log_mu), nis, y, seen, states, active)


def first_readings(z: Array) -> Array:
    """(3,) first finite reading of each channel, NaN where there is none; the median of the first few damps noise."""
    first = np.full(3, np.nan)
    for c in range(3):
        good = z[np.isfinite(z[:, c]), c][:5]
        if good.size:
            first[c] = np.median(good)
    return first
