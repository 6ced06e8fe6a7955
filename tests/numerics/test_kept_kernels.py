"""A kept kernel gives the same numbers as the one that was just compiled, and loads little."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import pytest

Called = Callable[
    [str, str], list[str]
]  # a kernel and a call: the value, whether the compiler was imported, kept kernels used
pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")

KERNELS = """
import numpy as np
from observer_fi.numerics import compiled, uncounted

@uncounted
def inner(a):
    total = 0.0
    for k in range(a.size):
        total += a[k] / (k + 3.0)
    return total

@uncounted
def outer(a):
    return inner(a) - a[0]

@compiled
def allocating(a):
    out = np.empty(a.size)
    for k in range(a.size):
        out[k] = a[k] / 3.0
    return out
"""
CALL = """
import sys, numpy as np, kernels
a = np.arange(40.0) / 7.0
print({call}, "numba.cpython.unicode" in sys.modules, sum(kernels.{name}.stats.cache_hits.values()))
"""


@pytest.fixture
def called(tmp_path: Path) -> Called:
    (tmp_path / "kernels.py").write_text(KERNELS)
    paths = [str(tmp_path), *(path for path in sys.path if path)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "XDG_CACHE_HOME": str(tmp_path)}

    def words(name: str, call: str) -> list[str]:
        code = CALL.format(name=name, call=call)
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout.split()

    return words


@pytest.mark.slow
def test_a_kept_kernel_gives_the_same_and_imports_no_compiler(called: Called) -> None:
    first, again = (called("inner", "repr(float(kernels.inner(a)))") for _ in range(2))
    assert first[1:] == ["True", "0"]
    assert again == [first[0], "False", "1"]


@pytest.mark.slow
def test_a_kernel_is_made_with_a_kept_one_in_it(called: Called) -> None:
    (alone, _, _), (both, _, kept) = called("inner", "kernels.inner(a)"), called("inner", "kernels.outer(a)")
    assert (float(both), kept) == (float(alone), "1")


@pytest.mark.slow
def test_one_that_allocates_has_numbas_runtime(called: Called) -> None:
    first, again = (called("allocating", "kernels.allocating(a).sum()") for _ in range(2))
    assert (again[0], first[-1], again[-1]) == (first[0], "0", "1")
