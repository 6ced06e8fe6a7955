"""One sample of one hypothesis: the mean a step on, its Jacobian, the channels it predicts.

Both engines (`observers.py` on filterpy, `kernels.py` compiled) call these functions; nothing else knows how the
states of a hypothesis enter the equations of `actuator.py`.

Functions take the arrays of a whole bank and the row j of a hypothesis: a slice costs more than an equation. Those that take
numbers alone take rows of them as well (`rows.py`): several logs side by side.

A state vector starts with w [rad/s], I [rad], x [m]; the rest is given by `kinds`, one code a state: D_STATE the
indentation of a stop [m], TORQUE and RATE the free disturbances of "none of these" [N m, m/s], and
SCALE + k a factor on parameter k of the equations, 1 in the mean.

The trajectory of the mean carries slow states that have no variance (`slow`): motor angle phi [rad], resistance rise h,
supply sag [V], lagged current c [A].
"""

import math

import numpy as np

from observer_fi import actuator as a
from observer_fi.compiled import inlined, uncounted
from observer_fi.rows import above, exp, nothing, seldom, signed, some

W_STATE, I_STATE, X_STATE, D_STATE, TORQUE, RATE = range(6)
SCALE = 16
PHI, H, SAG, LAGGED = range(4)
SLOW = 4
REST_VARIANCE = 1e-6  # (rad/s)^2, of a motor that friction holds
SIXTH = 1.0 / 6.0
STOPS_WITHIN = 1e-9  # share of a step that is not worth integrating

# A layout (LAYOUT,) says where in the state each kind stands: the size, then an index per kind, or -1.
SIZE, AT_D, AT_TORQUE, AT_SUPPLY, AT_RATE, AT_A, AT_B, AT_LOOSE, AT_C, AT_E, AT_J = range(11)
LAYOUT = 11
_LOOKED_UP = {
    AT_D: D_STATE, AT_TORQUE: TORQUE, AT_SUPPLY: SCALE + a.VMAX, AT_RATE: RATE, AT_A: SCALE + a.A, AT_B: SCALE + a.B,
    AT_LOOSE: SCALE + a.A_DECOUPLED, AT_C: SCALE + a.C, AT_E: SCALE + a.E, AT_J: SCALE + a.J,
}  # fmt: skip


def layout(kinds: np.ndarray) -> np.ndarray:
    """Where each kind of state stands, (LAYOUT,) integers, for the state codes kinds (n,)."""
    out = np.full(LAYOUT, -1)
    out[SIZE] = kinds.size
    for slot, kind in _LOOKED_UP.items():
        found = np.flatnonzero(kinds == kind)
        if found.size:
            out[slot] = found[0]
    return out


@inlined
def load_parameters(j, x, at, base, p):
    """Parameters of hypothesis j into p (VECTOR_SIZE,): the base's two switches and every factor in the state.

    All hypotheses of a bank share the other parameters, which p holds already.
    """
    p[a.COUPLING] = base[j, a.COUPLING]
    p[a.CONTACT] = base[j, a.CONTACT]
    p[a.A] = base[j, a.A] * (x[j, at[j, AT_A]] if at[j, AT_A] >= 0 else 1.0)
    p[a.B] = base[j, a.B] * (x[j, at[j, AT_B]] if at[j, AT_B] >= 0 else 1.0)
    p[a.A_DECOUPLED] = base[j, a.A_DECOUPLED] * (x[j, at[j, AT_LOOSE]] if at[j, AT_LOOSE] >= 0 else 1.0)
    p[a.C] = base[j, a.C] * (x[j, at[j, AT_C]] if at[j, AT_C] >= 0 else 1.0)
    p[a.E] = base[j, a.E] * (x[j, at[j, AT_E]] if at[j, AT_E] >= 0 else 1.0)
    p[a.VMAX] = base[j, a.VMAX] * (x[j, at[j, AT_SUPPLY]] if at[j, AT_SUPPLY] >= 0 else 1.0)
    factor = x[j, at[j, AT_J]] if at[j, AT_J] >= 0 else 1.0
    p[a.J] = base[j, a.J] * factor
    p[a.J_DECOUPLED] = base[j, a.J_DECOUPLED] * factor


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
def slow_of(j, slow):
    """Slow states of hypothesis j: (phi, h, sag, c)."""
    return slow[j, PHI], slow[j, H], slow[j, SAG], slow[j, LAGGED]


@inlined
def set_slow(j, slow, values):
    """Put (phi, h, sag, c) into row j of slow (m, SLOW)."""
    slow[j, PHI], slow[j, H], slow[j, SAG], slow[j, LAGGED] = values


@inlined
def value(j, k, x):
    """State k of hypothesis j, 0 where it has none (k = -1)."""
    return x[j, k] if k >= 0 else 0.0


