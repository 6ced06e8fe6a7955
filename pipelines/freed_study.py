"""Which equation the data want to free, against what is hidden in them: many seeds of the independent truth, one table.

    python -m pipelines.freed_study --first 9500 --out reports/freed.md

The threshold and the correlation times were chosen on seeds 9000 to 9011. A run that was interrupted goes on where it stopped.
"""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import hidden

from pipelines.freed_study_cases import FreedCase, run_case, summary

REPORTS = Path(__file__).resolve().parent.parent / "reports"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=9500, help="first seed")
    parser.add_argument("--sizes", default="3:3,1:1", help="sizes in units of the detectable one: seeds")
    parser.add_argument("--controls", type=int, default=20, help="seeds without any effect")
    parser.add_argument("--causes", default="", help="only these causes, separated by commas")
    parser.add_argument("--results", type=Path, default=REPORTS / "freed_study.jsonl")
    parser.add_argument("--out", type=Path, default=REPORTS / "freed.md")
    options = parser.parse_args(arguments)
    options.results.parent.mkdir(parents=True, exist_ok=True)
    done = [FreedCase(**json.loads(line)) for line in _lines(options.results)]
    seen = {(case.cause, case.size, case.seed) for case in done}
    with options.results.open("a") as file:
        for cause, size, seed in _todo(options):
            if (cause, size, seed) not in seen:
                done.append(run_case(cause, size, seed))
                file.write(json.dumps(asdict(done[-1])) + "\n")
                file.flush()
                print(f"{cause or 'control'} {size:g} {seed}: {done[-1].first}", file=sys.stderr)
    options.out.write_text(summary(done))
    print(f"wrote {options.out}")
    return 0


def _todo(options: argparse.Namespace) -> list[tuple[str, float, int]]:
    only = set(options.causes.split(",")) - {""}
    sizes = [item.split(":") for item in options.sizes.split(",")]
    cases = [
        (c, float(s), k) for s, n in sizes for k in range(int(n)) for c in hidden.ALL if not only or c in only
    ]
    controls = [] if only else [("", 0.0, k) for k in range(options.controls)]
    return [(cause, size, options.first + k) for cause, size, k in [*controls, *cases]]


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []


if __name__ == "__main__":
    sys.exit(main())
