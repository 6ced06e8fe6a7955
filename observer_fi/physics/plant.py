"""One step of the plant: what the simulation, the bank, the fits and the force-driven checks share.

The states of a plant are named: `Motion` moves with the motor and is integrated by one of the rules `runge_kutta`,
`midpoint` and `sampled_force`; `Slow` follows at the end of a step. What of a motion nobody outside asks for is `Inner`: others
hand it on, or keep it in arrays by `inner_in` and `inner_into`. All rules call the same rates, and `step` cuts a step in
which the motor stops or turns (Karnopp): the speed is cut where it passes zero, and the motor rests while friction holds it.

Letters as in `equations.py`; numbers, or rows of them. Adding a state is one entry of `Inner` or of `Slow` in this file: all
that other modules know of these is how many numbers they are.
"""

from typing import Any, NamedTuple

from observer_fi.numerics import any_of, any_of_rare, exp, inlined, uncounted, where_above, zeros_like
from observer_fi.physics import equations as a

SIGN_LENGTH = 2e-6  # m over which the friction of a reversal builds up; far below what the logs resolve


class Inner(NamedTuple):
    """States of a motion that nobody estimates: motor angle phi [rad], current c behind the lag of the servo [A]."""

    phi: Any
    c: Any


class Motion(NamedTuple):
    """States that move with the motor: speed w [rad/s], error integral I [rad], position x [m], indentation d of a stop [m]."""

    w: Any
    I: Any  # noqa: E741
    x: Any
    d: Any
    inner: Inner


class Slow(NamedTuple):
    """States that a step holds: relative rise h of the winding's resistance [1], sag [V] of the supply and its drift [V], and
    the relative rise of the friction of cold grease [1].
    """

    h: Any
    sag: Any
    drift: Any
    cold: Any


class Command(NamedTuple):
    """Commanded speed at start, middle and end of a step; `late`: as the proportional path sees it [rad/s].

    For `midpoint` the middle is the mean over the step.
    """

    start: Any
    middle: Any
    end: Any
    late_start: Any
    late_middle: Any
    late_end: Any


class Free(NamedTuple):
    """Disturbances that no cause explains: torque against the motor [N m], speed of the mass [m/s]."""

    torque: Any
    rate: Any


INNER, SLOW = len(Inner._fields), len(Slow._fields)


@inlined
def inner_at(phi, c):
    """`Inner` of a motor that begins at an angle, with a current."""
    return Inner(phi, c)


@inlined
def inner_in(row, first):
    """`Inner` of INNER numbers of an array."""
    return Inner(row[first], row[first + 1])


@inlined
def inner_into(row, first, inner):
    """`Inner` into an array."""
    row[first], row[first + 1] = inner.phi, inner.c


@inlined
def slow_in(row, first):
    """`Slow` of SLOW numbers of an array."""
    return Slow(row[first], row[first + 1], row[first + 2], row[first + 3])


@inlined
def slow_into(row, first, slow):
    """`Slow` into an array."""
    row[first], row[first + 1], row[first + 2], row[first + 3] = slow.h, slow.sag, slow.drift, slow.cold


# --- rates ---------------------------------------------------------------------------------------


@inlined
def motion_command(w, I, c, late, p):
    """Equation 3 behind the dead zone, or the lagged current c in its place where the servo lags [A]. late: command [rad/s]."""
    i_cmd = a.passed_current(a.command_current(w, I, late, p), p)
    if any_of_rare(p[a.EXTENDED]):
        i_cmd = where_above(p[a.CURRENT_LAG], 0.0, c, i_cmd)
    return i_cmd


@inlined
def motor_current(w, I, c, slow, late, torque, moving, p):
    """Motor current: equations 3 to 6 through the servo's delay and lag [A].

    torque: applied torque, which a delayed servo feels while moving (1, else 0) [N m].
    """
    i_cmd = a.command_current(w, I, late, p)
    if any_of_rare(p[a.EXTENDED]):
        if any_of_rare(p[a.SERVO_DELAY]):
            i_cmd = where_above(moving, 0.0, a.late_current(i_cmd, torque, p), i_cmd)
        i_cmd = a.passed_current(i_cmd, p)
        i_cmd = where_above(p[a.CURRENT_LAG], 0.0, c, i_cmd)
    i = a.limited_current(i_cmd, w, slow.h, slow.sag + slow.drift, p)
    return behind_limit(i, c, p)


