"""The file behind a log: opened as often as needed, and noticed if it is no longer the one that was opened first."""

import hashlib
import os
import stat
import weakref
from typing import BinaryIO, NamedTuple

from observer_fi.errors import InvalidLogError


class _Identity(NamedTuple):
    """What changes when a file is written to, or another takes its name."""

    device: int
    inode: int
    size: int
    changed_ns: int


def _identity(found: os.stat_result) -> _Identity:
    return _Identity(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


class Source:
    """A regular file that has to stay as it is until it was read to its end."""

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            found = os.stat(path)
            if not stat.S_ISREG(found.st_mode):
                raise InvalidLogError(f"{path}: cannot read the log ({_kind(found.st_mode)}); give a file")
            self._first = _identity(found)
            self._opened: weakref.ref[BinaryIO] | None = None  # not to keep it open
            with open(path, "rb") as stream:
                self.magic = stream.read(4)
        except InvalidLogError:
            raise
        except (OSError, ValueError) as error:  # ValueError: a name that no file can have
            what = (getattr(error, "strerror", None) or str(error)).lower()
            raise InvalidLogError(
                f"{path}: cannot read the log ({what}); check the path and its permissions"
            ) from error

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return self._first.size

    @property
    def share_read(self) -> float:
        """How much of the file was read by whoever opened it last, from 0 to 1."""
        if self._opened is None or not self.size:
            return 0.0
        stream = self._opened()
        return 1.0 if stream is None or stream.closed else stream.tell() / self.size

    def open(self) -> BinaryIO:
        """The bytes from the first on; the caller closes it. Raises InvalidLogError if they are no longer the same file."""
        try:
            stream = open(self.path, "rb")  # noqa: SIM115
        except OSError as error:
            raise self._replaced() from error
        if _identity(os.fstat(stream.fileno())) != self._first:
            stream.close()
            raise self._replaced()
        self._opened = weakref.ref(stream)
        return stream

    def check(self) -> None:
        """Raises InvalidLogError if the file was written to, replaced or removed since it was opened first."""
        try:
            same = _identity(os.stat(self.path)) == self._first
        except OSError:
            same = False
        if not same:
            raise self._replaced()

    def sha256(self) -> str:
        """SHA-256 of the file. Raises InvalidLogError if it changed since it was opened first."""
        with self.open() as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
        self.check()
        return found

    def _replaced(self) -> InvalidLogError:
        return InvalidLogError(
            f"{self.path}: the file changed while it was read; wait until the logger has finished, and read it again"
        )


def _kind(mode: int) -> str:
    kinds = {stat.S_IFDIR: "is a directory", stat.S_IFIFO: "is a named pipe", stat.S_IFSOCK: "is a socket"}
    return kinds.get(stat.S_IFMT(mode), "is a device")
