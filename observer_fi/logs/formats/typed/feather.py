"""Feather, which is Arrow's file format, batch by batch through pyarrow (imported on use)."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray

from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.formats.typed.batches import metadata_of, typed_arrays, typed_table
from observer_fi.logs.tables import Table

_DAMAGED = "not a whole Feather file of version 2 ({}); copy or export it again"


def open_feather(source: Source, column_map: ColumnMap) -> Table:
    """A Feather file; the key-value pairs of its schema are the metadata."""
    import pyarrow as pa

    remarks: list[str] = []
    with source.open() as stream, third_party(source.path, _DAMAGED, remarks):
        file = pa.ipc.open_file(stream)
        total = sum(file.get_batch(k).num_rows for k in range(file.num_record_batches))
        schema = file.schema
    return typed_table(source, column_map, schema, total, _batches, remarks)


@contextmanager
def _batches(source: Source, names: list[str], rows: int) -> Iterator[Iterator[Any]]:
    """Record batches of the columns of these names, as they stand in the file: none is cut into pieces of `rows`."""
    import pyarrow as pa

    with source.open() as stream:
        with third_party(source.path, _DAMAGED, []):
            file = pa.ipc.open_file(stream)
        yield (file.get_batch(k) for k in range(file.num_record_batches))


def feather_columns(source: Source, rows: int) -> tuple[dict[str, NDArray[Any]], int, tuple[str, ...]]:
    """The first rows of all columns, of any type, the number of rows of the file, and its metadata."""
    import pyarrow as pa

    with source.open() as stream, third_party(source.path, _DAMAGED, []):
        found = pa.ipc.open_file(stream).read_all()
        return typed_arrays(found.slice(0, rows)), found.num_rows, metadata_of(found.schema)