@inlined
def behind_limit(i, c, p):
    """The lagged current c where the current itself lags, else i [A]."""
    if any_of_rare(p[a.EXTENDED]):
        i = where_above(p[a.CURRENT_LAG] * p[a.LAG_BEHIND_LIMIT], 0.0, c, i)
    return i


@inlined
def lag_goal(i_cmd, w, slow, p):
    """What the lagged current tends to: the command, or what the supply allows of it where the current itself lags [A]."""
    i_cmd = a.passed_current(i_cmd, p)
    allowed = a.limited_current(i_cmd, w, slow.h, slow.sag + slow.drift, p)
    return where_above(abs(p[a.LAG_BEHIND_LIMIT]), 0.0, allowed, i_cmd)


@inlined
def lag_time(p):
    """Time constant of the servo's lag, 1 s where there is none and nobody asks [s]."""
    return where_above(p[a.CURRENT_LAG], 0.0, p[a.CURRENT_LAG], 1.0)


@inlined
def lagged(c, goal, t, p):
    """The lagged current after a time t of a goal that stays; c where nothing lags [A]."""
    return where_above(p[a.CURRENT_LAG], 0.0, goal + (c - goal) * exp(-t / lag_time(p)), c)


@inlined
def winding_up(change, I, p):
    """`change` of the error integral I, or 0 where it would leave the clamp of the servo further behind (anti-windup)."""
    if any_of_rare(p[a.EXTENDED]):
        change = where_above(change * I, 0.0, where_above(p[a.INTEGRATOR_LIMIT], abs(I), change, 0.0), change)
    return change


@inlined
def driving(m, slow, late, p):
    """Torque of the motor where friction asks for it, else 0 [N m]; the delay of a servo is left out there."""
    drive = zeros_like(m.w)
    if any_of_rare(p[a.EXTENDED]) and any_of_rare(p[a.TORQUE_FRICTION]):
        drive = p[a.KM] * motor_current(m.w, m.I, m.inner.c, slow, late, drive, 0.0, p)
    return drive


@inlined
def free_load(s, free, p):
    """The free torque against a motor that moves in direction s [N m]: a load, or friction where it is `rubbing`."""
    return free.torque * (1.0 + p[a.RUBBING] * (s - 1.0))


@inlined
def applied(s, m, slow, drive, theta, free, p):
    """Torque against the motor that moves in direction s, driven by `drive` (equations 7, 11, 13) [N m]."""
    torque = a.applied_torque(s, m.w, m.x, m.d, m.inner.phi, theta, p) + free_load(s, free, p)
    if any_of_rare(p[a.EXTENDED]):
        torque += s * slow.cold * a.coulomb_friction(p)
        if any_of_rare(p[a.TORQUE_FRICTION]):
            torque += s * a.transmission_loss(s, drive, torque, p)
    return torque


@inlined
def mass_rate(m, load, free, p):
    """Speed of the mass (equations 8, 10, 12) [m/s]."""
    return a.mass_speed(m.w, m.d, load, p) + free.rate


@inlined
def rates(s, m, slow, now, late, theta, free, p):
    """Rates of every state of `Motion`. s: sign of motion; now, late: command [rad/s]; theta: pitch [deg]."""
    load = applied(s, m, slow, driving(m, slow, late, p), theta, free, p)
    dw = a.acceleration(motor_current(m.w, m.I, m.inner.c, slow, late, load, 1.0, p), load, p)
    dx, dc = mass_rate(m, load, free, p), zeros_like(m.w)
    if any_of_rare(p[a.EXTENDED]) and any_of_rare(p[a.CURRENT_LAG]):
        i_cmd = a.command_current(m.w, m.I, late, p) + p[a.KP] * p[a.SERVO_DELAY] * dw
        gap = lag_goal(i_cmd, m.w, slow, p) - m.inner.c
        dc = where_above(p[a.CURRENT_LAG], 0.0, gap / lag_time(p), 0.0)
    in_contact = where_above(abs(p[a.CONTACT]), 0.0, 1.0, 0.0)
    return Motion(dw, winding_up(now - m.w, m.I, p), dx, in_contact * dx, Inner(m.w, dc))


