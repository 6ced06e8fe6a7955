"""Errors that are a user's to mend: their message is the one line that a command prints."""

import re

MOST_SHOWN = 2000  # characters of one line: names and paths of a log may be of any length
# What a terminal obeys instead of showing it: control characters, marks that turn the direction of writing round, lines
# that end where no line ends, and halves of characters, which cannot be written at all (names of files that are no UTF-8).
_UNPRINTABLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ufeff\ud800-\udfff]"
)


def one_line(text: object, most: int = MOST_SHOWN) -> str:
    """The text on one line of at most `most` characters, with what would command a terminal written as an escape."""
    found = _UNPRINTABLE.sub(_escaped, str(text))
    return found if len(found) <= most else found[: most - 4] + " ..."


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode("ascii")


class _OneLineError(ValueError):
    """An error whose message is one line, whatever stands in the names of files, headers and metadata."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(message))


class InvalidLogError(_OneLineError):
    """A log that cannot be used. The message is the one line a user sees: file, row, column, what is wrong, what to do."""


class UsageError(_OneLineError):
    """A command, rig or map that cannot be used. The message is the one line a user sees."""
