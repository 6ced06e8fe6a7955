"""What healthy logs are like: a mean of every quantity under the conditions of a log, the scatter from log to log, and from
which distance on a log has changed.

    y = B c + u + e,    u ~ (0, S) from log to log,    e ~ (0, V) of the log's own noise,

c: 1 and the conditions (load, pitch, speed). A distance is that of Mahalanobis, with the correlation of S shrunk towards none
(Schaefer and Strimmer 2005): of all quantities, and of each group that one cause moves together. How far healthy logs lie that
the mean never saw is measured: blocks of the baseline are left out in turn. Cube roots of these distances are near to normal
(Wilson and Hilferty 1931); standardised, what is above zero is added in squares over the groups. Its limit is a prediction limit
of Student's t: with few logs it is far away, as it must be; one quantity alone has its own. docs/trend.md has the reasons.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit  # the quantiles of scipy.stats, which takes a second to import

from observer_fi.errors import UsageError
from observer_fi.numerics import with_unit
from observer_fi.records import Array
from observer_fi.trend.kinds import kind_of
from observer_fi.trend.table import Table, regressors

FEWEST = 4  # logs of a baseline
BLOCKS = 7  # of neighbouring logs that are left out in turn
PER_COEFFICIENT = 2  # logs for each condition that the baseline can tell
ROOT = 1.0 / 3.0  # power of a distance that is near to normal
ALL = "all"
# Makes the logarithm of a score near to normal: of normal logs 1.4 % exceed a limit of 1 %, 0.2 % one of 0.1 %.
SHIFT = 4.0
SINGLE_SHARE = (
    0.3  # of the false alarms are left to quantities that differ alone: few logs tell their limit well
)
RIDGE = 0.03  # logs that say that a condition changes nothing: what two of them do together is shared
# Prior standard deviation of the logarithm of a variance per usual departure of a condition: at 0.7 slopes made of twenty logs
# were three in a thousand false alarms where one was asked for, at 0.35 less than one.
WIDENING = 0.35
DRAWS = 50_000  # of normal logs, that tell what is usual where no healthy ones do
MOST_OWN = 0.95  # of the scatter may be a log's own noise: a later log with less of it is not that much alike
UNSEEN = 1.0  # standard deviations of the baseline by which a quantity may move per unit of a condition it never varied in


@dataclass(frozen=True)
class Baseline:
    """Healthy logs in numbers. k quantities, c conditions.

    coefficients (c, k) and leverage (c, c), whose quadratic form with a log's conditions is the share of the scatter that the
    mean's own error adds; scatter (k,) standard deviation from log to log, own noise included, excursions of healthy logs
    counted in; widening (c, k): the logarithm of its square per unit of each condition, for friction scatters more where it is
    larger; noise (k,) the share of the scatter that is a typical log's own; correlation: of each group and of all quantities,
    shrunk; freedom: degrees of it. usual: of each group of quantities mean and standard deviation of the root of a healthy
    log's distance. limit: of what groups add up to; limit_of: what one quantity may differ by, in
    standard deviations. heldout: healthy scores. unseen: of `UNSEEN`, by condition, where it is not all of it.
    """

    reference: Table
    names: tuple[str, ...]
    units: tuple[str, ...]
    coefficients: Array
    leverage: Array
    scatter: Array
    widening: Array
    noise: Array
    correlation: dict[str, Array]
    freedom: int
    usual: dict[str, tuple[float, float]]
    limit: float = math.inf
    limit_of: float = math.inf
    heldout: tuple[float, ...] = ()
    unseen: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def healthy_conditions(self) -> tuple[list[str], Array]:
        """Names and values (n, c) of the regressors of the healthy logs, which every log is held against."""
        names, values = regressors(self.reference, self.reference)
        return list(names), values

    @cached_property
    def groups(self) -> dict[str, NDArray[np.intp]]:
        """Rows of the quantities of each group, and of all."""
        return groups_of(self.names)


@dataclass(frozen=True)
class Departure:
    """How a log differs from the baseline in the quantities that both have.

    which (m,): rows of the baseline's quantities; expected (m,), found (m,), std (m,) of their difference; z (m,) in these;
    distance: by group, squared and per quantity.
    """

    which: NDArray[np.intp]
    expected: Array
    found: Array
    std: Array
    z: Array
    distance: dict[str, float]


def learn(healthy: Table, rate: float, calibration: Table | None = None) -> Baseline:
    """The baseline of healthy logs. rate: false alarms per log. calibration: further healthy logs that set the
    limit in place of those that are left out in turn.

    Raises UsageError where they are too few.
    """
    n = len(healthy.paths)
    if n < FEWEST:
        raise UsageError(
            f"{n} healthy {'log is' if n == 1 else 'logs are'} too few for a baseline: give {FEWEST} or more with --baseline-logs"
        )
    fitted = _fit(healthy)
    if not fitted.names:
        raise UsageError(
            f"{healthy.paths[0]}: no quantity is told by most of the baseline's logs; record moves in both directions"
        )
    away = _left_out(healthy)
    further = 0 if calibration is None else len(calibration.paths)
    if calibration is not None:
        away += [departure(fitted, calibration, k) for k in range(further)]
    return _with_limits(fitted, away, rate, further or len(away))


def score_of(baseline: Baseline, found: Departure) -> float:
    """How far a log is from healthy ones, 1 being the limit: in all quantities together, or in one alone where that is more."""
    single = float(np.abs(found.z).max(initial=0.0))
    return max(_together(baseline.usual, found) / baseline.limit, single / baseline.limit_of)


def _together(usual: dict[str, tuple[float, float]], found: Departure) -> float:
    """Groups that are farther than usual, added in squares."""
    return math.sqrt(sum(max(u, 0.0) ** 2 for u in _roots(usual, found.distance).values()))


def _roots(usual: dict[str, tuple[float, float]], distance: dict[str, float]) -> dict[str, float]:
    return {g: (d**ROOT - usual[g][0]) / usual[g][1] for g, d in distance.items() if g in usual}


def _with_limits(fitted: Baseline, away: Sequence[Departure], rate: float, last: int) -> Baseline:
    """The baseline with limits from healthy logs that its mean never saw, each judged by the spread of the others.

    last: how many of them, from the end, set the limit of a log.
    """
    groups = list(dict.fromkeys(g for d in away for g in d.distance))
    roots = np.array([[d.distance.get(g, np.nan) ** ROOT for g in groups] for d in away])
    scores = []
    for k in range(len(away)):
        usual = _usual(groups, np.delete(roots, k, axis=0))
        scores.append(_together(usual, away[k]))
    single = np.concatenate([d.z for d in away if d.z.size])
    wider = max(1.0, float(np.sqrt(np.mean(np.minimum(single**2, 25.0)))))
    own = float(-stdtrit(fitted.freedom, SINGLE_SHARE * rate / (2 * len(fitted.names))))
    limit = prediction_limit(np.array(scores[-last:]), (1.0 - SINGLE_SHARE) * rate)
    usual = _usual(groups, roots)
    return replace(fitted, usual=usual, limit=limit, limit_of=own * wider, heldout=tuple(scores))


def _usual(groups: Sequence[str], roots: Array) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the roots (n, g) of each group; the spread is that of its theory at least."""
    found = {}
    for k, group in enumerate(groups):
        known = roots[np.isfinite(roots[:, k]), k]
        if known.size >= 2:
            found[group] = (float(known.mean()), max(float(known.std(ddof=1)), 1e-9))
    return found


