"""Extended Kalman filters of all hypotheses of a bank side by side, compiled: a prediction, and scalar updates.

A hypothesis is one number of every row (`packing.py`). Of a covariance only what is on and above its diagonal is kept.
"""

import numpy as np

from observer_fi.bank import transition as tr
from observer_fi.bank.channel_update import doubted, gate, of_failed
from observer_fi.bank.motion_moments import P_times_h, meanwhile, onto, through, without
from observer_fi.numerics import any_of_rare, inlined, log, where_above, zeros_like
from observer_fi.physics import VMAX, linear, plant
from observer_fi.physics import equations as a


@inlined
def _between(P, k, q):
    """Covariance of the states k and q."""
    return P[min(k, q), max(k, q)]


@inlined
def _core(P):
    """Covariance of w, I, x (see `motion_moments.py`)."""
    return P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2], P[2, 2]


@inlined
def _step_mean(b, r, from_x, dt, now, interval, row, last, theta):
    """States a sample later into r.x, and what the mean carries; what moves them (by_w, by_I, by_x, x_by_w), who rests, the
    change of w, and what a play puts in doubt of x.
    """
    n, w, I, pos, p = b.n, from_x[0], from_x[1], from_x[2], r.p
    d, torque, rate = zeros_like(w), zeros_like(w), zeros_like(w)
    if n > 3:
        tr.load_parameters(from_x, b.at, r.has, r.parameters, p)
        d = tr.state_or(from_x, b.at, r.has, tr.AT_D, 0.0)
        torque = tr.state_or(from_x, b.at, r.has, tr.AT_TORQUE, 0.0)
        rate = tr.state_or(from_x, b.at, r.has, tr.AT_RATE, 0.0)
    c, doubt = tr.carried_in(r.slow), zeros_like(w)
    m = plant.Motion(w, I, pos, d, c.inner)
    by_w, by_I, by_x, x_by_w, i, di_dV, load, per_J = linear.motion_slopes(
        m, c.slow, interval[row, 0], theta, plant.Free(torque, rate), p
    )
    if n > 3:
        tr.constant_slopes(from_x, b.at, r.has, w, d, i, di_dV, load, per_J, theta, p, r.parameters, r.g)
    (w1, I1, x1, d1), after, rests, grip = tr.advance(
        w, I, pos, d, torque, rate, c, dt, now, interval, row, last, theta, p
    )
    tr.carry_into(r.slow, after)
    if b.delayed:
        tr.delay_readings(
            r.slow, b.delays, (w, I, pos, c), (w1, I1, x1, after), interval[row, 0], last, now, dt, p
        )
    if any_of_rare(p[a.EXTENDED]):
        doubt, x_by_w = tr.play_doubt(c.high - c.low, after.high - after.low), x_by_w * grip
        for k in b.movers:
            r.g[1, k] = r.g[1, k] * grip
    for k in range(3, n):
        r.x[k] = from_x[k]
    r.x[0], r.x[1], r.x[2] = w1, I1, x1
    if b.at[tr.AT_D] >= 0:
        r.x[b.at[tr.AT_D]] = where_above(r.has[tr.AT_D], 0.5, d1, r.x[b.at[tr.AT_D]])
    return by_w, by_I, by_x, x_by_w, rests, w1 - w, doubt


@inlined
def _transition(b, r, by_w, by_I, by_x, x_by_w, rests, dt):
    """Rows of the transition matrix: of w, I, x by each other; by constants into r.into. A motor that rests forgets its
    speed, and nothing else moves.
    """
    by_d = zeros_like(by_w)
    if b.at[tr.AT_D] >= 0:
        by_d = where_above(r.has[tr.AT_D], 0.5, r.g[0, b.at[tr.AT_D]], by_d)
    f00, f01, f02, f10, f11, f20, f21 = linear.motion_transition(by_w, by_I, by_x, by_d, x_by_w, dt)
    moves = where_above(rests, 0.0, 0.0, 1.0)
    for k in range(3, b.n):
        push = linear.constant_transition(by_w, by_x, by_d, r.g[0, k], r.g[1, k], dt)
        r.into[0, k], r.into[1, k] = moves * push, moves * (r.g[1, k] * dt)
    if any_of_rare(rests):
        f00, f01, f02 = moves * f00, moves * f01, moves * f02
        f10, f11, f20, f21 = moves * f10, where_above(rests, 0.0, 1.0, f11), moves * f20, moves * f21
    return f00, f01, f02, f10, f11, f20, f21


