"""The pages of the site: written from the code, tables that a forge shows, studies that are listed, nothing fetched."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from vocabulary_pages import OF_EQUATION, PAGES

from observer_fi.physics import CAUSES, FAULTS

ROOT = Path(__file__).parents[1]
MARKDOWN = sorted(
    path
    for pattern in ("*.md", "data/*.md", "docs/**/*.md", "reports/*.md", "reports/emps/*.md")
    for path in ROOT.glob(pattern)
)
STUDIES = [*ROOT.glob("reports/*.md"), *ROOT.glob("reports/*.json")] + [
    path
    for name in ("compare_mixture", "emps", "reproduce_paper")
    for path in (ROOT / "reports" / name).iterdir()
]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_of_the_vocabulary_is_what_the_code_gives(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path](), "run python tests/vocabulary_pages.py"


def test_every_cause_and_every_fault_has_its_place() -> None:
    causes, faults = (path.read_text(encoding="utf-8") for path in PAGES)
    assert all(cause.equation in OF_EQUATION and f"| `{name}` |" in causes for name, cause in CAUSES.items())
    assert all(
        f"## {row.title}\n" in faults and row.says(row.action, "named") in faults for row in FAULTS.values()
    )


def cells(line: str) -> int:
    return len(re.findall(r"(?<!\\)\|", line.strip())) - 1


@pytest.mark.parametrize("path", MARKDOWN, ids=lambda path: str(path.relative_to(ROOT)))
def test_tables_are_such_as_a_forge_shows(path: Path) -> None:
    """A line of dashes below the head, an empty line above it, and as many cells in every row."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for block in re.findall(r"(?:^[^\n]*\n)?(?:^\|[^\n]*\n?)+", text, flags=re.MULTILINE):
        above, *rows = block.splitlines() if not block.startswith("|") else ["", *block.splitlines()]
        assert not above.strip() or above.startswith("#"), f"a table follows a line of text: {above}"
        assert re.fullmatch(r"\|([ :-]*-[ :-]*\|)+", rows[1].strip()), rows[:2]
        assert {cells(row) for row in rows} == {cells(rows[0])}, rows[0]


def test_every_study_is_listed_for_a_visitor() -> None:
    listed = (ROOT / "reports" / "README.md").read_text(encoding="utf-8")
    names = [
        path.relative_to(ROOT / "reports").as_posix() for path in STUDIES if not path.name.startswith(".")
    ]
    missing = [name for name in names if f"]({name})" not in listed and name != "README.md"]
    assert names and not missing


@pytest.mark.slow
def test_the_site_is_built_without_warnings_and_fetches_nothing(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(tmp_path)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) > 50 and (tmp_path / "docs" / "api.html").is_file()
    fetched = re.compile(
        r"<(?:script|img|iframe)[^>]*src=\"?https?:|<link[^>]*stylesheet[^>]*https?:|url\(https?:"
    )
    assert not [page.name for page in pages if fetched.search(page.read_text(encoding="utf-8"))]
    assert "Diagnosis" in (tmp_path / "docs" / "api.html").read_text(encoding="utf-8")
