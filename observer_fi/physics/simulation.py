"""Open-loop run of the plant with real stick-slip, and what the sensors show of it.

The motion between two samples is integrated by RK4 with the sign of friction held; a step in which the speed passes
zero is cut there, and the plant then stays at rest while friction can hold it (Karnopp). Slow states (winding
temperature, supply sag) move once a step. Backlash is a play between the screw and the mass.
"""

import math

from observer_fi.numerics import (
    MOST,
    above,
    compiled,
    exp,
    inlined,
    larger,
    nothing,
    seldom,
    side_by_side,
    signed,
    some,
    uncounted,
)
from observer_fi.physics import equations as a
from observer_fi.records import Array

STATES = ("w", "I", "x", "phi", "h", "sag", "c", "mass")
W, I, X, PHI, H, SAG, LAGGED, MASS = range(len(STATES))
CURRENT = len(STATES)  # column of the motor current in the output of `run`
BETWEEN = CURRENT + 1  # three columns: terminal voltage at the quarters of the interval that begins here
COLUMNS = BETWEEN + 3
LANES = MOST
ALL = (0,) * LANES
_LAG_STEP = 1.5  # RK4 is stable up to 2.8 time constants of the current lag in one step
_MOST_PIECES = 32  # steps per sample: a lag below 2 % of the sampling interval cannot be simulated


@inlined
def _drive_current(w, I, c, h, sag, late, torque, moving, p):
    """Motor current of equation 6, through the lag or the delay of the servo where there is one [A].

    late: the command as the proportional path sees it [rad/s]. torque: applied torque, used while moving (1, else 0) [N m].
    """
    i_cmd = a.command_current(w, I, late, p)
    if seldom(p[a.EXTENDED]):
        if seldom(p[a.SERVO_DELAY]):
            i_cmd = above(moving, 0.0, a.late_current(i_cmd, torque, p), i_cmd)
        i_cmd = above(p[a.CURRENT_LAG], 0.0, c, i_cmd)
    i = a.limited_current(i_cmd, w, h, sag, p)
    if seldom(p[a.EXTENDED]):
        i = above(p[a.CURRENT_LAG] * p[a.LAG_BEHIND_LIMIT], 0.0, c, i)
    return i


@inlined
def _lagged_goal(i_cmd, w, h, sag, p):
    """What the lagged current tends to: the command, or what the supply allows of it where the current itself lags [A]."""
    return above(abs(p[a.LAG_BEHIND_LIMIT]), 0.0, a.limited_current(i_cmd, w, h, sag, p), i_cmd)


@inlined
def _lag(p):
    """Time constant of the inner loop, 1 s where there is none and nobody asks [s]."""
    return above(p[a.CURRENT_LAG], 0.0, p[a.CURRENT_LAG], 1.0)


@inlined
def _rates(s, w, I, x, phi, h, sag, c, w_cmd, late, theta, p):
    """Rates of (w, I, x, c) for the sign of motion s: equations 8, 10, 12 and the lag of the inner loop."""
    d = a.indentation(x, p)
    torque = a.applied_torque(s, w, x, d, phi, theta, p)
    i = _drive_current(w, I, c, h, sag, late, torque, 1.0, p)
    dw = a.acceleration(i, torque, p)
    dI = w_cmd - w
    dc = nothing(w)
    if seldom(p[a.EXTENDED]):
        dI = above(dI * I, 0.0, above(p[a.INTEGRATOR_LIMIT], abs(I), dI, 0.0), dI)
        if seldom(p[a.CURRENT_LAG]):
            i_cmd = a.command_current(w, I, late, p) + p[a.KP] * p[a.SERVO_DELAY] * dw
            goal = _lagged_goal(i_cmd, w, h, sag, p)
            dc = above(p[a.CURRENT_LAG], 0.0, (goal - c) / _lag(p), 0.0)
    return dw, dI, a.mass_speed(w, d, torque, p), dc


