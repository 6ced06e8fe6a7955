"""A few numbers side by side: one register where a kernel is compiled, a slice of an array where it is not.

LLVM finds no vectors in loops over so few numbers in arrays that might overlap; here they are said. In plain Python a row
is a numpy array, which has the same operators. Functions of numbers take rows as well, so that an equation written with
them, and with `above` for its choices, runs on one log or on several side by side.
"""

import math
from typing import Any

import numpy as np

MOST = 8
Wide = tuple[int, ...]  # as many zeros as a row has numbers: the compiler knows the length of a tuple


def wide_enough(n: int) -> Wide:
    """Rows for n numbers: none, one, or eight, so that few kernels are compiled."""
    if n > MOST:
        raise ValueError(f"a row holds at most {MOST} numbers, got {n}")
    return (0,) * (n if n < 2 else MOST)


def load(a: Any, at: int, wide: Wide) -> Any:
    """The numbers of an array from `at` on, counted through its rows."""
    return a.reshape(-1)[at : at + len(wide)].copy()


def store(a: Any, at: int, row: Any) -> None:
    """A row into an array from `at` on, counted through its rows."""
    a.reshape(-1)[at : at + row.size] = row


def get(a: Any, at: int) -> float:
    """The number of an array at `at`, counted through its rows."""
    return float(a.reshape(-1)[at])


def put(a: Any, at: int, number: float) -> None:
    """A number into an array at `at`, counted through its rows."""
    a.reshape(-1)[at] = number


def dot(u: Any, v: Any) -> float:
    """Sum of the products."""
    return float(np.dot(u, v))


def zeros(wide: Wide) -> Any:
    """A row of zeros."""
    return np.zeros(len(wide))


def exp(row: Any) -> Any:
    """exp of each number of at most 0, to 2e-16; what is below -708 counts as -708."""
    return np.exp(np.maximum(row, LEAST_EXPONENT))


def log(row: Any) -> Any:
    """Natural logarithm of each number, to 2e-16; NaN where there is none. Numbers below 2.3e-308 are not for it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((row > 0.0) & (row < math.inf), np.log(row), math.nan)


def above(u: Any, v: Any, yes: Any, no: Any) -> Any:
    """yes where u is above v, else no (also where one of the two is no number)."""
    return np.where(u > v, yes, no)[()]


def larger(u: Any, v: Any) -> Any:
    """The larger of two; the second where one is no number."""
    return above(u, v, u, v)


def signed(size: Any, like: Any) -> Any:
    """`size` with the sign bit of `like`."""
    return np.copysign(size, like)


def some(u: Any) -> bool:
    """Whether a number, or any of a row, is not zero. What follows must leave the zeros of a row as they are."""
    return bool(np.any(u))


def seldom(u: Any) -> bool:
    """As `some`, for what most samples do without: the compiler keeps what it needs out of the way."""
    return some(u)


def nothing(like: Any) -> Any:
    """Zero: a number, or a row."""
    return np.zeros_like(like)[()]


def tanh(u: Any) -> Any:
    """tanh of each number [rad]."""
    return np.tanh(u)


def sin(u: Any) -> Any:
    """sin of each number [rad]."""
    return np.sin(u)


def cos(u: Any) -> Any:
    """cos of each number [rad]."""
    return np.cos(u)


def floor(u: Any) -> Any:
    """The whole number below each number."""
    return np.floor(u)


def side_by_side(a: Any, wide: Wide) -> Any:
    """An array whose last side is one row long, indexed by the others: each place holds a row."""
    return a


LEAST_EXPONENT = -708.0
