"""Many lines of plain numbers parsed in one go, to the same numbers as `float` line by line."""

from typing import Any

import numpy as np

from observer_fi.records import Array
from observer_fi.tables import plain

SEPARATORS = ",;\t|: "


def numbers(block: bytes, separator: str, fields: int, used: tuple[int, ...]) -> Array | None:
    """Numbers of the used fields of n lines, (n, k), NaN for an empty field and no row for an empty line.

    None where all lines are empty, where one has not as many fields, where `float` might not take a used one, or where a
    quote or a stray carriage return lets arrow and `str.split` see other fields. Arrow, not `float`, takes "nan(...)".
    """
    import pyarrow as pa

    if separator not in SEPARATORS or any(mark in block for mark in (b'"', b"(")):
        return None
    if b"\r" in block and block.count(b"\r") != block.count(b"\r\n"):
        return None
    try:
        table = _read(block, separator, fields, used)
    except pa.ArrowInvalid:
        return None
    if not table.num_rows:
        return None
    columns = [[plain(chunk) for chunk in column.chunks] for column in table.columns]
    return np.column_stack([np.concatenate(chunks) for chunks in columns])


def _read(block: bytes, separator: str, fields: int, used: tuple[int, ...]) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    names = [f"{k}" for k in range(fields)]
    wanted = [names[k] for k in used]
    return pacsv.read_csv(
        pa.py_buffer(block),
        pacsv.ReadOptions(use_threads=False, column_names=names),
        pacsv.ParseOptions(delimiter=separator),
        pacsv.ConvertOptions(
            column_types={name: pa.float64() for name in wanted}, include_columns=wanted, null_values=[""]
        ),
    )
