"""How studies end: their rows where they are wanted, and their report."""

from pathlib import Path

import pandas as pd


def write_study(frame: pd.DataFrame, report: str, rows: Path | None, out: Path) -> int:
    """The report to `out`, and a row a move to `rows` as CSV where that is given. Returns the exit code 0."""
    if rows:
        frame.to_csv(rows, index=False)
    out.write_text(report, encoding="utf-8")
    print(f"wrote {out}")
    return 0
