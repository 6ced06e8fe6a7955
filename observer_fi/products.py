"""Products of a few long rows, on one thread: a threaded BLAS takes many times longer here on a machine with other work."""

import numpy as np

from observer_fi.compiled import compiled
from observer_fi.records import Array

_DEPENDENT = (
    1e-12  # of the largest eigenvalue of the rows' correlation: below, a row adds nothing but rounding
)


@compiled
def gram(A: Array, B: Array) -> Array:
    """A B' for rows A (k, n) and B (l, n)."""
    out = np.empty((A.shape[0], B.shape[0]))
    for i in range(A.shape[0]):
        for j in range(B.shape[0]):
            total = 0.0
            for m in range(A.shape[1]):
                total += A[i, m] * B[j, m]
            out[i, j] = total
    return out


@compiled
def self_gram(A: Array) -> Array:
    """A A' for rows A (k, n)."""
    out = np.empty((A.shape[0], A.shape[0]))
    for i in range(A.shape[0]):
        for j in range(i + 1):
            total = 0.0
            for m in range(A.shape[1]):
                total += A[i, m] * A[j, m]
            out[i, j] = total
            out[j, i] = total
    return out


@compiled
def along(A: Array, y: Array) -> Array:
    """A y for rows A (k, n) and y (n,)."""
    out = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for m in range(y.size):
            total += A[i, m] * y[m]
        out[i] = total
    return out


@compiled
def less(y: Array, w: Array, A: Array) -> None:
    """y - w A, in place, for y (n,), weights w (k,) and rows A (k, n)."""
    for i in range(A.shape[0]):
        for m in range(y.size):
            y[m] -= w[i] * A[i, m]


def square(y: Array) -> float:
    """Sum of squares of an array of any shape."""
    flat = y.reshape(1, -1)
    return float(along(flat, flat[0])[0])


def orthonormal(A: Array) -> Array:
    """Orthonormal rows that span the rows of A (k, n); rows that depend on others are left out."""
    H = self_gram(A)
    length = np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = np.linalg.eigh(H / np.outer(length, length))
    good = values > _DEPENDENT * values[-1]
    weights = vectors[:, good].T / np.sqrt(values[good])[:, None] / length
    out = np.zeros((int(good.sum()), A.shape[1]))
    for row, w in zip(out, weights, strict=True):
        less(row, -w, A)
    return out
