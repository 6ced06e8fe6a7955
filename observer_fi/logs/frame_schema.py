"""The log table as a pandera schema, for tables that come as DataFrames.

docs/decisions/0002-schema-checks.md says why files do not pass through it.
"""

from typing import TYPE_CHECKING

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, ColumnMap
from observer_fi.logs.formats.stamps import Stamps
from observer_fi.logs.tables import not_a_number, positions

if TYPE_CHECKING:
    import pandas as pd
    import pandera.pandas as pa


def log_schema() -> "pa.DataFrameSchema":
    """Types and order of a log's columns. Missing values are for the cleaning to mask."""
    import pandera.pandas as pa

    forward = pa.Check(lambda time: ~(time.ffill().diff() < 0), name="forward", error="time runs backward")
    return pa.DataFrameSchema(
        {
            name: pa.Column(
                "float64",
                checks=[forward] if name == "time_s" else None,
                nullable=True,
                required=False,
                coerce=True,
            )
            for name in COLUMNS
        }
    )


def named(frame: "pd.DataFrame", path: str, column_map: ColumnMap) -> "pd.DataFrame":
    """The columns that a map finds, under the names of the contract and a fresh index; their units stay as they are.

    Raises InvalidLogError for a column that is missing or stands there twice.
    """
    at = positions(path, [str(name) for name in frame.columns], column_map)
    return frame.iloc[:, list(at.values())].set_axis(list(at), axis=1).reset_index(drop=True)


def with_seconds(frame: "pd.DataFrame", path: str, remarks: list[str], texts: bool = False) -> "pd.DataFrame":
    """The frame with seconds where time_s holds time stamps; remarks: takes the note on when the log starts.

    texts: whether a column map calls texts time stamps; those of pandas are known by their type.
    """
    stamps, times = Stamps(path, remarks), frame["time_s"]
    if texts and getattr(times.dtype, "kind", "") != "M":
        import pyarrow as pa

        words = times.astype("string").to_list()
        words = [text if isinstance(text, str) else None for text in words]
        return frame.assign(
            time_s=stamps.of_texts(pa.array(words, pa.string()), np.arange(1, len(words) + 1))
        )
    if getattr(times.dtype, "kind", "") != "M":
        return frame
    stamps.zoned = getattr(times.dtype, "tz", None) is not None
    ns = times.to_numpy(dtype="M8[ns]").astype(np.int64)
    return frame.assign(time_s=stamps.seconds(ns, times.notna().to_numpy()))


def checked(frame: "pd.DataFrame", path: str) -> "pd.DataFrame":
    """The frame with float columns. Raises InvalidLogError: row, column and what to do."""
    import pandera.errors

    try:
        return log_schema().validate(frame, lazy=True)
    except pandera.errors.SchemaErrors as error:
        cases = error.failure_cases
    first = cases.sort_values("index", na_position="last").iloc[0]
    if first["index"] is None or first["index"] != first["index"]:
        column = str(first["column"])
        raise InvalidLogError(
            f"{path}: column {column} is of type {frame[column].dtype}; numbers in {COLUMNS[column].unit} are needed"
        )
    row = int(first["index"]) + 1
    if first["check"] == "time runs backward":
        raise InvalidLogError(f"{path}: row {row}, column time_s: time runs backward; sort the table by time")
    raise not_a_number(path, row, str(first["column"]), first["failure_case"])
