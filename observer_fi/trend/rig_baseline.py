"""A baseline from a rig file: its constants are the mean, the logs themselves say how much neighbours scatter, and
what their conditions do. What no rig file gives (how rough the torque is) has the first third of the logs as its mean.
"""

import numpy as np
from scipy.special import stdtrit

from observer_fi.errors import UsageError
from observer_fi.physics import Rig
from observer_fi.trend.baseline import SINGLE_SHARE, Baseline, groups_of, limits_of_normal
from observer_fi.trend.few import KNOWN, everyday
from observer_fi.trend.table import Table, regressors

FEWEST = 4  # logs whose neighbours tell a scatter; of fewer it is assumed
NONE = ("backlash", "position_lag")  # a rig whose file is silent has none of these
EFFICIENCY = 0.37  # of a median of squares


def from_rig(table: Table, rig: Rig, rate: float) -> Baseline:
    """Mean of the rig's constants, scatter of neighbouring logs. Raises UsageError where logs and rig share no constant."""
    names = list(table.names)
    if not any(n in rig.quantities for n in names):
        raise UsageError(f"rig {rig.name}: none of its constants is told by these logs; give --baseline-logs")
    y = table.value
    early = np.nanmedian(y[: max(len(table.paths) // 3, 1)], axis=0)
    given = [n in rig.quantities or n in NONE for n in names]
    mean = np.array([rig.model[n] if known else m for n, m, known in zip(names, early, given, strict=True)])
    std = np.array([rig.quantities[n].std or 0.0 if n in rig.quantities else 0.0 for n in names])
    X = regressors(table, table)[1]
    X = X if len(table.paths) >= FEWEST * X.shape[1] else X[:, :1]
    known = np.where(np.isfinite(y), y, np.nanmedian(y, axis=0))
    inverse = np.linalg.pinv(X.T @ X)
    slopes = inverse @ X.T @ known
    if len(table.paths) >= FEWEST:
        left = known - X @ slopes
        scatter = np.sqrt(
            np.median(np.diff(left, axis=0) ** 2, axis=0) / 2.0 / 0.455
        )  # of a median of chi square
    else:
        scatter = everyday(names, table.units, mean)
    inverse[0], inverse[:, 0] = 0.0, 0.0
    slopes[0] = np.where(given, mean, slopes[0])
    own = np.sqrt(np.nanmedian(table.variance, axis=0))
    scatter = np.sqrt(scatter**2 + std**2 + own**2)
    groups = groups_of(names)
    enough = len(table.paths) >= FEWEST
    freedom = max(round(EFFICIENCY * (len(table.paths) - X.shape[1])), 2) if enough else KNOWN
    usual, limit = limits_of_normal(groups, freedom, rate)
    limit_of = float(-stdtrit(freedom, SINGLE_SHARE * rate / (2 * len(names))))
    return Baseline(
        table, tuple(names), table.units, slopes, np.asarray(inverse, dtype=float), scatter,
        np.zeros_like(slopes), np.minimum(own / scatter, 0.95), {g: np.eye(r.size) for g, r in groups.items()},
        freedom, usual, limit, limit_of,
    )  # fmt: skip


def rig_as_table(like: Table, rig: Rig) -> Table:
    """The rig's constants as the table of one log, with the quantities of other logs; what its file does not give is NaN."""
    known = [rig.quantities.get(n) for n in like.names]
    value = np.array(
        [[np.nan if q is None else rig.model[n] for n, q in zip(like.names, known, strict=True)]]
    )
    variance = np.array([[np.nan if q is None else (q.std or 0.0) ** 2 for q in known]])
    nothing = np.full((1, len(like.condition_names)), np.nan)
    return Table((rig.name,), like.names, like.units, value, variance, like.condition_names, nothing)
