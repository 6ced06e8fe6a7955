"""Interacting multiple models, compiled: what hypotheses give each other before a step, and their probabilities after it.

Source: Blom and Bar-Shalom (1988). Two hypotheses mix only the states they share; a state that the source lacks comes
from the entry prior. Probabilities live in logs where they are compared. Hypotheses stand side by side (`bank_rows.py`).
"""

import math

from observer_fi.bank import transition as tr
from observer_fi.numerics import exp, inlined, maximum, where_above, zeros_like

NEGLIGIBLE = 1e-12  # mixing weight below which a hypothesis receives nothing from another
UNREACHED = 1e-300  # least probability: a hypothesis that no rate leads to has no 0 / 0 when mixed


@inlined
def _chain(b, tune, scr, dt, stopped):
    """Transition matrix for a sample of dt [s], into scr.M; the first of a move mends what is broken."""
    new = abs(dt - scr.mixed[0]) > 1e-9 * dt
    if new:
        tr.mode_transition(b.rates, dt, scr.chain, scr.square)
    if new or stopped:
        M = scr.chain
        if stopped:
            M = scr.square[2]
            tr.renewed(scr.chain, tune.mended, M)
        for i in range(b.m):
            for row in range(len(b.wide)):
                scr.M[i, row] = M[i, row if row < b.m else 0]
        scr.mixed[0] = -1.0 if stopped else dt


@inlined
def _weigh(b, r, mu):
    """Mixing weights into r.weights; returns who stays, and what comes from others, both rows."""
    reached = r.M[0] * mu[0, 0]
    for i in range(1, b.m):
        reached = reached + r.M[i] * mu[0, i]
    r.reached[0] = reached
    per_reached, own, others = 1.0 / reached, zeros_like(reached), zeros_like(reached)
    for i in range(b.m):
        weight = r.M[i] * mu[0, i] * per_reached
        weight = where_above(weight, NEGLIGIBLE, weight, 0.0)
        r.weights[i] = weight
        own = own + r.itself[i] * weight
        others = others + (weight - r.itself[i] * weight)
    return own, others


@inlined
def _mix_common(b, r, from_x, from_P):
    """Means and covariances of the states that several hypotheses have. from_x, from_P: r.x and r.P as arrays of numbers."""
    for k in range(b.common):
        mean, lacking, entry = zeros_like(r.entry_mean[k]), zeros_like(r.entry_mean[k]), r.entry_mean[k]
        for i in range(len(b.wide)):
            mean = mean + r.weights[i] * (entry * b.lacks[i, k] + from_x[k, i] * (1.0 - b.lacks[i, k]))
            lacking = lacking + r.weights[i] * b.lacks[i, k]
        mean = where_above(r.holds[k], 0.5, mean, entry)
        r.to_x[k] = mean
        for i in range(len(b.wide)):
            off = (entry * b.lacks[i, k] + from_x[k, i] * (1.0 - b.lacks[i, k])) - mean
            r.off[k, i], r.heavy[i] = off, r.weights[i] * off
        for q in range(k + 1):
            total = zeros_like(mean)
            for i in range(len(b.wide)):
                total = total + (r.weights[i] * from_P[q, k, i] + r.heavy[i] * r.off[q, i])
            r.to_P[q, k] = total * (r.holds[k] * r.holds[q])
        r.to_P[k, k] = r.to_P[k, k] + r.holds[k] * (lacking * r.entry_var[k])


@inlined
def _mix_own(b, r, x, P, own, others):
    """As `_mix_common`, of states that only one hypothesis has: others enter them at the prior."""
    for k in range(b.common, b.n):
        entry = r.entry_mean[k]
        mean, beyond = own * x[k] + others * entry, x[k] - entry
        r.to_x[k] = mean
        for q in range(b.common):
            r.to_P[q, k] = own * (P[q, k] + (x[q] - r.to_x[q]) * beyond)
        for q in range(b.common, k + 1):
            stays = P[q, k] + (x[q] - r.to_x[q]) * (x[k] - mean)
            enters = (r.entry_mean[q] - r.to_x[q]) * (entry - mean)
            r.to_P[q, k] = own * stays + others * enters
        r.to_P[k, k] = r.to_P[k, k] + others * r.entry_var[k]


@inlined
def _mix_carried(b, r, slow):
    """What the means carry, as the means themselves. slow: r.slow as an array of numbers."""
    for k in range(b.carried):
        mean = zeros_like(r.weights[0])
        for i in range(len(b.wide)):
            mean = mean + r.weights[i] * slow[k, i]
        r.slow[k] = mean


@inlined
def mix(b, tune, scr, r, state, dt, stopped):
    """Moments of every hypothesis before the step, from the memory into r.to_x, r.to_P; its biases and r.slow in place.

    r: rows of memory, scratch and bank; r.reached gets the predicted mode probabilities. stopped: a move begins.
    """
    _chain(b, tune, scr, dt, stopped)
    own, others = _weigh(b, r, state.mu)
    _mix_common(b, r, state.x, state.P)
    _mix_own(b, r, r.x, r.P, own, others)
    if b.mixed:
        _mix_carried(b, r, state.slow)
    if b.failing:
        mean = own * r.bias[0]
        off, left = r.bias[0] - mean, 1.0 - own
        entered = mean * mean + tune.bias_entry * tune.bias_entry * r.failed_noise[0]
        r.bias[0], r.bias[1] = mean, own * (off * off + r.bias[1]) + left * entered


@inlined
def posterior(b, state, scr, r):
    """Mode probabilities from the predicted ones and the densities, into r.mu.

    Densities are taken relative to the largest, in logs: of two hypotheses that both explain nothing, -742 still beats
    -821.
    """
    top = -math.inf
    for j in range(b.m):
        top = max(top, scr.density[0, j])
    share = exp(r.density[0] - top) * r.reached[0]
    r.mu[0] = share
    total = 0.0
    for j in range(b.m):
        total += state.mu[0, j]
    r.mu[0] = maximum(share * (1.0 / total), UNREACHED)
