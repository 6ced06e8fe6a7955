"""The equations of the actuator, once.

Kemp and Martin, "Fault isolation of an electro-mechanical linear actuator": equations 1 to 13, as settled in
docs/equations.md, with every named effect of `effects.py` standing in them at a neutral default.

Letters: w motor speed [rad/s], I error integral [rad], x mass position [m], d indentation of a stop [m, signed],
i current [A], theta pitch as its sensor shows it [deg], w_cmd commanded speed [rad/s], s sign of motion in [-1, 1], phi motor
angle [rad], h relative rise of the winding resistance [1], sag drop of the supply [V], p parameter vector in the order of
`PARAMETERS`, SI units (torque in N m, pitch in degrees).

Every function takes and returns numbers, so that numba can compile it and plain Python can run it; or rows of numbers
(`rows.py`), one of each log side by side. A branch is only a short cut: `any_of_rare` asks whether any log needs what follows,
which changes nothing for the others.
"""

import math

from observer_fi.numerics import (
    any_of_rare,
    copysign,
    cos,
    exp,
    floor,
    inlined,
    maximum,
    sin,
    tanh,
    where_above,
    zeros_like,
)

# name: (unit, neutral value or None for the sixteen of Table 1 that every rig gives)
PARAMETERS: dict[str, tuple[str, float | None]] = {
    "Rm": ("ohm", None),
    "Km": ("N m/A", None),
    "D": ("m/rad", None),
    "Vmax": ("V", None),
    "Kp": ("A s/rad", None),
    "Ki": ("A/rad", None),
    "J": ("kg m^2", None),
    "A": ("N m", None),
    "B": ("N m/deg", None),
    "Rs": ("ohm", None),
    "C": ("N m/m^2", None),
    "E": ("1", None),
    "A_decoupled": ("N m", None),
    "J_decoupled": ("kg m^2", None),
    "accel_cmd": ("rad/s^2", None),
    # where the rails end; and the switches that make a fault of a plant; rubbing: a free torque turns with the motion
    "x_stop_high": ("m", math.inf),
    "x_stop_low": ("m", -math.inf),
    "coupling": ("1", 1.0),
    "contact": ("1", 0.0),
    "rubbing": ("1", 0.0),
    # torque
    "viscous_positive": ("N m s/rad", 0.0),
    "viscous_negative": ("N m s/rad", 0.0),
    "stribeck_torque": ("N m", 0.0),
    "stribeck_speed": ("rad/s", 30.0),
    "saturating_drag": ("N m", 0.0),
    "saturation_speed": ("rad/s", 30.0),
    "friction_asymmetry": ("N m", 0.0),
    "load_friction": ("1", 0.0),
    "warmup_rise": ("1", 0.0),
    "warmup_time": ("s", 60.0),
    "torque_friction": ("1", 0.0),
    "rotor_share": ("1", 0.0),
    "friction_slope": ("N m/m", 0.0),
    "friction_curvature": ("N m/m^2", 0.0),
    "friction_bump": ("N m", 0.0),
    "bump_position": ("m", 0.0),
    "bump_width": ("m", 2e-4),
    "shaft_ripple_sin": ("N m", 0.0),
    "shaft_ripple_cos": ("N m", 0.0),
    "shaft_order": ("1", 1.0),
    "gear_ripple_sin": ("N m", 0.0),
    "gear_ripple_cos": ("N m", 0.0),
    "gear_order": ("1", 0.5),
    "screw_ripple_sin": ("N m", 0.0),
    "screw_ripple_cos": ("N m", 0.0),
    "screw_lead": ("m", 1e-3),
    "gravity_cubic": ("N m/deg^3", 0.0),
    "gravity_quadratic": ("N m/deg^2", 0.0),
    "gravity_cosine": ("1", 0.0),
    "torque_offset": ("N m", 0.0),
    # electrical
    "heating_gain": ("1/J", 0.0),
    "heating_rise": ("1", 0.0),
    "heating_time": ("s", 60.0),
    "brush_drop": ("V", 0.0),
    "brush_current": ("A", 2e-3),
    "sag_resistance": ("ohm", 0.0),
    "sag_time": ("s", 0.1),
    "supply_drift": ("V/s", 0.0),
    # servo
    "servo_delay": ("s", 0.0),
    "tick_phase": ("s", 0.0),
    "tick_share": ("1", 0.0),
    "current_lag": ("s", 0.0),
    "lag_behind_limit": ("1", 0.0),
    "input_delay": ("s", 0.0),
    "dead_zone": ("A", 0.0),
    "zone_step": ("1", 0.0),
    "integrator_limit": ("rad", math.inf),
    "accel_limit": ("rad/s^2", math.inf),
    "accel_ahead": ("1", 0.0),
    "Kx": ("1/s", 0.0),
    "x_window": ("m", 0.0),
    # kinematics
    "backlash": ("m", 0.0),
    "slip": ("1", 0.0),
    "slip_per_torque": ("1/(N m)", 0.0),
    # contact
    "contact_exponent": ("1", 2.0),
    "contact_damping": ("N m s/(rad m)", 0.0),
    "contact_drag": ("N m s/rad", 0.0),
    # sensors
    "position_lag": ("s", 0.0),
    "position_delay": ("s", 0.0),
    "position_gain": ("1", 1.0),
    "position_sin": ("m", 0.0),
    "position_cos": ("m", 0.0),
    "position_period": ("m", 1e-3),
    "current_offset": ("A", 0.0),
    "current_gain": ("1", 1.0),
    "voltage_delay": ("s", 0.0),
    "voltage_offset": ("V", 0.0),
    "pitch_offset": ("deg", 0.0),
    # an empirical curve for what no cause explains: of which equation, over what, its points and values
    "curve_of": ("1", 0.0),
    "curve_over": ("1", 0.0),
    "curve_first": ("1", 0.0),
    "curve_step": ("1", 1.0),
    "curve_last": ("1", 1.0),
} | {f"curve_{k:02d}": ("1", 0.0) for k in range(32)}
NAMES = tuple(PARAMETERS)
INDEX = {name: k for k, name in enumerate(NAMES)}
# One slot behind the parameters: 1 where any effect is away from its neutral value, so that a plain plant pays nothing.
EXTENDED = len(NAMES)
VECTOR_SIZE = len(NAMES) + 1

