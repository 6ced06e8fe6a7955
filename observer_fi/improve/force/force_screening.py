"""The score of a cause where the force is calculated: what its columns explain of a residual that the model has left over."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer_fi.improve.steps import Candidate
from observer_fi.learn import (
    TIMING,
    Columns,
    Motion,
    Sharing,
    Solution,
    Structure,
    correlated,
    solve,
    term_of,
)
from observer_fi.learn import Term as Column
from observer_fi.physics import CAUSES, FORCE, Coverage
from observer_fi.records import Array

_SHORT = 0.3  # rad at the edge of the band
_BAND = 1.25  # the decimation keeps 0.8 of the samples' band
_STANDS_OUT = 3.0  # standard errors from which on a size would have been seen


@dataclass(frozen=True)
class ForceCandidate(Candidate):
    """A candidate, and what it does on the residual of a round.

    basis (N, k): its columns projected off the model, orthonormal; power: what they explain of the residual [N^2]. short: a
    delay or lag that is small against the fastest motion of the band. possible: its size has a sign that it may have.
    """

    basis: Array
    power: float
    short: bool
    possible: bool = True

    @property
    def columns(self) -> tuple[Column, ...]:
        """Coefficients that it adds; a delay or lag shifts the force and has none."""
        return tuple(term_of(t) for t in self.variant.sizes if t.parameter not in TIMING)

    @property
    def free(self) -> tuple[str, ...]:
        """Shapes, and delays or lags, that are searched."""
        return tuple(t.parameter for t in self.variant.terms if t.shape or t.parameter in TIMING)

    @property
    def shapes(self) -> dict[str, float]:
        """Where the search starts; delays and lags from nothing."""
        found = {t.parameter: t.start if t.shape else 0.0 for t in self.variant.terms}
        return {name: found[name] for name in self.free} | dict(self.variant.fixed)

    def added_to(self, structure: Structure) -> Structure:
        """The structure with this cause. A timing starts where it was: it may be known in part."""
        shapes = self.shapes | {k: v for k, v in structure.shapes.items() if k in TIMING}
        free = tuple(dict.fromkeys((*structure.free, *self.free)))
        limits = {t.parameter: (t.low, t.high) for t in self.variant.terms if t.parameter in self.free}
        return Structure(
            structure.terms + self.columns, structure.shapes | shapes, free, structure.limits | limits
        )

    def taken_from(self, structure: Structure, start: Structure) -> Structure:
        """The structure without this cause: what belongs to it is as it was at the start."""
        own = set(self.shapes)
        terms = tuple(t for t in structure.terms if t not in self.columns)
        shapes = {k: v for k, v in structure.shapes.items() if k not in own}
        shapes |= {k: v for k, v in start.shapes.items() if k in own}
        free = tuple(name for name in structure.free if name not in own or name in start.free)
        return Structure(terms, shapes, free, {k: v for k, v in structure.limits.items() if k not in own})


def vocabulary(coverage: Coverage) -> list[ForceCandidate]:
    """Every form of every cause that a commanded force and a position can show, without a score yet."""
    nothing = np.zeros((0, 0))
    return [
        ForceCandidate(cause, variant, 0.0, -math.inf, {}, {}, nothing, 0.0, False)
        for cause in CAUSES.values()
        for variant in cause.variants(coverage, FORCE)
    ]


def screen(
    columns: Columns, motions: Sequence[Motion], base: Solution, candidates: Sequence[ForceCandidate]
) -> list[ForceCandidate]:
    """Every candidate's projected score on the residual of `base`, best first."""
    q = orthonormal(base.jacobian)
    scores = [_score(columns, motions, base, q, c, len(candidates)) for c in candidates]
    return sorted(scores, key=lambda s: -s.net)


