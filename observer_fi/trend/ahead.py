"""When a limit is reached, as a distribution; said only where a drift towards it is seen."""

from typing import NamedTuple

import numpy as np

from observer_fi.numerics import digits, with_unit
from observer_fi.trend.baseline import Baseline
from observer_fi.trend.changes import DRIFT, History

DRAWS = 20_000
SEED = 16  # of the draws from the drift's own error


class Ahead(NamedTuple):
    """When a quantity reaches its limit. reached: in the unit of the logs' times from the first one; low, high: 90 % interval,
    infinite where a drift so slow is possible; None where nothing is said, and words say why.
    """

    name: str
    limit: float
    reached: float | None
    low: float | None
    high: float | None
    words: str


def ahead(name: str, limit: float, baseline: Baseline, history: History, unit: str) -> Ahead:
    """The crossing of a limit by one quantity."""
    k = baseline.names.index(name)
    at, now = with_unit(limit, baseline.units[k]), float(history.level[-1, k])
    last = float(history.time[-1])
    drifts = [c for c in history.changes if c.kind == DRIFT and c.shows[k]]
    if not drifts:
        return Ahead(
            name,
            limit,
            None,
            None,
            None,
            f"no drift of {name} is seen, so nothing is said of when it reaches {at}",
        )
    c = drifts[-1]
    if (limit - now) * float(c.size[k]) <= 0.0:
        return Ahead(name, limit, None, None, None, f"{name} has passed {at} already, or drifts away from it")
    lasted = last - float(history.time[c.since - 1])
    size = np.random.default_rng(SEED).normal(float(c.size[k]), float(c.std[k]), DRAWS)
    start = now - float(c.size[k])
    share = (limit - start) / np.where(size == 0.0, 1e-300, size)  # of the drift so far
    when = np.where(share > 0.0, last + (share - 1.0) * lasted, np.inf)
    low, middle, high = (float(v) for v in np.quantile(when, (0.05, 0.5, 0.95)))
    span = f"90 %: {digits(low - last)} to {digits(high - last)}"
    words = f"{name} reaches {at} {digits(middle - last)} {unit} after the last log ({span})"
    return Ahead(name, limit, middle, low, high, words)