@inlined
def _carry(b, r, f, P):
    """Covariances of w, I, x after the step with w, I, x before it; with the constants into r.T, rows 0 to 2."""
    f00, f01, f02, f10, f11, f20, f21 = f
    w0, w1, w2, I0, I1, I2, x0, x1, x2 = through(f, _core(P))
    for k in range(3, b.n):
        by_w, p0, p1, p2 = r.into[0, k], P[0, k], P[1, k], P[2, k]
        w0, w1, w2 = w0 + by_w * p0, w1 + by_w * p1, w2 + by_w * p2
        with_w = f00 * p0 + f01 * p1 + f02 * p2
        for q in range(3, k):
            with_w = with_w + r.into[0, q] * P[q, k]
        for q in range(k, b.n):
            with_w = with_w + r.into[0, q] * P[k, q]
        r.T[0, k], r.T[1, k], r.T[2, k] = with_w, f10 * p0 + f11 * p1, f20 * p0 + f21 * p1 + p2
    for q in b.movers:
        by_x = r.into[1, q]
        x0, x1, x2 = x0 + by_x * P[0, q], x1 + by_x * P[1, q], x2 + by_x * P[2, q]
        for k in range(3, b.n):
            r.T[2, k] = r.T[2, k] + by_x * _between(P, k, q)
    return w0, w1, w2, I0, I1, I2, x0, x1, x2


@inlined
def _grow(b, r, p):
    """Covariance p of w, I, x after the step with what constants add (see `_carry`)."""
    p00, p01, p02, p11, p12, p22 = p
    for k in range(3, b.n):
        by_w = r.into[0, k]
        p00, p01, p02 = p00 + by_w * r.T[0, k], p01 + by_w * r.T[1, k], p02 + by_w * r.T[2, k]
    for k in b.movers:
        p22 = p22 + r.into[1, k] * r.T[2, k]
    return p00, p01, p02, p11, p12, p22


@inlined
def _indented(b, r, t, p, from_P, changes):
    """An indentation moves with x: its covariances from those of the change of x. changes (L,): variance of that change.

    r.P holds the constants before the step; its rows of w, I, x after it.
    """
    at_d = b.at[tr.AT_D]
    if at_d >= 0:
        has, before = r.has[tr.AT_D], from_P[2, at_d]
        with_d = r.T[2, at_d] - before
        for k in range(3, b.n):
            low, high = min(k, at_d), max(k, at_d)
            r.P[low, high] = r.P[low, high] + has * (r.T[2, k] - from_P[2, k])
        r.P[at_d, at_d] = r.P[at_d, at_d] + has * (with_d + changes)
        r.P[0, at_d] = r.T[0, at_d] + has * (p[2] - t[2])
        r.P[1, at_d] = r.T[1, at_d] + has * (p[4] - t[5])
        r.P[2, at_d] = r.T[2, at_d] + has * (p[5] - t[8])


@inlined
def predict(b, tune, r, from_x, from_P, dt, now, interval, row, last, theta, seen):
    """Means and covariances a sample later, from from_x, from_P to r.x, r.P, which may be the same; r.slow in place.

    seen: what current and voltage changed meanwhile (`transition.changed`).

    Returns the covariances of w, I, x after the step with those before; with the constants they are in r.T, rows 0 to 2.
    """
    by_w, by_I, by_x, x_by_w, rests, change, doubt = _step_mean(
        b, r, from_x, dt, now, interval, row, last, theta
    )
    f = _transition(b, r, by_w, by_I, by_x, x_by_w, rests, dt)
    before = from_P[2, 2]
    t = _carry(b, r, f, from_P)
    p = _grow(b, r, onto(f, t))
    if b.n > 3:
        for k in range(3, b.n):
            for q in range(k, b.n):
                r.P[k, q] = from_P[k, q]
            r.P[k, k] = r.P[k, k] + r.diffusion[k] * dt
        _indented(b, r, t, p, from_P, p[5] - 2.0 * t[8] + before)
        for k in range(3, b.n):
            if k != b.at[tr.AT_D]:
                r.P[0, k], r.P[1, k], r.P[2, k] = r.T[0, k], r.T[1, k], r.T[2, k]
    change, moves = change * change, where_above(rests, 0.0, 0.0, tune.meanwhile)
    growth = r.diffusion[0] * dt + tune.agility * tune.agility * change
    of_I = tr.grown_current(r.diffusion[1] * dt, seen, b.noise[1], r.parameters)
    p = meanwhile(p, moves * growth, moves * of_I, by_I, x_by_w, dt)
    grown = p[0] + growth
    r.P[0, 0], r.P[0, 1], r.P[0, 2] = where_above(rests, 0.0, tr.held_variance(last), grown), p[1], p[2]
    r.P[1, 1] = p[3] + (of_I + tune.tick * tune.tick * change)
    r.P[1, 2], r.P[2, 2] = p[4], p[5] + (r.diffusion[2] * dt + doubt)
    return t


@inlined
def _constants_seen(b, r, h):
    """Covariance of a reading of slopes h (w, I, x, supply) with the constants, into r.w."""
    h0, h1, h2, hv = h
    v = b.at[tr.AT_SUPPLY]
    for k in range(3, b.n):
        r.w[k] = h0 * r.P[0, k] + h1 * r.P[1, k] + h2 * r.P[2, k]
    if v >= 0:
        for k in range(3, b.n):
            r.w[k] = r.w[k] + hv * _between(r.P, k, v)


