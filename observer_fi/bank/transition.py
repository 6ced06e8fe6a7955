"""One sample of one hypothesis: the mean a step on, its Jacobian, the channels it predicts.

Both engines (`observers.py` on filterpy, `kernels.py` compiled) call these functions; nothing else knows how the
states of a hypothesis enter the equations of `actuator.py`.

Functions of numbers take rows of them as well (`rows.py`): the hypotheses of a bank, or several logs, side by side. A state
x, its parameters p, `base` without the factors in the state and slopes g are then arrays of rows.

A state vector starts with w [rad/s], I [rad], x [m]; the rest is given by `kinds`, one code a state: D_STATE the
indentation of a stop [m], TORQUE and RATE the free disturbances of "none of these" [N m, m/s], and
SCALE + k a factor on parameter k of the equations, 1 in the mean.

The trajectory of the mean carries slow states that have no variance (`slow`): motor angle phi [rad], resistance rise h,
supply sag [V], lagged current c [A].
"""

import math

import numpy as np

from observer_fi.numerics import above, exp, inlined, log, nothing, seldom, signed, some, sqrt, uncounted
from observer_fi.physics import equations as a

W_STATE, I_STATE, X_STATE, D_STATE, TORQUE, RATE = range(6)
SCALE = 16
PHI, H, SAG, LAGGED = range(4)
SLOW = 4
REST_VARIANCE = 1e-6  # (rad/s)^2, of a motor that friction holds
SIXTH = 1.0 / 6.0
STOPS_WITHIN = 1e-9  # share of a step that is not worth integrating

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
def held(x, at, has, kind, otherwise):
    """The state of this kind, `otherwise` where there is none."""
    return above(has[kind], 0.5, x[max(at[kind], 0)], otherwise)


@inlined
def load_parameters(x, at, has, base, p):
    """Parameters into p (VECTOR_SIZE,): those of `base` that a state may stand for, times their factors."""
    p[a.A] = base[a.A] * held(x, at, has, AT_A, 1.0)
    p[a.B] = base[a.B] * held(x, at, has, AT_B, 1.0)
    p[a.A_DECOUPLED] = base[a.A_DECOUPLED] * held(x, at, has, AT_LOOSE, 1.0)
    p[a.C] = base[a.C] * held(x, at, has, AT_C, 1.0)
    p[a.E] = base[a.E] * held(x, at, has, AT_E, 1.0)
    p[a.VMAX] = base[a.VMAX] * held(x, at, has, AT_SUPPLY, 1.0)
    factor = held(x, at, has, AT_J, 1.0)
    p[a.J] = base[a.J] * factor
    p[a.J_DECOUPLED] = base[a.J_DECOUPLED] * factor * held(x, at, has, AT_LOOSE_J, 1.0)


@inlined
def _commanded(w, I, c, w_cmd, p):
    """Current that the servo asks for: equation 3, or the lagged current c where it lags [A]."""
    i_cmd = a.command_current(w, I, w_cmd, p)
    if seldom(p[a.EXTENDED]):
        i_cmd = above(p[a.CURRENT_LAG], 0.0, c, i_cmd)
    return i_cmd


@inlined
def _current(w, I, c, h, sag, w_cmd, p):
    return a.limited_current(_commanded(w, I, c, w_cmd, p), w, h, sag, p)


@inlined
def _rates(s, w, I, x, d, phi, h, sag, c, w_cmd, theta, torque, rate, p):
    i = _current(w, I, c, h, sag, w_cmd, p)
    load = a.applied_torque(s, w, x, d, phi, theta, p) + torque
    dx = a.mass_speed(w, d, load, p) + rate
    dI = w_cmd - w
    if seldom(p[a.EXTENDED]):
        dI = above(dI * I, 0.0, above(p[a.INTEGRATOR_LIMIT], abs(I), dI, 0.0), dI)
    return a.acceleration(i, load, p), dI, dx


@inlined
def _slide(s, w, I, x, d, phi, h, sag, c, t, c0, mean, theta, torque, rate, p):
    """Midpoint rule over (w, I, x, d) with the sign of motion s held; `mean` is the mean command over the step.

    At 0.7 ms and 22 Hz its error is 2e-4 of a step's change, far below the noise; docs/decisions has the comparison.
    """
    on = above(abs(p[a.CONTACT]), 0.0, 1.0, 0.0)
    half = 0.5 * t
    w1, I1, x1 = _rates(s, w, I, x, d, phi, h, sag, c, c0, theta, torque, rate, p)
    w2, I2, x2 = _rates(
        s, w + half * w1, I + half * I1, x + half * x1, d + on * half * x1, phi + half * w, h, sag, c, mean,
        theta, torque, rate, p,
    )  # fmt: skip
    return w + t * w2, I + t * I2, x + t * x2, d + on * t * x2


