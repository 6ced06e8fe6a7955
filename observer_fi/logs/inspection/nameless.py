"""Columns whose headers say nothing: voltage, current and position are the three that a motor's equation holds together."""

from collections.abc import Mapping
from itertools import permutations

import numpy as np

from observer_fi.logs.inspection.guesses import GUESS, Guess
from observer_fi.logs.inspection.relations import DriveFit, drive_fit
from observer_fi.logs.inspection.sizes import unit_by_values
from observer_fi.logs.inspection.vocabulary import understood
from observer_fi.records import Array

MOTOR = ("voltage_v", "current_a", "position_m")
MOST = 8  # columns that are tried
EXPLAINED, CLEAR = 0.9, 5.0  # share of the variance of the rate of a position; standard errors


def with_nameless(
    found: dict[str, Guess], values: Mapping[str, Array], silent: list[str]
) -> dict[str, Guess]:
    """The guesses, and voltage, current and position among the columns of headers that say nothing.

    values: (n,) numbers by header; silent: headers that say nothing. As it is where no three of them fit.
    """
    missing = [column for column in MOTOR if column not in found]
    clock = found.get("time_s")
    if not missing or clock is None or clock.header not in values:
        return found
    free = [h for h in silent if h in values and _moves(values[h]) and h != clock.header][:MOST]
    t = values[clock.header] * clock.scale
    fixed = {
        c: values[found[c].header] * found[c].scale for c in MOTOR if c in found and found[c].header in values
    }
    if len(fixed) + len(missing) < len(MOTOR):
        return found
    best: tuple[float, tuple[str, ...]] = (EXPLAINED, ())
    for headers in permutations(free, len(missing)):
        given = fixed | {c: values[h] for c, h in zip(missing, headers, strict=True)}
        fit = drive_fit(t, *(given[c] for c in MOTOR))
        if fit is not None and _is_motor(fit) and fit.explained > best[0]:
            best = (fit.explained, headers)
    why = (
        "V - Rm i follows its rate" if len(missing) == 1 else "the three together obey x' = D / Km (V - Rm i)"
    )
    told = {}
    for column, header in zip(missing, best[1], strict=False):
        unit, _, because = unit_by_values(column, values[header], understood(header))
        told[column] = Guess(column, header, unit, why=(why, because), sure=GUESS, also=("the unit is open",))
    return found | told


def _is_motor(fit: DriveFit) -> bool:
    """A positive voltage drives towards positive positions, and takes some of itself to overcome the winding."""
    return fit.gain > 0.0 and fit.resistance > CLEAR * fit.std


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 0.5 * values.size and float(np.ptp(known)) > 0.0
