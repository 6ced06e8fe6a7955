"""The table of named causes: what a model may be missing, equation by equation.

A cause has one or more variants (functional forms); a variant is a tuple of terms, parameters of `actuator.py` whose
neutral values leave the plant as it was. Causes that move the readings in exactly the same way are aliases.
"""

import math
from dataclasses import dataclass

from observer_fi.physics.equations import PARAMETERS


@dataclass(frozen=True)
class Term:
    """One free parameter of a variant. start: a small size to begin from [unit of the parameter].

    low, high: physical bounds. prior_std: weak knowledge of a shape (a time constant, a width), infinite for a size.
    shape: True where the parameter says how, not how much; it means nothing while the sizes are neutral.
    """

    parameter: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    shape: bool = False
    prior_std: float = math.inf

    @property
    def unit(self) -> str:
        """Unit of the parameter."""
        return PARAMETERS[self.parameter][0]

    @property
    def neutral(self) -> float:
        """The value that changes nothing."""
        value = PARAMETERS[self.parameter][1]
        return 0.0 if value is None else value


@dataclass(frozen=True)
class Variant:
    """One functional form of a cause. fixed: shapes that this form holds, by name."""

    name: str
    terms: tuple[Term, ...]
    fixed: tuple[tuple[str, float], ...] = ()

    @property
    def sizes(self) -> tuple[Term, ...]:
        """The terms that say how much."""
        return tuple(t for t in self.terms if not t.shape)


@dataclass(frozen=True)
class Cause:
    """One entry of the vocabulary.

    formula: in the letters of `actuator.py`. aliases: causes with exactly the same effect on the readings.
    confused_with: what it resembles in common logs. separate_by: what to record to tell them apart.
    """

    name: str
    equation: str
    formula: str
    source: str
    variants: tuple[Variant, ...]
    aliases: tuple[str, ...] = ()
    confused_with: tuple[str, ...] = ()
    separate_by: str = ""


def _one(parameter: str, start: float, low: float = -math.inf, high: float = math.inf) -> tuple[Variant, ...]:
    return (Variant("plain", (Term(parameter, start, low, high),)),)


def _bumps() -> tuple[Variant, ...]:
    """A rough spot of the rails: one start for each 0.15 mm that a campaign may cross."""
    centres = [round(-0.6e-3 + 1.5e-4 * k, 6) for k in range(17)]
    return tuple(
        Variant(
            f"bump at {1e3 * x:.2f} mm",
            (
                Term("friction_bump", 1e-5),
                Term("bump_position", x, -0.05, 0.05, shape=True),
                Term("bump_width", 1.5e-4, 3e-5, 1e-3, shape=True),
            ),
        )
        for x in centres
    )


def _ripple(sin: str, cos: str, start: float, orders: tuple[Variant, ...] = ()) -> tuple[Variant, ...]:
    return (Variant("first order", (Term(sin, start), Term(cos, start))), *orders)


def _order(k: int) -> Variant:
    terms = (Term("shaft_ripple_sin", 1e-6), Term("shaft_ripple_cos", 1e-6))
    return Variant(f"order {k}", terms, (("shaft_order", float(k)),))


def _lead(share: int) -> Variant:
    terms = (Term("screw_ripple_sin", 1e-6), Term("screw_ripple_cos", 1e-6))
    return Variant(f"order {share}", terms, (("screw_lead", 1e-3 / share),))


_TEXTBOOK = "Armstrong-Helouvry et al., Automatica 30 (1994)"
_PAPER = "Kemp and Martin, sections 2 and 5"
_SPEEDS = "steady moves at four speeds or more, both directions"
_PITCHES = "the same moves at three pitches or more"

