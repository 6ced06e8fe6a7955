"""One place that decides how kernels are compiled.

numba checks only the file of the cached function itself, so a change of an equation would leave stale kernels
behind. The cache therefore lives in a folder named after the content of every source file that is compiled.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from observer_fi.numerics import rows_llvm as registers  # noqa: F401  (kernels may hold rows)
from observer_fi.numerics.inlining import InlinedFunction

# What a module that compiles anything imports.
_COMPILES = b"observer_fi.numerics"
# No "nnan" and no "ninf": masks rely on NaN, unlimited clamps on infinity. No "reassoc" and no "arcp": LLVM keeps two forms
# of a loop and chooses by where its arrays happen to lie, so that two runs over one log would differ in the last digit.
_FASTMATH = {"nsz", "contract"}
_OPTIONS: dict[str, Any] = {
    "cache": True, "error_model": "numpy", "fastmath": _FASTMATH, "nogil": True, "no_cfunc_wrapper": True,
}  # fmt: skip
# Counting references to arrays that nobody frees takes most of a small loop's time; numba keeps the switch private.
_UNCOUNTED: dict[str, Any] = {**_OPTIONS, "_nrt": False}


def compiled_sources() -> list[bytes]:
    """Content of every module of the package that holds a compiled function, in the order of their paths."""
    package = Path(__file__).parent.parent
    return [source for path in sorted(package.rglob("*.py")) if _COMPILES in (source := path.read_bytes())]


def _cache_folder() -> Path:
    digest = hashlib.sha256(numba.__version__.encode())
    for source in compiled_sources():
        digest.update(source)
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return root / "observer-fi" / digest.hexdigest()[:16]


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba, or as it is where NUMBA_DISABLE_JIT is set."""
    return numba.njit(**_OPTIONS)(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, and LLVM puts the body in place of each call: passing a parameter array costs more than an equation."""
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    options = {key: value for key, value in _UNCOUNTED.items() if key != "cache"}
    alone = numba.njit(**_UNCOUNTED)(function)
    return InlinedFunction(function, alone, {**options, "nopython": True, "forceinline": True})


def uncounted(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, without reference counts: for loops that allocate nothing and get all their work arrays."""
    return numba.njit(**_UNCOUNTED)(function)
