"""The bank, compiled: interacting multiple models of extended Kalman filters, one sample at a time.

Probabilities live in logs; rates are per second; a channel that is NaN is left out of every hypothesis alike; two
hypotheses mix only the states they share. The state of a bank is O(1) in the length of the log (`BankState`), so that a
file in chunks, a stream and a whole log give the same numbers. The filterpy bank of `observers.py` is the oracle.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi import transition as tr
from observer_fi import unscented
from observer_fi.compiled import inlined, uncounted
from observer_fi.feed import CommandStream, LogStream
from observer_fi.hypotheses import BankArrays, Hypothesis, arrays, bank
from observer_fi.models import Rig
from observer_fi.records import Array, Estimate, Log
from observer_fi.settings import BankSettings
from observer_fi.unscented import UnscentedWork

REST_VARIANCE = tr.REST_VARIANCE
START_ROWS, START_READINGS = (
    64,
    5,
)  # samples looked at for the first readings of a channel, and how many count
NEGLIGIBLE = 1e-12  # mixing weight below which a hypothesis receives nothing from another
UNREACHED = 1e-300  # least probability: a hypothesis that no rate leads to has no 0 / 0 when mixed
SKIPPED_S = 0.1  # of a gap in the clock that LogStream did not fill, this much is integrated


class BankState(NamedTuple):
    """Everything a bank remembers between samples (m hypotheses, at most n states).

    x (m, n), P (m, n, n), slow (m, 4), bias (m, 2), predicted (m, 3) the last predictions, glitches (m, 3) how many
    samples in a row a channel was taken for a glitch, log_mu (m,), z (3,) last reading of each channel, t (1,) last time
    or NaN before the first sample, stopped (1,) 1 from a command of zero to the next sample that counts as evidence.
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
    stopped: Array


class Tuning(NamedTuple):
    """Numbers of BankSettings that the loop needs, as scalars and small arrays."""

    timing: float
    agility: float
    tick: float
    bias_entry: float
    bias_diffusion: float
    failed: Array
    glitch: float
    glitch_samples: float
    longest: float
    mended: float


