"""Many lines of plain numbers parsed in one go, to the same numbers as `float` line by line."""

from typing import Any

import numpy as np

from observer_fi.logs.tables import plain
from observer_fi.records import Array

SEPARATORS = ",;\t|:"
MARKS = (b'"', b"(", b"#")
EDGES = (b"\n\t", b"\t\n", b"\t\r")


def numbers(block: bytes, separator: str, decimal: str, fields: int, used: tuple[int, ...]) -> Array | None:
    """Numbers of the used fields of n lines, (n, k), NaN for an empty field and no row for an empty line.

    None where all lines are empty, where one has not as many fields, where `float` might not take a used one, and for what
    arrow and a reader of single lines see in two ways: quotes, "nan(...)", comments, stray carriage returns, and tabs at the
    edges of a line.
    """
    import pyarrow as pa

    if separator not in SEPARATORS or any(mark in block for mark in MARKS):
        return None
    if b"\r" in block and block.count(b"\r") != block.count(b"\r\n"):
        return None
    if separator == "\t" and (block.startswith(b"\t") or any(edge in block for edge in EDGES)):
        return None
    try:
        table = _read(block, separator, decimal, fields, used)
    except pa.ArrowInvalid:
        return None
    if not table.num_rows:
        return None
    columns = [[plain(chunk) for chunk in column.chunks] for column in table.columns]
    return np.column_stack([np.concatenate(chunks) for chunks in columns])


def _read(block: bytes, separator: str, decimal: str, fields: int, used: tuple[int, ...]) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    names = [f"{k}" for k in range(fields)]
    wanted = {names[k]: pa.float64() for k in used}
    read = pacsv.ReadOptions(use_threads=False, column_names=names)
    parse = pacsv.ParseOptions(delimiter=separator)
    convert = pacsv.ConvertOptions(
        column_types=wanted, include_columns=list(wanted), null_values=[""], decimal_point=decimal
    )
    # The streaming reader costs a third of read_csv, which has threads wait for each other; and what the system's allocator
    # gives each of its threads is 12 MB less than arrow's own.
    return pacsv.open_csv(pa.py_buffer(block), read, parse, convert, pa.system_memory_pool()).read_all()
