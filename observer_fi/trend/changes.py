"""What changed since when: steps and drifts of each quantity over the logs, told from outliers and from conditions.

Each quantity is regressed on the conditions of its logs; a step or a ramp that begins at any log is one column more. The
t value of the best one is held against Student's t at the false-alarm rate shared by all quantities, logs and both kinds.
Quantities that change at the same log and in the same way are one change, and named together.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from observer_fi.records import Array
from observer_fi.trend.baseline import ALL, Baseline, Departure
from observer_fi.trend.table import SIGNED, Table, regressors

STEP, DRIFT = "step", "drift"
FEWEST_BEFORE, FEWEST_AFTER = 3, 2  # logs on either side of a change
OUTLIER = 3.5  # robust standard deviations: farther from its neighbours, a log counts as this far
MOST_CHANGES = 6
PER_CONDITION = 4  # logs after a change for each condition that it may depend on
MOST_PLACES = 200  # at which a change is looked for first
TOGETHER = 9.0  # squared t value that a quantity may lose where it is given another's time
MOST_CORRELATED = 0.8
AS_LIKELY = 3.84  # twice the log likelihood that a place may lose: 95 % of chi square, one degree of freedom
NEARBY = 5  # logs by which quantities of one change may seem to change apart
CONDITION_SHARE = 0.7  # likewise of a changed effect of a condition: where a plain step fits, too, it is that
DRIFT_SHARE = 0.95  # of its t value a drift counts for: where both fit, it is a step


class Change(NamedTuple):
    """One change of several quantities: kind, row of the first log, and for each of the k quantities its size up to the last
    log, standard error, and t value; `shows` (k,) which of them have changed; low, high: rows between which it began. by: column
    of the conditions whose effect has changed in place of the quantities themselves, 0 for none.
    """

    kind: str
    since: int
    size: Array
    std: Array
    t: Array
    shows: Array
    low: int
    high: int
    by: int = 0


@dataclass(frozen=True)
class History:
    """All quantities over all logs. n logs in order, k quantities.

    time (n,); level (n, k): fitted mean without what conditions do; value (n, k) the same with each log's own departure; std
    (k,) scatter of a log; changes; detectable (k,): the step in the middle of the logs that would just have been seen.
    conditions: name of each column, and by how much it rises per unit; slopes (c, k) of the quantities with these columns.
    """

    time: Array
    level: Array
    value: Array
    std: Array
    changes: tuple[Change, ...]
    detectable: Array
    conditions: tuple[tuple[str, float], ...]
    slopes: Array


def history_of(table: Table, baseline: Baseline, time: Array, rate: float, healthy: int = 0) -> History:
    """Changes over the logs of a table in their order. time (n,): of each log, rising; rate: of a false change in all of it.

    healthy: how many logs at the beginning are known to be.
    """
    names = baseline.names
    columns = [table.names.index(n) for n in names]
    y = table.value[:, columns]
    X = regressors(table, baseline.reference)[1]
    n, k = y.shape
    scale = np.maximum(baseline.scatter, 1e-300)
    work = np.where(np.isfinite(y), y, np.nan) / scale
    names_of = regressors(table, baseline.reference)[0]
    signed = [c for c, name in enumerate(names_of) if name in SIGNED]
    changes = _found(work, X, time, rate, healthy, signed)
    mains, extra = _columns(changes, X, time)
    fit = _fitted(work, np.column_stack([X, mains, extra]))
    changes = [_with_size(c, j, fit, X.shape[1], time, scale) for j, c in enumerate(changes)]
    sizes = fit.coefficients[X.shape[1] : X.shape[1] + mains.shape[1]]
    plain = np.array([c.by == 0 for c in changes], dtype=np.bool_)
    shown = np.array([c.shows for c in changes if not c.by]).reshape(-1, k)
    centre = fit.coefficients[0]
    level = (centre + mains[:, plain] @ np.where(shown, sizes[plain], 0.0)) * scale
    value = (centre + mains[:, plain] @ sizes[plain] + fit.residual) * scale
    std = fit.sigma * scale
    return History(
        time, level, value, std, tuple(changes), _detectable(fit, n, k, rate) * std, _scales(names_of, X, table),
        fit.coefficients[: X.shape[1]] * scale,
    )  # fmt: skip


def _scales(names: tuple[str, ...], X: Array, table: Table) -> tuple[tuple[str, float], ...]:
    """Of each column of conditions its name, and by how much it rises per unit of the condition."""
    found = []
    for c, name in enumerate(names):
        raw = (
            table.conditions[:, table.condition_names.index(name)]
            if name in table.condition_names
            else np.zeros(1)
        )
        span = float(np.nanmax(raw) - np.nanmin(raw))
        found.append((name, float(np.ptp(X[:, c])) / span if span > 0.0 else 1.0))
    return tuple(found)


def _found(work: Array, X: Array, time: Array, rate: float, healthy: int, signed: list[int]) -> list[Change]:
    """Changes one after the other; each time the earlier ones are looked for again beside the new one, and may go."""

    def beside(others: list[Change], by: int = 0) -> Change | None:
        taken = [c.since for c in others]
        columns = _columns(others, X, time, by)
        return _next(work, X, np.column_stack([X, *columns]), time, rate, healthy, signed, taken)

    changes: list[Change] = []
    while len(changes) < MOST_CHANGES:
        new = beside(changes)
        if new is None:
            break
        changes.append(new)
        for old in changes[:-1]:
            others = [c for c in changes if c is not old]
            again = beside(others, old.by)
            changes = others if again is None else [again if c is old else c for c in changes]
    return changes


def _columns(changes: list[Change], X: Array, time: Array, by: int = 0) -> tuple[Array, Array]:
    """(n, c) a column for each change, and (n, e) what else they do under other conditions, one of them, `by`, left to a change
    of its own: beside a later step that may take it all, it would be seen no more.
    """
    mains = [_column(c.kind, c.since, time) * X[:, c.by] for c in changes]
    none = np.zeros((time.size, 0))
    extra = [_with_conditions(m, X, by) for c, m in zip(changes, mains, strict=True) if not c.by]
    return np.column_stack([none, *mains]), np.column_stack([none, *extra])


class _Fit(NamedTuple):
    """Regression of k quantities: coefficients (c, k), their standard errors, residual (n, k), sigma (k,), freedom (k,)."""

    coefficients: Array
    error: Array
    residual: Array
    sigma: Array
    freedom: Array


def _fitted(work: Array, X: Array) -> _Fit:
    n, k = work.shape
    coefficients, error = np.zeros((X.shape[1], k)), np.full((X.shape[1], k), np.inf)
    residual, sigma, freedom = np.full((n, k), np.nan), np.ones(k), np.ones(k)
    for j in range(k):
        known = np.isfinite(work[:, j])
        if known.sum() < X.shape[1] + 2:
            continue
        G, y = X[known], work[known, j]
        inverse = np.linalg.pinv(G.T @ G)
        b = inverse @ G.T @ y
        r = y - G @ b
        usual = 1.4826 * float(np.median(np.abs(r))) + 1e-12
        b = inverse @ G.T @ (G @ b + np.clip(r, -OUTLIER * usual, OUTLIER * usual))
        r = y - G @ b
        calm = np.clip(r, -OUTLIER * usual, OUTLIER * usual)
        freedom[j] = max(known.sum() - np.linalg.matrix_rank(G), 1)
        sigma[j] = math.sqrt(float(calm @ calm) / freedom[j]) * _correlated(calm)
        coefficients[:, j], residual[known, j] = b, r
        error[:, j] = sigma[j] * np.sqrt(np.maximum(np.diag(inverse), 0.0))
    return _Fit(coefficients, error, residual, sigma, freedom)


def _correlated(r: Array) -> float:
    """By how much neighbouring logs that are alike widen the error of a mean."""
    total = float(r @ r)
    rho = float(r[1:] @ r[:-1]) / total if total > 0.0 else 0.0
    rho = min(max(rho - 1.0 / math.sqrt(r.size), 0.0), MOST_CORRELATED)
    return math.sqrt((1.0 + rho) / (1.0 - rho))


def _column(kind: str, since: int, time: Array) -> Array:
    after = np.arange(time.size) >= since
    if kind == STEP:
        return after.astype(float)
    begin = time[since - 1]
    return np.where(after, time - begin, 0.0) / max(float(time[-1] - begin), 1e-300)


def _with_conditions(column: Array, X: Array, by: int = 0) -> Array:
    """(n, e) what else a change does where it acts otherwise under other conditions (friction that grows with the load more than
    before), as far as there are logs enough after it to tell.
    """
    after = column > 0.0
    enough = [
        c
        for c in range(1, X.shape[1])
        if c != by and np.count_nonzero(after) >= PER_CONDITION * X.shape[1] and np.ptp(X[after, c]) > 0.0
    ]
    return np.column_stack([column * X[:, c] for c in enough]) if enough else np.zeros((column.size, 0))


def _first_places(free: list[int]) -> tuple[list[int], int]:
    """Logs at which a change is looked for first, and how far they lie apart."""
    step = -(-len(free) // MOST_PLACES)
    return free[::step], step


def _clearest(t: Array, allowed: Array) -> tuple[int, int]:
    """Row and column of the t value that exceeds what chance allows by most. t (m, k), allowed (k,)."""
    over = np.abs(t) / allowed
    row, column = np.unravel_index(int(np.nanargmax(over)), over.shape)
    return int(row), int(column)


def _weighed(work: Array, plain: Array, X: Array, time: Array, kinds: list[tuple[str, int, int]]) -> Array:
    """(m, k) t value of each kind of change at its log, as far as it counts beside a plain step."""
    t = _t_values(work, X, np.column_stack([_column(kind, p, time) * plain[:, c] for kind, p, c in kinds]))
    t[[kind == DRIFT for kind, _, _ in kinds]] *= DRIFT_SHARE
    t[[c > 0 for _, _, c in kinds]] *= CONDITION_SHARE
    return t


def _searched(
    work: Array, plain: Array, X: Array, time: Array, allowed: Array, free: list[int], signed: list[int]
) -> tuple[list[tuple[str, int, int]], Array]:  # fmt: skip
    """Kinds of change (kind, log, condition) with their t values: of many logs at some first, then at all near to the best."""
    last = work.shape[0] - FEWEST_AFTER - 2  # for what takes more logs than a step to tell
    places, step = _first_places(free)
    kinds = [(kind, p, 0) for kind in (STEP, DRIFT) for p in places if kind == STEP or p <= last]
    kinds += [(STEP, p, c) for c in signed for p in places if p <= last]
    t = _weighed(work, plain, X, time, kinds)
    kind, place, by = kinds[_clearest(t, allowed)[0]]
    ends = work.shape[0] if kind == STEP and not by else last
    between = [(kind, p, by) for p in free if 0 < abs(p - place) < step and p <= ends]
    if not between:
        return kinds, t
    return kinds + between, np.concatenate([t, _weighed(work, plain, X, time, between)])


def _next(
    work: Array, plain: Array, X: Array, time: Array, rate: float, healthy: int, signed: list[int], taken: list[int]
) -> Change | None:  # fmt: skip
    """The clearest change that is left, None where no one exceeds what chance allows.

    taken: where other changes begin. Beside these a level would rest on a log or two, and two columns share one change, so
    that neither shows it.
    """
    n, quantities = work.shape
    free = [
        p
        for p in range(max(healthy, FEWEST_BEFORE), n - FEWEST_AFTER + 1)
        if all(abs(p - other) >= FEWEST_BEFORE for other in taken)
    ]
    if not free:
        return None
    freedom = np.maximum(np.isfinite(work).sum(axis=0) - X.shape[1] - 1, 1)
    allowed = _allowed(rate, quantities, n, freedom)
    kinds, t = _searched(work, plain, X, time, allowed, free, signed)
    best, j = _clearest(t, allowed)
    over = np.abs(t) / allowed
    if over[best, j] <= 1.0:
        return None
    kind, _, by = kinds[best]
    same = np.array([k for k, (other, _, c) in enumerate(kinds) if other == kind and c == by])
    alike = _less_likely(t[:, j], t[best, j], freedom[j]) < AS_LIKELY
    shows = (over[best] > 1.0) | (
        (np.nanmax(over[same], axis=0) > 1.0) & (t[best] ** 2 > np.nanmax(t[same] ** 2, axis=0) - TOGETHER)
    )
    since = _shared(t[same][:, shows], [kinds[k][1] for k in same], kinds[best][1])
    near = [since, *(kinds[k][1] for k in same if alike[k])]
    nothing = np.zeros(quantities)
    return Change(kind, since, nothing, nothing, t[best], shows, min(near), max(near), by)


def _less_likely(t: Array, best: float, freedom: float) -> Array:
    """By how much twice the log likelihood is less at places of t values t (m,) than at that of the best.

    Of squared residuals 1 / (1 + t^2 / freedom) is left. A clear change has a large t, whose square falls fast beside it while
    the residuals hardly grow: the fall of t^2 itself would be too sure of the place.
    """
    return np.asarray(freedom * np.log((freedom + best**2) / (freedom + t**2)))


def _shared(t: Array, places: list[int], first: int) -> int:
    """The log, near to the first guess, at which all quantities that changed together fit best. t (m, s): at m places."""
    rows = [k for k, p in enumerate(places) if abs(p - first) <= NEARBY]
    total = np.sum(np.log1p(t[rows] ** 2), axis=1)
    return places[rows[int(np.argmax(total))]]


def _t_values(work: Array, X: Array, columns: Array) -> Array:
    """(m, k) t value of each of m columns (n, m), one at a time beside X, for every quantity; 0 where it cannot be told."""
    found = np.zeros((columns.shape[1], work.shape[1]))
    for j in range(work.shape[1]):
        known = np.isfinite(work[:, j])
        freedom = int(known.sum()) - X.shape[1] - 1
        if freedom < 1:
            continue
        Q = np.linalg.qr(X[known])[0]
        r = work[known, j] - Q @ (Q.T @ work[known, j])
        usual = 1.4826 * float(np.median(np.abs(r))) + 1e-12
        r = np.clip(r, -2.0 * OUTLIER * usual, 2.0 * OUTLIER * usual)
        C = columns[known] - Q @ (Q.T @ columns[known])
        square = np.sum(C**2, axis=0)
        told = square > 1e-6 * np.maximum(np.sum(columns[known] ** 2, axis=0), 1e-300)
        size = np.where(told, C.T @ r / np.maximum(square, 1e-300), 0.0)
        left = r[:, None] - C * size
        total = np.sum(left**2, axis=0)
        rho = np.sum(left[1:] * left[:-1], axis=0) / np.maximum(total, 1e-300)
        rho = np.clip(rho - 1.0 / math.sqrt(r.size), 0.0, MOST_CORRELATED)
        error = np.sqrt(total / freedom / np.maximum(square, 1e-300) * (1.0 + rho) / (1.0 - rho))
        found[told, j] = size[told] / np.maximum(error[told], 1e-300)
    return found


def _allowed(rate: float, quantities: int, n: int, freedom: Array) -> Array:
    """(k,) t value that chance exceeds with a probability of `rate` in all quantities, places and both kinds."""
    tries = quantities * max(n - FEWEST_BEFORE - FEWEST_AFTER, 1)
    return np.asarray(-stdtrit(np.maximum(freedom, 1), 0.5 * rate / tries))


def _with_size(c: Change, j: int, fit: _Fit, at: int, time: Array, scale: Array) -> Change:
    """The change with sizes from the fit of all changes together: up to the last log."""
    size, std = fit.coefficients[at + j] * scale, fit.error[at + j] * scale
    return c._replace(size=size, std=std, t=np.where(std > 0.0, size / std, 0.0))


def _detectable(fit: _Fit, n: int, k: int, rate: float) -> Array:
    """(k,) standard deviations that a step in the middle of the logs would have to have to be seen, one time in two."""
    return _allowed(rate, k, n, fit.freedom) * math.sqrt(4.0 / max(n, 4))


def as_departure(change: Change, baseline: Baseline, level: Array) -> Departure:
    """The change as a departure from what was before, for its naming."""
    which = np.flatnonzero(np.isfinite(change.std) & (change.std > 0.0))
    before = level[change.since - 1, which]
    z = change.size[which] / change.std[which]
    full = np.zeros(len(baseline.names))
    full[which] = z
    distance = {g: float(full[r] @ full[r]) / r.size for g, r in baseline.groups.items() if g != ALL}
    return Departure(which, before, before + change.size[which], change.std[which], z, distance)
