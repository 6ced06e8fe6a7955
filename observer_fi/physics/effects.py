"""The table of named causes: what a model may be missing, equation by equation.

A cause has one or more variants (functional forms); a variant is a tuple of terms, parameters of `equations.py` whose
neutral values leave the plant as it was. Where a search for them starts follows from the rig and from what its log covers.
Causes that move the readings in exactly the same way are aliases.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from observer_fi.physics.equations import PARAMETERS

MOVES, FORCE = "simulated moves", "inverse dynamics"  # the two ways in which a log shows an effect


class Coverage(NamedTuple):
    """What a rig and its log cover, from which every start follows; a log without any of it keeps the 1.

    low, high: travel of the mass [m]. speed: fastest of the motor [rad/s]. pitch: largest [deg]. torque: Coulomb friction A
    [N m]. current: what friction takes, A / Km [A]. resistance: of the winding [ohm]. heat: put into it [J]. length_s: of the
    log; step_s: between samples. voltage_noise [V], current_noise [A], position_noise [m]: standard deviations. turn: travel of
    a turn of the motor [m]; lead: of a turn of the screw [m], NaN where nobody knows. integral [rad] and acceleration [rad/s^2]:
    the largest that the servo reached. orders: of lines in a torque, per turn of the motor.
    """

    low: float = 0.0
    high: float = 1.0
    speed: float = 1.0
    pitch: float = 1.0
    torque: float = 1.0
    current: float = 1.0
    resistance: float = 1.0
    heat: float = 1.0
    length_s: float = 1.0
    step_s: float = 1.0
    voltage_noise: float = 1.0
    current_noise: float = 1.0
    position_noise: float = 1.0
    turn: float = 1.0
    lead: float = 1.0
    integral: float = 1.0
    acceleration: float = 1.0
    orders: tuple[float, ...] = ()

    @property
    def travel(self) -> float:
        """What lies between the ends [m]; at least what the noise shows."""
        return max(self.high - self.low, 10.0 * self.position_noise)

    @property
    def screw_is_shaft(self) -> bool:
        """Whether the screw turns with the motor, so that what comes back every turn of one does so of the other."""
        return abs(self.lead / self.turn - 1.0) < 1e-6


@dataclass(frozen=True)
class Term:
    """One free parameter of a variant. start: a small size to begin from [unit of the parameter].

    low, high: physical bounds. prior_std: weak knowledge of a shape (a time constant, a width), infinite for a size.
    shape: True where the parameter says how, not how much; it means nothing while the sizes are neutral. with_it: other
    parameters that move with this one, and by how much. per_log: True where the value belongs to one log, as the phase of
    what turns does, for the zero of an angle is arbitrary. step: for slopes, 0 for the start of a size or a share of a shape's.
    """

    parameter: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    shape: bool = False
    prior_std: float = math.inf
    with_it: tuple[tuple[str, float], ...] = ()
    per_log: bool = False
    step: float = 0.0

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
    """One functional form of a cause. fixed: shapes that this form holds, by name. seen_by: the ways in which it shows.

    aliases: in place of those of the cause, where this form has others. beside: whether it only joins another form of its cause.
    """

    name: str
    terms: tuple[Term, ...]
    fixed: tuple[tuple[str, float], ...] = ()
    seen_by: tuple[str, ...] = (MOVES, FORCE)
    aliases: tuple[str, ...] | None = None
    beside: bool = False

    @property
    def sizes(self) -> tuple[Term, ...]:
        """The terms that say how much."""
        return tuple(t for t in self.terms if not t.shape)

    @property
    def shapes(self) -> tuple[str, ...]:
        """The parameters that say how, free or fixed."""
        return (*(t.parameter for t in self.terms if t.shape), *(name for name, _ in self.fixed))


Forms = Callable[[Coverage], tuple[Variant, ...]]


@dataclass(frozen=True)
class Cause:
    """One entry of the vocabulary.

    formula: in the letters of `equations.py`. forms: its variants for what a log covers. aliases: causes with exactly the
    same effect on the readings. confused_with: what it resembles in common logs. separate_by: what to record to tell them
    apart; separate_force: the same for a rig that logs a force, where that differs.
    """

    name: str
    equation: str
    formula: str
    source: str
    forms: Forms
    aliases: tuple[str, ...] = ()
    confused_with: tuple[str, ...] = ()
    separate_by: str = ""
    separate_force: str = ""

    def variants(self, coverage: Coverage, seen_by: str) -> tuple[Variant, ...]:
        """Its forms that show in one of the two ways, with starts for what a log covers."""
        return tuple(v for v in self.forms(coverage) if seen_by in v.seen_by)

    def told_apart_by(self, seen_by: str) -> str:
        """What to record to tell it from its rivals."""
        return self.separate_force if seen_by == FORCE and self.separate_force else self.separate_by


# --- forms: how an effect enters, and where its search begins --------------------------------------
# Steps of sizes are a hundredth to a thousandth of what the log shows anyway, so that the readings answer in proportion.


def _none(c: Coverage) -> tuple[Variant, ...]:
    return ()


def _one(
    parameter: str, start: Callable[[Coverage], float], low: float = -math.inf, high: float = math.inf,
    seen_by: tuple[str, ...] = (MOVES,),
) -> Forms:  # fmt: skip
    return lambda c: (Variant("plain", (Term(parameter, start(c), low, high),), seen_by=seen_by),)


def _small(c: Coverage) -> float:
    """A small torque [N m]."""
    return 0.002 * c.torque


def _load(c: Coverage) -> tuple[Variant, ...]:
    """With the axial load; with the torque that a gear transmits, whose rotor has little of the inertia or all of it."""
    loss = Term("torque_friction", 1e-3, 0.0, 0.9)
    return (
        Variant("plain", (Term("load_friction", 1e-3, 0.0),)),
        Variant("with the motor's torque", (loss,), seen_by=(MOVES,)),
        Variant("with the torque behind the rotor", (loss,), (("rotor_share", 1.0),), seen_by=(MOVES,)),
    )


def _viscous(c: Coverage) -> tuple[Variant, ...]:
    """Drag in proportion to the speed, and that of a lubricant that shears thin: it stops growing above some speed.

    The latter is asked where the force is calculated from the motion, whose starts and stops are many and slow enough.
    """
    start = 0.01 * c.torque / c.speed
    both = Term("viscous_positive", start, 0.0, with_it=(("viscous_negative", 1.0),))
    ways = (Term("viscous_positive", start, 0.0), Term("viscous_negative", start, 0.0))
    return (
        Variant("per direction", ways, seen_by=(MOVES,)),
        Variant("alike in both directions", (both,), seen_by=(FORCE,)),
        *(_saturating(share, c) for share in (0.03, 0.06, 0.12)),
    )


def _saturating(share: float, c: Coverage) -> Variant:
    above = Term("saturation_speed", share * c.speed, 0.02 * c.speed, 0.2 * c.speed, shape=True)
    terms = (Term("saturating_drag", _small(c), 0.0), above)
    return Variant(f"saturates above {100 * share:.0f} % of top speed", terms, seen_by=(FORCE,), beside=True)


def _asymmetric(c: Coverage) -> tuple[Variant, ...]:
    """Coulomb friction per direction is a torque offset; drag per direction is nothing else."""
    apart = Term("viscous_positive", 0.01 * c.torque / c.speed, with_it=(("viscous_negative", -1.0),))
    return (Variant("viscous, per direction", (apart,), seen_by=(FORCE,), aliases=()),)


def _stribeck(c: Coverage) -> tuple[Variant, ...]:
    """Friction of low speeds, from several shares of the fastest on.

    Where the force is calculated from the motion only low speeds count, for over the whole range this form is viscous
    friction by another name. It rises towards standstill: friction that falls there is a drag that saturates, `_viscous`.
    """
    found = [
        _stribeck_below(share, c.speed, (0.005, 0.98), 0.0, _small(c), MOVES) for share in (0.05, 0.15, 0.37)
    ]
    found += [
        _stribeck_below(share, c.speed, (0.02, 0.2), 0.0, _small(c), FORCE) for share in (0.03, 0.06, 0.12)
    ]
    return tuple(found)


def _stribeck_below(
    share: float, speed: float, limits: tuple[float, float], least: float, start: float, seen_by: str
) -> Variant:
    low, high = limits
    where = Term("stribeck_speed", share * speed, low * speed, high * speed, shape=True)
    terms = (Term("stribeck_torque", start, least), where)
    return Variant(f"below {100 * share:.0f} % of top speed", terms, seen_by=(seen_by,))


def _along_the_rails(c: Coverage) -> tuple[Variant, ...]:
    """Friction that changes with position: a slope, a parabola, or one rough spot anywhere on the travel."""
    slope = Term("friction_slope", 5e-4 * c.torque / c.travel)
    curvature = Term("friction_curvature", 1e-3 * c.torque / c.travel**2)
    return (Variant("linear", (slope,)), Variant("quadratic", (slope, curvature)), *_bumps(c))


def _warmup(c: Coverage) -> tuple[Variant, ...]:
    """Friction that falls, or rises, from where it is as the log begins; a change that is slower than the log is a slope."""
    limits = 0.01 * c.length_s, 3.0 * c.length_s
    return tuple(
        Variant(
            f"within {100 * share:.0f} % of the log",
            (
                Term("warmup_rise", 0.002, -0.9, 10.0),
                Term("warmup_time", share * c.length_s, *limits, shape=True),
            ),
            seen_by=(MOVES,),
        )
        for share in (0.05, 0.2, 0.8)
    )


_PLACES = 13  # widths of a rough spot that the travel is cut into


def _bumps(c: Coverage) -> tuple[Variant, ...]:
    width = c.travel / _PLACES
    centres = [c.low + width * k for k in range(_PLACES + 1)]
    ends = (c.low - c.travel, c.high + c.travel)
    return tuple(
        Variant(
            f"bump at {1e3 * x:.3g} mm",
            (
                Term("friction_bump", 0.02 * c.torque),
                Term("bump_position", x, *ends, shape=True),
                Term("bump_width", width, 0.2 * width, 6.0 * width, shape=True),
            ),
        )
        for x in centres
    )


def _waves(stem: str, start: float) -> tuple[Term, Term]:
    return Term(f"{stem}_sin", start, per_log=True), Term(f"{stem}_cos", start, per_log=True)


_SHAFT_ORDERS = (1, 2, 3, 4, 6, 9, 13)  # that are tried whether the torque shows a line there or not
_NEAR_ORDER = 0.02  # relative: orders are as near as that where they are one,
_NEAREST = 0.1  # and no further apart than this


def _is_near(order: float, known: float) -> bool:
    return abs(order - known) <= min(_NEAR_ORDER * known, _NEAREST)


def _whole(order: float) -> int:
    """The whole number that an order is, 0 where it is none."""
    return round(order) if _is_near(order, float(round(order))) else 0


def _shaft(c: Coverage) -> tuple[Variant, ...]:
    waves = _waves("shaft_ripple", _small(c))
    orders = dict.fromkeys((*_SHAFT_ORDERS, *(k for o in c.orders if (k := _whole(o)))))
    return tuple(Variant(f"order {k}", waves, (("shaft_order", float(k)),)) for k in orders)


def _gear(c: Coverage) -> tuple[Variant, ...]:
    """Any other order of the motor's angle, from those that a look at the torque shows."""
    screw = math.inf if math.isnan(c.lead) else c.turn / c.lead
    waves = _waves("gear_ripple", _small(c))
    finest = c.turn / c.travel  # an order that much off is out of step once over the travel
    return tuple(
        Variant(f"order {o:.3g}", (*waves, _order(o, finest)))
        for o in c.orders
        if not _whole(o) and not any(_is_near(o, k * screw) for k in (1, 2, 3))
    )