(
    RM,
    KM,
    D,
    VMAX,
    KP,
    KI,
    J,
    A,
    B,
    RS,
    C,
    E,
    A_DECOUPLED,
    J_DECOUPLED,
    ACCEL_CMD,
    X_STOP_HIGH,
    X_STOP_LOW,
    COUPLING,
    CONTACT,
    RUBBING,
    VISCOUS_POSITIVE,
    VISCOUS_NEGATIVE,
    STRIBECK_TORQUE,
    STRIBECK_SPEED,
    SATURATING_DRAG,
    SATURATION_SPEED,
    FRICTION_ASYMMETRY,
    LOAD_FRICTION,
    WARMUP_RISE,
    WARMUP_TIME,
    TORQUE_FRICTION,
    ROTOR_SHARE,
    FRICTION_SLOPE,
    FRICTION_CURVATURE,
    FRICTION_BUMP,
    BUMP_POSITION,
    BUMP_WIDTH,
    SHAFT_RIPPLE_SIN,
    SHAFT_RIPPLE_COS,
    SHAFT_ORDER,
    GEAR_RIPPLE_SIN,
    GEAR_RIPPLE_COS,
    GEAR_ORDER,
    SCREW_RIPPLE_SIN,
    SCREW_RIPPLE_COS,
    SCREW_LEAD,
    GRAVITY_CUBIC,
    GRAVITY_QUADRATIC,
    GRAVITY_COSINE,
    TORQUE_OFFSET,
    HEATING_GAIN,
    HEATING_RISE,
    HEATING_TIME,
    BRUSH_DROP,
    BRUSH_CURRENT,
    SAG_RESISTANCE,
    SAG_TIME,
    SUPPLY_DRIFT,
    SERVO_DELAY,
    TICK_PHASE,
    TICK_SHARE,
    CURRENT_LAG,
    LAG_BEHIND_LIMIT,
    INPUT_DELAY,
    DEAD_ZONE,
    ZONE_STEP,
    INTEGRATOR_LIMIT,
    ACCEL_LIMIT,
    ACCEL_AHEAD,
    KX,
    X_WINDOW,
    BACKLASH,
    SLIP,
    SLIP_PER_TORQUE,
    CONTACT_EXPONENT,
    CONTACT_DAMPING,
    CONTACT_DRAG,
    POSITION_LAG,
    POSITION_DELAY,
    POSITION_GAIN,
    POSITION_SIN,
    POSITION_COS,
    POSITION_PERIOD,
    CURRENT_OFFSET,
    CURRENT_GAIN,
    VOLTAGE_DELAY,
    VOLTAGE_OFFSET,
    PITCH_OFFSET,
    CURVE_OF,
    CURVE_OVER,
    CURVE_FIRST,
    CURVE_STEP,
    CURVE_LAST,
    CURVE,
) = range(INDEX["curve_00"] + 1)
MOST_POINTS = len(NAMES) - CURVE
# What a curve adds to, and over what it runs: the codes of curve_of and curve_over.
TORQUE, DRAG, RESISTANCE, SHOWN_POSITION, SHOWN_CURRENT = 1.0, 2.0, 3.0, 4.0, 5.0
SPEED, POSITION, PITCH, SHAFT_ANGLE, SCREW_ANGLE, CURRENT = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0

