"""Cells of text tables that are numbers to a reader and none to a computer, made plain; and rows that are no samples.

Groups of three digits (1,234.5 and 1.234,5, with blanks or apostrophes too), Fortran's D, the minus sign of typesetters, and what
loggers and spreadsheets write where they have no reading.
"""

import re
from collections.abc import Sequence

from observer_fi.logs.tables import NO_VALUE

_SIGNS = str.maketrans(
    {"\u2212": "-", "\u2013": "-", "\u00a0": " ", "\u202f": " ", "\u2009": " ", "\u2019": "'"}
)
_EXPONENT = r"(?:[eEdD][+-]?\d+)?"
_NUMBER = {
    sign: re.compile(rf"[+-]?(?:\d+{re.escape(sign)}?\d*|{re.escape(sign)}\d+){_EXPONENT}", re.ASCII)
    for sign in ".,"
}
# In groups: by the other sign, which needs a decimal sign to be told from one, or by what is none.
_GROUPED = {
    sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:(?:{re.escape(other)}\d{{3}})+|(?:[' ]\d{{3}})+)"
                     rf"(?:{re.escape(sign)}\d*)?{_EXPONENT}", re.ASCII)
    for sign, other in (".,", ",.")
}  # fmt: skip
_EDGES = "#!?+-<>*._~=()[] "
_NO_READING = """na n/a nan null nil none missing bad badvalue badinput err error fail failed fault invalid nodata novalue
noreading timeout overrange underrange over under overflow underflow overload ovl ovr ol o.l out outofrange saturated sat offline
disconnected unknown undefined ind inf infinity qnan snan 1.#ind 1.#inf 1.#qnan 1.#snan"""
_SUMMARY = """min minimum max maximum mean average avg std stdev std.dev stddev sd sigma rms sum total median count range
mittelwert mittel summe moyenne media promedio p-p pk-pk peak peak-peak end eof"""
NO_READING, SUMMARIES = frozenset(_NO_READING.split()), frozenset(_SUMMARY.split())


def plain_cell(text: str, decimal: str, sure: bool) -> str | None:
    """A cell as a number with a decimal point, "" where it says that there is none, None for any other text.

    sure: whether the table shows its decimal sign elsewhere; else groups count only beside one, for 1,234 may be either.
    """
    text = text.strip().translate(_SIGNS)
    if _NUMBER[decimal].fullmatch(text):
        return _pointed(text, decimal)
    if _GROUPED[decimal].fullmatch(text):
        other = "," if decimal == "." else "."
        if other not in text or decimal in text or sure:
            return _pointed(re.sub(rf"[{other}' ]", "", text), decimal)
    return "" if is_no_reading(text) else None


def _pointed(text: str, decimal: str) -> str:
    return text.replace(decimal, ".").translate({ord("d"): "e", ord("D"): "e"})


def is_no_reading(text: str) -> bool:
    """Whether a text stands where a logger has no number: a word of `NO_READING`, or a mark such as ----."""
    word = text.casefold().strip(_EDGES)
    of_a_sheet = text.startswith("#") and text.endswith(("!", "?"))  # #DIV/0!, #NAME?
    a_mark = not word and not text.endswith("+")
    return of_a_sheet or text in NO_VALUE or a_mark or word.replace(" ", "") in NO_READING


def no_sample(fields: Sequence[str], headers: Sequence[str]) -> str:
    """Why a row is no sample: the header once more, or a summary of columns at the end; "" for any other."""
    plain = [field.strip() for field in fields]
    if headers and plain == [header.strip() for header in headers]:
        return "the header once more"
    first = next((field for field in plain if field), "").casefold().rstrip(": ").replace(" ", "")
    return "a summary of the columns" if first.rstrip(".") in SUMMARIES else ""