@inlined
def _breakaway(I, x, d, phi, h, sag, c, w_cmd, theta, torque, p):
    """Sign in which the drive overcomes friction at rest; 0 where friction holds."""
    still = nothing(I)
    push = (
        p[a.KM] * _current(still, I, c, h, sag, w_cmd, p) - a.load_torque(still, x, d, phi, theta, p) - torque
    )
    hold, asymmetry = a.friction(still, x, theta, p), p[a.FRICTION_ASYMMETRY]
    return above(push, asymmetry + hold, 1.0, above(asymmetry - hold, push, -1.0, still))


@inlined
def _advance_slow(w0, w, I, t, w_cmd, slow, p):
    """Slow states (phi, h, sag, c) a step later."""
    phi, h, sag, c = slow
    phi = phi + 0.5 * t * (w0 + w)
    if seldom(p[a.EXTENDED]):
        i = _current(w, I, c, h, sag, w_cmd, p)
        h = h + t * a.heating(i, h, p)
        sag = sag + t * a.sagging(i, sag, p)
        if seldom(p[a.CURRENT_LAG]):
            goal = a.command_current(w, I, w_cmd, p)
            lag = p[a.CURRENT_LAG]
            c = above(lag, 0.0, goal + (c - goal) * exp(-t / above(lag, 0.0, lag, 1.0)), c)
    return phi, h, sag, c


@uncounted
def _stick(w, I, pos, d, torque, rate, slow, step, c0, mean, theta, p):
    """One step with standstill or a change of direction in it: (w, I, x, d, 1 where the motor rests at its end, else 0).

    A speed that passes zero is cut there, and the rest of the step goes on from standstill; `left` is what is still to go.
    """
    phi, h, sag, c = slow
    resting, left = nothing(w), step + nothing(w)
    for _ in range(3):
        s = a.sign_of(w)
        if some(1.0 - abs(s)):
            s = above(abs(s), 0.0, s, _breakaway(I, pos, d, phi, h, sag, c, mean, theta, torque, p))
            held = above(abs(s), 0.0, 0.0, left)
            I, pos, resting = I + held * mean, pos + held * rate, above(held, 0.0, 1.0, resting)
            left = left - held
            if not some(left):
                break
        w1, I1, x1, d1 = _slide(s, w, I, pos, d, phi, h, sag, c, left, c0, mean, theta, torque, rate, p)
        back = -(w1 * s)
        share = above(back, 0.0, above(abs(w), 0.0, w / (w - w1), 1.0), 1.0)
        w, left = above(back, 0.0, 0.0, w1), above(back, 0.0, left * (1.0 - share), 0.0)
        I, pos = above(back, 0.0, I + share * (I1 - I), I1), above(back, 0.0, pos + share * (x1 - pos), x1)
        d, left = above(back, 0.0, d + share * (d1 - d), d1), above(left, STOPS_WITHIN * step, left, 0.0)
        if not some(left):
            break
    return w, I, pos, d, resting


@inlined
def _stick_or_slide(w, I, pos, d, torque, rate, slow, step, c0, mean, theta, p):
    """As `_stick`, and the shorter way where the motor keeps its direction."""
    phi, h, sag, c = slow
    s, resting = a.sign_of(w), nothing(w)
    if seldom(1.0 - abs(s)):
        return _stick(w, I, pos, d, torque, rate, slow, step, c0, mean, theta, p)
    w1, I1, x1, d1 = _slide(s, w, I, pos, d, phi, h, sag, c, step, c0, mean, theta, torque, rate, p)
    if seldom(above(0.0, w1 * s, 1.0, 0.0)):
        w1, I1, x1, d1, resting = _stick(w, I, pos, d, torque, rate, slow, step, c0, mean, theta, p)
    return w1, I1, x1, d1, resting


@inlined
def advance(w, I, pos, d, torque, rate, slow, t, steps, interval, row, last, theta, p):
    """Mean a sample later: (w, I, x, d), the slow states, and 1 where the motor rests at the end, else 0.

    slow: (phi, h, sag, c). t: time step [s], in `steps` steps. interval (rows, 2 steps): command at the half-steps in its
    row `row`, `last` at the end [rad/s].
    """
    step, resting = t * (1.0 / steps), nothing(w)
    for m in range(steps):
        c0, c1 = interval[row, 2 * m], interval[row, 2 * m + 1]
        c2 = interval[row, 2 * m + 2] if m + 1 < steps else last
        mean, w0 = (c0 + 4.0 * c1 + c2) * SIXTH, w
        w, I, pos, d, resting = _stick_or_slide(w, I, pos, d, torque, rate, slow, step, c0, mean, theta, p)
        slow = _advance_slow(w0, w, I, step, c2, slow, p)
    return (w, I, pos, d), slow, resting