def _order(o: float, finest: float) -> Term:
    return Term("gear_order", o, max(o - finest, 0.1 * o), o + finest, shape=True, step=0.03 * finest)


def _screw(c: Coverage) -> tuple[Variant, ...]:
    """Per turn of the screw, unless nobody knows its lead or it turns with the motor."""
    if math.isnan(c.lead) or c.screw_is_shaft:
        return ()
    waves = _waves("screw_ripple", _small(c))
    return tuple(Variant(f"order {k}", waves, (("screw_lead", c.lead / k),)) for k in (1, 2, 3))


def _gravity(c: Coverage) -> tuple[Variant, ...]:
    start = 2e-4 * c.torque
    return (
        Variant("quadratic", (Term("gravity_quadratic", start / c.pitch**2),), seen_by=(FORCE,)),
        Variant("cubic", (Term("gravity_cubic", start / c.pitch**3),)),
        Variant("cosine", (Term("gravity_cosine", 0.1, 0.0, 2.0),), seen_by=(MOVES,)),
    )


def _heating(c: Coverage) -> tuple[Variant, ...]:
    """Windings of small motors warm within seconds to minutes, however long the log is."""
    with_loss = (
        Term("heating_gain", 4e-3 / c.heat, 0.0),
        Term("heating_time", 60.0, 3.0, 1000.0, shape=True, prior_std=60.0),
    )
    in_time = (
        Term("heating_rise", 1e-3, 0.0),
        Term("heating_time", 10.0, 0.5, 1000.0, shape=True, prior_std=60.0),
    )
    return (
        Variant("one time constant", with_loss, seen_by=(MOVES,)),
        Variant("warm-up in time", in_time, seen_by=(MOVES,)),
    )


