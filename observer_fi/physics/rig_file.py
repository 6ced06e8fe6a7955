"""What a rig file may hold: the type and the physical range of every value, checked by pydantic.

Ranges are those beyond which no actuator of this kind exists or an equation has no meaning; what a value should be is for
`identify` to say.
"""

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator

from observer_fi.physics.equations import PARAMETERS
from observer_fi.settings import checked

# Name of a parameter: smallest and largest value, SI units. A bound that is open (above 0) is a number no rig comes near.
ABOVE_ZERO = 1e-30
RANGES: dict[str, tuple[float, float]] = {
    "Rm": (1e-6, 1e6),
    "Km": (1e-9, 1e3),
    "D": (1e-12, 1e2),
    "Vmax": (1e-3, 1e5),
    "Kp": (0.0, 1e6),
    "Ki": (0.0, 1e6),
    "J": (1e-15, 1e6),
    "A": (0.0, 1e6),
    "Rs": (0.0, 1e6),
    "A_decoupled": (0.0, 1e6),
    "J_decoupled": (1e-15, 1e6),
    "accel_cmd": (1e-6, 1e12),
    "coupling": (0.0, 1.0),
    "contact": (0.0, 1.0),
    "rubbing": (0.0, 1.0),
    "stribeck_speed": (ABOVE_ZERO, 1e9),
    "saturation_speed": (ABOVE_ZERO, 1e9),
    "shaft_order": (ABOVE_ZERO, 1e6),
    "gear_order": (ABOVE_ZERO, 1e6),
    "screw_lead": (ABOVE_ZERO, 1e3),
    "bump_width": (ABOVE_ZERO, 1e3),
    "position_period": (ABOVE_ZERO, 1e3),
    "heating_time": (ABOVE_ZERO, 1e9),
    "sag_time": (ABOVE_ZERO, 1e9),
    "brush_current": (ABOVE_ZERO, 1e6),
    "servo_delay": (-1.0, 1.0),
    "tick_phase": (-1.0, 1.0),
    "tick_share": (-2.0, 2.0),
    "input_delay": (-1.0, 10.0),
    "current_lag": (0.0, 10.0),
    "position_lag": (0.0, 10.0),
    "position_delay": (-1.0, 10.0),
    "voltage_delay": (-1.0, 10.0),
    "integrator_limit": (ABOVE_ZERO, math.inf),
    "accel_limit": (1e-6, math.inf),
    "x_stop_high": (-1e3, math.inf),
    "x_stop_low": (-math.inf, 1e3),
    "contact_exponent": (0.0, 20.0),
    "pitch_offset": (-180.0, 180.0),
}
LARGEST = 1e15  # of any other parameter

# How far an equation may be off between two samples: of the torque [N m s^1/2], of the servo's current [A/s^1/2], of every change
# of the speed (a share, at 1600 samples a second), of the travel [m/s^1/2], of the friction from move to move [1/s^1/2].
ERRORS = ("torque", "servo", "change", "travel", "friction")

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]
Spread = Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)]
Error = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=10_000)]


class _Strict(BaseModel):
    """Types as they stand: no text for a number, no truth value for one. Names that do not exist are for `rigs.py`."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True)


class _Quantity(_Strict):
    value: float
    unit: Text = ""
    method: Text = ""
    source: Text = ""
    spread: Spread = 0.0
    std: Error | None = None


class _Curve(_Strict):
    equation: Text = ""
    regressor: Text = ""
    directed: bool = False
    first: Finite = 0.0
    step: Finite = 1.0
    unit: Text = ""
    values: Annotated[list[Finite], Field(max_length=1000)] = []
    std: Annotated[list[Error], Field(max_length=1000)] = []


class _Inductance(_Quantity):
    value: Annotated[float, Field(gt=0.0, le=1e3, allow_inf_nan=False)]


class _Channel(_Strict):
    noise_std: Error = 0.0
    as_white: Error | None = None
    resolution: Positive | None = None
    update_hz: Positive | None = None
    lines_hz: Annotated[list[Positive], Field(max_length=20)] = []
    line_amplitudes: Annotated[list[Error], Field(max_length=20)] = []
    correlation_s: Positive | None = None
    spikes: Annotated[int, Field(ge=0)] = 0
    averaged_samples: Annotated[int, Field(ge=1, le=10**6)] = 1
    low_pass_hz: Positive | None = None
    late_s: Error | None = None


class _Clock(_Strict):
    jitter_s: Error = 0.0
    resolution_s: Positive | None = None


class _Acquisition(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    voltage_v: _Channel = _Channel()
    current_a: _Channel = _Channel()
    position_m: _Channel = _Channel()
    clock: _Clock = _Clock()


class _RigFile(_Strict):
    name: Annotated[str, Field(min_length=1, max_length=200)] = "rig"
    description: Text = ""
    drive: Text = ""
    source: Text = ""
    noise: dict[str, Positive] = {}
    parameters: dict[str, _Quantity] = {}
    curve: _Curve | None = None
    acquisition: _Acquisition | None = None
    errors: dict[str, Positive] = {}
    inductance: _Inductance | None = None

    @field_validator("parameters", mode="before")
    @classmethod
    def _plain_numbers(cls, given: Any) -> Any:
        """A number alone stands for { value = ... }."""
        if not isinstance(given, dict):
            return given
        return {name: entry if isinstance(entry, dict) else {"value": entry} for name, entry in given.items()}

    @field_validator("parameters")
    @classmethod
    def _in_range(cls, found: dict[str, _Quantity]) -> dict[str, _Quantity]:
        for name, entry in found.items():
            _check_range(name, entry.value)
        high, low = (found[n].value if n in found else None for n in ("x_stop_high", "x_stop_low"))
        if high is not None and low is not None and not low < high:
            raise ValueError(
                f"parameters.x_stop_low.value must be below x_stop_high, got {low:g} and {high:g}"
            )
        return found


def _check_range(name: str, value: float) -> None:
    neutral = PARAMETERS[name][1] if name in PARAMETERS else None
    if value == neutral:
        return
    low, high = RANGES.get(name, (-LARGEST, LARGEST))
    if not low <= value <= high:
        said = "above 0" if low == ABOVE_ZERO else f"from {low:g}"
        unit = f" {PARAMETERS[name][0]}" if name in PARAMETERS else ""
        raise ValueError(f"parameters.{name}.value must be a number {said} to {high:g}{unit}, got {value:g}")


def check(table: dict[str, Any]) -> None:
    """Types and ranges of a parsed rig file. Raises UsageError that names the key, the value and what it may be."""
    checked(_RigFile, table)
