"""The bank, compiled: interacting multiple models of extended Kalman filters, one sample at a time.

Probabilities live in logs; rates are per second; a channel that is NaN is left out of every hypothesis alike; two
hypotheses mix only the states they share. The state of a bank is O(1) in the length of the log (`BankState`), so that a
file in chunks, a stream and a whole log give the same numbers. The filterpy bank of `observers.py` is the oracle.
"""

import copy
import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi import transition as tr
from observer_fi import unscented
from observer_fi.compiled import compiled, inlined, uncounted
from observer_fi.feed import CommandStream, LogStream
from observer_fi.hypotheses import BankArrays, Hypothesis, arrays, bank
from observer_fi.models import Rig
from observer_fi.records import Array, Estimate, Log
from observer_fi.rows import MOST, dot, exp, get, load, log, put, some, store, zeros
from observer_fi.settings import BankSettings
from observer_fi.unscented import UnscentedWork

REST_VARIANCE = tr.REST_VARIANCE
START_ROWS, START_READINGS = (
    64,
    5,
)  # samples looked at for the first readings of a channel, and how many count
NEGLIGIBLE = 1e-12  # mixing weight below which a hypothesis receives nothing from another
UNREACHED = 1e-300  # least probability: a hypothesis that no rate leads to has no 0 / 0 when mixed
ROOM = (0,) * MOST
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
    m, n = b.entry_mean.shape[0], padded(b)
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
def _side(b):
    """States that a row of P has room for."""
    return 3 + len(b.wide)


@inlined
def _has_constants(j, b):
    """Whether hypothesis j has states behind w, I, x. Where no hypothesis has, the compiler knows."""
    return len(b.wide) > 0 and b.layout[j, tr.SIZE] > 3


@inlined
def _row(b, P, j, r):
    """Covariances of state r of hypothesis j with its constants."""
    return load(P, (j * _side(b) + r) * _side(b) + 3, b.wide)


@inlined
def _set_row(b, P, j, r, row):
    store(P, (j * _side(b) + r) * _side(b) + 3, row)


@inlined
def _core(b, P, j):
    """Covariance of w, I, x of hypothesis j: (ww, wI, wx, II, Ix, xx)."""
    side = _side(b)
    at = j * side * side
    return (
        get(P, at),
        get(P, at + 1),
        get(P, at + 2),
        get(P, at + side + 1),
        get(P, at + side + 2),
        get(P, at + 2 * side + 2),
    )


@inlined
def _set_core(b, P, j, p):
    side = _side(b)
    at = j * side * side
    put(P, at, p[0])
    put(P, at + 1, p[1])
    put(P, at + 2, p[2])
    put(P, at + side + 1, p[3])
    put(P, at + side + 2, p[4])
    put(P, at + 2 * side + 2, p[5])


# The algebra of w, I, x, of numbers or of rows of them. A covariance is (ww, wI, wx, II, Ix, xx), F as in `motion_transition`.


@inlined
def through(f, p):
    """F P, row by row."""
    f00, f01, f02, f10, f11, f20, f21 = f
    p00, p01, p02, p11, p12, p22 = p
    return (
        f00 * p00 + f01 * p01 + f02 * p02, f00 * p01 + f01 * p11 + f02 * p12, f00 * p02 + f01 * p12 + f02 * p22,
        f10 * p00 + f11 * p01, f10 * p01 + f11 * p11, f10 * p02 + f11 * p12,
        f20 * p00 + f21 * p01 + p02, f20 * p01 + f21 * p11 + p12, f20 * p02 + f21 * p12 + p22,
    )  # fmt: skip


@inlined
def onto(f, t):
    """T F' with T = F P."""
    f00, f01, f02, f10, f11, f20, f21 = f
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = t
    return (
        f00 * t00 + f01 * t01 + f02 * t02, f00 * t10 + f01 * t11 + f02 * t12, f00 * t20 + f01 * t21 + f02 * t22,
        f10 * t10 + f11 * t11, f10 * t20 + f11 * t21, f20 * t20 + f21 * t21 + t22,
    )  # fmt: skip


