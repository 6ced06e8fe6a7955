"""Products of long rows against numpy."""

import numpy as np
import pytest

from observer_fi.numerics.products import gram, matvec, orthonormal, self_gram, subtract_rows, sum_of_squares

A = np.random.default_rng(3).normal(size=(4, 301))
B = np.random.default_rng(4).normal(size=(2, 301))


def test_products_are_numpys():
    assert gram(A, B) == pytest.approx(A @ B.T)
    assert self_gram(A) == pytest.approx(A @ A.T)
    assert matvec(A, B[0]) == pytest.approx(A @ B[0])
    y = B[1].copy()
    subtract_rows(y, np.array([1.0, 2.0]), B)
    assert y == pytest.approx(-B[0] - B[1])
    assert sum_of_squares(A) == pytest.approx(np.sum(A**2))


def test_orthonormal_rows_span_what_is_independent():
    rows = np.vstack([A, A[0] + 1e-3 * A[1], np.zeros(301)])
    Q = orthonormal(rows * np.array([[1.0], [1e-8], [1e5], [1.0], [1.0], [1.0]]))
    left = A - (A @ Q.T) @ Q
    assert len(Q) == 4
    assert self_gram(Q) == pytest.approx(np.eye(4), abs=1e-6)
    assert left == pytest.approx(0.0, abs=1e-5)