@inlined
def propagate(j, x, at, slow, t, interval, row, last, theta, p):
    """As `advance`, with rows j of x (m, n) and slow (m, SLOW) overwritten. True where the motor rests at the end."""
    (x[j, 0], x[j, 1], x[j, 2], d), after, resting = advance(
        x[j, 0], x[j, 1], x[j, 2], value(j, at[j, AT_D], x), value(j, at[j, AT_TORQUE], x), value(j, at[j, AT_RATE], x),
        slow_of(j, slow), t, interval.shape[1] // 2, interval, row, last, theta, p,
    )  # fmt: skip
    set_slow(j, slow, after)
    if at[j, AT_D] >= 0:
        x[j, at[j, AT_D]] = d
    return some(resting)


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
def constant_slopes(j, x, at, w, d, i, di_dV, load, per_J, theta, p, base, g):
    """Slopes of dw/dt and dx/dt by the states behind w, I, x, into g (3, n); entries that no state has are left alone.

    p: parameters with this hypothesis' factors, base: without.
    """
    s = 1.0 if w > 0.0 else -1.0
    if at[j, AT_SUPPLY] >= 0:
        g[0, at[j, AT_SUPPLY]] = p[a.KM] * di_dV * base[j, a.VMAX] * per_J
    if at[j, AT_A] >= 0:
        g[0, at[j, AT_A]] = -p[a.COUPLING] * s * base[j, a.A] * per_J
    if at[j, AT_B] >= 0:
        g[0, at[j, AT_B]] = -p[a.COUPLING] * base[j, a.B] * theta * per_J
    if at[j, AT_LOOSE] >= 0:
        g[0, at[j, AT_LOOSE]] = -(1.0 - p[a.COUPLING]) * s * base[j, a.A_DECOUPLED] * per_J
    if at[j, AT_J] >= 0:
        g[0, at[j, AT_J]] = -(p[a.KM] * i - load) * per_J / x[j, at[j, AT_J]]
    if at[j, AT_D] >= 0:
        g[0, at[j, AT_D]] = -2.0 * p[a.C] * abs(d) * per_J
    if at[j, AT_C] >= 0:
        g[0, at[j, AT_C]] = -a.stop_torque(w, d, p) * per_J / x[j, at[j, AT_C]]
    if at[j, AT_E] >= 0:
        g[2, at[j, AT_E]] = -p[a.COUPLING] * p[a.D] * w * base[j, a.E]
    if at[j, AT_TORQUE] >= 0:
        g[0, at[j, AT_TORQUE]] = -per_J
    if at[j, AT_RATE] >= 0:
        g[2, at[j, AT_RATE]] = 1.0


@inlined
def slopes(j, x, at, slow, w_cmd, theta, p, base, g):
    """Jacobian of (dw/dt, dI/dt, dx/dt) by the state, into g (3, n), at the state x while sliding.

    dI/dt has no entry but -1 for w, which callers know.
    """
    w, d = x[j, 0], value(j, at[j, AT_D], x)
    for k in range(2, at[j, SIZE]):
        g[0, k] = 0.0
        g[2, k] = 0.0
    g[0, 0], g[0, 1], g[0, 2], g[2, 0], i, di_dV, load, per_J = motion_slopes(
        w, x[j, 1], x[j, 2], d, slow[j, PHI], slow[j, H], slow[j, SAG], w_cmd, theta, value(j, at[j, AT_TORQUE], x), p
    )  # fmt: skip
    constant_slopes(j, x, at, w, d, i, di_dV, load, per_J, theta, p, base, g)


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
def transition(j, at, g, t, resting, F):
    """Rows of the discrete transition matrix for w, I, x and, where there is one, d, into F (4, n): I + g t + (g t)^2 / 2.

    Second-order terms of I and x by constants are left out: they are 1e-3 of what w passes on a sample later. d moves
    with x. A motor that rests forgets its speed, and nothing else moves.
    """
    n, at_d = at[j, SIZE], at[j, AT_D]
    for r in range(4):
        for k in range(n):
            F[r, k] = 0.0
    F[1, 1], F[2, 2] = 1.0, 1.0
    if not resting:
        by_w, by_x, by_d = g[0, 0], g[0, 2], g[0, at_d] if at_d >= 0 else 0.0
        F[0, 0], F[0, 1], F[0, 2], F[1, 0], F[1, 1], F[2, 0], F[2, 1] = motion_transition(
            by_w, g[0, 1], by_x, by_d, g[2, 0], t
        )
        for k in range(3, n):
            F[0, k] = constant_transition(by_w, by_x, by_d, g[0, k], g[2, k], t)
            F[2, k] = t * g[2, k]
    if at_d >= 0:
        for k in range(n):
            F[3, k] = F[2, k]
        F[3, 2] -= 1.0
        F[3, at_d] += 1.0


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


