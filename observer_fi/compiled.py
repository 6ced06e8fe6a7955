"""One place that decides how kernels are compiled.

numba checks only the file of the cached function itself, so a change of `actuator.py` would leave stale kernels
behind. The cache therefore lives in a folder named after the content of every source file that is compiled.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from observer_fi import registers  # noqa: F401  (kernels may hold rows)

_SOURCES = (
    "rows.py",
    "registers.py",
    "actuator.py",
    "transition.py",
    "scratch.py",
    "mixing.py",
    "motion_moments.py",
    "gating.py",
    "extended.py",
    "unscented.py",
    "feed.py",
    "kernels.py",
    "lanes.py",
    "smoothing.py",
    "simulate.py",
    "mixture.py",
    "fitting.py",
)
# No "nnan" and no "ninf": masks rely on NaN, unlimited clamps on infinity. No "reassoc" and no "arcp": LLVM keeps two forms
# of a loop and chooses by where its arrays happen to lie, so that two runs over one log would differ in the last digit.
_FASTMATH = {"nsz", "contract"}
_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": _FASTMATH, "nogil": True}
# Counting references to arrays that nobody frees takes most of a small loop's time; numba keeps the switch private.
_UNCOUNTED: dict[str, Any] = {**_OPTIONS, "_nrt": False}


def _cache_folder() -> Path:
    here = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    for name in _SOURCES:
        path = here / name
        if path.exists():
            digest.update(path.read_bytes())
    root = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return root / "observer-fi" / digest.hexdigest()[:16]


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba, or as it is where NUMBA_DISABLE_JIT is set."""
    return numba.njit(**_OPTIONS)(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, and LLVM puts the body in place of each call: passing a parameter array costs more than an equation."""
    return numba.njit(forceinline=True, **_UNCOUNTED)(function)


def uncounted(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, without reference counts: for loops that allocate nothing and get all their work arrays."""
    return numba.njit(**_UNCOUNTED)(function)
