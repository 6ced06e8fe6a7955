"""MAT files of version 5 to 7.2, element by element: real arrays, texts and structs of them; anything else is passed over.

Written out because the reader at hand ends the process where a type in a damaged file is none. The format is that of "MAT-File
Format" (The MathWorks), level 5: elements of a type, a number of bytes and data, padded to eight bytes, or packed by zlib.
"""

import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

HEADER = 128
MOST_BYTES = 1 << 31  # of one variable, unpacked
_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
    18: "u4",
}
_MATRIX, _PACKED = 14, 15
_STRUCT, _CHAR, _NUMERIC = 2, 4, range(6, 16)
_DEEPEST = 4  # structs within structs

Found = tuple[str, NDArray[Any] | str]


class _Element(NamedTuple):
    """One element: its type, its data, and where the next one begins."""

    kind: int
    data: memoryview
    end: int


def mat5_variables(raw: bytes) -> Iterator[Found]:
    """Name and value of every array of real numbers (as it lies in MATLAB) and text. Raises ValueError for a damaged file."""
    if len(raw) < HEADER or raw[126:128] not in (b"IM", b"MI"):
        raise ValueError("not of version 5 to 7.3; save it again with -v7")
    order = "<" if raw[126:128] == b"IM" else ">"
    for element in _elements(memoryview(raw)[HEADER:], order):
        if element.kind == _PACKED:
            packer = zlib.decompressobj()
            plain = packer.decompress(bytes(element.data), MOST_BYTES)
            if not packer.eof:
                raise ValueError("a packed variable breaks off, or is larger than 2 GB")
            for inner in _elements(memoryview(plain), order):
                yield from _variable(inner, order, "", _DEEPEST)
        else:
            yield from _variable(element, order, "", _DEEPEST)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    at = 0
    while at + 8 <= len(data):
        element = _element(data, at, order)
        yield element
        at = element.end


def _element(data: memoryview, at: int, order: str) -> _Element:
    if at + 8 > len(data):
        raise ValueError("an element breaks off")
    first, size = (int(v) for v in np.frombuffer(data, order + "u4", 2, at))
    if first >> 16:  # a small one: type and size share four bytes, the data are the next four
        kind, size = first & 0xFFFF, first >> 16
        if size > 4:
            raise ValueError("an element is larger than its room")
        return _Element(kind, data[at + 4 : at + 4 + size], at + 8)
    if size > len(data) - at - 8:
        raise ValueError("an element breaks off")
    padded = size if first == _PACKED else -(-size // 8) * 8
    return _Element(first, data[at + 8 : at + 8 + size], at + 8 + padded)


def _numbers(element: _Element, order: str) -> NDArray[Any]:
    if element.kind not in _TYPES:
        raise ValueError(f"there is no type of numbers {element.kind}")
    kind = np.dtype(order + _TYPES[element.kind])
    return np.frombuffer(element.data[: len(element.data) // kind.itemsize * kind.itemsize], kind)


def _variable(element: _Element, order: str, name: str, deeper: int) -> Iterator[Found]:
    """A variable, or a field of the name that is given, and the fields of a struct."""
    if element.kind != _MATRIX or not len(element.data):
        return
    parts = _elements(element.data, order)
    flags, shape_of, named = (next(parts, None) for _ in range(3))
    if flags is None or shape_of is None or named is None:
        raise ValueError("a variable breaks off")
    about = _numbers(flags, order)
    if not about.size:
        raise ValueError("a variable breaks off")
    kind, is_complex = int(about[0]) & 0xFF, bool(int(about[0]) & 0x0800)
    shape = tuple(int(n) for n in _numbers(shape_of, order))
    name = name or bytes(named.data).decode("utf-8", "replace")
    if kind == _STRUCT:
        if deeper and shape in ((1, 1), (1,)):
            yield from _fields(parts, order, name, deeper - 1)
    elif kind == _CHAR and (text := next(parts, None)) is not None:
        yield name, "".join(chr(int(c)) for c in _numbers(text, order)[:500])
    elif kind in _NUMERIC and not is_complex and (real := next(parts, None)) is not None:
        values = _numbers(real, order)
        if min(shape, default=-1) < 0 or values.size != np.prod(shape, dtype=np.float64):
            raise ValueError(f"{name} has {values.size} values and claims {shape}")
        yield name, values.reshape(shape, order="F")


def _fields(parts: Iterator[_Element], order: str, name: str, deeper: int) -> Iterator[Found]:
    length, names = next(parts, None), next(parts, None)
    if length is None or names is None or not _numbers(length, order).size:
        raise ValueError(f"the struct {name} breaks off")
    size = int(_numbers(length, order)[0])
    if size < 1:
        raise ValueError(f"the struct {name} has fields without names")
    raw = bytes(names.data)
    for k in range(len(raw) // size):
        field = raw[k * size : (k + 1) * size].split(b"\0")[0].decode("utf-8", "replace")
        value = next(parts, None)
        if value is None:
            raise ValueError(f"the struct {name} breaks off")
        yield from _variable(value, order, f"{name}.{field}", deeper)
