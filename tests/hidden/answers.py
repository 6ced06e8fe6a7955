"""What `improve` should say of a hidden effect: which parameters of the package's model hold its size, and what they should be.

The only place that knows the names of both sides.
"""

from typing import NamedTuple

from .effects import Effect

# cause: the truth's parameter that is its size, the model's that should say so
_SIZES = {
    "viscous_friction": ("plus", "viscous_positive"),
    "stribeck_friction": ("rise", "stribeck_torque"),
    "load_dependent_friction": ("ratio", "load_friction"),
    "friction_warmup": ("rise", "warmup_rise"),
    "position_dependent_friction": ("gradient", "friction_slope"),
    "gravity_nonlinearity": ("cubic", "gravity_cubic"),
    "torque_offset": ("offset", "torque_offset"),
    "winding_heating": ("rise", "heating_gain"),
    "brush_drop": ("drop", "brush_drop"),
    "supply_sag": ("resistance", "sag_resistance"),
    "current_lag": ("lag", "current_lag"),
    "input_delay": ("delay", "input_delay"),
    "dead_zone": ("threshold", "dead_zone"),
    "integrator_clamp": ("limit", "integrator_limit"),
    "acceleration_limit": ("limit", "accel_limit"),
    "backlash": ("width", "backlash"),
    "partial_slip": ("slip", "slip_per_torque"),
    "contact_exponent": ("exponent", "contact_exponent"),
    "position_lag": ("lag", "position_lag"),
    "position_delay": ("delay", "position_delay"),
    "current_offset": ("offset", "current_offset"),
    "voltage_delay": ("delay", "voltage_delay"),
    "voltage_offset": ("offset", "voltage_offset"),
}
_GAINS = {
    "position_gain": "position_gain",
    "current_gain": "current_gain",
}  # the truth has 0.02, the model 1.02
_SINES = {
    "shaft_ripple": ("shaft_ripple_sin", "shaft_ripple_cos"),
    "screw_ripple": ("screw_ripple_sin", "screw_ripple_cos"),
    "position_periodic_error": ("position_sin", "position_cos"),
}


class Size(NamedTuple):
    """The model's parameter of an effect, or its sine and cosine, and the right value (of two: their amplitude), SI units."""

    parameters: tuple[str, ...]
    value: float


def right_size(effect: Effect) -> Size | None:
    """Which size is right; None where the two describe the effect by other numbers, so that no two can be compared."""
    values = dict(effect.values)
    if effect.cause in _SIZES:
        there, here = _SIZES[effect.cause]
        return Size((here,), values[there])
    if effect.cause in _GAINS:
        return Size((_GAINS[effect.cause],), 1.0 + values["gain"])
    if effect.cause in _SINES:
        return Size(_SINES[effect.cause], values["amplitude"])
    return None
