"""Observer bank against the paper's open-loop mixture on simulated moves: reports/compare_mixture.

python -m pipelines.compare_mixture [--cases 300] [--seed 2018] [--out reports/compare_mixture]

The logs come from the project's own simulator, with every parameter drawn from the paper's spread; the study
with an independent truth is pipelines/diagnose_study.py.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from observer_fi.physics import load_rig
from observer_fi.report import json_text, page, still_figures, table, write_folder
from observer_fi.settings import Settings
from observer_fi.verdict import as_dict, compare


def main(argv: Sequence[str] | None = None) -> int:
    """Run the Monte Carlo, write the page, its figure and the score sheets, print the short of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=2018)
    parser.add_argument("--out", type=Path, default=Path("reports/compare_mixture"))
    args = parser.parse_args(argv)

    rig = load_rig()
    pairs = compare(args.cases, args.seed, rig, Settings())
    result = as_dict(list(tqdm(pairs, total=args.cases, unit="log", disable=None)), args.seed, rig)
    sheets = {key: value for key, value in result.items() if key != "cases"}
    delays = still_figures.svg(still_figures.delay_figure(result["cases"]))
    files = {"compare.html": page(result), "compare.json": json_text(sheets), "delays.svg": delays}
    write_folder(args.out, files)
    print(table(result))
    print(args.out / "compare.html")
    return 0


if __name__ == "__main__":
    sys.exit(main())
