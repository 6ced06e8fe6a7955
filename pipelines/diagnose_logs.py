"""A folder of DAQ logs to reports and one summary table.

python -m pipelines.diagnose_logs FOLDER [--out reports/diagnose_logs] [--rig RIG.toml] [--columns MAP.toml]
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from observer_fi.errors import InvalidLogError
from observer_fi.logs import load_columns
from observer_fi.physics import load_rig
from observer_fi.report import diagnosis as report
from observer_fi.report import folder_name, write_file
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose

PATTERNS = ("*.csv", "*.csv.gz", "*.parquet", "*.tdms", "*.lvm")
SHOWN = ["label", "channel", "probability", "onset_s", "isolated_s", "mixture", "nis", "error"]


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose every log of a folder; a bad one is a row of the table and stops nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("reports/diagnose_logs"))
    parser.add_argument("--rig")
    parser.add_argument("--columns")
    args = parser.parse_args(argv)

    rig, settings = load_rig(args.rig), Settings()
    columns = load_columns(args.columns) if args.columns else None
    rows = []
    for path in sorted(path for pattern in PATTERNS for path in args.folder.glob(pattern)):
        try:
            outcome = diagnose(path, rig, settings, columns=columns)
        except InvalidLogError as error:
            rows.append({"log": path.name, "error": str(error)})
            continue
        report.write(outcome, rig, args.out / folder_name(None, str(path)))
        result = report.report_dict(outcome)
        rows.append(
            {"log": path.name, **result["verdict"], "mixture": result["open_loop"]["label"]}
            | {"nis": result["consistency"]["nis_mean"], "samples": result["log"]["samples"]}
        )

    table = pd.DataFrame(rows, columns=["log", *SHOWN, "samples"]).set_index("log")
    write_file(args.out / "summary.csv", table.to_csv())
    print(table[SHOWN].dropna(axis=1, how="all").to_string(float_format=lambda v: f"{v:.4g}"))
    print(table["label"].value_counts().to_string())
    return 2 if table["error"].notna().any() else 0


if __name__ == "__main__":
    sys.exit(main())
