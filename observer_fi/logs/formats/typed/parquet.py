"""Parquet, batch by batch through pyarrow (imported on use)."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.formats.typed.batches import BATCH_ROWS, metadata_of, typed_arrays, typed_table
from observer_fi.logs.tables import Table

# Of a row group, unpacked: what a page of it may ask for. (Its columns are not looked at one by one: pyarrow ends the process
# where the metadata of one are damaged.)
MOST_GROUP_BYTES = 1 << 30
_DAMAGED = "not a whole Parquet file ({}); copy or export it again"


def open_parquet(source: Source, column_map: ColumnMap) -> Table:
    """A Parquet file; the key-value pairs of its schema are the metadata."""
    import pyarrow.parquet as pq

    remarks: list[str] = []
    with source.open() as stream, third_party(source.path, _DAMAGED, remarks):
        file = pq.ParquetFile(stream)
        schema, total = file.schema_arrow, int(file.metadata.num_rows)
        groups = [file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups)]
        largest = max((file.metadata.row_group(k).total_byte_size for k in range(len(groups))), default=0)
    if total != sum(groups) or min(groups, default=0) < 0:
        raise InvalidLogError(f"{source.path}: " + _DAMAGED.format("its row groups do not add up"))
    if largest > MOST_GROUP_BYTES:
        raise InvalidLogError(
            f"{source.path}: a row group has {largest >> 20} MB, more than {MOST_GROUP_BYTES >> 20} MB; write it in smaller ones"
        )
    return typed_table(source, column_map, schema, total, _batches, remarks)


@contextmanager
def _batches(source: Source, names: list[str], rows: int) -> Iterator[Iterator[Any]]:
    """Record batches of the columns of these names."""
    import pyarrow.parquet as pq

    with source.open() as stream:
        with third_party(source.path, _DAMAGED, []):
            file = pq.ParquetFile(stream, pre_buffer=False)
            found = file.iter_batches(batch_size=rows, columns=names)
        yield found


def parquet_columns(source: Source, rows: int) -> tuple[dict[str, NDArray[Any]], int, tuple[str, ...]]:
    """The first rows of all columns, of any type, the number of rows of the file, and its metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with source.open() as stream, third_party(source.path, _DAMAGED, []):
        file = pq.ParquetFile(stream, pre_buffer=False)
        batches, held = [], 0
        for batch in file.iter_batches(batch_size=BATCH_ROWS):
            batches.append(batch)
            held += batch.num_rows
            if held >= rows:
                break
        found = pa.Table.from_batches(batches, file.schema_arrow)
        return typed_arrays(found), int(file.metadata.num_rows), metadata_of(file.schema_arrow)
