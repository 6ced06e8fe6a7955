"""The unscented transform of one hypothesis, compiled: the other way of `kernels.py` to predict and update.

The points are those of filterpy's MerweScaledSigmaPoints and drawn anew after a prediction, as filterpy 2.0 does; every
point has its own stick and slip and its own saturation.
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi import transition as tr
from observer_fi.compiled import inlined, uncounted
from observer_fi.records import Array


class UnscentedWork(NamedTuple):
    """Work arrays of the unscented transform.

    L (n, n); points (2 n + 1, n), x (m, n), slow (m, SLOW): sigma points, and one of them in its hypothesis' row;
    z (2 n + 1, 3), expected, column (3,), Pxz (3, n), Pzz (3, 3): their readings and moments.
    """

    L: Array
    points: Array
    x: Array
    slow: Array
    z: Array
    expected: Array
    column: Array
    Pxz: Array
    Pzz: Array


def work_arrays(m: int, n: int) -> UnscentedWork:
    """Work arrays for m hypotheses of at most n states."""
    return UnscentedWork(
        np.zeros((n, n)), np.zeros((2 * n + 1, n)), np.zeros((m, n)), np.zeros((m, tr.SLOW)), np.zeros((2 * n + 1, 3)),
        np.zeros(3), np.zeros(3), np.zeros((3, n)), np.zeros((3, 3)),
    )  # fmt: skip


@inlined
def _sigma_points(j, n, x, P, L, points):
    """Points of Merwe's unscented transform around state j, into points (2 n + 1, n). L (n, n): scratch."""
    tr.factor(j, P, n, L)
    far = tr.ALPHA * math.sqrt(n + tr.KAPPA)
    for k in range(n):
        points[0, k] = x[j, k]
        for q in range(n):
            points[q + 1, k] = x[j, k] + far * L[k, q]
            points[n + q + 1, k] = x[j, k] - far * L[k, q]


@inlined
def _weights(n):
    """Weights of the centre in the mean and in the covariance, and of every other point."""
    spread = tr.ALPHA * tr.ALPHA * (n + tr.KAPPA)
    centre = (spread - n) / spread
    return centre, centre + 1.0 - tr.ALPHA * tr.ALPHA + tr.BETA, 0.5 / spread


@uncounted
def predict(j, b, p, x, P, slow, t, interval, row, last, theta, tune, u):
    """As `_predict` of kernels.py, by the unscented transform; the slow states follow the centre. u: UnscentedWork."""
    n = b.layout[j, tr.SIZE]
    _sigma_points(j, n, x, P, u.L, u.points)
    moving = False
    for s in range(2 * n, -1, -1):
        for k in range(n):
            u.x[j, k] = u.points[s, k]
        for k in range(tr.SLOW):
            u.slow[j, k] = slow[j, k]
        tr.load_parameters(j, u.x, b.layout, b.parameters, p)
        tr.propagate(j, u.x, b.layout, u.slow, t, interval, row, last, theta, p)
        moving = moving or u.x[j, 0] != 0.0
        for k in range(n):
            u.points[s, k] = u.x[j, k]
    for k in range(tr.SLOW):
        slow[j, k] = u.slow[j, k]
    of_mean, of_centre, weight = _weights(n)
    w_before = x[j, 0]
    for k in range(n):
        x[j, k] = of_mean * u.points[0, k]
        for s in range(1, 2 * n + 1):
            x[j, k] += weight * u.points[s, k]
    for k in range(n):
        for q in range(k + 1):
            total = of_centre * (u.points[0, k] - x[j, k]) * (u.points[0, q] - x[j, q])
            for s in range(1, 2 * n + 1):
                total += weight * (u.points[s, k] - x[j, k]) * (u.points[s, q] - x[j, q])
            P[j, k, q] = total
            P[j, q, k] = total
    for k in range(n):
        P[j, k, k] += b.diffusion[j, k] * t
    change = x[j, 0] - w_before
    P[j, 0, 0] += tune.agility * tune.agility * change * change
    P[j, 1, 1] += tune.tick * tune.tick * change * change
    if not moving:
        P[j, 0, 0] = tr.REST_VARIANCE


@uncounted
def update(
    j, b, p, x, P, slow, bias, z, row, previous, last_y, glitches, w_cmd, theta, tune, y, H, seen, spread, u
):
    """As `_update` of kernels.py, by the unscented transform: one set of points, then one channel given those before it."""
    n, failed = b.layout[j, tr.SIZE], b.failed[j]
    points = 2 * n + 1
    _sigma_points(j, n, x, P, u.L, u.points)
    for s in range(points):
        for k in range(n):
            u.x[j, k] = u.points[s, k]
        tr.load_parameters(j, u.x, b.layout, b.parameters, p)
        tr.channels(j, u.x, b.layout, slow, w_cmd, theta, p, b.parameters, y, H)
        for c in range(3):
            u.z[s, c] = y[j, c]
    of_mean, of_centre, weight = _weights(n)
    for c in range(3):
        y[j, c] = of_mean * u.z[0, c]
        for s in range(1, points):
            y[j, c] += weight * u.z[s, c]
        u.expected[c] = y[j, c]
        for s in range(points):
            u.z[s, c] -= y[j, c]
        for k in range(n):
            total = of_centre * (u.points[0, k] - x[j, k]) * u.z[0, c]
            for s in range(1, points):
                total += weight * (u.points[s, k] - x[j, k]) * u.z[s, c]
            u.Pxz[c, k] = total
        for q in range(c + 1):
            total = of_centre * u.z[0, c] * u.z[0, q]
            for s in range(1, points):
                total += weight * u.z[s, c] * u.z[s, q]
            u.Pzz[c, q] = total
            u.Pzz[q, c] = total
    log_density, nis, product = 0.0, 0.0, 1.0
    for c in range(3):
        seen[j, c] = np.nan
        if z[row, c] != z[row, c] or c == failed:
            continue
        e = z[row, c] - u.expected[c]
        change = tune.timing * (y[j, c] - last_y[j, c]) if last_y[j, c] == last_y[j, c] else 0.0
        S = b.noise[c] + change * change + u.Pzz[c, c]
        seen[j, c], spread[j, c] = e, S
        product *= S
        log_density -= tr.LOG_2PI
        if tr.glitch(j, S, e, c, glitches, tune.glitch, tune.glitch_samples):
            nis += tune.glitch * tune.glitch
            continue
        nis += e * e / S
        for k in range(n):
            gain = u.Pxz[c, k] / S
            x[j, k] += gain * e
            for q in range(k + 1):
                P[j, k, q] -= gain * u.Pxz[c, q]
                P[j, q, k] = P[j, k, q]
        for r in range(3):
            u.column[r] = u.Pzz[r, c]
        for r in range(3):
            if r == c:
                continue
            gain = u.column[r] / S
            u.expected[r] += gain * e
            for k in range(n):
                u.Pxz[r, k] -= gain * u.Pxz[c, k]
            for q in range(3):
                u.Pzz[r, q] -= gain * u.column[q]
    log_density = 0.5 * (log_density - nis - math.log(product))
    if failed >= 0 and z[row, failed] == z[row, failed]:
        change = (
            tune.timing * (y[j, failed] - last_y[j, failed])
            if last_y[j, failed] == last_y[j, failed]
            else 0.0
        )
        before = previous[failed] if previous[failed] == previous[failed] else np.inf
        sigma = math.sqrt(b.noise[failed] + change * change)
        log_density += tr.failed_channel(
            j, z[row, failed], before, u.expected[failed], u.Pzz[failed, failed], sigma, bias, tune.failed
        )
    return log_density, nis
