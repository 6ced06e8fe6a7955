"""A Kalman filter around a simulated motion with one disturbance as a fourth state, forward and back, compiled.

States: deviations of w [rad/s], I [rad], x [m] from the simulated motion, and the disturbance in its unit. Readings are
deviations too. Several series run through one filter: its gains do not depend on them.
"""

import math

import numpy as np

from observer_fi.numerics import compiled, inlined

STATES = 4


@inlined
def _transition(k, F, held, G, begins, keep, f):
    """Matrix of the step that ends at row k, into f (4, 4)."""
    f[:] = 0.0
    f[3, 3] = keep
    if begins[k] != 0:
        return
    j = k - 1
    f[1, 1], f[2, 2], f[1, 3], f[2, 3] = 1.0, 1.0, G[j, 1], G[j, 2]
    if not held[j]:
        f[0, 0], f[0, 1], f[0, 2], f[0, 3] = F[j, 0], F[j, 1], F[j, 2], G[j, 0]
        f[1, 0], f[1, 1], f[2, 0], f[2, 1] = F[j, 3], F[j, 4], F[j, 5], F[j, 6]


@inlined
def _product(A, B, transposed, out):
    for r in range(STATES):
        for c in range(STATES):
            total = 0.0
            for q in range(STATES):
                total += A[r, q] * (B[c, q] if transposed else B[q, c])
            out[r, c] = total


@inlined
def _slopes(k, c, H, S):
    """Slopes of channel c at row k by the four states."""
    if c == 2:
        return H[k, 4], 0.0, H[k, 5], S[k, 2]
    return H[k, 2 * c], H[k, 2 * c + 1], 0.0, S[k, c]


@inlined
def _see(y, h, R, M, P, products, w):
    """Update by one reading y (1 + k,), its slopes h by the states, its variance R; the variance of its innovation.

    y becomes the innovations over their standard deviation, w (4,) what each state has in common with them.
    """
    for r in range(STATES):
        w[r] = h[0] * P[r, 0] + h[1] * P[r, 1] + h[2] * P[r, 2] + h[3] * P[r, 3]
    V = R + h[0] * w[0] + h[1] * w[1] + h[2] * w[2] + h[3] * w[3]
    root = 1.0 / math.sqrt(V)
    for q in range(y.size):
        y[q] = (y[q] - h[0] * M[0, q] - h[1] * M[1, q] - h[2] * M[2, q] - h[3] * M[3, q]) * root
    for r in range(STATES):
        w[r] *= root
        for q in range(y.size):
            M[r, q] += w[r] * y[q]
    for r in range(STATES):
        for q in range(STATES):
            P[r, q] -= w[r] * w[q]
    for r in range(y.size):
        for q in range(r + 1):
            products[r, q] += y[r] * y[q]
    return V


