"""Tables with a row a reading (time, name of a signal, value), as historians, CAN loggers and InfluxDB export them."""

import csv
import io
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError, one_line
from observer_fi.logs.formats.converted.cells import text_of
from observer_fi.logs.formats.stamps import Stamps
from observer_fi.records import Array

if TYPE_CHECKING:
    import pandas as pd

HEAD_BYTES = 1 << 16  # of text in which the header has to stand
MOST_SIGNALS = 1000
_VALUES = {"value", "_value", "val", "values", "wert", "messwert", "reading", "valeur", "valore", "valor"}
_NAMES = {
    "signal", "signalname", "signal_name", "name", "_field", "field", "channel", "tag", "tagname", "tag_name", "variable",
    "sensor", "key", "topic", "kanal", "bezeichnung", "nom", "nome", "nombre", "canale", "canal",
}  # fmt: skip
_UNITS = {"unit", "units", "einheit", "unité", "unità", "unidad"}
_TIMES = ("time", "zeit", "temps", "tempo", "tiempo", "date", "datum", "stamp")


class LongHeader(NamedTuple):
    """The header of such a table. line: its index in the text; the others are indices of fields; times: one, or date and time."""

    line: int
    separator: str
    fields: tuple[str, ...]
    times: tuple[int, ...]
    name: int
    value: int
    unit: int | None


def long_header(head: str) -> LongHeader | None:
    """The header among the first lines of a text, None where it is none of a table with a row a reading."""
    lines = _newlines(head).split("\n")
    at = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if at is None:
        return None
    separator = max(",;\t|", key=lines[at].count)
    fields = tuple(field.strip() for field in next(csv.reader([lines[at]], delimiter=separator), []))
    words = [field.casefold() for field in fields]
    names, values, units = (
        [k for k, word in enumerate(words) if word in of] for of in (_NAMES, _VALUES, _UNITS)
    )
    times = [k for k, word in enumerate(words) if any(time in word for time in _TIMES)]
    if len(names) != 1 or len(values) != 1 or not 1 <= len(times) <= 2:
        return None
    return LongHeader(
        at, separator, fields, tuple(times), names[0], values[0], units[0] if len(units) == 1 else None
    )


def long_text(text: str, header: LongHeader) -> bytes:
    """The table with a column a signal and a row a time, in the order of time; numbers stay the texts they are.

    What stands before the header is kept; a signal is called with its unit. Raises InvalidLogError.
    """
    lines = _newlines(text).split("\n", header.line)
    readings = _readings(lines[-1], header)
    readings["turn"] = readings.groupby(
        ["time", "name"]
    ).cumcount()  # of readings of one signal with one time stamp
    wide = (
        readings.pivot(index=["time", "turn"], columns="name", values="value")
        .fillna("")
        .reset_index("turn", drop=True)
    )
    wide = wide[list(dict.fromkeys(readings["name"]))].iloc[
        np.argsort(_seconds(wide.index.tolist()), kind="stable")
    ]
    called = " ".join(header.fields[k] for k in header.times)
    table = text_of(
        [[called, *wide.columns.tolist()], *wide.reset_index().itertuples(index=False, name=None)]
    )
    return "\n".join([*lines[:-1], ""]).encode() + table


def _newlines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _readings(text: str, header: LongHeader) -> "pd.DataFrame":
    """Time, name and value of every reading, as texts. Raises InvalidLogError."""
    import pandas as pd

    try:
        found = pd.read_csv(
            io.StringIO(text), sep=header.separator, dtype=str, keep_default_na=False, index_col=False
        ).fillna("")  # of a row that is too short
    except ValueError as error:
        reason = one_line(error, 150)
        raise InvalidLogError(
            f"a table with a row a reading that breaks off ({reason}); export it again"
        ) from error
    found = found[~found.iloc[:, 0].str.startswith("#")]  # a # within a row is part of a name
    columns = [found.iloc[:, k].str.strip() for k in range(len(header.fields))]
    names, value = columns[header.name], columns[header.value]
    if header.unit is not None:
        unit = columns[header.unit]
        names = names.where(unit == "", names + " [" + unit + "]")
    if names.nunique() > MOST_SIGNALS:
        raise InvalidLogError(
            f"more than {MOST_SIGNALS} names in column {header.fields[header.name]}; export the signals needed"
        )
    time = columns[header.times[0]]
    for k in header.times[1:]:
        time = time + " " + columns[k]
    readings = pd.DataFrame({"time": time, "name": names, "value": value})
    return readings[value != header.fields[header.value]]  # InfluxDB begins every signal with the header


def _seconds(times: list[str]) -> Array:
    """Times as numbers that sort, of texts that are numbers or time stamps. Raises InvalidLogError."""
    import pyarrow as pa

    try:
        return np.array([float(time.replace(",", ".")) for time in times])
    except ValueError:
        return Stamps("time", []).of_texts(pa.array(times), np.arange(1, len(times) + 1))
