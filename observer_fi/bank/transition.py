"""One sample of one hypothesis: the mean a step on, its Jacobian, the channels it predicts.

Both engines (`filterpy_bank.py` and `compiled_bank.py`) call these functions; nothing else knows how the states of a
hypothesis enter the plant of `physics/plant.py`.

Functions of numbers take rows of them as well (`numerics/rows.py`): the hypotheses of a bank, or several logs, side by side.
A state x, its parameters p, `base` without the factors in the state and slopes g are then arrays of rows.

A state vector starts with w [rad/s], I [rad], x [m]; the rest is given by `kinds`, one code a state: D_STATE the
indentation of a stop [m], TORQUE and RATE the free disturbances of "none of these" [N m, m/s], and
SCALE + k a factor on parameter k of the equations, 1 in the mean.

The trajectory of the mean carries states that have no variance (`Carried`), in arrays `slow`.
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi.numerics import any_of_rare, exp, inlined, log, sqrt, where_above, zeros_like
from observer_fi.physics import Model, linear, plant
from observer_fi.physics import equations as a
from observer_fi.records import Array

W_STATE, I_STATE, X_STATE, D_STATE, TORQUE, RATE = range(6)
SCALE = 16
# (rad/s)^2, of a motor that friction holds, and of one that it holds against a command: the moment at which it breaks away is as
# uncertain as the friction, and what a filter does not doubt of its speed it makes a wrong friction of.
REST_VARIANCE, HELD_VARIANCE = 1e-6, 9.0
SIXTH = 1.0 / 6.0


class Carried(NamedTuple):
    """What the mean carries besides the states that a hypothesis estimates.

    inner, slow: see `plant.py`. low, high: least and most that the screw may be ahead of the mass in the play [m].
    trail: how far the position sensor's lag is behind [m]; late_x [m], late_V [V]: what has not come through the delays.
    """

    inner: plant.Inner
    slow: plant.Slow
    low: Array
    high: Array
    trail: Array
    late_x: Array
    late_V: Array


_NAMES = (*plant.Inner._fields, *plant.Slow._fields, *Carried._fields[2:])  # as an array has them
SLOW = len(_NAMES)
PHI, LAGGED, LOW, HIGH, TRAIL, LATE_X, LATE_V = (
    _NAMES.index(name) for name in ("phi", "c", "low", "high", "trail", "late_x", "late_V")
)
CELLS = 32  # a delay is told in as many parts


def parameters_of(model: Model) -> Array:
    """(VECTOR_SIZE,) what the equations take in a bank: the delay of a sampled servo is left to the doubt in its timing."""
    p = model.vector
    p[a.SERVO_DELAY] = 0.0
    return p


def slow_size(p: Array) -> int:
    """Numbers that the mean of a model p carries: `Carried`, and the changes that are on their way through its delays."""
    return SLOW + (2 * (CELLS + 2) if p[a.VOLTAGE_DELAY] > 0.0 or p[a.POSITION_DELAY] > 0.0 else 0)


def slow_at_rest(p: Array) -> Array:
    """(slow_size,) what a mean carries that begins: where in the play the screw is, nobody knows."""
    slow = np.zeros(slow_size(p))
    slow[LOW], slow[HIGH] = -0.5 * p[a.BACKLASH], 0.5 * p[a.BACKLASH]
    return slow


def delays(p: Array) -> Array:
    """(2,) delays of the voltage and the position sensor [s]."""
    return np.array([p[a.VOLTAGE_DELAY], p[a.POSITION_DELAY]])


# A layout (LAYOUT,) says where in the state each kind stands: an index per kind, or -1. Beside it stands `has`
# (LAYOUT,), 1.0 where there is such a state: in rows, hypotheses of other states may use the same place.
AT_D, AT_TORQUE, AT_SUPPLY, AT_RATE, AT_A, AT_B, AT_LOOSE, AT_C, AT_E, AT_J, AT_LOOSE_J = range(11)
LAYOUT = 11
_LOOKED_UP = {
    AT_D: D_STATE, AT_TORQUE: TORQUE, AT_SUPPLY: SCALE + a.VMAX, AT_RATE: RATE, AT_A: SCALE + a.A, AT_B: SCALE + a.B,
    AT_LOOSE: SCALE + a.A_DECOUPLED, AT_C: SCALE + a.C, AT_E: SCALE + a.E, AT_J: SCALE + a.J,
    AT_LOOSE_J: SCALE + a.J_DECOUPLED,
}  # fmt: skip


def layout(kinds: np.ndarray) -> np.ndarray:
    """Where each kind of state stands, (LAYOUT,) integers, for the state codes kinds (n,)."""
    out = np.full(LAYOUT, -1)
    for slot, kind in _LOOKED_UP.items():
        found = np.flatnonzero(kinds == kind)
        if found.size:
            out[slot] = found[0]
    return out


@inlined
def state_or(x, at, has, kind, otherwise):
    """The state of this kind, `otherwise` where there is none."""
    return where_above(has[kind], 0.5, x[max(at[kind], 0)], otherwise)


@inlined
def held_variance(command):
    """Variance of the speed of a motor that friction holds at this command [rad/s]."""
    return where_above(abs(command), 0.0, HELD_VARIANCE, REST_VARIANCE)


@inlined
def load_parameters(x, at, has, base, p):
    """Parameters into p (VECTOR_SIZE,): those of `base` that a state may stand for, times their factors."""
    p[a.A] = base[a.A] * state_or(x, at, has, AT_A, 1.0)
    p[a.B] = base[a.B] * state_or(x, at, has, AT_B, 1.0)
    p[a.A_DECOUPLED] = base[a.A_DECOUPLED] * state_or(x, at, has, AT_LOOSE, 1.0)
    p[a.C] = base[a.C] * state_or(x, at, has, AT_C, 1.0)
    p[a.E] = base[a.E] * state_or(x, at, has, AT_E, 1.0)
    p[a.VMAX] = base[a.VMAX] * state_or(x, at, has, AT_SUPPLY, 1.0)
    factor = state_or(x, at, has, AT_J, 1.0)
    p[a.J] = base[a.J] * factor
    p[a.J_DECOUPLED] = base[a.J_DECOUPLED] * factor * state_or(x, at, has, AT_LOOSE_J, 1.0)


@inlined
def carried_in(slow):
    """`Carried` of an array (SLOW or more,)."""
    inner, rest = plant.inner_in(slow, 0), plant.slow_in(slow, plant.INNER)
    return Carried(inner, rest, slow[LOW], slow[HIGH], slow[TRAIL], slow[LATE_X], slow[LATE_V])


@inlined
def carry_into(slow, c):
    """`Carried` into an array (SLOW or more,)."""
    plant.inner_into(slow, 0, c.inner)
    plant.slow_into(slow, plant.INNER, c.slow)
    slow[LOW], slow[HIGH], slow[TRAIL] = c.low, c.high, c.trail
    slow[LATE_X], slow[LATE_V] = c.late_x, c.late_V


@inlined
def advance(w, I, pos, d, torque, rate, c, t, now, interval, row, last, theta, p):
    """Mean a sample later: w, I, x, d; `Carried`; 1 where the motor rests at the end, else 0; the share of the screw's travel
    that the mass made.

    c: `Carried` before. t: time step [s], in as many steps as half of the columns of `interval` (rows, 2 steps): command at the
    half-steps in its row `row`, `last` at the end [rad/s]. now: time at the end on the log's clock [s].
    """
    steps, rests, grip = interval.shape[1] // 2, zeros_like(w), 1.0 + zeros_like(w)
    m, slow, free = plant.Motion(w, I, pos, d, c.inner), c.slow, plant.Free(torque, rate)
    step = t * (1.0 / steps)
    for k in range(steps):
        first, middle = interval[row, 2 * k], interval[row, 2 * k + 1]
        end = interval[row, 2 * k + 2] if k + 1 < steps else last
        mean = (first + 4.0 * middle + end) * SIXTH
        u = plant.Command(first, mean, end, first, mean, end)
        m, rests = plant.step(plant.midpoint, m, slow, step, u, theta, free, p)
        if any_of_rare(p[a.EXTENDED]):
            i = plant.motor_current(m.w, m.I, m.inner.c, slow, end, zeros_like(w), 0.0, p)
            slow = plant.settled(slow, i, step, now, p)
    x, d1 = m.x, m.d
    c = Carried(m.inner, slow, c.low, c.high, c.trail, c.late_x, c.late_V)
    if any_of_rare(p[a.EXTENDED]):
        c, x, grip = _behind_play(c, pos, x, t, p)
        d1 = d + grip * (d1 - d)
    return (m.w, m.I, x, d1), c, rests, grip


@inlined
def _behind_play(c, before, screw, t, p):
    """`Carried` after the screw moved from `before` to `screw` in a time t; where the mass is then, and its share of the travel.

    Where in the play the screw is may be unknown: the mass moves by the mean of the two extremes.
    """
    travel = screw - before
    low, high, moved, grip = c.low, c.high, travel, 1.0 + zeros_like(travel)
    if any_of_rare(p[a.BACKLASH]):
        low, high = plant.in_play(c.low + travel, p), plant.in_play(c.high + travel, p)
        moved = travel - 0.5 * ((low - c.low) + (high - c.high))
        grip = where_above(abs(travel), 0.0, moved / where_above(abs(travel), 0.0, travel, 1.0), 1.0)
    trail = c.trail
    if any_of_rare(p[a.POSITION_LAG]):
        lag = p[a.POSITION_LAG]
        trail = where_above(lag, 0.0, plant.lag_behind(trail, moved, t, where_above(lag, 0.0, lag, 1.0)), 0.0)
    after = Carried(c.inner, c.slow, low, high, trail, c.late_x, c.late_V)
    return after, before + moved, grip


@inlined
def play_doubt(before, after):
    """Variance that a step adds to the position while the place of the screw in the play is unknown [m^2].

    before, after: how far apart the extremes of that place are. What they lose in a step is one unknown share for all steps,
    so that the doubts add up straight: hence twice the loss, not half.
    """
    change = 2.0 * (before - after)
    return change * change


@inlined
def propagate(x, at, has, slow, t, now, interval, row, last, theta, p):
    """As `advance`, with x (n,) and slow (SLOW or more,) overwritten: 1 where the motor rests at the end, share of the travel."""
    (x[0], x[1], x[2], d), c, rests, grip = advance(
        x[0], x[1], x[2], state_or(x, at, has, AT_D, 0.0), state_or(x, at, has, AT_TORQUE, 0.0), state_or(x, at, has,
        AT_RATE, 0.0),
        carried_in(slow), t, now, interval, row, last, theta, p,
    )  # fmt: skip
    carry_into(slow, c)
    if at[AT_D] >= 0:
        x[at[AT_D]] = where_above(has[AT_D], 0.5, d, x[at[AT_D]])
    return rests, grip


@inlined
def changed(z, row, previous, meanwhile):
    """Squares of what current [A] and voltage [V] changed from the readings `previous` (3,) to row `row` of z (n, 3).

    That of a voltage that is missing is 0, that of a current, or where nobody asks (meanwhile 0), infinite.
    """
    di, dV = z[row, 1] - previous[1], z[row, 0] - previous[0]
    if not meanwhile > 0.0 or di != di:
        return math.inf, math.inf
    return di * di, dV * dV if dV == dV else 0.0


@inlined
def grown_current(growth, seen, noise, p):
    """Variance that I gains in a step of an unknown servo: `growth`, and no more than what readings saw it change.

    seen: of `changed`; noise: variance of the current's readings [A^2]. A motor that turns steadily is driven steadily, and its
    start may be anything: one diffusion for both would leave the steady motion without a word.
    """
    of_V = seen[1] / (p[a.RM] * p[a.RM])
    most = (where_above(of_V, seen[0], of_V, seen[0]) + noise) / (p[a.KI] * p[a.KI]) + LEAST * growth
    return where_above(growth, most, most, growth)


@inlined
def _set_slope(g, row, at, has, kind, slope):
    g[row, at[kind]] = where_above(has[kind], 0.5, slope, g[row, at[kind]])


@inlined
def constant_slopes(x, at, has, w, d, i, di_dV, load, per_J, theta, p, base, g):
    """Slopes of dw/dt and dx/dt by the states behind w, I, x, into rows 0 and 1 of g (2, n); what no state has is left alone.

    p: parameters with the factors in x, base: without.
    """
    s = where_above(w, 0.0, 1.0, -1.0)
    if at[AT_SUPPLY] >= 0:
        _set_slope(g, 0, at, has, AT_SUPPLY, p[a.KM] * di_dV * base[a.VMAX] * per_J)
    if at[AT_A] >= 0:
        _set_slope(g, 0, at, has, AT_A, -p[a.COUPLING] * s * base[a.A] * per_J)
    if at[AT_B] >= 0:
        _set_slope(g, 0, at, has, AT_B, -p[a.COUPLING] * base[a.B] * theta * per_J)
    if at[AT_LOOSE] >= 0:
        _set_slope(g, 0, at, has, AT_LOOSE, -(1.0 - p[a.COUPLING]) * s * base[a.A_DECOUPLED] * per_J)
    if at[AT_J] >= 0:
        _set_slope(g, 0, at, has, AT_J, -(p[a.KM] * i - load) * per_J / state_or(x, at, has, AT_J, 1.0))
    if at[AT_LOOSE_J] >= 0:
        slope = -(1.0 - p[a.COUPLING]) * (p[a.KM] * i - load) * per_J
        _set_slope(g, 0, at, has, AT_LOOSE_J, slope / state_or(x, at, has, AT_LOOSE_J, 1.0))
    if at[AT_D] >= 0:
        _set_slope(g, 0, at, has, AT_D, -a.stop_stiffness(d, p) * per_J)
    if at[AT_C] >= 0:
        _set_slope(g, 0, at, has, AT_C, -a.stop_torque(w, d, p) * per_J / state_or(x, at, has, AT_C, 1.0))
    if at[AT_E] >= 0:
        _set_slope(g, 1, at, has, AT_E, -p[a.COUPLING] * p[a.D] * w * base[a.E])
    if at[AT_TORQUE] >= 0:
        _set_slope(g, 0, at, has, AT_TORQUE, -(1.0 + p[a.RUBBING] * (s - 1.0)) * per_J)
    if at[AT_RATE] >= 0:
        _set_slope(g, 1, at, has, AT_RATE, 1.0 + zeros_like(w))


@inlined
def readings(w, I, pos, c, w_cmd, p, supply):
    """Predicted voltage, current, position, and their slopes: of V and i by w, I and the factor of the supply (`supply`
    its voltage without that factor), of x by x.

    A sensor's lag or delay is what of the mean's own motion has not come through yet; the state's error has, long ago.
    """
    (V, V_w, V_I, V_v), (i, i_w, i_I, i_v) = linear.electrical_readings(
        w, I, c.inner.c, c.slow, w_cmd, p, supply
    )
    seen = pos
    if any_of_rare(p[a.EXTENDED]):
        V, seen = V + p[a.VOLTAGE_OFFSET] - c.late_V, pos - c.trail - c.late_x
    x, x_x = linear.sensed_position(seen, p)
    return V, i, x, V_w, V_I, V_v, i_w, i_I, i_v, x_x


@inlined
def delay_readings(slow, delays, before, after, before_cmd, after_cmd, now, t, p):
    """What of voltage and position has not come through the delays of their sensors, into slow, after a step of the mean.

    slow: see `slow_size`; delays (2,) [s]; before, after: w, I, x and `Carried` of the mean, with the command [rad/s] at either
    end of a step of t [s] that ends at `now`.
    """
    if delays[0] > 0.0:
        change = _voltage(after, after_cmd, p) - _voltage(before, before_cmd, p)
        slow[LATE_V] = _delayed(slow, SLOW, change, now, t, delays[0])
    if delays[1] > 0.0:
        change = (after[2] - after[3].trail) - (before[2] - before[3].trail)
        slow[LATE_X] = _delayed(slow, SLOW + CELLS + 2, change, now, t, delays[1])


@inlined
def _voltage(mean, w_cmd, p):
    w, I, _, c = mean
    V, _ = linear.electrical_readings(w, I, c.inner.c, c.slow, w_cmd, p, 1.0)
    return V[0]


@inlined
def _delayed(cells, first, change, now, t, delay):
    """How much a signal changed in the last `delay` [s], after it changed by `change` in the last t [s].

    Cells of delay / CELLS on the log's clock hold the changes; they begin at cells[first], CELLS + 2 of them in turn.
    """
    size = delay / CELLS
    start, end = (now - t) / size, now / size
    last, total = int(math.floor(end)), zeros_like(change)
    oldest = max(int(math.floor(start)), last - CELLS - 1)
    for k in range(oldest, last + 1):
        at, share = first + k % (CELLS + 2), (min(end, k + 1.0) - max(start, 1.0 * k)) / (end - start)
        cells[at] = (cells[at] if start > k else zeros_like(change)) + share * change
    until = end - CELLS
    for k in range(int(math.floor(until)), last + 1):
        total = total + min(1.0, k + 1.0 - until) * cells[first + k % (CELLS + 2)]
    return total


LEAST = 0.01  # of the growth, whatever was seen: beside a stiff obstacle, less left the filters sure of what they had wrong
LOG_2PI = math.log(2.0 * math.pi)


@inlined
def failed_channel(z, previous, y, spread, sigma, share, bias, variance, tuning):
    """Log-density of a channel that has failed, and its bias afterwards, mean and variance.

    z, previous: reading now and a sample ago (infinite where there was none); y: what the state predicts, with variance
    `spread`; sigma: the channel's noise, share: that of it within which a reading repeats itself; bias, variance: what its
    bias was. A failed channel is off by a slowly moving bias, or repeats itself, or is noisy; tuning: (weight of repeating,
    weight of noise, its scale in sigma).
    """
    wide, narrow = tuning[2] * sigma, share * sigma
    S = spread + variance + sigma * sigma
    noise, repeat = S + wide * wide, narrow * narrow
    e, change = z - y - bias, z - previous
    by_S, by_noise, by_repeat = e * e / S, e * e / noise, change * change / repeat
    least = where_above(by_S, by_noise, by_noise, by_S)
    least = where_above(least, by_repeat, by_repeat, least)
    off = (1.0 - tuning[0] - tuning[1]) / sqrt(S) * exp(0.5 * (least - by_S))
    noisy = tuning[1] / sqrt(noise) * exp(0.5 * (least - by_noise))
    still = tuning[0] / narrow * exp(0.5 * (least - by_repeat))
    total = off + noisy + still
    trust = 1.0 - noisy / total
    gain = variance / S
    return log(total) - 0.5 * (LOG_2PI + least), bias + trust * gain * e, variance * (1.0 - trust * gain)


@inlined
def _times(A, B, scale, out):
    m = A.shape[0]
    for r in range(m):
        for c in range(m):
            total = 0.0
            for k in range(m):
                total += A[r, k] * B[k, c]
            out[r, c] = scale * total


@inlined
def renewed(M, mended, out):
    """Transition matrix of the first sample of a move, into out (m, m): what a fault is replaced by after a rest.

    Within a move no fault heals: a hypothesis that nothing leads back to keeps its own filter, and so its chance to be
    right after all. Between two moves the first hypothesis is entered anew from the others with probability `mended`.
    """
    m = M.shape[0]
    for r in range(m):
        share = 0.0 if r == 0 else mended
        for c in range(m):
            out[r, c] = (1.0 - share) * M[r, c]
        out[r, 0] += share


@inlined
def mode_transition(rates, t, M, work):
    """Transition matrix expm(rates t) of the mode process, into M (m, m), by scaling and squaring a Taylor series.

    work (2, m, m): scratch.
    """
    m = rates.shape[0]
    size = 0.0
    for j in range(m):
        size = max(size, -rates[j, j] * t)
    halvings = 0
    while size > 0.1:
        size *= 0.5
        halvings += 1
    part = t / 2.0**halvings
    term, product = work[0], work[1]
    for r in range(m):
        for c in range(m):
            term[r, c] = 1.0 if r == c else 0.0
            M[r, c] = term[r, c]
    for k in range(1, 9):
        _times(term, rates, part / k, product)
        for r in range(m):
            for c in range(m):
                term[r, c] = product[r, c]
                M[r, c] += term[r, c]
    for _ in range(halvings):
        _times(M, M, 1.0, product)
        for r in range(m):
            for c in range(m):
                M[r, c] = product[r, c]


LOST = -1e12  # log-density of a sample after which a hypothesis had to start anew, and the least of any
FARTHEST, WIDEST = 1e9, 1e12  # state and variance, SI units, that no actuator reaches
