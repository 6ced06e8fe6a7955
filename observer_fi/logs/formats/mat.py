"""MAT files of MATLAB: version 5 to 7.2 by `mat5.py`, 7.3 (which is HDF5) through h5py, imported on use.

Vectors of one length are columns, also those in a struct ("run.current"). Where several lengths occur, the most frequent one
makes the table, and a note says what is left out.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.arrays import MOST_VALUES, array_table
from observer_fi.logs.formats.mat5 import mat5_variables
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.tables import Table
from observer_fi.records import Array

_DAMAGED = "not a whole MAT file ({}); save or copy it again"
FEWEST = 2  # values that make a column; single numbers are parameters
DEEPEST = 4  # structs within structs
MOST_COLUMNS = 2000
_HDF5 = b"\x89HDF"


class Vectors(NamedTuple):
    """What a MAT file holds: columns (n,) by name, single numbers and texts as lines, and what else there is."""

    columns: dict[str, Array]
    metadata: tuple[str, ...]
    notes: tuple[str, ...]


def open_mat(source: Source, column_map: ColumnMap) -> Table:
    """A MAT file as a table; the names of its variables are the headers."""
    wanted = {column_map.source(column).header for column in column_map.columns}
    found = mat_vectors(source, wanted)
    return array_table(source.path, found.columns, column_map, found.metadata, found.notes)


def mat_vectors(source: Source, wanted: set[str] | None = None) -> Vectors:
    """All vectors of a MAT file of one length: that of those wanted, or the most frequent one. Raises InvalidLogError."""
    remarks: list[str] = []
    with source.open() as stream:
        head = stream.read(520)
        stream.seek(0)
        with third_party(source.path, _DAMAGED, remarks):
            found = dict(_hdf5(stream) if _HDF5 in head[:516] else _version_5(stream))
    vectors = {name: v for name, v in found.items() if isinstance(v, np.ndarray)}
    metadata = tuple(f"{name}: {v}" for name, v in found.items() if not isinstance(v, np.ndarray))
    if not vectors:
        raise InvalidLogError(
            f"{source.path}: holds no vectors of numbers (a timeseries object or a Simulink dataset is none); save "
            "time and channels as plain vectors"
        )
    if len(vectors) > MOST_COLUMNS:
        raise InvalidLogError(
            f"{source.path}: {len(vectors)} vectors, more than {MOST_COLUMNS}; save those needed"
        )
    columns, notes = _of_one_length(vectors, wanted or set())
    return Vectors(columns, metadata, (*remarks, *notes))


def _of_one_length(vectors: dict[str, Array], wanted: set[str]) -> tuple[dict[str, Array], tuple[str, ...]]:
    sizes = Counter(v.size for name, v in vectors.items() if name in wanted) or Counter(
        v.size for v in vectors.values()
    )
    size = max(sizes, key=lambda n: (sizes[n], n))
    columns = {name: v for name, v in vectors.items() if v.size == size}
    others = [f"{name} ({v.size})" for name, v in vectors.items() if v.size != size]
    note = f"vectors of {size} values are the table; others are left out: {', '.join(others[:8])}"
    return columns, (note,) if others else ()


def _version_5(stream: Any) -> Iterator[tuple[str, Any]]:
    for name, value in mat5_variables(stream.read()):
        if isinstance(value, str):
            yield name, value
        else:
            yield from _numbers(name, value)


def _numbers(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A vector (n, 1) or (1, n), one number, or the columns of a matrix (n, k)."""
    value = np.asarray(value)
    if value.size == 1:
        yield name, f"{float(value.reshape(-1)[0]):.9g}"
    elif value.size >= FEWEST and max(value.shape) == value.size:
        yield name, value.reshape(-1).astype(np.float64)
    elif value.ndim == 2 and value.shape[0] > value.shape[1] > 0:
        for k in range(value.shape[1]):
            yield f"{name}({k + 1})", value[:, k].astype(np.float64)


def _hdf5(stream: Any) -> Iterator[tuple[str, Any]]:
    import h5py

    with h5py.File(stream, "r") as file:
        yield from _of_group(file, "", DEEPEST)


def _of_group(group: Any, prefix: str, deeper: int) -> Iterator[tuple[str, Any]]:
    import h5py

    for name, item in group.items():
        if name.startswith("#"):
            continue
        if isinstance(item, h5py.Group):
            if deeper:
                yield from _of_group(item, f"{prefix}{name}.", deeper - 1)
        elif isinstance(item, h5py.Dataset):
            yield from _of_dataset(item, prefix + name)


def _of_dataset(item: Any, name: str) -> Iterator[tuple[str, Any]]:
    if item.size is None or item.attrs.get("MATLAB_empty", 0):
        return
    if item.size > MOST_VALUES:
        raise ValueError(f"{name} claims {item.size} values")
    if item.attrs.get("MATLAB_class", b"") == b"char":
        codes = np.asarray(item[()]).reshape(-1)
        yield name, "".join(chr(int(c)) for c in codes[:500])
    elif item.dtype.kind in "iufb":
        yield from _numbers(name, np.asarray(item[()]).T)  # MATLAB counts down columns, HDF5 along rows
