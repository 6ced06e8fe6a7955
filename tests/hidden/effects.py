"""The table of hidden effects: the causes of the contract and some that are outside its vocabulary.

Formulas: torques add to the applied torque, the others stand as written. w motor speed [rad/s], x mass
position [m], theta pitch [deg], phi motor angle [rad], d indentation [m], i current [A], t log time [s].
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """One number of an effect, and where the simulator keeps it.

    field: "plant.", "servo.", "command." or "sensors." and the field's name. neutral: the value that changes
    nothing. small: what stands out by VISIBLE_SIGMA of detectability.py; more for the servo's timing, which a
    sampled servo imitates (40 us of delay, 90 us of lag). role: "size" is neutral + f * small at size factor
    f; "limit" is neutral / (1 + f * small), and none at f = 0; "shape" stays `small`; "phase" is a shape that
    a draw takes from 0 to 2 pi. signed: a draw may take either sign.
    """

    name: str
    field: str
    unit: str
    small: float
    neutral: float = 0.0
    role: str = "size"
    signed: bool = False

    def sized(self, factor: float) -> float:
        if self.role == "size":
            return self.neutral + factor * self.small
        if self.role == "limit":
            return self.neutral / (1.0 + factor * self.small) if factor > 0.0 else np.inf
        return self.small


@dataclass(frozen=True)
class Cause:
    """One effect. regressors: those which a right answer may name if it does not name the cause itself."""

    name: str
    equation: str
    formula: str
    parameters: tuple[Parameter, ...]
    regressors: frozenset[str] = frozenset()
    other_equations: frozenset[str] = frozenset()

    @property
    def equations(self) -> frozenset[str]:
        return self.other_equations | {self.equation}


@dataclass(frozen=True)
class Effect:
    """A cause with the values of its parameters, in the units of its table entry."""

    cause: str
    values: tuple[tuple[str, float], ...]


def _table(*causes: Cause) -> dict[str, Cause]:
    return {cause.name: cause for cause in causes}


def _outside(name, equations, regressors, formula, *parameters) -> Cause:
    first, *others = equations
    return Cause(name, first, formula, parameters, frozenset(regressors), frozenset(others))


CAUSES = _table(
    Cause("viscous_friction", "torque", "plus*w if w > 0, minus*w if w < 0", (
        Parameter("plus", "plant.viscous_plus", "N m s/rad", 8e-9),
        Parameter("minus", "plant.viscous_minus", "N m s/rad", 8e-9),
    )),
    Cause("stribeck_friction", "torque", "rise*exp(-(w/speed)^2)*sgn(w)", (
        Parameter("rise", "plant.stribeck_rise", "N m", 3e-6),
        Parameter("speed", "plant.stribeck_speed", "rad/s", 60.0, role="shape"),
    )),
    Cause("asymmetric_friction", "torque", "A*ratio*|sgn(w)|: A*(1 + ratio) forward, A*(1 - ratio) back", (
        Parameter("ratio", "plant.asymmetry", "1", 2.5e-3, signed=True),
    )),
    # 6.5e-4 of the transmitted torque is as visible as 7e-3 of the axial load.
    Cause("load_dependent_friction", "torque", "(ratio*|B*theta + contact| + loss*|Km*i|)*sgn(w)", (
        Parameter("ratio", "plant.load_ratio", "1", 7e-3),
        Parameter("loss", "plant.gear_loss", "1", 0.0),
    )),
    Cause("position_dependent_friction", "torque", "gradient*x*sgn(w), x from the log's zero", (
        Parameter("gradient", "plant.friction_gradient", "N m/m", 2.5e-3, signed=True),
    )),
    Cause("friction_warmup", "torque", "A*rise*exp(-t/time)*sgn(w)", (
        Parameter("rise", "plant.warmup", "1", 6e-3, signed=True),
        Parameter("time", "plant.warmup_time", "s", 5.0, role="shape"),
    )),
    Cause("shaft_ripple", "torque", "amplitude*sin(order*phi + phase)", (
        Parameter("amplitude", "plant.shaft_amplitude", "N m", 2e-6),
        Parameter("order", "plant.shaft_order", "per motor turn", 1.0, role="shape"),
        Parameter("phase", "plant.shaft_phase", "rad", 0.0, role="phase"),
    )),
    Cause("screw_ripple", "torque", "amplitude*sin(phi/526.3*2*pi + phase): once per 1 mm of lead", (
        Parameter("amplitude", "plant.screw_amplitude", "N m", 2e-6),
        Parameter("phase", "plant.screw_phase", "rad", 0.0, role="phase"),
    )),
    # A true sine has cubic = -B * (pi / 180)^2 / 6 = -1.17e-9: far below what can be seen at 10 deg.
    Cause("gravity_nonlinearity", "torque", "cubic*theta^3 + cosine*A*(cos(theta) - 1)*sgn(w)", (
        Parameter("cubic", "plant.gravity_cubic", "N m/deg^3", -1.5e-8),
        Parameter("cosine", "plant.gravity_cosine", "1", 0.0),
    )),
    Cause("torque_offset", "torque", "offset", (
        Parameter("offset", "plant.torque_offset", "N m", 1.2e-6, signed=True),
    )),
    Cause("winding_heating", "electrical", "Rm*(1 + rise*H), dH/dt = i^2*Rm - H/cooling, H [J] from 0", (
        Parameter("rise", "plant.heating", "1/J", 4e-4),
        Parameter("cooling", "plant.cooling_time", "s", 30.0, role="shape"),
    )),
    Cause("brush_drop", "electrical", "Vs = R*i + Km*w + drop*tanh(i/knee)", (
        Parameter("drop", "plant.brush_drop", "V", 4e-3),
        Parameter("knee", "plant.brush_knee", "A", 3e-3, role="shape"),
    )),
    Cause("supply_sag", "electrical", "Vmax - s - drift*t, ds/dt = (resistance*|i| - s)/recovery", (
        Parameter("resistance", "plant.sag_ohm", "ohm", 0.2),
        Parameter("drift", "plant.supply_drift", "V/s", 0.0),
        Parameter("recovery", "plant.sag_time", "s", 0.1, role="shape"),
    )),
    Cause("current_lag", "servo", "d(i_cmd')/dt = (i_cmd - i_cmd')/lag", (
        Parameter("lag", "servo.current_lag", "s", 1e-4),
    )),
    Cause("input_delay", "servo", "the servo follows w_cmd(t - delay); the log shows w_cmd(t)", (
        Parameter("delay", "command.delay", "s", 2e-4),
    )),
    Cause("dead_zone", "servo", "0 below the threshold; sgn(i_cmd)*(|i_cmd| - threshold) above, i_cmd there at jump = 1", (
        Parameter("threshold", "servo.dead_zone", "A", 1.4e-4),
        Parameter("jump", "servo.dead_jump", "1", 0.0),
    )),
    Cause("integrator_clamp", "servo", "|I| <= limit; nominal full-speed starts reach 3.4 rad", (
        Parameter("limit", "servo.integral_limit", "rad", 0.03, neutral=3.4, role="limit"),
    )),
    Cause("acceleration_limit", "servo", "the servo's own command slews at most `limit`; the log shows 6e4", (
        Parameter("limit", "command.slew", "rad/s^2", 0.02, neutral=6e4, role="limit"),
    )),
    Cause("backlash", "kinematics", "play of x behind D*phi, taken up forward by share `start` at t = 0", (
        Parameter("width", "plant.play", "m", 6e-6),
        Parameter("start", "plant.play_start", "1", 1.0, role="shape"),
    )),
    Cause("partial_slip", "kinematics", "dx/dt = D*(1 - slip*|applied torque|)*w", (
        Parameter("slip", "plant.slip_per_torque", "1/(N m)", 10.0),
    )),
    Cause("contact_exponent", "contact", "C*(1 mm)^2*(d/1 mm)^exponent instead of C*d^2", (
        Parameter("exponent", "plant.contact_exponent", "1", 0.12, neutral=2.0, signed=True),
    )),
    Cause("contact_damping", "contact", "damping*dx/dt while d > 0, the stop never pulls", (
        Parameter("damping", "plant.contact_damping", "N m s/m", 7e-3),
    )),
    Cause("position_lag", "sensor:position", "first-order lag of x", (
        Parameter("lag", "sensors.position_lag", "s", 6e-3),
    )),
    Cause("position_delay", "sensor:position", "x(t - delay)", (
        Parameter("delay", "sensors.position_delay", "s", 6e-3),
    )),
    Cause("position_gain", "sensor:position", "(1 + gain)*x", (
        Parameter("gain", "sensors.position_gain", "1", 0.02, signed=True),
    )),
    Cause("position_periodic_error", "sensor:position", "x + amplitude*sin(2*pi*x/period + phase)", (
        Parameter("amplitude", "sensors.position_ripple", "m", 5e-6),
        Parameter("period", "sensors.position_ripple_period", "m", 1e-3, role="shape"),
        Parameter("phase", "sensors.position_ripple_phase", "rad", 0.0, role="phase"),
    )),
    Cause("current_offset", "sensor:current", "i + offset", (
        Parameter("offset", "sensors.current_offset", "A", 7.5e-5, signed=True),
    )),
    Cause("current_gain", "sensor:current", "(1 + gain)*i", (
        Parameter("gain", "sensors.current_gain", "1", 0.02, signed=True),
    )),
    Cause("voltage_delay", "sensor:voltage", "V(t - delay)", (
        Parameter("delay", "sensors.voltage_delay", "s", 1e-4),
    )),
    Cause("voltage_offset", "sensor:voltage", "V + offset", (
        Parameter("offset", "sensors.voltage_offset", "V", 2.5e-3, signed=True),
    )),
    Cause("pitch_offset", "sensor:pitch", "theta + offset", (
        Parameter("offset", "sensors.pitch_offset", "deg", 0.05, signed=True),
    )),
)  # fmt: skip

OUTSIDE = _table(
    _outside("power_torque", ("torque",), ("current", "load", "speed"), "coefficient*|Vs*i|*sgn(w)",
        Parameter("coefficient", "plant.power_torque", "N m/W", 1e-6)),
    _outside("torque_bump", ("torque",), ("position", "screw_angle"), "peak*exp(-((x - position)/width)^2)",
        Parameter("peak", "plant.bump_peak", "N m", 6e-6, signed=True),
        Parameter("position", "plant.bump_position", "m", 2.5e-4, role="shape"),
        Parameter("width", "plant.bump_width", "m", 5e-5, role="shape")),
    _outside("km_saturation", ("electrical", "torque"), ("current", "load"), "Km*(1 - rate*|i|) throughout",
        Parameter("rate", "plant.km_saturation", "1/A", 2e-3)),
    _outside("pitch_speed_torque", ("torque",), ("pitch", "speed"), "coefficient*(theta*w)^2*sgn(w)",
        Parameter("coefficient", "plant.pitch_speed", "N m s^2/(deg rad)^2", 2e-13)),
    _outside("slow_torque", ("torque",), ("time",), "amplitude*sin(2*pi*frequency*t + phase)",
        Parameter("amplitude", "plant.wave_amplitude", "N m", 2e-6),
        Parameter("frequency", "plant.wave_hz", "Hz", 0.7, role="shape"),
        Parameter("phase", "plant.wave_phase", "rad", 0.0, role="phase")),
    _outside("position_creep", ("sensor:position",), ("time",), "x + creep*(1 - exp(-t/time))",
        Parameter("creep", "sensors.position_creep", "m", 1e-5, signed=True),
        Parameter("time", "sensors.position_creep_time", "s", 5.0, role="shape")),
    _outside("pitch_dependent_position", ("sensor:position",), ("pitch",), "x + slope*theta",
        Parameter("slope", "sensors.position_per_degree", "m/deg", 3e-7, signed=True)),
    _outside("km_by_direction", ("electrical", "torque"), ("current", "load", "direction", "speed"), "Km*(1 + ratio*sgn(i))",
        Parameter("ratio", "plant.km_asymmetry", "1", 3.7e-4, signed=True)),
    _outside("km_heating", ("electrical", "torque", "servo"), ("temperature", "time"), "Km*(1 - rate*H), H [J] from 0",
        Parameter("rate", "plant.km_heating", "1/J", 3.3e-4)),
    _outside("lead_swing", ("kinematics", "sensor:position"), ("position", "screw_angle"),
        "dx/dt = D*(1 + share*cos(2*pi*x/period + phase))*w",
        Parameter("share", "plant.lead_swing", "1", 0.07),
        Parameter("period", "plant.lead_period", "m", 3.2e-3, role="shape"),
        Parameter("phase", "plant.lead_phase", "rad", 0.0, role="phase")),
    _outside("lead_heating", ("kinematics", "sensor:position"), ("temperature", "time"), "dx/dt = D*(1 + rate*H)*w",
        Parameter("rate", "plant.lead_heating", "1/J", 0.0115, signed=True)),
    _outside("spring", ("torque",), ("position", "screw_angle"), "stiffness*x",
        Parameter("stiffness", "plant.spring", "N m/m", 3.6e-3)),
    _outside("tilted_unbalance", ("torque",), ("shaft_angle", "pitch"), "torque*theta/10*sin(phi)",
        Parameter("torque", "plant.unbalance", "N m", 2.1e-6)),
    _outside("square_drag", ("torque",), ("speed",), "coefficient*w^2*sgn(w)",
        Parameter("coefficient", "plant.drag_square", "N m s^2/rad^2", 1.8e-11)),
    _outside("ageing_at_rest", ("torque",), ("time", "position", "direction"),
        "share*A*a*sgn(w), da/dt = (1 - a)/time at rest, -a*|w|/angle in motion",
        Parameter("share", "plant.ageing", "1", 0.047),
        Parameter("time", "plant.ageing_time", "s", 1.0, role="shape"),
        Parameter("angle", "plant.ageing_angle", "rad", 20.0, role="shape")),
    _outside("lagged_drag", ("torque",), ("speed", "direction", "time"), "coefficient*w', dw'/dt = (w - w')/time",
        Parameter("coefficient", "plant.lagged_viscous", "N m s/rad", 8e-9),
        Parameter("time", "plant.lagged_time", "s", 0.02, role="shape")),
    _outside("commutator_ripple", ("electrical",), ("shaft_angle",), "Rm*(1 + share*sin(bars*phi))",
        Parameter("share", "plant.winding_ripple", "1", 1.4e-3),
        Parameter("bars", "plant.winding_bars", "per motor turn", 7.0, role="shape")),
    _outside("integral_leak", ("servo",), ("current", "speed", "time"), "dI/dt = w_cmd - w - rate*I",
        Parameter("rate", "servo.leak", "1/s", 0.045)),
    _outside("command_steps", ("servo",), ("speed",), "the servo follows w_cmd in whole steps",
        Parameter("step", "servo.command_step", "rad/s", 0.28)),
    _outside("frozen_integral", ("servo",), ("speed", "time"), "dI/dt = (1 - share)*(w_cmd - w) while |Vs| is at its limit",
        Parameter("share", "servo.freeze", "1", 0.046)),
    _outside("kp_by_error", ("servo",), ("speed", "time"), "Kp*(1 + rise*|w_cmd - w|/100)",
        Parameter("rise", "servo.kp_error", "s/rad", 1.8e-3)),
    _outside("command_filter", ("servo",), ("time", "speed"), "the servo follows w_cmd behind a low-pass; the log shows w_cmd",
        Parameter("time", "servo.command_filter", "s", 2e-4)),
    _outside("square_position", ("sensor:position", "kinematics"), ("position",), "x + rate*x^2",
        Parameter("rate", "sensors.position_square", "1/m", 48.0, signed=True)),
    _outside("position_hysteresis", ("sensor:position", "kinematics"), ("direction", "position", "speed"),
        "x + width*h, h from -1 to 1 over `way` of travel behind a reversal",
        Parameter("width", "sensors.position_hysteresis", "m", 6e-6),
        Parameter("way", "sensors.position_hysteresis_way", "m", 2e-4, role="shape")),
    _outside("swinging_frame", ("sensor:position", "kinematics"), ("time", "speed"),
        "x + share*y, y'' + 25 y' + (80 pi)^2 y = x''",
        Parameter("share", "sensors.position_ring", "1", 12.0)),
    _outside("current_filter", ("sensor:current",), ("current", "time"), "the sensor of the current is a first-order lag",
        Parameter("lag", "sensors.current_filter", "s", 1e-4)),
)  # fmt: skip

ALL = CAUSES | OUTSIDE


def effect(cause: str, **values: float) -> Effect:
    """An effect; a parameter that is not given has its neutral size (a size or limit) or its tabled shape."""
    parameters = _parameters(cause)
    if unknown := values.keys() - parameters.keys():
        raise ValueError(f"{cause} has no parameter {sorted(unknown)}; it has {sorted(parameters)}")
    return Effect(
        cause, tuple((name, float(values.get(name, p.sized(0.0)))) for name, p in parameters.items())
    )


def sized_effect(cause: str, factor: float, rng: np.random.Generator | None = None) -> Effect:
    """An effect at `factor` times its small size; with a generator, sign and phase are drawn."""
    values = {}
    for name, parameter in _parameters(cause).items():
        value = parameter.sized(factor)
        if rng is not None and parameter.signed and rng.random() < 0.5:
            value = 2.0 * parameter.neutral - value
        if rng is not None and parameter.role == "phase":
            value = rng.uniform(0.0, 2 * np.pi)
        values[name] = value
    return effect(cause, **values)


def fields_of(effects: tuple[Effect, ...], owner: str) -> dict[str, float]:
    """The simulator's fields that `effects` set, of "plant", "servo", "command" or "sensors"."""
    if len({item.cause for item in effects}) < len(effects):
        raise ValueError(f"a cause is given twice in {[item.cause for item in effects]}")
    fields = {}
    for item in effects:
        for name, value in item.values:
            place, field = _parameters(item.cause)[name].field.split(".")
            if place == owner:
                fields[field] = value
    return fields


def _parameters(cause: str) -> dict[str, Parameter]:
    if cause not in ALL:
        raise ValueError(f"no effect {cause!r}; there are {sorted(ALL)}")
    return {parameter.name: parameter for parameter in ALL[cause].parameters}
