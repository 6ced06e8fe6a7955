"""An inlined function is part of the kernels that call it, and of nothing else until Python calls it."""

import math

import numba
import pytest

from observer_fi.numerics import compiled, inlined
from observer_fi.numerics.inlining import InlinedFunction


@inlined
def hypotenuse(a, b):
    return math.sqrt(a * a + b * b)


@inlined
def halved(a, b):
    return 0.5 * hypotenuse(a, b)


@compiled
def total(n):
    out = 0.0
    for k in range(n):
        out += halved(3.0 * k, 4.0 * k)
    return out


compiled_only = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def test_a_kernel_computes_what_plain_python_does() -> None:
    assert total(5) == pytest.approx(2.5 * sum(range(5)), rel=1e-15)


@compiled_only
def test_only_the_kernel_becomes_machine_code() -> None:
    assert isinstance(halved, InlinedFunction)
    total(2)
    total.recompile()  # a kernel that an earlier run has kept is loaded, and nothing of it lowered
    (lowered,) = halved.overloads.values()
    with pytest.raises(ValueError, match="object caching not enabled"):
        lowered.library._get_compiled_object()
    assert "halved" not in "".join(
        f.name for f in total.overloads[(numba.int64,)].library.get_defined_functions()
    )


def test_python_calls_it_alone() -> None:
    assert halved(3.0, 4.0) == 2.5


@inlined
def applied(rule, a, b):
    return rule(a, b)


@compiled_only
def test_what_is_made_for_another_function_is_not_kept_on_disk() -> None:
    """The next process that adds to such a file cannot write what it names: a first run on two workers failed now and then."""
    assert applied(hypotenuse, 3.0, 4.0) == 5.0 and applied(halved, 3.0, 4.0) == 2.5
    assert list(applied.alone) == [False] and applied.alone[False].stats.cache_path is None
    assert list(hypotenuse.alone) in ([], [True])
