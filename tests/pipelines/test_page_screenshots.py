"""The pictures of pages: taken where there is a browser, the same again, and those of docs/ of a size that a page carries."""

import shutil
from pathlib import Path

import pytest
from PIL import Image

from pipelines import page_screenshots

FIGURES = Path(__file__).parents[2] / "docs" / "figures"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no chromium to open the pages in")
def test_a_page_has_the_same_picture_again(tmp_path: Path) -> None:
    pytest.importorskip(
        "playwright.sync_api", reason="pictures are taken by a browser that playwright drives"
    )
    for name in ("a", "b"):
        assert page_screenshots.main(["--only", "overload", "--out", str(tmp_path / name)]) == 0
    first, again = ((tmp_path / name / "page_overload.png").read_bytes() for name in ("a", "b"))
    assert first == again


@pytest.mark.parametrize("name", page_screenshots.PAGES)
def test_the_pictures_of_the_docs_are_there(name: str) -> None:
    path = FIGURES / f"page_{name}.png"
    with Image.open(path) as picture:
        assert picture.size == (page_screenshots.WIDTH, page_screenshots.PAGES[name][0])
    assert path.stat().st_size < 200_000 and path.name in (FIGURES.parent / "reading.md").read_text(
        encoding="utf-8"
    )
