"""Parquet, batch by batch through pyarrow (imported on use)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.tables import Block, Table, not_a_number, plain, positions, regrouped
from observer_fi.records import Array


def open_parquet(path: str, column_map: ColumnMap) -> Table:
    """A Parquet file; the key-value pairs of its schema are the metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            headers = list(file.schema_arrow.names)
            raw = dict(file.schema_arrow.metadata or {})
    except pa.ArrowInvalid as error:
        what = str(error).splitlines()[0].rstrip(".")
        raise InvalidLogError(
            f"{path}: not a whole Parquet file ({what}); copy or export it again"
        ) from error
    at = positions(path, headers, column_map)
    metadata = tuple(
        f"{key.decode('utf-8', 'replace')}: {value.decode('utf-8', 'replace')}"
        for key, value in raw.items()
        if key not in (b"ARROW:schema", b"pandas")
    )

    def blocks(rows: int) -> Iterator[Block]:
        return regrouped(_parquet_blocks(path, {c: headers[k] for c, k in at.items()}, rows), rows)

    return Table(tuple(at), blocks, metadata)


def _parquet_blocks(path: str, used: dict[str, str], rows: int) -> Iterator[Block]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    done = 0
    try:
        with pq.ParquetFile(path, pre_buffer=False) as file:
            for batch in file.iter_batches(
                batch_size=min(rows, 1 << 17), columns=list(dict.fromkeys(used.values()))
            ):
                values = {
                    column: _floats(path, batch.column(batch.schema.names.index(name)), column, done)
                    for column, name in used.items()
                }
                yield Block(np.arange(done + 1, done + batch.num_rows + 1), values)
                done += batch.num_rows
    except (pa.ArrowInvalid, OSError) as error:
        what = str(error).splitlines()[0].rstrip(".")
        raise InvalidLogError(
            f"{path}: breaks off after row {done} ({what}); copy or export it again"
        ) from error


def _floats(path: str, array: Any, column: str, done: int) -> Array:
    import pyarrow as pa

    if array.type == pa.float64():
        return plain(array)
    try:
        return plain(array.cast(pa.float64(), safe=False))
    except pa.ArrowNotImplementedError as error:
        raise InvalidLogError(
            f"{path}: column {column} is of type {array.type}; numbers in {COLUMNS[column].unit} are needed"
        ) from error
    except pa.ArrowInvalid as error:
        for k, text in enumerate(array.to_pylist()):
            if text is not None and not _is_number(text):
                raise not_a_number(path, done + k + 1, column, text) from error
        raise


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
