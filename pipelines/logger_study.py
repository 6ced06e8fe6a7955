"""Verdicts through loggers as they are, and on sensors that fail: writes reports/loggers.md.

    python -m pipelines.logger_study [--moves 60] [--traits hum_50hz noise_3+steps_all] [--failing 12] [--campaigns 500]
    [--combined 1000] [--crossed 400] [--out reports/loggers.md]

Seeds from 90000 on: none of them was looked at while thresholds were set.
"""

import argparse
import math
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import numpy as np
import pandas as pd

from observer_fi.errors import InvalidLogError
from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.diagnose_study import markdown
from pipelines.logger_study_found import found

FIRST_SEED = 90_000
CLASSES = ("nominal", "overload", "coupling_loss")
CONFIDENT = 0.95
EVERY = (*hidden.TRAITS, *hidden.PAIRS, *hidden.TRIPLES)


CAMPAIGN = "campaign"
COMBINED = "combined"
CROSSED = ("on another day", "of any size", "a failing sensor")
TOGETHER = (2, 5)  # traits at once: from so many to fewer than so many
EITHER = ("no_voltage", "no_command")  # nothing is left to tell the command from without both


class Job(NamedTuple):
    """One move: the traits of its logger, its class, its seed; of a failing sensor what `draw_failing_case` takes.

    Of the kind `COMBINED` a logger with several traits, drawn at random. Or, of the kind `CAMPAIGN`, a healthy campaign: starts
    and stops at three speeds and three pitches, reversals, rests. crossed: of `CROSSED`, what else is drawn; kind is then the
    day, the fault of any size, or how the sensor fails.
    """

    trait: str
    label: str
    seed: int
    kind: str = ""
    channel: str = ""
    factor: float = 1.0
    crossed: str = ""


NO_VERDICT = {
    "said": "no verdict", "said_channel": "", "named": False, "alike": "", "probability": 0.0, "right": False,
    "delay_ms": None,
}  # fmt: skip


def judged(job: Job) -> dict[str, Any]:
    """Truth and verdict of one move, as a row."""
    frame, truth = hidden.make_log_with(job.trait, _spec(job), job.seed)
    try:
        outcome = diagnose_log(log_from_frame(frame), load_rig(), Settings())
    except InvalidLogError:  # a command that cannot be recovered
        return {**job._asdict(), "missed": None, **NO_VERDICT}
    acquisition = getattr(outcome, "acquisition", None)
    missed = None if acquisition is None else found(truth["acquisition"], acquisition)
    return {**job._asdict(), "missed": missed, **_said(job, outcome, truth, frame["time_s"].iloc[0])}


def _spec(job: Job) -> hidden.TruthSpec:
    if job.kind == CAMPAIGN:
        return hidden.draw_effects_case(job.seed, (), 0.0)
    if job.crossed == CROSSED[0]:
        spec, rng = hidden.draw_move_case(job.seed, job.label), np.random.default_rng([job.seed, 17])
        return hidden.SURROUNDINGS[job.kind].change(spec, 1.0, rng)
    if job.crossed == CROSSED[1]:
        return hidden.draw_severity_case(job.seed, job.kind)
    if job.label == "sensor_fault":
        return hidden.draw_failing_case(job.seed, job.kind, job.channel, job.factor)
    return hidden.draw_move_case(job.seed, job.label)


def _said(job: Job, outcome: Outcome, truth: dict[str, Any], first_s: float) -> dict[str, Any]:
    """The verdict, and how long after the fault, or the log, had begun [ms] it was there."""
    if outcome.isolation is None:
        return NO_VERDICT
    verdict = outcome.isolation.verdict
    named = verdict.label == job.label and (not job.channel or verdict.channel == job.channel)
    onset, isolated = truth["onset_s"], verdict.isolated_s
    return {
        "said": verdict.label, "said_channel": verdict.channel or "", "named": named, "alike": " ".join(verdict.alike),
        "probability": verdict.probability, "right": named or job.label in verdict.alike,
        "delay_ms": 1e3 * (isolated - max(onset, first_s)) if named and onset is not None and isolated is not None else None,
    }  # fmt: skip


