"""One actuator on other days: false alarms and right verdicts in everyday surroundings, writes reports/surroundings.md.

    python -m pipelines.surroundings_study [--healthy 6] [--faulty 4] [--kinds "winding 30 K warmer" ...] [--learn "usual" ...]

Moves of the paper's rig, another draw of it a kind, in each of the surroundings of tests/hidden/surroundings.py: with the rig
file alone, and with the rig that `identify` makes of three healthy campaigns (a usual day, one half way, one in these).
Seeds from 96000 on: none of them was looked at while anything was chosen.
"""

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import numpy as np
import pandas as pd

from observer_fi.learn import identified_rig, identify, with_equation_errors
from observer_fi.logs import log_from_frame, with_logger
from observer_fi.physics import NOMINAL, Rig, load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.diagnose_study import markdown
from pipelines.study_output import write_study

FIRST_SEED = 96_000
FAULTS_IN_TURN = ("overload", "coupling_loss")
CONFIDENT = 0.95
ALONE = "rig file alone"


class Job(NamedTuple):
    """Surroundings by name, the seed of their actuator, how many moves."""

    kind: str
    seed: int
    healthy: int
    faulty: int
    learned: bool


def learned_rig(kind: str, seed: int) -> Rig:
    """What `identify` makes of three healthy campaigns of the actuator of a seed."""
    rig = load_rig()
    logs = [log_from_frame(frame) for frame in hidden.healthy_days(hidden.SURROUNDINGS[kind], seed)]
    return with_equation_errors(with_logger(identified_rig(identify(logs, rig), rig), logs), logs)


def judged(job: Job) -> list[dict[str, Any]]:
    """A row a move and rig file."""
    rigs = {ALONE: load_rig()}
    if job.learned:
        rigs["three healthy logs"] = learned_rig(job.kind, job.seed)
    labels = [NOMINAL] * job.healthy + [FAULTS_IN_TURN[k % len(FAULTS_IN_TURN)] for k in range(job.faulty)]
    rows = []
    for k, label in enumerate(labels):
        frame, truth = _move(job, label, job.seed + 10 + k)
        log = log_from_frame(frame)
        for name, rig in rigs.items():
            rows.append({"kind": job.kind, "rig": name, "label": label, **_said(log, rig, label, truth)})
    return rows


def _move(job: Job, label: str, seed: int) -> tuple[pd.DataFrame, dict]:
    """A move of the actuator of the job, on the day of its surroundings."""
    rig = hidden.draw_rig(np.random.default_rng([job.seed, 18]))
    spec = replace(hidden.draw_move_case(seed, label), rig=rig)
    return hidden.log_in(hidden.SURROUNDINGS[job.kind], spec, seed)


def _said(log: Any, rig: Rig, label: str, truth: dict) -> dict[str, Any]:
    found = diagnose_log(log, rig, Settings()).isolation
    if found is None:
        return {"said": "no verdict", "right": False, "confident": False, "delay_ms": np.nan}
    verdict = found.verdict
    right = verdict.label == label or label in verdict.alike
    onset, isolated = truth["onset_s"], verdict.isolated_s
    delay = 1e3 * (isolated - onset) if right and onset is not None and isolated is not None else np.nan
    return {
        "said": verdict.label, "right": right, "confident": not right and verdict.probability > CONFIDENT, "delay_ms": delay,
    }  # fmt: skip


def study(jobs: Iterable[Job]) -> pd.DataFrame:
    """The rows of all jobs."""
    return pd.DataFrame([row for job in jobs for row in judged(job)])


def table(frame: pd.DataFrame) -> str:
    """A row a kind and rig file: false alarms on healthy moves, faults told, and what was said otherwise."""
    rows = []
    for (kind, rig), part in frame.groupby(["kind", "rig"], sort=False):
        healthy, faulty = part[part["label"] == NOMINAL], part[part["label"] != NOMINAL]
        wrong = part[~part["right"]]["said"].value_counts()
        rows.append({
            "surroundings": kind, "rig": rig, "healthy moves": len(healthy), "false alarms": int((~healthy["right"]).sum()),
            "faulty moves": len(faulty), "right": int(faulty["right"].sum()), "confident and wrong": int(part["confident"].sum()),
            "said otherwise": ", ".join(f"{said} {n}" for said, n in wrong.items()),
        })  # fmt: skip
    return markdown(pd.DataFrame(rows).set_index("surroundings"))


def totals(frame: pd.DataFrame) -> str:
    """A row a rig file, with the median delays from onset to isolation."""
    rows = []
    for rig, part in frame.groupby("rig", sort=False):
        healthy = part[part["label"] == NOMINAL]
        late = {f: part.loc[part["label"] == f, "delay_ms"].median() for f in FAULTS_IN_TURN}
        rows.append({
            "rig": rig, "moves": len(part), "right": int(part["right"].sum()), "healthy moves": len(healthy),
            "false alarms": int((~healthy["right"]).sum()), "confident and wrong": int(part["confident"].sum()),
            **{f"{name}, median delay [ms]": f"{value:.3g}" for name, value in late.items()},
        })  # fmt: skip
    return markdown(pd.DataFrame(rows).set_index("rig"))


def summary(frame: pd.DataFrame, first: int) -> str:
    """The report."""
    learned = frame.loc[frame["rig"] != ALONE, "kind"].unique()
    each = frame.groupby(["kind", "rig"]).size().max()
    lines = [
        "# Everyday surroundings", "",
        f"Made by `pipelines/surroundings_study.py`, seeds from {first} on, at most {each} moves a kind: few, for what a machine",
        "of two cores can do; a kind without a false alarm here may still have one in ten. The truth is that of",
        "tests/hidden/surroundings.py: the paper's rig, drawn anew for each kind, on another day.",
        "*Three healthy logs*: what `identify` makes of campaigns on a usual day, half way, and in these surroundings.", "",
        "## All surroundings, with the rig file alone", "", totals(frame[frame["rig"] == ALONE]), "",
        "## Those in which three healthy logs were learned too", "",
        totals(frame[frame["kind"].isin(learned)]) if len(learned) else "None in this run.", "",
        "## By surroundings", "", table(frame), "",
    ]  # fmt: skip
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--healthy", type=int, default=6, help="healthy moves of a kind")
    parser.add_argument("--faulty", type=int, default=4, help="faulty moves of a kind")
    parser.add_argument("--kinds", nargs="*", default=list(hidden.SURROUNDINGS), choices=hidden.SURROUNDINGS)
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument(
        "--learn", nargs="*", default=list(hidden.SURROUNDINGS), help="kinds for which three logs are learned"
    )
    parser.add_argument("--rows", type=Path, help="where to write a row a move, as CSV")
    parser.add_argument("--out", type=Path, default=Path("reports/surroundings.md"))
    options = parser.parse_args(arguments)
    kinds = list(hidden.SURROUNDINGS)
    jobs = [
        Job(
            kind,
            options.first + 100 * kinds.index(kind),
            options.healthy,
            options.faulty,
            kind in options.learn,
        )
        for kind in options.kinds
    ]
    frame = study(jobs)
    return write_study(frame, summary(frame, options.first), options.rows, options.out)


if __name__ == "__main__":
    raise SystemExit(main())