DEGREE = math.pi / 180.0
CONTACT_DEPTH = 5e-3  # m, depth at which a changed contact exponent leaves the torque as it was
SHALLOWEST = 1e-9  # m, from which on a power of a depth is taken: far below what any log resolves


@inlined
def is_curve_of(what, p):
    """1 where the empirical curve adds to this, else 0."""
    return is_code(p[CURVE_OF], what)


@inlined
def is_code(given, code):
    """1 where two small whole numbers are the same, else 0."""
    return where_above(0.5, abs(given - code), 1.0, 0.0)


@inlined
def curve_value(r, p):
    """The empirical curve at r: linear between its points, constant beyond them, closed over a turn where r is an angle.

    A sum of hats, one a point; p[CURVE_LAST]: number of intervals. Unit: N m, ohm, m or A, by p[CURVE_OF].
    """
    turns, last = is_code(p[CURVE_OVER], SHAFT_ANGLE) + is_code(p[CURVE_OVER], SCREW_ANGLE), p[CURVE_LAST]
    u = (r - p[CURVE_FIRST]) / p[CURVE_STEP]
    u = where_above(turns, 0.5, u - last * floor(u / last), where_above(u, last, last, maximum(u, 0.0)))
    value = zeros_like(u)
    for k in range(MOST_POINTS):
        away = abs(u - float(k))
        around = abs(last - away)
        away = where_above(turns, 0.5, where_above(away, around, around, away), away)
        value += p[CURVE + k] * maximum(1.0 - away, 0.0)
    return value


@inlined
def curve_torque(w, x, phi, theta, p):
    """The empirical curve of a torque: over speed or shaft angle, or over what only moves with the mass [N m]."""
    over = p[CURVE_OVER]
    of_motor = is_code(over, SPEED) + is_code(over, SHAFT_ANGLE)
    r = (
        is_code(over, SPEED) * w
        + is_code(over, POSITION) * x
        + is_code(over, PITCH) * (theta - p[PITCH_OFFSET])
    )
    r += is_code(over, SHAFT_ANGLE) * phi + is_code(over, SCREW_ANGLE) * 2.0 * math.pi * x / p[SCREW_LEAD]
    return (of_motor + (1.0 - of_motor) * p[COUPLING]) * curve_value(r, p)


@inlined
def curve_drop(i, w, p):
    """What the empirical curve of a resistance, over speed or current, drops [V]."""
    return curve_value(is_code(p[CURVE_OVER], SPEED) * w + is_code(p[CURVE_OVER], CURRENT) * i, p) * i


@inlined
def sign_of(w):
    """Sign of motion, 0 at rest."""
    return where_above(w, 0.0, 1.0, where_above(0.0, w, -1.0, zeros_like(w)))


@inlined
def command_current(w, I, w_cmd, p):
    """Equation 3: i_cmd = Kp (w_cmd - w) + Ki I [A]."""
    return p[KP] * (w_cmd - w) + p[KI] * I