@inlined
def with_source(total, weight, p, e):
    """total + weight (P + e e'), a source of mixing with its mean e off."""
    w0, w1, w2 = weight * e[0], weight * e[1], weight * e[2]
    return (
        total[0] + (weight * p[0] + w0 * e[0]), total[1] + (weight * p[1] + w0 * e[1]), total[2] + (weight * p[2] + w0 * e[2]),
        total[3] + (weight * p[3] + w1 * e[1]), total[4] + (weight * p[4] + w1 * e[2]), total[5] + (weight * p[5] + w2 * e[2]),
    )  # fmt: skip


@inlined
def shown(h, p):
    """P h'."""
    h0, h1, h2 = h
    return (
        h0 * p[0] + h1 * p[1] + h2 * p[2],
        h0 * p[1] + h1 * p[3] + h2 * p[4],
        h0 * p[2] + h1 * p[4] + h2 * p[5],
    )


@inlined
def without(p, w, per_S):
    """P - w w' / S; the products wait for no division."""
    return (
        p[0] - (w[0] * w[0]) * per_S, p[1] - (w[0] * w[1]) * per_S, p[2] - (w[0] * w[2]) * per_S,
        p[3] - (w[1] * w[1]) * per_S, p[4] - (w[1] * w[2]) * per_S, p[5] - (w[2] * w[2]) * per_S,
    )  # fmt: skip


@inlined
def _gather(j, i, n, b, x, P, in_x, in_P):
    """Source i in the states of target j, into rows i of in_x, in_P: for hypotheses that name their states in another order."""
    for k in range(n):
        at = b.source[j, i, k]
        in_x[i, k] = x[i, at] if at >= 0 else b.entry_mean[j, k]
        for q in range(n):
            to = b.source[j, i, q]
            in_P[i, k, q] = P[i, min(at, to), max(at, to)] if at >= 0 and to >= 0 else 0.0
        if at < 0:
            in_P[i, k, k] = b.entry_var[j, k]


@inlined
def _mixed(j, count, b, x, P, scr):
    """Moments of target j from its `count` sources, into rows j of scr.to_x, scr.to_P.

    A constant that a source lacks comes from the entry prior: tables of b say which.
    """
    n, m, side, width, wide = b.layout[j, tr.SIZE], b.size.size, _side(b), len(b.wide), _has_constants(j, b)
    for s in range(count):
        if wide and not b.aligned[j, scr.sources[s]]:
            _gather(j, scr.sources[s], n, b, x, P, scr.in_x, scr.in_P)
    m0, m1, m2, mean = 0.0, 0.0, 0.0, zeros(b.wide)
    for s in range(count):
        i, weight = scr.sources[s], scr.weights[s]
        at = i * side
        m0, m1, m2 = m0 + weight * get(x, at), m1 + weight * get(x, at + 1), m2 + weight * get(x, at + 2)
        if wide:
            from_x = x if b.aligned[j, i] else scr.in_x
            pair = (j * m + i) * width
            entered = load(from_x, at + 3, b.wide) * load(b.shared, pair, b.wide)
            entered = entered + load(b.lacking_mean, pair, b.wide)
            store(scr.off, i * width, entered)
            mean = mean + entered * weight
    moments = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    row0, row1, row2, lacking = zeros(b.wide), zeros(b.wide), zeros(b.wide), zeros(b.wide)
    for s in range(count):
        i, weight = scr.sources[s], scr.weights[s]
        at = i * side
        e0, e1, e2 = get(x, at) - m0, get(x, at + 1) - m1, get(x, at + 2) - m2
        moments = with_source(moments, weight, _core(b, P, i), (e0, e1, e2))
        if wide:
            from_P = P if b.aligned[j, i] else scr.in_P
            pair = (j * m + i) * width
            off, shared = load(scr.off, i * width, b.wide) - mean, load(b.shared, pair, b.wide) * weight
            store(scr.off, i * width, off)
            row0 = row0 + (_row(b, from_P, i, 0) * shared + off * (weight * e0))
            row1 = row1 + (_row(b, from_P, i, 1) * shared + off * (weight * e1))
            row2 = row2 + (_row(b, from_P, i, 2) * shared + off * (weight * e2))
            lacking = lacking + load(b.lacking_var, pair, b.wide) * weight
    to_x, to_P = scr.to_x, scr.to_P
    to_x[j, 0], to_x[j, 1], to_x[j, 2] = m0, m1, m2
    _set_core(b, to_P, j, moments)
    if not wide:
        return
    store(to_x, j * _side(b) + 3, mean)
    _set_row(b, to_P, j, 0, row0)
    _set_row(b, to_P, j, 1, row1)
    _set_row(b, to_P, j, 2, row2)
    store(scr.lacking, 0, lacking)
    for k in range(n - 3):
        row = load(b.unit, k * width, b.wide) * get(scr.lacking, k)
        for s in range(count):
            i, weight = scr.sources[s], scr.weights[s]
            from_P = P if b.aligned[j, i] else scr.in_P
            pair = (j * m + i) * width
            shared = load(b.shared, pair, b.wide) * (weight * get(b.shared, pair + k))
            off = load(scr.off, i * width, b.wide) * (weight * get(scr.off, i * width + k))
            row = row + (_row(b, from_P, i, 3 + k) * shared + off)
        _set_row(b, to_P, j, 3 + k, row)


