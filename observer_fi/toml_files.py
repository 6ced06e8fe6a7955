"""TOML from people: rigs, settings and column maps, checked by pydantic; what is wrong is one line with file and key."""

import os
import stat
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from observer_fi.errors import UsageError, one_line

if TYPE_CHECKING:
    from pydantic import BaseModel

M = TypeVar("M", bound="BaseModel")

MOST_BYTES = 1 << 20  # a rig with an empirical curve has 10 kB


def toml_table(path: str | Path, what: str, example: str) -> dict[str, Any]:
    """The table of a TOML file. what: "rig file", ...; example: where files of this kind are. Raises UsageError."""
    advice = f"give a TOML file as in {example}"
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise UsageError(f"{path}: cannot read the {what} (not a file); {advice}")
        with open(path, "rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        if isinstance(error, UsageError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{path}: cannot read the {what} ({reason}); {advice}") from error
    if len(raw) > MOST_BYTES:
        raise UsageError(f"{path}: cannot read the {what} (more than {MOST_BYTES >> 20} MB); {advice}")
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except RecursionError as error:
        raise UsageError(f"{path}: not a TOML file: nested too deeply") from error
    except ValueError as error:  # of TOML, of UTF-8, of numbers with more than 4300 digits
        raise UsageError(f"{path}: not a TOML file: {error}") from error


def checked(model: type[M], table: dict[str, Any]) -> M:
    """The table as a pydantic model. Raises UsageError: the key, what is wrong with it, and what was given."""
    import pydantic

    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False, include_context=True)[0]
        raise UsageError(_said(dict(first))) from error
    except RecursionError as error:
        raise UsageError("tables are nested too deeply") from error


def _said(error: dict[str, Any]) -> str:
    """One line of an error of pydantic: "noise.voltage must be greater than 0, got nan"."""
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])  # a sentence of our own, which names its key
    if error["type"] == "missing":
        return f"{key} is missing"
    text = _IN_OUR_WORDS.get(error["type"]) or error["msg"].removeprefix("Input should be ")
    return f"{key} must be {text}, got {one_line(repr(error['input']), 80)}"


_IN_OUR_WORDS = {
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "dict_type": "a table",
    "list_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dataclass_type": "a table",
}