@inlined
def late_current(i_cmd, torque, p):
    """Equation 3 in a sampled servo, whose proportional path sees the speed `servo_delay` late, while moving [A].

    i = i_cmd + Kp servo_delay dw/dt with equation 1 for dw/dt, solved for i; i_cmd from the late command.
    """
    k = p[KP] * p[SERVO_DELAY] / inertia(p)
    return (i_cmd - k * torque) / (1.0 - k * p[KM])


@inlined
def passed_current(i_cmd, p):
    """What a servo's dead zone lets through: nothing below the threshold, what is beyond it or all of it above [A]."""
    if any_of_rare(p[EXTENDED]) and any_of_rare(p[DEAD_ZONE]):
        taken = copysign((1.0 - p[ZONE_STEP]) * p[DEAD_ZONE], i_cmd)
        i_cmd = where_above(p[DEAD_ZONE], abs(i_cmd), 0.0, i_cmd - taken)
    return i_cmd


@inlined
def passes(i_cmd, p):
    """Slope of `passed_current`: 0 in the dead zone, else 1."""
    return where_above(p[DEAD_ZONE], abs(i_cmd), 0.0, 1.0)


@inlined
def limited_current(i_cmd, w, h, sag, p):
    """Equations 5 and 6: the commanded current, unless the supply's +-Vmax cannot drive it [A]."""
    R = p[RM] * (1.0 + h) + p[RS]
    limit = p[VMAX] - sag
    emf = p[KM] * w
    if any_of_rare(p[EXTENDED]) and any_of_rare(p[BRUSH_DROP]):
        emf += p[BRUSH_DROP] * tanh(i_cmd / p[BRUSH_CURRENT])
    i = driven_current(i_cmd, emf, R, limit)
    if any_of_rare(p[EXTENDED]):
        has_curve = is_curve_of(RESISTANCE, p)
        if any_of_rare(has_curve):
            for _ in range(2):  # the drop is that of the current without it, then of the current with that
                i = driven_current(i_cmd, emf + has_curve * curve_drop(i, w, p), R, limit)
    return i


@inlined
def driven_current(i_cmd, emf, R, limit):
    """Equation 5 solved for the current: the command, or what the limit of the supply leaves over the resistance [A]."""
    V = R * i_cmd + emf
    i = i_cmd
    if any_of_rare(where_above(abs(V), limit, 1.0, 0.0)):
        i = where_above(V, limit, (limit - emf) / R, where_above(-limit, V, (-limit - emf) / R, i))
    return i


@inlined
def terminal_voltage(i, w, h, p):
    """Equation 15 with equation 2: V - Rs i = Rm i + Km w [V]."""
    V = p[RM] * (1.0 + h) * i + p[KM] * w
    if any_of_rare(p[EXTENDED]) and any_of_rare(p[BRUSH_DROP]):
        V += p[BRUSH_DROP] * tanh(i / p[BRUSH_CURRENT])
    if any_of_rare(p[EXTENDED]):
        has_curve = is_curve_of(RESISTANCE, p)
        if any_of_rare(has_curve):
            V += has_curve * curve_drop(i, w, p)
    return V


def speed_behind_readings(V, i, p):
    """Equation 16: (V - Rm i) / Km [rad/s], less what the brushes drop; of numbers or arrays."""
    behind = V - p[RM] * i
    if any_of_rare(p[EXTENDED]) and any_of_rare(p[BRUSH_DROP]):
        behind = behind - p[BRUSH_DROP] * tanh(i / p[BRUSH_CURRENT])
    return behind / p[KM]


measured_speed = inlined(speed_behind_readings)


