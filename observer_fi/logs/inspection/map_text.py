"""A column map as TOML, from guesses and the layout of a file: what the readers find by themselves is left out."""

import json

from observer_fi.logs.columns import COLUMNS
from observer_fi.logs.inspection.contents import Contents
from observer_fi.logs.inspection.guesses import SURE, Guess

_NAMED = {"\t": "tab", ",": "comma", ";": "semicolon"}


def map_text(contents: Contents, found: dict[str, Guess]) -> str:
    """The map, its entries in the order of the contract, with what is not sure as comments."""
    lines = [*_layout(contents), "", "[columns]"]
    for column in COLUMNS:
        guess = found.get(column)
        if guess is None or (contents.clock and column == "time_s"):
            continue
        doubt = "" if guess.sure == SURE and not guess.also else f"  # {', '.join((guess.sure, *guess.also))}"
        lines.append(f"{column} = {_entry(guess)}{_one_line(doubt)}")
    return "\n".join(lines).strip() + "\n"


def _layout(contents: Contents) -> list[str]:
    table = contents.table
    if table is None:
        return []
    lines = [f"separator = {_text(_NAMED.get(table.separator, table.separator))}"]
    if table.decimal == ",":
        lines.append("decimal_comma = true")
    lines.append(f"header_line = {table.header_line}")
    if table.data_line != table.header_line + 1:
        lines.append(f"data_line = {table.data_line}")
    return lines


def _entry(guess: Guess) -> str:
    parts = [f"header = {_text(guess.header)}"]
    if guess.time_of_day:
        parts.append(f"time_of_day = {_text(guess.time_of_day)}")
    parts.append(f'unit = "{guess.unit}"')
    if guess.factor != 1.0:
        parts.append(f"factor = {guess.factor!r}")
    return "{ " + ", ".join(parts) + " }"


def _text(text: str) -> str:
    """A TOML string: that of JSON, but for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