def _brushes(c: Coverage) -> tuple[Variant, ...]:
    """The drop turns its sign within a share of the current that friction takes."""
    size = Term("brush_drop", 0.1 * c.voltage_noise, 0.0)
    turning = Term("brush_current", 0.14 * c.current, 0.014 * c.current, 0.92 * c.current, shape=True)
    return (Variant("plain", (size, turning), seen_by=(MOVES,)),)


def _supply(c: Coverage) -> tuple[Variant, ...]:
    resistance = Term("sag_resistance", 5e-4 * c.resistance, 0.0)
    time = Term("sag_time", 0.1, 3e-3, 5.0, shape=True, prior_std=1.0)
    drift = Term("supply_drift", 2.0 * c.voltage_noise / c.length_s, 0.0)
    return (
        Variant("sag", (resistance, time), seen_by=(MOVES,)),
        Variant("drift", (drift,), seen_by=(MOVES,)),
    )


def _input_delay(c: Coverage) -> tuple[Variant, ...]:
    """In inverse dynamics a late force and a late position are one."""
    term = Term("input_delay", 0.08 * c.step_s, 0.0, 320.0 * c.step_s)
    return (
        Variant("plain", (term,), seen_by=(MOVES,)),
        Variant("delay", (term,), seen_by=(FORCE,), aliases=("position_delay",)),
    )


