"""How many nats blocks of moves tell between rivals: simulated readings of one, fitted by the others as well as they can.

Fits are linear, about each rival at its own size. What moves say adds up: the normal equations of a profile are the sum of
those of its blocks, so that a search over profiles simulates every block once.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn import (
    Experiment,
    Free,
    Point,
    fit,
    nuisance_columns,
    prepare,
    project,
    residuals,
    run,
    scales,
    whitened,
)
from observer_fi.physics import Rig, Scenario, synthesise
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import Block, Placed, by_pitch, lay_out
from observer_fi.plan.rivals import Hypothesis, Rival
from observer_fi.records import Array, Log

_BOUND_ROUNDS = 4
_RIDGE = 1e-10  # of a scaled diagonal: directions without information do not move
_EARLY_S = (
    0.05  # a move belongs to a block that begins so much later: its first sample is the last one at rest
)


@dataclass(frozen=True)
class Fitted:
    """What a fit of one hypothesis makes of one truth, block by block; units are the steps.

    H (B, k, k), g (B, k): normal equations, g towards the truth. s (B,): twice the nats before the fit. at (k,): values from
    which it starts.
    """

    free: tuple[Free, ...]
    at: Array
    H: Array
    g: Array
    s: Array

    def left(self, counts: Array) -> float:
        """Nats that the best fit leaves on so many of each block, counts (B,)."""
        k = len(self.free)
        H = (counts @ self.H.reshape(counts.size, -1)).reshape(k, k)
        g, s = counts @ self.g, float(counts @ self.s)
        weight = np.array([f.prior_weight for f in self.free])
        away = np.array(
            [
                (f.prior - v) / f.step if f.prior_weight else 0.0
                for f, v in zip(self.free, self.at, strict=True)
            ]
        )
        d = self._step(H + np.diag(weight), g + weight * away)
        return max(
            0.5 * (s - 2.0 * float(g @ d) + float(d @ H @ d)) + 0.5 * float(weight @ (d - away) ** 2), 0.0
        )

    def _step(self, H: Array, g: Array) -> Array:
        """The least squares within the bounds: what would leave them is held there, and the others follow."""
        unit = scales(self.free)
        low = (np.array([f.low for f in self.free]) - self.at) / unit
        high = (np.array([f.high for f in self.free]) - self.at) / unit
        d, inside = np.zeros(g.size), np.ones(g.size, dtype=np.bool_)
        for _ in range(_BOUND_ROUNDS):
            rows = np.ix_(inside, inside)
            d[inside] = solved(H[rows], g[inside] - H[np.ix_(inside, ~inside)] @ d[~inside])
            out = inside & ((d < low) | (d > high))
            if not out.any():
                return d
            inside &= ~out
            d[out] = np.clip(d[out], low[out], high[out])
        return np.clip(d, low, high)


def solved(H: Array, g: Array) -> Array:
    """H^-1 g for a positive semi-definite H of any scale."""
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.linalg.solve(H / np.outer(scale, scale) + _RIDGE * np.eye(g.size), g / scale) / scale


@dataclass(frozen=True)
class Pair:
    """A truth, and a rival in every form that it may take."""

    truth: str
    rival: str
    forms: tuple[Fitted, ...]

    def left(self, counts: Array) -> float:
        """Nats that the rival's best form leaves."""
        return min(form.left(counts) for form in self.forms)


@dataclass(frozen=True)
class Evidence:
    """What blocks say of every pair. seconds (B,): how long they last."""

    blocks: tuple[Block, ...]
    seconds: Array
    pairs: tuple[Pair, ...]

    def value(self, counts: Array) -> float:
        """Expected log-odds of the truth against its closest rival [nats], of the least favourable pair."""
        return min(pair.left(counts) for pair in self.pairs)


# --- simulated moves ---------------------------------------------------------------------------------


def logs_of(
    blocks: Sequence[Block], rig: Rig, limits: Limits, rival: Rival | None = None, seed: int = 0
) -> list[Log]:
    """One log for every run of one pitch, of the rig, or with a rival in it."""
    logs = []
    for k, (pitch, run_) in enumerate(by_pitch(blocks)):
        moves, _, end = lay_out(run_, limits.accel)
        scenario = Scenario(moves, end, limits.rate_hz, pitch, seed=1000 * seed + k)
        if rival is not None:
            effects = {} if rival.fault.kind != "none" else rival.values
            scenario = replace(scenario, effects=effects, fault=rival.fault)
        logs.append(synthesise(scenario, rig, f"{pitch:g} deg")[0])
    return logs


def whole(blocks: Sequence[Block], rig: Rig, limits: Limits) -> tuple[Experiment, NDArray[np.int64]]:
    """A profile as it is recorded, all of it one block."""
    experiment = prepare(logs_of(blocks, rig, limits), rig, share=1.0)
    return experiment, np.zeros(experiment.moves, dtype=np.int64)


