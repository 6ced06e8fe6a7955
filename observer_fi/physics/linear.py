"""The plant and its servo linearised around a motion: slopes of what moves w, I and x, of the readings, and a step in time.

Numbers, or rows of them. Used by the filters of the bank, and for small disturbances of simulated moves.
"""

from observer_fi.numerics import any_of_rare, copysign, inlined, where_above, zeros_like
from observer_fi.physics import equations as a
from observer_fi.physics import plant

_SPEED, _PLACE, _TURN = (
    0.5,
    1e-5,
    1e-3,
)  # rad/s, m, rad: steps of the differences that effects are differentiated by
_SCALE = 1e-6  # m: the same for what the position sensor makes of a position


@inlined
def driven(i_cmd, w, slow, p):
    """The current that a commanded one, behind the dead zone, leads to; its slopes by w, I and the limit of the supply."""
    i = a.limited_current(i_cmd, w, slow.h, slow.sag + slow.drift, p)
    by_w, by_I, by_V, short = -p[a.KP], p[a.KI], zeros_like(i), abs(i - i_cmd)
    if any_of_rare(short):
        per_R = 1.0 / (p[a.RM] * (1.0 + slow.h) + p[a.RS])
        by_w, by_I = where_above(short, 0.0, -p[a.KM] * per_R, by_w), where_above(short, 0.0, 0.0, by_I)
        by_V = where_above(short, 0.0, copysign(per_R, i_cmd), by_V)
    return i, by_w, by_I, by_V


@inlined
def _load_of(s, m, slow, w_cmd, theta, free, p):
    return plant.applied(s, m, slow, plant.driving(m, slow, w_cmd, p), theta, free, p)


@inlined
def motion_slopes(m, slow, w_cmd, theta, free, p):
    """What moves w, I and x: d(dw/dt) by w, I, x, d(dx/dt) by w; and current, its slope by the supply, load, 1 / J.

    Friction keeps its sign; effects of the torque are differentiated numerically, everything else exactly.
    """
    s = where_above(m.w, 0.0, 1.0, -1.0)
    i_cmd = a.command_current(m.w, m.I, w_cmd, p)
    i, di_dw, di_dI, di_dV = driven(a.passed_current(i_cmd, p), m.w, slow, p)
    di_dw, di_dI = a.passes(i_cmd, p) * di_dw, a.passes(i_cmd, p) * di_dI
    per_J = 1.0 / a.inertia(p)
    load = _load_of(s, m, slow, w_cmd, theta, free, p)
    by_w, by_I, by_x = p[a.KM] * di_dw * per_J, p[a.KM] * di_dI * per_J, zeros_like(load)
    if any_of_rare(p[a.EXTENDED]):
        faster = plant.Motion(m.w + _SPEED, m.I, m.x, m.d, m.inner)
        farther = plant.Motion(m.w, m.I, m.x + _PLACE, m.d, m.inner)
        by_w -= (_load_of(s, faster, slow, w_cmd, theta, free, p) - load) / _SPEED * per_J
        by_x -= (_load_of(s, farther, slow, w_cmd, theta, free, p) - load) / _PLACE * per_J
        if any_of_rare(p[a.TORQUE_FRICTION]):
            pulled = plant.Motion(m.w, m.I + _TURN, m.x, m.d, m.inner)
            by_I -= (_load_of(s, pulled, slow, w_cmd, theta, free, p) - load) / _TURN * per_J
    return by_w, by_I, by_x, a.mass_speed(1.0 + zeros_like(m.w), m.d, load, p), i, di_dV, load, per_J


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
    """What a constant does to w in a step, from its slopes."""
    half = 0.5 * t * t
    return w_slope * (t + half * by_w) + x_slope * (half * (by_x + by_d))


@inlined
def electrical_readings(w, I, c, slow, w_cmd, p, supply):
    """Voltage and current, and their slopes by w, I and the factor of the supply, whose voltage without it is `supply`.

    Equation 15 for the voltage before its sensor, equation 6 for the current as shown.
    """
    i_cmd = plant.motion_command(w, I, c, w_cmd, p)
    if any_of_rare(p[a.EXTENDED]) and any_of_rare(p[a.LAG_BEHIND_LIMIT]):
        i_cmd = where_above(
            abs(p[a.LAG_BEHIND_LIMIT]), 0.0, a.passed_current(a.command_current(w, I, w_cmd, p), p), i_cmd
        )
    i, di_dw, di_dI, di_dV = driven(i_cmd, w, slow, p)
    through = a.passes(a.command_current(w, I, w_cmd, p), p)
    di_dw, di_dI = through * di_dw, through * di_dI
    i, di_dV = plant.behind_limit(i, c, p), di_dV * supply
    resistance = p[a.RM] * (1.0 + slow.h)
    V, shown, gain = a.terminal_voltage(i, w, slow.h, p), i, 1.0 + zeros_like(w)
    if any_of_rare(p[a.EXTENDED]):
        shown, gain = a.current_reading(i, p), p[a.CURRENT_GAIN]
    return (
        (V, resistance * di_dw + p[a.KM], resistance * di_dI, resistance * di_dV),
        (shown, gain * di_dw, gain * di_dI, gain * di_dV),
    )


@inlined
def sensed_position(seen, p):
    """What the position sensor shows of what has come through its lag and delay [m], and its slope."""
    shown, gain = seen, 1.0 + zeros_like(seen)
    if any_of_rare(p[a.EXTENDED]):
        shown = a.sensed_position(seen, p)
        gain = (a.sensed_position(seen + _SCALE, p) - shown) / _SCALE
    return shown, gain
