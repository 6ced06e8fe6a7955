"""Lines of text from a running logger become samples: CSV with a header, or JSON objects; a broken line is an error.

The columns are those of a log (docs/logs.md), with the same column maps. `Clock` puts what the parser hands out in
order: it does, one sample at a time, what `cleaning.py` does with a file.
"""

import csv
import json
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError, one_line
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.csv import header_fields
from observer_fi.logs.plain_lines import numbers
from observer_fi.logs.tables import NO_VALUE, positions
from observer_fi.physics import CommandLaw
from observer_fi.records import Array

READINGS = ("time_s", "voltage_v", "current_a", "position_m", "pitch_deg")
LONGEST_LINE = 1 << 16  # bytes: what has no end of line by then is no line
LATEST_S = 1e15  # beyond this two samples have the same double: no clock is there
MOST_HELD = 64  # samples that wait for a time, a pitch or a command
NAN = math.nan
Say = Callable[[str, int], None]  # what is wrong, and how many samples are left out for it


class Row(NamedTuple):
    """One sample, SI units and degrees; NaN marks a missing reading."""

    t: float
    voltage: float
    current: float
    position: float
    pitch: float
    w_cmd: float


class BrokenLineError(ValueError):
    """A line that is no sample: what is wrong with it."""


class Splitter:
    """Bytes as they come, in lines as they end."""

    def __init__(self) -> None:
        self.rest = b""

    def block(self, data: bytes) -> bytes:
        """The lines that `data` completes, each with its end."""
        data = self.rest + data
        end = data.rfind(b"\n") + 1
        block, self.rest = data[:end], data[end:]
        if len(self.rest) > LONGEST_LINE:
            block += self.rest[:80] + b"\n"
            self.rest = b""
        return block

    def last(self) -> bytes:
        """What stands behind the last end of line, as a line, now that no more will come."""
        rest, self.rest = self.rest, b""
        return rest + b"\n" if rest else b""


def lines_of(block: bytes) -> list[str]:
    """The lines of a block."""
    return [line.decode("utf-8", "replace") for line in block.split(b"\n")[:-1]]


