"""How an actuator may be driven: one row a drive. What differs between drives is a column of this table.

A row says which columns a log needs, which parameters a rig must give, where the current comes from and how a motor begins
that friction holds. Nothing else in
the package knows a drive by its name.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from observer_fi.physics.equations import DEAD_ZONE, KI, KM, KX, PARAMETERS, X_WINDOW, ZONE_STEP, A, D
from observer_fi.records import Array


class CommandLaw(NamedTuple):
    """How other columns make the commanded speed: `of` takes them in order, then the parameter vector [rad/s]."""

    columns: tuple[str, ...]
    of: Callable[..., Array]


class Rest(NamedTuple):
    """What drives a motor that friction holds: current c [A], the error integral I that makes it [rad] and its deviation."""

    c: Any
    I: Any  # noqa: E741
    I_std: float


@dataclass(frozen=True)
class Drive:
    """One way of driving.

    name: as `drive` of a rig file. columns: what a log must hold besides time_s and position_m. requires: parameters that
    a rig must give; excludes: those it must not. servo: equations 3 to 6 make the current of the commanded speed, so that
    a log can be simulated and the plant run open loop; without them the measured current drives. motor: a current drives;
    without one a force on the mass does, and nothing electrical can tell a fault. plant: parameters of the plant that a
    filter takes instead of the rig's. command: the law by which other columns make the commanded speed; None: it is logged,
    or recovered. at_rest: from the current [A] and the parameter vector, what drives a motor that friction holds. in_doubt:
    constants that every hypothesis estimates, besides friction and gravity.
    """

    name: str
    columns: tuple[str, ...]
    requires: tuple[str, ...]
    excludes: tuple[str, ...]
    servo: bool
    motor: bool
    plant: Mapping[str, float]
    command: CommandLaw | None
    at_rest: Callable[[Any, Array], Rest]
    in_doubt: tuple[str, ...]

    def __post_init__(self) -> None:
        """Raises ValueError for a row that says nothing of its log or names a parameter that does not exist."""
        for f in fields(self):
            if f.name in ("name", "columns", "requires") and not getattr(self, f.name):
                raise ValueError(f"drive {self.name!r}: {f.name} is empty")
        for name in (*self.requires, *self.excludes, *self.plant, *self.in_doubt):
            if name not in PARAMETERS:
                raise ValueError(f"drive {self.name!r}: there is no parameter {name!r}")
        if self.servo and not self.motor:
            raise ValueError(f"drive {self.name!r}: a servo drives a motor")


_MECHANICS = ("J", "A", "D")
_MOTOR = ("voltage_v", "current_a")
_ELECTRICS = (*_MECHANICS, "Rm", "Km")
_LOOP = SERVOS_OWN = ("Vmax", "Kp", "Ki", "Rs")
_RIGS_OWN: Mapping[str, float] = MappingProxyType({})
# A servo that nobody knows: i = Ki I is a random walk that the current sensor pins, without gains and limits.
_FREE_SERVO = MappingProxyType({"Kp": 0.0, "Ki": 1e-3, "Rs": 0.0, "Vmax": 1e6})


def position_loop(goal: Array, angle: Array, p: Array) -> Array:
    """Commanded speed of a proportional position loop, Kx (x_cmd / D - phi), 0 within its window [rad/s].

    goal: commanded position [m]; angle: of the motor [rad], 0 where the position is.
    """
    error = goal / p[D] - angle
    return np.where(np.abs(error) * p[D] <= p[X_WINDOW], 0.0, p[KX] * error)  # NaN where a reading is missing


_UNKNOWN_INTEGRAL = (
    0.05  # rad, the friction band of the paper's rig: where nothing makes a current of the integral
)


_NEXT_TO_NONE = 0.05  # of the threshold of a dead zone: so small a current may be none


def held_by_servo(i: Any, p: Array) -> Rest:
    """The integral makes the current, anywhere in the band that friction holds: +-A / (Km Ki), without anti-windup."""
    pull = float(p[KM] * p[KI])
    if not pull:
        return Rest(i, i / p[KI] if p[KI] else 0.0 * i, 0.5 * _UNKNOWN_INTEGRAL)
    return Rest(
        i, _before_dead_zone(i, p) / p[KI], math.hypot(0.5 * float(p[A]) / pull, p[DEAD_ZONE] / p[KI])
    )


def _before_dead_zone(i: Any, p: Array) -> Any:
    """What a servo asks for that drives the current i [A]: where next to none flows, anything within the zone."""
    size = np.abs(i)
    hidden = np.minimum(size / _NEXT_TO_NONE, p[DEAD_ZONE])
    return np.sign(i) * (np.maximum(size, hidden) if p[ZONE_STEP] else size + hidden)


def unloaded(i: Any, p: Array) -> Rest:
    """A motor that no current drives, or none at all."""
    return Rest(0.0 * i, 0.0 * i, 0.0)


def table(*rows: Drive) -> Mapping[str, Drive]:
    """Rows by name. Raises ValueError where two have one name."""
    found = {row.name: row for row in rows}
    if len(found) < len(rows):
        raise ValueError(f"two drives of one name: {', '.join(row.name for row in rows)}")
    return MappingProxyType(found)


DRIVES = table(
    Drive(
        name="pi_servo",
        columns=_MOTOR,  # the commanded speed is recovered where the log has none
        requires=(*_ELECTRICS, *_LOOP, "accel_cmd"),
        excludes=("Kx", "x_window"),
        servo=True,
        motor=True,
        plant=_RIGS_OWN,
        command=None,
        at_rest=held_by_servo,
        in_doubt=("J", "Vmax"),
    ),
    Drive(
        name="position_servo",
        columns=(*_MOTOR, "position_cmd_m", "encoder_rad"),
        requires=(*_ELECTRICS, *_LOOP, "Kx"),
        excludes=("accel_cmd",),  # its speed command has no corners to look for
        servo=True,
        motor=True,
        plant=_RIGS_OWN,
        command=CommandLaw(("position_cmd_m", "encoder_rad"), position_loop),
        at_rest=held_by_servo,
        in_doubt=("J", "Vmax"),
    ),
    Drive(
        name="voltage",
        columns=_MOTOR,
        requires=_ELECTRICS,
        excludes=("Kx", "x_window"),
        servo=False,
        motor=True,
        plant=_FREE_SERVO,
        command=None,
        at_rest=held_by_servo,
        in_doubt=("J",),
    ),
    Drive(
        name="current",
        columns=("current_a",),
        requires=(*_MECHANICS, "Km"),
        excludes=("Kx", "x_window"),
        servo=False,
        motor=True,
        plant=_FREE_SERVO,
        command=None,
        at_rest=held_by_servo,
        in_doubt=("J",),
    ),
    Drive(
        name="force",
        columns=("force_cmd_n",),
        requires=_MECHANICS,
        excludes=("Kx", "x_window"),
        servo=False,
        motor=False,
        plant=_RIGS_OWN,
        command=None,
        at_rest=unloaded,
        in_doubt=(),
    ),
)