@inlined
def _slide(s, w, I, x, phi, h, sag, c, t, c0, c1, c2, l0, l1, l2, theta, p):
    """One RK4 step of length t with the sign s. c0, c1, c2: command at start, middle, end; l0, l1, l2: late command."""
    u = 0.5 * t
    w0, I0, x0, q0 = _rates(s, w, I, x, phi, h, sag, c, c0, l0, theta, p)
    wa = w + u * w0
    w1, I1, x1, q1 = _rates(s, wa, I + u * I0, x + u * x0, phi + u * w, h, sag, c + u * q0, c1, l1, theta, p)
    wb = w + u * w1
    w2, I2, x2, q2 = _rates(s, wb, I + u * I1, x + u * x1, phi + u * wa, h, sag, c + u * q1, c1, l1, theta, p)
    wc = w + t * w2
    w3, I3, x3, q3 = _rates(s, wc, I + t * I2, x + t * x2, phi + t * wb, h, sag, c + t * q2, c2, l2, theta, p)
    v = t / 6.0
    return (
        w + v * (w0 + 2.0 * (w1 + w2) + w3),
        I + v * (I0 + 2.0 * (I1 + I2) + I3),
        x + v * (x0 + 2.0 * (x1 + x2) + x3),
        phi + v * (w + 2.0 * (wa + wb) + wc),
        c + v * (q0 + 2.0 * (q1 + q2) + q3),
    )


@inlined
def _breakaway(I, x, phi, h, sag, c, late, theta, p):
    """Sign in which the drive torque overcomes friction at rest, 0 where friction holds."""
    still = nothing(I)
    i = _drive_current(still, I, c, h, sag, late, still, 0.0, p)
    push = p[a.KM] * i - a.load_torque(still, x, a.indentation(x, p), phi, theta, p)
    hold, asymmetry = a.friction(still, x, theta, p), p[a.FRICTION_ASYMMETRY]
    return above(push, hold + asymmetry, 1.0, above(asymmetry - hold, push, -1.0, still))


@inlined
def _rest(I, c, t, h, sag, w_cmd, late, p):
    """Integral and lagged current after a time t at standstill."""
    wound = t * w_cmd
    if seldom(p[a.EXTENDED]):
        wound = above(w_cmd * I, 0.0, above(p[a.INTEGRATOR_LIMIT], abs(I), wound, 0.0), wound)
    I = I + wound
    if seldom(p[a.EXTENDED]) and seldom(p[a.CURRENT_LAG]):
        still = nothing(I)
        goal = _lagged_goal(a.command_current(still, I, late, p), still, h, sag, p)
        c = above(p[a.CURRENT_LAG], 0.0, goal + (c - goal) * exp(-t / _lag(p)), c)
    return I, c


@inlined
def _advance(w, I, x, phi, h, sag, c, step, c0, c1, c2, l0, l1, l2, theta, p):
    """One step of the plant with stick-slip: (w, I, x, phi, c) at its end."""
    s = a.sign_of(w)
    if seldom(1.0 - abs(s)):
        return _stick(w, I, x, phi, h, sag, c, step, c0, c1, c2, l0, l1, l2, theta, p)
    w1, I1, x1, phi1, q1 = _slide(s, w, I, x, phi, h, sag, c, step, c0, c1, c2, l0, l1, l2, theta, p)
    if seldom(above(0.0, w1 * s, 1.0, 0.0)):
        w1, I1, x1, phi1, q1 = _stick(w, I, x, phi, h, sag, c, step, c0, c1, c2, l0, l1, l2, theta, p)
    return w1, I1, x1, phi1, q1


@uncounted
def _stick(w, I, x, phi, h, sag, c, step, c0, c1, c2, l0, l1, l2, theta, p):
    """As `_advance`, for a step with standstill or a change of direction in it; `left` of it is still to go."""
    left = step + nothing(w)
    for _ in range(4):
        s = a.sign_of(w)
        if some(1.0 - abs(s)):
            s = above(abs(s), 0.0, s, _breakaway(I, x, phi, h, sag, c, l1, theta, p))
            held = above(abs(s), 0.0, 0.0, left)
            I1, c_held = _rest(I, c, held, h, sag, c1, l1, p)
            I, c, left = above(held, 0.0, I1, I), above(held, 0.0, c_held, c), left - held
            if not some(left):
                break
        f = 1.0 - left / step
        w1, I1, x1, phi1, q1 = _slide(
            s, w, I, x, phi, h, sag, c, left, c0 + (c2 - c0) * f, c1, c2, l0 + (l2 - l0) * f, l1, l2, theta, p
        )
        back = -(w1 * s)
        share = above(back, 0.0, above(abs(w), 0.0, w / (w - w1), 0.0), 1.0)
        I, x = above(back, 0.0, I + share * (I1 - I), I1), above(back, 0.0, x + share * (x1 - x), x1)
        phi, c = (
            above(back, 0.0, phi + share * (phi1 - phi), phi1),
            above(back, 0.0, c + share * (q1 - c), q1),
        )
        w, left = above(back, 0.0, 0.0, w1), above(back, 0.0, left * (1.0 - share), 0.0)
        left = above(left, 1e-9 * step, left, 0.0)
        if some(above(share, 0.0, 0.0, left)):  # thrown back at once: it rests
            held = above(share, 0.0, 0.0, left)
            I1, c_held = _rest(I, c, held, h, sag, c1, l1, p)
            I, c, left = above(held, 0.0, I1, I), above(held, 0.0, c_held, c), left - held
        if not some(left):
            break
    return w, I, x, phi, c


