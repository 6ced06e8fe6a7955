"""Which drives a log has the columns for, and what is missing for which."""

from collections.abc import Collection
from typing import NamedTuple

from observer_fi.physics import DRIVES

ALWAYS = ("time_s", "position_m")
RECOVERED = "speed_cmd_rad_s"  # a log may lack it, a stream may not


class Need(NamedTuple):
    """A drive: columns that are missing for any command, and those that only a live stream (`watch`) needs besides."""

    drive: str
    missing: tuple[str, ...]
    for_streams: tuple[str, ...]


def needs(columns: Collection[str]) -> tuple[Need, ...]:
    """What a log with these columns lacks, drive by drive."""
    found = []
    for drive in DRIVES.values():
        wanted = dict.fromkeys((*ALWAYS, *drive.columns))
        missing = tuple(column for column in wanted if column not in columns)
        live = () if drive.command or not drive.motor or RECOVERED in columns else (RECOVERED,)
        found.append(Need(drive.name, missing, live))
    return tuple(found)
