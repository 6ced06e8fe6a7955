"""Spreadsheets of Office and OpenDocument, through python-calamine (imported on use)."""

from typing import IO

from observer_fi.errors import InvalidLogError, one_line
from observer_fi.logs.formats.converted.cells import text_of

SPREADSHEETS = (".xlsx", ".xlsm", ".ods")
ALIKE = 0.5  # of the rows of the longest sheet: one that has as many may be the log as well


def sheet_text(stream: IO[bytes]) -> bytes:
    """The sheet of a spreadsheet that holds the log. Raises InvalidLogError where several may."""
    from python_calamine import CalamineError, CalamineWorkbook

    try:
        book = CalamineWorkbook.from_filelike(stream)
        sheets = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names
        }
    except (CalamineError, OSError) as error:
        raise InvalidLogError(
            f"not a whole spreadsheet ({one_line(error, 100)}); save it again, or export CSV"
        ) from error
    longest = max(map(len, sheets.values()), default=0)
    if longest < 2:
        raise InvalidLogError("this spreadsheet has no rows; save the sheet that holds the log")
    alike = [name for name, rows in sheets.items() if len(rows) >= ALIKE * longest]
    if len(alike) > 1:
        raise InvalidLogError(
            f"this spreadsheet has {len(alike)} tables ({', '.join(alike)[:100]}); save each by itself"
        )
    return text_of(sheets[alike[0]])
