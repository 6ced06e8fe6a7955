"""The documents name only what exists: files, modules, functions, columns, keys."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = sorted((ROOT / "docs").glob("*.md"))  # decisions tell what was, these what is
HOLDS_NAMES = ("observer_fi", "tests", "pipelines", "benchmarks", "data")
ELSEWHERE = {
    "IMMEstimator",  # filterpy
    "Script_IDIM_LS.m",  # the authors' own, of the EMPS benchmark
    "insertelement",  # LLVM
    "make",
    "shufflevector",  # LLVM
}


@cache
def files() -> frozenset[str]:
    found = [
        path for top in HOLDS_NAMES for path in (ROOT / top).rglob("*") if "__pycache__" not in path.parts
    ]
    return frozenset(path.relative_to(ROOT).as_posix() for path in found) | {
        path.name for path in (*found, *ROOT.iterdir())
    }


@cache
def words() -> frozenset[str]:
    texts = [
        path
        for top in HOLDS_NAMES
        for kind in ("py", "toml", "html", "json")
        for path in (ROOT / top).rglob(f"*.{kind}")
    ]
    texts += [ROOT / "pyproject.toml", ROOT / "Makefile"]
    own = Path(__file__).resolve()
    return frozenset(
        w for path in texts if path != own for w in re.findall(r"\w+", path.read_text(encoding="utf-8"))
    )


def is_there(quoted: str) -> bool:
    """Whether a path exists, or every part of a dotted name occurs in the sources."""
    if "/" in quoted or re.search(r"\.(py|md|toml|txt|json|html|parquet|csv|gz)$", quoted):
        places = (ROOT / quoted, ROOT / "observer_fi" / quoted)
        written = quoted.split("/")[-1] in words_of_outputs()
        return quoted in files() or written or any(place.exists() for place in places)
    module, _, name = quoted.removesuffix("()").partition(".")
    of_module = [path for path in (ROOT / "observer_fi").rglob(f"{module}.py") if name.isidentifier()]
    if of_module:
        return any(
            re.search(rf"^(def |class )?{name}\b", path.read_text(), re.MULTILINE) for path in of_module
        )
    return all(part in words() or f"{part}.py" in files() for part in quoted.removesuffix("()").split("."))


@cache
def words_of_outputs() -> frozenset[str]:
    """Files that commands write: their names stand in the sources as text."""
    sources = (path.read_text(encoding="utf-8") for path in (ROOT / "observer_fi").rglob("*.py"))
    return frozenset(
        name for text in sources for name in re.findall(r"[\w.]+\.(?:json|html|parquet|toml|csv)", text)
    )


def quoted_names(path: Path) -> list[str]:
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    quoted = set(re.findall(r"`([^`\n]+)`", text))
    is_name = re.compile(r"^[A-Za-z_][\w/]*(\.\w+)*/?(\(\))?$")
    return sorted(name for name in quoted if is_name.match(name) and name not in ELSEWHERE)


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_what_a_document_names_exists(path: Path) -> None:
    missing = [name for name in quoted_names(path) if not is_there(name)]
    assert not missing, f"{path.name} names what is not there: {', '.join(missing)}"


def test_a_name_that_is_gone_is_found_missing() -> None:
    assert is_there("observer_fi/numerics/rows.py") and is_there("rows.py") and is_there("sqrt")
    assert is_there("rows.sqrt") and not is_there("rows.diagnose")
    assert not is_there("gone" + "_with_the_wind.py") and not is_there("no_such" + "_function")


@pytest.mark.parametrize("path", DOCS, ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    links = re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8"))
    assert all((path.parent / link).exists() for link in links), links


def test_the_index_has_one_row_for_every_room() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    rooms = {path.parent.name for path in (ROOT / "observer_fi").glob("*/__init__.py")}
    rows = re.findall(r"^\| `(\w+)/` \|", index, flags=re.MULTILINE)
    assert len(rows) == len(set(rows)) and set(rows) == rooms
