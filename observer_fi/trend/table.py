"""Digests side by side: one row a log, one column a quantity, with what a ripple period found together adds to each."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.physics import Rig
from observer_fi.records import Array
from observer_fi.trend import ripple
from observer_fi.trend.digests import Digest

# A condition counts where logs differ in it by more than this: absolute, and relative to its largest value.
LEAST_SPAN = {
    "load_n": (0.0, 0.02), "pitch_deg": (0.5, 0.0), "speed_m_s": (0.0, 0.05), "speed_rad_s": (0.0, 0.05),
    "travel_centre_m": (0.0, 0.1), "travel_m": (0.0, 0.1),
}  # fmt: skip
SIGNED = ("load_n", "pitch_deg")  # may act by their size, too, as a friction that grows with the load does


class Span(NamedTuple):
    """One condition over the logs of a table: how many know it, its ends, mean and standard deviation, those of its size."""

    known: int
    low: float
    high: float
    mean: float
    std: float
    mean_size: float
    std_size: float

    @property
    def largest(self) -> float:
        """Its largest size."""
        return max(-self.low, self.high, 0.0) if self.known else 0.0


@dataclass(frozen=True)
class Table:
    """n logs, k quantities, q conditions.

    value (n, k), NaN where a log cannot tell; variance (n, k) of the estimate from the log's own noise; conditions (n, q) with
    their names.
    """

    paths: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    variance: Array
    condition_names: tuple[str, ...]
    conditions: Array

    def rows(self, chosen: NDArray[np.intp]) -> "Table":
        """The table of some logs."""
        return Table(
            tuple(self.paths[k] for k in chosen), self.names, self.units, self.value[chosen],
            self.variance[chosen], self.condition_names, self.conditions[chosen],
        )  # fmt: skip

    @cached_property
    def spans(self) -> tuple[Span, ...]:
        """Of each condition, where these logs have it."""
        return tuple(_span(c[np.isfinite(c)]) for c in self.conditions.T)

    def column(self, name: str) -> Array:
        """(n,) values of a quantity."""
        return self.value[:, self.names.index(name)]


def _span(c: Array) -> Span:
    if not c.size:
        return Span(0, np.inf, -np.inf, np.nan, np.nan, np.nan, np.nan)
    size = np.abs(c)
    return Span(c.size, *(float(v) for v in (c.min(), c.max(), c.mean(), c.std(), size.mean(), size.std())))


def periods_of(baseline: Sequence[Digest], rig: Rig) -> tuple[float, ...]:
    """Periods of ripple along the travel [m]: the screw's lead where the rig gives it, and what the healthy logs show."""
    found = ripple.lines_of(d.curve for d in baseline if d.curve is not None)
    lead = rig.quantities["screw_lead"].value if "screw_lead" in rig.quantities else 0.0
    kept = [p for p in found if not lead or abs(p / lead - 1.0) > 0.02]
    return (lead, *kept)[: ripple.MOST_LINES] if lead else tuple(kept)


def table_of(digests: Sequence[Digest], periods: Sequence[float]) -> Table:
    """The digests as one table, ripple of these periods with them."""
    rows = [_entries(d, periods) for d in digests]
    units: dict[str, str] = {}
    for row in rows:
        units |= {name: entry.unit for name, entry in row.items()}
    names = tuple(units)
    value = np.full((len(rows), len(names)), np.nan)
    variance = np.full_like(value, np.nan)
    for n, row in enumerate(rows):
        for k, name in enumerate(names):
            if name in row and np.isfinite(row[name].value):
                value[n, k], variance[n, k] = row[name].value, max(row[name].variance, 0.0)
    known = tuple(dict.fromkeys(c for d in digests for c in d.conditions))
    conditions = np.array([[d.conditions.get(c, np.nan) for c in known] for d in digests]).reshape(
        len(rows), -1
    )
    return Table(
        tuple(d.path for d in digests), names, tuple(units.values()), value, variance, known, conditions
    )


class Entry(NamedTuple):
    """One quantity of one log."""

    value: float
    variance: float
    unit: str


def _entries(digest: Digest, periods: Sequence[float]) -> dict[str, Entry]:
    found = {
        name: Entry(float(v), float(c), unit)
        for name, unit, v, c in zip(
            digest.names, digest.units, digest.value, np.diag(digest.covariance), strict=True
        )
    }
    for names, units, value, covariance in ripple.quantities(digest.curve, periods) if digest.curve else []:
        for name, unit, v, c in zip(names, units, value, np.diag(covariance), strict=True):
            found[name] = Entry(float(v), float(c), unit)
    return found


def regressors(table: Table, reference: Table) -> tuple[tuple[str, ...], Array]:
    """Names and (n, 1 + r) columns of the conditions in which the logs of either table differ: 1, c, and |c| of signed ones.

    Each is centred and scaled by the reference logs, so that 1 is a departure as large as theirs, or as what can be seen.
    """
    names, columns = ["1"], [np.ones(len(table.paths))]
    for k, name in enumerate(table.condition_names):
        mine, healthy = table.conditions[:, k], reference.spans[k]
        known = mine[np.isfinite(mine)]
        if known.size + healthy.known < 2:
            continue
        absolute, relative = LEAST_SPAN.get(name, (0.0, 0.05))
        floor = max(absolute, relative * _size(name, table, reference))
        low, high = min(healthy.low, *known.tolist()), max(healthy.high, *known.tolist())
        if high - low <= floor:
            continue
        if known.size < mine.size:
            mine = np.where(
                np.isfinite(mine), mine, float(np.nanmedian([*mine, *reference.conditions[:, k]]))
            )
        columns.append((mine - healthy.mean) / max(healthy.std, floor, 1e-12))
        names.append(name)
        if name in SIGNED and low < 0.0 < high:
            columns.append((np.abs(mine) - healthy.mean_size) / max(healthy.std_size, floor, 1e-12))
            names.append(f"|{name}|")
    return tuple(names), np.column_stack(columns)


def _size(name: str, table: Table, reference: Table) -> float:
    """The largest of a condition; where along the travel counts against its length."""
    name = "travel_m" if name == "travel_centre_m" and "travel_m" in table.condition_names else name
    k = table.condition_names.index(name)
    mine = np.abs(table.conditions[:, k])
    return max(reference.spans[k].largest, *mine[np.isfinite(mine)].tolist(), 0.0)


def period_of(name: str) -> float:
    """The period along the travel [m] that the name of a ripple carries."""
    return float(name.partition("@")[2])
