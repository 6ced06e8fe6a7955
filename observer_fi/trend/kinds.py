"""What a change of each quantity is called: its kind, the causes of the vocabulary that move it, and words for a technician."""

from fnmatch import fnmatchcase
from functools import cache
from typing import NamedTuple

from observer_fi.numerics import with_unit


class Kind(NamedTuple):
    """Quantities whose names match `pattern`.

    group: those that one cause moves together are judged together. cause, equation: of the contract's vocabulary; rivals: causes
    that move the same quantity. words: what it is; doubt: what else to think of when it changes.
    """

    pattern: str
    group: str
    cause: str
    equation: str
    rivals: tuple[str, ...]
    words: str
    doubt: str = ""


_RIPPLES = ("shaft_ripple", "gear_ripple", "position_periodic_error")
_FRICTION = ("viscous_friction", "load_dependent_friction", "friction_warmup")

KINDS = (
    Kind(
        "A",
        "friction",
        "asymmetric_friction",
        "torque",
        _FRICTION,
        "friction",
        "lubrication, preload or temperature",
    ),
    Kind(
        "friction_*",
        "friction",
        "asymmetric_friction",
        "torque",
        _FRICTION,
        "friction",
        "lubrication or preload",
    ),
    Kind(
        "torque_offset",
        "friction",
        "torque_offset",
        "torque",
        ("asymmetric_friction", "current_offset", "load_dependent_friction"),
        "half the difference of forward and backward torque",
        "a load, a spring, or friction of one direction",
    ),
    Kind(
        "B",
        "friction",
        "gravity_nonlinearity",
        "torque",
        ("torque_offset", "pitch_offset"),
        "torque per degree of pitch",
        "the mass that is carried",
    ),
    Kind(
        "J",
        "friction",
        "acceleration_torque",
        "torque",
        ("current_gain", "acceleration_limit"),
        "inertia",
        "the mass that is carried",
    ),
    Kind(
        "inertia",
        "friction",
        "acceleration_torque",
        "torque",
        ("viscous_friction", "current_lag"),
        "torque per acceleration",
    ),
    Kind(
        "viscous_*",
        "friction",
        "viscous_friction",
        "torque",
        ("stribeck_friction", "friction_warmup"),
        "friction per speed",
        "lubrication or temperature",
    ),
    Kind(
        "speed_slope_*",
        "friction",
        "viscous_friction",
        "torque",
        ("stribeck_friction", "friction_warmup"),
        "how friction changes with speed",
        "lubrication",
    ),
    Kind(
        "start_*_settling_torque",
        "friction",
        "stribeck_friction",
        "torque",
        ("viscous_friction", "asymmetric_friction"),
        "torque while a start settles",
        "lubrication",
    ),
    Kind(
        "start_*_torque",
        "friction",
        "stribeck_friction",
        "torque",
        ("backlash", "asymmetric_friction"),
        "torque of a start",
        "lubrication or play",
    ),
    Kind(
        "travel_*",
        "travel",
        "position_dependent_friction",
        "torque",
        ("gear_ripple",),
        "how friction changes along the travel",
        "wear or dirt at a place, alignment",
    ),
    Kind(
        "ripple_*",
        "ripple",
        "screw_ripple",
        "torque",
        _RIPPLES,
        "ripple along the travel",
        "the screw, nut or their mounting",
    ),
    Kind(
        "roughness_*",
        "roughness",
        "position_dependent_friction",
        "torque",
        ("gear_ripple", "stribeck_friction"),
        "roughness of the torque",
        "raceway, balls, or lubrication",
    ),
    Kind(
        "stop_*_torque",
        "reversal",
        "backlash",
        "kinematics",
        ("stribeck_friction", "integrator_clamp"),
        "torque where a move ends and turns back",
        "play of nut or coupling",
    ),
    Kind(
        "*_lag",
        "reversal",
        "backlash",
        "kinematics",
        ("input_delay", "integrator_clamp"),
        "position error after a start or stop",
        "play, or the position loop",
    ),
    Kind(
        "backlash",
        "reversal",
        "backlash",
        "kinematics",
        ("position_lag", "partial_slip"),
        "play at reversals",
        "nut or coupling",
    ),
    Kind(
        "steady_error_*_scatter",
        "loop",
        "dead_zone",
        "servo",
        ("backlash", "position_periodic_error"),
        "unrest of the position error in motion",
        "play, or the position loop",
    ),
    Kind(
        "steady_error_*", "loop", "position_lag", "sensor:position", ("input_delay",), "steady position error"
    ),
    Kind(
        "holding_*_scatter",
        "loop",
        "backlash",
        "kinematics",
        ("dead_zone",),
        "unrest at rest",
        "play, or the position loop",
    ),
    Kind("holding_error", "loop", "dead_zone", "servo", ("position_gain",), "position error at rest"),
    Kind(
        "holding_torque", "loop", "dead_zone", "servo", ("current_offset", "torque_offset"), "torque at rest"
    ),
    Kind("Kp", "servo", "current_gain", "sensor:current", ("current_lag",), "proportional gain of the servo"),
    Kind("Ki", "servo", "current_gain", "sensor:current", ("current_lag",), "integral gain of the servo"),
    Kind("servo_delay", "servo", "current_lag", "servo", ("input_delay",), "delay of the servo"),
    Kind(
        "input_delay",
        "servo",
        "input_delay",
        "servo",
        ("current_lag", "voltage_delay"),
        "delay of the command",
    ),
    Kind(
        "current_offset",
        "friction",
        "current_offset",
        "sensor:current",
        ("torque_offset",),
        "current at rest",
    ),
    Kind(
        "Rm",
        "electrical",
        "winding_heating",
        "electrical",
        ("brush_drop", "current_gain"),
        "resistance of the winding",
        "temperature or brushes",
    ),
    Kind("Km", "electrical", "current_gain", "sensor:current", ("position_gain",), "torque constant"),
    Kind("Rs", "electrical", "supply_sag", "electrical", (), "resistance of the source"),
    Kind("Vmax", "electrical", "supply_sag", "electrical", (), "voltage of the source"),
    Kind(
        "D",
        "kinematics",
        "position_gain",
        "sensor:position",
        ("partial_slip",),
        "travel per turn of the motor",
    ),
    Kind(
        "position_lag",
        "kinematics",
        "position_lag",
        "sensor:position",
        ("position_delay",),
        "lag of the position",
    ),
    Kind(
        "misfit_current",
        "misfit",
        "shaft_ripple",
        "torque",
        ("gear_ripple", "screw_ripple", "position_dependent_friction"),
        "what the constants do not explain of the current",
    ),
    Kind(
        "misfit_position",
        "misfit",
        "position_periodic_error",
        "sensor:position",
        ("backlash",),
        "what the constants do not explain of the position",
    ),
    Kind(
        "misfit_speed",
        "misfit",
        "shaft_ripple",
        "torque",
        ("gear_ripple", "screw_ripple"),
        "what the constants do not explain of the speed",
    ),
)
OTHER = Kind("*", "other", "unknown", "torque", (), "")


@cache
def kind_of(name: str) -> Kind:
    """The kind of a quantity."""
    return next((kind for kind in KINDS if fnmatchcase(name, kind.pattern)), OTHER)


def in_words(name: str) -> str:
    """A quantity in words: what it is, and which direction and place it is of."""
    kind = kind_of(name)
    base, _, period = name.partition("@")
    ways = [way for way in ("forward", "backward") if f"_{way}" in base]
    band = next((band for band in ("slow", "middle", "fast") if f"_{band}_" in base), "")
    words = f"{band} {kind.words or base.replace('_', ' ')}".strip()
    words += f", {ways[0]}" if ways else ""
    return words + (f", every {with_unit(float(period), 'm')}" if period else "")
