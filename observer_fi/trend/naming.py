"""Which cause explains a departure from the baseline, and which others would.

A cause moves one quantity, a group of them, or several in a fixed proportion (a current sensor whose gain has changed scales
every torque). Causes are taken in turn by what they explain of the squared distance less the price of their free sizes.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import digits
from observer_fi.records import Array
from observer_fi.trend.baseline import ALL, Baseline, Departure, groups_of
from observer_fi.trend.kinds import KINDS, kind_of
from observer_fi.trend.table import period_of

PRICE = 4.0  # of squared distance for each free size of a cause
NEAR = 6.0  # a cause that explains less than the best by no more than this is a rival
MOST_CAUSES = 4
SHOWS = 2.0  # standard deviations from which on a quantity of a changed group is listed

# Several quantities in proportion, relative to their values: what a gain of the current sensor does to what is read from torque.
PROPORTIONS: dict[str, tuple[str, dict[str, float]]] = {
    "current_gain": ("sensor:current", {"A": 1.0, "J": 1.0, "Kp": 1.0, "Ki": 1.0, "Rm": -1.0, "Rs": -1.0}),
}

# What else a fit without the cause gets wrong by it: told as part of it, not as causes of their own.
SYMPTOMS = {"backlash": ("backlash", ("D", "position_lag", "misfit_position"))}
ALONG = 1e-10  # share of a column's square beside those that are taken: less of it is one of them
FIRST = ("A", "backlash")  # quantities that name their group where they have moved
MISFIT = "misfit"  # group of quantities that any cause moves which the constants do not know
MISFITS = frozenset(kind.cause for kind in KINDS if kind.group == MISFIT)


class Candidate(NamedTuple):
    """A cause that may explain a departure: its direction matrix (m, f) over the departure's quantities, of which the first
    `priced` are its own.
    """

    cause: str
    equation: str
    rivals: tuple[str, ...]
    columns: Array
    priced: int


class Named(NamedTuple):
    """A cause that was found: the quantities that show it (rows of the departure, the clearest first), and rivals."""

    cause: str
    equation: str
    rows: tuple[int, ...]
    rivals: tuple[str, ...]


def named(
    baseline: Baseline, found: Departure, periods: Mapping[str, float] | None = None
) -> tuple[Named, ...]:
    """The causes of a departure, the clearest first; at least one where there is any quantity."""
    if not found.which.size:
        return ()
    names = [baseline.names[k] for k in found.which]
    R = baseline.correlation[ALL][np.ix_(found.which, found.which)]
    white = np.linalg.cholesky(np.linalg.inv(R)).T
    candidates = _candidates(names, found, periods or {}, baseline.limit_of)
    chosen: list[Named] = []
    taken = np.zeros((found.z.size, 0))
    while len(chosen) < MOST_CAUSES:
        gains = _gains(white, found.z, taken, candidates)
        worth = gains - PRICE * np.array([c.priced for c in candidates])
        worth[_only_symptoms(candidates, worth, bool(chosen), baseline.limit_of)] = -math.inf
        best = int(np.argmax(worth))
        if chosen and worth[best] < baseline.limit_of**2:
            break
        c = candidates[best]
        rows = _rows(c, found, names)
        close = [o.cause for o, w in zip(candidates, worth, strict=True) if worth[best] - w < NEAR]
        rivals = tuple(dict.fromkeys(r for r in (*close, *c.rivals) if r != c.cause))
        chosen.append(Named(c.cause, c.equation, rows, rivals))
        taken = np.column_stack([taken, c.columns])
    return _merged(chosen)


def _only_symptoms(
    candidates: Sequence[Candidate], worth: Array, other: bool, limit: float
) -> NDArray[np.bool_]:
    """(c,) candidates that are a misfit where something with a name of its own has changed."""
    misfit = np.array([c.cause in MISFITS and c.priced == 1 for c in candidates])
    named = other or bool((worth[~misfit] > limit**2).any())
    return misfit & named


def _merged(chosen: Sequence[Named]) -> tuple[Named, ...]:
    """Each cause once."""
    found: dict[str, Named] = {}
    for n in chosen:
        old = found.get(n.cause)
        rows = n.rows if old is None else tuple(dict.fromkeys((*old.rows, *n.rows)))
        found[n.cause] = n._replace(rows=rows)
    return tuple(found.values())


def _rows(c: Candidate, found: Departure, names: Sequence[str]) -> tuple[int, ...]:
    """Quantities that show a cause: friction or play itself in front, then the clearest."""
    part = np.flatnonzero(np.abs(c.columns[:, : c.priced]).sum(axis=1) > 0.0)
    clear = np.abs(found.z[part])
    first = np.array([names[k] in FIRST for k in part.tolist()]) & (clear > SHOWS)
    order = part[np.lexsort((-clear, ~first))]
    return tuple(int(k) for j, k in enumerate(order) if j == 0 or abs(found.z[k]) > SHOWS)


def _candidates(
    names: Sequence[str], found: Departure, periods: Mapping[str, float], limit: float
) -> list[Candidate]:
    eye = np.eye(len(names))
    many = []
    for k, name in enumerate(names):
        cause, equation, rivals = meaning(name, periods)
        many.append(Candidate(cause, equation, rivals, eye[:, [k]], 1))
    for name, others in SYMPTOMS.values():
        if name in names and abs(found.z[names.index(name)]) > limit:
            cause, equation, rivals = meaning(name, periods)
            those = [names.index(n) for n in (name, *others) if n in names]
            many.append(Candidate(cause, equation, rivals, eye[:, those], 1))
    for group, rows in groups_of(names).items():
        if group not in (ALL, MISFIT) and rows.size > 1:
            cause, equation, rivals = meaning(names[_speaks(names, found.z, rows)], periods)
            many.append(Candidate(cause, equation, rivals, eye[:, rows], int(rows.size)))
    for cause, (equation, shares) in PROPORTIONS.items():
        there = [k for k, name in enumerate(names) if name in shares]
        if len(there) >= 3:
            column = np.zeros((len(names), 1))
            column[there, 0] = [shares[names[k]] * found.expected[k] / found.std[k] for k in there]
            many.append(Candidate(cause, equation, (), column, 1))
    return many


def _speaks(names: Sequence[str], z: Array, rows: NDArray[np.intp]) -> int:
    """Which quantity of a group names it: friction itself where it has moved, else the clearest."""
    plain = [int(k) for k in rows if names[k] in FIRST and abs(z[k]) > SHOWS]
    return plain[0] if plain else int(rows[np.argmax(np.abs(z[rows]))])


def meaning(name: str, periods: Mapping[str, float]) -> tuple[str, str, tuple[str, ...]]:
    """Cause, equation and rivals of a quantity; a ripple is the screw's, the shaft's or another's by its period."""
    kind = kind_of(name)
    if kind.group != "ripple":
        return kind.cause, kind.equation, kind.rivals
    period = period_of(name)
    same = [cause for cause, p in periods.items() if abs(period / p - 1.0) < 0.02]
    cause = same[0] if same else "screw_ripple" if "screw_ripple" not in periods else "gear_ripple"
    every = ("screw_ripple", "shaft_ripple", "gear_ripple", "position_periodic_error")
    return cause, kind.equation, tuple(r for r in every if r != cause)