def _current_lag(c: Coverage) -> tuple[Variant, ...]:
    """A tenth of the sampling period is the shortest that the integration of a simulated move follows."""
    term = Term("current_lag", 0.16 * c.step_s, 0.096 * c.step_s, 80.0 * c.step_s)
    any_lag = Term("current_lag", 0.16 * c.step_s, 0.0, 80.0 * c.step_s)
    return (
        Variant("of the command", (term,), seen_by=(MOVES,)),
        Variant("of the current", (term,), (("lag_behind_limit", 1.0),), seen_by=(MOVES,)),
        Variant("first-order lag", (any_lag,), seen_by=(FORCE,)),
    )


def _position_lag(c: Coverage) -> tuple[Variant, ...]:
    return (Variant("first-order lag", (Term("position_lag", 1.6 * c.step_s, 0.0, 800.0 * c.step_s),)),)


def _delay(parameter: str, share: float) -> Forms:
    """A delay from a share of the sampling period on, up to 5000 times that."""
    return lambda c: (
        Variant("plain", (Term(parameter, share * c.step_s, 0.0, 5e3 * share * c.step_s),), seen_by=(MOVES,)),
    )


def _dead_zone(c: Coverage) -> tuple[Variant, ...]:
    """A share of what friction takes; all of a current above the threshold shows only where a current turns its sign."""
    most = 10.0 * c.current
    return (
        Variant("what is beyond it", (Term("dead_zone", 0.01 * c.current, 0.0, most),), seen_by=(MOVES,)),
        Variant(
            "all above it",
            (Term("dead_zone", 0.2 * c.current, 0.0, most, step=0.01 * c.current),),
            (("zone_step", 1.0),),
            seen_by=(MOVES,),
        ),
    )


def _clamp(c: Coverage) -> tuple[Variant, ...]:
    term = Term("integrator_limit", 0.99 * c.integral, 5e-4 * c.integral)
    return (Variant("plain", (term,), seen_by=(MOVES,)),)


