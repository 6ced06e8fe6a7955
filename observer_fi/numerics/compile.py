"""One place that decides how kernels are compiled, and where they are kept.

numba checks only the file of the cached function itself, so a change of an equation would leave stale kernels
behind. The cache therefore lives in a folder named after the content of every source file that kernels are made of.
"""

import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from observer_fi.numerics import rows_llvm as registers  # noqa: F401  (kernels may hold rows)
from observer_fi.numerics.inlining import InlinedFunction
from observer_fi.numerics.kept_kernels import KernelCache

# Rooms all of whose modules count: kernels take equations, places and constants from any of them. In other rooms a module
# counts that compiles anything, which is one that imports from here.
_ROOMS_OF_KERNELS = ("numerics", "physics", "bank")
_COMPILES = b"observer_fi.numerics"
_NEWEST, _FORGOTTEN_S = (
    4,
    7 * 86400.0,
)  # folders of other versions that stay, and how long the others stay at least
# No "nnan" and no "ninf": masks rely on NaN, unlimited clamps on infinity. No "reassoc" and no "arcp": LLVM keeps two forms
# of a loop and chooses by where its arrays happen to lie, so that two runs over one log would differ in the last digit.
_FASTMATH = {"nsz", "contract"}
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy", "fastmath": _FASTMATH, "nogil": True, "no_cfunc_wrapper": True,
}  # fmt: skip
# Counting references to arrays that nobody frees takes most of a small loop's time; numba keeps the switch private.
_UNCOUNTED: dict[str, Any] = {**_OPTIONS, "_nrt": False}


def compiled_sources(package: Path | None = None) -> dict[str, bytes]:
    """Content of every module of the package that kernels are made of, by its path in the package.

    Raises FileNotFoundError where the sources are not there: without them nobody can know whether a kernel is stale.
    """
    package = package or Path(__file__).parent.parent
    sources = {path.relative_to(package): path.read_bytes() for path in sorted(package.rglob("*.py"))}
    found = {
        path.as_posix(): source
        for path, source in sources.items()
        if path.parts[0] in _ROOMS_OF_KERNELS or _COMPILES in source
    }
    if "numerics/compile.py" not in found:
        raise FileNotFoundError(
            f"{package}: the sources of the kernels are not there; install the package unzipped"
        )
    return found


def cache_name(sources: dict[str, bytes]) -> str:
    """Name of the folder of kernels made of these sources by this numba."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path, source in sources.items():
        digest.update(f"\n{path} {len(source)}\n".encode())
        digest.update(source)
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Folder of the kernels of all versions."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "observer-fi"


def clear_old(root: Path, own: str) -> None:
    """Remove the kernels of other versions, but for the newest and those in use lately."""
    if (root / own).exists() or not root.is_dir():
        return
    made = {folder: folder.stat().st_mtime for folder in root.iterdir() if folder.is_dir()}
    for folder in sorted(made, key=made.__getitem__, reverse=True)[_NEWEST:]:
        if time.time() - made[folder] > _FORGOTTEN_S:
            shutil.rmtree(folder, ignore_errors=True)


if not os.environ.get("NUMBA_CACHE_DIR"):
    _own = cache_name(compiled_sources())
    clear_old(cache_root(), _own)
    numba.config.CACHE_DIR = str(cache_root() / _own)  # type: ignore[attr-defined]


class _FirstCompilation(event.Listener):
    """Tells once that something is being compiled."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self.tell: Callable[[], None] | None = tell

    def on_start(self, event: Any) -> None:
        if self.tell is not None:
            tell, self.tell = self.tell, None
            tell()

    def on_end(self, event: Any) -> None:
        """Nothing to tell."""


def when_compiling(tell: Callable[[], None]) -> None:
    """Call `tell` once, as soon as it is known that kernels have to be compiled: now, where none were ever kept."""
    listener = _FirstCompilation(tell)
    event.register("numba:compile", listener)
    if next(Path(numba.config.CACHE_DIR).rglob("*.nbi"), None) is None:  # type: ignore[attr-defined]
        listener.on_start(None)


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` compiled by numba, or as it is where NUMBA_DISABLE_JIT is set."""
    return _kept(function, _OPTIONS)


def _kept(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    kernel = numba.njit(**options)(function)
    kernel._cache = KernelCache(function, counted=options.get("_nrt", True))
    return kernel


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function for kernels, whose body LLVM puts in place of each call: passing a parameter array costs more than an equation.

    It is compiled within each kernel only (see `inlining.py`), and by itself where Python calls it.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return InlinedFunction(function, uncounted, {**_UNCOUNTED, "nopython": True, "forceinline": True})


def in_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """The Python function behind a compiled one: for a few numbers it has the answer before machine code is loaded."""
    return getattr(function, "py_func", function)


def uncounted(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, without reference counts: for loops that allocate nothing and get all their work arrays."""
    return _kept(function, _UNCOUNTED)
