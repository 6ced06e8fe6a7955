"""The file behind a log: opened as often as needed, and noticed if it is no longer the one that was opened first."""

import bz2
import codecs
import gzip
import hashlib
import io
import lzma
import os
import stat
import weakref
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import IO, Any, BinaryIO, NamedTuple

from observer_fi.errors import InvalidLogError
from observer_fi.logs.formats.converted import JSONS, SPREADSHEETS, json_text, sheet_text

PIECE_BYTES = 1 << 20
_ONE_BYTE = (
    "utf-8",
    "ascii",
    "cp125",
    "iso8859",
    "latin",
    "koi8",
)  # ASCII as it stands, and nothing else looks like it

# First bytes of what packs text: its name, and how it is opened.
PACKERS: dict[bytes, tuple[str, Callable[[BinaryIO], Any]]] = {
    b"\x1f\x8b": ("gzip", lambda raw: gzip.GzipFile(fileobj=raw)),
    b"\xfd7zX": ("xz", lzma.LZMAFile),
    b"BZh": ("bzip2", bz2.BZ2File),
    b"PK\x03\x04": ("zip", lambda raw: _only_member(raw)),
}
_BROKEN = (OSError, EOFError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, NotImplementedError)


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

    @cached_property
    def packer(self) -> str:
        """What the file is packed with, "" where with nothing."""
        return next((name for start, (name, _) in PACKERS.items() if self.magic.startswith(start)), "")

    @cached_property
    def converter(self) -> tuple[str, Callable[[IO[bytes]], bytes]] | None:
        """For a file that is no text yet: what it is, and what makes text of it."""
        if self.path.lower().endswith(SPREADSHEETS) or (self.packer == "zip" and _is_spreadsheet(self)):
            return "spreadsheet", sheet_text
        if self.magic.startswith(b"{") or any(end in self.path.lower()[-12:] for end in JSONS):
            return "JSON", json_text
        return None

    @cached_property
    def text(self) -> bytes:
        """The table of a spreadsheet or of JSON as text between tabs. Raises InvalidLogError."""
        assert self.converter is not None
        with self.open() as raw:
            try:
                return self.converter[1](raw if self.converter[0] == "spreadsheet" else _unpacked(self, raw))
            except InvalidLogError as error:
                raise InvalidLogError(f"{self.path}: {error}") from error

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


def _is_spreadsheet(source: Source) -> bool:
    """Whether a zip archive is one of Office or OpenDocument; what is no whole archive is none."""
    with source.open() as raw:
        try:
            return {"[Content_Types].xml", "mimetype"} & set(zipfile.ZipFile(raw).namelist()) != set()
        except _BROKEN:
            return False


def _only_member(raw: BinaryIO) -> IO[bytes]:
    """The one file of a zip archive, besides what a Mac adds. Raises InvalidLogError where it is not one, or locked."""
    archive = zipfile.ZipFile(raw)
    names = [info for info in archive.infolist() if not info.is_dir() and "__MACOSX" not in info.filename]
    if len(names) != 1:
        raise InvalidLogError(f"this is an archive of {len(names)} files; unpack it and give the log")
    if names[0].flag_bits & 1:
        raise InvalidLogError("the archive is locked by a password; unpack it and give the log")
    return archive.open(names[0])


def _unpacked(source: Source, raw: BinaryIO) -> IO[bytes]:
    """The bytes of a file without what packs them."""
    for name, opened in PACKERS.values():
        if name == source.packer:
            try:
                return opened(raw)
            except InvalidLogError as error:
                raise InvalidLogError(f"{source.path}: {error}") from error
    return raw


def _wide(magic: bytes) -> str | None:
    """The encoding of text of two bytes a character, by its mark or by the zeros in its first characters; None of other text."""
    if magic[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    zeros = "".join("1" if byte == 0 else "0" for byte in magic)
    return {"0101": "utf-16-le", "1010": "utf-16-be"}.get(zeros)


def is_like_ascii(encoding: str | None) -> bool:
    """Whether a byte of ASCII stands for itself in this encoding, and for nothing else."""
    return encoding is None or codecs.lookup(encoding).name.startswith(_ONE_BYTE)


def utf8_pieces(source: Source, encoding: str | None) -> Iterator[bytes]:
    """The decompressed text in pieces of about a megabyte; an encoding that does not look like ASCII becomes UTF-8.

    Raises InvalidLogError where it cannot be decompressed.
    """
    encoding = None if source.converter else encoding or _wide(source.magic)
    decoder = None if is_like_ascii(encoding) else codecs.getincrementaldecoder(encoding or "")("replace")
    with source.open() as raw:
        try:
            stream = io.BytesIO(source.text) if source.converter else _unpacked(source, raw)
            while piece := stream.read(PIECE_BYTES):
                yield piece if decoder is None else decoder.decode(piece).encode("utf-8", "replace")
            yield b"" if decoder is None else decoder.decode(b"", True).encode("utf-8", "replace")
        except UnicodeError as error:
            raise InvalidLogError(
                f"{source.path}: cannot be decoded as {encoding} ({str(error)[:100]}); name the right encoding in a "
                "column map"
            ) from error
        except _BROKEN as error:
            raise InvalidLogError(
                f"{source.path}: breaks off ({str(error)[:100]}); copy or export it again"
            ) from error