def prediction_limit(score: Array, rate: float) -> float:
    """What the next of these scores (n,) exceeds with a chance of `rate`: log(score + SHIFT) is near to normal."""
    y, n = np.log(score + SHIFT), score.size
    far = float(-stdtrit(n - 1, rate)) * float(y.std(ddof=1)) * math.sqrt(1.0 + 1.0 / n)
    return math.exp(min(float(y.mean()) + far, 700.0)) - SHIFT


def limits_of_normal(
    groups: dict[str, NDArray[np.intp]], freedom: int, rate: float
) -> tuple[dict[str, tuple[float, float]], float]:
    """What is usual of each group's distance for normal scatter known with so many degrees of freedom, and the limit of a score.

    For a baseline that has no healthy logs to leave out.
    """
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((DRAWS, groups[ALL].size))
    off = draws / np.sqrt(rng.chisquare(freedom, draws.shape) / freedom)
    roots = {g: np.mean(draws[:, r] ** 2, axis=1) ** ROOT for g, r in groups.items()}
    usual = {g: (float(v.mean()), float(v.std())) for g, v in roots.items()}
    total = np.zeros(DRAWS)
    for g, r in groups.items():
        total += np.maximum((np.mean(off[:, r] ** 2, axis=1) ** ROOT - usual[g][0]) / usual[g][1], 0.0) ** 2
    return usual, float(np.quantile(np.sqrt(total), 1.0 - max((1.0 - SINGLE_SHARE) * rate, 1e-4)))