@inlined
def _mix(b, entry, M, mu, x, P, bias, scr):
    """IMM mixing: moments of every hypothesis before the step, from x, P, bias into scr.to_x, to_P, to_bias.

    Source: Blom and Bar-Shalom (1988). mu (m,) mode probabilities; entry: variance of a failed channel's bias on entry, over
    that of its noise; scr.reached gets the predicted mode probabilities.
    """
    m = mu.size
    for j in range(m):
        c = 0.0
        for i in range(m):
            c += M[i, j] * mu[i]
        scr.reached[j] = c
        per_c, count, own = 1.0 / c, 0, 0.0
        for i in range(m):
            weight = M[i, j] * mu[i] * per_c
            if weight >= NEGLIGIBLE:
                scr.sources[count], scr.weights[count] = i, weight
                count += 1
                if i == j:
                    own = weight
        _mixed(j, count, b, x, P, scr)
        if b.failed[j] >= 0:
            mean = own * bias[j, 0]
            off, others = bias[j, 0] - mean, 1.0 - own
            scr.to_bias[j, 0] = mean
            scr.to_bias[j, 1] = own * (off * off + bias[j, 1]) + others * (
                mean * mean + entry * b.noise[b.failed[j]]
            )


@inlined
def _rest(j, b, from_P, P, t, I_grown):
    """Covariance of a motor that rests: it forgets its speed, and nothing else moves."""
    n = b.layout[j, tr.SIZE]
    _, _, _, p11, p12, p22 = _core(b, from_P, j)
    _set_core(b, P, j, (REST_VARIANCE, 0.0, 0.0, p11 + I_grown, p12, p22 + b.diffusion[j, 2] * t))
    if _has_constants(j, b):
        _set_row(b, P, j, 0, zeros(b.wide))
        _set_row(b, P, j, 1, _row(b, from_P, j, 1))
        _set_row(b, P, j, 2, _row(b, from_P, j, 2))
        for k in range(n - 3):
            grown = load(b.unit, k * len(b.wide), b.wide) * (b.diffusion[j, 3 + k] * t)
            _set_row(b, P, j, 3 + k, _row(b, from_P, j, 3 + k) + grown)