class Parser:
    """Lines of one source as samples in SI units. The first line that says so decides between CSV and JSON.

    law: how columns make the commanded speed, with the parameters p; None: it is sent.
    """

    def __init__(
        self, source: str, column_map: ColumnMap, law: CommandLaw | None = None, p: Array | None = None
    ) -> None:
        self.source, self.map, self.law, self.p = source, column_map, law, p
        self.columns = (*READINGS, *(law.columns if law else ("speed_cmd_rad_s",)))
        self.limits = (LATEST_S, *(column_map.limit(column) for column in self.columns[1:]))
        self.missing = {*NO_VALUE, *column_map.missing}
        self.coded = any(_is_number(text) for text in column_map.missing)  # a number that stands for no value
        self.begin()

    def begin(self) -> None:
        """Forget the header: the writer starts anew."""
        self.format = ""
        self.number = 0
        self.headers: list[str] = []
        self.separator = ","
        self.at: tuple[int, ...] = ()
        self.factors: tuple[float, ...] = ()
        self.restarted = False

    @property
    def has_pitch(self) -> bool:
        """Whether a header that was read names a pitch."""
        return bool(self.at) and self.at[4] >= 0

    def table(self, block: bytes) -> Array | None:
        """The samples (n, 6) of many lines, if `row` would take each for plain numbers. It does not count the lines."""
        if self.format != "csv" or self.coded or self.number + 1 < (self.map.data_line or 0):
            return None
        used = [c for c, k in enumerate(self.at) if k >= 0]
        found = self._numbers(block, tuple(self.at[c] for c in used))
        if found is None:
            return None
        table = np.full((len(found), len(self.columns)), NAN)
        with np.errstate(over="ignore"):
            table[:, used] = found * np.array(self.factors)[used]
        if self.at[4] < 0:
            table[:, 4] = 0.0
        table[~(np.abs(table) <= np.array(self.limits))] = NAN
        return (
            table
            if self.law is None
            else np.column_stack((table[:, :5], self.law.of(*table[:, 5:].T, self.p)))
        )

    def _numbers(self, block: bytes, at: tuple[int, ...]) -> Array | None:
        """The fields at those positions: all with decimal points, or all with decimal commas."""
        found = numbers(block, self.separator, ".", len(self.headers), at)
        if found is None and self.separator != ",":
            return numbers(block, self.separator, ",", len(self.headers), at)
        return found

    def row(self, line: str) -> Row | None:
        """The sample of a line, None where it holds none (header, comment, blank line).

        Raises BrokenLineError for a line to skip, InvalidLogError where no line can be used. `restarted` tells that
        this line is a second header.
        """
        self.number += 1
        self.restarted = False
        if self.format == "csv":
            return self._csv(line)
        line = line.strip().lstrip("\ufeff")
        if self.format == "json" or (line.startswith("{") and not self.format):
            return self._json(line) if line else None
        if line and not line.startswith("#") and self.number >= (self.map.header_line or 1):
            self._header(line)
        return None

    # --- CSV ---

    def _header(self, line: str) -> None:
        self.separator = self.map.separator or max(",;\t|", key=line.count)
        self.headers = header_fields(self.source, self.number, line, self.separator)
        if all(_is_number(text.replace(",", ".")) for text in self.headers):
            raise InvalidLogError(
                f"{self.source}: line {self.number} holds numbers, not column names; send a header first, "
                "as in docs/watch.md, or JSON lines"
            )
        self._columns(self.headers)
        self.format = "csv"

    def _columns(self, headers: list[str]) -> None:
        if self.map.source("time_s").stamps:
            raise InvalidLogError(
                f"{self.source}: column time_s: a stream needs numbers, not time stamps; send seconds, or map an epoch unit"
            )
        at = positions(self.source, headers, self.map)
        for column in self.columns[5:]:
            if column not in at:
                why = (
                    "the loop of a position servo needs it"
                    if self.law
                    else "only a whole log lets it be recovered"
                )
                raise InvalidLogError(
                    f"{self.source}: column {column} is missing; a stream needs it ({why}): send it, or map its name "
                    "with --columns"
                )
        self.at = tuple(at.get(column, -1) for column in self.columns)
        self.factors = tuple(self.map.source(column).factor for column in self.columns)

    def _csv(self, line: str) -> Row | None:
        if self.map.data_line is not None and self.number < self.map.data_line:
            return None
        fields = line.split(self.separator)
        if len(fields) == len(self.headers) and "_" not in line and not self.coded:
            try:
                return self._sample([float(fields[k]) if k >= 0 else NAN for k in self.at])
            except ValueError:
                pass
        return self._slowly(line)

    def _slowly(self, line: str) -> Row | None:
        """A line that is not plain numbers: blank, comment, quoted, decimal commas, a header, or broken."""
        text = line.strip()
        if not text or text.startswith("#"):
            return None
        try:
            fields = [field.strip() for field in next(csv.reader([text], delimiter=self.separator))]
        except csv.Error as error:
            raise BrokenLineError(f"no fields ({error})") from error
        if fields == self.headers:
            self.restarted = True
            return None
        if len(fields) != len(self.headers):
            raise BrokenLineError(f"{len(fields)} fields where the header has {len(self.headers)}")
        return self._sample(
            [
                self._number(column, fields[k]) if k >= 0 else NAN
                for column, k in zip(self.columns, self.at, strict=True)
            ]
        )

    def _number(self, column: str, text: str) -> float:
        if text in self.missing:
            return NAN
        plain = text.replace(",", ".") if self.separator != "," and text.count(",") == 1 else text
        if not _is_number(plain):
            raise BrokenLineError(f"column {column}: {text[:40]!r} is not a number")
        return float(plain)

    # --- JSON ---

    def _json(self, line: str) -> Row | None:
        try:
            found = json.loads(line)
        except (
            ValueError,
            RecursionError,
        ) as error:  # also of nesting, and of numbers with more than 4300 digits
            raise BrokenLineError(f"no JSON object ({one_line(error, 100)})") from error
        if not isinstance(found, dict):
            raise BrokenLineError("no JSON object")
        if not self.format:
            self.headers = list(found)
            self._columns(self.headers)
            self.format = "json"
            self.keys = tuple(self.headers[k] if k >= 0 else None for k in self.at)
        values = []
        for column, key in zip(self.columns, self.keys, strict=True):
            value = None if key is None else found.get(key)
            if isinstance(value, str):
                value = self._number(column, value)
            if isinstance(value, bool) or not isinstance(value, int | float | None):
                raise BrokenLineError(f"column {column}: {one_line(repr(value), 40)} is not a number")
            values.append(NAN if value is None else _float(value))
        return self._sample(values)

    # --- both ---

    def _sample(self, values: list[float]) -> Row | None:
        """Values in SI units, what is beyond its limit as missing; None for a line without any value."""
        t, v, i, x, pitch, *told = (value * f for value, f in zip(values, self.factors, strict=True))
        most = self.limits
        if not abs(t) <= most[0]:
            if v != v and i != i and x != x:
                return None
            t = NAN
        if self.at[4] < 0:
            pitch = 0.0
        told = [value if abs(value) <= m else NAN for value, m in zip(told, most[5:], strict=True)]
        return Row(
            t,
            v if abs(v) <= most[1] else NAN,
            i if abs(i) <= most[2] else NAN,
            x if abs(x) <= most[3] else NAN,
            pitch if abs(pitch) <= most[4] else NAN,
            told[0] if self.law is None else float(self.law.of(*told, self.p)),
        )


