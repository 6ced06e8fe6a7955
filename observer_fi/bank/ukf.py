"""Unscented Kalman filters of all hypotheses of a bank side by side, compiled: the other way to predict and update.

The points are those of filterpy's MerweScaledSigmaPoints and drawn anew after a prediction, as filterpy 2.0 does; every
point has its own stick and slip and its own saturation. A state that a hypothesis does not have gives points without weight.
"""

from typing import NamedTuple

import numpy as np

from observer_fi.bank import transition as tr
from observer_fi.bank.channel_update import doubted, gate, of_failed
from observer_fi.bank.motion_moments import meanwhile
from observer_fi.numerics import inlined, log, maximum, side_by_side, sqrt, where_above, zeros_like
from observer_fi.physics import VMAX, linear, plant
from observer_fi.records import Array

# Sigma points at sqrt(n) standard deviations: with alpha = 1 and kappa = 0 no weight is negative, so that a covariance
# stays one; beta = 2 is right for a Gaussian. Small alphas weigh the centre by -1e6 and lose six digits.
ALPHA, BETA, KAPPA = 1.0, 2.0, 0.0
FLAT = 1e-12  # least share of a variance that a pivot keeps


class UnscentedWork(NamedTuple):
    """Work arrays of the unscented transform in rows of L numbers, or these rows.

    root (n, n, L); points (2 n + 1, n, L) sigma points; z (2 n + 1, 3, L) their readings; expected (3, L), Pxz (3, n, L),
    Pzz (3, 3, L) moments of those.
    """

    root: Array
    points: Array
    z: Array
    expected: Array
    Pxz: Array
    Pzz: Array


def unscented_work(n: int, L: int) -> UnscentedWork:
    """Work arrays for hypotheses of n places in rows of L numbers."""
    return UnscentedWork(
        np.zeros((n, n, L)), np.zeros((2 * n + 1, n, L)), np.zeros((2 * n + 1, 3, L)), np.zeros((3, L)), np.zeros((3, n, L)),
        np.zeros((3, 3, L)),
    )  # fmt: skip


@inlined
def work_rows(b, u):
    """The work arrays as rows."""
    L = b.wide
    return UnscentedWork(
        side_by_side(u.root, L), side_by_side(u.points, L), side_by_side(u.z, L), side_by_side(u.expected, L),
        side_by_side(u.Pxz, L), side_by_side(u.Pzz, L),
    )  # fmt: skip


@inlined
def factor(P, n, L):
    """Lower Cholesky factor of what P (n, n) has on and above its diagonal, into L (n, n); numbers, or rows of them.

    A pivot that rounding took below FLAT of its variance is set to that share: P may be singular.
    """
    for k in range(n):
        for q in range(k):
            total = P[q, k]
            for r in range(q):
                total = total - L[k, r] * L[q, r]
            L[k, q], L[q, k] = total / L[q, q], zeros_like(total)
        total = P[k, k]
        for r in range(k):
            total = total - L[k, r] * L[k, r]
        L[k, k] = sqrt(maximum(maximum(total, FLAT * P[k, k]), 1e-300))


@inlined
def _sigma_points(b, r, u, x, P):
    """Points of Merwe's unscented transform around the states, into u.points."""
    n = b.n
    factor(P, n, u.root)
    far = ALPHA * sqrt(r.sizes[0] + KAPPA)
    for k in range(n):
        u.points[0, k] = x[k]
        for q in range(n):
            u.points[q + 1, k], u.points[n + q + 1, k] = x[k] + far * u.root[k, q], x[k] - far * u.root[k, q]


@inlined
def _weights(r):
    """Weights of the centre in the mean and in the covariance, and of every other point."""
    spread = ALPHA * ALPHA * (r.sizes[0] + KAPPA)
    centre = (spread - r.sizes[0]) / spread
    return centre, centre + (1.0 - ALPHA * ALPHA + BETA), 0.5 / spread


