"""Products of a few long rows, on one thread: a threaded BLAS takes many times longer here on a machine with other work."""

import numpy as np

from observer_fi.numerics.compile import compiled, inlined
from observer_fi.numerics.rows import MOST, dot, load, zeros
from observer_fi.records import Array

EIGHT = (0,) * MOST

_DEPENDENT = (
    1e-12  # of the largest eigenvalue of the rows' correlation: below, a row adds nothing but rounding
)


@inlined
def _inner(A: Array, i: int, B: Array, j: int) -> float:
    """Product of row i of A and row j of B, (k, n) and (l, n): eight sums side by side, always in the same order."""
    n = A.shape[1]
    total, ends = zeros(EIGHT), 0.0
    for m in range(0, n - MOST + 1, MOST):
        total = total + load(A, i * n + m, EIGHT) * load(B, j * n + m, EIGHT)
    for m in range(n - n % MOST, n):
        ends += A[i, m] * B[j, m]
    return dot(total, zeros(EIGHT) + 1.0) + ends


@compiled
def _gram(A: Array, B: Array) -> Array:
    out = np.empty((A.shape[0], B.shape[0]))
    for i in range(A.shape[0]):
        for j in range(B.shape[0]):
            out[i, j] = _inner(A, i, B, j)
    return out


@compiled
def _self_gram(A: Array) -> Array:
    out = np.empty((A.shape[0], A.shape[0]))
    for i in range(A.shape[0]):
        for j in range(i + 1):
            out[i, j] = _inner(A, i, A, j)
            out[j, i] = out[i, j]
    return out


def gram(A: Array, B: Array) -> Array:
    """A B' for rows A (k, n) and B (l, n)."""
    return _gram(np.ascontiguousarray(A), np.ascontiguousarray(B))


def self_gram(A: Array) -> Array:
    """A A' for rows A (k, n)."""
    return _self_gram(np.ascontiguousarray(A))


def matvec(A: Array, y: Array) -> Array:
    """A y for rows A (k, n) and y (n,)."""
    return gram(A, y[None])[:, 0]


@compiled
def subtract_rows(y: Array, w: Array, A: Array) -> None:
    """y - w A, in place, for y (n,), weights w (k,) and rows A (k, n)."""
    for i in range(A.shape[0]):
        for m in range(y.size):
            y[m] -= w[i] * A[i, m]


def sum_of_squares(y: Array) -> float:
    """Sum of squares of an array of any shape."""
    flat = y.reshape(1, -1)
    return float(matvec(flat, flat[0])[0])


def orthonormal(A: Array) -> Array:
    """Orthonormal rows that span the rows of A (k, n); rows that depend on others are left out."""
    H = self_gram(A)
    length = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H / np.outer(length, length))
    good = values > _DEPENDENT * values[-1]
    weights = vectors[:, good].T / np.sqrt(values[good])[:, None] / length
    out = np.zeros((int(good.sum()), A.shape[1]))
    for row, w in zip(out, weights, strict=True):
        subtract_rows(row, -w, A)
    return out
