"""Formats that are read whole: named arrays of one length become a table."""

from collections.abc import Iterator, Sequence

import numpy as np

from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.tables import Block, RowCount, Table, positions
from observer_fi.records import Array

MOST_VALUES = 400_000_000  # of a file that is read whole: 3 GB of numbers


def array_table(
    path: str,
    arrays: dict[str, Array],
    column_map: ColumnMap,
    metadata: tuple[str, ...] = (),
    notes: Sequence[str] = (),
) -> Table:
    """A table of columns (n,) by their headers. Raises InvalidLogError for a column that is missing."""
    headers = list(arrays)
    at = positions(path, headers, column_map)
    columns = {column: arrays[headers[k]] for column, k in at.items()}
    total = columns["time_s"].size

    def blocks(rows: int) -> Iterator[Block]:
        for start in range(0, total, rows):
            part = slice(start, min(start + rows, total))
            values = {column: values[part].astype(np.float64) for column, values in columns.items()}
            yield Block(np.arange(part.start, part.stop) + 1, values)

    return Table(tuple(at), blocks, RowCount(total), metadata, tuple(notes))
