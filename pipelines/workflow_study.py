"""From a campaign to verdicts, all through one logger as it is: writes reports/workflow.md.

    python -m pipelines.workflow_study [--seeds 2] [--traits hum_50hz noise_3+steps_all] [--out reports/workflow.md]

Each logger records a healthy campaign of a rig of the paper's spread. `identify` and `improve` learn from it, and three
new moves of the same rig, one a class, are judged with what each of them wrote. A second campaign hides a cause at three
times the size that shows on an ideal logger. Seeds from 400000 on: none of them was looked at while anything was chosen.
"""

import argparse
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import numpy as np
import pandas as pd

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve import Improvement, improve
from observer_fi.learn import identified_rig, identify, with_equation_errors
from observer_fi.logs import log_from_frame, with_command, with_logger
from observer_fi.physics import Rig, load_rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.diagnose_study import markdown

FIRST_SEED = 400_000
CLASSES = ("nominal", "overload", "coupling_loss")
EVERY = (*hidden.TRAITS, *hidden.PAIRS, *hidden.TRIPLES)
CONFIDENT = 0.95
# What these loggers do is a cause with a name, and no false finding.
NAMED = {
    "voltage_late": ("voltage_delay",),
    "position_late": ("position_delay",),
    "position_averaged": ("position_delay",),
    "offsets": ("current_offset", "voltage_offset", "torque_offset"),
}
SIZE = 3.0  # of a hidden cause, in units of the one that shows on an ideal logger


class Job(NamedTuple):
    """One rig behind one logger, and the cause that its second campaign hides."""

    trait: str
    seed: int
    cause: str


def jobs_of(traits: Iterable[str], seeds: int, first: int) -> list[Job]:
    """Every logger with as many rigs, all of them different; the causes take turns, so that each meets many loggers."""
    names, causes = list(traits), list(hidden.CAUSES)
    return [Job(name, first + k, causes[k % len(causes)]) for k, name in enumerate(names * seeds)]


def judged(job: Job) -> list[dict[str, Any]]:
    """A row for each verdict on a new move, and one for each campaign that `improve` was asked about."""
    began = time.process_time()
    campaign = hidden.draw_effects_case(job.seed, (), 0.0)
    log = _recorded(job.trait, campaign, job.seed, job.seed)
    control = improve([log], load_rig())
    rigs = {
        "rig file": load_rig,
        "identify": lambda: _identified(log),
        "improve": lambda: control.extended_rig,
    }
    named = tuple(name for trait in job.trait.split("+") for name in NAMED.get(trait, ()))
    rows = [_found("control", control, None, named)]
    for name, learned in rigs.items():
        rows += list(_moves(job, campaign.rig, name, learned()))
    spoiled = hidden.draw_effects_case(job.seed, (job.cause,), SIZE)
    record = improve([_recorded(job.trait, spoiled, job.seed, job.seed)], load_rig())
    rows.append(_found("hidden", record, job.cause, named))
    return [{**job._asdict(), **row, "cpu_s": time.process_time() - began} for row in rows]


def _recorded(trait: str, spec: hidden.TruthSpec, logger: int, noise: int) -> Log:
    """A log of the spec. logger: the seed that draws the sizes of its traits, noise: that of what is recorded."""
    frame, _ = hidden.make_log_through(hidden.acquisition_of(trait, spec, logger), spec, noise)
    return with_command(log_from_frame(frame), load_rig())


def _identified(log: Log) -> Rig:
    rig = load_rig()
    return with_equation_errors(with_logger(identified_rig(identify([log], rig), rig), [log]), [log])


def _moves(job: Job, truth: hidden.Rig, name: str, rig: Rig) -> Iterator[dict[str, Any]]:
    """Verdicts on three new moves of the rig behind the logger that recorded its campaign."""
    for k, label in enumerate(CLASSES):
        seed = job.seed * 10 + k
        spec = replace(hidden.draw_move_case(seed, label), rig=truth)
        pitch = spec.profile.pitch_steps[0][1]
        integral = hidden.draw_rest_integral(np.random.default_rng([seed, 19]), truth, pitch)
        log = _recorded(job.trait, replace(spec, start_integral_rad=integral), job.seed, seed)
        yield {"of": name, "label": label, **_said(log, rig, label)}