def _slew(c: Coverage) -> tuple[Variant, ...]:
    term = Term("accel_limit", 0.99 * c.acceleration, 0.016 * c.acceleration)
    return (
        Variant("plain", (term,), seen_by=(MOVES,)),
        Variant("planned", (term,), (("accel_ahead", 1.0),), seen_by=(MOVES,)),
    )


def _play(c: Coverage) -> tuple[Variant, ...]:
    return (Variant("play", (Term("backlash", 0.2 * c.position_noise, 0.0, 2.5 * c.travel),)),)


def _slip(c: Coverage) -> tuple[Variant, ...]:
    return (Variant("with torque", (Term("slip_per_torque", 5e-4 / c.torque, 0.0, 0.5 / c.torque),)),)


def _contact_damping(c: Coverage) -> tuple[Variant, ...]:
    drag = 1e-3 * c.torque / c.speed
    return (
        Variant("drag", (Term("contact_drag", drag, 0.0),), seen_by=(MOVES,)),
        Variant("with depth", (Term("contact_damping", 2.0 * drag / c.travel, 0.0),), seen_by=(MOVES,)),
    )


_GRATINGS_M = (1e-3, 5e-4, 2e-3)  # usual periods of incremental scales
FEWEST_PERIODS = (
    2.0  # of one, that the travel must cover: less is a bend, which a sensor that is not linear has too
)


def _scale(c: Coverage) -> tuple[Variant, ...]:
    """Per turn of the screw (of the motor, where no screw is known), and per period of a scale that the travel has twice."""
    own = c.turn if math.isnan(c.lead) else c.lead
    waves = _waves("position", 0.1 * c.position_noise)
    return tuple(
        Variant(f"{1e3 * period:.3g} mm", waves, (("position_period", period),))
        for period in dict.fromkeys((own, *(g for g in _GRATINGS_M if FEWEST_PERIODS * g <= c.travel)))
    )


_TEXTBOOK = "Armstrong-Helouvry et al., Automatica 30 (1994)"
_SPEEDS = "steady moves at four speeds or more, both directions"
_PITCHES = "the same moves at three pitches or more"

