"""EMPS: what the paper's Coulomb friction misses, cause by cause, judged where no parameter was fitted.

Learned on DATA_EMPS and on the first half of DATA_EMPS_PULSES (and, to compare, on DATA_EMPS alone); judged on the second
half of the pulses beside the published models.

    python -m pipelines.improve_emps --data FOLDER [--out reports/emps]
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve import (
    CalculatedForce,
    Ladder,
    calculated_force,
    improvement_of,
    name_causes,
    to_json,
)
from observer_fi.learn import (
    Columns,
    Motion,
    PositionServo,
    Solution,
    closed_loop,
    held_out,
    predict,
    prepare_motion,
    relative,
    residual_on,
    solve,
    structure_of,
    tune,
)
from observer_fi.physics import Rig, colour_of, load_rig, rig_toml, with_values
from observer_fi.records import Log
from observer_fi.report import json_text, still_figures, write_file
from pipelines import emps
from pipelines import emps_tables as text

HALF_S = 12.42  # the second half of the pulses is judged
GUARD_S = 0.1  # filters look this far, so the first half is learned from up to here before the second
AHEAD = 50  # samples
ALONE, BOTH = "extended, learned on DATA_EMPS alone", "extended, learned on both"
DRAWN = {"symmetric, published (DATA_EMPS)": colour_of("unknown"), BOTH: colour_of("nominal")}
BASELINES = {"symmetric": "emps_published", "two directions": "emps_two_directions"}


LEGEND = f"""Learned: DATA_EMPS, and the first half of DATA_EMPS_PULSES where it says "both". Judged: the second half of the
pulses, from {HALF_S} s on, with frozen parameters; no fit and no acceptance of a cause used it
(docs/emps.md says what did). Figures are 100 |residual| / |force| after the
authors' decimation to 40 Hz; sizes are forces at the carriage. "Hold known" gives the published structure the half sample by
which the 1 kHz controller's command acts late, which the published recipe leaves out. ΔBIC is the extended BIC that is won
(more is better). "Held out" is the residual of parts of the learning logs that were left out in turn. Standard errors are the
larger of two: from the correlation of the residual, and from the spread between parts.

Data: {emps.SOURCE}.
"""


class Fitted(NamedTuple):
    """A rig, its columns and what was fitted."""

    rig: Rig
    columns: Columns
    solution: Solution


class Learned(NamedTuple):
    """What was learned from, and the causes that were named."""

    problem: CalculatedForce
    ladder: Ladder[Solution]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help=f"folder of the .mat files ({emps.VARIABLE})")
    parser.add_argument("--out", type=Path, default=Path("reports/emps"), help="folder for the report")
    args = parser.parse_args(argv)
    try:
        runs = [emps.load(name, args.data) for name in (emps.LEARN, emps.PULSES)]
    except (InvalidLogError, UsageError) as error:
        print(error, file=sys.stderr)
        return 2
    logs = [emps.to_log(run) for run in runs]
    learn, pulses = (prepare_motion(log) for log in logs)
    rig = load_rig("emps")
    training = (learn, pulses.between(-np.inf, HALF_S - GUARD_S))
    alone, both = (Learned(problem, name_causes(problem)) for problem in problems(rig, training))
    models = baselines(learn, training) | {ALONE: final(alone), BOTH: final(both)}
    judged = {name: scores(m, learn, pulses) for name, m in models.items()}
    sections = [
        "# EMPS: what Coulomb friction alone misses",
        answer(judged),
        "![Force that the models leave, judged half](improve.svg)\n",
        "## Force residual of every model, frozen",
        text.scores_table(
            ("DATA_EMPS [%]", "judged [%]", "judged, without the end of the filters [%]"), judged
        ),
        *story(both, pulses, "DATA_EMPS and the first half of the pulses"),
        *story(alone, pulses, "DATA_EMPS alone"),
        "## Forward: one step ahead in an observer, and the closed loop simulated",
        text.scores_table(
            (
                "-log likelihood a sample",
                "one step [nm]",
                f"{AHEAD} ms ahead [um]",
                "closed loop, position [um]",
                "closed loop, force [%]",
            ),
            {name: forward(models[name], runs, logs) for name in models if "hold" not in name},
        ),
        LEGEND,
    ]
    write_file(args.out / "improve.svg", still_figures.svg(left_over(models, pulses)))
    write_file(args.out / "improve.md", "\n".join(sections))
    record = improvement_of(*both)
    write_file(args.out / "improve.json", json_text(to_json(record)))
    write_file(args.out / "rig.toml", rig_toml(record.extended_rig))
    print(sections[1])
    return 0


def problems(rig: Rig, training: tuple[Motion, ...]) -> tuple[CalculatedForce, CalculatedForce]:
    """DATA_EMPS alone, and both runs."""
    return calculated_force((), rig, training[:1]), calculated_force((), rig, training)


def final(learned: Learned) -> Fitted:
    """The model with every cause."""
    return Fitted(learned.problem.rig, learned.problem.columns, learned.ladder.extended)


def baselines(learn: Motion, training: tuple[Motion, ...]) -> dict[str, Fitted]:
    """The published structures: as published, learned on as much as ours, and given the hold of the controller."""
    found = {}
    for name, packaged in BASELINES.items():
        rig = load_rig(packaged)
        held = with_values(rig, {"input_delay": load_rig("emps").model["input_delay"]})
        found[f"{name}, published (DATA_EMPS)"] = fitted(rig, (learn,))
        found[f"{name}, refitted on both"] = fitted(rig, training)
        found[f"{name}, hold known (DATA_EMPS)"] = fitted(held, (learn,))
        found[f"{name}, hold known, refitted on both"] = fitted(held, training)
    return found


def fitted(rig: Rig, motions: tuple[Motion, ...]) -> Fitted:
    """A rig's own terms, learned."""
    columns = Columns(rig)
    return Fitted(rig, columns, solve(columns, motions, structure_of(rig, motions)))