def study(
    jobs: Iterable[Job], workers: int, rows: Path | None = None, until: float = math.inf
) -> pd.DataFrame:
    """The rows of all jobs begun before `until` [s of `time.monotonic`], each written to `rows` as it comes."""
    done: list[dict[str, Any]] = []
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(judged, jobs, chunksize=4) if workers > 1 else map(judged, jobs):
            done.append(row)
            if rows:
                pd.DataFrame([row]).to_csv(
                    rows, mode="w" if len(done) == 1 else "a", header=len(done) == 1, index=False
                )
            if time.monotonic() > until:
                break
    return pd.DataFrame(done)


def trait_jobs(traits: Iterable[str], moves: int, first: int) -> list[Job]:
    """`moves` a trait, a third of each class; one move through every trait before the next, so that a cut run tells of all."""
    traits = list(traits)
    return [Job(trait, CLASSES[k % len(CLASSES)], first + k) for k in range(moves) for trait in traits]


def failing_jobs(moves: int, factor: float, first: int, behind: str = "ideal") -> list[Job]:
    """`moves` for each way in which each sensor fails, through the logger `behind` it."""
    return [
        Job(behind, "sensor_fault", first + k, kind, channel, factor)
        for k in range(moves)
        for kind in hidden.FAILURES
        for channel in hidden.CHANNELS
    ]


def campaign_jobs(campaigns: int, first: int) -> list[Job]:
    """Healthy campaigns through the loggers that leave the information in, which take turns."""
    keeps = [name for name in EVERY if hidden.trait_of(name).keeps]
    return [Job(keeps[k % len(keeps)], "nominal", first + k, CAMPAIGN) for k in range(campaigns)]


def combined_jobs(moves: int, first: int) -> list[Job]:
    """Moves through loggers that do several things at once, drawn from those that leave the information in."""
    keeps = [name for name in hidden.TRAITS if hidden.trait_of(name).keeps and name != "ideal"]
    jobs = []
    for seed in range(first, first + moves):
        rng = np.random.default_rng([seed, 13])
        drawn = rng.choice(keeps, int(rng.integers(*TOGETHER)), replace=False).tolist()
        kept = [name for name in drawn if name != EITHER[1] or EITHER[0] not in drawn]
        jobs.append(Job("+".join(kept), CLASSES[seed % len(CLASSES)], seed, COMBINED))
    return jobs


