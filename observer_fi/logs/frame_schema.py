"""The log table as a pandera schema, for tables that come as DataFrames.

docs/decisions/0002-schema-checks.md says why files do not pass through it.
"""

from typing import TYPE_CHECKING

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import COLUMNS, PLAIN, missing_column
from observer_fi.logs.formats.stamps import Stamps
from observer_fi.logs.tables import REQUIRED, not_a_number

if TYPE_CHECKING:
    import pandas as pd
    import pandera.pandas as pa


def log_schema() -> "pa.DataFrameSchema":
    """Columns, types and order of a log. Missing values are for the cleaning to mask."""
    import pandera.pandas as pa

    forward = pa.Check(lambda time: ~(time.ffill().diff() < 0), name="forward", error="time runs backward")
    return pa.DataFrameSchema(
        {
            name: pa.Column(
                "float64",
                checks=[forward] if name == "time_s" else None,
                nullable=True,
                required=name in REQUIRED,
                coerce=True,
            )
            for name in COLUMNS
        }
    )


def with_seconds(frame: "pd.DataFrame", path: str, remarks: list[str]) -> "pd.DataFrame":
    """The frame with seconds where time_s holds time stamps of pandas; remarks: takes the note on when the log starts."""
    if "time_s" not in frame or getattr(frame["time_s"].dtype, "kind", "") != "M":
        return frame
    stamps, times = Stamps(path, remarks), frame["time_s"]
    stamps.zoned = getattr(times.dtype, "tz", None) is not None
    ns = times.to_numpy(dtype="M8[ns]").astype(np.int64)
    return frame.assign(time_s=stamps.seconds(ns, times.notna().to_numpy()))


def checked(frame: "pd.DataFrame", path: str) -> "pd.DataFrame":
    """The frame with float columns and a fresh index. Raises InvalidLogError: row, column and what to do."""
    import pandera.errors

    headers = [str(name) for name in frame.columns]
    for name in COLUMNS:
        if headers.count(name) > 1:
            raise InvalidLogError(
                f"{path}: column {name} stands {headers.count(name)} times; keep one of them"
            )
    try:
        return log_schema().validate(frame.reset_index(drop=True), lazy=True)
    except pandera.errors.SchemaErrors as error:
        cases = error.failure_cases
    for case in cases.itertuples():
        if case.check == "column_in_dataframe":
            raise missing_column(path, str(case.failure_case), headers, PLAIN)
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
