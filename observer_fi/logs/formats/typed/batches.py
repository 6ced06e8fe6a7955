"""Columns with types of their own, as pyarrow gives them batch by batch: what Parquet and Feather share."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.stamps import TIME_OF_DAY, Stamps, stamp_columns
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.tables import Block, RowCount, Table, not_a_number, plain, positions, regrouped
from observer_fi.records import Array

BATCH_ROWS = 1 << 16
_NO_LOG = (b"ARROW:schema", b"pandas")

Batches = Callable[[Source, list[str], int], AbstractContextManager[Iterator[Any]]]


def typed_table(
    source: Source, column_map: ColumnMap, schema: Any, total: int, batches: Batches, remarks: list[str]
) -> Table:
    """A table of an arrow schema, whose key-value pairs are the metadata.

    batches: of a source the record batches of columns by name, with at most so many rows. total: rows of the file.
    """
    headers, types = [str(name) for name in schema.names], list(schema.types)
    at = positions(source.path, headers, column_map)
    stamped = _stamped(types[at["time_s"]]) or column_map.source("time_s").stamps
    stamps = stamp_columns(source.path, headers, column_map, at) if stamped else {}
    for column, k in at.items():
        if column not in stamps:
            _check_type(source.path, column, types[k])

    def blocks(rows: int) -> Iterator[Block]:
        clock = Stamps(source.path, remarks) if stamps else None
        used = {column: headers[k] for column, k in (at | stamps).items()}
        return regrouped(_blocks(source, used, rows, batches, remarks, clock), rows)

    return Table(tuple(at), blocks, RowCount(total), metadata_of(schema), remarks=remarks)


def typed_arrays(table: Any) -> dict[str, Any]:
    """The columns of an arrow table that are no structures, by name."""
    import pyarrow as pa

    flat = {str(name): table.column(k) for k, name in enumerate(table.schema.names)}
    return {name: column.to_numpy() for name, column in flat.items() if not pa.types.is_nested(column.type)}


def metadata_of(schema: Any) -> tuple[str, ...]:
    """The key-value pairs of an arrow schema that say something of the log."""
    raw = dict(schema.metadata or {})
    return tuple(
        f"{key.decode('utf-8', 'replace')}: {value[:2000].decode('utf-8', 'replace')}"
        for key, value in raw.items()
        if key not in _NO_LOG
    )


def _check_type(path: str, column: str, kind: Any) -> None:
    import pyarrow.types as of

    numeric = of.is_integer(kind) or of.is_floating(kind) or of.is_decimal(kind)
    texts = of.is_string(kind) or of.is_large_string(kind) or of.is_null(kind)
    if not (numeric or texts or (of.is_dictionary(kind) and of.is_string(kind.value_type))):
        raise InvalidLogError(
            f"{path}: column {column} is of type {kind}; numbers in {COLUMNS[column].unit} are needed"
        )


def _stamped(kind: Any) -> bool:
    import pyarrow.types as of

    return bool(of.is_timestamp(kind) or of.is_time(kind) or of.is_date(kind))


def _blocks(
    source: Source,
    used: dict[str, str],
    rows: int,
    batches: Batches,
    remarks: list[str],
    stamps: Stamps | None,
) -> Iterator[Block]:
    done = 0
    with batches(source, list(used.values()), min(rows, BATCH_ROWS)) as found:
        while True:
            refusal = f"breaks off after row {done} ({{}}); copy or export it again"
            with third_party(source.path, refusal, remarks):
                batch = next(found, None)
                if batch is None:
                    return
                arrays = {c: batch.column(batch.schema.names.index(name)) for c, name in used.items()}
                values = {}
                if stamps is not None:
                    parts = [arrays.pop(c) for c in ("time_s", TIME_OF_DAY) if c in arrays]
                    values["time_s"] = _times(parts, done, stamps)
                values |= {c: _floats(source.path, array, c, done) for c, array in arrays.items()}
            yield Block(np.arange(done + 1, done + batch.num_rows + 1), values)
            done += batch.num_rows


def _times(parts: list[Any], done: int, stamps: Stamps) -> Array:
    """Time stamps of a type of their own, or texts, as seconds from the first of the file on."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_timestamp(parts[0].type) and len(parts) == 1:
        whole = parts[0].cast(pa.timestamp("ns", parts[0].type.tz), safe=False).view(pa.int64())
        stamps.zoned = parts[0].type.tz is not None
        return stamps.seconds(np.array(whole.fill_null(0)), np.array(whole.is_valid()))
    texts = [part.cast(pa.string()) for part in parts]
    joined = texts[0] if len(texts) == 1 else pc.binary_join_element_wise(*texts, " ")
    return stamps.of_texts(joined, np.arange(done + 1, done + len(joined) + 1))


def _floats(path: str, array: Any, column: str, done: int) -> Array:
    import pyarrow as pa

    if array.type == pa.float64():
        return plain(array)
    try:
        if pa.types.is_dictionary(array.type):
            array = array.dictionary_decode()
        return plain(array.cast(pa.float64(), safe=False))
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