def crossed_jobs(moves: int, first: int) -> list[Job]:
    """Moves through one trait that leaves the information in, on another day, with a fault of any size or a failing sensor.

    What a study of its own holds still for each of these: what is healthy through any logger, and on any day, must be so through
    any logger on any day.
    """
    keeps = [name for name in hidden.TRAITS if hidden.trait_of(name).keeps]
    days = [name for name, day in hidden.SURROUNDINGS.items() if not day.late_s]
    jobs = []
    for seed in range(first, first + moves):
        rng, crossed = np.random.default_rng([seed, 14]), CROSSED[seed % len(CROSSED)]
        trait = str(rng.choice(keeps))
        if crossed == CROSSED[0]:
            label, kind, channel = CLASSES[seed // 3 % len(CLASSES)], str(rng.choice(days)), ""
        elif crossed == CROSSED[1]:
            kind, channel = str(rng.choice(hidden.SEVERITY_KINDS)), ""
            label = hidden.draw_severity_case(seed, kind).fault.label
        else:
            label, kind = "sensor_fault", str(rng.choice(list(hidden.FAILURES)))
            channel = str(rng.choice(hidden.CHANNELS[1 if trait == EITHER[0] else 0 :]))
        jobs.append(Job(trait, label, seed, kind, channel, 3.0, crossed))
    return jobs


def of_crossed(frame: pd.DataFrame) -> str:
    """How many crossed moves were told right, by what was crossed, and what was said of the others."""
    lines = []
    for crossed, g in frame.groupby("crossed", sort=False):
        wrong = g[~g["right"].astype(bool)]
        said = ", ".join(
            f"{row.trait} {row.kind} {row.channel} {row.label} {row.seed}: {row.said} {row.probability:.3g}"
            for row in wrong.itertuples()
        )
        sure = int((wrong["probability"] > CONFIDENT).sum())
        lines.append(
            f"- {crossed}: {len(g) - len(wrong)} of {len(g)} right, {sure} confident and wrong. {said}".strip()
        )
    return "\n".join(lines)


def of_combined(frame: pd.DataFrame) -> str:
    """How many moves through loggers drawn at random were told right, and what was said of the others."""
    wrong = frame[~frame["right"].astype(bool)]
    sure = int((wrong["probability"] > CONFIDENT).sum())
    said = ", ".join(
        f"{row.trait} {row.label} {row.seed}: {row.said} {row.probability:.3g}" for row in wrong.itertuples()
    )
    return f"{len(frame) - len(wrong)} of {len(frame)} right, {sure} confident and wrong. {said}".strip()


def of_campaigns(frame: pd.DataFrame) -> str:
    """How many healthy campaigns were called anything else, and what through which logger."""
    alarms = frame[frame["said"] != "nominal"]
    said = ", ".join(f"{row.trait}: {row.said} {row.probability:.3g}" for row in alarms.itertuples())
    moves = len(hidden.draw_effects_case(0, (), 0.0).profile.moves)
    return f"{len(alarms)} of {len(frame)} campaigns of {moves} moves each are called anything but nominal. {said}".strip()


def by_trait(frame: pd.DataFrame) -> pd.DataFrame:
    """One row a trait: what was said, and what was found of the logger."""
    rows = {}
    for trait, g in frame.groupby("trait", sort=False):
        told = hidden.trait_of(str(trait))
        healthy = g[g["label"] == "nominal"]
        confident = ~g["right"] & (g["probability"] > CONFIDENT)
        rows[trait] = {
            "logger": told.words + ("" if told.keeps else " (hides)"), "moves": len(g), "right": int(g["right"].sum()),
            "delay median ms": g["delay_ms"].astype(float).median(),
            "false alarms": f"{int((healthy['said'] != 'nominal').sum())} of {len(healthy)}",
            "confident and wrong": int(confident.sum()), "said otherwise": _counts(g.loc[~g["right"], "said"]),
            "logger found": _found(g["missed"]),
        }  # fmt: skip
    return pd.DataFrame(rows).T.rename_axis("trait")


def by_failure(frame: pd.DataFrame) -> pd.DataFrame:
    """One row a way to fail and channel: whether it was named, and what a fault of the actuator was blamed."""
    rows = []
    for (kind, channel), g in frame.groupby(["kind", "channel"], sort=False):
        blamed = g["said"].isin(["coupling_loss", "overload"]) & (g["probability"] > CONFIDENT)
        others = g["said"].str.cat(g["said_channel"], sep=" ").str.strip()[~g["named"]]
        rows.append({
            "kind": kind, "channel": channel, "moves": len(g), "right": int(g["right"].sum()),
            "by name and channel": int(g["named"].sum()),
            "delay median ms": g["delay_ms"].astype(float).median(), "actuator blamed with more than 0.95": int(blamed.sum()),
            "said otherwise": _counts(others),
        })  # fmt: skip
    return pd.DataFrame(rows).set_index("kind")


def _counts(said: pd.Series) -> str:
    return ", ".join(f"{label} {count}" for label, count in said.value_counts().items())


def _found(missed: pd.Series) -> str:
    """In how many logs nothing was missed, and what was in the others."""
    known = missed.dropna()
    if known.empty:
        return ""
    whole = f"{int((known == '').sum())} of {len(known)}"
    items = _counts(known[known != ""].str.split("; ").explode())
    return f"{whole}; not: {items}" if items else whole


def summary(frame: pd.DataFrame, first: int, factor: float) -> str:
    """The report."""
    campaigns = frame[frame["kind"] == CAMPAIGN]
    combined, crossed = frame[frame["kind"] == COMBINED], frame[frame["crossed"] != ""]
    moves = frame[~frame["kind"].isin([CAMPAIGN, COMBINED]) & (frame["crossed"] == "")]
    through, failing = moves[moves["label"] != "sensor_fault"], moves[moves["label"] == "sensor_fault"]
    keeps = through["trait"].map(lambda name: hidden.trait_of(name).keeps).astype(bool)
    wrong = ~through["right"] & (through["probability"] > CONFIDENT)
    right = f"{int(through.loc[keeps, 'right'].sum())} of {int(keeps.sum())}"
    sizes = ", ".join(f"{kind} {factor * size:g}" for kind, size in hidden.FAILING_SIGMAS.items())
    lines = (
        "# Loggers as they are, sensors as they fail", "",
        f"Right through loggers that leave the information in: {right} moves. Confident (above {CONFIDENT}) and wrong:",
        f"{int(wrong.sum())} of {len(through)}.", "",
        "Made by `pipelines/logger_study.py` from the independent truth of tests/hidden (the paper's size and spread of faults,",
        f"the rig file of Table 1) with the loggers of tests/hidden/loggers.py, seeds from {first} on. Right: the label, or one",
        "that the verdict declares alike. Delay: of verdicts with the right name, from the fault's onset or the log's begin to a",
        "posterior above 0.95 for good. Logger found: noise, steps, holds and lines as they were, and nothing that was not.", "",
        "## By logger", "", markdown(by_trait(through)) if len(through) else "", "",
        f"## Failing sensors, {', '.join(failing['trait'].unique()) or 'no'} logger", "",
        f"Sizes in sigmas of the channel's noise: {sizes}.", "",
        markdown(by_failure(failing)) if len(failing) else "", "",
        "## Several at once, drawn at random", "", of_combined(combined) if len(combined) else "", "",
        "## Another day, any size, a failing sensor, each through one trait", "", of_crossed(crossed) if len(crossed) else "", "",
        "## Healthy campaigns", "", of_campaigns(campaigns) if len(campaigns) else "", "",
    )  # fmt: skip
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=60, help="moves through each logger")
    parser.add_argument("--traits", nargs="*", default=EVERY, help="names of traits, or several joined by +")
    parser.add_argument(
        "--failing", type=int, default=12, help="moves for each way in which each sensor fails"
    )
    parser.add_argument(
        "--campaigns", type=int, default=500, help="healthy campaigns, through every logger in turn"
    )
    parser.add_argument("--combined", type=int, default=1000, help="moves through several traits at once")
    parser.add_argument(
        "--crossed", type=int, default=400, help="moves on other days, of any size, or with a failing sensor"
    )
    parser.add_argument("--behind", default="ideal", help="the logger of those moves")
    parser.add_argument("--factor", type=float, default=3.0, help="size of these failures, in FAILING_SIGMAS")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="where to write a row a move, as CSV, as they come")
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="stop after so long, with the moves that are done"
    )
    parser.add_argument("--out", type=Path, default=Path("reports/loggers.md"))
    options = parser.parse_args(arguments)
    jobs = trait_jobs(options.traits, options.moves, options.first)
    jobs += failing_jobs(options.failing, options.factor, options.first, options.behind)
    jobs += campaign_jobs(options.campaigns, options.first)
    jobs += combined_jobs(options.combined, options.first)
    jobs += crossed_jobs(options.crossed, options.first)
    frame = study(jobs, options.workers, options.rows, time.monotonic() + 60 * options.minutes)
    options.out.write_text(summary(frame, options.first, options.factor))
    print(f"wrote {options.out}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