def _score(
    columns: Columns,
    motions: Sequence[Motion],
    base: Solution,
    q: Array,
    candidate: ForceCandidate,
    count: int,
) -> ForceCandidate:
    names, C = _columns_of(columns, motions, base, candidate)
    left = off(q, C)
    seen = np.linalg.norm(left, axis=0) > 0.0
    basis = orthonormal(left[:, seen])
    power = float(np.sum((basis.T @ base.residual) ** 2))
    n = independent_samples(basis, base.residual)
    gain = won(base.rss, base.rss - power, n)
    price = 0.5 * basis.shape[1] * math.log(n) + math.log(count)
    net = gain - price if seen.any() else -math.inf
    short = False
    if names[0] in TIMING and seen.any():
        estimate = abs(float(left[:, 0] @ base.residual)) / float(left[:, 0] @ left[:, 0])
        short = 2.0 * math.pi * estimate * 0.4 / (motions[0].factor * motions[0].step) < _SHORT
    detectable = _detectable(names, left, seen, base)
    first = candidate.variant.sizes[0]
    possible = first.low < 0.0 or first.parameter in TIMING or float(left[:, 0] @ base.residual) >= 0.0
    return replace(
        candidate, gain=gain, net=net, detectable=detectable, basis=basis, power=power, short=short,
        possible=possible,
    )  # fmt: skip


def _detectable(names: list[str], left: Array, seen: Array, base: Solution) -> dict[str, float]:
    """The smallest size of each parameter that stands out, infinite where its column is a sum of what is in the model."""
    found = dict.fromkeys(names, math.inf)
    if seen.any():
        inverse = np.linalg.pinv(left[:, seen].T @ left[:, seen])
        spread = left[:, seen].T @ correlated(left[:, seen], base.residual)
        std = np.sqrt(np.maximum(np.diag(inverse @ spread @ inverse), 0.0) * base.rss / base.residual.size)
        for j, k in enumerate(np.flatnonzero(seen)):
            found[names[k]] = min(found[names[k]], _STANDS_OUT * float(std[j]))
    return found


def _columns_of(
    columns: Columns, motions: Sequence[Motion], base: Solution, candidate: ForceCandidate
) -> tuple[list[str], Array]:
    """(N, k) columns that the candidate would add, linearised, with the parameter of each."""
    probe = candidate.added_to(replace(base.structure, free=()))
    timing = tuple(name for name in candidate.free if name in TIMING)
    if timing:
        new = solve(columns, motions, replace(probe, free=timing), iterations=0)
        return list(timing), new.jacobian[:, new.theta.size :]
    names, parts = [], []
    for term in candidate.columns:
        blocks = [columns.term(m, term, probe.shapes)[m.use] for m in motions]
        for column in _by_log(blocks) if term.sharing is Sharing.EACH else [np.concatenate(blocks)]:
            names.append(term.moves[0][0])
            parts.append(column)
    return names, np.column_stack(parts)


def _by_log(blocks: Sequence[Array]) -> list[Array]:
    """One column for each log, zero in the others."""
    whole = [
        np.concatenate([b if j == k else np.zeros(b.size) for j, b in enumerate(blocks)])
        for k in range(len(blocks))
    ]
    return whole


def off(q: Array, columns: Array) -> Array:
    """Columns projected off an orthonormal basis, those that are sums of it zero."""
    left = columns - q @ (q.T @ columns)
    left -= q @ (q.T @ left)
    gone = np.linalg.norm(left, axis=0) <= 1e-4 * np.linalg.norm(columns, axis=0)
    left[:, gone] = 0.0
    return left


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis of the columns (N, k), those that are sums of others left out."""
    length = np.linalg.norm(columns, axis=0)
    scaled = columns[:, length > 0.0] / length[length > 0.0]
    if scaled.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    u, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, values > 1e-9 * values[0]]


def won(before: float, after: float, independent: float) -> float:
    """Nats that independent samples gain where a sum of squares falls: n ln(before / after) / 2."""
    return 0.5 * independent * math.log(before / after)


def independent_samples(basis: Array, residual: Array) -> float:
    """Samples that are independent as far as columns (basis (N, k)) can tell; never more than the band holds."""
    if basis.shape[1] == 0:
        return 1.0
    inflation = float(np.sum(basis * correlated(basis, residual))) / basis.shape[1]
    return residual.size / max(inflation, _BAND)


def alike(a: ForceCandidate, b: ForceCandidate) -> float:
    """Cosine of the angle between the farthest directions of two candidates; 0 if their sizes differ.

    A short lag is a delay: what sets them apart are the reversals, where every model of friction is at its worst.
    """
    if a.short and b.short:
        return 1.0
    if a.basis.shape[1] != b.basis.shape[1] or a.basis.shape[1] == 0:
        return 0.0
    return float(np.linalg.svd(a.basis.T @ b.basis, compute_uv=False)[-1])