def scores(model: Fitted, learn: Motion, pulses: Motion) -> tuple[float, float, float]:
    """Force residual on DATA_EMPS, on the judged half, and on it without the samples where the filters end [per cent]."""
    _, columns, solution = model
    e, y = residual_on(columns, pulses, solution)
    inside = pulses.between(HALF_S, np.inf).use
    whole = judge(columns, solution, learn), judge(columns, solution, pulses, HALF_S)
    return *whole, relative(e[inside], y[inside])


def left_over(models: dict[str, Fitted], pulses: Motion) -> still_figures.Figure:
    """The force of the judged half, and what the published and the extended model leave of it."""
    half = pulses.t >= HALF_S
    curves = []
    for name, colour in DRAWN.items():
        e, force = residual_on(models[name].columns, pulses, models[name].solution)
        curves.append(still_figures.Curve(pulses.t[half], e[half], name, colour))
    return still_figures.force_figure(pulses.t[half], force[half], curves)


def forward(model: Fitted, runs: list[emps.Run], logs: list[Log]) -> tuple[float, ...]:
    """On the judged half, the observer tuned on DATA_EMPS.

    Negative log-likelihood [nats a sample], errors of one step [nm] and AHEAD samples ahead [um]; closed loop, position
    [um] and force [per cent].
    """
    rig, _, solution = model
    run, log = runs[1], logs[1]
    start = int(np.searchsorted(log.t, HALF_S))
    found = predict(rig, solution, log, tune(rig, solution, logs[0], rounds=2), AHEAD)
    servo = PositionServo(run.kp, run.kv, run.gain, emps.LIMIT_V, emps.COUNT_M)
    x, u = closed_loop(rig, solution, log, run.reference, run.pulse, servo)
    off = float(np.sqrt(np.mean((x - run.position)[start:] ** 2)))
    force = relative((u - run.command)[start:], run.command[start:])
    return found.nll(start), 1e9 * found.rms(start), 1e6 * found.rms_ahead(start), 1e6 * off, force


def answer(judged: dict[str, tuple[float, float, float]]) -> str:
    """The first paragraph: the extended model beside every other on the judged half."""
    ours = judged[BOTH][1]
    lines = [
        f"On the second half of the pulses the extended model leaves {ours:.2f} % of the force unexplained."
    ]
    lines += [
        f"- {100 * (ours / score[1] - 1):+.0f} % against: {name} ({score[1]:.2f} %)"
        for name, score in judged.items()
        if name not in (ALONE, BOTH)
    ]
    return "\n".join(lines) + "\n"


def judge(columns: Columns, solution: Solution, motion: Motion, start_s: float = -np.inf) -> float:
    """Force residual of a motion from a time on, relative to the force, under frozen parameters [per cent].

    Every sample counts, those at the end too where the filters end: that is how the published figures are made.
    """
    e, y = residual_on(columns, motion, solution)
    rows = motion.t >= start_s
    return relative(e[rows], y[rows])


def story(learned: Learned, pulses: Motion, learned_on: str) -> list[str]:
    """Causes in order, what only moved, what belongs to one log, what is left, and what was not found."""
    (problem, ladder), record = learned, improvement_of(*learned)
    fits = (ladder.baseline, *ladder.path)
    judged = [judge(problem.columns, one, pulses, HALF_S) for one in fits]
    seen = [relative(held_out(one), one.force) for one in fits]
    return [
        f"## Causes, learned on {learned_on}",
        f"Start: inertia, Coulomb friction and the hold of the controller, {judged[0]:.2f} % on the judged half.\n",
        text.findings_table(record, seen, judged[1:]),
        "To be surer, or to tell rivals apart, record:\n",
        text.separation_list(record),
        text.refit_table(record),
        text.per_log_table(ladder.extended, problem.rig.model["D"]),
        "What the rest of the residual depends on (equation: torque):\n",
        text.unexplained_table(record),
        "Not found (a ΔBIC above zero: the held-out residual fell by less than 3 %):\n",
        text.refused_table(record),
    ]


if __name__ == "__main__":
    sys.exit(main())
