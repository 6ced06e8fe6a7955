"""Rows of cells of any type as text between tabs, and how much may be read for them."""

import datetime
from collections.abc import Iterable
from typing import Any

from observer_fi.errors import InvalidLogError

MOST_BYTES = 1 << 29  # what stands in memory is ten times that
_BREAKS = str.maketrans("\t\r\n", "   ")


def text_of(rows: Iterable[Iterable[Any]]) -> bytes:
    """Rows of cells as lines between tabs; a row without any is a blank line."""
    lines = ("\t".join(map(_cell, row)) for row in rows)
    return "".join((line if line.strip("\t") else "") + "\n" for line in lines).encode()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return repr(value) if isinstance(value, float) else str(value).translate(_BREAKS)


def at_most(pieces: Iterable[bytes]) -> bytes:
    """The pieces joined. Raises InvalidLogError for more than `MOST_BYTES`."""
    held, there = [], 0
    for piece in pieces:
        held.append(piece)
        there += len(piece)
        if there > MOST_BYTES:
            raise InvalidLogError(
                f"more than {MOST_BYTES >> 20} MB of this kind; write the log as CSV or Parquet, with a column a signal"
            )
    return b"".join(held)