def _left_out(healthy: Table) -> list[Departure]:
    """Every log as the others see it that are not its neighbours: a warm day is no news on the same day."""
    n = len(healthy.paths)
    found = []
    for block in np.array_split(np.arange(n), min(BLOCKS, n)):
        fitted = _fit(healthy.rows(np.setdiff1d(np.arange(n), block)))
        part = healthy.rows(block)
        found += [departure(fitted, part, k) for k in range(block.size)]
    return found


# --- mean and scatter -------------------------------------------------------------------------------


def _fit(healthy: Table) -> Baseline:
    n = len(healthy.paths)
    enough = np.isfinite(healthy.value).sum(axis=0) >= max(3, math.ceil(0.6 * n))
    moved = np.nanstd(np.where(np.isfinite(healthy.value), healthy.value, np.nan)[:, enough], axis=0) > 0.0
    kept = np.flatnonzero(enough)[moved]
    names_kept = tuple(healthy.names[k] for k in kept)
    X = regressors(healthy, healthy)[1]
    X = X[:, : 1 + max((n - 2) // PER_COEFFICIENT - 1, 0)]
    y = _completed(healthy.value[:, kept])
    inverse = np.linalg.inv(X.T @ X + RIDGE * np.diag(np.r_[1e-6, np.ones(X.shape[1] - 1)]))
    B = inverse @ X.T @ y
    r = y - X @ B
    freedom = max(n - X.shape[1], 1)
    std = np.sqrt(np.sum(r**2, axis=0) / freedom)
    usual = float(-ndtri(0.25 / n))
    widening = _widening(X, r / std, freedom / n)
    z = r / std / np.exp(0.5 * X @ widening)
    z /= np.sqrt(np.sum(z**2, axis=0) / freedom)
    scatter = std * np.maximum(1.0, np.abs(z).max(axis=0) / usual)
    own = np.sqrt(np.nanmedian(healthy.variance[:, kept], axis=0))
    return Baseline(
        healthy, names_kept, tuple(healthy.units[k] for k in kept), B, np.asarray(inverse, dtype=float),
        scatter, widening, np.minimum(own / scatter, MOST_OWN), _correlations(names_kept, z, freedom), freedom, {},
    )  # fmt: skip


def groups_of(names: Sequence[str]) -> dict[str, NDArray[np.intp]]:
    """Rows of the quantities of each group, and of all."""
    every = np.array([kind_of(name).group for name in names])
    return {
        **{g: np.flatnonzero(every == g) for g in dict.fromkeys(every.tolist())},
        ALL: np.arange(len(names)),
    }


def _correlations(names: Sequence[str], z: Array, freedom: int) -> dict[str, Array]:
    return {g: shrunk(z[:, rows], freedom) for g, rows in groups_of(names).items()}


def _widening(X: Array, z: Array, share: float) -> Array:
    """(c, k) slopes of log z^2 (n, k) with the conditions X (n, c), by their likelihood under a prior of no slope.

    The mean of X's first column, 1, is left to the scatter itself.
    """
    slopes = np.zeros((X.shape[1], z.shape[1]))
    if X.shape[1] == 1:
        return slopes
    prior = np.diag(np.r_[1e-6, np.full(X.shape[1] - 1, 1.0 / WIDENING**2)])
    inverse = np.linalg.inv(0.5 * X.T @ X + prior)
    for _ in range(20):
        ratio = np.minimum(z**2 / share / np.exp(np.clip(X @ slopes, -6.0, 6.0)), 9.0)
        slopes = slopes + inverse @ (0.5 * X.T @ (ratio - 1.0) - prior @ slopes)
    slopes[0] = 0.0
    return slopes


def _completed(value: Array) -> Array:
    """What a log could not tell as the median of the others."""
    return np.where(np.isfinite(value), value, np.nanmedian(value, axis=0))


def shrunk(z: Array, freedom: int) -> Array:
    """Correlation of standardised rows z (n, k), shrunk towards the identity by as much as its own error asks for."""
    n, k = z.shape
    R = z.T @ z / freedom
    np.fill_diagonal(R, 1.0)
    products = z[:, :, None] * z[:, None, :]
    error = n / max(n - 1, 1) ** 3 * np.sum((products - products.mean(axis=0)) ** 2, axis=0)
    off = ~np.eye(k, dtype=bool)
    total = float(np.sum(R[off] ** 2))
    share = min(1.0, float(error[off].sum()) / total) if total > 0.0 else 1.0
    share = max(share, min(1.0, k / (10.0 * n)), 0.02)
    return (1.0 - share) * R + share * np.eye(k)


# --- a log against it --------------------------------------------------------------------------------


def departure(baseline: Baseline, table: Table, row: int) -> Departure:
    """How one log of a table differs from the baseline, with the error of the mean under that log's conditions."""
    one = table.rows(np.array([row]))
    where = [table.names.index(n) if n in table.names else -1 for n in baseline.names]
    value = np.array([one.value[0, k] if k >= 0 else np.nan for k in where])
    own = np.array([one.variance[0, k] if k >= 0 else np.nan for k in where])
    c, excess, beyond = _conditions(baseline, one)
    expected = c @ baseline.coefficients
    lever = float(c @ baseline.leverage @ c) + beyond
    doubt = np.sum((excess[:, None] * baseline.coefficients) ** 2, axis=0)
    square = baseline.scatter**2 * np.exp(np.clip((c - excess * np.sign(c)) @ baseline.widening, -2.0, 4.0))
    variance = square * (1.0 - baseline.noise**2 + lever) + own + doubt
    which = np.flatnonzero(np.isfinite(value) & np.isfinite(variance))
    std = np.sqrt(variance[which])
    z = (value[which] - expected[which]) / std
    full = np.full(len(baseline.names), np.nan)
    full[which] = z
    distance = {}
    for group, rows in baseline.groups.items():
        there = np.isfinite(full[rows])
        if there.any():
            R = baseline.correlation[group][np.ix_(there, there)]
            distance[group] = float(full[rows][there] @ np.linalg.solve(R, full[rows][there])) / int(
                there.sum()
            )
    return Departure(which, expected[which], value[which], std, z, distance)


def _conditions(baseline: Baseline, one: Table) -> tuple[Array, Array, float]:
    """(c,) regressors of a log in the baseline's order; by how much each lies outside what healthy logs had, where what it
    does is doubted as a whole; and what conditions that the baseline never varied add to the variance, in that of the scatter.
    """
    mine, x = regressors(one, baseline.reference)
    size = baseline.coefficients.shape[0]
    names, healthy = baseline.healthy_conditions
    at = dict(zip(mine, x[0], strict=True))
    c = np.array([at.get(name, 0.0) for name in names[:size]])
    low, high = healthy[:, :size].min(axis=0), healthy[:, :size].max(axis=0)
    excess = np.maximum(c - high, 0.0) + np.maximum(low - c, 0.0)
    excess[0] = 0.0
    beyond = sum(
        (baseline.unseen.get(name.strip("|"), 1.0) * float(v)) ** 2
        for name, v in at.items()
        if name not in names[:size]
    )
    return c, np.where(excess > 0.1 * (high - low), excess, 0.0), UNSEEN**2 * beyond


UNITS = {
    "load_n": "N",
    "pitch_deg": "deg",
    "speed_m_s": "m/s",
    "speed_rad_s": "rad/s",
    "travel_centre_m": "m",
    "travel_m": "m",
}


def outside(baseline: Baseline, table: Table, row: int) -> tuple[str, ...]:
    """Conditions of a log that lie outside what healthy logs had, in words: what they do is taken out with doubt."""
    found = []
    for k, name in enumerate(baseline.reference.condition_names):
        if name not in table.condition_names:
            continue
        value = float(table.conditions[row, table.condition_names.index(name)])
        low, high = (
            float(np.nanmin(baseline.reference.conditions[:, k])),
            float(np.nanmax(baseline.reference.conditions[:, k])),
        )
        slack = 0.1 * (high - low) + 0.05 * max(abs(low), abs(high)) + 1e-12
        if not low - slack <= value <= high + slack:
            words = name.rpartition("_")[0] if name.endswith(("_n", "_deg", "_m")) else "speed"
            unit = UNITS.get(name, "")
            found.append(
                f"{words.replace('_', ' ')} {with_unit(value, unit)} is outside the baseline's {with_unit(low, unit)} to "
                f"{with_unit(high, unit)}"
            )
    return tuple(found)
