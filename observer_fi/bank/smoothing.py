"""States of one hypothesis given the whole log: a filter forward, then the smoother of Rauch, Tung and Striebel back."""

import numpy as np

from observer_fi.bank import ekf as extended
from observer_fi.bank import transition as tr
from observer_fi.bank.bank_state import remembered
from observer_fi.bank.first_state import first_readings, start
from observer_fi.bank.hypotheses import Hypothesis, arrays
from observer_fi.bank.log_feed import CommandStream, LogStream
from observer_fi.bank.packing import bank_rows, tuning
from observer_fi.bank.ukf import factor
from observer_fi.bank.work_arrays import rows_of, scratch
from observer_fi.numerics import inlined, uncounted
from observer_fi.physics import Rig
from observer_fi.records import Array, Log
from observer_fi.settings import BankSettings


def smooth(log: Log, hypothesis: Hypothesis, rig: Rig, settings: BankSettings) -> tuple[Array, Array]:
    """Smoothed states (n, k) and covariances (n, k, k) of a hypothesis of k states at the n samples of a log, SI units.

    Keeps three matrices a sample: 1.2 kB for seven states. Source: Rauch, Tung and Striebel (1965).
    """
    own_arrays = arrays((hypothesis,), rig, settings)
    b = bank_rows((hypothesis,), own_arrays)
    log, own = LogStream().take(log)
    w_cmd, interval = CommandStream(rig.model, settings.substep_s).intervals(log.t, log.w_cmd)
    first = start((hypothesis,), own_arrays, first_readings(log.z), w_cmd[0])
    n, k = log.t.size, len(hypothesis.states)
    x, P = np.empty((n, k)), np.empty((n, k, k))
    ahead, P_ahead, cross = np.empty((n, k)), np.empty((n, k, k)), np.empty((n, k, k))
    _forward(
        b, tuning(settings), remembered(b, first), scratch(b), log.t, interval, w_cmd, log.pitch, log.z,
        x, P, ahead, P_ahead, cross,
    )  # fmt: skip
    _backward(x, P, ahead, P_ahead, cross, np.empty((2, k, k)), np.empty(k))
    order = b.places[0]
    return x[own][:, order], P[own][:, order[:, None], order]


@inlined
def _note(b, state, row, x, P):
    """The moments of the first hypothesis, into row `row` of x (n, k), P (n, k, k)."""
    for k in range(b.n):
        x[row, k] = state.x[k, 0]
        for q in range(b.n):
            P[row, k, q] = state.P[min(k, q), max(k, q), 0]


@uncounted
def _forward(b, tune, state, scr, t, interval, w_cmd, theta, z, x, P, ahead, P_ahead, cross):
    """Filtered states x (n, k), P (n, k, k); the predictions before them, ahead and P_ahead; cross (n, k, k) the covariance
    of the filtered state before and the predicted one, P F'.
    """
    r, at_d = rows_of(b, state, scr), b.at[tr.AT_D]
    for row in range(t.size):
        if row > 0:
            dt = min(t[row] - t[row - 1], tune.longest)
            carried = extended.predict(b, tune, r, r.x, r.P, dt, interval, row, w_cmd[row], theta[row])
            (
                r.T[0, 0],
                r.T[0, 1],
                r.T[0, 2],
                r.T[1, 0],
                r.T[1, 1],
                r.T[1, 2],
                r.T[2, 0],
                r.T[2, 1],
                r.T[2, 2],
            ) = carried
            for k in range(b.n):
                for q in range(b.n):
                    cross[row, k, q] = scr.T[q, k, 0] if q < 3 else P[row - 1, k, q]
                if at_d >= 0:  # it moves with x
                    cross[row, k, at_d] += scr.T[2, k, 0] - P[row - 1, k, 2]
        elif b.n > 3:
            tr.load_parameters(r.x, b.at, r.has, r.parameters, r.p)
        _note(b, state, row, ahead, P_ahead)
        extended.update(b, tune, r, z, row, state.z, w_cmd[row])
        for c in range(3):
            r.predicted[c] = r.y[c]
            if z[row, c] == z[row, c]:
                state.z[c] = z[row, c]
        _note(b, state, row, x, P)


@uncounted
def _backward(x, P, ahead, P_ahead, cross, work, off):
    """Smoothed in place of filtered x, P. work (2, k, k), off (k,): scratch."""
    n = x.shape[1]
    L, gain = work[0], work[1]
    for row in range(x.shape[0] - 2, -1, -1):
        factor(P_ahead[row + 1], n, L)
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