_TABLE = (
    Cause(
        "viscous_friction", "torque", "torque += b w, b per direction", _TEXTBOOK,
        (
            Variant("per direction", (Term("viscous_positive", 1e-8, 0.0), Term("viscous_negative", 1e-8, 0.0))),
        ),
        confused_with=("stribeck_friction", "brush_drop"),
        separate_by=_SPEEDS,
    ),
    Cause(
        "stribeck_friction", "torque", "friction += T exp(-(w/ws)^2)", _TEXTBOOK,
        tuple(
            Variant(
                f"{ws} rad/s",
                (Term("stribeck_torque", 1e-6, 0.0), Term("stribeck_speed", float(ws), 2.0, 400.0, shape=True)),
            )
            for ws in (20, 60, 150)
        ),
        confused_with=("viscous_friction",),
        separate_by="slow moves, below 60 rad/s, and steady moves at four speeds",
    ),
    Cause(
        "torque_offset", "torque", "torque += T", "constant load, such as a cable or a spring",
        _one("torque_offset", 1e-6),
        aliases=("asymmetric_friction", "pitch_offset"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
    ),
    Cause(
        "asymmetric_friction", "torque", "friction += T sgn(w)", _TEXTBOOK,
        (),
        aliases=("torque_offset", "pitch_offset"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
    ),
    Cause(
        "load_dependent_friction", "torque", "friction += k |B theta|", "screw efficiency: Coulomb friction times axial load",
        _one("load_friction", 1e-3, 0.0),
        confused_with=("gravity_nonlinearity",),
        separate_by=_PITCHES,
    ),
    Cause(
        "position_dependent_friction", "torque", "friction += a x + b x^2, or a bump T exp(-((x - x0)/width)^2)",
        "wear and alignment of the rails",
        (
            Variant("linear", (Term("friction_slope", 1e-4),)),
            Variant("quadratic", (Term("friction_slope", 1e-4), Term("friction_curvature", 1e-1))),
            *_bumps(),
        ),
        confused_with=("screw_ripple",),
        separate_by="moves over the whole travel, both directions, two speeds",
    ),
    Cause(
        "shaft_ripple", "torque", "torque += T sin(n phi + phase), n whole turns of the motor",
        "cogging and shaft misalignment",
        _ripple("shaft_ripple_sin", "shaft_ripple_cos", 1e-6, tuple(_order(k) for k in (2, 3, 4, 6, 9, 13))),
        confused_with=("screw_ripple",),
        separate_by="slow moves with the encoder logged: the ripple must stay with the motor angle",
    ),
    Cause(
        "screw_ripple", "torque", "torque += T sin(2 pi n D phi/lead + phase)", "run-out of the lead screw",
        _ripple("screw_ripple_sin", "screw_ripple_cos", 1e-6, (_lead(2), _lead(3))),
        confused_with=("position_dependent_friction", "position_periodic_error"),
        separate_by="moves over three screw turns or more",
    ),
    Cause(
        "gravity_nonlinearity", "torque", "torque += c theta^3, or c |theta| theta, or friction += k A (cos theta - 1)",
        "the small-pitch approximation of equation 7",
        (
            Variant("cubic", (Term("gravity_cubic", 1e-10),)),
            Variant("cosine", (Term("gravity_cosine", 0.1, 0.0, 2.0),)),
        ),
        confused_with=("load_dependent_friction",),
        separate_by="moves at five pitches, as large as they get",
    ),
    Cause(
        "winding_heating", "electrical", "R += Rm h, dh/dt = g Rm i^2 - h/T, or h = r (1 - exp(-t/T))",
        "copper gains 0.39 % per kelvin",
        (
            Variant(
                "one time constant",
                (
                    Term("heating_gain", 1e-3, 0.0),
                    Term("heating_time", 60.0, 3.0, 1000.0, shape=True, prior_std=60.0),
                ),
            ),
            Variant(
                "warm-up in time",
                (
                    Term("heating_rise", 1e-3, 0.0),
                    Term("heating_time", 10.0, 0.5, 1000.0, shape=True, prior_std=60.0),
                ),
            ),
        ),
        confused_with=("current_gain",),
        separate_by="a minute of moves under load and a minute of rest",
    ),
    Cause(
        "brush_drop", "electrical", "V += U tanh(i/i0)", "contact drop of brushes",
        (Variant("plain", (Term("brush_drop", 1e-3, 0.0), Term("brush_current", 3e-3, 3e-4, 2e-2, shape=True))),),
        confused_with=("voltage_offset", "viscous_friction"),
        separate_by="slow moves in both directions and rests at several currents",
    ),
    Cause(
        "supply_sag", "electrical", "Vmax - sag, T dsag/dt = Rs' |i| - sag, or a drift in time", "battery and cable",
        (
            Variant("sag", (Term("sag_resistance", 1e-2, 0.0), Term("sag_time", 0.1, 3e-3, 5.0, shape=True, prior_std=1.0))),
            Variant("drift", (Term("supply_drift", 1e-3, 0.0),)),
        ),
        confused_with=("integrator_clamp",),
        separate_by="the supply voltage itself, or starts of several sizes that saturate",
    ),
    Cause(
        "current_lag", "servo", "T di/dt = i_cmd - i, before or behind the supply's limit",
        "bandwidth of the inner loop; inductance of the winding",
        (
            Variant("of the command", (Term("current_lag", 1e-4, 6e-5, 0.05),)),
            Variant("of the current", (Term("current_lag", 1e-4, 6e-5, 0.05),), (("lag_behind_limit", 1.0),)),
        ),
        confused_with=("input_delay",),
        separate_by="a faster logger through a start, both signals from one clock",
    ),
    Cause(
        "input_delay", "servo", "the servo follows w_cmd(t - T)", "communication and clock offset of the logger",
        _one("input_delay", 5e-5, 0.0, 0.2),
        confused_with=("current_lag", "voltage_delay"),
        separate_by="a faster logger through a start, both signals from one clock",
    ),
    Cause(
        "integrator_clamp", "servo", "|I| <= limit", "anti-windup of the servo",
        (Variant("plain", (Term("integrator_limit", 0.99, 1e-3),)),),
        confused_with=("supply_sag", "acceleration_limit"),
        separate_by="a full-speed start against pitch, which winds the integral up further",
    ),
    Cause(
        "acceleration_limit", "servo", "the servo's own command slews at most a", "preset of the servo",
        (Variant("plain", (Term("accel_limit", 0.99, 1e3),)),),
        confused_with=("integrator_clamp",),
        separate_by="starts to several speeds, one below saturation",
    ),
    Cause(
        "backlash", "kinematics", "the mass follows D phi within +-gap/2", "play of the nut",
        _one("backlash", 2e-6, 0.0, 5e-3),
        confused_with=("position_lag", "position_delay"),
        separate_by="short moves there and back with rests",
    ),
    Cause(
        "partial_slip", "kinematics", "dx/dt = D w (1 - s - k |torque|)", "slipping nut or coupling",
        (
            Variant("with torque", (Term("slip_per_torque", 1.0, 0.0, 1e3),)),
        ),
        confused_with=("position_gain",),
        separate_by="moves at large pitch of either sign, with the encoder logged",
    ),
    Cause(
        "contact_exponent", "contact", "C d^n", "Hertzian contact: n = 1.5; equation 11: n = 2",
        _one("contact_exponent", 2.02, 0.5, 4.0),
        confused_with=("contact_damping",),
        separate_by="slow moves into the stop, 5 mm deep",
    ),
    Cause(
        "contact_damping", "contact", "torque += (c |d| + c') w in contact", "Hunt and Crossley, J. Appl. Mech. 42 (1975)",
        (
            Variant("drag", (Term("contact_drag", 1e-9, 0.0),)),
            Variant("with depth", (Term("contact_damping", 1e-6, 0.0),)),
        ),
        confused_with=("contact_exponent", "viscous_friction"),
        separate_by="moves into the stop at two speeds or more",
    ),
    Cause(
        "position_delay", "sensor:position", "x seen T late", "bus of the absolute sensor",
        _one("position_delay", 1e-3, 0.0, 0.5),
        confused_with=("position_lag", "backlash"),
        separate_by="fast short moves: a lag rounds the corners that a delay shifts",
    ),
    Cause(
        "position_lag", "sensor:position", "T dx_seen/dt = x - x_seen", "filter of the absolute sensor",
        _one("position_lag", 1e-3, 0.0, 0.5),
        confused_with=("position_delay", "backlash"),
        separate_by="fast short moves: a lag rounds the corners that a delay shifts",
    ),
    Cause(
        "position_gain", "sensor:position", "x_seen = k x", "calibration of the absolute sensor",
        _one("position_gain", 1.0005),
        aliases=("partial_slip",),
        separate_by="a gauge block or calliper beside the position sensor",
    ),
    Cause(
        "position_periodic_error", "sensor:position", "x_seen = x + a sin(2 pi x/period + phase)",
        "interpolation error of scales",
        (
            Variant("1 mm", (Term("position_sin", 1e-6), Term("position_cos", 1e-6))),
            Variant("0.5 mm", (Term("position_sin", 1e-6), Term("position_cos", 1e-6)), (("position_period", 5e-4),)),
            Variant("2 mm", (Term("position_sin", 1e-6), Term("position_cos", 1e-6)), (("position_period", 2e-3),)),
        ),
        confused_with=("screw_ripple",),
        separate_by="a second position sensor, or moves over three periods or more",
    ),
    Cause(
        "current_offset", "sensor:current", "i_seen = i + i0", "zero of the current sensor",
        _one("current_offset", 1e-5),
        confused_with=("voltage_offset", "torque_offset"),
        separate_by="a rest with the servo off",
    ),
    Cause(
        "current_gain", "sensor:current", "i_seen = k i", "calibration of the current sensor",
        _one("current_gain", 1.001),
        confused_with=("winding_heating",),
        separate_by="the winding's resistance with an ohmmeter: another Rm looks the same",
    ),
    Cause(
        "voltage_delay", "sensor:voltage", "V seen T late", "filter of the voltage channel",
        _one("voltage_delay", 2e-5, 0.0, 0.1),
        confused_with=("input_delay",),
        separate_by="a faster logger through a start",
    ),
    Cause(
        "voltage_offset", "sensor:voltage", "V_seen = V + V0", "zero of the voltage channel",
        _one("voltage_offset", 1e-3),
        confused_with=("current_offset", "brush_drop"),
        separate_by="a rest with the servo off",
    ),
    Cause(
        "pitch_offset", "sensor:pitch", "theta_seen = theta + theta0", "mounting of the inclinometer",
        (),
        aliases=("torque_offset", "asymmetric_friction"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
    ),
)  # fmt: skip

CAUSES: dict[str, Cause] = {cause.name: cause for cause in _TABLE}
EQUATIONS = ("torque", "electrical", "servo", "kinematics", "contact", "sensor")
