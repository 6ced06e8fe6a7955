"""The order of logs in time: what they say themselves, else their names."""

import re
from collections.abc import Sequence
from datetime import datetime

import numpy as np

from observer_fi.records import Array
from observer_fi.trend.digests import Digest

BY_TIME, BY_NAME = (
    "the times of recording that the logs give",
    "the names of the logs, numbers in them by value",
)
DAYS, LOGS = "days", "logs"


def ordered(digests: Sequence[Digest]) -> tuple[list[Digest], Array, str, str]:
    """The digests in order, (n,) times from the first, what the order comes from, and the unit of the times.

    By time of recording where every log has one and they differ, else by name.
    """
    stamps = [_seconds(d.time) for d in digests]
    known = [s for s in stamps if s is not None]
    if known and len(known) == len(digests) and len(set(known)) == len(known):
        rows = np.argsort(known, kind="stable")
        days = (np.array(known)[rows] - min(known)) / 86400.0
        return [digests[k] for k in rows], days, BY_TIME, DAYS
    by_name = sorted(digests, key=lambda d: natural(d.path))
    return by_name, np.arange(len(by_name), dtype=float), BY_NAME, LOGS


def natural(text: str) -> tuple[tuple[bool, int, str], ...]:
    """A key that sorts log2 before log10."""
    parts = re.split(r"(\d+)", text)
    return tuple((part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts)


def _seconds(time: str) -> float | None:
    if not time:
        return None
    moment = datetime.fromisoformat(time)
    return moment.timestamp() if moment.tzinfo else (moment - datetime(1970, 1, 1)).total_seconds()
