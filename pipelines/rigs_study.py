"""Actuators unlike the paper's, from data sheet to verdict: writes reports/rigs.md.

    python -m pipelines.rigs_study [--rigs 8] [--drives voltage current] [--first 99000] [--out reports/rigs.md]
    python -m pipelines.rigs_study --intervals [--rigs 8] ...     # what `identify` found beside the truth, instead of moves
    python -m pipelines.rigs_study --causes [--rigs 8] ...        # what `improve` named of two campaigns

Each actuator has a data sheet (`rig new`), a healthy campaign (`identify`) and six moves, one a class (`diagnose`). Seeds from
99000 on: none of them was looked at while anything was chosen.
"""

import argparse
import contextlib
import io
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import pandas as pd
from hidden.effects import Effect, effect

from observer_fi.cli import main as command
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve import improve
from observer_fi.learn import identified_rig, identify, with_equation_errors
from observer_fi.logs import filtered_logger, log_from_frame, with_command, with_logger
from observer_fi.physics import Rig, load_rig
from observer_fi.records import Log, Parameter
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.diagnose_study import markdown
from pipelines.study_output import write_study

FIRST_SEED = 99_000
CONFIDENT = 0.95
Z95 = 1.959964
VISCOUS = 0.3  # of the Coulomb friction, at full speed: what is hidden where `improve` is asked
NOT_THERE = {"torque_offset": 0.0, "viscous_positive": 0.0, "brush_drop": 0.0}


class Job(NamedTuple):
    """One actuator: its drive and its seed, and whether its campaign is learned from."""

    drive: str
    seed: int
    learned: bool = True


def judged(job: Job) -> list[dict[str, Any]]:
    """A row a move of one actuator."""
    actuator = hidden.draw_actuator(job.seed, job.drive)
    about = {**job._asdict(), "size": actuator.size, "rate_hz": actuator.logger.rate_hz}
    labels = hidden.FAULTS_DRAWN if job.learned else ("nominal",)
    try:
        rig = _learned(actuator) if job.learned else _from_sheet(actuator)
    except (InvalidLogError, UsageError) as error:
        return [{**about, "label": label, "said": "not learned", "why": str(error)} for label in labels]
    return [{**about, "label": label, **_said(actuator, rig, label)} for label in labels]


