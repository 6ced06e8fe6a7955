"""How an actuator may be driven: one row a drive. What differs between drives is a column of this table.

A row says which columns a log needs, which parameters a rig must give, and where the current comes from. Nothing else in
the package knows a drive by its name.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.physics.equations import KX, PARAMETERS, X_WINDOW, D
from observer_fi.records import Array, Log


@dataclass(frozen=True)
class Drive:
    """One way of driving.

    name: as `drive` of a rig file. columns: what a log must hold besides time_s and position_m. requires: parameters that
    a rig must give; excludes: those it must not. servo: equations 3 to 6 make the current of the commanded speed, so that
    a log can be simulated and the plant run open loop; without them the measured current drives. motor: a current drives;
    without one a force on the mass does, and nothing electrical can tell a fault. plant: parameters of the plant that a
    filter takes instead of the rig's. command: the law by which other columns of a log and the parameter vector make the
    commanded speed; None: it is logged, or recovered. in_doubt: constants that every hypothesis estimates, besides
    friction and gravity.
    """

    name: str
    columns: tuple[str, ...]
    requires: tuple[str, ...]
    excludes: tuple[str, ...]
    servo: bool
    motor: bool
    plant: Mapping[str, float]
    command: Callable[[Log, Array], Array] | None
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
_LOOP = ("Vmax", "Kp", "Ki", "Rs")
_RIGS_OWN: Mapping[str, float] = MappingProxyType({})
# A servo that nobody knows: i = Ki I is a random walk that the current sensor pins, without gains and limits.
_FREE_SERVO = MappingProxyType({"Kp": 0.0, "Ki": 1e-3, "Rs": 0.0, "Vmax": 1e6})


def position_loop(goal: Array, angle: Array, p: Array) -> Array:
    """Commanded speed of a proportional position loop, Kx (x_cmd / D - phi), 0 within its window [rad/s].

    goal: commanded position [m]; angle: of the motor [rad], 0 where the position is.
    """
    error = goal / p[D] - angle
    return np.where(np.abs(error) * p[D] > p[X_WINDOW], p[KX] * error, 0.0)


def _of_position(log: Log, p: Array) -> Array:
    """The law of `position_servo` on the columns of a log."""
    goal, angle = log.position_cmd, log.encoder
    if goal is None or angle is None:
        raise InvalidLogError(
            f"{log.path}: column {'position_cmd_m' if goal is None else 'encoder_rad'} is missing, which the loop of a "
            'position servo needs; log it, or give a rig with drive = "voltage"'
        )
    return position_loop(goal, angle, p)


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
        command=_of_position,
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
        in_doubt=(),
    ),
)