@inlined
def _indented(j, b, from_P, P, t, rows_after, row2_before, into_w, into_x, f, t2, work):
    """The part of `_predict` for an indentation d, which moves with x: its rows and columns of P; rows_after with d in them.

    P becomes P + e delta' + delta e' with e the place of d and delta what x after it has in common with a constant more
    than x before. f: rows of w, I, x of the transition matrix; t2: what x after it has in common with w, I, x before.
    """
    at_d = b.layout[j, tr.AT_D]
    place, row0, row1, row2 = (
        load(b.unit, (at_d - 3) * len(b.wide), b.wide),
        rows_after[0],
        rows_after[1],
        rows_after[2],
    )
    delta = row2 - row2_before
    store(work, 2 * len(b.wide), delta)
    with_w = from_P[j, 0, at_d] + t2[0] - from_P[j, 0, 2]
    with_I = from_P[j, 1, at_d] + t2[1] - from_P[j, 1, 2]
    with_x = from_P[j, 2, at_d] + t2[2] - from_P[j, 2, 2]
    with_d, own = (
        _row(b, from_P, j, at_d) + delta,
        from_P[j, at_d, at_d] + get(work, 2 * len(b.wide) + at_d - 3),
    )
    more = f[5] * with_w + f[6] * with_I + dot(into_x, with_d)
    for k in range(b.layout[j, tr.SIZE] - 3):
        _set_row(b, P, j, 3 + k, _row(b, P, j, 3 + k) + place * get(work, 2 * len(b.wide) + k))
    variance = own + more + b.diffusion[j, at_d] * t
    _set_row(b, P, j, at_d, with_d + place * (variance - dot(with_d, place)))
    into = f[0] * with_w + f[1] * with_I + f[2] * with_x + dot(into_w, with_d)
    return (
        row0 + place * (into - dot(row0, place)),
        row1 + place * (f[3] * with_w + f[4] * with_I - dot(row1, place)),
        row2 + place * (more + with_x - dot(row2, place)),
    )


