"""A file as it stands, whatever its columns are called: its layout and the first rows of every column."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.blank_columns import BlankColumns
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats import lvm
from observer_fi.logs.formats.csv import MOST_COLUMNS, decoded, fields_of, first_bytes, is_binary
from observer_fi.logs.formats.mat import mat_vectors
from observer_fi.logs.formats.mdf import Group, best_group, mdf_groups
from observer_fi.logs.formats.registry import READERS, SHOWN_SUFFIXES, check_kind, suffix_of
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.stamps import STAMP, Stamps, is_stamp
from observer_fi.logs.formats.tdms import tdms_columns
from observer_fi.logs.formats.text_rows import lines_in, without_lines
from observer_fi.logs.formats.texts import converted, packer_of, utf8_pieces
from observer_fi.logs.formats.typed.feather import feather_columns
from observer_fi.logs.formats.typed.parquet import parquet_columns
from observer_fi.logs.inspection.text_table import TextTable, text_table
from observer_fi.logs.inspection.vocabulary import understood
from observer_fi.logs.plain_cells import plain_cell
from observer_fi.logs.tables import NO_VALUE
from observer_fi.records import Array

MOST_ROWS = 300_000  # that are looked at
MOST_BYTES = 64 << 20  # of text that is looked at
FEWEST_STAMPS = 0.9  # share of fields from which a column holds time stamps
SHOWN = 3  # fields of a column that are shown


@dataclass(frozen=True)
class Column:
    """One column of a file.

    values: (n,) numbers as they stand, NaN where there is none; of time stamps seconds from the first one on. texts: the first
    fields as they stand. unit: by the file itself (a row of units, a property). missing, strange: shares of fields without a
    value, and with one that is no number.
    """

    header: str
    values: Array
    texts: tuple[str, ...]
    unit: str = ""
    stamps: bool = False
    missing: float = 0.0
    strange: float = 0.0


@dataclass(frozen=True)
class Contents:
    """A file: its kind, its columns, and its layout.

    table: of text; clock: the file has a clock of its own, which is the column time_s. whole: all rows were looked at.
    """

    path: str
    kind: str
    columns: tuple[Column, ...]
    rows: int
    whole: bool = True
    table: TextTable | None = None
    clock: bool = False
    metadata: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default_factory=tuple)


def contents_of(path: str, column_map: ColumnMap | None = None) -> Contents:
    """What a file holds. Raises InvalidLogError for one that cannot be read, or is no table."""
    source = Source(path)
    if not source.magic:
        raise InvalidLogError(f"{path}: the file is empty; record or export the log again")
    suffix = suffix_of(path)
    if not suffix:
        raise InvalidLogError(f"{path}: unknown kind of file; logs end in {SHOWN_SUFFIXES}")
    check_kind(path, source.magic)
    try:
        found = _OF_KIND[suffix](source) if suffix in READERS else _of_text(source, column_map)
    except OSError as error:
        raise InvalidLogError(f"{path}: cannot read the log ({error}); copy or export it again") from error
    source.check()
    return found


def digest_of(path: str) -> str:
    """SHA-256 of a file. Raises InvalidLogError."""
    return Source(path).sha256()


# --- text ----------------------------------------------------------------------------------------


def _of_text(source: Source, column_map: ColumnMap | None) -> Contents:
    encoding = column_map.encoding if column_map else None
    texts, notes = decoded(first_bytes(source, encoding), encoding)
    if is_binary(texts):
        raise InvalidLogError(
            f"{source.path}: this is not a table of text but binary data; export the log as CSV"
        )
    table = text_table(texts, column_map)
    if table is None:
        raise InvalidLogError(
            f"{source.path}: no table of numbers: no rows of as many fields between commas, semicolons, tabs, bars or blanks; "
            "export the log as CSV"
        )
    if len(table.headers) > MOST_COLUMNS:
        raise InvalidLogError(
            f"{source.path}: {len(table.headers)} columns, more than {MOST_COLUMNS}; export those needed"
        )
    columns, rows, whole = _text_columns(source, table, encoding, column_map.missing if column_map else ())
    kind = "CSV" if suffix_of(source.path).startswith(".csv") else "text"
    packer, made = packer_of(source.magic), converted(source)
    kind = made[0] if made else f"{kind}, {packer}" if packer else kind
    return Contents(source.path, kind, columns, rows, whole, table, False, table.preamble, notes)


def _text_columns(
    source: Source, table: TextTable, encoding: str | None, missing: tuple[str, ...]
) -> tuple[tuple[Column, ...], int, bool]:
    """The columns of the first rows, how many rows there are, and whether that is all of them."""
    import pyarrow as pa
    import pyarrow.csv as pacsv

    names = [f"{k}" for k in range(_fields(source, table, encoding))]
    read = pacsv.ReadOptions(use_threads=False, block_size=1 << 30, column_names=names)
    separator = "\t" if table.separator == " " else table.separator
    parse = pacsv.ParseOptions(delimiter=separator, invalid_row_handler=lambda row: "skip")
    convert = pacsv.ConvertOptions(
        column_types=dict.fromkeys(names, pa.string()),
        null_values=[*NO_VALUE, *missing],
        strings_can_be_null=True,
    )
    text, whole = _rows_text(source, table, encoding)
    try:
        found = pacsv.read_csv(pa.py_buffer(text), read, parse, convert)
    except pa.ArrowInvalid:
        parse.quote_char = False
        found = pacsv.read_csv(pa.py_buffer(text), read, parse, convert)
    whole = whole and found.num_rows <= MOST_ROWS
    found = found.slice(0, MOST_ROWS)
    headers = [*table.headers, *[""] * len(names)]
    units = [*table.units, *[""] * len(names)]
    columns = tuple(
        _text_column(source.path, headers[k], found.column(name).combine_chunks(), units[k], table.decimal)
        for k, name in enumerate(names)
    )
    return columns, found.num_rows, whole


def _rows_text(source: Source, table: TextTable, encoding: str | None) -> tuple[bytes, bool]:
    """The bytes of the first rows, whole lines, and whether these are all."""
    kept: list[bytes] = []
    size = 0
    lines = without_lines(lines_in(source.path, utf8_pieces(source, encoding)), table.data_line - 1)
    if table.separator == " ":
        lines = BlankColumns(len(table.headers)).tabbed(lines)
    for block in lines:
        if block.startswith(b"#") or b"\n#" in block:
            block = b"".join(line for line in block.splitlines(True) if not line.startswith(b"#"))
        kept.append(block)
        size += len(block)
        if size > MOST_BYTES:
            return _utf8(b"".join(kept)), False
    return _utf8(b"".join(kept)), True


def _utf8(text: bytes) -> bytes:
    return text if text.isascii() else text.decode("utf-8", "replace").encode("utf-8")


def _fields(source: Source, table: TextTable, encoding: str | None) -> int:
    """Fields of the first row: one more than the header has, where rows end with a separator."""
    texts, _ = decoded(first_bytes(source, encoding), encoding)
    first = next((line for line in texts[table.data_line - 1 :] if line.strip()), "")
    return max(len(fields_of(first, table.separator)), 1)


def _text_column(path: str, header: str, texts: Any, unit: str, decimal: str) -> Column:
    """A column of texts (arrow) as numbers, or as time stamps where nearly all of them are."""
    import pyarrow as pa
    import pyarrow.compute as pc

    texts = pc.utf8_trim_whitespace(texts)
    texts = pc.if_else(pc.is_in(texts, pa.array(NO_VALUE)), pa.scalar(None, pa.string()), texts)
    shown = tuple(str(text) for text in texts.slice(0, SHOWN).to_pylist() if text is not None)
    there = len(texts) - texts.null_count
    missing = texts.null_count / max(len(texts), 1)
    if there and any(map(is_stamp, shown)):
        fits = pc.match_substring_regex(texts, STAMP).fill_null(False)
        if pc.sum(fits).as_py() >= FEWEST_STAMPS * there:
            only = pc.if_else(fits, texts, pa.scalar(None, pa.string()))
            values = _seconds(path, only)
            if values is not None:
                return Column(header, values, shown, unit, True, missing)
    point = texts if decimal == "." else pc.replace_substring(texts, ",", ".", max_replacements=1)
    numeric = pc.match_substring_regex(point, r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$").fill_null(False)
    plain = pc.if_else(numeric, point, pa.scalar(None, pa.string()))
    values = np.array(plain.cast(pa.float64()).fill_null(float("nan")), dtype=np.float64)
    others = np.flatnonzero(np.array(texts.is_valid()) & ~np.array(numeric))
    sure = bool(pc.any(pc.match_substring(texts.filter(numeric), decimal)).as_py())
    cells = [plain_cell(str(texts[k]), decimal, sure) for k in others.tolist()]
    values[others] = [float(cell or "nan") for cell in cells]
    rows, strange = max(len(texts), 1), sum(cell is None for cell in cells)
    return Column(header, values, shown, unit, False, missing + cells.count("") / rows, strange / rows)


def _seconds(path: str, texts: Any) -> Array | None:
    """Time stamps as seconds, None where some of them are none after all."""
    try:
        return Stamps(path, []).of_texts(texts, np.arange(1, len(texts) + 1))
    except InvalidLogError:
        return None


# --- other formats -------------------------------------------------------------------------------


def _of_arrays(
    source: Source, kind: str, arrays: dict[str, NDArray[Any]], units: dict[str, str], **more: Any
) -> Contents:
    """Contents of columns (n,) of any type."""
    if not arrays:
        raise InvalidLogError(f"{source.path}: holds no columns; export the log again")
    rows = max(values.size for values in arrays.values())
    columns = tuple(
        _typed(source.path, name, values[:MOST_ROWS], units.get(name, "")) for name, values in arrays.items()
    )
    return Contents(source.path, kind, columns, min(rows, MOST_ROWS), rows <= MOST_ROWS, **more)


def _typed(path: str, header: str, values: NDArray[Any], unit: str) -> Column:
    import pyarrow as pa

    if values.dtype.kind == "M":
        known = ~np.isnat(values)
        seconds = Stamps(path, []).seconds(values.astype("M8[ns]").astype(np.int64), known)
        return Column(
            header,
            seconds,
            tuple(map(str, values[:SHOWN])),
            unit,
            True,
            float(1.0 - known.mean()) if known.size else 0.0,
        )
    if values.dtype.kind not in "iufb":
        texts = pa.array([None if v is None or v != v else str(v) for v in values.tolist()], pa.string())
        return _text_column(path, header, texts, unit, ".")
    numbers = values.astype(np.float64)
    numbers[~np.isfinite(numbers)] = np.nan
    shown = tuple(f"{v:.6g}" for v in numbers[:SHOWN])
    return Column(
        header, numbers, shown, unit, False, float(np.isnan(numbers).mean()) if numbers.size else 0.0
    )


def _of_parquet(source: Source) -> Contents:
    return _of_typed(source, "Parquet", *parquet_columns(source, MOST_ROWS))


def _of_feather(source: Source) -> Contents:
    return _of_typed(source, "Feather", *feather_columns(source, MOST_ROWS))


def _of_typed(
    source: Source, kind: str, arrays: dict[str, NDArray[Any]], rows: int, metadata: tuple[str, ...]
) -> Contents:
    found = _of_arrays(source, kind, arrays, {}, metadata=metadata)
    return Contents(source.path, kind, found.columns, found.rows, rows <= found.rows, metadata=metadata)


def _of_tdms(source: Source) -> Contents:
    arrays, units, clock, metadata, notes = tdms_columns(source, MOST_ROWS)
    return _of_arrays(source, "TDMS", arrays, units, clock=clock, metadata=metadata, notes=notes)


def _of_mat(source: Source) -> Contents:
    found = mat_vectors(source)
    return _of_arrays(source, "MAT", found.columns, {}, metadata=found.metadata, notes=found.notes)


def _of_mdf(source: Source) -> Contents:
    found = mdf_groups(source)
    group = best_group(found.groups, set()) if len(found.groups) == 1 else max(found.groups, key=_likeness)
    others = [
        f"{other.name} ({', '.join(list(other.columns)[1:4])})"
        for other in found.groups
        if other is not group
    ]
    notes = (f"group {group.name} is shown; others: {'; '.join(others[:5])}",) if others else ()
    return _of_arrays(
        source, "MDF", group.columns, group.units, clock=True, metadata=found.metadata, notes=notes
    )


def _likeness(group: Group) -> tuple[int, int]:
    """How many quantities of a log the names of a group say, and its samples."""
    said = {q for name, unit in group.units.items() for q in understood(name, unit).quantities}
    return len(said & {"voltage", "current", "position", "speed", "angle", "force"}), group.columns[
        "time_s"
    ].size


def _of_lvm(source: Source) -> Contents:
    headers, blocks, clock, metadata, notes = lvm.lvm_columns(source)
    parts: list[dict[str, Array]] = []
    rows = 0
    for block in blocks:
        parts.append(block)
        rows += next(iter(block.values())).size
        if rows >= MOST_ROWS:
            break
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in headers} if parts else {}
    return _of_arrays(source, "LVM", arrays, {}, clock=clock, metadata=metadata, notes=notes)


_OF_KIND: dict[str, Callable[[Source], Contents]] = {
    ".parquet": _of_parquet, ".pq": _of_parquet, ".feather": _of_feather, ".arrow": _of_feather,
    ".tdms": _of_tdms, ".lvm": _of_lvm, ".mat": _of_mat, ".mf4": _of_mdf,
    ".mdf": _of_mdf,
}  # fmt: skip


def columns_by_header(contents: Contents) -> Iterator[Column]:
    """Columns that a map can name: those whose header stands once."""
    headers = [column.header.casefold() for column in contents.columns]
    return (
        column
        for column in contents.columns
        if column.header and headers.count(column.header.casefold()) == 1
    )