@inlined
def friction(w, x, theta, p):
    """Friction torque for motion at full slip, without its sign [N m] (A of equation 7, A' of equation 13)."""
    drag = coulomb_friction(p)
    if any_of_rare(p[EXTENDED]):
        if any_of_rare(p[STRIBECK_TORQUE]):
            ratio = w / p[STRIBECK_SPEED]
            drag += p[STRIBECK_TORQUE] * exp(-ratio * ratio)
        if any_of_rare(p[SATURATING_DRAG]):  # a lubricant that shears thin
            drag += p[SATURATING_DRAG] * tanh(abs(w) / p[SATURATION_SPEED])
        pitch = theta - p[PITCH_OFFSET]
        along = p[LOAD_FRICTION] * abs(p[B] * pitch) + (p[FRICTION_SLOPE] + p[FRICTION_CURVATURE] * x) * x
        if any_of_rare(p[FRICTION_BUMP]):
            off = (x - p[BUMP_POSITION]) / p[BUMP_WIDTH]
            along += p[FRICTION_BUMP] * exp(-off * off)
        if any_of_rare(p[GRAVITY_COSINE]):
            along += p[GRAVITY_COSINE] * p[A] * (cos(DEGREE * pitch) - 1.0)
        drag += p[COUPLING] * along
        has_curve = is_curve_of(DRAG, p)
        if any_of_rare(has_curve):
            drag += has_curve * curve_torque(w, x, zeros_like(x), theta, p)
    return maximum(drag, 0.0)


@inlined
def coulomb_friction(p):
    """A, or A' with the mass decoupled (equation 12) [N m]."""
    return p[COUPLING] * p[A] + (1.0 - p[COUPLING]) * p[A_DECOUPLED]


@inlined
def cold_rise(now, p):
    """Relative rise of the Coulomb friction of a rig whose grease is cold as its log begins [1]; now: on the log's clock [s]."""
    return p[WARMUP_RISE] * exp(-now / p[WARMUP_TIME])


@inlined
def transmission_loss(s, drive, torque, p):
    """What a gear loses of the torque T that it transmits, k |T|, against motion [N m].

    drive: torque of the motor; torque: all that it works against, without this loss. The rotor's share r of the inertia does not
    pass through the gear: T = drive - r J dw/dt, solved for T with equation 1. At rest T is the drive.
    """
    k, r = p[TORQUE_FRICTION], p[ROTOR_SHARE]
    passed = (1.0 - r) * drive + r * torque
    return k * abs(passed) / (1.0 - k * r * s * sign_of(passed))


@inlined
def stop_torque(w, d, p):
    """Restoring torque of a stop, C d^2 against the indentation (equation 11, mirrored) [N m].

    A filter may have C below zero for a while: the torque is that of its size, with or without other effects, or the filter would
    see none and stay there.
    """
    torque = zeros_like(p[C] * d)
    if any_of_rare(d):
        depth = abs(d)
        torque = abs(p[C]) * depth * depth
        if any_of_rare(p[EXTENDED]):
            if any_of_rare(p[CONTACT_EXPONENT] - 2.0):
                torque *= _law_of_depth(depth, p)
            torque += (p[CONTACT_DAMPING] * depth + p[CONTACT_DRAG]) * w * copysign(1.0, d)
            torque = where_above(depth, 0.0, maximum(torque, 0.0), 0.0)  # a stop pushes and never pulls
        torque = copysign(torque, d)
    return torque


@inlined
def _law_of_depth(depth, p):
    """What an exponent n other than 2 makes of the torque of a stop: (d / CONTACT_DEPTH)^(n - 2)."""
    return (maximum(depth, SHALLOWEST) / CONTACT_DEPTH) ** (p[CONTACT_EXPONENT] - 2.0)


@inlined
def stop_stiffness(d, p):
    """Slope of the stop's torque by the indentation d, n C d^(n - 1) [N m/m]; damping is left out."""
    slope = 2.0 * abs(p[C]) * maximum(abs(d), SHALLOWEST)
    if any_of_rare(p[EXTENDED]) and any_of_rare(p[CONTACT_EXPONENT] - 2.0):
        slope *= 0.5 * p[CONTACT_EXPONENT] * _law_of_depth(abs(d), p)
    return slope