@inlined
def _predict(j, b, p, from_x, from_P, x, P, slow, t, interval, row, last, theta, tune, g, work):
    """Mean and covariance of hypothesis j a sample later: from rows j of from_x, from_P to rows j of x, P; slow in place.

    p: parameters, with the factors in the state from here on. g (3, n): slopes, 0 but for those of `constant_slopes`;
    work (3, width): scratch. Whether the motor rests at the end.
    Of P only what is right of the diagonal in the rows of w, I, x and the square of the constants is kept (see `mirror`).
    """
    n, at_d, wide = b.layout[j, tr.SIZE], b.layout[j, tr.AT_D], _has_constants(j, b)
    w, I, pos, d, torque, rate = from_x[j, 0], from_x[j, 1], from_x[j, 2], 0.0, 0.0, 0.0
    if wide:
        tr.load_parameters(j, from_x, b.layout, b.parameters, p)
        d, torque = tr.value(j, at_d, from_x), tr.value(j, b.layout[j, tr.AT_TORQUE], from_x)
        rate = tr.value(j, b.layout[j, tr.AT_RATE], from_x)
    by_w, by_I, by_x, x_by_w, i, di_dV, load_now, per_J = tr.motion_slopes(
        w, I, pos, d, slow[j, tr.PHI], slow[j, tr.H], slow[j, tr.SAG], interval[row, 0], theta, torque, p
    )
    if wide:
        tr.constant_slopes(j, from_x, b.layout, w, d, i, di_dV, load_now, per_J, theta, p, b.parameters, g)
    (x[j, 0], x[j, 1], x[j, 2], d_after), slow_after, resting = tr.advance(
        w,
        I,
        pos,
        d,
        torque,
        rate,
        tr.slow_of(j, slow),
        t,
        interval.shape[1] // 2,
        interval,
        row,
        last,
        theta,
        p,
    )
    tr.set_slow(j, slow, slow_after)
    if wide:
        store(x, j * _side(b) + 3, load(from_x, j * _side(b) + 3, b.wide))
    if at_d >= 0:
        x[j, at_d] = d_after
    change = (x[j, 0] - w) * (x[j, 0] - w)
    I_grown = b.diffusion[j, 1] * t + tune.tick * tune.tick * change
    if some(resting):
        _rest(j, b, from_P, P, t, I_grown)
        return True
    by_d = g[0, at_d] if at_d >= 0 else 0.0
    f = tr.motion_transition(by_w, by_I, by_x, by_d, x_by_w, t)
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = through(f, _core(b, from_P, j))
    p00 = b.diffusion[j, 0] * t + tune.agility * tune.agility * change
    p01, p02, p22 = 0.0, 0.0, b.diffusion[j, 2] * t
    if wide:
        b0, b1, b2 = _row(b, from_P, j, 0), _row(b, from_P, j, 1), _row(b, from_P, j, 2)
        w_slopes, x_slopes = load(g, 3, b.wide), load(g, 2 * _side(b) + 3, b.wide)
        into_w, into_x = tr.constant_transition(by_w, by_x, by_d, w_slopes, x_slopes, t), x_slopes * t
        store(work, 0, into_w)
        store(work, len(b.wide), into_x)
        through_w, through_x = zeros(b.wide), zeros(b.wide)
        for k in range(n - 3):
            row_k = _row(b, from_P, j, 3 + k)
            through_w = through_w + row_k * get(work, k)
            through_x = through_x + row_k * get(work, len(b.wide) + k)
            _set_row(
                b, P, j, 3 + k, row_k + load(b.unit, k * len(b.wide), b.wide) * (b.diffusion[j, 3 + k] * t)
            )
        t00 += dot(into_w, b0)
        t01 += dot(into_w, b1)
        t02 += dot(into_w, b2)
        t20 += dot(into_x, b0)
        t21 += dot(into_x, b1)
        t22 += dot(into_x, b2)
        f00, f01, f02, f10, f11, f20, f21 = f
        row0, row1 = b0 * f00 + b1 * f01 + b2 * f02 + through_w, b0 * f10 + b1 * f11
        row2 = b0 * f20 + b1 * f21 + b2 + through_x
        p00 += dot(into_w, row0)
        p01 += dot(into_w, row1)
        p02 += dot(into_w, row2)
        p22 += dot(into_x, row2)
        if at_d >= 0:
            row0, row1, row2 = _indented(
                j, b, from_P, P, t, (row0, row1, row2), b2, into_w, into_x, f, (t20, t21, t22), work
            )
        _set_row(b, P, j, 0, row0)
        _set_row(b, P, j, 1, row1)
        _set_row(b, P, j, 2, row2)
    q00, q01, q02, q11, q12, q22 = onto(f, (t00, t01, t02, t10, t11, t12, t20, t21, t22))
    _set_core(b, P, j, (p00 + q00, p01 + q01, p02 + q02, q11 + I_grown, q12, p22 + q22))
    return False


