"""Office Open XML with nothing but rows of numbers and texts, written without the library that reads it."""

import zipfile
from pathlib import Path

import pandas as pd

_OF = "http://schemas.openxmlformats.org"
_RELATED = f"{_OF}/officeDocument/2006/relationships"
_PACKAGE = f"{_OF}/package/2006"


def spreadsheet(path: Path, **sheets: pd.DataFrame) -> None:
    """A workbook of sheets by name: the names of columns in the first row, numbers below."""
    book, related = "", ""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        for k, (name, frame) in enumerate(sheets.items(), 1):
            made.writestr(f"xl/worksheets/sheet{k}.xml", _sheet(frame))
            book += f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>'
            related += (
                f'<Relationship Id="r{k}" Type="{_RELATED}/worksheet" Target="worksheets/sheet{k}.xml"/>'
            )
        made.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{_PACKAGE}/content-types"><Default Extension="xml" ContentType="application/xml"/></Types>',
        )
        made.writestr(
            "_rels/.rels",
            _relations(f'<Relationship Id="r" Type="{_RELATED}/officeDocument" Target="xl/workbook.xml"/>'),
        )
        made.writestr("xl/_rels/workbook.xml.rels", _relations(related))
        made.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{_OF}/spreadsheetml/2006/main" xmlns:r="{_RELATED}"><sheets>{book}</sheets></workbook>',
        )


def _relations(entries: str) -> str:
    return f'<Relationships xmlns="{_PACKAGE}/relationships">{entries}</Relationships>'


def _sheet(frame: pd.DataFrame) -> str:
    header = "".join(f'<c t="inlineStr"><is><t>{column}</t></is></c>' for column in frame.columns)
    rows = ["".join(f"<c><v>{v!r}</v></c>" for v in row) for row in frame.to_numpy().tolist()]
    body = "".join(f"<row>{row}</row>" for row in [header, *rows])
    return f'<worksheet xmlns="{_OF}/spreadsheetml/2006/main"><sheetData>{body}</sheetData></worksheet>'