@inlined
def _run(t, commands, late, fine, theta, p, pace, start, out, steps):
    """As `run`, of numbers or rows. pace: the parameters that say how many steps an interval has."""
    n = t.size
    w, I, x, phi = start[0], start[1], start[2], start[3]
    h, sag, c, mass = start[4], start[5], start[6], start[7]
    half_gap = 0.5 * p[a.BACKLASH]
    extended = seldom(p[a.EXTENDED])
    for j in range(n):
        low = nothing(sag)
        if extended:
            low = sag + p[a.SUPPLY_DRIFT] * t[j]
        torque = a.applied_torque(signed(1.0, w), w, x, a.indentation(x, p), phi, theta[j], p)
        i = _drive_current(w, I, c, h, low, late[j, 0], torque, abs(w), p)
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = w, I, x, phi
        out[j, 4], out[j, 5], out[j, 6], out[j, 7], out[j, 8] = h, sag, c, mass, i
        if j + 1 == n:
            break
        dt = t[j + 1] - t[j]
        end, late_end = commands[j + 1, 0], late[j + 1, 0]
        pieces = _pieces(dt, steps if fine[j] else 1, pace)
        c0, l0 = commands[j, 0], late[j, 0]
        for m in range(pieces):
            c1 = _within(commands, j, end, (m + 0.5) / pieces)
            c2 = _within(commands, j, end, (m + 1.0) / pieces)
            l1 = _within(late, j, late_end, (m + 0.5) / pieces)
            l2 = _within(late, j, late_end, (m + 1.0) / pieces)
            w, I, x, phi, c = _advance(
                w, I, x, phi, h, low, c, dt / pieces, c0, c1, c2, l0, l1, l2, theta[j], p
            )
            c0, l0 = c2, l2
            if extended and seldom(p[a.VOLTAGE_DELAY]) and 4 * (m + 1) % pieces == 0 and m + 1 < pieces:
                torque = a.applied_torque(signed(1.0, w), w, x, a.indentation(x, p), phi, theta[j], p)
                i = _drive_current(w, I, c, h, low, l0, torque, abs(w), p)
                out[j, BETWEEN + 4 * (m + 1) // pieces - 1] = a.terminal_voltage(i, w, h, p)
        if extended:
            limit = p[a.INTEGRATOR_LIMIT]
            I = above(I, limit, limit, above(-limit, I, -limit, I))
            h = h + dt * a.heating(i, h, p)
            if seldom(p[a.SAG_RESISTANCE]):
                goal = p[a.SAG_RESISTANCE] * abs(i)
                later = goal + (sag - goal) * exp(-dt / p[a.SAG_TIME])
                sag = above(abs(p[a.SAG_RESISTANCE]), 0.0, later, sag)
        mass = larger(mass, x - half_gap)
        mass = above(mass, x + half_gap, x + half_gap, mass)


@compiled
def run(t, commands, late, fine, theta, p, start, out, steps=2):
    """States at every sample time, open loop from `start`.

    t: (n,) s. commands, late: (n, 4) the command, and the command as the proportional path sees it, at the quarters
    of the interval from each sample on [rad/s]. fine: (n,) whether that interval needs `steps` steps, a multiple of
    four or two. theta: (n,) deg. p: parameter vector. start: (8,) in the order of `STATES`. out: (n, 12), the
    states, the motor current, and the terminal voltage at the quarters of the interval where something asks for it.
    """
    _run(t, commands, late, fine, theta, p, p, start, out, steps)


@compiled
def run_lanes(t, commands, late, fine, theta, p, pace, start, out, steps=2):
    """As `run` for LANES parameter vectors at once, alike in `paced`: p (VECTOR_SIZE, L), start (8, L), out (n, 12, L).

    pace: one of the vectors.
    """
    _run(
        t, commands, late, fine, theta, side_by_side(p, ALL), pace, side_by_side(start, ALL), side_by_side(out, ALL), steps
    )  # fmt: skip


def paced(p: Array) -> tuple[float, bool]:
    """What of a parameter vector decides how many steps an interval has: the lag, and whether the voltage is late."""
    return float(p[a.CURRENT_LAG]), bool(p[a.VOLTAGE_DELAY] != 0.0)


@inlined
def _pieces(dt, steps, p):
    """Integration steps of one sampling interval: no fewer than a lag needs, or the quarters of a delayed voltage."""
    if p[a.EXTENDED] == 0.0:
        return steps
    if p[a.CURRENT_LAG] > 0.0:
        return max(steps, min(4 * math.ceil(dt / (4.0 * _LAG_STEP * p[a.CURRENT_LAG])), _MOST_PIECES))
    if p[a.VOLTAGE_DELAY] != 0.0:
        return max(steps, 4)
    return steps


@inlined
def _within(commands, j, end, share):
    """Command at a share of the interval from sample j on: a parabola over each half, exact in its integral [rad/s]."""
    k = 0 if share < 0.5 else 2
    u = 2.0 * share - 0.5 * k
    left, middle = commands[j, k], commands[j, k + 1]
    right = commands[j, 2] if k == 0 else end
    return left + u * (4.0 * middle - 3.0 * left - right + 2.0 * u * (left - 2.0 * middle + right))


@compiled
def readings(t, states, p, out):
    """What the sensors show: voltage [V], current [A], position [m], with their delays, lags, gains and offsets.

    t: (n,) s. states: (n, 12) from `run`. out: (n, 3). Lags and delays are exact for signals linear between samples.
    """
    n = t.size
    extended = p[a.EXTENDED] != 0.0
    seen = states[0, 7]
    for j in range(n):
        i = states[j, 8]
        out[j, 0] = a.terminal_voltage(i, states[j, 0], states[j, 4], p)
        out[j, 1] = a.current_reading(i, p) if extended else i
        out[j, 2] = states[j, 7]
    if not extended:
        return
    if p[a.POSITION_LAG] > 0.0:
        for j in range(1, n):
            dt = t[j] - t[j - 1]
            slope = (states[j, 7] - states[j - 1, 7]) / dt
            keep = math.exp(-dt / p[a.POSITION_LAG])
            seen = (
                states[j, 7]
                - slope * p[a.POSITION_LAG]
                + keep * (seen - states[j - 1, 7] + slope * p[a.POSITION_LAG])
            )
            out[j, 2] = seen
    if p[a.POSITION_DELAY] != 0.0:
        _delay(t, out[:, 2], p[a.POSITION_DELAY])
    for j in range(n):
        out[j, 2] = a.shown_position(out[j, 2], p)
    if p[a.VOLTAGE_DELAY] != 0.0:
        _delay_voltage(t, states, p[a.VOLTAGE_DELAY], out)
    for j in range(n):
        out[j, 0] += p[a.VOLTAGE_OFFSET]


@compiled
def _delay(t, y, delay):
    """y(t - delay) in place, linear between samples, constant before the first."""
    k = t.size - 1
    for j in range(t.size - 1, -1, -1):
        at = t[j] - delay
        k = min(k, j)
        while k > 0 and t[k] > at:
            k -= 1
        if t[k] > at:
            y[j] = y[0]
        elif k + 1 < t.size:
            y[j] = y[k] + (at - t[k]) / (t[k + 1] - t[k]) * (y[k + 1] - y[k])


@compiled
def _delay_voltage(t, states, delay, out):
    """V(t - delay) into the first column of out, linear between the quarters of the sampling intervals."""
    n = t.size
    for j in range(n - 1, -1, -1):
        at = t[j] - delay
        k = j
        while k > 0 and t[k] > at:
            k -= 1
        if t[k] > at:
            out[j, 0] = out[0, 0]
            continue
        last = min(k + 1, n - 1)
        if last == k:
            continue
        place = 4.0 * (at - t[k]) / (t[last] - t[k])
        if place >= 4.0:
            continue  # a negative delay asks for what comes later: the nearest sample stays
        q = int(place)
        left = out[k, 0] if q == 0 else states[k, BETWEEN + q - 1]
        right = out[last, 0] if q == 3 else states[k, BETWEEN + q]
        out[j, 0] = left + (place - q) * (right - left)