def _said(log: Log, rig: Rig, label: str) -> dict[str, Any]:
    try:
        outcome = diagnose_log(log, rig, Settings()).isolation
    except (InvalidLogError, UsageError) as error:
        return {"said": f"refused: {error}", "right": False, "confident": False}
    if outcome is None:
        return {"said": "no verdict", "right": False, "confident": False}
    verdict = outcome.verdict
    right = label in (verdict.label, *verdict.alike)
    return {"said": verdict.label, "right": right, "confident": not right and verdict.probability > CONFIDENT}


def _found(of: str, record: Improvement, cause: str | None, named: tuple[str, ...] = ()) -> dict[str, Any]:
    """What `improve` found: right where that is nothing, or the hidden cause first or in the first's declared set.

    named: causes that are the logger's own, which may stand beside.
    """
    sets = [
        (f.cause, *f.indistinguishable_from)
        for f in record.findings
        if f.cause not in named or f.cause == cause
    ]
    left = [f"{u.equation} by {u.regressor}" for u in record.unexplained]
    said = "; ".join([*("/".join(names) for names in sets), *left])
    right = not said if cause is None else bool(sets) and cause in sets[0]
    wrong_name = bool(sets) and (cause is None or not any(cause in names for names in sets))
    return {
        "of": of,
        "label": cause or "nothing",
        "said": said or "nothing",
        "right": right,
        "confident": wrong_name,
    }


def study(jobs: Iterable[Job], workers: int, rows: Path) -> pd.DataFrame:
    """The rows of all jobs, written to `rows` as they come."""
    done: list[dict[str, Any]] = []
    with ProcessPoolExecutor(workers) as pool:
        for future in as_completed([pool.submit(judged, job) for job in jobs]):
            done += future.result()
            pd.DataFrame(done).to_csv(rows, index=False)
    return pd.DataFrame(done)


def table(frame: pd.DataFrame, key: str, otherwise: bool = True) -> str:
    """A row a group of `key`: right of all by what was learned, and what was said in place of the right answer if asked for."""
    rows = []
    for group, part in frame.groupby(key, sort=False):
        wrong = part[~part["right"]]
        said = "; ".join(f"{row.of}, {row.label}: {row.said}" for row in wrong.itertuples())
        rows.append({
            key: group, **{str(of): f"{int(g['right'].sum())} of {len(g)}" for of, g in part.groupby("of", sort=False)},
            "confident and wrong": int(wrong["confident"].sum()), **({"said otherwise": said} if otherwise else {}),
        })  # fmt: skip
    return markdown(pd.DataFrame(rows).fillna("").set_index(key))


def summary(frame: pd.DataFrame) -> str:
    """The report."""
    seeds = f"{frame['seed'].min()} to {frame['seed'].max()}"
    frame = frame.assign(
        logger=np.where(frame["trait"].isin(hidden.TRAITS), "one trait", "pairs and triples")
    )
    cpu = frame.groupby(["trait", "seed"])["cpu_s"].max().median()
    return "\n".join([
        "# From a campaign to verdicts, through one logger", "",
        f"Made by `pipelines/workflow_study.py`, seeds {seeds}: {frame['trait'].nunique()} loggers of tests/hidden/loggers.py,",
        "each before rigs of the paper's spread. *Rig file*, *identify*, *improve*: three new moves a rig, one a class, judged",
        "with Table 1 and with what these commands wrote of a healthy campaign of 25 s through the same logger (right: named or",
        "declared alike). *Control*: `improve` finds nothing on that campaign but what the logger does and has a name",
        "(an offset, a late voltage). *Hidden*: a cause at three times the size that",
        "shows on an ideal logger is found first, or in the first's declared set; loggers with more noise show less. Confident",
        f"and wrong: a label above {CONFIDENT}, or a finding whose set has no hidden cause. {cpu:.0f} CPU-seconds a rig.", "",
        "## All", "", table(frame, "logger", otherwise=False), "", "## By logger", "", table(frame, "trait"), "",
    ])  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="rigs behind each logger")
    parser.add_argument("--traits", nargs="*", default=EVERY, help="names of traits, or several joined by +")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--rows", type=Path, default=Path("reports/workflow_study.csv"), help="a row a verdict, as CSV"
    )
    parser.add_argument("--out", type=Path, default=Path("reports/workflow.md"))
    options = parser.parse_args(arguments)
    frame = study(jobs_of(options.traits, options.seeds, options.first), options.workers, options.rows)
    options.out.write_text(summary(frame), encoding="utf-8")
    print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