@inlined
def _update(
    j, b, p, x, P, slow, bias, z, row, previous, last_y, glitches, w_cmd, tune, y, H, seen, spread, work
):
    """Scalar updates of hypothesis j, channel by channel; returns its NIS, and its density for `_densities`.

    Fills rows j of y (m, 3), the prediction, and of seen, spread (m, 3), the innovations and their variances. p: parameters
    with the factors in the state. H (3, 4), work (3, width): scratch. A glitch counts as one at the gate and moves nothing.
    """
    n, at_v, failed, wide = b.layout[j, tr.SIZE], b.layout[j, tr.AT_SUPPLY], b.failed[j], _has_constants(j, b)
    tr.channels(j, x, b.layout, slow, w_cmd, 0.0, p, b.parameters, y, H)
    x0, x1, x2, xv = 0.0, 0.0, 0.0, 0.0  # corrections so far
    p_core = _core(b, P, j)
    pv0, pv1, pv2, pvv = 0.0, 0.0, 0.0, 0.0
    row0, row1, row2, row_v, constants = (
        zeros(b.wide),
        zeros(b.wide),
        zeros(b.wide),
        zeros(b.wide),
        zeros(b.wide),
    )
    if wide:
        row0, row1, row2 = _row(b, P, j, 0), _row(b, P, j, 1), _row(b, P, j, 2)
        constants = load(x, j * _side(b) + 3, b.wide)
        if at_v >= 0:
            row_v = _row(b, P, j, at_v)
            pv0, pv1, pv2, pvv = P[j, 0, at_v], P[j, 1, at_v], P[j, 2, at_v], P[j, at_v, at_v]
    doubled, nis, product = 0.0, 0.0, 1.0
    for c in range(3):
        if wide:
            store(work, c * len(b.wide), zeros(b.wide))
            store(work, (3 + c) * len(b.wide), zeros(b.wide))
        seen[j, c] = np.nan
        if z[row, c] != z[row, c] or c == failed:
            continue
        h0, h1, h2, hv = H[c, 0], H[c, 1], H[c, 2], H[c, 3] if at_v >= 0 else 0.0
        e = z[row, c] - y[j, c] - h0 * x0 - h1 * x1 - h2 * x2 - hv * xv
        w0, w1, w2 = shown((h0, h1, h2), p_core)
        w0, w1, w2 = w0 + hv * pv0, w1 + hv * pv1, w2 + hv * pv2
        wv = h0 * pv0 + h1 * pv1 + h2 * pv2 + hv * pvv
        S = (b.noise[c] + _doubt(j, c, tune, y, last_y) + h2 * w2) + (h0 * w0 + h1 * w1) + hv * wv
        per_S = 1.0 / S
        seen[j, c], spread[j, c] = e, S
        product *= S
        doubled -= tr.LOG_2PI
        if tr.glitch(j, S, e, c, glitches, tune.glitch, tune.glitch_samples):
            nis += tune.glitch * tune.glitch
            continue
        nis += e * e * per_S
        gain, gv = e * per_S, wv * per_S
        x0, x1, x2, xv = x0 + w0 * gain, x1 + w1 * gain, x2 + w2 * gain, xv + wv * gain
        p_core = without(p_core, (w0, w1, w2), per_S)
        pv0, pv1, pv2, pvv = pv0 - gv * w0, pv1 - gv * w1, pv2 - gv * w2, pvv - gv * wv
        if wide:
            column = row0 * h0 + row1 * h1 + row2 * h2 + row_v * hv
            store(work, c * len(b.wide), column)
            gains = column * per_S
            store(work, (3 + c) * len(b.wide), gains)
            constants = constants + gains * e
            row0, row1, row2, row_v = (
                row0 - gains * w0,
                row1 - gains * w1,
                row2 - gains * w2,
                row_v - gains * wv,
            )
    x[j, 0] += x0
    x[j, 1] += x1
    x[j, 2] += x2
    _set_core(b, P, j, p_core)
    if wide:
        store(x, j * _side(b) + 3, constants)
        _set_row(b, P, j, 0, row0)
        _set_row(b, P, j, 1, row1)
        _set_row(b, P, j, 2, row2)
        gain0, gain1, gain2 = (
            load(work, 3 * len(b.wide), b.wide),
            load(work, 4 * len(b.wide), b.wide),
            load(work, 5 * len(b.wide), b.wide),
        )
        for k in range(n - 3):
            taken = (
                gain0 * get(work, k)
                + gain1 * get(work, len(b.wide) + k)
                + gain2 * get(work, 2 * len(b.wide) + k)
            )
            _set_row(b, P, j, 3 + k, _row(b, P, j, 3 + k) - taken)
    if failed >= 0 and z[row, failed] == z[row, failed]:
        h0, h1, h2, hv = H[failed, 0], H[failed, 1], H[failed, 2], H[failed, 3]
        p00, p01, p02, p11, p12, p22 = p_core
        expected = y[j, failed] + h0 * x0 + h1 * x1 + h2 * x2 + hv * xv
        variance = h0 * h0 * p00 + h1 * h1 * p11 + h2 * h2 * p22 + hv * hv * pvv
        variance += 2.0 * (
            h0 * h1 * p01 + h0 * h2 * p02 + h1 * h2 * p12 + hv * (h0 * pv0 + h1 * pv1 + h2 * pv2)
        )
        before = previous[failed] if previous[failed] == previous[failed] else np.inf
        sigma = math.sqrt(b.noise[failed] + _doubt(j, failed, tune, y, last_y))
        doubled += 2.0 * tr.failed_channel(
            j, z[row, failed], before, expected, variance, sigma, bias, tune.failed
        )
    return nis, doubled - nis, product


