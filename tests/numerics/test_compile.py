"""Where kernels are kept: a folder of their own for each state of the sources, none that nobody asks for."""

import os
import time
import tomllib
from importlib.metadata import version
from pathlib import Path

import numba
import pytest
from packaging.requirements import Requirement

from observer_fi.numerics import compile as compiling
from observer_fi.numerics import compiled_sources, when_compiling

PACKAGE = Path(compiling.__file__).parents[1]
KERNELS = [
    "physics/equations.py",
    "bank/transition.py",
    "numerics/inlining.py",
    "numerics/rows_llvm.py",
    "verdict/open_loop.py",
]


def test_numba_is_one_that_was_tried() -> None:
    needs = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "dependencies"
    ]
    bound = next(Requirement(line) for line in needs if Requirement(line).name == "numba")
    assert any(spec.operator == "<" for spec in bound.specifier), (
        "numba needs an upper bound, see docs/rows.md"
    )
    assert bound.specifier.contains(version("numba")), (
        f"numba {version('numba')} was never tried: observer_fi writes LLVM through its internals (docs/rows.md). "
        f"Run the tests of tests/numerics and tests/bank with it, then move the bound {bound.specifier}."
    )


@pytest.mark.parametrize("path", KERNELS)
def test_a_change_of_any_source_of_a_kernel_changes_the_folder(path: str) -> None:
    sources = compiled_sources()
    changed = {**sources, path: sources[path] + b"# a change"}
    assert compiling.cache_name(changed) != compiling.cache_name(sources)


def test_the_folder_knows_which_file_holds_what() -> None:
    assert compiling.cache_name({"a.py": b"x", "b.py": b""}) != compiling.cache_name(
        {"a.py": b"", "b.py": b"x"}
    )


def test_every_module_that_compiles_anything_counts() -> None:
    compiling_modules = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if any(
            line.startswith(("@compiled", "@inlined", "@uncounted")) for line in path.read_text().splitlines()
        )
    }
    assert len(compiling_modules) > 10
    assert compiling_modules <= set(compiled_sources())


def test_missing_sources_are_an_error_not_an_empty_hash(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="sources of the kernels"):
        compiled_sources(tmp_path)


def test_old_folders_go_the_newest_and_those_in_use_stay(tmp_path: Path) -> None:
    now = time.time()
    for k in range(8):
        (tmp_path / f"v{k}").mkdir()
        os.utime(tmp_path / f"v{k}", (now - 86400 * 3 * k,) * 2)
    compiling.clear_old(tmp_path, "v0")  # it exists: nothing was made anew
    assert len(list(tmp_path.iterdir())) == 8
    compiling.clear_old(tmp_path, "new")
    assert sorted(folder.name for folder in tmp_path.iterdir()) == ["v0", "v1", "v2", "v3"]
    for k in range(8):
        (tmp_path / f"w{k}").mkdir()
    compiling.clear_old(tmp_path, "new")
    assert {f"w{k}" for k in range(8)} <= {folder.name for folder in tmp_path.iterdir()}


def test_the_first_compilation_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    (tmp_path / "kernel.1.nbi").write_bytes(b"")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    when_compiling(lambda: told.append(1))
    assert not told
    double = numba.njit(lambda x: 2 * x)
    assert double(1) == 2
    assert double(1.0) == 2.0
    assert told == [1]


def test_an_empty_cache_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    when_compiling(lambda: told.append(1))
    assert told == [1]