def _gains(white: Array, z: Array, taken: Array, candidates: Sequence[Candidate]) -> Array:
    """(c,) squared distance that the best combination of each candidate's columns explains beside those `taken`.

    white (k, k): makes departures z (k,) independent.
    """
    Q = np.linalg.qr(white @ taken)[0]
    left = white @ z
    left = left - Q @ (Q.T @ left)
    columns = white @ np.column_stack([c.columns for c in candidates])
    beside = columns - Q @ (Q.T @ columns)
    square, whole = np.sum(beside**2, axis=0), np.sum(columns**2, axis=0)
    single = np.where(square > ALONG * whole, (beside.T @ left) ** 2 / np.maximum(square, 1e-300), 0.0)
    ends = np.cumsum([c.columns.shape[1] for c in candidates])
    found = np.empty(len(candidates))
    for j, (c, end) in enumerate(zip(candidates, ends.tolist(), strict=True)):
        many = c.columns.shape[1]
        if many == 1:
            found[j] = single[end - 1]
        else:
            block = beside[:, end - many : end]
            found[j] = left @ block @ np.linalg.lstsq(block, left, rcond=ALONG)[0]
    return found


def ratio_words(value: float, before: float, std: float) -> str:
    """By how many per cent a quantity has changed, where that says something: not of one that has changed its sign."""
    if before * value <= 0.0 or not math.isfinite(before) or abs(before) < 3.0 * std:
        return ""
    percent = 100.0 * (value / before - 1.0)
    return f"{digits(percent, 2 if abs(percent) < 10.0 else 3, '+')} %"