@inlined
def _move(b, r, x, c, dt, now, interval, row, last, theta):
    """One point x (n,) a sample later, in place; what it carries after it."""
    p = r.p
    if b.n > 3:
        tr.load_parameters(x, b.at, r.has, r.parameters, p)
    d, torque, rate = (
        tr.state_or(x, b.at, r.has, tr.AT_D, 0.0), tr.state_or(x, b.at, r.has, tr.AT_TORQUE, 0.0),
        tr.state_or(x, b.at, r.has, tr.AT_RATE, 0.0),
    )  # fmt: skip
    (x[0], x[1], x[2], d), after, _, _ = tr.advance(
        x[0], x[1], x[2], d, torque, rate, c, dt, now, interval, row, last, theta, p
    )
    if b.at[tr.AT_D] >= 0:
        x[b.at[tr.AT_D]] = where_above(r.has[tr.AT_D], 0.5, d, x[b.at[tr.AT_D]])
    return after


@inlined
def _driven(b, r, x, w_cmd, theta):
    """Slopes of dw/dt by I and of dx/dt by w at the mean x (n,), while sliding."""
    p = r.p
    if b.n > 3:
        tr.load_parameters(x, b.at, r.has, r.parameters, p)
    d, torque = tr.state_or(x, b.at, r.has, tr.AT_D, 0.0), tr.state_or(x, b.at, r.has, tr.AT_TORQUE, 0.0)
    c, free = tr.carried_in(r.slow), plant.Free(torque, zeros_like(torque))
    m = plant.Motion(x[0], x[1], x[2], d, c.inner)
    _, by_I, _, x_by_w, _, _, _, _ = linear.motion_slopes(m, c.slow, w_cmd, theta, free, p)
    return by_I, x_by_w


@inlined
def predict(b, tune, r, u, from_x, from_P, dt, now, interval, row, last, theta, seen):
    """Means and covariances a sample later, from from_x, from_P to r.x, r.P; r.slow in place, after the centre."""
    n, before = b.n, from_x[0]
    by_I, x_by_w = _driven(b, r, from_x, interval[row, 0], theta)
    _sigma_points(b, r, u, from_x, from_P)
    I, x, c, moving = from_x[1], from_x[2], tr.carried_in(r.slow), zeros_like(before)
    after = c
    for s in range(2 * n, -1, -1):
        after = _move(b, r, u.points[s], c, dt, now, interval, row, last, theta)
        weighed = 1.0 + zeros_like(before) if s == 0 else r.holds[(s - 1) % n]
        moving = moving + weighed * abs(u.points[s, 0])
    tr.carry_into(r.slow, after)
    if b.delayed:
        centre = (u.points[0, 0], u.points[0, 1], u.points[0, 2], after)
        tr.delay_readings(r.slow, b.delays, (before, I, x, c), centre, interval[row, 0], last, now, dt, r.p)
    of_mean, of_centre, weight = _weights(r)
    for k in range(n):
        mean = of_mean * u.points[0, k]
        for q in range(n):
            mean = mean + (weight * r.holds[q]) * (u.points[q + 1, k] + u.points[n + q + 1, k])
        r.x[k] = where_above(r.holds[k], 0.5, mean, r.entry_mean[k])
        for s in range(2 * n + 1):
            u.points[s, k] = u.points[s, k] - r.x[k]
    for k in range(n):
        for q in range(k, n):
            total = of_centre * (u.points[0, k] * u.points[0, q])
            for s in range(n):
                both = (
                    u.points[s + 1, k] * u.points[s + 1, q] + u.points[n + s + 1, k] * u.points[n + s + 1, q]
                )
                total = total + (weight * r.holds[s]) * both
            r.P[k, q] = total
        growth = r.diffusion[k] * dt
        r.P[k, k] = r.P[k, k] + (growth if k != 1 else zeros_like(growth))
    change = (r.x[0] - before) * (r.x[0] - before)
    of_change, moves = tune.agility * tune.agility * change, where_above(moving, 0.0, tune.meanwhile, 0.0)
    of_I = tr.grown_current(r.diffusion[1] * dt, seen, b.noise[1], r.parameters)
    p = r.P[0, 0], r.P[0, 1], r.P[0, 2], r.P[1, 1], r.P[1, 2], r.P[2, 2]
    p = meanwhile(p, moves * (r.diffusion[0] * dt + of_change), moves * of_I, by_I, x_by_w, dt)
    r.P[0, 0], r.P[0, 1], r.P[0, 2] = where_above(moving, 0.0, p[0] + of_change, tr.REST_VARIANCE), p[1], p[2]
    r.P[1, 1], r.P[1, 2] = p[3] + (of_I + tune.tick * tune.tick * change), p[4]
    r.P[2, 2] = p[5] + tr.play_doubt(c.high - c.low, after.high - after.low)


