"""Which reader opens a file. A reader judges no value: what is no number is an error, the rest is cleaned."""

from pathlib import Path

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import ColumnMap
from observer_fi.logs.formats.csv import open_csv
from observer_fi.logs.formats.labview import open_lvm, open_tdms
from observer_fi.logs.formats.parquet import open_parquet
from observer_fi.logs.tables import Table

SUFFIXES = (".csv.gz", ".csv", ".parquet", ".tdms", ".lvm", ".txt", ".tsv", ".dat", ".pq")


def suffix_of(path: str | Path) -> str:
    """The part of the file name that says what it holds, lower case; "" if unknown."""
    name = Path(path).name.lower()
    return next((suffix for suffix in SUFFIXES if name.endswith(suffix)), "")


def open_table(path: str, column_map: ColumnMap) -> Table:
    """Opens the file far enough to know its columns. Raises InvalidLogError, the one line for the user."""
    try:
        with open(path, "rb") as stream:
            magic = stream.read(4)
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InvalidLogError(
            f"{path}: cannot read the log ({what}); check the path and its permissions"
        ) from error
    if not magic:
        raise InvalidLogError(f"{path}: the file is empty; record or export the log again")
    suffix = suffix_of(path)
    readers = {".parquet": open_parquet, ".pq": open_parquet, ".tdms": open_tdms, ".lvm": open_lvm}
    if not suffix:
        raise InvalidLogError(f"{path}: unknown kind of file; logs end in {', '.join(SUFFIXES)}")
    if suffix not in readers and magic == b"PAR1":
        raise InvalidLogError(f"{path}: this is a Parquet file; rename it to end in .parquet")
    try:
        return readers.get(suffix, open_csv)(path, column_map)
    except OSError as error:
        raise InvalidLogError(f"{path}: cannot read the log ({error}); copy or export it again") from error
