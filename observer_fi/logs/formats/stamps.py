"""Absolute time stamps as seconds from the first one on: dates and times of day as texts, or typed ones of binary formats.

Texts are ISO 8601, with or without a zone, day.month.year, month/day/year, or a time of day alone; a fraction of a second has a
point or a comma. Nanoseconds are counted as whole numbers, so that nothing is rounded before the start is taken off.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.tables import place, position
from observer_fi.records import Array

Nanoseconds = NDArray[np.int64]
Mask = NDArray[np.bool_]

TIME_OF_DAY = "time of day"  # its column, beside time_s with the date
SECOND, DAY = 10**9, 86_400 * 10**9
STAMP = (
    r"^\s*(?:(?P<a>\d{1,4})(?P<k>[-./ ])(?P<b>\d{1,2}|\p{L}{3,9}\.?)[-./ ](?P<c>\d{1,4})(?:[ T]+|$))?"
    r"(?:(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9})\d*)?)?)?"
    r"\s*(?P<p>[AaPp]\.?[Mm]\.?)?\s*(?P<z>Z|UTC|GMT|[A-Z]{3,5}|[+-]\d{2}:?\d{2}|[+-]\d{2})?\s*$"
)
_STAMP = re.compile(STAMP.replace(r"\p{L}", r"[^\W\d_]"))
_UTC = r"^(Z|UTC|GMT|[+-])"
_MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "apr": 4, "may": 5, "jun": 6, "jul": 7, "aug": 8, "sep": 9, "oct": 10, "nov": 11, "dec": 12,
    "mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12,
}  # fmt: skip


def is_stamp(text: str) -> bool:
    """Whether a text is a date, a time of day, or both, and no plain number."""
    found = _STAMP.match(text)
    return found is not None and bool(found["a"] or found["h"])


def stamp_columns(path: str, headers: list[str], column_map: ColumnMap, at: dict[str, int]) -> dict[str, int]:
    """The fields of the columns that make time stamps, in order: the date's, and the time of day's where it has its own."""
    own = column_map.source("time_s").time_of_day
    if own is None:
        return {"time_s": at["time_s"]}
    k = position(path, headers, own)
    if k is None or k in at.values():
        what = "is missing" if k is None else "is mapped to another column"
        raise InvalidLogError(
            f"{path}: header {own!r}, the time_of_day of time_s, {what}; correct the column map"
        )
    return {"time_s": at["time_s"], TIME_OF_DAY: k}


class Stamps:
    """The clock of one pass over a file. remarks: takes the note that says when the log starts."""

    def __init__(self, path: str, remarks: list[str]) -> None:
        self.path, self.remarks = path, remarks
        self.first: int | None = None
        self.last = self.midnights = 0
        self.dated, self.day_first, self.zoned = True, False, False

    def of_texts(self, texts: Any, rows: NDArray[np.int64], first_line: int | None = None) -> Array:
        """(n,) s from the first stamp of the file on, NaN where there is none. texts: arrow strings; rows: their numbers.

        Raises InvalidLogError that names the first text that is no stamp.
        """
        import pyarrow.compute as pc

        parts = pc.extract_regex(texts, STAMP)
        there = np.array(parts.is_valid())
        text = dict(zip((f.name for f in parts.type), parts.flatten(), strict=True))
        date, clock = (np.array(pc.not_equal(text[k].fill_null(""), "")) for k in "ah")
        given = np.array(texts.is_valid())
        ns, possible = self._nanoseconds(text, date, there & (date | clock))
        wrong = np.flatnonzero(given & ~possible)
        if wrong.size:
            k = int(wrong[0])
            where = place(int(rows[k]), None if first_line is None else first_line + int(rows[k]) - 1)
            raise InvalidLogError(
                f"{self.path}: {where}, column time_s: {str(texts[k])[:40]!r} is no time stamp like 2026-01-31T10:15:00.250; "
                "correct it, or list it under missing in a column map (--columns map.toml)"
            )
        return self.seconds(ns, possible)

    def seconds(self, ns: Nanoseconds, known: Mask) -> Array:
        """(n,) s from the first known stamp of the file on, NaN where it is not known. ns: since 1970, or since midnight."""
        if self.first is None and known.any():
            self._begin(int(ns[known][0]))
        if not self.dated:
            ns = self._past_midnight(ns, known)
        return np.where(known, (ns - (self.first or 0)) * 1e-9, np.nan)

    def _begin(self, first: int) -> None:
        self.first = self.last = first
        shown = str(np.datetime64(first, "ns")).rstrip("0").rstrip(".")
        shown = shown if self.dated else shown.split("T")[1]
        note = f"time stamps are absolute: time_s is 0 at {shown}{' UTC' if self.zoned else ''}"
        if note not in self.remarks:
            self.remarks.append(note)

    def _past_midnight(self, ns: Nanoseconds, known: Mask) -> Nanoseconds:
        """Times of day with the days that they have passed: back by more than half a day is another day."""
        at = np.flatnonzero(known)
        if not at.size:
            return ns
        passed = np.diff(np.append(self.last, ns[at])) < -DAY // 2
        days = self.midnights + np.cumsum(passed)
        self.last, self.midnights = int(ns[at[-1]]), int(days[-1])
        out = ns.copy()
        out[at] += days * DAY
        return out

    def _nanoseconds(self, text: dict[str, Any], date: Mask, good: Mask) -> tuple[Nanoseconds, Mask]:
        """Since 1970, or since midnight where there is no date, and which stamps there can be."""
        named = _like(text["b"], r"^\p{L}")
        a, c, h, m, s = (_whole(text[k]) for k in "achms")
        b = _month(text["b"], named)
        if self.first is None and good.any():
            self._learn(text, date, good & ~named if (good & ~named).any() else good, a, b)
            self.day_first = self.day_first or bool(named[good].any())
        year, month, day = _order(a, b, c, self.day_first)
        h = (
            h
            + np.where(_like(text["p"], "^[pP]"), 12, 0)
            - np.where(_like(text["p"], "^[aApP]") & (h == 12), 12, 0)
        )
        inside = (h < 24) & (m < 60) & (s <= 60)
        dated = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (year > 1900) & (year < 2200)
        good = good & inside & (dated | ~date) & (date == self.dated)
        days = (np.where(good & date, year - 1970, 0) * 12 + np.where(good & date, month - 1, 0)).astype(
            "M8[M]"
        )
        whole = days.astype("M8[D]").astype(np.int64) + np.where(good & date, day - 1, 0)
        ns = whole * DAY + ((h * 60 + m) * 60 + s) * SECOND + _fraction(text["f"]) - _zone(text["z"])
        return ns, good

    def _learn(self, text: dict[str, Any], date: Mask, good: Mask, a: Nanoseconds, b: Nanoseconds) -> None:
        """What the first stamps tell of all: whether they have a date, in which order, and a zone."""
        k = int(np.flatnonzero(good)[0])
        self.dated, self.zoned = bool(date[k]), bool(_like(text["z"], _UTC)[k])
        slashes = bool(_like(text["k"], "/")[k])
        self.day_first = not slashes or bool(12 < a[good][0] <= 31)
        if slashes and not self.day_first and a[k] < 1000 and not (b[good] > 12).any():
            self.remarks.append("dates are read as month/day/year; they may be day/month/year")


def _order(a: Nanoseconds, b: Nanoseconds, c: Nanoseconds, day_first: bool) -> tuple[Nanoseconds, ...]:
    """Year, month and day of the three numbers of a date."""
    first = a > 31  # year-month-day
    year = np.where(first, a, c)
    year = np.where(year < 100, year + 2000, year)
    month, day = (b, a) if day_first else (a, b)
    return year, np.where(first, b, month), np.where(first, c, day)


def _like(texts: Any, pattern: str) -> Mask:
    import pyarrow.compute as pc

    return np.array(pc.match_substring_regex(texts.fill_null(""), pattern), dtype=np.bool_)


def _whole(texts: Any) -> Nanoseconds:
    import pyarrow as pa
    import pyarrow.compute as pc

    filled = pc.if_else(pc.equal(texts.fill_null(""), ""), "0", texts)
    return np.array(filled.cast(pa.int64()), dtype=np.int64)


def _month(texts: Any, named: Mask) -> Nanoseconds:
    """Numbers of months that are given as numbers or by name; 0 for a name that is none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not named.any():
        return _whole(texts)
    short = pc.utf8_lower(pc.utf8_slice_codeunits(texts.fill_null(""), 0, 3))
    at = np.array(pc.index_in(short, value_set=pa.array(list(_MONTHS))).fill_null(len(_MONTHS)))
    numbers = _whole(pc.if_else(pa.array(named), "0", texts))
    return np.where(named, np.array([*_MONTHS.values(), 0])[at], numbers)


def _fraction(texts: Any) -> Nanoseconds:
    import pyarrow.compute as pc

    return _whole(pc.utf8_rpad(texts.fill_null(""), 9, "0"))


def _zone(texts: Any) -> Nanoseconds:
    """How far local time is ahead of UTC [ns]."""
    import pyarrow.compute as pc

    parts = dict(zip("ghm", pc.extract_regex(texts.fill_null(""), r"^(?P<g>[+-]?)(?P<h>\d{0,2}):?(?P<m>\d{0,2})").flatten(),
                     strict=True))  # fmt: skip
    ahead = (_whole(parts["h"]) * 60 + _whole(parts["m"])) * 60 * SECOND
    return np.where(_like(parts["g"], "-"), -ahead, ahead)