@inlined
def breakaway(m, slow, late, theta, free, p):
    """Sign in which the drive overcomes friction at rest, 0 where friction holds."""
    still = zeros_like(m.I)
    push = p[a.KM] * motor_current(still, m.I, m.inner.c, slow, late, still, 0.0, p)
    hold = a.friction(still, m.x, theta, p) + slow.cold * a.coulomb_friction(p)
    hold += a.transmission_loss(still, push, push, p) + p[a.RUBBING] * free.torque
    push = push - a.load_torque(still, m.x, m.d, m.inner.phi, theta, p) - free_load(still, free, p)
    asymmetry = p[a.FRICTION_ASYMMETRY]
    return where_above(push, asymmetry + hold, 1.0, where_above(asymmetry - hold, push, -1.0, still))


# --- sums of states ------------------------------------------------------------------------------


@inlined
def moved(m, t, r):
    """m + t r."""
    inner = Inner(m.inner.phi + t * r.inner.phi, m.inner.c + t * r.inner.c)
    return Motion(m.w + t * r.w, m.I + t * r.I, m.x + t * r.x, m.d + t * r.d, inner)


@inlined
def between(m, later, share, w):
    """A share of the way from m to later, with the speed w."""
    left, a0, a1 = 1.0 - share, m.inner, later.inner
    inner = Inner(left * a0.phi + share * a1.phi, left * a0.c + share * a1.c)
    return Motion(
        w, left * m.I + share * later.I, left * m.x + share * later.x, left * m.d + share * later.d, inner
    )


# --- rules: a time t with the sign of motion s held ----------------------------------------------


@inlined
def on_rails(m, p):
    """m with the indentation of the rail's end that x has reached."""
    return Motion(m.w, m.I, m.x, a.indentation(m.x, p), m.inner)


@inlined
def runge_kutta(s, m, slow, t, gone, u, theta, free, p):
    """Fourth order, between the ends of the rails. gone: share of the command's step u that is over."""
    half, v = 0.5 * t, t / 6.0
    start, late = u.start + (u.end - u.start) * gone, u.late_start + (u.late_end - u.late_start) * gone
    first = rates(s, on_rails(m, p), slow, start, late, theta, free, p)
    at = on_rails(moved(m, half, first), p)
    second = rates(s, at, slow, u.middle, u.late_middle, theta, free, p)
    at = on_rails(moved(m, half, second), p)
    third = rates(s, at, slow, u.middle, u.late_middle, theta, free, p)
    at = on_rails(moved(m, t, third), p)
    fourth = rates(s, at, slow, u.end, u.late_end, theta, free, p)
    return on_rails(moved(moved(moved(m, v, first), 2.0 * v, moved(second, 1.0, third)), v, fourth), p)


@inlined
def with_lag(m, c, at, slow, t, late, p):
    """m with the lagged current that c has become after a time t, its goal that of the motion `at` (`late`: command)."""
    if any_of_rare(p[a.EXTENDED]) and any_of_rare(p[a.CURRENT_LAG]):
        c = lagged(c, lag_goal(a.command_current(at.w, at.I, late, p), at.w, slow, p), t, p)
    return Motion(m.w, m.I, m.x, m.d, Inner(m.inner.phi, c))


@inlined
def midpoint(s, m, slow, t, gone, u, theta, free, p):
    """Second order; the indentation of a stop is a state of its own, the lag of the current exact for the goal in the middle.

    At 0.7 ms and 22 Hz its error is 2e-4 of a step's change, far below the noise; docs/decisions has the comparison.
    """
    half = 0.5 * t
    middle = moved(m, half, rates(s, m, slow, u.start, u.late_start, theta, free, p))
    middle = with_lag(middle, m.inner.c, m, slow, half, u.late_start, p)
    later = moved(m, t, rates(s, middle, slow, u.middle, u.late_middle, theta, free, p))
    return with_lag(later, m.inner.c, middle, slow, t, u.late_middle, p)


@inlined
def rested(m, slow, t, u, free, p):
    """m after a time t at which friction held it (0: not at all)."""
    after = Motion(m.w, m.I + winding_up(t * u.middle, m.I, p), m.x + t * free.rate, m.d, m.inner)
    still = Motion(zeros_like(m.w), after.I, after.x, after.d, m.inner)
    return with_lag(after, m.inner.c, still, slow, t, u.late_middle, p)


@inlined
def step(rule, m, slow, t, u, theta, free, p):
    """A time t by a rule, with standstill and changes of direction: `Motion` at its end, 1 where the motor rests, else 0."""
    s, rests = a.sign_of(m.w), zeros_like(m.w)
    if any_of_rare(1.0 - abs(s)):
        return _cut(rule, m, slow, t, u, theta, free, p)
    later = rule(s, m, slow, t, 0.0, u, theta, free, p)
    if any_of_rare(where_above(0.0, later.w * s, 1.0, 0.0)):
        later, rests = _cut(rule, m, slow, t, u, theta, free, p)
    return later, rests


