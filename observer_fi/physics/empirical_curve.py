"""An empirical curve of a rig: a disturbance of one equation over one regressor, for what no named cause explains.

It is a stopgap: it says how large something is and over what it runs, not what it is. In the equations it stands as the
parameters `curve_...` of `actuator.py`, in a rig file as the table [curve].
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from observer_fi.errors import UsageError
from observer_fi.physics import equations as a

_OF = {
    ("torque", False): a.TORQUE,
    ("torque", True): a.DRAG,
    ("electrical", False): a.RESISTANCE,
    ("sensor:position", False): a.SHOWN_POSITION,
    ("sensor:current", False): a.SHOWN_CURRENT,
}
_OVER = {
    "speed": a.SPEED,
    "position": a.POSITION,
    "pitch": a.PITCH,
    "shaft_angle": a.SHAFT_ANGLE,
    "screw_angle": a.SCREW_ANGLE,
    "current": a.CURRENT,
}
# What the equations know where the curve enters them.
_KNOWN = {
    a.TORQUE: ("speed", "position", "pitch", "shaft_angle", "screw_angle"),
    a.DRAG: ("speed", "position", "pitch", "screw_angle"),
    a.RESISTANCE: ("speed", "current"),
    a.SHOWN_POSITION: ("position",),
    a.SHOWN_CURRENT: ("current",),
}
ANGLES = ("shaft_angle", "screw_angle")
FRAME = ("curve_of", "curve_over", "curve_first", "curve_step", "curve_last")
_KEYS = ("equation", "regressor", "directed", "first", "step", "unit", "values", "std")
_REQUIRED = ("equation", "regressor", "first", "step", "values")


@dataclass(frozen=True)
class Curve:
    """equation and regressor as in `improve.json`; directed: the torque follows the direction of motion, as friction does.

    values (n,) at first, first + step, ... of the regressor (SI, pitch in degrees), in the unit of the equation; linear
    between, constant beyond, closed over a turn for an angle. std: standard errors, as many, or none.
    """

    equation: str
    regressor: str
    directed: bool
    first: float
    step: float
    values: tuple[float, ...]
    std: tuple[float, ...] = ()

    @property
    def unit(self) -> str:
        """Of the values."""
        return {"torque": "N m", "electrical": "ohm", "sensor:position": "m", "sensor:current": "A"}[
            self.equation
        ]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters of the equations that hold the values."""
        return value_names(len(self.values))


def value_names(count: int) -> tuple[str, ...]:
    """Parameters that hold the first `count` values of a curve."""
    return tuple(f"curve_{k:02d}" for k in range(count))


def is_possible(equation: str, regressor: str, directed: bool) -> bool:
    """Whether the equations know the regressor where such a curve would enter them."""
    return regressor in _KNOWN.get(_OF.get((equation, directed), 0.0), ())


def parameters(curve: Curve) -> dict[str, float]:
    """The curve as parameters of the equations. Raises UsageError for what the equations cannot take."""
    _check(curve)
    last = len(curve.values) - (0 if curve.regressor in ANGLES else 1)
    frame = (
        _OF[curve.equation, curve.directed],
        _OVER[curve.regressor],
        curve.first,
        curve.step,
        float(last),
    )
    return {**dict(zip(FRAME, frame, strict=True)), **dict(zip(curve.names, curve.values, strict=True))}


def is_curve(parameter: str) -> bool:
    """Whether a parameter of the equations belongs to a curve."""
    return parameter.startswith("curve_")


def curve_of(values: Mapping[str, float], std: Mapping[str, float] | None = None) -> Curve | None:
    """The curve that parameters of the equations hold, None where there is none."""
    if values.get("curve_of", 0.0) == 0.0:
        return None
    equation, directed = next(key for key, code in _OF.items() if code == values["curve_of"])
    regressor = next(name for name, code in _OVER.items() if code == values["curve_over"])
    names = value_names(int(values["curve_last"]) + (0 if regressor in ANGLES else 1))
    errors = tuple((std or {})[n] for n in names) if std and all(n in std for n in names) else ()
    return Curve(
        equation, regressor, directed, values["curve_first"], values["curve_step"], tuple(values[n] for n in names), errors
    )  # fmt: skip


def from_table(table: object) -> Curve:
    """The table [curve] of a rig file. Raises UsageError that says which key is wrong and what it may be."""
    if not isinstance(table, dict):
        raise UsageError(f"curve must be a table, got {table!r}")
    for key in table:
        if key not in _KEYS:
            raise UsageError(f"there is no key {key!r} in curve (known: {', '.join(_KEYS)})")
    missing = [key for key in _REQUIRED if key not in table]
    if missing:
        raise UsageError(f"keys missing in curve: {', '.join(missing)}")
    try:
        curve = Curve(
            table["equation"], table["regressor"], bool(table.get("directed", False)), float(table["first"]),
            float(table["step"]), tuple(map(float, table["values"])), tuple(map(float, table.get("std", ()))),
        )  # fmt: skip
    except (TypeError, ValueError) as error:
        raise UsageError(f"curve: first, step, values and std are numbers ({error})") from error
    _check(curve)
    if table.get("unit", curve.unit) != curve.unit:
        raise UsageError(f"curve: unit must be {curve.unit!r}, got {table['unit']!r}")
    return curve


def to_table(curve: Curve) -> dict[str, Any]:
    """The table [curve] of a rig file."""
    table: dict[str, Any] = {
        "equation": curve.equation, "regressor": curve.regressor, "directed": curve.directed,
        "first": curve.first, "step": curve.step, "unit": curve.unit, "values": list(curve.values),
    }  # fmt: skip
    return table | ({"std": list(curve.std)} if curve.std else {})


def _check(curve: Curve) -> None:
    if not all(map(math.isfinite, (curve.first, curve.step, *curve.values, *curve.std))):
        raise UsageError("curve: first, step, values and std must be finite numbers")
    if (curve.equation, curve.directed) not in _OF:
        known = ", ".join(dict.fromkeys(equation for equation, _ in _OF))
        raise UsageError(
            f"curve: equation must be one of {known} (directed: torque alone), got {curve.equation!r}"
        )
    known_here = _KNOWN[_OF[curve.equation, curve.directed]]
    if curve.regressor not in known_here:
        raise UsageError(
            f"curve: regressor of {curve.equation} must be one of {', '.join(known_here)}, got {curve.regressor!r}"
        )
    if not 2 <= len(curve.values) <= a.MOST_POINTS:
        raise UsageError(f"curve: 2 to {a.MOST_POINTS} values, got {len(curve.values)}")
    if curve.std and len(curve.std) != len(curve.values):
        raise UsageError(f"curve: as many std as values, got {len(curve.std)} and {len(curve.values)}")
    if not curve.step > 0.0:
        raise UsageError(f"curve: step must be above 0, got {curve.step:g}")
