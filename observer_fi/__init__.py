"""Observer-based fault isolation: a DAQ log of a linear actuator in, a verdict out.

    from observer_fi import diagnose
    found = diagnose(frame, rig="mass_shifter")  # a DataFrame, or the path of a log
    print(found)
    found.plot().savefig("verdict.png")

Names are imported when they are first used: numba and pandas take longer to load than most commands take to say no.
"""

import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType
from typing import TYPE_CHECKING, Any

from observer_fi.errors import InvalidLogError, UsageError

if TYPE_CHECKING:
    from observer_fi.logs import ColumnMap, load_columns, log_from_frame, read_log
    from observer_fi.physics import CAUSES, FAULTS, Move, Rig, Scenario, load_rig
    from observer_fi.records import Log
    from observer_fi.report import (
        Comparison,
        Diagnosis,
        Identification,
        Improved,
        Inspected,
        Life,
        Planned,
        compare,
        diagnose,
        identify,
        improve,
        inspect,
        plan,
        simulate,
        trend,
        write_report,
    )
    from observer_fi.settings import Settings

try:
    __version__ = version("observer-fi")
except PackageNotFoundError:  # run from a checkout that was never installed
    __version__ = "0+unknown"

_ROOMS = {
    "observer_fi.logs": ("ColumnMap", "load_columns", "log_from_frame", "read_log"),
    "observer_fi.physics": ("CAUSES", "FAULTS", "Move", "Rig", "Scenario", "load_rig"),
    "observer_fi.records": ("Log",),
    "observer_fi.report": (
        "Comparison",
        "Diagnosis",
        "Identification",
        "Improved",
        "Inspected",
        "Life",
        "Planned",
        "compare",
        "diagnose",
        "identify",
        "improve",
        "inspect",
        "plan",
        "simulate",
        "trend",
        "write_report",
    ),
    "observer_fi.settings": ("Settings",),
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "CAUSES",
    "ColumnMap",
    "Comparison",
    "Diagnosis",
    "FAULTS",
    "Identification",
    "Improved",
    "Inspected",
    "InvalidLogError",
    "Life",
    "Log",
    "Move",
    "Planned",
    "Rig",
    "Scenario",
    "Settings",
    "UsageError",
    "compare",
    "diagnose",
    "identify",
    "improve",
    "inspect",
    "load_columns",
    "load_rig",
    "log_from_frame",
    "plan",
    "read_log",
    "simulate",
    "trend",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_ROOM_OF[name]), name)
    globals()[name] = found
    return found


class _Package(ModuleType):
    """A package whose function `improve` stays one: importing the room of that name would put the room in its place."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _ROOM_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
