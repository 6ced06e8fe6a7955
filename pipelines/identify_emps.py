"""EMPS: the published identification again, and the same parameters frozen on the run with pulses.

python -m pipelines.identify_emps --data FOLDER [--out reports/emps]
"""

import argparse
import sys
from pathlib import Path

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.learn import (
    Columns,
    InverseSettings,
    identify_force,
    prepare_motion,
    relative,
    residual_on,
    solve,
    structure_of,
)
from observer_fi.physics import load_rig
from pipelines.emps import FILES, LEARN, PULSES, SOURCE, VARIABLE, load, to_log
from pipelines.emps_tables import fit_table, scores_table

PUBLISHED = {"symmetric": "emps_published", "two directions": "emps_two_directions"}


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help=f"folder of the .mat files ({VARIABLE})")
    parser.add_argument("--out", type=Path, default=Path("reports/emps"), help="folder for the report")
    args = parser.parse_args(argv)
    try:
        learn, pulses = (to_log(load(name, args.data)) for name in (LEARN, PULSES))
    except (InvalidLogError, UsageError) as error:
        print(error, file=sys.stderr)
        return 2
    as_published = InverseSettings(edge=0)  # the authors fit the edge of the filters as well
    motions = [prepare_motion(log, as_published) for log in (learn, pulses)]
    text, scores = [], {}
    for name, packaged in PUBLISHED.items():
        rig = load_rig(packaged)
        fit = identify_force([learn], rig, as_published)
        columns = Columns(rig)
        solution = solve(columns, motions[:1], structure_of(rig, motions[:1]))
        scores[name] = [relative(*residual_on(columns, motion, solution)) for motion in motions]
        text.append(f"## {name.capitalize()}, learned on {LEARN}\n\n{fit_table(fit, rig)}")
    head = [f"{name} [%]" for name in FILES]
    answer = f"Force residual relative to the force, parameters learned on {LEARN} and frozen.\n\n{scores_table(head, scores)}"
    args.out.mkdir(parents=True, exist_ok=True)
    report = args.out / "identify.md"
    report.write_text(
        "\n".join(["# EMPS: identification", answer, *text, f"Data: {SOURCE}.\n"]), encoding="utf-8"
    )
    print(answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