@inlined
def propagate(x, at, has, slow, t, interval, row, last, theta, p):
    """As `advance`, with x (n,) and slow (SLOW,) overwritten. 1 where the motor rests at the end."""
    d, torque, rate = (
        held(x, at, has, AT_D, 0.0),
        held(x, at, has, AT_TORQUE, 0.0),
        held(x, at, has, AT_RATE, 0.0),
    )
    (x[0], x[1], x[2], d), (slow[PHI], slow[H], slow[SAG], slow[LAGGED]), resting = advance(
        x[0], x[1], x[2], d, torque, rate, (slow[PHI], slow[H], slow[SAG], slow[LAGGED]), t, interval.shape[1] // 2,
        interval, row, last, theta, p,
    )  # fmt: skip
    if at[AT_D] >= 0:
        x[at[AT_D]] = above(has[AT_D], 0.5, d, x[at[AT_D]])
    return resting


@inlined
def driven(i_cmd, w, h, sag, p):
    """The current that a commanded one leads to, and its slopes by w, I and the limit of the supply."""
    i = a.limited_current(i_cmd, w, h, sag, p)
    by_w, by_I, by_V, short = -p[a.KP], p[a.KI], nothing(i), abs(i - i_cmd)
    if seldom(short):
        per_R = 1.0 / (p[a.RM] * (1.0 + h) + p[a.RS])
        by_w, by_I = above(short, 0.0, -p[a.KM] * per_R, by_w), above(short, 0.0, 0.0, by_I)
        by_V = above(short, 0.0, signed(per_R, i_cmd), by_V)
    return i, by_w, by_I, by_V


@inlined
def motion_slopes(w, I, pos, d, phi, h, sag, w_cmd, theta, torque, p):
    """What moves w, I and x: d(dw/dt) by w, I, x, d(dx/dt) by w; and current, its slope by the supply, load, 1 / J.

    Friction keeps its sign; effects of the torque are differentiated numerically, everything else exactly.
    """
    s = above(w, 0.0, 1.0, -1.0)
    i, di_dw, di_dI, di_dV = driven(a.command_current(w, I, w_cmd, p), w, h, sag, p)
    per_J = 1.0 / a.inertia(p)
    load = a.applied_torque(s, w, pos, d, phi, theta, p) + torque
    by_w, by_I, by_x = p[a.KM] * di_dw * per_J, p[a.KM] * di_dI * per_J, nothing(load)
    if seldom(p[a.EXTENDED]):
        dw, dp = 0.5, 1e-5
        by_w -= (a.applied_torque(s, w + dw, pos, d, phi, theta, p) + torque - load) / dw * per_J
        by_x -= (a.applied_torque(s, w, pos + dp, d, phi, theta, p) + torque - load) / dp * per_J
    return by_w, by_I, by_x, a.mass_speed(1.0 + nothing(w), d, load, p), i, di_dV, load, per_J


@inlined
def _set_slope(g, row, at, has, kind, slope):
    g[row, at[kind]] = above(has[kind], 0.5, slope, g[row, at[kind]])


@inlined
def constant_slopes(x, at, has, w, d, i, di_dV, load, per_J, theta, p, base, g):
    """Slopes of dw/dt and dx/dt by the states behind w, I, x, into rows 0 and 1 of g (2, n); what no state has is left alone.

    p: parameters with the factors in x, base: without.
    """
    s = above(w, 0.0, 1.0, -1.0)
    if at[AT_SUPPLY] >= 0:
        _set_slope(g, 0, at, has, AT_SUPPLY, p[a.KM] * di_dV * base[a.VMAX] * per_J)
    if at[AT_A] >= 0:
        _set_slope(g, 0, at, has, AT_A, -p[a.COUPLING] * s * base[a.A] * per_J)
    if at[AT_B] >= 0:
        _set_slope(g, 0, at, has, AT_B, -p[a.COUPLING] * base[a.B] * theta * per_J)
    if at[AT_LOOSE] >= 0:
        _set_slope(g, 0, at, has, AT_LOOSE, -(1.0 - p[a.COUPLING]) * s * base[a.A_DECOUPLED] * per_J)
    if at[AT_J] >= 0:
        _set_slope(g, 0, at, has, AT_J, -(p[a.KM] * i - load) * per_J / held(x, at, has, AT_J, 1.0))
    if at[AT_LOOSE_J] >= 0:
        slope = -(1.0 - p[a.COUPLING]) * (p[a.KM] * i - load) * per_J
        _set_slope(g, 0, at, has, AT_LOOSE_J, slope / held(x, at, has, AT_LOOSE_J, 1.0))
    if at[AT_D] >= 0:
        _set_slope(g, 0, at, has, AT_D, -2.0 * p[a.C] * abs(d) * per_J)
    if at[AT_C] >= 0:
        _set_slope(g, 0, at, has, AT_C, -a.stop_torque(w, d, p) * per_J / held(x, at, has, AT_C, 1.0))
    if at[AT_E] >= 0:
        _set_slope(g, 1, at, has, AT_E, -p[a.COUPLING] * p[a.D] * w * base[a.E])
    if at[AT_TORQUE] >= 0:
        _set_slope(g, 0, at, has, AT_TORQUE, -per_J)
    if at[AT_RATE] >= 0:
        _set_slope(g, 1, at, has, AT_RATE, 1.0 + nothing(w))