@inlined
def _read(b, r, u, w_cmd):
    """Readings of all points, and their moments: r.y and u.expected, u.Pxz, u.Pzz; the points become distances."""
    n = b.n
    c = tr.carried_in(r.slow)
    _sigma_points(b, r, u, r.x, r.P)
    for s in range(2 * n + 1):
        x = u.points[s]
        if n > 3:
            tr.load_parameters(x, b.at, r.has, r.parameters, r.p)
        u.z[s, 0], u.z[s, 1], u.z[s, 2], _, _, _, _, _, _, _ = tr.readings(
            x[0], x[1], x[2], c, w_cmd, r.p, r.parameters[VMAX]
        )
    of_mean, of_centre, weight = _weights(r)
    for c in range(3):
        mean = of_mean * u.z[0, c]
        for q in range(n):
            mean = mean + (weight * r.holds[q]) * (u.z[q + 1, c] + u.z[n + q + 1, c])
        r.y[c], u.expected[c] = mean, mean
        for s in range(2 * n + 1):
            u.z[s, c] = u.z[s, c] - mean
    for k in range(n):
        for s in range(2 * n + 1):
            u.points[s, k] = u.points[s, k] - r.x[k]
    for c in range(3):
        for k in range(n):
            total = of_centre * (u.points[0, k] * u.z[0, c])
            for q in range(n):
                both = u.points[q + 1, k] * u.z[q + 1, c] + u.points[n + q + 1, k] * u.z[n + q + 1, c]
                total = total + (weight * r.holds[q]) * both
            u.Pxz[c, k] = total
        for q in range(3):
            total = of_centre * (u.z[0, c] * u.z[0, q])
            for s in range(n):
                both = u.z[s + 1, c] * u.z[s + 1, q] + u.z[n + s + 1, c] * u.z[n + s + 1, q]
                total = total + (weight * r.holds[s]) * both
            u.Pzz[c, q] = total


@inlined
def _channel(b, tune, r, u, c, z):
    """Scalar update by channel c, of reading z: states, and what the others then expect. NIS and density as `gate` has them."""
    e, S = z - u.expected[c], doubted(b, tune, r, c) + u.Pzz[c, c]
    gain, nis, doubled = gate(tune, r, c, e, S)
    for k in range(b.n):
        scaled = gain * u.Pxz[c, k]
        r.x[k] = r.x[k] + scaled * e
        for q in range(k, b.n):
            r.P[k, q] = r.P[k, q] - scaled * u.Pxz[c, q]
    for other in range(3):
        if other != c:
            scaled = gain * u.Pzz[other, c]
            u.expected[other] = u.expected[other] + scaled * e
            for k in range(b.n):
                u.Pxz[other, k] = u.Pxz[other, k] - scaled * u.Pxz[c, k]
            for q in range(3):
                if q != c:
                    u.Pzz[other, q] = u.Pzz[other, q] - scaled * u.Pzz[c, q]
    return nis, doubled


@inlined
def update(b, tune, r, u, z, row, previous, w_cmd):
    """As `update` of extended.py, by the unscented transform: one set of points, then one channel given those before it."""
    _read(b, r, u, w_cmd)
    none = zeros_like(r.x[0])
    r.product[0], nis, doubled = 1.0 + none, none, none
    for c in range(3):
        r.e[c] = none + np.nan
        if z[row, c] == z[row, c]:
            more, part = _channel(b, tune, r, u, c, z[row, c])
            nis, doubled = nis + more, doubled + part
    r.nis[0], r.density[0] = nis, (doubled - log(r.product[0])) * 0.5
    if b.failing:
        expected = (u.expected[0], u.expected[1], u.expected[2])
        variance = (u.Pzz[0, 0], u.Pzz[1, 1], u.Pzz[2, 2])
        r.density[0] = r.density[0] + of_failed(b, tune, r, z, row, previous, expected, variance)