def _float(value: int | float) -> float:
    """As a float; a whole number beyond the largest one is infinite, as it is in a text."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


class Clock:
    """Samples on one increasing clock: those without a time, pitch or command wait for the next one that has them.

    A time before the last one is a broken line if the clock then goes on, and a new clock if it goes on from there.
    """

    def __init__(self) -> None:
        self.last = NAN  # the latest time
        self.complete: Row | None = None  # the latest sample that had everything a bank needs
        self.waiting: list[Row] = []
        self.astray: Row | None = None

    def take(self, row: Row, say: Say) -> Iterator[Row | None]:
        """The samples that are now in order; None in front of those of a clock that begins anew."""
        if row.t < self.last:
            yield from self._backward(row, say)
            return
        if self.astray is not None and row.t > self.last:
            self._drop_astray(say)
        yield from self._forward(row, say)

    def passes(self, table: Array) -> bool:
        """Take samples (n, 6) at once if they are in order as they stand: complete, later than the last, nothing waits."""
        t = table[:, 0]
        if self.waiting or self.astray is not None or not np.isfinite(table[:, (0, 4, 5)]).all():
            return False
        if t[0] <= self.last or (t[1:] <= t[:-1]).any():
            return False
        self.complete = Row(*table[-1].tolist())
        self.last = self.complete.t
        return True

    def finish(self, say: Say) -> Iterator[Row]:
        """What still waits when no more will come: without a time of their own samples are dropped."""
        if self.astray is not None:
            self._drop_astray(say)
        yield from self._flushed(say)

    def _backward(self, row: Row, say: Say) -> Iterator[Row | None]:
        before, self.astray = self.astray, row
        if before is None or row.t == before.t:
            return
        if row.t < before.t:
            say(f"the time {before.t:.9g} s is before {self.last:.9g} s: sample left out", 1)
            return
        yield from self._flushed(say)
        self.last, self.complete, self.astray = NAN, None, None
        yield None
        yield from self._forward(before, say)
        yield from self._forward(row, say)

    def _drop_astray(self, say: Say) -> None:
        if self.astray is not None:
            say(f"the time {self.astray.t:.9g} s is before {self.last:.9g} s: sample left out", 1)
        self.astray = None

    def _forward(self, row: Row, say: Say) -> Iterator[Row]:
        t, pitch, w = row.t, row.pitch, row.w_cmd
        if t > self.last or (self.last != self.last and t == t):
            self.last = t
            if pitch == pitch and w == w:
                if self.waiting:
                    yield from self._placed(row)
                else:
                    yield row
                self.complete = row
                return
        elif self.last != self.last:
            say("no time, and none before it: sample left out", 1)
            return
        else:
            row = Row(NAN, NAN, NAN, NAN, pitch, w)
        self.waiting.append(row)
        if len(self.waiting) >= MOST_HELD:
            yield from self._flushed(say)

    def _placed(self, row: Row) -> Iterator[Row]:
        """Those that waited, between the last complete sample and this one, as `cleaning.py` does it."""
        rows = [*([self.complete] if self.complete else []), *self.waiting, row]
        self.waiting = []
        table, index = np.array(rows), np.arange(len(rows))
        timed = np.isfinite(table[:, 0])
        table[:, 0] = np.interp(index, index[timed], table[timed, 0])
        for c in (4, 5):
            known = np.isfinite(table[:, c])
            table[:, c] = np.interp(table[:, 0], table[known, 0], table[known, c])
        for values in table[1 if self.complete else 0 :].tolist():
            yield Row(*values)

    def _flushed(self, say: Say) -> Iterator[Row]:
        """Those that waited too long: with the last pitch and command known, or zero; without a time they are left out."""
        rows, self.waiting = self.waiting, []
        lost = sum(row.t != row.t for row in rows)
        if lost:
            say(f"no time of their own, and none soon after: {lost} samples left out", lost)
        _, _, _, _, pitch, w = self.complete or Row(NAN, NAN, NAN, NAN, 0.0, 0.0)
        for row in rows:
            pitch = pitch if row.pitch != row.pitch else row.pitch
            w = w if row.w_cmd != row.w_cmd else row.w_cmd
            if row.t == row.t:
                self.complete = row._replace(pitch=pitch, w_cmd=w)
                yield self.complete
