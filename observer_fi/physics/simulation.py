"""Open-loop run of the plant with real stick-slip, and what the sensors show of it.

The motion between two samples is integrated by `plant.runge_kutta`. Slow states (winding temperature, supply sag) move once a
sample. Backlash is a play between the screw and the mass.
"""

import math

from observer_fi.numerics import (
    MOST,
    any_of_rare,
    copysign,
    inlined,
    side_by_side,
    uncounted,
    where_above,
    zeros_like,
)
from observer_fi.physics import equations as a
from observer_fi.physics import plant
from observer_fi.records import Array

STATES = ("w", "I", "x", *plant.Inner._fields, "h", "sag", "mass")
W, I, X, INNER, H, SAG, MASS, PHI, LAGGED = (
    STATES.index(name) for name in ("w", "I", "x", plant.Inner._fields[0], "h", "sag", "mass", "phi", "c")
)
CURRENT = len(STATES)  # column of the motor current in the output of `run`
BETWEEN = CURRENT + 1  # three columns: terminal voltage at the quarters of the interval that begins here
COLUMNS = BETWEEN + 3
LANES = MOST
ALL = (0,) * LANES
_LAG_STEP = 1.5  # RK4 is stable up to 2.8 time constants of the current lag in one step
_MOST_PIECES = 32  # steps per sample: a lag below 2 % of the sampling interval cannot be simulated