def tuning(settings: BankSettings) -> Tuning:
    """The loop's numbers from the settings."""
    failed = np.array(
        [settings.repeat_weight, settings.repeat_scale, settings.noisy_weight, settings.noisy_scale]
    )
    return Tuning(
        settings.timing,
        settings.agility,
        settings.tick_s,
        settings.bias_entry,
        settings.bias_diffusion,
        failed,
        settings.glitch_sigma,
        float(settings.glitch_samples),
        SKIPPED_S,
        settings.mended,
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
    log_mu = np.log(np.array([1.0 - 1e-9 * (m - 1)] + [1e-9] * (m - 1)))
    bias = np.zeros((m, 2))
    for j in range(m):
        if b.failed[j] >= 0:
            bias[j, 1] = b.noise[b.failed[j]]
    return BankState(
        x,
        P,
        slow,
        bias,
        np.full((m, 3), np.nan),
        np.zeros((m, 3)),
        log_mu,
        np.full(3, np.nan),
        np.full(1, np.nan),
        np.zeros(1),
    )


@inlined
def _mix_unlike(j, i, n, weight, b, x, P, to_x, to_P):
    """Add the moments of source i, which has other states than target j, to row j of to_P."""
    for k in range(n):
        at = b.source[j, i, k]
        dk = (x[i, at] if at >= 0 else b.entry_mean[j, k]) - to_x[j, k]
        for q in range(k + 1):
            to = b.source[j, i, q]
            cov = dk * ((x[i, to] if to >= 0 else b.entry_mean[j, q]) - to_x[j, q])
            if at >= 0 and to >= 0:
                cov += P[i, at, to]
            elif at == -1 and k == q:
                cov += b.entry_var[j, k]
            to_P[j, k, q] += weight * cov


@inlined
def _mix(b, entry, M, mu, x, P, bias, to_x, to_P, to_bias, reached):
    """IMM mixing: moments of every hypothesis before the step, from x, P, bias into to_x, to_P, to_bias.

    Source: Blom and Bar-Shalom (1988). States that a source lacks come from the target's entry prior. mu (m,) mode
    probabilities; entry: variance of a failed channel's bias on entry, over that of its noise; log_c (m,) gets the log of
    the predicted mode probabilities.
    """
    m = mu.size
    for j in range(m):
        n = b.layout[j, tr.SIZE]
        c = 0.0
        for i in range(m):
            c += M[i, j] * mu[i]
        reached[j] = c
        for k in range(n):
            to_x[j, k] = 0.0
            for q in range(k + 1):
                to_P[j, k, q] = 0.0
        to_bias[j, 0], to_bias[j, 1] = 0.0, 0.0
        for i in range(m):
            weight = M[i, j] * mu[i] / c
            if weight < NEGLIGIBLE:
                continue
            if b.alike[j, i]:
                for k in range(n):
                    to_x[j, k] += weight * x[i, k]
            else:
                for k in range(n):
                    at = b.source[j, i, k]
                    to_x[j, k] += weight * (x[i, at] if at >= 0 else b.entry_mean[j, k])
            if i == j:
                to_bias[j, 0] += weight * bias[j, 0]
        for i in range(m):
            weight = M[i, j] * mu[i] / c
            if weight < NEGLIGIBLE:
                continue
            if b.alike[j, i]:
                for k in range(n):
                    dk = x[i, k] - to_x[j, k]
                    for q in range(k + 1):
                        to_P[j, k, q] += weight * (P[i, k, q] + dk * (x[i, q] - to_x[j, q]))
            else:
                _mix_unlike(j, i, n, weight, b, x, P, to_x, to_P)
            if b.failed[j] >= 0:
                off = (bias[j, 0] if i == j else 0.0) - to_bias[j, 0]
                to_bias[j, 1] += weight * (
                    off * off + (bias[j, 1] if i == j else entry * b.noise[b.failed[j]])
                )
        for k in range(n):
            for q in range(k):
                to_P[j, q, k] = to_P[j, k, q]


@inlined
def _predict(j, b, p, x, P, slow, t, interval, row, last, theta, tune, g, F, T):
    """Mean and covariance of hypothesis j a sample later: rows j of x, P, slow in place. g (3, n), F, T (4, n): scratch."""
    n, at_d = b.layout[j, tr.SIZE], b.layout[j, tr.AT_D]
    tr.load_parameters(j, x, b.layout, b.parameters, p)
    tr.slopes(j, x, b.layout, slow, interval[row, 0], theta, p, b.parameters, g)
    w_before = x[j, 0]
    resting = tr.propagate(j, x, b.layout, slow, t, interval, row, last, theta, p)
    tr.transition(j, b.layout, g, t, resting, F)
    f00, f01, f02 = F[0, 0], F[0, 1], F[0, 2]
    f10, f11, f20, f21 = F[1, 0], F[1, 1], F[2, 0], F[2, 1]
    for k in range(n):
        p0, p1, p2 = P[j, 0, k], P[j, 1, k], P[j, 2, k]
        t0, t2 = f00 * p0 + f01 * p1 + f02 * p2, f20 * p0 + f21 * p1 + p2
        for q in range(3, n):
            t0 += F[0, q] * P[j, q, k]
        if b.moves[j]:
            for q in range(3, n):
                t2 += F[2, q] * P[j, q, k]
        T[0, k], T[1, k], T[2, k] = t0, f10 * p0 + f11 * p1, t2
        if at_d >= 0:  # d moves with x
            T[3, k] = P[j, at_d, k] + t2 - p2
    for r in range(3):
        t0, t1, t2 = T[r, 0], T[r, 1], T[r, 2]
        p0 = f00 * t0 + f01 * t1 + f02 * t2
        for q in range(3, n):
            p0 += F[0, q] * T[r, q]
            P[j, r, q] = T[r, q]
            P[j, q, r] = T[r, q]
        P[j, r, 0] = p0
        P[j, 0, r] = p0
        if r > 0:
            P[j, r, 1] = f10 * t0 + f11 * t1
            P[j, 1, r] = P[j, r, 1]
    x_var = f20 * T[2, 0] + f21 * T[2, 1] + T[2, 2]
    for q in range(3, n):
        x_var += F[2, q] * T[2, q]
    if at_d >= 0:
        d_var = T[3, at_d] + f20 * T[3, 0] + f21 * T[3, 1]
        for q in range(3, n):
            d_var += F[2, q] * T[3, q]
        p0 = f00 * T[3, 0] + f01 * T[3, 1] + f02 * T[3, 2]
        for q in range(3, n):
            p0 += F[0, q] * T[3, q]
        p1, p2 = f10 * T[3, 0] + f11 * T[3, 1], d_var - T[3, at_d] + T[3, 2]
        for q in range(3, n):
            P[j, at_d, q] = T[3, q]
            P[j, q, at_d] = T[3, q]
        P[j, at_d, 0], P[j, at_d, 1], P[j, at_d, 2], P[j, at_d, at_d] = p0, p1, p2, d_var
        P[j, 0, at_d], P[j, 1, at_d], P[j, 2, at_d] = p0, p1, p2
    P[j, 2, 2] = x_var
    for k in range(n):
        P[j, k, k] += b.diffusion[j, k] * t
    change = x[j, 0] - w_before
    P[j, 0, 0] += tune.agility * tune.agility * change * change
    P[j, 1, 1] += tune.tick * tune.tick * change * change
    if resting:
        P[j, 0, 0] = REST_VARIANCE


@inlined
def _update(
    j,
    b,
    p,
    x,
    P,
    slow,
    bias,
    z,
    row,
    previous,
    last_y,
    glitches,
    w_cmd,
    theta,
    tune,
    y,
    H,
    seen,
    spread,
    work,
):
    """Scalar updates of hypothesis j, channel by channel; returns its log-density and NIS.

    Fills rows j of y (m, 3), the prediction, and seen (m, 3), the innovations over their standard deviations.
    work (2, n): scratch.
    A glitch counts as one at the gate and moves nothing.
    """
    n, at_v, failed = b.layout[j, tr.SIZE], b.layout[j, tr.AT_SUPPLY], b.failed[j]
    tr.load_parameters(j, x, b.layout, b.parameters, p)
    tr.channels(j, x, b.layout, slow, w_cmd, theta, p, b.parameters, y, H)
    for k in range(n):
        work[0, k] = x[j, k]
    log_density, nis, product = 0.0, 0.0, 1.0
    for c in range(3):
        seen[j, c] = np.nan
        if z[row, c] != z[row, c] or c == failed:
            continue
        h0, h1, h2 = H[c, 0], H[c, 1], H[c, 2]
        hv = H[c, 3] if at_v >= 0 else 0.0
        e = (
            z[row, c]
            - y[j, c]
            - h0 * (x[j, 0] - work[0, 0])
            - h1 * (x[j, 1] - work[0, 1])
            - h2 * (x[j, 2] - work[0, 2])
        )
        for k in range(n):
            work[1, k] = P[j, k, 0] * h0 + P[j, k, 1] * h1 + P[j, k, 2] * h2
        if hv != 0.0:
            e -= hv * (x[j, at_v] - work[0, at_v])
            for k in range(n):
                work[1, k] += hv * (P[j, k, at_v] if k >= at_v else P[j, at_v, k])
        change = tune.timing * (y[j, c] - last_y[j, c]) if last_y[j, c] == last_y[j, c] else 0.0
        S = (
            b.noise[c]
            + change * change
            + h0 * work[1, 0]
            + h1 * work[1, 1]
            + h2 * work[1, 2]
            + (hv * work[1, at_v] if hv != 0.0 else 0.0)
        )
        per_S = 1.0 / S
        seen[j, c], spread[j, c] = e, S
        product *= S
        log_density -= tr.LOG_2PI
        if tr.glitch(j, S, e, c, glitches, tune.glitch, tune.glitch_samples):
            nis += tune.glitch * tune.glitch
            continue
        nis += e * e * per_S
        for k in range(n):
            gain = work[1, k] * per_S
            x[j, k] += gain * e
            for q in range(k + 1):
                P[j, k, q] -= gain * work[1, q]
        for k in range(1, n):
            for q in range(min(k, 3)):
                P[j, q, k] = P[j, k, q]
    for k in range(4, n):
        for q in range(3, k):
            P[j, q, k] = P[j, k, q]
    log_density = 0.5 * (log_density - nis - math.log(product))
    if failed >= 0 and z[row, failed] == z[row, failed]:
        h0, h1, h2 = H[failed, 0], H[failed, 1], H[failed, 2]
        expected = (
            y[j, failed]
            + h0 * (x[j, 0] - work[0, 0])
            + h1 * (x[j, 1] - work[0, 1])
            + h2 * (x[j, 2] - work[0, 2])
        )
        variance = h0 * h0 * P[j, 0, 0] + h1 * h1 * P[j, 1, 1] + h2 * h2 * P[j, 2, 2]
        if at_v >= 0:
            hv = H[failed, 3]
            expected += hv * (x[j, at_v] - work[0, at_v])
            variance += hv * (
                hv * P[j, at_v, at_v] + 2.0 * (h0 * P[j, 0, at_v] + h1 * P[j, 1, at_v] + h2 * P[j, 2, at_v])
            )
        variance += 2.0 * (h0 * h1 * P[j, 0, 1] + h0 * h2 * P[j, 0, 2] + h1 * h2 * P[j, 1, 2])
        change = (
            tune.timing * (y[j, failed] - last_y[j, failed])
            if last_y[j, failed] == last_y[j, failed]
            else 0.0
        )
        before = previous[failed] if previous[failed] == previous[failed] else np.inf
        sigma = math.sqrt(b.noise[failed] + change * change)
        log_density += tr.failed_channel(
            j, z[row, failed], before, expected, variance, sigma, bias, tune.failed
        )
    return log_density, nis


@inlined
def _posterior(reached, log_density, mu):
    """Mode probabilities from the predicted ones and the densities, into mu (m,).

    Densities are taken relative to the largest, in logs: of two hypotheses that both explain nothing, -742 still beats
    -821.
    """
    m = mu.size
    top = -math.inf
    for j in range(m):
        top = max(top, log_density[j])
    total = 0.0
    for j in range(m):
        mu[j] = reached[j] * math.exp(log_density[j] - top)
        total += mu[j]
    for j in range(m):
        mu[j] = max(mu[j] / total, UNREACHED)


@inlined
def _strain(j, b, x):
    """How far hypothesis j had to stretch constants that only it has, in prior standard deviations."""
    worst = 0.0
    for k in range(3, b.layout[j, tr.SIZE]):
        if b.own[j, k]:
            off = x[j, k] - b.entry_mean[j, k]
            worst = max(worst, off * off / b.entry_var[j, k])
    return math.sqrt(worst)


class Scratch(NamedTuple):
    """Work arrays of `run`: it allocates nothing, so that no reference is counted in its loop (that was 90 % of its time).

    to_x (m, n), to_P (m, n, n), to_bias (m, 2): the other side of mixing; M (m, m); p (VECTOR_SIZE,); mu, log_density,
    reached (m,); y, seen, spread (m, 3); g (3, n), F, T (4, n), H (3, 4), work (2, n),
    square (2, m, m); unscented: see there; mixed (1,): the time step that M belongs to, which outlasts a call.
    """

    to_x: Array
    to_P: Array
    to_bias: Array
    M: Array
    p: Array
    mu: Array
    log_density: Array
    reached: Array
    y: Array
    seen: Array
    spread: Array
    g: Array
    F: Array
    T: Array
    H: Array
    work: Array
    square: Array
    unscented: UnscentedWork
    mixed: Array


def scratch(b: BankArrays) -> Scratch:
    """Work arrays for a bank."""
    m, n = b.entry_mean.shape
    g = np.zeros((3, n))
    g[1, 0] = -1.0
    return Scratch(
        np.zeros((m, n)), np.zeros((m, n, n)), np.zeros((m, 2)), np.eye(m), b.parameters[0].copy(), np.zeros(m), np.zeros(m),
        np.zeros(m), np.zeros((m, 3)), np.zeros((m, 3)), np.ones((m, 3)), g, np.zeros((4, n)), np.zeros((4, n)), np.zeros((3, 4)), np.zeros((2, n)),  # noqa: E501
        np.zeros((2, m, m)), unscented.work_arrays(m, n), np.full(1, -1.0),
    )  # fmt: skip


@inlined
def _start_anew(j, b, state):
    tr.start_anew(
        j, b.layout[j, tr.SIZE], state.x, state.P, state.slow, b.entry_mean, b.entry_var, state.z[2]
    )
    state.bias[j, 0] = 0.0
    state.bias[j, 1] = b.noise[b.failed[j]] if b.failed[j] >= 0 else 0.0


@inlined
def _copy_back(b, state, scr):
    for j in range(b.size.size):
        n = b.layout[j, tr.SIZE]
        for k in range(n):
            state.x[j, k] = scr.to_x[j, k]
            for q in range(n):
                state.P[j, k, q] = scr.to_P[j, k, q]
        state.bias[j, 0], state.bias[j, 1] = scr.to_bias[j, 0], scr.to_bias[j, 1]


@inlined
def _begin(b, tune, state, scr, dt, w_cmd, mixing):
    """Mix the hypotheses where the sample counts as evidence."""
    if w_cmd == 0.0:
        state.stopped[0] = 1.0
    if not mixing:
        return
    if abs(dt - scr.mixed[0]) > 1e-9 * dt:
        tr.mode_transition(b.rates, dt, scr.M, scr.square)
        scr.mixed[0] = dt
    entry = tune.bias_entry * tune.bias_entry
    M = scr.M
    if state.stopped[0] == 1.0:
        state.stopped[0] = 0.0
        M = scr.square[0]
        tr.renewed(scr.M, tune.mended, M)
    _mix(b, entry, M, scr.mu, state.x, state.P, state.bias, scr.to_x, scr.to_P, scr.to_bias, scr.reached)
    _copy_back(b, state, scr)


@inlined
def _check(j, b, state, lost):
    """Start hypothesis j anew where it has lost the plant; whether it has."""
    if lost or tr.lost(j, b.layout[j, tr.SIZE], state.x, state.P):
        _start_anew(j, b, state)
        return True
    return False


@inlined
def _finish(b, state, scr, mixing, k, z, w_cmd, out_mu, out_y, out_seen, out_states, out_density, out_strain):
    """Posterior of sample k and everything that is written of it."""
    if mixing:
        _posterior(scr.reached, scr.log_density, scr.mu)
    best = 0
    for j in range(scr.mu.size):
        out_mu[k, j] = scr.mu[j]
        out_density[k, j] = scr.log_density[j]
        out_strain[k, j] = _strain(j, b, state.x)
        if scr.mu[j] > scr.mu[best]:
            best = j
        for c in range(3):
            out_y[k, j, c] = scr.y[j, c]
            state.predicted[j, c] = scr.y[j, c]
    for c in range(3):
        out_seen[k, c] = scr.seen[best, c] / math.sqrt(scr.spread[best, c])
        out_states[k, c] = state.x[best, c]
        if z[k, c] == z[k, c]:
            state.z[c] = z[k, c]
    out_states[k, 3] = w_cmd[k]


@inlined
def _probabilities(state, scr):
    total = 0.0
    for j in range(scr.mu.size):
        scr.mu[j] = math.exp(state.log_mu[j])
        total += scr.mu[j]
    for j in range(scr.mu.size):
        scr.mu[j] /= total


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
    m, before = scr.mu.size, state.t[0]
    creep = tune.bias_diffusion * tune.bias_diffusion
    _probabilities(state, scr)
    for k in range(t.size):
        dt = min(t[k] - before, tune.longest) if before == before else before
        first, before = before != before, t[k]
        mixing = active[k] and not first
        _begin(b, tune, state, scr, dt, w_cmd[k], mixing)
        for j in range(m):
            if not first:
                _predict(
                    j, b, scr.p, state.x, state.P, state.slow, dt, interval, k, w_cmd[k], theta[k], tune,
                    scr.g, scr.F, scr.T,
                )  # fmt: skip
                if b.failed[j] >= 0:
                    state.bias[j, 1] += creep * b.noise[b.failed[j]] * dt
            lost = _check(j, b, state, False)
            density, out_nis[k, j] = _update(
                j, b, scr.p, state.x, state.P, state.slow, state.bias, z, k, state.z, state.predicted, state.glitches,
                w_cmd[k], theta[k], tune, scr.y, scr.H, scr.seen, scr.spread, scr.work,
            )  # fmt: skip
            if not (density > tr.LOST):
                lost = _check(j, b, state, True)
            scr.log_density[j] = tr.LOST if lost else density
        _finish(
            b, state, scr, mixing, k, z, w_cmd, out_mu, out_y, out_seen, out_states, out_density, out_strain
        )
    for j in range(m):
        state.log_mu[j] = math.log(scr.mu[j])
    state.t[0] = before


@uncounted
def run_unscented(
    b, tune, state, scr, t, interval, w_cmd, theta, z, active,
    out_mu, out_nis, out_y, out_seen, out_states, out_density, out_strain,
):  # fmt: skip
    """As `run`, with unscented filters. A loop of its own, so that only the filter in use is compiled."""
    m, before = scr.mu.size, state.t[0]
    creep = tune.bias_diffusion * tune.bias_diffusion
    _probabilities(state, scr)
    for k in range(t.size):
        dt = min(t[k] - before, tune.longest) if before == before else before
        first, before = before != before, t[k]
        mixing = active[k] and not first
        _begin(b, tune, state, scr, dt, w_cmd[k], mixing)
        for j in range(m):
            if not first:
                unscented.predict(
                    j, b, scr.p, state.x, state.P, state.slow, dt, interval, k, w_cmd[k], theta[k], tune,
                    scr.unscented,
                )  # fmt: skip
                if b.failed[j] >= 0:
                    state.bias[j, 1] += creep * b.noise[b.failed[j]] * dt
            lost = _check(j, b, state, False)
            density, out_nis[k, j] = unscented.update(
                j, b, scr.p, state.x, state.P, state.slow, state.bias, z, k, state.z, state.predicted, state.glitches,
                w_cmd[k], theta[k], tune, scr.y, scr.H, scr.seen, scr.spread, scr.unscented,
            )  # fmt: skip
            if not (density > tr.LOST):
                lost = _check(j, b, state, True)
            scr.log_density[j] = tr.LOST if lost else density
        _finish(
            b, state, scr, mixing, k, z, w_cmd, out_mu, out_y, out_seen, out_states, out_density, out_strain
        )
    for j in range(m):
        state.log_mu[j] = math.log(scr.mu[j])
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
        self.tuning = tuning(settings)
        self.run = run_unscented if filter_kind == "ukf" else run
        self.scratch = scratch(self.arrays)
        self.state: BankState | None = None
        self.recent: Recent | None = None
        self.snapshots: deque[tuple[float, BankState]] = deque()
        self.samples = LogStream()
        self.commands = CommandStream(rig.model, settings.substep_s)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples (see Estimate for shapes); the same whether a log comes whole or in chunks."""
        log, own = self.samples.take(log)
        w_cmd, interval = self.commands.intervals(log.t, log.w_cmd)
        if self.state is None:
            self.state = start(self.hypotheses, self.arrays, first_readings(log.z), w_cmd[0])
        n, m = log.t.size, len(self.hypotheses)
        active = under_way(interval, w_cmd)
        mu, nis, y = np.empty((n, m)), np.empty((n, m)), np.empty((n, m, 3))
        seen, states, density, strain = np.empty((n, 3)), np.empty((n, 4)), np.empty((n, m)), np.empty((n, m))
        self.recent = Recent(log.t, interval, w_cmd, log.pitch, log.z).after(self.recent)
        for first in range(0, n, BLOCK):
            if n > 1:
                self.snapshots.append((float(log.t[first]), self._nominal(self.state)))
            b = slice(first, first + BLOCK)
            self.run(
                self.arrays, self.tuning, self.state, self.scratch, log.t[b], interval[b], w_cmd[b], log.pitch[b], log.z[b],
                active[b], mu[b], nis[b], y[b], seen[b], states[b], density[b], strain[b],
            )  # fmt: skip
        self._forget()
        names = tuple(h.name for h in self.hypotheses)
        return Estimate(log.t, names, mu, nis, y, seen, states, active, density, strain).at(own)

    def _nominal(self, state: BankState) -> BankState:
        """A copy of what the first hypothesis remembers."""
        names = ("x", "P", "slow", "bias", "predicted", "glitches")
        parts = {name: getattr(state, name)[:1].copy() for name in names}
        return BankState(
            **parts, log_mu=np.zeros(1), z=state.z.copy(), t=state.t.copy(), stopped=state.stopped.copy()
        )

    def _forget(self) -> None:
        """Keep the snapshots that fall into the samples kept in `recent`."""
        kept = self.recent.t[0] if self.recent is not None else -math.inf
        while len(self.snapshots) > 1 and self.snapshots[1][0] <= kept:
            self.snapshots.popleft()


BLOCK = 400  # samples between two snapshots
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


def under_way(interval: Array, w_cmd: Array) -> NDArray[np.bool_]:
    """Whether each sample counts as evidence, (n,): the motor is commanded to turn and is not being stopped.

    A stop and the rest after it say little about the move that ended and must not overturn its verdict.
    """
    return (w_cmd != 0.0) & (np.abs(w_cmd) >= np.abs(interval[:, 0]) * (1.0 - 1e-9))


def first_readings(z: Array) -> Array:
    """(3,) first finite reading of each channel, NaN where there is none; the median of the first few damps noise.

    Only START_ROWS samples are looked at: a stream that begins cannot wait for more.
    """
    first = np.full(3, np.nan)
    for c in range(3):
        good = z[:START_ROWS][np.isfinite(z[:START_ROWS, c]), c][:START_READINGS]
        if good.size:
            first[c] = np.median(good)
    return first
