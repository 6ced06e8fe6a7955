"""The mass-shifter in fine time steps: DC motor, sampled PI servo, stick-slip, rails with a stop at each end.

All compiled code lives in this one file, because numba's cache does not see changes in other files.
Sign convention: applied torque = load + friction * direction; positive pitch and the upper stop oppose +x.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

CONTACT_REFERENCE_M = 1e-3  # the indentation at which every contact exponent gives the torque of C d^2


class Plant(NamedTuple):
    """Every number of the physics, SI units with pitch in degrees. Defaults are neutral."""

    Rm: float
    Rs: float
    Km: float
    D: float
    Vmax: float
    J: float
    A: float
    B: float
    C: float
    E: float
    stop_low: float
    stop_high: float
    static_ratio: float = 1.0  # break-away friction over sliding friction
    # torque
    viscous_plus: float = 0.0
    viscous_minus: float = 0.0
    stribeck_rise: float = 0.0
    stribeck_speed: float = 50.0
    asymmetry: float = 0.0
    load_ratio: float = 0.0
    gear_loss: float = 0.0  # share of the motor's torque that the gear turns to friction
    friction_gradient: float = 0.0
    warmup: float = 0.0
    warmup_time: float = 5.0
    shaft_amplitude: float = 0.0
    shaft_order: float = 1.0
    shaft_phase: float = 0.0
    screw_amplitude: float = 0.0
    screw_phase: float = 0.0
    screw_ratio: float = 0.0
    gravity_cubic: float = 0.0
    gravity_cosine: float = 0.0
    torque_offset: float = 0.0
    # electrical
    heating: float = 0.0
    cooling_time: float = 30.0
    brush_drop: float = 0.0
    brush_knee: float = 3e-3
    sag_ohm: float = 0.0
    sag_time: float = 0.1
    supply_drift: float = 0.0
    L: float = 0.0  # H, inductance of the winding; the current then rises and falls within current_loop
    current_loop: float = 5e-4  # s, in which the drive closes its current
    # kinematics and contact
    play: float = 0.0
    play_start: float = 1.0
    slip_per_torque: float = 0.0
    contact_exponent: float = 2.0
    contact_damping: float = 0.0
    contact_preload: float = 0.0  # N m, of a spring that was pressed before the mass met it
    # outside the vocabulary of causes
    power_torque: float = 0.0
    bump_peak: float = 0.0
    bump_position: float = 0.0
    bump_width: float = 1e-4
    km_saturation: float = 0.0
    pitch_speed: float = 0.0
    wave_amplitude: float = 0.0
    wave_hz: float = 0.7
    wave_phase: float = 0.0
    km_asymmetry: float = 0.0  # of the torque constant, by the sign of the current
    km_heating: float = 0.0  # 1/J, by which the magnet weakens
    lead_swing: float = 0.0
    lead_period: float = 3.2e-3  # m
    lead_phase: float = 0.0
    lead_heating: float = 0.0  # 1/J
    spring: float = 0.0  # N m/m, of a cable chain
    unbalance: float = 0.0  # N m at 10 deg
    drag_square: float = 0.0
    ageing: float = 0.0  # share of A that friction gains in a long rest
    ageing_time: float = 1.0
    ageing_angle: float = 20.0  # rad, of motion over which it is lost
    lagged_viscous: float = 0.0
    lagged_time: float = 0.02
    winding_ripple: float = 0.0
    winding_bars: float = 7.0  # a turn
    # faults
    shake_amplitude: float = 0.0
    shake_hz: float = 3.0
    shake_start: float = 0.0
    jam: float = 0.0  # friction becomes this many times more than it was, over jam_time from jam_start on
    jam_start: float = 0.0
    jam_time: float = 0.0
    slip: float = 0.0  # share of the travel that the nut loses, over slip_time from slip_start on
    slip_start: float = 0.0
    slip_time: float = 0.0
    stop_here: float = 0.0  # +1 or -1: when this plant takes over, that stop is where the mass is


class Servo(NamedTuple):
    """The sampled PI controller. encoder_step: quantum of the motor angle [rad], 0 = exact speed."""

    Kp: float
    Ki: float
    current_lag: float = 0.0  # s
    integral_limit: float = np.inf  # rad
    dead_zone: float = 0.0  # A
    dead_jump: float = 0.0  # 1: what is above the threshold comes through whole
    leak: float = 0.0  # 1/s, of the integral
    command_step: float = 0.0  # rad/s, in which the servo reads its command
    freeze: float = 0.0  # share of the integration that stops while the supply limits
    kp_error: float = 0.0  # by which Kp grows for 100 rad/s of error
    command_filter: float = 0.0  # s
    encoder_step: float = 0.0
    Kx: float = 0.0  # 1/s, of a position loop around it that sees its encoder; 0 = none
    window: float = 0.0  # rad, within which that loop asks for no speed
    loop_step: float = 0.0  # rad, quantum of its encoder
    speed_filter: float = 2e-3  # s, on the encoder's speed in the proportional path only


class Motion(NamedTuple):
    """What the rig truly did, one row per record. SI units."""

    time: np.ndarray
    source_voltage: np.ndarray
    current: np.ndarray
    position: np.ndarray
    speed: np.ndarray
    angle: np.ndarray
    integral: np.ndarray
    applied_torque: np.ndarray


@njit(cache=True)
def contact_torque(p, stop_low, stop_high, x, w):
    """Eq. 11 at both stops [N m], opposing +x at the upper one. A stop pushes and never pulls."""
    depth, side = x - stop_high, 1.0
    if depth <= 0.0:
        depth, side = stop_low - x, -1.0
    if depth <= 0.0:
        return 0.0
    spring = p.C * CONTACT_REFERENCE_M**2 * (depth / CONTACT_REFERENCE_M) ** p.contact_exponent
    spring += p.contact_preload
    return side * max(0.0, spring + side * p.contact_damping * p.D * (1.0 - p.E) * w)


@njit(cache=True)
def load_torque(p, t, x, w, angle, pitch, contact):
    """Applied torque that does not depend on the direction of motion [N m]."""
    load = p.B * pitch + p.gravity_cubic * pitch**3 + p.torque_offset + contact
    if p.shaft_amplitude != 0.0:
        load += p.shaft_amplitude * np.sin(p.shaft_order * angle + p.shaft_phase)
    if p.screw_amplitude != 0.0:
        load += p.screw_amplitude * np.sin(p.screw_ratio * angle + p.screw_phase)
    if p.bump_peak != 0.0:
        load += p.bump_peak * np.exp(-(((x - p.bump_position) / p.bump_width) ** 2))
    if p.wave_amplitude != 0.0:
        load += p.wave_amplitude * np.sin(2.0 * np.pi * p.wave_hz * t + p.wave_phase)
    if p.shake_amplitude != 0.0:
        load += p.shake_amplitude * np.sin(2.0 * np.pi * p.shake_hz * (t - p.shake_start))
    if p.unbalance != 0.0:
        load += p.unbalance * pitch / 10.0 * np.sin(angle)
    return load + p.spring * x


@njit(cache=True)
def grown(since, time):
    """Share of a fault that grows over `time` [s], `since` seconds after it began: 0 to 1."""
    if since < 0.0:
        return 0.0
    return 1.0 if since >= time else since / time


@njit(cache=True)
def friction_torque(p, t, x, w, direction, pitch, contact, power, aged):
    """Magnitude of the torque that opposes motion in `direction` [N m], never negative. aged: 0 to 1, by rest."""
    friction = p.A * (1.0 + p.asymmetry * direction) + p.friction_gradient * x
    friction += (p.viscous_plus if direction > 0.0 else p.viscous_minus) * abs(w)
    if p.stribeck_rise != 0.0:
        friction += p.stribeck_rise * np.exp(-((w / p.stribeck_speed) ** 2))
    if p.load_ratio != 0.0:
        friction += p.load_ratio * abs(p.B * pitch + contact)
    if p.gravity_cosine != 0.0:
        friction += p.A * p.gravity_cosine * (np.cos(np.radians(pitch)) - 1.0)
    if p.warmup != 0.0:
        friction += p.A * p.warmup * np.exp(-t / p.warmup_time)
    if p.jam != 0.0:
        friction *= 1.0 + p.jam * grown(t - p.jam_start, p.jam_time)
    friction += p.pitch_speed * (pitch * w) ** 2 + p.power_torque * abs(power)
    friction += p.drag_square * w**2 + p.ageing * p.A * aged
    return max(0.0, friction)


@njit(cache=True)
def torque_constant(p, i, heat):
    """Km where the magnet saturates, weakens with heat, or the two ways differ [N m/A]."""
    Km = p.Km * (1.0 - p.km_saturation * abs(i))
    if p.km_asymmetry != 0.0:
        Km *= 1.0 + p.km_asymmetry * np.tanh(i / 1e-3)
    return Km * (1.0 - p.km_heating * heat)


@njit(cache=True)
def resistance(p, angle, heat):
    """Of the warm winding and the source, seen through the bars of the commutator [ohm]."""
    R = p.Rm * (1.0 + p.heating * heat)
    if p.winding_ripple != 0.0:
        R *= 1.0 + p.winding_ripple * np.sin(p.winding_bars * angle)
    return R + p.Rs


@njit(cache=True)
def source_voltage(p, i, w, angle, heat):
    """Eq. 2 with brush drop, a warm winding and a torque constant that is none [V]."""
    V = resistance(p, angle, heat) * i + torque_constant(p, i, heat) * w
    if p.brush_drop != 0.0:
        V += p.brush_drop * np.tanh(i / p.brush_knee)
    return V


@njit(cache=True)
def motor_current(p, wanted, w, angle, heat, limit):
    """Eq. 6: (i [A], Vs [V]), the wanted current or what the supply `limit` [V] allows."""
    V = source_voltage(p, wanted, w, angle, heat)
    if abs(V) <= limit:
        return wanted, V
    V = limit if V > 0.0 else -limit
    if p.brush_drop == 0.0 and p.km_saturation == 0.0 and p.km_asymmetry == 0.0:
        return (V - torque_constant(p, 0.0, heat) * w) / resistance(p, angle, heat), V
    most = max(5.0, 2.0 * (limit + abs(torque_constant(p, 0.0, heat) * w)) / resistance(p, angle, heat))
    low, high = -most, most  # A; Vs rises with i, so bisect
    for _ in range(50):
        middle = 0.5 * (low + high)
        if source_voltage(p, middle, w, angle, heat) < V:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high), V


@njit(cache=True)
def inductive_current(p, h, i, wanted, w, angle, heat, limit):
    """Current [A] and source voltage [V] of a winding with inductance, `h` seconds after it was `i`.

    The drive asks for the voltage that would bring `wanted` within current_loop, and gets what the supply `limit` [V] allows.
    """
    R = p.Rm * (1.0 + p.heating * heat) + p.Rs
    V = source_voltage(p, i, w, angle, heat) + p.L * (wanted - i) / p.current_loop
    V = min(max(V, -limit), limit)
    settled = (V - p.Km * w) / R
    return settled + (i - settled) * np.exp(-h * R / p.L), V


@njit(cache=True)
def forces(p, stops, supply, t, x, w, angle, pitch, past, way):
    """Electrical and mechanical balance at one instant: (i, Vs, load, drive, friction, direction).

    stops: where the lower and the upper one are [m]; supply: (wanted current [A], voltage limit [V]);
    past: (heat in the winding [J], how aged the contact is by rest, speed as a lagging film of grease has it [rad/s]);
    way: direction of travel, 0 = that of the speed, or at rest that in which the drive pulls.
    """
    contact = contact_torque(p, stops[0], stops[1], x, w)
    load = load_torque(p, t, x, w, angle, pitch, contact)
    load += p.lagged_viscous * past[2]
    i, V = motor_current(p, supply[0], w, angle, past[0], supply[1])
    drive = torque_constant(p, i, past[0]) * i - load
    direction = way
    if way == 0.0:
        direction = np.sign(w) if w != 0.0 else np.sign(drive)
    friction = friction_torque(p, t, x, w, direction, pitch, contact, V * i, past[1])
    return i, V, load, drive, friction + p.gear_loss * abs(drive + load), direction


@njit(cache=True)
def advance(p, stops, supply, t, h, body, pitch, past):
    """The body (x, w, angle, gap) `h` seconds later: RK2, cut at every zero crossing of the speed.

    gap is how far the motor is into the play of the coupling [m]. A body that friction holds stays at rest.
    """
    x, w, angle, gap = body
    for _ in range(8):  # slices of one step; a crossing or two is all that happens
        _, _, load, drive, friction, way = forces(p, stops, supply, t, x, w, angle, pitch, past, 0.0)
        if h <= 0.0 or (w == 0.0 and abs(drive) <= p.static_ratio * friction):
            break
        carry = p.D * (1.0 - min(0.9, p.slip_per_torque * abs(load + way * friction)))
        carry *= 1.0 + p.lead_heating * past[0]
        if p.lead_swing != 0.0:
            carry *= 1.0 + p.lead_swing * np.cos(2.0 * np.pi * x / p.lead_period + p.lead_phase)
        if p.slip != 0.0:
            carry *= 1.0 - p.slip * grown(t - p.slip_start, p.slip_time)
        w_mid = w + 0.5 * h * (drive - way * friction) / p.J
        w_mid = way * max(0.0, way * w_mid)
        angle_mid = angle + 0.25 * h * (w + w_mid)
        x_mid = x + carry * (angle_mid - angle)  # play and compression in half a step are not felt
        middle = forces(p, stops, supply, t + 0.5 * h, x_mid, w_mid, angle_mid, pitch, past, way)
        w_new = w + h * (middle[3] - way * middle[4]) / p.J
        used = h
        if way * w_new < 0.0:
            used = h * w / (w - w_new)
            w_new = 0.0
        turned = 0.5 * used * (w + w_new)
        in_contact = x > stops[1] or x < stops[0]
        gap += carry * turned
        pushed = max(gap - p.play, 0.0) + min(gap, 0.0)
        x += pushed * (1.0 - p.E) if in_contact else pushed
        w, angle, gap, t, h = w_new, angle + turned, gap - pushed, t + used, h - used
    return x, w, angle, gap


@njit(cache=True)
def through_dead_zone(servo, asked):
    """What of the current that the controller asks for [A] reaches the bridge."""
    excess = abs(asked) - servo.dead_zone
    if excess <= 0.0:
        return asked if servo.dead_zone == 0.0 else 0.0
    return np.sign(asked) * (abs(asked) if servo.dead_jump > 0.0 else excess)


@njit(cache=True)
def run(plants, switch_steps, servo, command, ahead, pitch, step_s, steps_per_tick, record_every, start):
    """Integrate and record. start = (x, I), at rest. Returns the rows of Motion and the final stops.

    command: rad/s per servo tick; ahead (ticks, 2): speed [rad/s] and current [A] that a position loop is fed forward; pitch: deg
    per step. plants: one after the other, each from its switch_steps on.
    A position loop around the servo takes rad per tick.
    The servo ticks half a tick after time zero, so a logged current is half a tick old.
    """
    steps, h, tick_s = pitch.size, step_s, steps_per_tick * step_s
    out = np.empty(((steps + record_every - 1) // record_every, 8))
    before, p, phase = plants[0], plants[0], 0
    stops = (before.stop_low, before.stop_high)
    body = (start[0], 0.0, 0.0, before.play * before.play_start)
    integral = start[1]
    asked = wanted = through_dead_zone(servo, servo.Ki * integral)
    heat, sag, w_filtered, seen_angle, flowing = 0.0, 0.0, 0.0, 0.0, wanted
    aged, w_lagged, w_heard, limited = 0.0, 0.0, 0.0, 0.0
    heard = 1.0 - np.exp(-tick_s / servo.command_filter) if servo.command_filter > 0.0 else 1.0
    half_decay = np.exp(-0.5 * h / servo.current_lag) if servo.current_lag > 0.0 else 0.0
    sag_gain = 1.0 - np.exp(-h / before.sag_time)
    for k in range(steps):
        t = k * h
        x, w, angle, gap = body
        while phase + 1 < len(plants) and k >= switch_steps[phase + 1]:
            phase += 1
            p = plants[phase]
            stops = (x if p.stop_here < 0.0 else p.stop_low, x if p.stop_here > 0.0 else p.stop_high)
        if k % steps_per_tick == steps_per_tick // 2:
            w_command, w_seen, speed_seen = command[k // steps_per_tick], w, w
            if servo.command_filter > 0.0:
                w_heard += heard * (w_command - w_heard)
                w_command = w_heard
            if servo.command_step > 0.0:
                w_command = np.round(w_command / servo.command_step) * servo.command_step
            if servo.Kx > 0.0:
                error = w_command - np.floor(angle / servo.loop_step) * servo.loop_step
                w_command = servo.Kx * error if abs(error) > servo.window else 0.0
                w_command += ahead[k // steps_per_tick, 0]
            if servo.encoder_step > 0.0:
                new_angle = np.floor(angle / servo.encoder_step) * servo.encoder_step
                w_seen, seen_angle = (new_angle - seen_angle) / tick_s, new_angle
                w_filtered += (w_seen - w_filtered) * tick_s / servo.speed_filter
                speed_seen = w_filtered
            integral += (w_command - w_seen) * tick_s * (1.0 - servo.freeze * limited)
            integral -= servo.leak * integral * tick_s
            integral = min(max(integral, -servo.integral_limit), servo.integral_limit)
            error = w_command - speed_seen
            Kp = servo.Kp * (1.0 + servo.kp_error * abs(error) / 100.0)
            pulled = Kp * error + servo.Ki * integral
            asked = through_dead_zone(servo, pulled + ahead[k // steps_per_tick, 1])
        if servo.current_lag == 0.0:
            wanted = asked
        limit = max(0.0, p.Vmax - sag - p.supply_drift * t)
        supply, source = (wanted, limit), 0.0
        if p.L > 0.0:
            wound, source = inductive_current(p, h, flowing, wanted, w, angle, heat, limit)
            supply, flowing = (flowing, np.inf), wound
        past = (heat, aged, w_lagged)
        i, V, load, drive, friction, way = forces(p, stops, supply, t, x, w, angle, pitch[k], past, 0.0)
        limited = 1.0 if abs(V) >= limit else 0.0
        if k % record_every == 0:
            stuck = w == 0.0 and abs(drive) <= p.static_ratio * friction
            row = out[k // record_every]
            row[0], row[1], row[2], row[3] = t, source if p.L > 0.0 else V, i, x
            row[4], row[5], row[6] = w, angle, integral
            row[7] = drive + load if stuck else load + way * friction
        heat += h * (i * i * p.Rm - heat / p.cooling_time)
        w_lagged += h * (w - w_lagged) / p.lagged_time
        aged += h * ((1.0 - aged) / p.ageing_time if w == 0.0 else -aged * abs(w) / p.ageing_angle)
        sag += (p.sag_ohm * abs(i) - sag) * sag_gain
        wanted_midway = asked + (wanted - asked) * half_decay
        wanted = asked + (wanted_midway - asked) * half_decay
        if p.L > 0.0:
            wanted_midway, limit = 0.5 * (supply[0] + flowing), np.inf
        body = advance(p, stops, (wanted_midway, limit), t, h, body, pitch[k], past)
    return out, stops[0], stops[1]
