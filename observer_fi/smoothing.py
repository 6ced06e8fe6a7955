"""States of one hypothesis given the whole log: a filter forward, then the smoother of Rauch, Tung and Striebel back."""

import numpy as np

from observer_fi import kernels
from observer_fi import transition as tr
from observer_fi.compiled import uncounted
from observer_fi.feed import CommandStream, LogStream
from observer_fi.hypotheses import Hypothesis, arrays
from observer_fi.models import Rig
from observer_fi.records import Array, Log
from observer_fi.settings import BankSettings


def smooth(log: Log, hypothesis: Hypothesis, rig: Rig, settings: BankSettings) -> tuple[Array, Array]:
    """Smoothed states (n, k) and covariances (n, k, k) of a hypothesis of k states at the n samples of a log, SI units.

    Keeps three matrices a sample: 1.2 kB for seven states. Source: Rauch, Tung and Striebel (1965).
    """
    b = arrays((hypothesis,), rig, settings)
    stream = CommandStream(rig.model, settings.substep_s)
    log, own = LogStream().take(log)
    w_cmd, interval = stream.intervals(log.t, log.w_cmd)
    state = kernels.start((hypothesis,), b, kernels.first_readings(log.z), w_cmd[0])
    n, k = log.t.size, len(hypothesis.states)
    x, P = np.empty((n, k)), np.empty((n, k, k))
    ahead, P_ahead, cross = np.empty((n, k)), np.empty((n, k, k)), np.empty((n, k, k))
    _forward(
        b, kernels.tuning(settings), state, kernels.scratch(b), log.t, interval, w_cmd, log.pitch, log.z,
        np.zeros((3, k)), np.zeros((4, k)), x, P, ahead, P_ahead, cross,
    )  # fmt: skip
    _backward(x, P, ahead, P_ahead, cross, np.empty((2, k, k)), np.empty(k))
    return x[own], P[own]


@uncounted
def _forward(b, tune, state, scr, t, interval, w_cmd, theta, z, g, F, x, P, ahead, P_ahead, cross):
    """Filtered states x (n, k), P (n, k, k); the predictions before them, ahead and P_ahead; cross (n, k, k) the covariance
    of the filtered state before and the predicted one, P F'. g (3, k), F (4, k): scratch.
    """
    n, at_d = b.layout[0, tr.SIZE], b.layout[0, tr.AT_D]
    for row in range(t.size):
        if row > 0:
            for k in range(n):
                for q in range(n):
                    cross[row, k, q] = state.P[0, k, q]
            dt = min(t[row] - t[row - 1], tune.longest)
            tr.load_parameters(0, state.x, b.layout, b.parameters, scr.p[0])
            tr.slopes(
                0, state.x, b.layout, state.slow, interval[row, 0], theta[row], scr.p[0], b.parameters, g
            )
            resting = kernels._predict(
                0, b, scr.p[0], state.x, state.P, state.x, state.P, state.slow, dt, interval, row, w_cmd[row], theta[row],
                tune, scr.g[0], scr.work,
            )  # fmt: skip
            kernels.mirror(0, n, state.P)
            tr.transition(0, b.layout, g, dt, resting, F)
            for k in range(n):
                for r in range(4 if at_d >= 0 else 3):
                    total = 0.0
                    for q in range(n):
                        total += P[row - 1, k, q] * F[r, q]
                    cross[row, k, r if r < 3 else at_d] = total
        for k in range(n):
            ahead[row, k] = state.x[0, k]
            for q in range(n):
                P_ahead[row, k, q] = state.P[0, k, q]
        kernels._update(
            0, b, scr.p[0], state.x, state.P, state.slow, state.bias, z, row, state.z, state.predicted, state.glitches,
            w_cmd[row], tune, scr.y, scr.H, scr.seen, scr.spread, scr.work,
        )  # fmt: skip
        kernels.mirror(0, n, state.P)
        for c in range(3):
            state.predicted[0, c] = scr.y[0, c]
            if z[row, c] == z[row, c]:
                state.z[c] = z[row, c]
        for k in range(n):
            x[row, k] = state.x[0, k]
            for q in range(n):
                P[row, k, q] = state.P[0, k, q]


@uncounted
def _backward(x, P, ahead, P_ahead, cross, work, off):
    """Smoothed in place of filtered x, P. work (2, k, k), off (k,): scratch."""
    n = x.shape[1]
    L, gain = work[0], work[1]
    for row in range(x.shape[0] - 2, -1, -1):
        tr.factor(row + 1, P_ahead, n, L)
        for k in range(n):  # gain = cross / P_ahead, a row at a time
            for q in range(n):
                total = cross[row + 1, k, q]
                for r in range(q):
                    total -= L[q, r] * gain[k, r]
                gain[k, q] = total / L[q, q]
            for q in range(n - 1, -1, -1):
                total = gain[k, q]
                for r in range(q + 1, n):
                    total -= L[r, q] * gain[k, r]
                gain[k, q] = total / L[q, q]
        for k in range(n):
            off[k] = x[row + 1, k] - ahead[row + 1, k]
        for k in range(n):
            for q in range(n):
                x[row, k] += gain[k, q] * off[q]
        for k in range(n):
            for q in range(n):  # L holds gain (P_smoothed - P_ahead) from here on
                total = 0.0
                for r in range(n):
                    total += gain[k, r] * (P[row + 1, r, q] - P_ahead[row + 1, r, q])
                L[k, q] = total
        for k in range(n):
            for q in range(k + 1):
                total = P[row, k, q]
                for r in range(n):
                    total += L[k, r] * gain[q, r]
                P[row, k, q] = total
                P[row, q, k] = total