@inlined
def motion_transition(by_w, by_I, by_x, by_d, x_by_w, t):
    """Transition matrix of w, I, x, I + g t + (g t)^2 / 2: (F_ww, F_wI, F_wx, F_Iw, F_II, F_xw, F_xI); F_Ix = 0, F_xx = 1."""
    half = 0.5 * t * t
    return (
        1.0 + t * by_w + half * (by_w * by_w + (by_x + by_d) * x_by_w - by_I),
        t * by_I + half * by_w * by_I,
        t * by_x + half * by_w * by_x,
        half * by_w * -1.0 - t,
        1.0 - half * by_I,
        t * x_by_w + half * x_by_w * by_w,
        half * x_by_w * by_I,
    )


@inlined
def constant_transition(by_w, by_x, by_d, w_slope, x_slope, t):
    """What a constant does to w in a step, from its slopes; numbers, or rows of them."""
    half = 0.5 * t * t
    return w_slope * (t + half * by_w) + x_slope * (half * (by_x + by_d))


@inlined
def readings(w, I, pos, h, sag, c, w_cmd, p, supply):
    """Predicted voltage, current, position, and their slopes: of V and i by w, I and the factor of the supply (`supply`
    its voltage without that factor), of x by w and x.

    Equation 15 for the voltage, equation 6 for the current.
    """
    i_cmd = _commanded(w, I, c, w_cmd, p)
    i, di_dw, di_dI, di_dV = driven(i_cmd, w, h, sag, p)
    di_dV *= supply
    resistance = p[a.RM] * (1.0 + h)
    V, shown_i, shown_x, gain, lag = a.terminal_voltage(i, w, h, p), i, pos, 1.0 + nothing(w), nothing(w)
    if seldom(p[a.EXTENDED]):
        free = nothing(w)
        V += p[a.VOLTAGE_OFFSET]
        shown_i, gain = a.current_reading(i, p), p[a.CURRENT_GAIN]
        shown_x = a.position_reading(pos, a.mass_speed(w, free, free, p), p)
        lag = (p[a.POSITION_DELAY] + p[a.POSITION_LAG]) * a.mass_speed(1.0 + free, free, free, p)
    return (
        V, shown_i, shown_x, resistance * di_dw + p[a.KM], resistance * di_dI, resistance * di_dV,
        gain * di_dw, gain * di_dI, gain * di_dV, -lag, p[a.POSITION_GAIN],
    )  # fmt: skip


LOG_2PI = math.log(2.0 * math.pi)


@inlined
def failed_channel(z, previous, y, spread, sigma, bias, variance, tuning):
    """Log-density of a channel that has failed, and its bias afterwards, mean and variance.

    z, previous: reading now and a sample ago (infinite where there was none); y: what the state predicts, with variance
    `spread`; sigma: the channel's noise; bias, variance: what its bias was. A failed channel is off by a slowly moving
    bias, or repeats itself, or is noisy; tuning: (weight of repeating, its scale in sigma, weight of noise, its scale).
    """
    wide, narrow = tuning[3] * sigma, tuning[1] * sigma
    S = spread + variance + sigma * sigma
    noise, repeat = S + wide * wide, narrow * narrow
    e, change = z - y - bias, z - previous
    by_S, by_noise, by_repeat = e * e / S, e * e / noise, change * change / repeat
    least = above(by_S, by_noise, by_noise, by_S)
    least = above(least, by_repeat, by_repeat, least)
    off = (1.0 - tuning[0] - tuning[2]) / sqrt(S) * exp(0.5 * (least - by_S))
    noisy = tuning[2] / sqrt(noise) * exp(0.5 * (least - by_noise))
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