@inlined
def channels(j, x, at, slow, w_cmd, theta, p, base, y, H):
    """The `readings` into y (m, 3) row j, and their slopes by w, I, x and the factor of the supply, into H (3, 4)."""
    (
        y[j, 0], y[j, 1], y[j, 2], H[0, 0], H[0, 1], H[0, 3], H[1, 0], H[1, 1], H[1, 3], H[2, 0], H[2, 2],
    ) = readings(
        x[j, 0], x[j, 1], x[j, 2], slow[j, 1], slow[j, SAG], slow[j, LAGGED], w_cmd, p, base[j, a.VMAX]
    )  # fmt: skip
    H[0, 2], H[1, 2], H[2, 1], H[2, 3] = 0.0, 0.0, 0.0, 0.0


LOG_2PI = math.log(2.0 * math.pi)


@inlined
def glitch(j, S, e, c, glitches, limit, samples):
    """Whether an innovation e of variance S is a glitch: farther than `limit` standard deviations, for at most `samples`.

    Counts channel c of hypothesis j in glitches (m, 3).
    """
    far = e * e > limit * limit * S
    if not far:
        glitches[j, c] = 0.0
        return False
    if glitches[j, c] < samples:
        glitches[j, c] += 1.0
        return True
    return False


@inlined
def failed_channel(j, z, previous, y, spread, sigma, bias, tuning):
    """Log-density of a channel that has failed, and the update of its bias; bias (m, 2) mean and variance, row j in place.

    z, previous: reading now and a sample ago; y: what the state predicts, with variance `spread`; sigma: the channel's
    noise. A failed channel is off by a slowly moving bias, or repeats itself, or is noisy; tuning: (weight of
    repeating, its scale in sigma, weight of noise, its scale in sigma).
    """
    wide, narrow = tuning[3] * sigma, tuning[1] * sigma
    S = spread + bias[j, 1] + sigma * sigma
    noise, repeat = S + wide * wide, narrow * narrow
    e, change = z - y - bias[j, 0], z - previous
    by_S, by_noise, by_repeat = e * e / S, e * e / noise, change * change / repeat
    least = min(by_S, by_noise, by_repeat)
    off = (1.0 - tuning[0] - tuning[2]) / math.sqrt(S) * math.exp(0.5 * (least - by_S))
    noisy = tuning[2] / math.sqrt(noise) * math.exp(0.5 * (least - by_noise))
    still = tuning[0] / math.sqrt(repeat) * math.exp(0.5 * (least - by_repeat))
    total = off + noisy + still
    trust = 1.0 - noisy / total
    gain = bias[j, 1] / S
    bias[j, 0] += trust * gain * e
    bias[j, 1] *= 1.0 - trust * gain
    return math.log(total) - 0.5 * (LOG_2PI + least)


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


# Sigma points at sqrt(n) standard deviations: with alpha = 1 and kappa = 0 no weight is negative, so that a covariance
# stays one; beta = 2 is right for a Gaussian. Small alphas weigh the centre by -1e6 and lose six digits.
ALPHA, BETA, KAPPA = 1.0, 2.0, 0.0
FLAT = 1e-12  # least share of a variance that a pivot keeps


@inlined
def factor(j, P, n, L):
    """Lower Cholesky factor of the symmetric part of P[j] (m, n, n), into L (n, n).

    A pivot that rounding took below FLAT of its variance is set to that share: P may be singular.
    """
    for k in range(n):
        for q in range(k + 1):
            total = 0.5 * (P[j, k, q] + P[j, q, k])
            for r in range(q):
                total -= L[k, r] * L[q, r]
            if q < k:
                L[k, q] = total / L[q, q]
                L[q, k] = 0.0
            else:
                L[k, k] = math.sqrt(max(total, FLAT * P[j, k, k], 1e-300))


LOST = -1e12  # log-density of a sample after which a hypothesis had to start anew, and the least of any
FARTHEST, WIDEST = 1e9, 1e12  # state and variance, SI units, that no actuator reaches


@inlined
def lost(j, n, x, P):
    """Whether state j is beyond what any reading can have meant: numbers that would soon be no numbers."""
    far, wide, narrow = 0.0, 0.0, 0.0
    for k in range(n):
        far += abs(x[j, k])
        wide += abs(P[j, k, k])
        narrow = min(narrow, P[j, k, k])
    return not (far < FARTHEST and wide < WIDEST and narrow > -1.0)


@inlined
def start_anew(j, n, x, P, slow, mean, var, position):
    """State j at rest at `position` [m], everything else at the entry prior mean, var (m, n); rows j in place."""
    for k in range(n):
        for q in range(n):
            P[j, k, q] = 0.0
        x[j, k] = mean[j, k]
        P[j, k, k] = var[j, k]
    if position == position:
        x[j, 2] = position
    for k in range(SLOW):
        slow[j, k] = 0.0