@inlined
def _doubt(j, c, tune, y, last_y):
    """Variance of channel c that the timing of the servo puts in doubt."""
    change = tune.timing * (y[j, c] - last_y[j, c]) if last_y[j, c] == last_y[j, c] else 0.0
    return change * change


@inlined
def mirror(j, n, P):
    """Complete the symmetric P[j] (m, n, n) from what `_predict` and `_update` keep."""
    for r in range(3):
        for k in range(r + 1, n):
            P[j, k, r] = P[j, r, k]


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
    for j in range(0, m, MOST):
        store(mu, j, exp(load(log_density, j, ROOM) - top) * load(reached, j, ROOM))
    total = 0.0
    for j in range(m):
        total += mu[j]
    per_total = 1.0 / total
    for j in range(m):
        mu[j] = max(mu[j] * per_total, UNREACHED)


@inlined
def _densities(b, scr, log_density):
    """Log-densities of all hypotheses from scr.product, the variances of what was read, and scr.doubled, twice the rest."""
    for j in range(0, b.size.size, MOST):
        store(log_density, j, (load(scr.doubled, j, ROOM) - log(load(scr.product, j, ROOM))) * 0.5)


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

    to_x, in_x (m, n), to_P, in_P (m, n, n), to_bias (m, 2): the other side of mixing; sources, weights (m,), off (m, width),
    lacking (width,): who mixes; M (m, m); p (m, VECTOR_SIZE) parameters with the factors in the states; mu, log_density,
    reached (m,); y, seen, spread (m, 3); g (m, 3, n), H (3, 4), work (6, width), square (2, m, m); unscented: see there;
    mixed (1,): the time step that M belongs to, which outlasts a call; product, doubled (m,): see `_densities`; lost (m,).
    Arrays that are read in rows of MOST have room behind them.
    """

    to_x: Array
    to_P: Array
    in_x: Array
    in_P: Array
    to_bias: Array
    sources: NDArray[np.int64]
    weights: Array
    off: Array
    lacking: Array
    M: Array
    p: Array
    mu: Array
    log_density: Array
    reached: Array
    y: Array
    seen: Array
    spread: Array
    g: Array
    H: Array
    work: Array
    square: Array
    unscented: UnscentedWork
    mixed: Array
    product: Array
    doubled: Array
    lost: NDArray[np.bool_]


def scratch(b: BankArrays) -> Scratch:
    """Work arrays for a bank."""
    m, n, width = b.entry_mean.shape[0], padded(b), len(b.wide)
    return Scratch(
        np.zeros((m, n)), np.zeros((m, n, n)), np.zeros((m, n)), np.zeros((m, n, n)), np.zeros((m, 2)),
        np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros((m, width)), np.zeros(width), np.eye(m), b.parameters.copy(),
        _roomy(m), _roomy(m), _roomy(m), np.zeros((m, 3)), np.zeros((m, 3)), np.ones((m, 3)), np.zeros((m, 3, n)),
        np.zeros((3, 4)), np.zeros((6, width)), np.zeros((2, m, m)), unscented.work_arrays(m, n), np.full(1, -1.0),
        _roomy(m), _roomy(m), np.zeros(m, dtype=np.bool_),
    )  # fmt: skip


def _roomy(m: int) -> Array:
    """Zeros (m,) with room behind them for the last row that is read."""
    return np.zeros(m + MOST)[:m]


def padded(b: BankArrays) -> int:
    """Room for the states of a hypothesis: rows of constants have a fixed width."""
    return 3 + len(b.wide)


@inlined
def _start_anew(j, b, state):
    tr.start_anew(
        j, b.layout[j, tr.SIZE], state.x, state.P, state.slow, b.entry_mean, b.entry_var, state.z[2]
    )
    state.bias[j, 0] = 0.0
    state.bias[j, 1] = b.noise[b.failed[j]] if b.failed[j] >= 0 else 0.0


@inlined
def _copy_back(b, state, scr):
    """The mixed moments, whole, for a filter that starts from `state`."""
    for j in range(b.size.size):
        n = b.layout[j, tr.SIZE]
        mirror(j, n, scr.to_P)
        for k in range(n):
            state.x[j, k] = scr.to_x[j, k]
            for q in range(n):
                state.P[j, k, q] = scr.to_P[j, k, q]


@inlined
def _begin(b, tune, state, scr, dt, w_cmd, mixing):
    """Mix the hypotheses where the sample counts as evidence, from `state` into scr.to_x, scr.to_P."""
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
    _mix(b, entry, M, scr.mu, state.x, state.P, state.bias, scr)
    for j in range(b.size.size):
        state.bias[j, 0], state.bias[j, 1] = scr.to_bias[j, 0], scr.to_bias[j, 1]


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
        out_strain[k, j] = _strain(j, b, state.x) if b.strained[j] else 0.0
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
        from_x, from_P = (scr.to_x, scr.to_P) if mixing else (state.x, state.P)
        for j in range(m):
            if not first:
                _predict(
                    j, b, scr.p[j], from_x, from_P, state.x, state.P, state.slow, dt, interval, k, w_cmd[k], theta[k],
                    tune, scr.g[j], scr.work,
                )  # fmt: skip
                if b.failed[j] >= 0:
                    state.bias[j, 1] += creep * b.noise[b.failed[j]] * dt
        for j in range(m):  # a loop of its own: the processor works at several hypotheses at once
            scr.lost[j] = _check(j, b, state, False)
            if scr.lost[j] or first:
                tr.load_parameters(j, state.x, b.layout, b.parameters, scr.p[j])
            out_nis[k, j], scr.doubled[j], scr.product[j] = _update(
                j, b, scr.p[j], state.x, state.P, state.slow, state.bias, z, k, state.z, state.predicted, state.glitches,
                w_cmd[k], tune, scr.y, scr.H, scr.seen, scr.spread, scr.work,
            )  # fmt: skip
        _densities(b, scr, scr.log_density)
        for j in range(m):
            if scr.lost[j] or not (scr.log_density[j] > tr.LOST):
                _check(j, b, state, not scr.lost[j])
                scr.log_density[j] = tr.LOST
        _finish(
            b, state, scr, mixing, k, z, w_cmd, out_mu, out_y, out_seen, out_states, out_density, out_strain
        )
    for j in range(m):
        state.log_mu[j] = math.log(scr.mu[j])
        mirror(j, b.layout[j, tr.SIZE], state.P)
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
        if mixing:
            _copy_back(b, state, scr)
        for j in range(m):
            if not first:
                unscented.predict(
                    j, b, scr.p[j], state.x, state.P, state.slow, dt, interval, k, w_cmd[k], theta[k], tune,
                    scr.unscented,
                )  # fmt: skip
                if b.failed[j] >= 0:
                    state.bias[j, 1] += creep * b.noise[b.failed[j]] * dt
            lost = _check(j, b, state, False)
            density, out_nis[k, j] = unscented.update(
                j, b, scr.p[j], state.x, state.P, state.slow, state.bias, z, k, state.z, state.predicted, state.glitches,
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
        mu, nis, density, strain, y, seen, states = in_one_piece(
            (n, m), (n, m), (n, m), (n, m), (n, m, 3), (n, 3), (n, 4)
        )
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

    def memory(self) -> "Bank":
        """This bank as an onset sees it now, whatever `advance` does later."""
        now = copy.copy(self)
        now.snapshots = self.snapshots.copy()
        return now

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


def in_one_piece(*shapes: tuple[int, ...]) -> list[Array]:
    """Arrays of these shapes in one allocation, which the system gives in large pages: small ones cost more than a sample."""
    sizes = [math.prod(shape) for shape in shapes]
    parts = np.split(np.empty(sum(sizes)), np.cumsum(sizes)[:-1])
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
