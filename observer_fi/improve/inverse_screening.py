"""The score of a candidate: what its columns explain of a residual that everything in the model has left over."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer_fi.improve.inverse_vocabulary import Candidate
from observer_fi.learn import TIMING, Columns, Motion, Sharing, Solution, correlated, solve
from observer_fi.records import Array

_SHORT = 0.3  # rad at the edge of the band
_BAND = 1.25  # the decimation keeps 0.8 of the samples' band


@dataclass(frozen=True)
class Score:
    """A candidate on the residual of a round. basis (N, k): its columns projected off the model, orthonormal.

    gain: what they explain of the residual [N^2]; net: extended BIC of it; detectable: smallest size at three standard
    errors, by parameter, infinite where the data cannot show it. short: a delay or lag that is small against the
    fastest motion of the band.
    """

    candidate: Candidate
    basis: Array
    gain: float
    net: float
    detectable: dict[str, float]
    short: bool = False


def screen(
    columns: Columns, motions: Sequence[Motion], base: Solution, candidates: Sequence[Candidate]
) -> list[Score]:
    """Every candidate's projected score on the residual of `base`, best first."""
    q = orthonormal(base.jacobian)
    scores = [_score(columns, motions, base, q, c, len(candidates)) for c in candidates]
    return sorted(scores, key=lambda s: -s.net)


def _score(
    columns: Columns, motions: Sequence[Motion], base: Solution, q: Array, candidate: Candidate, count: int
) -> Score:
    names, C = _columns_of(columns, motions, base, candidate)
    left = off(q, C)
    seen = np.linalg.norm(left, axis=0) > 0.0
    basis = orthonormal(left[:, seen])
    gain = float(np.sum((basis.T @ base.residual) ** 2))
    n = independent_samples(basis, base.residual)
    net = won(base.rss, base.rss - gain, n, basis.shape[1], 1, count) if seen.any() else -math.inf
    short = False
    if names[0] in TIMING and seen.any():
        estimate = abs(float(left[:, 0] @ base.residual)) / float(left[:, 0] @ left[:, 0])
        short = 2.0 * math.pi * estimate * 0.4 / (motions[0].factor * motions[0].step) < _SHORT
    return Score(candidate, basis, gain, net, _detectable(names, left, seen, base), short)


def _detectable(names: list[str], left: Array, seen: Array, base: Solution) -> dict[str, float]:
    """Three standard errors of each parameter, infinite where its column is a sum of what is in the model."""
    found = dict.fromkeys(names, math.inf)
    if seen.any():
        inverse = np.linalg.pinv(left[:, seen].T @ left[:, seen])
        spread = left[:, seen].T @ correlated(left[:, seen], base.residual)
        std = np.sqrt(np.maximum(np.diag(inverse @ spread @ inverse), 0.0) * base.rss / base.residual.size)
        for j, k in enumerate(np.flatnonzero(seen)):
            found[names[k]] = min(found[names[k]], 3.0 * float(std[j]))
    return found


def _columns_of(
    columns: Columns, motions: Sequence[Motion], base: Solution, candidate: Candidate
) -> tuple[list[str], Array]:
    """(N, k) columns that the candidate would add, linearised, with the parameter of each."""
    probe = candidate.added_to(replace(base.structure, free=()))
    timing = tuple(name for name in candidate.free if name in TIMING)
    new = solve(columns, motions, replace(probe, free=timing), iterations=0) if timing else None
    if new is not None:
        return list(timing), new.jacobian[:, new.theta.size :]
    names, parts = [], []
    for term in candidate.terms:
        blocks = [columns.term(m, term, probe.shapes)[m.use] for m in motions]
        if term.sharing is Sharing.EACH:
            for k in range(len(blocks)):
                parts.append(
                    np.concatenate([b if j == k else np.zeros(b.size) for j, b in enumerate(blocks)])
                )
                names.append(term.moves[0][0])
        else:
            parts.append(np.concatenate(blocks))
            names.append(term.moves[0][0])
    return names, np.column_stack(parts)


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


def won(before: float, after: float, independent: float, parameters: int, causes: int, count: int) -> float:
    """Extended BIC that is won: n ln(before / after) - k ln n - 2 causes ln(count)."""
    price = parameters * math.log(independent) + 2.0 * causes * math.log(count)
    return independent * math.log(before / after) - price


def independent_samples(basis: Array, residual: Array) -> float:
    """Samples that are independent as far as columns (basis (N, k)) can tell; never more than the band holds."""
    if basis.shape[1] == 0:
        return 1.0
    inflation = float(np.sum(basis * correlated(basis, residual))) / basis.shape[1]
    return residual.size / max(inflation, _BAND)


def alike(a: Score, b: Score) -> float:
    """Cosine of the angle between the farthest directions of two candidates; 0 if their sizes differ.

    A short lag is a delay: what sets them apart are the reversals, where every model of friction is at its worst.
    """
    if a.short and b.short:
        return 1.0
    if a.basis.shape[1] != b.basis.shape[1] or a.basis.shape[1] == 0:
        return 0.0
    return float(np.linalg.svd(a.basis.T @ b.basis, compute_uv=False)[-1])
