"""A few numbers side by side: one register where a kernel is compiled, a slice of an array where it is not.

LLVM finds no vectors in loops over so few numbers in arrays that might overlap; here they are said. In plain Python a row
is a numpy array, which has the same operators. Functions of numbers take rows as well, so that an equation written with
them, and with `where_above` for its choices, runs on one log or on several side by side.
"""

import math
from typing import Any

import numpy as np

MOST = 8
Wide = tuple[int, ...]  # as many zeros as a row has numbers: the compiler knows the length of a tuple


def aligned_empty(count: int) -> Any:
    """Memory for so many numbers, the first where a row may stand: rows that cross a cache line take twice as long."""
    memory = np.empty(count + MOST)
    first = (-memory.ctypes.data // 8) % MOST
    return memory[first : first + count]


def aligned_copy(a: Any) -> Any:
    """A copy of an array in such memory."""
    out = aligned_empty(a.size).reshape(a.shape)
    out[...] = a
    return out


def load(a: Any, at: int, wide: Wide) -> Any:
    """The numbers of an array from `at` on, counted through its rows."""
    return a.reshape(-1)[at : at + len(wide)].copy()


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


def sqrt(u: Any) -> Any:
    """Square root of each number, NaN below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(u)


def where_above(u: Any, v: Any, yes: Any, no: Any) -> Any:
    """yes where u is above v, else no (also where one of the two is no number)."""
    return np.where(u > v, yes, no)[()]


def maximum(u: Any, v: Any) -> Any:
    """The larger of two; the second where one is no number."""
    return where_above(u, v, u, v)


def copysign(size: Any, like: Any) -> Any:
    """`size` with the sign bit of `like`."""
    return np.copysign(size, like)


def any_of(u: Any) -> bool:
    """Whether a number, or any of a row, is not zero. What follows must leave the zeros of a row as they are."""
    return bool(np.any(u))


def any_of_rare(u: Any) -> bool:
    """As `any_of`, for what most samples do without: the compiler keeps what it needs out of the way."""
    return any_of(u)


def zeros_like(like: Any) -> Any:
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


class _Rows:
    """What `side_by_side` gives to plain Python: a row that is taken out is a copy, as it is in a register."""

    def __init__(self, a: Any) -> None:
        self.a = a

    def __getitem__(self, at: Any) -> Any:
        part = self.a[at]
        return _Rows(part) if part.ndim > 1 else part.copy()

    def __setitem__(self, at: Any, row: Any) -> None:
        self.a[at] = row


def side_by_side(a: Any, wide: Wide) -> Any:
    """An array whose last side is one row long, indexed by the others: each place holds a row."""
    return _Rows(a)


LEAST_EXPONENT = -708.0