def library(
    blocks: Sequence[Block], rig: Rig, limits: Limits, warm_up: Block
) -> tuple[Experiment, NDArray[np.int64]]:
    """Blocks of all pitches one after another, and of each move the number of its block, -1 of none.

    A log's first move says less than others: a warm-up takes its place.
    """
    runs = [(replace(warm_up, pitch=pitch), *run_) for pitch, run_ in by_pitch(blocks)]
    experiment = prepare(logs_of([b for run_ in runs for b in run_], rig, limits), rig, share=1.0)
    owner, first = np.full(experiment.moves, -1, dtype=np.int64), 0
    for k, run_ in enumerate(runs):
        here = np.flatnonzero(experiment.log == k)
        starts = experiment.t[experiment.bounds[here] + experiment.moving[here]]
        number = _owners(starts, lay_out(run_, limits.accel)[1])
        owner[here] = np.where(number > 0, number - 1 + first, -1)
        first += len(run_) - 1
    return experiment, owner


def _owners(starts: Array, placed: Sequence[Placed]) -> NDArray[np.int64]:
    begins = np.array([p.begin for p in placed])
    return np.searchsorted(begins - _EARLY_S, starts, "right") - 1


def readings(experiment: Experiment, h: Hypothesis) -> Array:
    """(N, 3) of a hypothesis, without noise."""
    y = run(experiment, h.model, np.zeros((experiment.moves, 2)))[1]
    if h.still is not None:
        for m in range(experiment.moves):
            first = int(np.flatnonzero(experiment.log == experiment.log[m])[0])
            y[experiment.rows(m), h.still] = y[int(experiment.bounds[first]), h.still]
    return y


def columns_of(experiment: Experiment, h: Hypothesis) -> tuple[Array, Array]:
    """Columns (k, N, 3) of the free parameters and (2, N, 3) of the numbers of the moves, about a hypothesis."""
    nuisance = np.zeros((experiment.moves, 2))
    columns = fit(experiment, h.model, h.free, nuisance, iterations=0).columns
    around = nuisance_columns(experiment, h.model, nuisance, residuals(experiment, h.model, nuisance))
    if h.still is not None:
        columns[:, :, h.still] = around[:, :, h.still] = 0.0
    return columns, around


def normals(
    experiment: Experiment, owner: NDArray[np.int64], h: Hypothesis, truths: Sequence[Array]
) -> list[Fitted]:
    """What a hypothesis makes of the readings (N, 3) of each truth."""
    columns, around = columns_of(experiment, h)
    here = readings(experiment, h)
    apart = np.array([whitened(experiment, (y - here) * experiment.weight) for y in truths]).reshape(
        -1, *here.shape
    )
    k, still = columns.shape[0], np.zeros((experiment.moves, 2))
    point = Point({}, still, np.zeros_like(here), 0.0)
    H = project(experiment, np.concatenate([columns, apart]), around, point).H
    count = int(owner.max()) + 1
    blocks = np.array([H[owner == b].sum(axis=0) for b in range(count)])
    at = np.array([h.model[f.name] for f in h.free])
    return [
        Fitted(h.free, at, blocks[:, :k, :k], blocks[:, :k, k + a], blocks[:, k + a, k + a])
        for a in range(len(truths))
    ]


def weigh(
    experiment: Experiment,
    owner: NDArray[np.int64],
    rivals: Sequence[Rival],
    blocks: Sequence[Block],
    seconds: Sequence[float],
) -> Evidence:
    """Every ordered pair of rivals on the blocks of an experiment."""
    made = [readings(experiment, rival.forms[0]) for rival in rivals]
    pairs = []
    for b, rival in enumerate(rivals):
        others = [a for a, other in enumerate(rivals) if a != b and not other.within_all]
        by_form = [normals(experiment, owner, form, [made[a] for a in others]) for form in rival.forms]
        pairs += [
            Pair(rivals[a].name, rival.name, tuple(forms[k] for forms in by_form))
            for k, a in enumerate(others)
        ]
    pairs = [pair for pair in pairs if pair.forms]
    return Evidence(tuple(blocks), np.array(seconds), tuple(pairs))


def covariance(fitted: Fitted, counts: Array) -> Array:
    """(k, k) of the free parameters after so many of each block [SI], priors included."""
    k = len(fitted.free)
    H = (counts @ fitted.H.reshape(counts.size, -1)).reshape(k, k) + np.diag(
        [f.prior_weight for f in fitted.free]
    )
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.inv(H / np.outer(scale, scale) + _RIDGE * np.eye(k)) / np.outer(scale, scale)
    unit = scales(fitted.free)
    return inverse * np.outer(unit, unit)


def std_of(fitted: Fitted, counts: Array) -> dict[str, float]:
    """Standard errors after so many of each block."""
    variances = np.diag(covariance(fitted, counts))
    return {f.name: math.sqrt(max(v, 0.0)) for f, v in zip(fitted.free, variances, strict=True)}


def precision(fitted: Fitted, counts: Array, names: Sequence[str]) -> float:
    """Minus half the log-determinant of the covariance of some constants, relative to their values: D-optimal where largest."""
    at = [k for k, f in enumerate(fitted.free) if f.name in names]
    unit = np.abs(fitted.at[at]) + (fitted.at[at] == 0.0)
    return -0.5 * float(
        np.linalg.slogdet(covariance(fitted, counts)[np.ix_(at, at)] / np.outer(unit, unit))[1]
    )
