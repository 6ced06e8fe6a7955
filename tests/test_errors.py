"""Messages are one line that no terminal obeys, whatever was put into them."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.errors import MOST_SHOWN, InvalidLogError, UsageError, one_line


@given(text=st.text(st.characters(codec=None), max_size=300))
def test_any_text_becomes_one_line_that_can_be_printed(text: str) -> None:
    shown = one_line(text)
    shown.encode("utf-8")  # no halves of characters
    assert shown.isprintable()
    assert shown == text or not text.isprintable()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\r\nb\u2028c", r"a\r\nb\u2028c"),
        ("\udce9.csv", r"\udce9.csv"),
        ("a\u202eb\x85", r"a\u202eb\x85"),
        ("Pr\u00fcfstand \u03a9", "Pr\u00fcfstand \u03a9"),
    ],
)
def test_what_a_terminal_would_obey_is_written_out(text: str, shown: str) -> None:
    assert one_line(text) == shown


@pytest.mark.parametrize("kind", [InvalidLogError, UsageError])
def test_errors_are_one_line_of_bounded_length_and_survive_pickling(kind: type[Exception]) -> None:
    error = kind("x\n" * 10_000)
    assert len(str(error)) <= MOST_SHOWN and str(error).isprintable()
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is kind and str(copy) == str(error)
