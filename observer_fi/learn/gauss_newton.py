"""Gauss-Newton for every output-error fit: parameters with Gaussian priors and bounds, two free numbers per move.

    minimise  1/2 sum r^2 + 1/2 sum ((p - prior) / prior_std)^2 + 1/2 sum (nuisance / nuisance_std)^2

The residuals r are normalised by the noise and fall into moves. The two numbers of a move, its rest current and rest
position, touch that move only, so that they are projected out move by move. Sums over moves of the projected normal
equations also give the estimate without some of the moves, without another simulation.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import gram, matvec, self_gram, sum_of_squares
from observer_fi.physics import Model
from observer_fi.records import Array

NUISANCE_STEP = np.array([1e-4, 1e-6])  # A, m: for differences
_ITERATIONS = 30
_HALVINGS = 6
_DONE = 0.01  # nats that a step must gain to be worth another one
# Of the misfit over the noise, the same: who misses by thousands looks for no tenth of a nat.
_OF_MISFIT = 1e-5
_CONDITION = 1e-12
_RUN_AWAY = 1e30  # standard deviations of the noise
_FARTHEST = 4.0  # standard deviations that a rest may be off: farther out is another branch of stick and slip


class Free(NamedTuple):
    """One free parameter: bounds, a step for differences that the noise does not hide, and a Gaussian prior.

    prior_std may be infinite.
    """

    name: str
    step: float
    low: float = -math.inf
    high: float = math.inf
    prior: float = 0.0
    prior_std: float = math.inf

    @property
    def prior_weight(self) -> float:
        """Weight of the prior in the normal equations, whose unit is the step."""
        return (self.step / self.prior_std) ** 2


class Point(NamedTuple):
    """Where a search stands: values by name, nuisance (M, 2) A, m, residuals (N, 3), objective [nats]."""

    values: dict[str, float]
    nuisance: Array
    residuals: Array
    objective: float


class Moves(Protocol):
    """Move m in rows bounds[m]:bounds[m + 1] of the residuals; nuisance_std (M, 2), infinite for no prior."""

    @property
    def bounds(self) -> NDArray[np.int64]:
        """(M + 1,) first rows of the moves."""

    @property
    def nuisance_std(self) -> Array:
        """(M, 2) A, m."""


class Problem(Moves, Protocol):
    """What is fitted."""

    @property
    def free(self) -> tuple[Free, ...]:
        """The free parameters."""

    def residuals(self, values: Mapping[str, float], nuisance: Array) -> Array:
        """(N, 3) normalised residuals, 0 where missing."""

    def columns(self, point: Point) -> tuple[Array, Array]:
        """(k, N, 3) and (2, N, 3): change of the normalised readings for one step of each parameter and nuisance."""


class Normal(NamedTuple):
    """Normal equations per move with its two numbers projected out; units are the steps.

    H (M, k, k), g (M, k): g is the gradient of half the sum of squares to -parameter. pull (M, 2) of the residual on
    the two numbers, follow (M, 2, k) how they follow each parameter.
    """

    H: Array
    g: Array
    pull: Array
    follow: Array


class Found(NamedTuple):
    """Where a search ended, and the columns (k, N, 3) of its last step."""

    point: Point
    columns: Array
    converged: bool


def search(
    problem: Problem,
    values: Mapping[str, float],
    nuisance: Array,
    iterations: int = _ITERATIONS,
    worth: float = _DONE,
    goal: float = math.inf,
) -> Found:
    """Gauss-Newton with step halving from `values` on, until a step gains less than `worth` [nats] or than the misfit is worth.

    goal: an objective; the search ends where steps that gain as much as the better of the last two would not come there.
    Rests that were dragged to another branch of stick and slip while the parameters were far off start anew, once.
    """
    point = point_at(problem, values, nuisance)
    columns, converged, before, last = np.empty(0), False, None, math.inf
    for left in reversed(range(iterations)):
        columns = around = np.empty(0)  # not twice at once: they are the largest there is
        columns, around = problem.columns(point)
        enough = max(worth, _OF_MISFIT * _over_noise(point))
        better = _better(problem, point, project(problem, columns, around, point), enough)
        gain = point.objective - better.objective if better else 0.0
        point = better or point
        if gain >= enough:
            if point.objective - left * max(gain, last) > goal:
                break
            last = gain
            continue
        converged = True
        far = np.abs(point.nuisance) > _FARTHEST * problem.nuisance_std
        if before is not None or not far.any():
            break
        before = point
        point = point_at(problem, point.values, np.where(far, 0.0, point.nuisance))
    if before is not None and before.objective < point.objective:
        point = before
    return Found(point, columns, converged)


def _over_noise(point: Point) -> float:
    """Nats of the objective over what white noise leaves, 0 where it is infinite: there any step is worth its while."""
    over = point.objective - 0.5 * float(np.count_nonzero(point.residuals))
    return over if math.isfinite(over) else 0.0


def point_at(problem: Problem, values: Mapping[str, float], nuisance: Array) -> Point:
    """The point with these values and nuisances."""
    r = problem.residuals(values, nuisance)
    doubt = 0.5 * float(np.sum((nuisance / problem.nuisance_std) ** 2))
    return Point(dict(values), nuisance, r, objective(values, problem.free, r) + doubt)


def objective(values: Mapping[str, float] | Model, free: Sequence[Free], r: Array) -> float:
    """Half the sum of squares, priors of the parameters included [nats]."""
    total = 0.5 * sum_of_squares(r)
    total = total if math.isfinite(total) else math.inf
    return total + 0.5 * sum(((values[f.name] - f.prior) / f.prior_std) ** 2 for f in free)


def _better(problem: Problem, point: Point, normal: Normal, worth: float) -> Point | None:
    """The point after the longest step that lowers the objective: the Newton step, its half, and so on.

    At the edge of stick and slip the difference of a rest tells nothing of it, and would spoil a good step of the parameters:
    each length is also tried with the rests where they are. Nothing shorter is tried once the parameters' part promises
    less than `worth` [nats].
    """
    step = newton_step(problem.free, point.values, normal)
    still = normal._replace(pull=np.zeros_like(normal.pull), follow=np.zeros_like(normal.follow))
    promising = promised(problem.free, point.values, normal, step) >= worth
    for halving in range(_HALVINGS):
        for rests in (normal, still):
            trial = moved(problem, point, 0.5**halving * step, rests)
            if trial.objective < point.objective:
                return trial
            if not promising:
                return None
    return None


def promised(free: Sequence[Free], values: Mapping[str, float], normal: Normal, step: Array) -> float:
    """Nats that the linearised objective gains by a step (k,) of the parameters, in units of the steps."""
    H, g = _whole(free, values, normal)
    return float(g @ step - 0.5 * step @ H @ step)


def moved(problem: Problem, point: Point, step: Array, normal: Normal) -> Point:
    """The point after a step (k,) in units of the steps, within the bounds; the numbers of the moves follow."""
    values = stepped(problem.free, point.values, step)
    actual = np.array([(values[f.name] - point.values[f.name]) / f.step for f in problem.free])
    shift = normal.pull - np.einsum("mak,k->ma", normal.follow, actual)
    return point_at(problem, values, point.nuisance + shift * NUISANCE_STEP)


def stepped(free: Sequence[Free], values: Mapping[str, float], step: Array) -> dict[str, float]:
    """Values after a step (k,) in units of the steps, within the bounds."""
    changed = {
        f.name: min(max(values[f.name] + float(d) * f.step, f.low), f.high)
        for f, d in zip(free, step, strict=True)
    }
    return {**values, **changed}


def project(problem: Moves, columns: Array, around: Array, point: Point) -> Normal:
    """Normal equations at a point from the columns (k, N, 3) and those of the two numbers of every move (2, N, 3)."""
    columns, k, bounds = _told(columns), columns.shape[0], problem.bounds
    moves = bounds.size - 1
    H, g = np.empty((moves, k, k)), np.empty((moves, k))
    pull, follow = np.empty((moves, 2)), np.empty((moves, 2, k))
    weight = (NUISANCE_STEP / problem.nuisance_std) ** 2
    for m in range(moves):
        rows = slice(int(bounds[m]), int(bounds[m + 1]))
        residual = point.residuals[rows].ravel()
        G, N = columns[:, rows].reshape(k, residual.size), around[:, rows].reshape(2, residual.size)
        block = np.linalg.pinv(self_gram(N) + np.diag(weight[m]), rcond=_CONDITION)
        cross = gram(N, G)
        pull[m] = block @ (matvec(N, residual) - weight[m] * point.nuisance[m] / NUISANCE_STEP)
        follow[m] = block @ cross
        H[m] = self_gram(G) - cross.T @ follow[m]
        g[m] = matvec(G, residual) - cross.T @ pull[m]
    return Normal(H, g, pull, follow)


def _told(columns: Array) -> Array:
    """Columns (k, N, 3), zero for parameters with which a simulation runs away: a difference says nothing of them there."""
    near = np.maximum(columns.max(axis=(1, 2)), -columns.min(axis=(1, 2))) < _RUN_AWAY
    return columns if near.all() else np.where(near[:, None, None], columns, 0.0)


def newton_step(free: Sequence[Free], values: Mapping[str, float], normal: Normal) -> Array:
    """(k,) step that minimises the linearised objective, in units of the steps.

    A parameter at its bound that would leave it stays there.
    """
    at = np.array([values[f.name] for f in free])
    low, high = np.array([f.low for f in free]), np.array([f.high for f in free])
    H, g = _whole(free, values, normal)
    inside, step = np.ones(len(free), dtype=bool), np.zeros(len(free))
    for _ in free:
        step[:] = 0.0
        step[inside] = _solve(H[np.ix_(inside, inside)], g[inside])
        out = inside & (((step < 0.0) & (at <= low)) | ((step > 0.0) & (at >= high)))
        if not out.any():
            break
        inside &= ~out
    return step


def _whole(free: Sequence[Free], values: Mapping[str, float], normal: Normal) -> tuple[Array, Array]:
    """(k, k) and (k,): the normal equations of all moves and of the priors."""
    prior = np.array([f.prior_weight for f in free])
    pull = np.array([(f.prior - values[f.name]) / f.step for f in free])
    return normal.H.sum(axis=0) + np.diag(prior), normal.g.sum(axis=0) + prior * pull


def _solve(H: Array, g: Array) -> Array:
    """H^-1 g for a positive semi-definite H of any scale: directions without information do not move."""
    if g.size == 0:
        return g
    d = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.linalg.lstsq(H / np.outer(d, d), g / d, rcond=_CONDITION)[0] / d


def scales(free: Sequence[Free]) -> Array:
    """(k,) the unit of each parameter in the normal equations: its step."""
    return np.array([f.step for f in free])


UNTOLD = 1e-12  # what readings say at least of a parameter, per square of its step: a million steps wide is not told


def covariance_of(free: Sequence[Free], normal: Normal) -> Array:
    """(k, k) covariance for white residuals of unit size, priors included [SI]; wide in directions that nothing tells."""
    unit = scales(free)
    H = normal.H.sum(axis=0) + np.diag([f.prior_weight for f in free])
    d = np.sqrt(np.maximum(np.diag(H), UNTOLD))
    told, directions = np.linalg.eigh(H / np.outer(d, d))
    inverse = directions / np.maximum(told, _CONDITION * told.max()) @ directions.T
    return inverse / np.outer(d, d) * np.outer(unit, unit)


FEWEST_MOVES = 5  # of which a scatter can be told


def scatter(free: Sequence[Free], values: Mapping[str, float], normal: Normal) -> Array:
    """(k,) standard error of each parameter from what moves, left out one at a time, change in it (jackknife) [SI].

    It counts what residuals of a move have in common, however long: a model that is off by a little is off in every sample
    of it. Zeros where too few moves tell of a parameter: without the one that does, nothing of it is left.
    """
    moves = normal.g.shape[0]
    told = np.diagonal(normal.H, axis1=1, axis2=2)
    effective = told.sum(axis=0) ** 2 / np.maximum((told**2).sum(axis=0), 1e-300)
    if moves < FEWEST_MOVES:
        return np.zeros(len(free))
    left = [np.arange(moves) != m for m in range(moves)]
    steps = np.array([newton_step(free, values, Normal(*(part[rest] for part in normal))) for rest in left])
    return scales(free) * np.where(effective < FEWEST_MOVES, 0.0, np.sqrt((moves - 1.0) * steps.var(axis=0)))
