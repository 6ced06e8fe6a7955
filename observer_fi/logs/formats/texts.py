"""The text of a file: without what packs it, as UTF-8, and a table with a row a sample where it is none yet."""

import bz2
import codecs
import gzip
import lzma
import weakref
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import IO, Any, BinaryIO

from observer_fi.errors import InvalidLogError
from observer_fi.logs.formats.converted.cells import at_most
from observer_fi.logs.formats.converted.json_documents import JSONS, json_text
from observer_fi.logs.formats.converted.long_tables import HEAD_BYTES, long_header, long_text
from observer_fi.logs.formats.converted.spreadsheets import SPREADSHEETS, sheet_text
from observer_fi.logs.formats.source import Source

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

Converted = tuple[str, bytes] | None  # what it is, and the text between tabs that is made of it
_CONVERTED: weakref.WeakKeyDictionary[Source, Converted] = weakref.WeakKeyDictionary()


def packer_of(magic: bytes) -> str:
    """What a file is packed with by its first four bytes, "" where with nothing."""
    return next((name for start, (name, _) in PACKERS.items() if magic.startswith(start)), "")


def converted(source: Source) -> Converted:
    """A table with a row a sample, of a file that is no text, or none with a row a sample. Raises InvalidLogError."""
    if source not in _CONVERTED:
        try:
            _CONVERTED[source] = _with_a_row_a_sample(source, _as_text(source))
        except InvalidLogError as error:
            raise InvalidLogError(f"{source.path}: {str(error).removeprefix(f'{source.path}: ')}") from error
    return _CONVERTED[source]


def _as_text(source: Source) -> Converted:
    """The table of a spreadsheet or of JSON."""
    name = source.path.lower()
    if name.endswith(SPREADSHEETS) or (packer_of(source.magic) == "zip" and _is_spreadsheet(source)):
        with source.open() as raw:
            return "spreadsheet", sheet_text(raw)
    packed = (end + packed for end in JSONS for packed in ("", ".gz", ".xz", ".bz2", ".zip"))
    if source.magic.startswith(b"{") or name.endswith(tuple(packed)):
        return "JSON", json_text(_pieces(source))
    return None


def _with_a_row_a_sample(source: Source, found: Converted) -> Converted:
    """A text, or what was converted, as a table with a row a sample where it has a row a reading."""
    kind, text = found or ("text", next(_decoded_pieces(source, None), b""))
    header = long_header(text[:HEAD_BYTES].decode("utf-8", "replace"))
    if header is None:
        return found
    whole = text if found else at_most(_decoded_pieces(source, None))
    return f"{kind}, a row a reading", long_text(whole.decode("utf-8", "replace"), header)


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
        if name == packer_of(source.magic):
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
    """The text of a table with a row a sample in pieces of about a megabyte; what does not look like ASCII becomes UTF-8.

    Raises InvalidLogError where it cannot be unpacked.
    """
    if found := converted(source):
        yield found[1]
    else:
        yield from _decoded_pieces(source, encoding)


def _decoded_pieces(source: Source, encoding: str | None) -> Iterator[bytes]:
    encoding = encoding or _wide(source.magic)
    decoder = None if is_like_ascii(encoding) else codecs.getincrementaldecoder(encoding or "")("replace")
    try:
        for piece in _pieces(source):
            yield piece if decoder is None else decoder.decode(piece).encode("utf-8", "replace")
        yield b"" if decoder is None else decoder.decode(b"", True).encode("utf-8", "replace")
    except UnicodeError as error:
        raise InvalidLogError(
            f"{source.path}: cannot be decoded as {encoding} ({str(error)[:100]}); name the right encoding in a column map"
        ) from error


def _pieces(source: Source) -> Iterator[bytes]:
    """The bytes of a file without what packs them. Raises InvalidLogError where it breaks off."""
    with source.open() as raw:
        try:
            stream = _unpacked(source, raw)
            while piece := stream.read(PIECE_BYTES):
                yield piece
        except _BROKEN as error:
            raise InvalidLogError(
                f"{source.path}: breaks off ({str(error)[:100]}); copy or export it again"
            ) from error
