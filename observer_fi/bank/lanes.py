"""Several logs, or several sets of parameters, in step: eight banks of three states in the lanes of one register.

Equations and algebra are the functions that `kernels.py` calls, with rows of numbers in place of numbers; it judges them
(tests/test_lanes.py). Hypotheses have the states w, I, x and believe every channel.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank import transition as tr
from observer_fi.bank.bank_state import UNLIKELY
from observer_fi.bank.first_state import REST_VARIANCE, first_readings, start
from observer_fi.bank.hypotheses import BankArrays, Hypothesis, arrays
from observer_fi.bank.imm import NEGLIGIBLE, UNREACHED
from observer_fi.bank.log_feed import CommandStream, LogStream
from observer_fi.bank.motion_moments import onto, shown, through, with_source, without
from observer_fi.bank.packing import SKIPPED_S, lined_up, tuning
from observer_fi.numerics import (
    MOST,
    above,
    exp,
    inlined,
    larger,
    log,
    nothing,
    seldom,
    side_by_side,
    some,
    uncounted,
)
from observer_fi.physics import Rig
from observer_fi.records import Array, Log
from observer_fi.settings import BankSettings

LANES = MOST
ALL = (0,) * LANES


class Posterior(NamedTuple):
    """Of one log: t (n,); probability, nis and log-density of m hypotheses at every sample, (n, m)."""

    t: Array
    probability: Array
    nis: Array
    density: Array


class Feed(NamedTuple):
    """Samples of all lanes, side by side: dt [s], w_cmd [rad/s], theta [deg], active (n, L); interval (n, 2 k, L), z (n, 3, L)
    as in `kernels.run`.
    """

    dt: Array
    interval: Array
    w_cmd: Array
    theta: Array
    active: Array
    z: Array


class Lanes(NamedTuple):
    """What is remembered between samples, and scratch: x (m, 3, L), P (m, 6, L), slow (m, SLOW, L), last, glitches (m, 3, L),
    mu, reached, density, product (m, L), stopped (1, L), M (m, m, L), square (4, m, m) and p (m, VECTOR_SIZE, L); to_x, to_P
    the other side of mixing, weights (m, L) who mixes; mixed (1, L) the time steps that M belongs to.
    """

    x: Array
    P: Array
    slow: Array
    last: Array
    glitches: Array
    mu: Array
    reached: Array
    density: Array
    product: Array
    stopped: Array
    M: Array
    square: Array
    p: Array
    to_x: Array
    to_P: Array
    weights: Array
    mixed: Array


def posteriors(
    logs: Sequence[Log], hypotheses: Sequence[tuple[Hypothesis, ...]], rig: Rig, settings: BankSettings
) -> list[Posterior]:
    """The bank over each log; hypotheses: one bank for each log, alike but for the values of their parameters.

    Give one log several times for several sets of parameters. Raises ValueError for hypotheses with other states.
    """
    if len(logs) != len(hypotheses):
        raise ValueError(f"a bank for each log is needed, got {len(logs)} logs and {len(hypotheses)} banks")
    made: dict[int, BankArrays] = {}  # logs often share their hypotheses
    for bank in hypotheses:
        if id(bank) not in made:
            made[id(bank)] = b = arrays(bank, rig, settings)
            if (b.size > 3).any() or (b.failed >= 0).any():
                raise ValueError("lanes take hypotheses with the states w, I, x that believe every channel")
    found: list[Posterior] = []
    for first in range(0, len(logs), LANES):
        banks = hypotheses[first : first + LANES]
        found += _group(logs[first : first + LANES], banks, [made[id(bank)] for bank in banks], rig, settings)
    return found


def _group(
    logs: Sequence[Log],
    banks: Sequence[tuple[Hypothesis, ...]],
    made: list[BankArrays],
    rig: Rig,
    settings: BankSettings,
) -> list[Posterior]:
    """At most LANES logs; lanes without one repeat the last. made: the arrays of each bank."""
    feeds = [_fed(log, rig, settings) for log in logs]
    lane = [min(k, len(logs) - 1) for k in range(LANES)]
    work = _lanes([(feeds[k], banks[k], made[k]) for k in lane])
    n, m = max(f.log.t.size for f in feeds), len(banks[0])
    mu, nis, density = kernels.in_one_piece((n, m, LANES), (n, m, LANES), (n, m, LANES))
    feed, tune = _room(feeds[0].interval.shape[1]), tuning(settings)
    for first in range(0, n, kernels.BLOCK):
        part = slice(first, min(first + kernels.BLOCK, n))
        _fill(feed, [feeds[k] for k in lane], part)
        run(made[0], tune, feed, work, mu[part], nis[part], density[part])
    return [
        Posterior(f.log.t[f.own], *(a[: f.log.t.size, :, k][f.own] for a in (mu, nis, density)))
        for k, f in enumerate(feeds)
    ]


class Fed(NamedTuple):
    """A log with its gaps filled, n samples; which of them are its own; dt, w_cmd, active (n,) and interval (n, 2 k)."""

    log: Log
    own: slice | np.ndarray
    dt: Array
    w_cmd: Array
    active: Array
    interval: Array


def _fed(log: Log, rig: Rig, settings: BankSettings) -> Fed:
    log, own = LogStream().take(log)
    w_cmd, interval = CommandStream(rig.model, settings.substep_s).intervals(log.t, log.w_cmd)
    dt = np.minimum(np.diff(log.t, prepend=np.nan), SKIPPED_S)
    return Fed(
        log, slice(None) if own.all() else own, dt, w_cmd, kernels.under_way(interval, w_cmd), interval
    )


def _room(steps: int) -> Feed:
    """A Feed for a block of samples, `steps` half-steps in an interval."""
    one = np.zeros((kernels.BLOCK, LANES))
    return lined_up(
        Feed(one, np.zeros((kernels.BLOCK, steps, LANES)), one, one, one, np.zeros((kernels.BLOCK, 3, LANES)))
    )


def _fill(feed: Feed, feeds: list[Fed], part: slice) -> None:
    """Put a block of samples into feed; a log that has ended has no readings and stands still."""
    for k, f in enumerate(feeds):
        own = (f.dt, f.interval, f.w_cmd, f.log.pitch, f.active, f.log.z)
        for room, values, end in zip(feed, own, (1e-3, 0.0, 0.0, 0.0, 0.0, np.nan), strict=True):
            here = values[part]
            room[: here.shape[0], ..., k] = here
            room[here.shape[0] :, ..., k] = end


def _lanes(lanes: list[tuple[Fed, tuple[Hypothesis, ...], BankArrays]]) -> Lanes:
    starts, p = [], []
    for f, bank, b in lanes:
        starts.append(start(bank, b, first_readings(f.log.z), f.w_cmd[0]))
        p.append(b.parameters)
    m = len(lanes[0][1])
    P = np.array([[memory.P for memory in s] for s in starts])
    upper = np.stack([P[..., r, c] for r, c in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    mu = np.full((m, LANES), UNLIKELY)
    mu[0] = 1.0 - UNLIKELY * (m - 1)
    return lined_up(Lanes(
        np.array([[memory.x for memory in s] for s in starts]).transpose(1, 2, 0).copy(), upper.transpose(2, 0, 1).copy(),
        np.array([[memory.slow for memory in s] for s in starts]).transpose(1, 2, 0).copy(),
        np.full((m, 3, LANES), np.nan), np.zeros((m, 3, LANES)),
        mu, np.zeros((m, LANES)), np.zeros((m, LANES)), np.ones((m, LANES)), np.zeros((1, LANES)),
        np.zeros((m, m, LANES)), np.zeros((4, m, m)),
        np.array(p).transpose(1, 2, 0).copy(), np.zeros((m, 3, LANES)), np.zeros((m, 6, LANES)),
        np.zeros((m, LANES)), np.full((1, LANES), -1.0),
    ))  # fmt: skip


@inlined
def _transition(b, tune, feed, s, k, l):
    """M of lane l for sample k, into s.M (m, m, L); what is mended after a rest is in the first sample of a move alone."""
    m = s.mu.shape[0]
    tr.mode_transition(b.rates, feed.dt[k, l], s.square[2], s.square)
    s.mixed[0, l] = feed.dt[k, l]
    M = s.square[2]
    if s.stopped[0, l] == 1.0:
        M = s.square[3]
        tr.renewed(s.square[2], tune.mended, M)
        s.stopped[0, l], s.mixed[0, l] = 0.0, -1.0
    for i in range(m):
        for j in range(m):
            s.M[i, j, l] = M[i, j]


@inlined
def _transitions(b, tune, feed, s, f, r, k):
    """M of every active lane whose time step changed or whose move begins."""
    dt = f.dt[k]
    changed = above(abs(dt - r.mixed[0]), 1e-9 * dt, 1.0, r.stopped[0])
    if seldom(f.active[k] * changed):
        for l in range(LANES):
            changed = abs(feed.dt[k, l] - s.mixed[0, l]) > 1e-9 * feed.dt[k, l]
            if feed.active[k, l] != 0.0 and (changed or s.stopped[0, l] == 1.0):
                _transition(b, tune, feed, s, k, l)


@inlined
def _three(values, j):
    """Of hypothesis j: the rows of w, I, x."""
    return values[j, 0], values[j, 1], values[j, 2]


@inlined
def _set_three(values, j, rows):
    values[j, 0], values[j, 1], values[j, 2] = rows


@inlined
def _six(P, j):
    """Covariance of hypothesis j (see `through`)."""
    return P[j, 0], P[j, 1], P[j, 2], P[j, 3], P[j, 4], P[j, 5]


@inlined
def _set_six(P, j, p):
    P[j, 0], P[j, 1], P[j, 2], P[j, 3], P[j, 4], P[j, 5] = p


@inlined
def _mix(m, r, active):
    """IMM mixing into r.to_x, r.to_P, where a lane is active; predicted mode probabilities into r.reached."""
    for j in range(m):
        c = r.M[0, j] * r.mu[0]
        for i in range(1, m):
            c = c + r.M[i, j] * r.mu[i]
        r.reached[j] = c
        per_c, m0, m1, m2 = 1.0 / above(active, 0.5, c, 1.0), nothing(c), nothing(c), nothing(c)
        for i in range(m):
            own = 1.0 if i == j else 0.0
            weight = above(active, 0.5, r.M[i, j] * r.mu[i] * per_c, own)
            weight = above(weight, NEGLIGIBLE, weight, 0.0)
            r.weights[i] = weight
            x0, x1, x2 = _three(r.x, i)
            m0, m1, m2 = m0 + weight * x0, m1 + weight * x1, m2 + weight * x2
        p = (nothing(c), nothing(c), nothing(c), nothing(c), nothing(c), nothing(c))
        for i in range(m):
            x0, x1, x2 = _three(r.x, i)
            p = with_source(p, r.weights[i], _six(r.P, i), (x0 - m0, x1 - m1, x2 - m2))
        _set_three(r.to_x, j, (m0, m1, m2))
        _set_six(r.to_P, j, p)


@inlined
def _predict(j, b, tune, steps, feed, r, k, from_x, from_P):
    """Means and covariances of hypothesis j a sample later."""
    (w, I, x), p, t, theta = _three(from_x, j), r.p[j], feed.dt[k], feed.theta[k]
    none, slow = nothing(w), (r.slow[j, 0], r.slow[j, 1], r.slow[j, 2], r.slow[j, 3])
    by_w, by_I, by_x, x_by_w, _, _, _, _ = tr.motion_slopes(
        w, I, x, none, slow[tr.PHI], slow[tr.H], slow[tr.SAG], feed.interval[k, 0], theta, none, p
    )
    (w1, I1, x1, _), after, rests = tr.advance(
        w, I, x, none, none, none, slow, t, steps, feed.interval, k, feed.w_cmd[k], theta, p
    )
    _set_three(r.x, j, (w1, I1, x1))
    r.slow[j, 0], r.slow[j, 1], r.slow[j, 2], r.slow[j, 3] = after
    f = tr.motion_transition(by_w, by_I, by_x, none, x_by_w, t)
    before, change = _six(from_P, j), (w1 - w) * (w1 - w)
    q00, q01, q02, q11, q12, q22 = onto(f, through(f, before))
    q00 = q00 + (b.diffusion[j, 0] * t + tune.agility * tune.agility * change)
    if seldom(rests):
        q00, q01, q02 = (
            above(rests, 0.0, REST_VARIANCE, q00),
            above(rests, 0.0, 0.0, q01),
            above(rests, 0.0, 0.0, q02),
        )
        q11, q12, q22 = (
            above(rests, 0.0, before[3], q11), above(rests, 0.0, before[4], q12), above(rests, 0.0, before[5], q22)
        )  # fmt: skip
    q11, q22 = q11 + (b.diffusion[j, 1] * t + tune.tick * tune.tick * change), q22 + b.diffusion[j, 2] * t
    _set_six(r.P, j, (q00, q01, q02, q11, q12, q22))


@inlined
def _channel(j, c, b, tune, z, y, h, r, d, P, nis, doubled):
    """Scalar update by one channel: corrections d so far, covariance, NIS, and the density for `_densities`."""
    there = above(abs(z), -1.0, 1.0, 0.0)  # a missing reading is no number
    e = above(there, 0.5, z - y - h[0] * d[0] - h[1] * d[1] - h[2] * d[2], 0.0)
    w0, w1, w2 = shown(h, P)
    change = tune.timing * (y - r.last[j, c])
    doubt = above(change * change, 0.0, change * change, 0.0)
    S = above(there, 0.5, (b.noise[c] + doubt + h[2] * w2) + (h[0] * w0 + h[1] * w1), 1.0)
    per_S, limit, count = 1.0 / S, tune.glitch * tune.glitch, r.glitches[j, c]
    far = above(e * e, limit * S, 1.0, 0.0)
    glitch = above(tune.glitch_samples, count, far, 0.0)
    gain = above(glitch, 0.5, 0.0, there * per_S)
    step = gain * e
    r.glitches[j, c], r.last[j, c] = above(there, 0.5, far * (count + glitch), count), y
    r.product[j] = r.product[j] * S
    return (
        (d[0] + w0 * step, d[1] + w1 * step, d[2] + w2 * step), without(P, (w0, w1, w2), gain),
        nis + above(glitch, 0.5, limit, e * e * per_S), doubled - there * tr.LOG_2PI,
    )  # fmt: skip


@inlined
def _update(j, b, tune, feed, r, k, out_nis):
    """Scalar updates of hypothesis j, channel after channel."""
    (w, I, x), P = _three(r.x, j), _six(r.P, j)
    none = nothing(w)
    V, i, seen_x, V_w, V_I, _, i_w, i_I, _, x_w, x_x = tr.readings(
        w, I, x, r.slow[j, tr.H], r.slow[j, tr.SAG], r.slow[j, tr.LAGGED], feed.w_cmd[k], r.p[j], none
    )
    r.product[j], d = 1.0 + none, (none, none, none)
    d, P, nis, doubled = _channel(j, 0, b, tune, feed.z[k, 0], V, (V_w, V_I, none), r, d, P, none, none)
    d, P, nis, doubled = _channel(j, 1, b, tune, feed.z[k, 1], i, (i_w, i_I, none), r, d, P, nis, doubled)
    d, P, nis, doubled = _channel(
        j, 2, b, tune, feed.z[k, 2], seen_x, (x_w, none, x_x), r, d, P, nis, doubled
    )
    _set_three(r.x, j, (w + d[0], I + d[1], x + d[2]))
    _set_six(r.P, j, P)
    r.density[j], out_nis[k, j] = doubled - nis, nis


@inlined
def _densities(m, r):
    """Log-densities of all hypotheses from r.product, the variances of what was read, and twice the rest in r.density."""
    for j in range(m):
        r.density[j] = larger((r.density[j] - log(r.product[j])) * 0.5, tr.LOST)


@inlined
def _posterior(m, r, active):
    top = r.density[0]
    for j in range(1, m):
        top = larger(r.density[j], top)
    total = nothing(top)
    for j in range(m):
        share = r.reached[j] * exp(r.density[j] - top)
        r.reached[j] = share
        total = total + share
    per_total = 1.0 / total
    for j in range(m):
        share = larger(r.reached[j] * per_total, UNREACHED)
        r.mu[j] = above(active, 0.5, share, r.mu[j])


@inlined
def _rows(s):
    """The memory of all lanes as rows."""
    return Lanes(
        side_by_side(s.x, ALL), side_by_side(s.P, ALL), side_by_side(s.slow, ALL), side_by_side(s.last, ALL),
        side_by_side(s.glitches, ALL), side_by_side(s.mu, ALL), side_by_side(s.reached, ALL), side_by_side(s.density, ALL),
        side_by_side(s.product, ALL), side_by_side(s.stopped, ALL), side_by_side(s.M, ALL), s.square,
        side_by_side(s.p, ALL), side_by_side(s.to_x, ALL),
        side_by_side(s.to_P, ALL), side_by_side(s.weights, ALL), side_by_side(s.mixed, ALL),
    )  # fmt: skip


@inlined
def _feed_rows(feed):
    return Feed(
        side_by_side(feed.dt, ALL), side_by_side(feed.interval, ALL), side_by_side(feed.w_cmd, ALL),
        side_by_side(feed.theta, ALL), side_by_side(feed.active, ALL), side_by_side(feed.z, ALL),
    )  # fmt: skip


@uncounted
def run(b, tune, feed, s, out_mu, out_nis, out_density):
    """All lanes over the next n samples; out_mu, out_nis, out_density (n, m, L). The first of a log has no time step."""
    m, steps, f, r = s.mu.shape[0], feed.interval.shape[1] // 2, _feed_rows(feed), _rows(s)
    mu, nis, density = side_by_side(out_mu, ALL), side_by_side(out_nis, ALL), side_by_side(out_density, ALL)
    for k in range(out_mu.shape[0]):
        active, first = f.active[k], feed.dt[k, 0] != feed.dt[k, 0]
        mixing = not first and some(active)
        r.stopped[0] = above(abs(f.w_cmd[k]), 0.0, r.stopped[0], 1.0)
        if mixing:
            _transitions(b, tune, feed, s, f, r, k)
            _mix(m, r, active)
        from_x, from_P = (r.to_x, r.to_P) if mixing else (r.x, r.P)
        for j in range(m):
            if not first:
                _predict(j, b, tune, steps, f, r, k, from_x, from_P)
        for j in range(m):  # a loop of its own: the processor works at several hypotheses at once
            _update(j, b, tune, f, r, k, nis)
        _densities(m, r)
        if mixing:
            _posterior(m, r, active)
        for j in range(m):
            mu[k, j], density[k, j] = r.mu[j], r.density[j]


__all__ = ["LANES", "Posterior", "posteriors"]