@inlined
def load_torque(w, x, d, phi, theta, p):
    """The part of the applied torque that has no friction sign: gravity, stops, viscous drag, ripple [N m]."""
    torque = p[COUPLING] * p[B] * theta + stop_torque(w, d, p)
    if any_of_rare(p[EXTENDED]):
        pitch = theta - p[PITCH_OFFSET]
        torque += p[COUPLING] * (
            (p[GRAVITY_QUADRATIC] * abs(pitch) + p[GRAVITY_CUBIC] * pitch * pitch) * pitch
            - p[B] * p[PITCH_OFFSET]
        )
        torque += where_above(w, 0.0, p[VISCOUS_POSITIVE], p[VISCOUS_NEGATIVE]) * w + p[TORQUE_OFFSET]
        if any_of_rare(p[SHAFT_RIPPLE_SIN]) or any_of_rare(p[SHAFT_RIPPLE_COS]):
            shaft = p[SHAFT_ORDER] * phi
            torque += p[SHAFT_RIPPLE_SIN] * sin(shaft) + p[SHAFT_RIPPLE_COS] * cos(shaft)
        if any_of_rare(p[GEAR_RIPPLE_SIN]) or any_of_rare(p[GEAR_RIPPLE_COS]):
            gear = p[GEAR_ORDER] * phi
            torque += p[GEAR_RIPPLE_SIN] * sin(gear) + p[GEAR_RIPPLE_COS] * cos(gear)
        if any_of_rare(p[SCREW_RIPPLE_SIN]) or any_of_rare(p[SCREW_RIPPLE_COS]):
            screw = phi * p[D] * 2.0 * math.pi / p[SCREW_LEAD]
            torque += p[COUPLING] * (p[SCREW_RIPPLE_SIN] * sin(screw) + p[SCREW_RIPPLE_COS] * cos(screw))
        has_curve = is_curve_of(TORQUE, p)
        if any_of_rare(has_curve):
            torque += has_curve * curve_torque(w, x, phi, theta, p)
    return torque


@inlined
def applied_torque(s, w, x, d, phi, theta, p):
    """Equations 7, 11 and 13: friction with the sign of motion s, plus load [N m]."""
    drag = friction(w, x, theta, p)
    if any_of_rare(p[EXTENDED]):
        drag += p[FRICTION_ASYMMETRY] * s
    return s * drag + load_torque(w, x, d, phi, theta, p)


@inlined
def inertia(p):
    """J, or J' with the mass decoupled (equation 12) [kg m^2]."""
    return p[COUPLING] * p[J] + (1.0 - p[COUPLING]) * p[J_DECOUPLED]


@inlined
def acceleration(i, torque, p):
    """Equation 1: (Km i - torque) / J [rad/s^2]; 1 / J is what the calls of one step share."""
    return (p[KM] * i - torque) * (1.0 / inertia(p))


@inlined
def mass_speed(w, d, torque, p):
    """dx/dt: D w (equation 8), D (1 - E) w in contact (equation 10), 0 decoupled (equation 12) [m/s]."""
    rate = p[COUPLING] * p[D] * w
    if any_of_rare(d) or any_of_rare(p[CONTACT]):
        rate *= 1.0 - where_above(abs(d) + abs(p[CONTACT]), 0.0, p[E], 0.0)
    if any_of_rare(p[EXTENDED]):
        rate *= 1.0 - p[SLIP] - p[SLIP_PER_TORQUE] * abs(torque)
    return rate


@inlined
def heating(i, h, p):
    """Rate of the relative resistance rise: gain times loss, and towards heating_rise from outside heat [1/s]."""
    return p[HEATING_GAIN] * p[RM] * i * i + (p[HEATING_RISE] - h) / p[HEATING_TIME]


@inlined
def indentation(x, p):
    """How far the mass is past a stop [m]: positive at the high end, negative at the low end, else 0."""
    high, low = p[X_STOP_HIGH], p[X_STOP_LOW]
    return where_above(x, high, x - high, where_above(low, x, x - low, 0.0))


@inlined
def sensed_position(seen, p):
    """Gain and periodic error of the position sensor, for what has come through its lag and delay [m]."""
    turn = 2.0 * math.pi * seen / p[POSITION_PERIOD]
    reading = p[POSITION_GAIN] * seen + p[POSITION_SIN] * sin(turn) + p[POSITION_COS] * (cos(turn) - 1.0)
    has_curve = is_curve_of(SHOWN_POSITION, p)
    if any_of_rare(has_curve):
        reading += has_curve * curve_value(seen, p)
    return reading


@inlined
def current_reading(i, p):
    """What the current sensor shows of i [A]."""
    reading = p[CURRENT_GAIN] * i + p[CURRENT_OFFSET]
    has_curve = is_curve_of(SHOWN_CURRENT, p)
    if any_of_rare(has_curve):
        reading += has_curve * curve_value(i, p)
    return reading