@inlined
def _correct_constants(b, r, w, gain, step):
    """Constants, and their covariances, after a scalar update with w, r.w = P h'."""
    w0, w1, w2 = gain * w[0], gain * w[1], gain * w[2]
    for k in range(3, b.n):
        seen = r.w[k]
        r.x[k] = r.x[k] + seen * step
        r.P[0, k], r.P[1, k], r.P[2, k] = r.P[0, k] - w0 * seen, r.P[1, k] - w1 * seen, r.P[2, k] - w2 * seen
        scaled = gain * seen
        for q in range(k, b.n):
            r.P[k, q] = r.P[k, q] - scaled * r.w[q]


@inlined
def _channel(b, tune, r, c, z, h, off, p):
    """Scalar update by channel c, of reading z; h: slopes of what is predicted by w, I, x and the supply; off: how far these
    were corrected; p: covariance of w, I, x. Both with the correction, and NIS and density as `gate` gives them.
    """
    v, wv, hv = b.at[tr.AT_SUPPLY], zeros_like(p[0]), h[3]
    e = z - r.y[c] - _reading_change(h, off)
    w0, w1, w2 = P_times_h((h[0], h[1], h[2]), p)
    S = doubted(b, tune, r, c)
    if b.n > 3:
        _constants_seen(b, r, h)
        if v >= 0:
            w0, w1, w2 = w0 + hv * r.P[0, v], w1 + hv * r.P[1, v], w2 + hv * r.P[2, v]
            wv = r.w[v]
            S = S + hv * wv
    S = (S + h[2] * w2) + (h[0] * w0 + h[1] * w1)
    gain, nis, doubled = gate(tune, r, c, e, S)
    step = gain * e
    if b.n > 3:
        _correct_constants(b, r, (w0, w1, w2), gain, step)
    off = (off[0] + w0 * step, off[1] + w1 * step, off[2] + w2 * step, off[3] + wv * step)
    return off, without(p, (w0, w1, w2), gain), nis, doubled


@inlined
def update(b, tune, r, z, row, previous, w_cmd):
    """Scalar updates of r.x, r.P by the readings in row `row` of z (n, 3), channel after channel.

    Fills r.y with the predictions, r.e and r.S with innovations and their variances (e is NaN where nothing was read), r.nis,
    and r.density. previous (3,): the last readings before.
    """
    none, v, p = zeros_like(r.x[0]), r.has[tr.AT_SUPPLY], _core(r.P)
    V, i, x, V_w, V_I, V_v, i_w, i_I, i_v, x_x = tr.readings(
        r.x[0], r.x[1], r.x[2], tr.carried_in(r.slow), w_cmd, r.p, r.parameters[VMAX]
    )
    h = ((V_w, V_I, none, v * V_v), (i_w, i_I, none, v * i_v), (none, none, x_x, none))
    r.y[0], r.y[1], r.y[2] = V, i, x
    r.product[0], nis, doubled, off = 1.0 + none, none, none, (none, none, none, none)
    for c in range(3):
        r.e[c] = none + np.nan
        if z[row, c] == z[row, c]:
            off, p, more, part = _channel(b, tune, r, c, z[row, c], h[c], off, p)
            nis, doubled = nis + more, doubled + part
    r.x[0], r.x[1], r.x[2] = r.x[0] + off[0], r.x[1] + off[1], r.x[2] + off[2]
    r.P[0, 0], r.P[0, 1], r.P[0, 2], r.P[1, 1], r.P[1, 2], r.P[2, 2] = p
    r.nis[0], r.density[0] = nis, (doubled - log(r.product[0])) * 0.5
    if b.failing:
        variance = (_seen(b, r, h[0]), _seen(b, r, h[1]), _seen(b, r, h[2]))
        expected = (
            V + _reading_change(h[0], off),
            i + _reading_change(h[1], off),
            x + _reading_change(h[2], off),
        )
        r.density[0] = r.density[0] + of_failed(b, tune, r, z, row, previous, expected, variance)


@inlined
def _reading_change(h, off):
    """What a reading of slopes h shows of corrections of w, I, x and the supply."""
    return h[0] * off[0] + h[1] * off[1] + h[2] * off[2] + h[3] * off[3]


@inlined
def _seen(b, r, h):
    """Variance of a reading of slopes h."""
    h0, h1, h2, hv = h
    P, v = r.P, b.at[tr.AT_SUPPLY]
    total = h0 * h0 * P[0, 0] + h1 * h1 * P[1, 1] + h2 * h2 * P[2, 2]
    total = total + 2.0 * (h0 * h1 * P[0, 1] + h0 * h2 * P[0, 2] + h1 * h2 * P[1, 2])
    if v >= 0:
        total = total + hv * (hv * P[v, v] + 2.0 * (h0 * P[0, v] + h1 * P[1, v] + h2 * P[2, v]))
    return total
