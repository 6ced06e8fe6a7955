"""Calls into the readers of others: nothing they warn of reaches the terminal, and nothing they raise leaks."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from observer_fi.errors import InvalidLogError, one_line

MOST_NOTES = 5


class _Listener(logging.Handler):
    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self.heard = heard

    def emit(self, record: logging.LogRecord) -> None:
        self.heard.append(record.getMessage())


@contextmanager
def third_party(path: str, refusal: str, notes: list[str], logger: str = "") -> Iterator[None]:
    """Around one call of a reader. refusal: the line without the file, with {} for the reason.

    Its warnings and what it logs under `logger` go to `notes`, the first few of each log. A damaged file can make such a
    reader raise anything (it indexes, unpacks and divides what it finds), hence the broad except.
    """
    heard: list[str] = []
    listener = _Listener(heard)
    log = logging.getLogger(logger) if logger else None
    if log is not None:
        log.addHandler(listener)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
    except InvalidLogError:
        raise
    except Exception as error:
        reason = one_line(str(error).strip().split("\n")[0].rstrip(".") or type(error).__name__, 150)
        raise InvalidLogError(f"{path}: " + refusal.format(reason)) from error
    finally:
        if log is not None:
            log.removeHandler(listener)
    heard += [str(warning.message) for warning in caught]
    for text in dict.fromkeys(heard):
        note = f"the reader says: {one_line(text, 200)}"
        if note not in notes and len(notes) < MOST_NOTES:
            notes.append(note)