def _from_sheet(actuator: hidden.Actuator) -> Rig:
    """The rig file that a user makes of the data sheet."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        with contextlib.redirect_stderr(io.StringIO()) as told:
            if command(["rig", "new", "--to", str(path), "--quiet", *hidden.data_sheet(actuator)]):
                raise UsageError(told.getvalue())
        return load_rig(path)


def _learned(actuator: hidden.Actuator) -> Rig:
    rig = _from_sheet(actuator)
    log = _campaign(actuator, rig)
    fit = identify([log], rig)
    found = identified_rig(fit, rig)
    log = with_command(log, found)
    logged = filtered_logger(with_logger(found, [log]), fit.filters, log.rate_hz)
    return with_equation_errors(logged, [log], fit.filters)


def _campaign(actuator: hidden.Actuator, rig: Rig) -> Log:
    """The healthy campaign that is learned from."""
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), actuator.seed)
    return _read(frame, rig)


def constants(job: Job) -> list[dict[str, Any]]:
    """A row a constant that `identify` finds of one actuator: its truth, whether the interval holds it, the error; one where it
    fails.
    """
    actuator = hidden.draw_actuator(job.seed, job.drive)
    rig = _from_sheet(actuator)
    about = {"drive": job.drive, "seed": job.seed, "rate_hz": actuator.logger.rate_hz}
    truth = {**vars(actuator.rig), **NOT_THERE}
    try:
        found = identify([_campaign(actuator, rig)], rig).parameters
    except (InvalidLogError, UsageError) as error:
        return [{**about, "constant": "none found", "held": False, "why": str(error)}]
    return [{**about, **_beside(p, truth[p.name])} for p in found if p.name in truth]


def _beside(p: Parameter, truth: float) -> dict[str, Any]:
    """A constant beside its truth: the error in standard deviations, and half of the interval in percent."""
    half = max(0.5 * (p.high - p.low), 1e-300)
    return {
        "constant": p.name, "truth": truth, "value": p.value, "low": p.low, "high": p.high, "held": p.low <= truth <= p.high,
        "error": Z95 * (p.value - truth) / half, "half_percent": 100.0 * half / abs(truth) if truth else float("nan"),
    }  # fmt: skip


def intervals(frame: pd.DataFrame) -> str:
    """A row a drive and constant: how often the 95 % interval holds the truth, errors in standard deviations, and widths."""
    rows = [
        {
            "drive": drive, "constant": name, "found": len(g), "interval holds the truth": int(g["held"].sum()),
            "median error [std]": f"{g['error'].median():.2f}", "largest [std]": f"{g['error'].abs().max():.1f}",
            "median half width [%]": f"{g['half_percent'].median():.2g}",
        }
        for (drive, name), g in frame.groupby(["drive", "constant"], sort=False)
    ]  # fmt: skip
    held = frame.groupby("drive", sort=False)["held"]
    total = ", ".join(f"{drive} {int(one.sum())} of {len(one)}" for drive, one in held)
    return "\n".join(
        [
            "## Intervals of `identify`",
            "",
            f"Hold the truth: {total}.",
            "",
            markdown(pd.DataFrame(rows).set_index("drive")),
            "",
        ]
    )


def causes(job: Job) -> list[dict[str, Any]]:
    """What `improve` names of two campaigns of one actuator, with the rig learned from the healthy one: of that, and of one with
    viscous friction, `VISCOUS` of the Coulomb friction at full speed.
    """
    actuator = hidden.draw_actuator(job.seed, job.drive)
    size = VISCOUS * actuator.rig.A / actuator.speed
    both = {"none": (), "viscous_friction": (effect("viscous_friction", plus=size, minus=size),)}
    about = {"drive": job.drive, "seed": job.seed, "rate_hz": actuator.logger.rate_hz}
    try:
        rig = _learned(actuator)
        return [
            {**about, "hidden": name, **_improved(actuator, rig, effects, size)}
            for name, effects in both.items()
        ]
    except (InvalidLogError, UsageError) as error:
        return [{**about, "hidden": "none", "named": "refused", "why": str(error)}]


def _improved(
    actuator: hidden.Actuator, rig: Rig, effects: tuple[Effect, ...], size: float
) -> dict[str, Any]:
    """Names and sizes on one campaign, and nats a sample over the noise before and after."""
    spec = replace(hidden.healthy_spec(actuator), effects=effects)
    frame, _ = hidden.actuator_log(actuator, spec, actuator.seed)
    begun = time.process_time()
    found = improve([_read(frame, rig)], rig)
    values = [v.value for f in found.findings for n, v in f.parameters.items() if n.startswith("viscous")]
    floor = found.extended.noise_floor_nll
    return {
        "named": " + ".join(f.cause for f in found.findings) or "none",
        "unexplained": ", ".join(f"{u.equation} over {u.regressor}" for u in found.unexplained),
        "size_percent": 100.0 * (max(values, key=lambda v: abs(v - size)) / size - 1.0) if values and effects else float("nan"),
        "before": found.baseline.nll_per_sample - floor, "after": found.extended.nll_per_sample - floor,
        "cpu_s": time.process_time() - begun,
    }  # fmt: skip


def named(frame: pd.DataFrame, first: int) -> str:
    """A row a campaign, and how many have their right names alone."""
    right = frame["named"] == frame["hidden"]
    total = ", ".join(
        f"{drive} with {what}: {int(right[g.index].sum())} of {len(g)}"
        for (drive, what), g in frame.groupby(["drive", "hidden"], sort=False)
    )
    shown = frame.assign(
        **{n: frame[n].map("{:.3g}".format) for n in ("size_percent", "before", "after", "cpu_s")}
    )
    return "\n".join(
        [
            "# What `improve` names of other actuators", "",
            f"Right and alone: {total}.", "",
            f"Made by `pipelines/rigs_study.py --causes`, seeds from {first} on. The rig is learned from a healthy campaign;",
            f"viscous friction: {VISCOUS} of the Coulomb friction at full speed. size_percent: by how much the worse of its two",
            "sizes is off. before, after: nats a sample over the noise.",
            "", markdown(shown.set_index("drive")), "",
        ]
    )  # fmt: skip


def _read(frame: pd.DataFrame, rig: Rig) -> Log:
    return with_command(log_from_frame(frame), rig)


def _said(actuator: hidden.Actuator, rig: Rig, label: str) -> dict[str, Any]:
    """The verdict on one move."""
    spec = hidden.fault_spec(actuator, label, actuator.seed)
    frame, truth = hidden.actuator_log(actuator, spec, actuator.seed + 1)
    try:
        outcome = diagnose_log(_read(frame, rig), rig, Settings())
    except (InvalidLogError, UsageError) as error:
        return {"said": "no verdict", "why": str(error)}
    if outcome.isolation is None:
        return {"said": "no verdict"}
    verdict = outcome.isolation.verdict
    named = verdict.label == label and truth["channel"] in (None, verdict.channel)
    return {
        "said": verdict.label, "channel": verdict.channel, "probability": verdict.probability, "kind": truth["kind"],
        "right": named or label in verdict.alike, "onset_s": truth["onset_s"], "said_s": verdict.onset_s,
        "nis": outcome.isolation.consistency.nis_mean,
    }  # fmt: skip


def study(jobs: Iterable[Job], workers: int) -> pd.DataFrame:
    """The rows of all jobs."""
    with ProcessPoolExecutor(workers) as pool:
        parts = list(pool.map(judged, jobs) if workers > 1 else map(judged, jobs))
    frame = pd.DataFrame([row for part in parts for row in part])
    frame["right"] = frame["right"].eq(True)
    frame["confident"] = ~frame["right"] & (frame["probability"].astype(float) > CONFIDENT)
    return frame


def by(frame: pd.DataFrame, *keys: str) -> str:
    """A table with a row a group: right, confident and wrong, and what was said in place of the right label."""
    rows = []
    for group, g in frame.groupby(list(keys), sort=False):
        said = g.loc[~g["right"], "said"].value_counts()
        rows.append({
            **dict(zip(keys, group, strict=True)), "moves": len(g), "right": int(g["right"].sum()),
            "confident and wrong": int(g["confident"].sum()),
            "said otherwise": ", ".join(f"{label} {count}" for label, count in said.items()),
        })  # fmt: skip
    return markdown(pd.DataFrame(rows).set_index(keys[0]))


def summary(frame: pd.DataFrame, first: int) -> str:
    """The report."""
    learned, sheets = frame[frame["learned"]], frame[~frame["learned"]]
    lines = [
        "# Other actuators, from data sheet to verdict", "",
        f"Right: {int(learned['right'].sum())} of {len(learned)} moves. Confident (above {CONFIDENT}) and wrong: "
        f"{int(learned['confident'].sum())}.", "",
        "Made by `pipelines/rigs_study.py` from the independent truth of tests/hidden/rigs.py, seeds from "
        f"{first} on: motors of 1 W to 1 kW,",
        "gears of 1 to 100, leads of 1 to 20 mm, travels of 5 mm to 1 m, 100 to 4800 samples a second. The user knows the data "
        "sheet to 5 %,",
        "guesses the friction within a factor of two or not at all, runs `rig new`, `identify` on one healthy campaign of ten "
        "moves, and",
        "`diagnose` on six moves, one a class. Right: the label (of a sensor the channel, too), or one that the verdict declares "
        "alike.", "",
        "## By drive", "", by(learned, "drive"), "", "## By drive and size of the motor", "", by(learned, "drive", "size"), "",
        "## By drive and samples a second", "", by(learned, "drive", "rate_hz"), "", "## By drive and fault", "",
        by(learned, "drive", "label"), "",
    ]  # fmt: skip
    if len(sheets):
        lines += [
            "## Healthy moves with the rig file of the data sheet, before `identify`",
            "",
            by(sheets, "drive"),
            "",
        ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rigs", type=int, default=8, help="actuators of each drive")
    parser.add_argument("--drives", nargs="*", default=hidden.DRIVEN_BY, choices=hidden.DRIVEN_BY)
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument(
        "--sheets", action="store_true", help="healthy moves with the unlearned rig file, too"
    )
    parser.add_argument("--intervals", action="store_true", help="constants that `identify` finds, not moves")
    parser.add_argument("--causes", action="store_true", help="what `improve` names of campaigns, not moves")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="where to write a row a move, as CSV")
    parser.add_argument("--out", type=Path, default=Path("reports/rigs.md"))
    options = parser.parse_args(arguments)
    jobs = [Job(drive, options.first + k) for drive in options.drives for k in range(options.rigs)]
    if options.intervals:
        found = pd.DataFrame([row for job in jobs for row in constants(job)])
        return write_study(found, intervals(found), options.rows, options.out)
    if options.causes:
        with ProcessPoolExecutor(options.workers) as pool:
            frame = pd.DataFrame([row for rows in pool.map(causes, jobs) for row in rows])
        return write_study(frame, named(frame, options.first), options.rows, options.out)
    jobs += [job._replace(learned=False) for job in jobs] if options.sheets else []
    frame = study(jobs, options.workers)
    return write_study(frame, summary(frame, options.first), options.rows, options.out)


if __name__ == "__main__":
    raise SystemExit(main())