@compiled
def forward(
    F, held, H, G, S, y, variance, since, begins, start, start_var, kick, caught, square, memory, products,
    seen, ahead, M, work,
):  # fmt: skip
    """Filter over N rows: the sum of log(variance of an innovation / noise).

    F, held, H, G, S: see `perturbation.Linear`, G, S (N, 3) of one disturbance; y to caught: see `diffusion.Series`. square:
    variance of the disturbance, memory [s]. products (1 + k, 1 + k): lower half of the products of innovations over their
    variance. Where they have N rows: seen (N, 3, 6) innovation, its deviation, and w of `_see`; ahead (N, 4, 5) predicted
    mean and covariance. M (4, 1 + k), work (3, 4, 4): scratch, zero.
    """
    P, f, T = work[0], work[1], work[2]
    columns, kept = y.shape[2], seen.shape[0] > 1
    before, e, w = np.zeros(STATES), np.zeros(columns), np.zeros(STATES)
    log_det, move = 0.0, -1
    for k in range(since.size):
        keep = math.exp(-since[k] / memory) if begins[k] != 2 else 0.0
        _transition(k, F, held, G, begins, keep, f)
        for q in range(columns):
            for r in range(STATES):
                before[r] = M[r, q]
            for r in range(STATES):
                M[r, q] = (
                    f[r, 0] * before[0] + f[r, 1] * before[1] + f[r, 2] * before[2] + f[r, 3] * before[3]
                )
        _product(f, P, False, T)
        _product(T, f, True, P)
        P[3, 3] += square * (1.0 - keep * keep)
        if begins[k] != 0:
            move += 1
            for r in range(2):
                P[1 + r, 1 + r] += start_var[move, r]
                M[1 + r, 0] += start[move, r]
        P[0, 0] += kick[k]
        P[1, 1] += caught[k]
        if kept:
            ahead[k, :, 0], ahead[k, :, 1:] = M[:, 0], P
        for c in range(3):
            if variance[k, c] < np.inf:
                for q in range(columns):
                    e[q] = y[k, c, q]
                V = _see(e, _slopes(k, c, H, S), variance[k, c], M, P, products, w)
                log_det += math.log(V / variance[k, c])
                if kept:
                    seen[k, c, 0], seen[k, c, 1], seen[k, c, 2:] = e[0], math.sqrt(V), w
    return log_det


@inlined
def _unsee(h, one, pull, L, T):
    """What a reading said, put into the adjoint pull (4,) and its matrix L (4, 4). one (6,): a row of `seen`."""
    e, deviation = one[0], one[1]
    total = 0.0
    for r in range(STATES):
        total += one[2 + r] * pull[r]
    for r in range(STATES):
        pull[r] -= h[r] * (total + e) / deviation
    for r in range(STATES):  # T = L (1 - w h' / deviation)
        total = 0.0
        for q in range(STATES):
            total += L[r, q] * one[2 + q]
        for q in range(STATES):
            T[r, q] = L[r, q] - total * h[q] / deviation
    for q in range(STATES):  # L = (1 - w h' / deviation)' T + h h' / deviation^2
        total = 0.0
        for r in range(STATES):
            total += one[2 + r] * T[r, q]
        for r in range(STATES):
            L[r, q] = T[r, q] - h[r] * total / deviation + h[r] * h[q] / (deviation * deviation)


@compiled
def back(F, held, H, G, S, variance, since, begins, memory, seen, ahead, out, work):
    """Mean and variance of the disturbance given all rows, into out (N, 2). work (3, 4, 4): scratch, zero.

    The smoother of Bryson and Frazier (Bierman 1973): covariances are never inverted, and here they are singular, since
    speed and integral follow from the disturbance alone a while after a start.
    """
    L, f, T = work[0], work[1], work[2]
    pull, before, h = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    for k in range(since.size - 1, -1, -1):
        for c in range(2, -1, -1):
            if variance[k, c] < np.inf:
                h[0], h[1], h[2], h[3] = _slopes(k, c, H, S)
                _unsee(h, seen[k, c], pull, L, T)
        mean, var = ahead[k, 3, 0], ahead[k, 3, 4]
        for r in range(STATES):
            mean -= ahead[k, 3, 1 + r] * pull[r]
            for q in range(STATES):
                var -= ahead[k, 3, 1 + r] * L[r, q] * ahead[k, 3, 1 + q]
        out[k, 0], out[k, 1] = mean, var
        keep = math.exp(-since[k] / memory) if begins[k] != 2 else 0.0
        _transition(k, F, held, G, begins, keep, f)
        for r in range(STATES):
            before[r] = pull[r]
        for r in range(STATES):
            pull[r] = f[0, r] * before[0] + f[1, r] * before[1] + f[2, r] * before[2] + f[3, r] * before[3]
        _product(L, f, False, T)
        for r in range(STATES):
            for q in range(STATES):
                total = 0.0
                for m in range(STATES):
                    total += f[m, r] * T[m, q]
                L[r, q] = total
