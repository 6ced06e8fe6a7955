"""Two or three logs: what differs between the first and the others, where no scatter from run to run is known.

A difference is held against the noise of both logs, and, before a log is called changed, against what runs of a sound actuator
are taken to differ by as well: with so few logs that is an assumption, and is told as one.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from observer_fi.errors import UsageError
from observer_fi.records import Array
from observer_fi.trend.baseline import FEWEST, MOST_OWN, SINGLE_SHARE, Baseline, groups_of, limits_of_normal
from observer_fi.trend.kinds import kind_of
from observer_fi.trend.naming import ratio_words
from observer_fi.trend.table import Table

# What runs of one sound actuator are taken to differ by (1 sigma), as a share: friction of the field's and the simulated lives
# scatters by 1.5 to 2 %, a winding by 2 % in 5 K, constants of motor, servo and screw by less. Logarithms: their difference.
EVERYDAY = {"N m": 0.03, "N": 0.03, "ohm": 0.03, "m": 0.03, "s": 0.03, "1": 0.1}
OTHERWISE = 0.01
ASSUMED = (
    "how much healthy runs differ is not known from so few logs; 3 % of friction and resistance and 1 % of the other constants "
    "(1 sigma) is assumed, four healthy logs or more tell it"
)
# Of the assumed scatter by which another pitch or speed may move a quantity, per unit of regressors(): 10 deg or a speed or
# travel twice as large are doubted by one of it. A load that the log before had not stays as doubtful as anywhere.
UNSEEN = {"pitch_deg": 0.05, "speed_rad_s": 0.05, "speed_m_s": 0.05, "travel_m": 0.1, "travel_centre_m": 0.1}
KNOWN = 1000  # degrees of freedom of a scatter that is assumed
PER_MILLE = 1e-3  # chance of a difference that noise alone makes in any quantity of a log


class Difference(NamedTuple):
    """One quantity in the first log and in a later one, with standard errors from their own noise. sigmas: the difference in
    standard errors of it; differs: by more than this noise explains.
    """

    name: str
    unit: str
    before: float
    before_std: float
    after: float
    after_std: float
    sigmas: float
    differs: bool

    @property
    def size(self) -> float:
        """Later less before."""
        return self.after - self.before

    @property
    def std(self) -> float:
        """Standard error of `size`, from the noise of both logs."""
        return float(np.hypot(self.before_std, self.after_std))


def in_percent(d: Difference) -> str:
    """By how many per cent a quantity differs, "" where that says nothing: of one near to zero, or a part of an amplitude."""
    if d.unit == "1":
        return f"{100.0 * math.expm1(d.size):+.0f} %"
    return "" if kind_of(d.name).group in ("ripple", "travel") else ratio_words(d.after, d.before, d.std)


def is_few(logs: int) -> bool:
    """Whether so many logs are too few to tell a scatter from run to run."""
    return logs < FEWEST


def everyday(names: Sequence[str], units: Sequence[str], value: Array) -> Array:
    """(k,) what runs of a sound actuator are taken to differ by, from values (k,). Torques count against friction, of which
    an offset or a slope is a part. A ripple counts by its own size as well: a position that is counted from where it was
    switched on begins anywhere in a turn.
    """
    share = np.array([EVERYDAY.get(u, OTHERWISE) for u in units])
    size = np.where(np.array(units) == "1", 1.0, np.abs(value))
    if "A" in names:
        torque = np.array([u == units[names.index("A")] for u in units])
        size = np.where(torque, np.maximum(size, abs(float(value[names.index("A")]))), size)
    return np.maximum(share * size, _amplitudes(names, value))


def _amplitudes(names: Sequence[str], value: Array) -> Array:
    """(k,) the amplitude of the ripple of which a quantity is the sine or cosine; zero for others."""
    pairs = [n.replace("_sin_", "_cos_") if n.startswith("ripple_") else "" for n in names]
    squares = {p: sum(float(v) ** 2 for v, q in zip(value, pairs, strict=True) if q == p) for p in set(pairs)}
    return np.array([math.sqrt(squares[p]) if p else 0.0 for p in pairs])


def from_few(before: Table, rate: float) -> Baseline:
    """A baseline of one to three logs: their mean, with an assumed scatter. Raises UsageError where they tell nothing."""
    told = np.flatnonzero(np.isfinite(before.value).all(axis=0) & np.isfinite(before.variance).all(axis=0))
    if not told.size:
        raise UsageError(f"{before.paths[0]}: no quantity is told by it; record moves in both directions")
    names, units = (tuple(of[k] for k in told) for of in (before.names, before.units))
    mean = before.value[:, told].mean(axis=0)
    own = np.sqrt(before.variance[:, told].mean(axis=0))
    scatter = np.sqrt(everyday(names, units, mean) ** 2 + own**2)
    scatter = np.maximum(scatter, 1e-300)
    groups = groups_of(names)
    usual, limit = limits_of_normal(groups, KNOWN, rate)
    return Baseline(
        before, names, units, mean[None], np.array([[1.0 / len(before.paths)]]), scatter, np.zeros((1, told.size)),
        np.minimum(own / scatter, MOST_OWN), {g: np.eye(r.size) for g, r in groups.items()}, KNOWN, usual, limit,
        float(-ndtri(SINGLE_SHARE * rate / (2 * told.size))), unseen=UNSEEN,
    )  # fmt: skip


def differences(before: Table, table: Table, row: int) -> tuple[Difference, ...]:
    """What one log of a table tells beside the mean of the logs before, the clearest difference first."""
    found = []
    limit = float(-ndtri(0.5 * PER_MILLE / max(len(before.names), 1)))
    for k, name in enumerate(before.names):
        known = np.isfinite(before.value[:, k])
        if name not in table.names or not known.any():
            continue
        j = table.names.index(name)
        after, variance = float(table.value[row, j]), float(table.variance[row, j])
        own = float(before.variance[known, k].sum()) / int(known.sum()) ** 2
        std = float(np.sqrt(own + variance))
        if np.isfinite(after) and np.isfinite(std) and std > 0.0:
            mean = float(before.value[known, k].mean())
            z = (after - mean) / std
            entry = (name, before.units[k], mean, own**0.5, after, variance**0.5, z, abs(z) > limit)
            found.append(Difference(*entry))
    return tuple(sorted(found, key=lambda d: -abs(d.sigmas)))
