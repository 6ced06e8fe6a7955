"""docs/limits.md says what the code does."""

from limits_page import PAGE, page, rows_of_logs


def test_the_page_is_what_the_code_gives() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python tests/limits_page.py"


def test_every_limit_says_what_happens_beyond_it() -> None:
    assert all(len(row) == 3 and all(row) for row in rows_of_logs())
