"""How an actuator may be driven: one row a drive. What differs between drives is a column of this table.

A row says which columns a log needs, which parameters a rig must give, and where the current comes from. Nothing else in
the package knows a drive by its name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType

from observer_fi.physics.equations import PARAMETERS


@dataclass(frozen=True)
class Drive:
    """One way of driving.

    name: as `drive` of a rig file. columns: what a log must hold besides time_s and position_m. requires: parameters that
    a rig must give. servo: equations 3 to 6 make the current of the commanded speed, so that a log can be simulated and
    the plant run open loop; without them the measured current drives. motor: a current drives; without one a force on the
    mass does, and nothing electrical can tell a fault. plant: parameters of the plant that a filter takes instead of the
    rig's. in_doubt: constants that every hypothesis estimates, besides friction and gravity.
    """

    name: str
    columns: tuple[str, ...]
    requires: tuple[str, ...]
    servo: bool
    motor: bool
    plant: Mapping[str, float]
    in_doubt: tuple[str, ...]

    def __post_init__(self) -> None:
        """Raises ValueError for a row that says nothing of its log or names a parameter that does not exist."""
        for f in fields(self):
            if f.name in ("name", "columns", "requires") and not getattr(self, f.name):
                raise ValueError(f"drive {self.name!r}: {f.name} is empty")
        for name in (*self.requires, *self.plant, *self.in_doubt):
            if name not in PARAMETERS:
                raise ValueError(f"drive {self.name!r}: there is no parameter {name!r}")
        if self.servo and not self.motor:
            raise ValueError(f"drive {self.name!r}: a servo drives a motor")


_MECHANICS = ("J", "A", "D")
_MOTOR = ("voltage_v", "current_a")
_ELECTRICS = (*_MECHANICS, "Rm", "Km")
_SERVO = (*_ELECTRICS, "Vmax", "Kp", "Ki", "Rs", "accel_cmd")
_RIGS_OWN: Mapping[str, float] = MappingProxyType({})
# A servo that nobody knows: i = Ki I is a random walk that the current sensor pins, without gains and limits.
_FREE_SERVO = MappingProxyType({"Kp": 0.0, "Ki": 1e-3, "Rs": 0.0, "Vmax": 1e6})


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
        requires=_SERVO,
        servo=True,
        motor=True,
        plant=_RIGS_OWN,
        in_doubt=("J", "Vmax"),
    ),
    Drive(
        name="voltage",
        columns=_MOTOR,
        requires=_ELECTRICS,
        servo=False,
        motor=True,
        plant=_FREE_SERVO,
        in_doubt=("J",),
    ),
    Drive(
        name="current",
        columns=("current_a",),
        requires=(*_MECHANICS, "Km"),
        servo=False,
        motor=True,
        plant=_FREE_SERVO,
        in_doubt=("J",),
    ),
    Drive(
        name="force",
        columns=("force_cmd_n",),
        requires=_MECHANICS,
        servo=False,
        motor=False,
        plant=_RIGS_OWN,
        in_doubt=(),
    ),
)