@inlined
def _run(t, commands, late, fine, theta, p, pace, start, out, steps):
    """As `run`, of numbers or rows. pace: the parameters that say how many steps an interval has."""
    x, mass, none = start[X], start[MASS], zeros_like(start[X])
    m = plant.Motion(start[W], start[I], x, a.indentation(x, p), plant.inner_in(start, INNER))
    slow, free = plant.Slow(start[H], start[SAG], none, none), plant.Free(none, none)
    extended, n = any_of_rare(p[a.EXTENDED]), t.size
    for j in range(n):
        if extended:
            slow = plant.on_the_clock(slow, t[j], p)
        i = _current(m, slow, late[j, 0], theta[j], free, p)
        out[j, W], out[j, I], out[j, X] = m.w, m.I, m.x
        for k in range(plant.INNER):
            out[j, INNER + k] = m.inner[k]
        out[j, H], out[j, SAG], out[j, MASS], out[j, CURRENT] = slow.h, slow.sag, mass, i
        if j + 1 == n:
            break
        dt = t[j + 1] - t[j]
        pieces = _pieces(dt, steps if fine[j] else 1, pace)
        for k in range(pieces):
            u = _command(commands, late, j, k, pieces)
            m, _ = plant.step(plant.runge_kutta, m, slow, dt / pieces, u, theta[j], free, p)
            if extended and any_of_rare(p[a.VOLTAGE_DELAY]) and 4 * (k + 1) % pieces == 0 and k + 1 < pieces:
                between = _current(m, slow, u.late_end, theta[j], free, p)
                out[j, BETWEEN + 4 * (k + 1) // pieces - 1] = a.terminal_voltage(between, m.w, slow.h, p)
        if extended:
            limit = p[a.INTEGRATOR_LIMIT]
            clamped = where_above(m.I, limit, limit, where_above(-limit, m.I, -limit, m.I))
            m = plant.Motion(m.w, clamped, m.x, m.d, m.inner)
            slow = plant.settled(slow, i, dt, t[j + 1], p)
        mass = m.x - plant.in_play(m.x - mass, p)


@inlined
def _current(m, slow, late, theta, free, p):
    """Current of the motor as it moves, or rests [A]."""
    load = plant.applied(copysign(1.0, m.w), m, slow, plant.driving(m, slow, late, p), theta, free, p)
    return plant.motor_current(m.w, m.I, m.inner.c, slow, late, load, abs(m.w), p)


@inlined
def _command(commands, late, j, k, pieces):
    """Command over piece k of the interval from sample j on."""
    first, middle, last = k / pieces, (k + 0.5) / pieces, (k + 1.0) / pieces
    return plant.Command(
        _within(commands, j, first), _within(commands, j, middle), _within(commands, j, last),
        _within(late, j, first), _within(late, j, middle), _within(late, j, last),
    )  # fmt: skip


@uncounted
def run(t, commands, late, fine, theta, p, start, out, steps=2):
    """States at every sample time, open loop from `start`.

    t: (n,) s. commands, late: (n, 4) the command, and the command as the proportional path sees it, at the quarters
    of the interval from each sample on [rad/s]. fine: (n,) whether that interval needs `steps` steps, a multiple of
    four or two. theta: (n,) deg. p: parameter vector. start: one number each of `STATES`. out: (n, COLUMNS), the
    states, the motor current, and the terminal voltage at the quarters of the interval where something asks for it.
    """
    _run(t, commands, late, fine, theta, p, p, start, out, steps)


@uncounted
def run_lanes(t, commands, late, fine, theta, p, pace, start, out, steps=2):
    """As `run` for LANES parameter vectors at once, alike in `paced`: p (VECTOR_SIZE, L), start and out with L lanes behind.

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
def _within(commands, j, share):
    """Command at a share of the interval from sample j on: a parabola over each half, exact in its integral [rad/s]."""
    k = 0 if share < 0.5 else 2
    u = 2.0 * share - 0.5 * k
    left, middle = commands[j, k], commands[j, k + 1]
    right = commands[j, 2] if k == 0 else commands[j + 1, 0]
    return left + u * (4.0 * middle - 3.0 * left - right + 2.0 * u * (left - 2.0 * middle + right))


@uncounted
def readings(t, states, p, out):
    """What the sensors show: voltage [V], current [A], position [m], with their delays, lags, gains and offsets.

    t: (n,) s. states: (n, COLUMNS) from `run`. out: (n, 3). Lags and delays are exact for signals linear between samples.
    """
    n = t.size
    extended = p[a.EXTENDED] != 0.0
    seen = states[0, MASS]
    for j in range(n):
        i = states[j, CURRENT]
        out[j, 0] = a.terminal_voltage(i, states[j, W], states[j, H], p)
        out[j, 1] = a.current_reading(i, p) if extended else i
        out[j, 2] = states[j, MASS]
    if not extended:
        return
    if p[a.POSITION_LAG] > 0.0:
        for j in range(1, n):
            dt = t[j] - t[j - 1]
            slope = (states[j, MASS] - states[j - 1, MASS]) / dt
            keep = math.exp(-dt / p[a.POSITION_LAG])
            seen = (
                states[j, MASS]
                - slope * p[a.POSITION_LAG]
                + keep * (seen - states[j - 1, MASS] + slope * p[a.POSITION_LAG])
            )
            out[j, 2] = seen
    if p[a.POSITION_DELAY] != 0.0:
        _delay(t, out[:, 2], p[a.POSITION_DELAY])
    for j in range(n):
        out[j, 2] = a.sensed_position(out[j, 2], p)
    if p[a.VOLTAGE_DELAY] != 0.0:
        _delay_voltage(t, states, p[a.VOLTAGE_DELAY], out)
    for j in range(n):
        out[j, 0] += p[a.VOLTAGE_OFFSET]


@uncounted
def age(t, states, late, ages, p, out):
    """Voltage and current of `readings` where a sampled servo holds its current: as it was set so long before a sample.

    late: (n, 4) the command as the proportional path sees it, at the quarters of the interval from each sample on [rad/s]. ages:
    (n,) s, negative where it was set later. Set is what was asked for; what the supply limits is limited when it is read. The
    current of a servo that lags is taken as linear between samples.
    """
    n = t.size
    for j in range(n):
        if ages[j] == 0.0 or n < 2:
            continue
        if p[a.CURRENT_LAG] > 0.0:
            change = _earlier(t, states[:, CURRENT], j, ages[j]) - states[j, CURRENT]
        else:
            change = _set_before(t, states, late, j, ages[j], p)
        i, w, h = states[j, CURRENT], states[j, W], states[j, H]
        out[j, 0] += a.terminal_voltage(i + change, w, h, p) - a.terminal_voltage(i, w, h, p)
        out[j, 1] += a.current_reading(i + change, p) - a.current_reading(i, p)


@uncounted
def _set_before(t, states, late, j, before, p):
    """By how much the current of sample j is another one if it is held since a time `before` it [A]."""
    w, integral = states[j, W], states[j, I]
    by_w = _slope(t, states[:, W], j)
    asked = a.command_current(w, integral, late[j, 0], p) + p[a.KP] * p[a.SERVO_DELAY] * by_w
    then = asked + p[a.KP] * (_command_before(t, late, j, before) - late[j, 0] + by_w * before)
    then -= p[a.KI] * (late[j, 0] - w) * before
    slow = plant.on_the_clock(plant.Slow(states[j, H], states[j, SAG], 0.0, 0.0), t[j], p)
    h, sag = slow.h, slow.sag + slow.drift
    held = a.limited_current(a.passed_current(then, p), w, h, sag, p)
    return held - a.limited_current(a.passed_current(asked, p), w, h, sag, p)


@uncounted
def _command_before(t, late, j, before):
    """The command so long before sample j, linear between the quarters of the intervals beside it."""
    k = j - 1 if before > 0.0 else j
    if k < 0 or k + 1 >= t.size:
        return late[j, 0]
    place = 4.0 * min(abs(before) / (t[k + 1] - t[k]), 1.0)
    q = min(int(place), 3)
    if before > 0.0:
        q = 3 - q
        left, right = late[k, q], late[j, 0] if q == 3 else late[k, q + 1]
        return right + (place - int(place) if place < 4.0 else 1.0) * (left - right)
    left, right = late[k, q], late[k + 1, 0] if q == 3 else late[k, q + 1]
    return left + (place - q) * (right - left)


@uncounted
def _slope(t, y, j):
    """dy/dt at sample j of the parabola through it and those beside it."""
    if j == 0 or j + 1 == t.size:
        k = max(j - 1, 0)
        return (y[k + 1] - y[k]) / (t[k + 1] - t[k])
    back, on = t[j] - t[j - 1], t[j + 1] - t[j]
    return ((y[j + 1] - y[j]) / on * back + (y[j] - y[j - 1]) / back * on) / (back + on)


@uncounted
def _earlier(t, y, j, by):
    """y so long before sample j, on the line to the sample beside it."""
    k = j - 1 if by > 0.0 else j
    if k < 0 or k + 1 >= t.size:
        return y[j]
    return y[j] - by * (y[k + 1] - y[k]) / (t[k + 1] - t[k])


@uncounted
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


@uncounted
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
