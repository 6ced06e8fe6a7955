"""Errors that are a user's to mend, or a cluster's: their message is the one line that a command prints."""

MOST_SHOWN = 2000  # characters of one line: names and paths of a log may be of any length


def one_line(text: object, most: int = MOST_SHOWN) -> str:
    """The text on one line of at most `most` characters, with all that cannot be shown written as an escape.

    That is what a terminal obeys instead of showing it, marks that turn the direction of writing round, ends of lines of any
    kind, and halves of characters, which cannot be written at all (names of files that are no UTF-8).
    """
    found = str(text)[: 2 * most]
    if not found.isprintable():
        found = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in found)
    return found if len(found) <= most else found[: most - 4] + " ..."


class _OneLineError(ValueError):
    """An error whose message is one line, whatever stands in the names of files, headers and metadata."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(message))


class InvalidLogError(_OneLineError):
    """A log that cannot be used. The message is the one line a user sees: file, row, column, what is wrong, what to do."""


class UsageError(_OneLineError):
    """A command, rig or map that cannot be used. The message is the one line a user sees."""


class LostClusterError(Exception):
    """The scheduler, or the last worker, is gone: the message says which. What was done is kept."""