@uncounted
def _cut(rule, m, slow, t, u, theta, free, p):
    """As `step`, cut where the speed passes zero; `left` of it is still to go. Thrown back at once, the motor rests."""
    left, rests = t + zeros_like(m.w), zeros_like(m.w)
    for _ in range(4):
        s = a.sign_of(m.w)
        if any_of(1.0 - abs(s)):
            s = where_above(abs(s), 0.0, s, breakaway(m, slow, u.late_middle, theta, free, p))
            m, left, rests = _held(s, m, slow, left, rests, u, free, p)
            if not any_of(left):
                break
        later = rule(s, m, slow, left, 1.0 - left / t, u, theta, free, p)
        back = -(later.w * s)
        share = where_above(back, 0.0, where_above(abs(m.w), 0.0, m.w / (m.w - later.w), 0.0), 1.0)
        m = between(m, later, share, where_above(back, 0.0, 0.0, later.w))
        left = where_above(back, 0.0, left * (1.0 - share), 0.0)
        left = where_above(left, 1e-9 * t, left, 0.0)
        m, left, rests = _held(share, m, slow, left, rests, u, free, p)
        if not any_of(left):
            break
    return m, rests


@inlined
def _held(moves, m, slow, left, rests, u, free, p):
    """Motion, time left and rest where friction holds the motor for all of it: where nothing `moves`."""
    still = where_above(abs(moves), 0.0, 0.0, left)
    if any_of(still):
        m = rested(m, slow, still, u, free, p)
    return m, left - still, where_above(still, 0.0, 1.0, rests)


# --- what follows at the end of a step -----------------------------------------------------------


@inlined
def settled(slow, i, t, now, p):
    """The slow states after a time t of the current i [A]; now: time at its end on the log's clock [s]."""
    h, sag = slow.h, slow.sag
    if any_of_rare(p[a.EXTENDED]):
        h = h + t * a.heating(i, h, p)
        if any_of_rare(p[a.SAG_RESISTANCE]):
            goal = p[a.SAG_RESISTANCE] * abs(i)
            sag = where_above(
                abs(p[a.SAG_RESISTANCE]), 0.0, goal + (sag - goal) * exp(-t / p[a.SAG_TIME]), sag
            )
    return on_the_clock(Slow(h, sag, slow.drift, slow.cold), now, p)


@inlined
def on_the_clock(slow, now, p):
    """The slow states with those that follow from the time on the log's clock alone, `now` [s]."""
    drift, cold = slow.drift, slow.cold
    if any_of_rare(p[a.EXTENDED]):
        drift = p[a.SUPPLY_DRIFT] * now
        if any_of_rare(p[a.WARMUP_RISE]):
            cold = a.cold_rise(now, p)
    return Slow(slow.h, slow.sag, drift, cold)


@inlined
def in_play(slack, p):
    """How far the screw is ahead of the mass: `slack` as far as the play goes [m]."""
    half = 0.5 * p[a.BACKLASH]
    slack = where_above(slack, half, half, slack)
    return where_above(-half, slack, -half, slack)


@inlined
def lag_behind(behind, travel, t, lag):
    """How far a first-order lag [s] is behind what moved by `travel` at an even rate in a time t."""
    keep = exp(-t / lag)
    return keep * behind + travel * (lag / t) * (1.0 - keep)


# --- a plant that is driven by a force -----------------------------------------------------------


@inlined
def sampled_force(s, m, force, t, theta, p):
    """A time t under a drive force [N], semi-implicit Euler: sign of motion and `Motion` at its end.

    The sign builds up over SIGN_LENGTH of travel.
    """
    free = Free(zeros_like(m.w), zeros_like(m.w))
    warm = Slow(free.torque, free.torque, free.torque, free.torque)
    load = applied(s, m, warm, force * p[a.D], theta, free, p)
    w = m.w + t * ((force * p[a.D] - load) / a.inertia(p))
    faster = Motion(w, m.I, m.x, m.d, m.inner)
    travel = t * mass_rate(faster, load, free, p)
    sign = a.sign_of(travel)
    s = sign + (s - sign) * exp(-abs(travel) / SIGN_LENGTH)
    return s, Motion(w, m.I, m.x + travel, m.d, Inner(m.inner.phi + t * w, m.inner.c))
