"""Several logs, or several sets of parameters, in step: eight banks of three states in the lanes of one register.

The equations of a hypothesis run lane by lane, as they branch; the algebra of the filters and of the mixing runs on all
lanes at once, through the same functions as in `kernels.py`, which judges it (tests/test_lanes.py). Hypotheses have the
states w, I, x and believe every channel.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi import kernels
from observer_fi import transition as tr
from observer_fi.compiled import inlined, uncounted
from observer_fi.feed import CommandStream, LogStream
from observer_fi.hypotheses import Hypothesis, arrays
from observer_fi.kernels import NEGLIGIBLE, REST_VARIANCE, UNREACHED
from observer_fi.models import Rig
from observer_fi.records import Array, Log
from observer_fi.rows import MOST, above, exp, load, log, store
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
    """Samples of all lanes: dt, w_cmd, theta, active (L, n), interval (L, n, 2 k), z (L, n, 3); now (8, L): a sample of each,
    side by side: dt, active, z with zeros where nothing was measured, and whether it was.
    """

    dt: Array
    interval: Array
    w_cmd: Array
    theta: Array
    active: Array
    z: Array
    now: Array


class Lanes(NamedTuple):
    """What is remembered between samples, and scratch: x (m, 3, L), P (m, 6, L), slow (m, L, SLOW), last, glitches (m, 3, L), mu,
    reached, density (m, L), stopped (L,), M (m, m, L), square (4, m, m) and p (m, L, VECTOR_SIZE); to_x, to_P the other side of
    mixing; slopes (6, L), readings (11, L) of the hypothesis under way; mixed (L,) the time steps that M belongs to.
    """

    x: Array
    P: Array
    slow: Array
    last: Array
    glitches: Array
    mu: Array
    reached: Array
    density: Array
    stopped: Array
    M: Array
    square: Array
    p: Array
    to_x: Array
    to_P: Array
    slopes: Array
    readings: Array
    mixed: Array


def posteriors(
    logs: Sequence[Log], hypotheses: Sequence[tuple[Hypothesis, ...]], rig: Rig, settings: BankSettings
) -> list[Posterior]:
    """The bank over each log; hypotheses: one bank for each log, alike but for the values of their parameters.

    Give one log several times for several sets of parameters. Raises ValueError for hypotheses with other states.
    """
    if len(logs) != len(hypotheses):
        raise ValueError(f"a bank for each log is needed, got {len(logs)} logs and {len(hypotheses)} banks")
    found: list[Posterior] = []
    for first in range(0, len(logs), LANES):
        part = slice(first, first + LANES)
        found += _group(logs[part], hypotheses[part], rig, settings)
    return found


def _group(
    logs: Sequence[Log], banks: Sequence[tuple[Hypothesis, ...]], rig: Rig, settings: BankSettings
) -> list[Posterior]:
    """At most LANES logs; lanes without one repeat the last."""
    b = arrays(banks[0], rig, settings)
    if len(b.wide) > 0 or (b.failed >= 0).any():
        raise ValueError("lanes take hypotheses with the states w, I, x that believe every channel")
    feeds = [_fed(log, rig, settings) for log in logs]
    lane = [min(k, len(logs) - 1) for k in range(LANES)]
    feed = _side_by_side([feeds[k] for k in lane])
    work = _lanes([(feeds[k], banks[k]) for k in lane], rig, settings)
    n, m = feed.dt.shape[1], len(banks[0])
    mu, nis, density = np.empty((n, m, LANES)), np.empty((n, m, LANES)), np.empty((n, m, LANES))
    run(b, kernels.tuning(settings), feed, work, mu, nis, density)
    return [
        Posterior(whole.t[own], *(a[: whole.t.size, :, k][own] for a in (mu, nis, density)))
        for k, (whole, own, _, _) in enumerate(feeds)
    ]


Fed = tuple[Log, slice | np.ndarray, Array, Array]


def _fed(log: Log, rig: Rig, settings: BankSettings) -> Fed:
    """A log with its gaps filled, which samples are its own, its command at them and between."""
    log, own = LogStream().take(log)
    kept = slice(None) if own.all() else own
    return log, kept, *CommandStream(rig.model, settings.substep_s).intervals(log.t, log.w_cmd)


def _side_by_side(feeds: list[Fed]) -> Feed:
    """Shorter logs end in samples without readings."""
    n = max(f[0].t.size for f in feeds)

    def stacked(values: list[Array], end: float) -> Array:
        out = np.empty((LANES, n, *values[0].shape[1:]))
        for k, value in enumerate(values):
            out[k, : value.shape[0]] = value
            out[k, value.shape[0] :] = end
        return out

    dt = [np.minimum(np.diff(f[0].t, prepend=np.nan), kernels.SKIPPED_S) for f in feeds]
    return Feed(
        stacked(dt, 1e-3), stacked([f[3] for f in feeds], 0.0), stacked([f[2] for f in feeds], 0.0),
        stacked([f[0].pitch for f in feeds], 0.0),
        stacked([kernels.under_way(f[3], f[2]).astype(np.float64) for f in feeds], 0.0),
        stacked([f[0].z for f in feeds], np.nan), np.zeros((8, LANES)),
    )  # fmt: skip


def _lanes(lanes: list[tuple[Fed, tuple[Hypothesis, ...]]], rig: Rig, settings: BankSettings) -> Lanes:
    starts, p = [], []
    for (whole, _, w_cmd, _), bank in lanes:
        b = arrays(bank, rig, settings)
        starts.append(kernels.start(bank, b, kernels.first_readings(whole.z), w_cmd[0]))
        p.append(b.parameters)
    m = len(lanes[0][1])
    P = np.array([s.P for s in starts])
    upper = np.stack([P[..., r, c] for r, c in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))])
    mu = np.array([np.exp(s.log_mu) / np.exp(s.log_mu).sum() for s in starts])
    return Lanes(
        np.array([s.x for s in starts]).transpose(1, 2, 0).copy(), upper.transpose(2, 0, 1).copy(),
        np.array([s.slow for s in starts]).transpose(1, 0, 2).copy(), np.full((m, 3, LANES), np.nan), np.zeros((m, 3, LANES)),
        mu.T.copy(), np.zeros((m, LANES)), np.zeros((m, LANES)), np.zeros(LANES), np.zeros((m, m, LANES)), np.zeros((4, m, m)),
        np.array(p).transpose(1, 0, 2).copy(), np.zeros((m, 3, LANES)), np.zeros((m, 6, LANES)), np.zeros((6, LANES)),
        np.zeros((11, LANES)), np.full(LANES, -1.0),
    )  # fmt: skip


@inlined
def _gather(feed, k):
    """Sample k of every lane into feed.now; whether any counts as evidence."""
    moving = False
    for l in range(LANES):
        feed.now[0, l], feed.now[1, l] = feed.dt[l, k], feed.active[l, k]
        moving = moving or feed.active[l, k] != 0.0
        for c in range(3):
            z = feed.z[l, k, c]
            feed.now[2 + c, l], feed.now[5 + c, l] = (z, 1.0) if z == z else (0.0, 0.0)
    return moving


@inlined
def _transitions(b, tune, feed, s, k):
    """M of every lane for sample k, into s.M (m, m, L); what is mended after a rest is in the first sample of a move alone."""
    m = s.mu.shape[0]
    for l in range(LANES):
        if feed.w_cmd[l, k] == 0.0:
            s.stopped[l] = 1.0
        if feed.active[l, k] == 0.0:
            continue
        mended = s.stopped[l] == 1.0
        if mended or abs(feed.dt[l, k] - s.mixed[l]) > 1e-9 * feed.dt[l, k]:
            tr.mode_transition(b.rates, feed.dt[l, k], s.square[2], s.square)
            s.mixed[l] = feed.dt[l, k]
            M = s.square[2]
            if mended:
                M = s.square[3]
                tr.renewed(s.square[2], tune.mended, M)
                s.stopped[l], s.mixed[l] = 0.0, -1.0
            for i in range(m):
                for j in range(m):
                    s.M[i, j, l] = M[i, j]


@inlined
def _mix(s, active):
    """IMM mixing where a lane is active, in place."""
    m = s.mu.shape[0]
    for j in range(m):
        c = load(s.M, j * LANES, ALL) * load(s.mu, 0, ALL)
        for i in range(1, m):
            c = c + load(s.M, (i * m + j) * LANES, ALL) * load(s.mu, i * LANES, ALL)
        store(s.reached, j * LANES, c)
        per_c, m0, m1, m2 = 1.0 / above(active, 0.5, c, 1.0), c * 0.0, c * 0.0, c * 0.0
        for i in range(m):
            weight = load(s.M, (i * m + j) * LANES, ALL) * load(s.mu, i * LANES, ALL) * per_c
            weight = above(weight, NEGLIGIBLE, weight, 0.0)
            m0 = m0 + weight * load(s.x, (i * 3) * LANES, ALL)
            m1 = m1 + weight * load(s.x, (i * 3 + 1) * LANES, ALL)
            m2 = m2 + weight * load(s.x, (i * 3 + 2) * LANES, ALL)
        nothing = c * 0.0
        p = (nothing, nothing, nothing, nothing, nothing, nothing)
        for i in range(m):
            weight = load(s.M, (i * m + j) * LANES, ALL) * load(s.mu, i * LANES, ALL) * per_c
            weight = above(weight, NEGLIGIBLE, weight, 0.0)
            x0, x1, x2 = _state(s.x, i)
            p = kernels.with_source(p, weight, _moments(s.P, i), (x0 - m0, x1 - m1, x2 - m2))
        old = _state(s.x, j)
        _set_state(
            s.to_x,
            j,
            (above(active, 0.5, m0, old[0]), above(active, 0.5, m1, old[1]), above(active, 0.5, m2, old[2])),
        )
        q = _moments(s.P, j)
        _set_moments(
            s.to_P, j, (above(active, 0.5, p[0], q[0]), above(active, 0.5, p[1], q[1]), above(active, 0.5, p[2], q[2]),
                        above(active, 0.5, p[3], q[3]), above(active, 0.5, p[4], q[4]), above(active, 0.5, p[5], q[5])),
        )  # fmt: skip


@inlined
def _state(x, j):
    return load(x, (j * 3) * LANES, ALL), load(x, (j * 3 + 1) * LANES, ALL), load(x, (j * 3 + 2) * LANES, ALL)


@inlined
def _set_state(x, j, values):
    store(x, (j * 3) * LANES, values[0])
    store(x, (j * 3 + 1) * LANES, values[1])
    store(x, (j * 3 + 2) * LANES, values[2])


@inlined
def _moments(P, j):
    at = j * 6 * LANES
    return (
        load(P, at, ALL), load(P, at + LANES, ALL), load(P, at + 2 * LANES, ALL), load(P, at + 3 * LANES, ALL),
        load(P, at + 4 * LANES, ALL), load(P, at + 5 * LANES, ALL),
    )  # fmt: skip


@inlined
def _set_moments(P, j, p):
    at = j * 6 * LANES
    store(P, at, p[0])
    store(P, at + LANES, p[1])
    store(P, at + 2 * LANES, p[2])
    store(P, at + 3 * LANES, p[3])
    store(P, at + 4 * LANES, p[4])
    store(P, at + 5 * LANES, p[5])


@inlined
def _predict(j, b, tune, feed, s, k, from_x, from_P):
    """Means lane by lane, covariances together."""
    for l in range(LANES):
        p = s.p[j, l]
        w, I, x = from_x[j, 0, l], from_x[j, 1, l], from_x[j, 2, l]
        s.slopes[0, l], s.slopes[1, l], s.slopes[2, l], s.slopes[3, l], _, _, _, _ = tr.motion_slopes(
            w, I, x, 0.0, s.slow[j, l, tr.PHI], s.slow[j, l, tr.H], s.slow[j, l, tr.SAG], feed.interval[l, k, 0],
            feed.theta[l, k], 0.0, p,
        )  # fmt: skip
        s.x[j, 0, l], s.x[j, 1, l], s.x[j, 2, l], _, resting = tr.advance(
            l,
            w,
            I,
            x,
            0.0,
            0.0,
            0.0,
            s.slow[j],
            feed.dt[l, k],
            feed.interval[l],
            k,
            feed.w_cmd[l, k],
            feed.theta[l, k],
            p,
        )
        s.slopes[4, l], s.slopes[5, l] = 1.0 if resting else 0.0, s.x[j, 0, l] - w
    t, change = load(feed.now, 0, ALL), load(s.slopes, 5 * LANES, ALL)
    by_w, by_I, by_x = load(s.slopes, 0, ALL), load(s.slopes, LANES, ALL), load(s.slopes, 2 * LANES, ALL)
    f = tr.motion_transition(by_w, by_I, by_x, 0.0, load(s.slopes, 3 * LANES, ALL), t)
    a, rests = _moments(from_P, j), load(s.slopes, 4 * LANES, ALL)
    p = kernels.onto(f, kernels.through(f, a))
    change = change * change
    grown = b.diffusion[j, 0] * t + tune.agility * tune.agility * change
    _set_moments(
        s.P, j,
        (
            above(rests, 0.5, REST_VARIANCE, p[0] + grown), above(rests, 0.5, 0.0, p[1]), above(rests, 0.5, 0.0, p[2]),
            above(rests, 0.5, a[3], p[3]) + b.diffusion[j, 1] * t + tune.tick * tune.tick * change, above(rests, 0.5, a[4], p[4]),
            above(rests, 0.5, a[5], p[5]) + b.diffusion[j, 2] * t,
        ),
    )  # fmt: skip


@inlined
def _update(j, b, tune, feed, s, k, out_nis):
    """Readings lane by lane, then the scalar updates, channel after channel; the log-density into s.density."""
    for l in range(LANES):
        p = s.p[j, l]
        (
            s.readings[0, l], s.readings[1, l], s.readings[2, l], s.readings[3, l], s.readings[4, l], _,
            s.readings[5, l], s.readings[6, l], _, s.readings[7, l], s.readings[8, l],
        ) = tr.readings(
            s.x[j, 0, l], s.x[j, 1, l], s.x[j, 2, l], s.slow[j, l, tr.H], s.slow[j, l, tr.SAG], s.slow[j, l, tr.LAGGED],
            feed.w_cmd[l, k], p, 0.0,
        )  # fmt: skip
    x0, x1, x2 = _state(s.x, j)
    P, nothing = _moments(s.P, j), x0 * 0.0
    d0, d1, d2, nis, product, doubled = nothing, nothing, nothing, nothing, nothing + 1.0, nothing
    for c in range(3):
        at = (j * 3 + c) * LANES
        h0, h1, h2 = (
            load(s.readings, (3 + 2 * c) * LANES, ALL),
            load(s.readings, (4 + 2 * c) * LANES, ALL),
            nothing,
        )
        if c == 2:
            h1, h2 = nothing, h1
        y, last, there = (
            load(s.readings, c * LANES, ALL),
            load(s.last, at, ALL),
            load(feed.now, (5 + c) * LANES, ALL),
        )
        e = above(there, 0.5, load(feed.now, (2 + c) * LANES, ALL) - y - h0 * d0 - h1 * d1 - h2 * d2, 0.0)
        w0, w1, w2 = kernels.shown((h0, h1, h2), P)
        change = tune.timing * (y - last)
        doubt = above(change * change, 0.0, change * change, 0.0)
        S = above(there, 0.5, b.noise[c] + doubt + h0 * w0 + h1 * w1 + h2 * w2, 1.0)
        per_S, limit, count = 1.0 / S, tune.glitch * tune.glitch, load(s.glitches, at, ALL)
        far = above(e * e, limit * S, 1.0, 0.0)
        glitch = above(tune.glitch_samples, count, far, 0.0)
        store(s.glitches, at, above(there, 0.5, far * (count + glitch), count))
        nis = nis + above(glitch, 0.5, limit, e * e * per_S)
        product, doubled = product * S, doubled - there * tr.LOG_2PI
        gain = above(glitch, 0.5, 0.0, there * per_S)
        g0, g1, g2 = w0 * gain, w1 * gain, w2 * gain
        d0, d1, d2 = d0 + g0 * e, d1 + g1 * e, d2 + g2 * e
        P = kernels.without(P, (g0, g1, g2), (w0, w1, w2))
        store(s.last, at, y)
    _set_state(s.x, j, (x0 + d0, x1 + d1, x2 + d2))
    _set_moments(s.P, j, P)
    density = (doubled - nis - log(product)) * 0.5
    store(s.density, j * LANES, above(density, tr.LOST, density, tr.LOST))
    store(out_nis, (k * s.mu.shape[0] + j) * LANES, nis)


@inlined
def _posterior(s, active):
    m = s.mu.shape[0]
    top = load(s.density, 0, ALL)
    for j in range(1, m):
        one = load(s.density, j * LANES, ALL)
        top = above(one, top, one, top)
    total = top * 0.0
    for j in range(m):
        share = load(s.reached, j * LANES, ALL) * exp(load(s.density, j * LANES, ALL) - top)
        store(s.reached, j * LANES, share)
        total = total + share
    per_total = 1.0 / total
    for j in range(m):
        share = load(s.reached, j * LANES, ALL) * per_total
        share = above(share, UNREACHED, share, UNREACHED)
        store(s.mu, j * LANES, above(active, 0.5, share, load(s.mu, j * LANES, ALL)))


@uncounted
def run(b, tune, feed, s, out_mu, out_nis, out_density):
    """All lanes over n samples; out_mu, out_nis, out_density (n, m, L)."""
    m = s.mu.shape[0]
    for k in range(feed.dt.shape[1]):
        moving = _gather(feed, k)
        active = load(feed.now, LANES, ALL)
        mixing = k > 0 and moving
        if mixing:
            _transitions(b, tune, feed, s, k)
            _mix(s, active)
        else:
            for l in range(LANES):
                if feed.w_cmd[l, k] == 0.0:
                    s.stopped[l] = 1.0
        from_x, from_P = (s.to_x, s.to_P) if mixing else (s.x, s.P)
        for j in range(m):
            if k > 0:
                _predict(j, b, tune, feed, s, k, from_x, from_P)
            _update(j, b, tune, feed, s, k, out_nis)
        if mixing:
            _posterior(s, active)
        for j in range(m):
            store(out_mu, (k * m + j) * LANES, load(s.mu, j * LANES, ALL))
            store(out_density, (k * m + j) * LANES, load(s.density, j * LANES, ALL))


__all__ = ["LANES", "Posterior", "posteriors"]
