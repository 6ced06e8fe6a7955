"""What a fleet run found, folder by folder, from its fleet.parquet.

python -m pipelines.fleet_summary reports/fleet.parquet [--worst 10]
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

SHOWN = ["log", "label", "channel", "probability", "onset_s", "nis_ratio", "error"]


def main(argv: Sequence[str] | None = None) -> int:
    """Print verdicts by folder, the worst logs, and the logs without a verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, nargs="?", default=Path("reports/fleet.parquet"))
    parser.add_argument("--worst", type=int, default=10)
    args = parser.parse_args(argv)

    logs = pd.read_parquet(args.table)
    folder = logs["log"].map(lambda log: Path(log).parent.as_posix())
    verdict = logs["label"].where(logs["status"] == "done", logs["status"])
    print(pd.crosstab(folder.rename("folder"), verdict.rename("verdict"), margins=True).to_string())
    print(f"\nThe first {args.worst}, worst first:")
    print(logs.head(args.worst)[SHOWN].to_string(index=False, na_rep="", float_format=lambda v: f"{v:.4g}"))
    healthy = logs[logs["label"] == "nominal"]
    if len(healthy):
        print(f"\nHealthy logs: NIS over its expectation, median {healthy['nis_ratio'].median():.3g}, "
              f"largest {healthy['nis_ratio'].max():.3g}")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