_TABLE = (
    Cause(
        "viscous_friction", "torque", "torque += b w, b per direction, or friction += T tanh(|w|/ws)",
        "textbook; lubricants that shear thin: Bair and Winer, J. Lubr. Technol. 101 (1979)",
        _viscous,
        confused_with=("stribeck_friction", "brush_drop"),
        separate_by=_SPEEDS,
    ),
    Cause(
        "stribeck_friction", "torque", "friction += T exp(-(w/ws)^2)", _TEXTBOOK,
        _stribeck,
        confused_with=("viscous_friction",),
        separate_by="slow moves, below 60 rad/s, and steady moves at four speeds",
    ),
    Cause(
        "torque_offset", "torque", "torque += T", "constant load, such as a cable or a spring",
        _one("torque_offset", _small, seen_by=(MOVES, FORCE)),
        aliases=("asymmetric_friction", "pitch_offset"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
    ),
    Cause(
        "asymmetric_friction", "torque", "friction += T sgn(w), or torque += c |w|", _TEXTBOOK,
        _asymmetric,
        aliases=("torque_offset", "pitch_offset"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
        separate_force="steady moves at four speeds or more, both directions, and again with the rig turned round",
    ),
    Cause(
        "load_dependent_friction", "torque", "friction += k |B theta|, or k |Km i - r J dw/dt|, r the rotor's share of J",
        "efficiency of screw and gear: friction times axial load, or times the transmitted torque",
        _load,
        confused_with=("gravity_nonlinearity",),
        separate_by=_PITCHES,
    ),
    Cause(
        "position_dependent_friction", "torque", "friction += a x + b x^2, or a bump T exp(-((x - x0)/width)^2)",
        "wear and alignment of the rails",
        _along_the_rails,
        confused_with=("screw_ripple",),
        separate_by="moves over the whole travel, both directions, two speeds",
    ),
    Cause(
        "friction_warmup", "torque", "friction += r A exp(-t/T), t since the log began", "grease that warms as it is worked",
        _warmup,
        confused_with=("winding_heating", "supply_sag"),
        separate_by="the same move again and again from cold for several minutes, and once more after a rest of an hour",
    ),
    Cause(
        "shaft_ripple", "torque", "torque += T sin(n phi + phase), n whole turns of the motor",
        "cogging and shaft misalignment",
        _shaft,
        confused_with=("screw_ripple",),
        separate_by="slow moves with the encoder logged: the ripple must stay with the motor angle",
    ),
    Cause(
        "gear_ripple", "torque", "torque += T sin(n phi + phase), n any other number of turns of the motor",
        "tooth mesh and run-out of a gear's later stages; order tracking",
        _gear,
        confused_with=("shaft_ripple", "screw_ripple"),
        separate_by="steady moves at two speeds: a ripple of the gear keeps its order, a disturbance in time its frequency",
    ),
    Cause(
        "screw_ripple", "torque", "torque += T sin(2 pi n D phi/lead + phase)", "run-out of the lead screw",
        _screw,
        confused_with=("position_dependent_friction", "position_periodic_error"),
        separate_by="moves over three screw turns or more",
    ),
    Cause(
        "gravity_nonlinearity", "torque", "torque += c theta^3, or c |theta| theta, or friction += k A (cos theta - 1)",
        "the small-pitch approximation of equation 7",
        _gravity,
        confused_with=("load_dependent_friction",),
        separate_by="moves at five pitches, as large as they get",
    ),
    Cause(
        "winding_heating", "electrical", "R += Rm h, dh/dt = g Rm i^2 - h/T, or h = r (1 - exp(-t/T))",
        "copper gains 0.39 % per kelvin",
        _heating,
        confused_with=("current_gain",),
        separate_by="a minute of moves under load and a minute of rest",
    ),
    Cause(
        "brush_drop", "electrical", "V += U tanh(i/i0)", "contact drop of brushes",
        _brushes,
        confused_with=("voltage_offset", "viscous_friction"),
        separate_by="slow moves in both directions and rests at several currents",
    ),
    Cause(
        "supply_sag", "electrical", "Vmax - sag, T dsag/dt = Rs' |i| - sag, or a drift in time", "battery and cable",
        _supply,
        confused_with=("integrator_clamp",),
        separate_by="the supply voltage itself, or starts of several sizes that saturate",
    ),
    Cause(
        "input_delay", "servo", "the servo follows w_cmd(t - T)", "communication and clock offset of the logger",
        _input_delay,
        confused_with=("current_lag", "voltage_delay"),
        separate_by="a faster logger through a start, both signals from one clock",
        separate_force="the force itself (a load cell, or the motor current) on the clock of the position",
    ),
    Cause(
        "current_lag", "servo", "T di/dt = i_cmd - i, before or behind the supply's limit",
        "bandwidth of the inner loop; inductance of the winding",
        _current_lag,
        confused_with=("input_delay",),
        separate_by="a faster logger through a start, both signals from one clock",
        separate_force="the motor current, through a step of force",
    ),
    Cause(
        "integrator_clamp", "servo", "|I| <= limit", "anti-windup of the servo",
        _clamp,
        confused_with=("supply_sag", "acceleration_limit"),
        separate_by="a full-speed start against pitch, which winds the integral up further",
    ),
    Cause(
        "acceleration_limit", "servo", "the servo's own command slews at most a, behind the given one or planned to end with it",
        "preset of the servo",
        _slew,
        confused_with=("integrator_clamp",),
        separate_by="starts to several speeds, one below saturation",
    ),
    Cause(
        "dead_zone", "servo", "i = i_cmd - clip(i_cmd, +-zone), or 0 where |i_cmd| < zone and i_cmd elsewhere",
        "threshold of a servo valve or of a bridge's dead time",
        _dead_zone,
        confused_with=("current_lag", "input_delay"),
        separate_by="slow moves and rests, at which the current is small, with the commanded current logged",
    ),
    Cause(
        "backlash", "kinematics", "the mass follows D phi within +-gap/2", "play of the nut",
        _play,
        confused_with=("position_lag", "position_delay"),
        separate_by="short moves there and back with rests",
    ),
    Cause(
        "partial_slip", "kinematics", "dx/dt = D w (1 - s - k |torque|)", "slipping nut or coupling",
        _slip,
        confused_with=("position_gain",),
        separate_by="moves at large pitch of either sign, with the encoder logged",
    ),
    Cause(
        "contact_exponent", "contact", "C d^n", "Hertzian contact: n = 1.5; equation 11: n = 2",
        _one("contact_exponent", lambda c: 2.02, 0.5, 4.0),
        confused_with=("contact_damping",),
        separate_by="slow moves into the stop, 5 mm deep",
    ),
    Cause(
        "contact_damping", "contact", "torque += (c |d| + c') w in contact", "Hunt and Crossley, J. Appl. Mech. 42 (1975)",
        _contact_damping,
        confused_with=("contact_exponent", "viscous_friction"),
        separate_by="moves into the stop at two speeds or more",
    ),
    Cause(
        "position_delay", "sensor:position", "x seen T late", "bus of the absolute sensor",
        _delay("position_delay", 1.6),
        confused_with=("position_lag", "backlash"),
        separate_by="fast short moves: a lag rounds the corners that a delay shifts",
    ),
    Cause(
        "position_lag", "sensor:position", "T dx_seen/dt = x - x_seen", "filter of the absolute sensor",
        _position_lag,
        confused_with=("position_delay", "backlash"),
        separate_by="fast short moves: a lag rounds the corners that a delay shifts",
    ),
    Cause(
        "position_gain", "sensor:position", "x_seen = k x", "calibration of the absolute sensor",
        _one("position_gain", lambda c: 1.0005),
        aliases=("partial_slip",),
        separate_by="a gauge block or calliper beside the position sensor",
    ),
    Cause(
        "position_periodic_error", "sensor:position", "x_seen = x + a sin(2 pi x/period + phase)",
        "interpolation error of scales",
        _scale,
        confused_with=("screw_ripple",),
        separate_by="a second position sensor, or moves over three periods or more",
    ),
    Cause(
        "current_offset", "sensor:current", "i_seen = i + i0", "zero of the current sensor",
        _one("current_offset", lambda c: 0.03 * c.current_noise),
        confused_with=("voltage_offset", "torque_offset"),
        separate_by="a rest with the servo off",
    ),
    Cause(
        "current_gain", "sensor:current", "i_seen = k i", "calibration of the current sensor",
        _one("current_gain", lambda c: 1.001),
        confused_with=("winding_heating",),
        separate_by="the winding's resistance with an ohmmeter: another Rm looks the same",
    ),
    Cause(
        "voltage_delay", "sensor:voltage", "V seen T late", "filter of the voltage channel",
        _delay("voltage_delay", 0.032),
        confused_with=("input_delay",),
        separate_by="a faster logger through a start",
    ),
    Cause(
        "voltage_offset", "sensor:voltage", "V_seen = V + V0", "zero of the voltage channel",
        _one("voltage_offset", lambda c: 0.1 * c.voltage_noise),
        confused_with=("current_offset", "brush_drop"),
        separate_by="a rest with the servo off",
    ),
    Cause(
        "pitch_offset", "sensor:pitch", "theta_seen = theta + theta0", "mounting of the inclinometer",
        _none,
        aliases=("torque_offset", "asymmetric_friction"),
        separate_by="the inclinometer on a level table, and the coupling open: an offset of pitch goes with the mass",
    ),
)  # fmt: skip

CAUSES: dict[str, Cause] = {cause.name: cause for cause in _TABLE}
EQUATIONS = ("torque", "electrical", "servo", "kinematics", "contact", "sensor")


def bounds(parameter: str, value: float) -> tuple[float, float]:
    """Within which an effect may move that a rig file gives.

    Bounds that hold on every rig as they are; of those that scale with rig and log, a tenth and ten times the value.
    """
    near, far = (_term(parameter, scale) for scale in (1.0, 2.0))
    if near is None or far is None:
        return -math.inf, math.inf
    low = near.low if near.low == far.low else (0.1 * value if near.low > 0.0 else -math.inf)
    high = near.high if near.high == far.high else (10.0 * value if near.low > 0.0 else math.inf)
    return low, high


def _term(parameter: str, scale: float) -> Term | None:
    """The first term of a parameter, on a rig and log of which everything is so large."""
    sizes: dict[str, Any] = dict.fromkeys(Coverage._fields[:-1], scale)
    coverage = Coverage(**sizes)._replace(low=0.0, lead=3.0 * scale, orders=(0.5,))
    forms = (v for cause in CAUSES.values() for v in cause.forms(coverage))
    return next((t for v in forms for t in v.terms if t.parameter == parameter), None)
