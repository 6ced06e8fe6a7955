"""A baseline from a rig file: its constants are the mean, the logs themselves say how much neighbours scatter.

What no rig file gives (how rough the torque is) has the first third of the logs as its mean.
"""

from dataclasses import replace

import numpy as np
from scipy import stats

from observer_fi.errors import UsageError
from observer_fi.physics import PARAMETERS, Rig
from observer_fi.trend.baseline import ALL, Baseline, groups_of
from observer_fi.trend.table import Table

FEWEST = 4  # logs whose neighbours tell a scatter
USUAL = 0.02  # relative scatter from log to log where they are fewer


def from_rig(table: Table, rig: Rig, rate: float) -> Baseline:
    """Mean of the rig's constants, scatter of neighbouring logs. Raises UsageError where logs and rig share no constant."""
    names = list(table.names)
    if not any(n in rig.quantities for n in names):
        raise UsageError(f"rig {rig.name}: none of its constants is told by these logs; give --baseline-logs")
    y = table.value
    early = np.nanmedian(y[: max(len(table.paths) // 3, 1)], axis=0)
    mean = np.array([rig.model[n] if n in PARAMETERS else m for n, m in zip(names, early, strict=True)])
    std = np.array([rig.quantities[n].std or 0.0 if n in rig.quantities else 0.0 for n in names])
    if len(table.paths) >= FEWEST:
        scatter = np.sqrt(
            np.nanmedian(np.diff(y, axis=0) ** 2, axis=0) / 2.0 / 0.455
        )  # of a median of chi square
    else:
        scatter = USUAL * np.abs(mean)
    own = np.sqrt(np.nanmedian(table.variance, axis=0))
    scatter = np.sqrt(scatter**2 + std**2 + own**2)
    groups = groups_of(names)
    usual, spread = _usual(groups)
    found = Baseline(
        table, tuple(names), table.units, mean[None, :], np.zeros((1, 1)), scatter,
        np.zeros((1, len(names))), np.minimum(own / scatter, 0.95), {g: np.eye(r.size) for g, r in groups.items()},
        max(len(table.paths) - 1, 1), usual,
    )  # fmt: skip
    limit_of = float(stats.t.isf(rate / (2 * len(names)), max(len(table.paths) - 1, 1)))
    return replace(found, limit=float(np.quantile(spread, 1.0 - max(rate, 1e-4))), limit_of=limit_of)


def _usual(groups: dict[str, np.ndarray]) -> tuple[dict[str, tuple[float, float]], np.ndarray]:
    """What is usual of each group's distance for normal scatter, and scores drawn from it."""
    draws = np.random.default_rng(0).standard_normal((100_000, groups[ALL].size))
    roots = {g: np.mean(draws[:, r] ** 2, axis=1) ** 0.25 for g, r in groups.items()}
    usual = {g: (float(v.mean()), float(v.std())) for g, v in roots.items()}
    total = sum(np.maximum((v - usual[g][0]) / usual[g][1], 0.0) ** 2 for g, v in roots.items())
    return usual, np.sqrt(total)
