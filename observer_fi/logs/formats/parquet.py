"""Parquet, batch by batch through pyarrow (imported on use)."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.stamps import TIME_OF_DAY, Stamps, stamp_columns
from observer_fi.logs.formats.third_party import third_party
from observer_fi.logs.tables import Block, RowCount, Table, not_a_number, plain, positions, regrouped
from observer_fi.records import Array

BATCH_ROWS = 1 << 16
# Of a row group, unpacked: what a page of it may ask for. (Its columns are not looked at one by one: pyarrow ends the process
# where the metadata of one are damaged.)
MOST_GROUP_BYTES = 1 << 30
_DAMAGED = "not a whole Parquet file ({}); copy or export it again"
_NO_LOG = (b"ARROW:schema", b"pandas")


def open_parquet(source: Source, column_map: ColumnMap) -> Table:
    """A Parquet file; the key-value pairs of its schema are the metadata."""
    import pyarrow.parquet as pq

    remarks: list[str] = []
    with source.open() as stream, third_party(source.path, _DAMAGED, remarks):
        file = pq.ParquetFile(stream)
        headers = [str(name) for name in file.schema_arrow.names]
        raw, total = dict(file.schema_arrow.metadata or {}), int(file.metadata.num_rows)
        groups = [file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups)]
        types = list(file.schema_arrow.types)
        largest = max((file.metadata.row_group(k).total_byte_size for k in range(len(groups))), default=0)
    if total != sum(groups) or min(groups, default=0) < 0:
        raise InvalidLogError(f"{source.path}: " + _DAMAGED.format("its row groups do not add up"))
    if largest > MOST_GROUP_BYTES:
        raise InvalidLogError(
            f"{source.path}: a row group has {largest >> 20} MB, more than {MOST_GROUP_BYTES >> 20} MB; write it in smaller ones"
        )
    at = positions(source.path, headers, column_map)
    stamped = _stamped(types[at["time_s"]]) or column_map.source("time_s").stamps
    stamps = stamp_columns(source.path, headers, column_map, at) if stamped else {}
    for column, k in at.items():
        if column not in stamps:
            _check_type(source.path, column, types[k])
    count = RowCount(total)

    def blocks(rows: int) -> Iterator[Block]:
        clock = Stamps(source.path, remarks) if stamps else None
        used = {column: headers[k] for column, k in (at | stamps).items()}
        return regrouped(_blocks(source, used, rows, remarks, clock), rows)

    return Table(tuple(at), blocks, count, _metadata(raw), remarks=remarks)


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
        flat = {str(name): found.column(k) for k, name in enumerate(found.schema.names)}
        arrays = {
            name: column.to_numpy() for name, column in flat.items() if not pa.types.is_nested(column.type)
        }
        return arrays, int(file.metadata.num_rows), _metadata(dict(file.schema_arrow.metadata or {}))


def _metadata(raw: dict[bytes, bytes]) -> tuple[str, ...]:
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
    source: Source, used: dict[str, str], rows: int, remarks: list[str], stamps: Stamps | None
) -> Iterator[Block]:
    import pyarrow.parquet as pq

    done = 0
    with source.open() as stream:
        with third_party(source.path, _DAMAGED, remarks):
            file = pq.ParquetFile(stream, pre_buffer=False)
            batches = file.iter_batches(batch_size=min(rows, BATCH_ROWS), columns=list(used.values()))
        while True:
            refusal = f"breaks off after row {done} ({{}}); copy or export it again"
            with third_party(source.path, refusal, remarks):
                batch = next(batches, None)
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
