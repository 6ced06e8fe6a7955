"""Whether planned moves decide: pairs of rivals, logs of the independent truth, one table.

    python -m pipelines.plan_study --seed 52000 --out reports/plan.md

Seeds below 52000 were seen while the room was written.
"""

import argparse
import sys
from pathlib import Path

from pipelines.plan_study_cases import PAIRS, run_pair, summary

REPORTS = Path(__file__).resolve().parent.parent / "reports"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=52000, help="first seed; each pair has the next one")
    parser.add_argument("--pairs", default="", help="numbers of the pairs, separated by commas (all)")
    parser.add_argument("--out", type=Path, default=REPORTS / "plan.md")
    options = parser.parse_args(arguments)
    chosen = [int(k) for k in options.pairs.split(",") if k] or range(len(PAIRS))
    rows = []
    for k in chosen:
        rows.append(run_pair(PAIRS[k], options.seed + k))
        print(f"{len(rows)}/{len(chosen)} {' / '.join(rows[-1]['causes'])}", file=sys.stderr)
        options.out.write_text(summary(rows))
    print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
