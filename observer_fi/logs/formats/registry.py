"""Which reader opens a file. A reader judges no value: what is no number is an error, the rest is cleaned."""

from dataclasses import replace
from pathlib import Path

from observer_fi.errors import InvalidLogError, one_line
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.converted.json_documents import JSONS
from observer_fi.logs.formats.converted.spreadsheets import SPREADSHEETS
from observer_fi.logs.formats.csv import open_csv
from observer_fi.logs.formats.lvm import open_lvm
from observer_fi.logs.formats.mat import open_mat
from observer_fi.logs.formats.mdf import open_mdf
from observer_fi.logs.formats.source import Source
from observer_fi.logs.formats.tdms import open_tdms
from observer_fi.logs.formats.typed.feather import open_feather
from observer_fi.logs.formats.typed.parquet import open_parquet
from observer_fi.logs.tables import Table

_TEXTS = (".csv", ".txt", ".tsv", ".dat", *JSONS)
_PACKED = (".gz", ".xz", ".bz2", ".zip")
SUFFIXES = (
    *(text + packed for text in _TEXTS for packed in _PACKED), ".zip", *_TEXTS,
    *SPREADSHEETS, ".parquet", ".pq", ".feather", ".arrow", ".tdms", ".lvm", ".mat", ".mf4", ".mdf"
)  # fmt: skip
SHOWN_SUFFIXES = (
    f"{', '.join(SUFFIXES[len(_TEXTS) * len(_PACKED) + 1 :])}; text also packed as .gz, .xz, .bz2 or .zip"
)
READERS = {
    ".parquet": open_parquet, ".pq": open_parquet, ".feather": open_feather, ".arrow": open_feather,
    ".tdms": open_tdms, ".lvm": open_lvm, ".mat": open_mat,
    ".mf4": open_mdf, ".mdf": open_mdf,
}  # fmt: skip

MOST_METADATA = 200  # lines
LONGEST_METADATA = 500  # characters


def suffix_of(path: str | Path) -> str:
    """The part of the file name that says what it holds, lower case; "" if unknown."""
    name = Path(path).name.lower()
    return next((suffix for suffix in SUFFIXES if name.endswith(suffix)), "")


def check_kind(path: str, magic: bytes) -> None:
    """Raises InvalidLogError for a binary format under the suffix of a text."""
    if suffix_of(path) in READERS:
        return
    for start, name, suffix in (
        (b"PAR1", "a Parquet", ".parquet"),
        (b"MDF ", "an MDF", ".mf4"),
        (b"TDSm", "a TDMS", ".tdms"),
        (b"ARRO", "a Feather", ".feather"),
    ):
        if magic == start:
            raise InvalidLogError(f"{path}: this is {name} file; rename it to end in {suffix}")


def open_table(source: Source, column_map: ColumnMap) -> Table:
    """Opens the file far enough to know its columns. Raises InvalidLogError, the one line for the user."""
    path, magic = source.path, source.magic
    if not magic:
        raise InvalidLogError(f"{path}: the file is empty; record or export the log again")
    suffix = suffix_of(path)
    if not suffix:
        raise InvalidLogError(f"{path}: unknown kind of file; logs end in {SHOWN_SUFFIXES}")
    check_kind(path, magic)
    try:
        table = READERS.get(suffix, open_csv)(source, column_map)
    except OSError as error:
        raise InvalidLogError(f"{path}: cannot read the log ({error}); copy or export it again") from error
    return replace(table, metadata=_shown(table.metadata))


def _shown(metadata: tuple[str, ...]) -> tuple[str, ...]:
    """Metadata as lines that neither a terminal nor a page obeys, and not more than anyone reads."""
    shown = tuple(one_line(text, LONGEST_METADATA) for text in metadata[:MOST_METADATA])
    more = len(metadata) - len(shown)
    return (*shown, f"... and {more} more lines of metadata") if more else shown
