"""How well `improve` names what is hidden from it: many seeds of the independent truth, one table.

    python -m pipelines.improve_study --first 41000 --out reports/improve.md

Seeds below 41000 were seen while thresholds were set; the report uses seeds from 41000 on. A run that was interrupted
goes on where it stopped.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

import hidden

from pipelines.improve_study_cases import PAIRS, Case, case_of, run_case, summary

REPORTS = Path(__file__).resolve().parent.parent / "reports"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=41000, help="first seed")
    parser.add_argument("--sizes", default="3:2,10:1,1:1", help="sizes in units of the detectable one: seeds")
    parser.add_argument("--controls", type=int, default=40, help="seeds without any effect")
    parser.add_argument("--pairs", type=int, default=2, help="seeds for each pair of effects")
    parser.add_argument("--causes", default="", help="only these causes, separated by commas")
    parser.add_argument("--rate", type=float, default=0.0, help="of the logger [Hz], 0: that of the truth")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--results", type=Path, default=REPORTS / "improve_study.jsonl")
    parser.add_argument("--out", type=Path, default=REPORTS / "improve.md")
    options = parser.parse_args(arguments)
    options.results.parent.mkdir(parents=True, exist_ok=True)
    done = {case_of(row) for row in _rows(options.results)}
    cases = [replace(case, rate_hz=options.rate) for case in _cases(options)]
    todo = [case for case in cases if case not in done]
    with ProcessPoolExecutor(options.workers) as pool, options.results.open("a") as file:
        running = [pool.submit(run_case, case) for case in todo]
        for k, future in enumerate(as_completed(running)):
            row = future.result()
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(f"{k + 1}/{len(todo)} {row['causes']} {row['seconds']:.1f} s", file=sys.stderr)
    options.out.write_text(summary(_rows(options.results)))
    print(f"wrote {options.out}")
    return 0


def _cases(options: argparse.Namespace) -> list[Case]:
    only = set(options.causes.split(",")) - {""}
    cases = []
    if not only:
        cases += [Case((), 0.0, options.first + k, True) for k in range(options.controls)]
        cases += [Case(pair, 3.0, options.first + k, True) for pair in PAIRS for k in range(options.pairs)]
    for size, seeds in (item.split(":") for item in options.sizes.split(",")):
        for cause in (*hidden.CAUSES, *hidden.OUTSIDE):
            if not only or cause in only:
                twice = cause in hidden.OUTSIDE and float(size) > 1.0
                count = max(int(seeds), 2) if twice else int(seeds)
                inside = cause in hidden.CAUSES
                cases += [Case((cause,), float(size), options.first + k, inside) for k in range(count)]
    return cases


def _rows(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


if __name__ == "__main__":
    sys.exit(main())
