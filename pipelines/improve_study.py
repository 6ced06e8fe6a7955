"""How well `improve` names what is hidden from it: many seeds of the independent truth, one table.

    python pipelines/improve_study.py --seeds 2 --first 9000 --out reports/improve.md

Seeds below 8000 were seen while thresholds were set; the report uses seeds from 9000 on.
"""

import argparse
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from observer_fi.improve_study import PAIRS, Case, run_case, summary  # noqa: E402


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="seeds for each cause and size")
    parser.add_argument("--first", type=int, default=9000, help="first seed")
    parser.add_argument("--controls", type=int, default=20, help="seeds without any effect")
    parser.add_argument("--sizes", default="1,3,10", help="sizes in units of the detectable one")
    parser.add_argument("--causes", default="", help="only these causes, separated by commas")
    parser.add_argument("--results", type=Path, default=ROOT / "reports" / "improve_study.jsonl")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "improve.md")
    options = parser.parse_args(arguments)
    import hidden  # the truth lives with the tests, not in the package

    only = set(options.causes.split(",")) - {""}
    seeds = range(options.first, options.first + options.seeds)
    sizes = [float(size) for size in options.sizes.split(",")]
    cases = [
        Case((cause,), size, seed, cause in hidden.CAUSES)
        for size in sizes
        for cause in (*hidden.CAUSES, *hidden.OUTSIDE)
        for seed in seeds
        if not only or cause in only
    ]
    if not only:
        cases += [Case((), 0.0, options.first + k, True) for k in range(options.controls)]
        cases += [Case(pair, 3.0, seed, True) for pair in PAIRS for seed in seeds]
    options.results.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    with options.results.open("w") as file:
        for k, case in enumerate(cases):
            began = time.perf_counter()
            spec = hidden.draw_effects_case(case.seed, case.causes, case.size)
            frame, truth = hidden.make_log(spec, case.seed)
            rows.append(run_case(case, frame, truth))
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
            print(f"{k + 1}/{len(cases)} {case.causes} {time.perf_counter() - began:.1f} s", file=sys.stderr)
    options.out.write_text(summary(rows))
    print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
