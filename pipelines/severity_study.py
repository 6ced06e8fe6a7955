"""Faults of any size, for a while and growing, on moves of any shape: writes reports/severity.md.

    python -m pipelines.severity_study [--moves 60] [--shaped 50] [--workers 2] [--kinds slip jam] [--out reports/severity.md]

Seeds from 80000 on by default; a report names its own, which were not looked at while thresholds were set.
"""

import argparse
import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import numpy as np
import pandas as pd

from observer_fi.logs import log_from_frame
from observer_fi.physics import NOMINAL, load_rig
from observer_fi.records import Event, Log
from observer_fi.settings import Settings
from observer_fi.verdict import Diagnosis, diagnose_log
from pipelines.diagnose_study import markdown
from pipelines.study_output import write_study

FIRST_SEED = 80_000
CLEAR_NATS = 30.0  # over a move: less than this may be called healthy
CONFIDENT = 0.95
BEGIN_S = 0.02
ABOUT_S = 0.1, 0.3  # before and after its begin, in which the bank's own filter of a fault may begin
SPREAD = {"A": 0.1, "B": 0.1}  # of what a healthy move feels, from rig to rig (the paper's, section 3)
KINDS = (*hidden.SEVERITY_KINDS, *hidden.PLACED_KINDS)
# What a fault that grows or goes is called, and how its size is read off the truth.
TRUE_SIZES = {
    "stiffness": lambda spec: spec.rig.C,
    "drag": lambda spec: spec.rig.A_loose,
    "inertia": lambda spec: spec.rig.J_loose,
    "friction_rise": lambda spec: spec.fault.size,
    "share_lost": lambda spec: spec.fault.size if spec.fault.label == "slip" else spec.rig.E,
}


class Job(NamedTuple):
    """One move: its kind of fault (or "nominal"), its seed, the shape of its command ("": a trapezoid)."""

    kind: str
    seed: int
    shape: str = ""


def judged(job: Job) -> dict[str, Any]:
    """Truth and verdict of one move, as a row."""
    spec = drawn(job)
    frame, truth = hidden.make_log(spec, job.seed)
    outcome = diagnose_log(log_from_frame(frame), load_rig(), Settings())
    if outcome.isolation is None:
        raise RuntimeError(f"{job}: no verdict: {outcome.error}")
    verdict = outcome.isolation.verdict
    named = verdict.label == truth["label"]
    second = _second(verdict, spec.then)
    inside, sizes = _intervals(verdict, spec) if named else (0, 0)
    return {
        **job._asdict(), "label": truth["label"], "said": verdict.label, "channel": verdict.channel or "",
        "alike": " ".join(verdict.alike), "probability": verdict.probability, "named": named and second.named,
        "right": (named or truth["label"] in verdict.alike) and second.right, "then": second.said,
        "nats": worth(spec, SPREAD), "known": worth(spec, {}), "inside": inside, "sizes": sizes,
        "size": spec.fault.size, "stiffness": spec.rig.C, "share": spec.rig.E,
        "begin_ms": None if verdict.onset_s is None or not named else 1e3 * since_begin(verdict.onset_s, spec),
        "lasts": spec.fault.duration_s if np.isfinite(spec.fault.duration_s) else None,
        "end_ms": 1e3 * since_end(verdict.over_s, spec) if named else None,
        "gained": gained(log_from_frame(frame), spec) if verdict.label == NOMINAL and spec.fault.onset_s is not None else None,
    }  # fmt: skip


def gained(log: Log, spec: hidden.TruthSpec) -> float:
    """Nats by which the bank's own filters of the true fault, begun about when it did, beat nominal over a move."""
    rig, begun = load_rig(), float(spec.fault.onset_s or 0.0)
    run = Diagnosis(rig, Settings())
    run.add(log)
    found = run.outcome("move", {}).isolation
    best = -math.inf
    for event in found.events if found else ():
        whole = run.last_word.move(event, run.memory, run.last_word.stop_s)
        if whole is not None:
            first, last = np.searchsorted(whole.window.t, (begun - ABOUT_S[0], begun + ABOUT_S[1]))
            same = (
                p.gain for p in whole.paths(int(first), int(last)) if p.hypothesis.label == spec.fault.label
            )
            best = max(best, *same, -math.inf)
    return best


class Second(NamedTuple):
    """What was said of a second fault of the move: its label, whether that is the true one, or one declared alike."""

    said: str
    named: bool
    right: bool


def _second(verdict: Event, then: hidden.Fault) -> Second:
    told = verdict.then[0] if verdict.then else None
    if then.onset_s is None:
        return Second(told.label if told else "", True, True)
    if told is None:
        return Second("", False, False)
    return Second(told.label, told.label == then.label, then.label in (told.label, *told.alike))


def drawn(job: Job) -> hidden.TruthSpec:
    """The truth of a job."""
    if job.kind in hidden.PLACED_KINDS:
        return hidden.draw_placed_case(job.seed, job.kind)
    return hidden.draw_severity_case(job.seed, job.kind, job.shape)


def since_begin(told_s: float, spec: hidden.TruthSpec) -> float:
    """How much later than the fault a told begin is [s]. One that begins at rest begins at any time until the next motion."""
    onset = float(spec.fault.onset_s or 0.0)
    rests = [(end, start) for end, start in _rests(spec) if end <= onset < start]
    first, last = rests[0] if rests else (onset, onset)
    return told_s - float(np.clip(told_s, first, last))


def since_end(told_s: float | None, spec: hidden.TruthSpec) -> float:
    """How much later than the fault a told end is [s]: none where it is told to last and ends behind the stop; not a number where
    it is told to last and does not, or ends and is told to do so by nobody.
    """
    end = float(spec.fault.onset_s or 0.0) + spec.fault.duration_s
    if told_s is None:
        return 0.0 if end >= spec.profile.moves[-1].brake_s else math.nan
    return told_s - end if np.isfinite(end) else math.nan


def _rests(spec: hidden.TruthSpec) -> list[tuple[float, float]]:
    """When the motor stands before each move [s]."""
    moves = spec.profile.moves
    ends = (0.0, *(move.brake_s for move in moves))
    return [(end, move.start_s) for end, move in zip(ends, moves, strict=False)]


def worth(spec: hidden.TruthSpec, spread: Mapping[str, float]) -> float:
    """How far the move is from one without the fault, on any rig of this spread; of two faults the lesser, the first until the
    second comes.

    Friction that rose at rest is worth no more than what it is from a healthy rig's.
    """
    if spec.fault.onset_s is None:
        return 0.0
    alone = replace(spec, then=hidden.NO_FAULT)
    healthy = replace(alone, fault=hidden.NO_FAULT)
    if spec.then.onset_s is not None:
        first = hidden.nats_apart(alone, healthy, spread, spec.then.onset_s)
        return min(first, hidden.nats_apart(spec, alone, spread))
    apart = hidden.nats_apart(spec, healthy, spread)
    if spec.fault.label != "jam" or not spread:
        return apart
    at_rest = any(end <= spec.fault.onset_s < start for end, start in _rests(spec))
    return min(
        apart,
        _from_one_that_rubs_more(spec, healthy, spread),
        *([_from_a_healthy_rig(spec)] if at_rest else []),
    )


def _from_one_that_rubs_more(
    spec: hidden.TruthSpec, healthy: hidden.TruthSpec, spread: Mapping[str, float]
) -> float:
    """Nats from the healthy rig that has the friction of a jam from the first sample on, and those by which rigs are not so."""
    usual, friction = load_rig().model["A"], spec.rig.A * (1.0 + float(spec.fault.size or 0.0))
    off = [(value / usual - 1.0) / spread["A"] for value in (friction, spec.rig.A)]
    rubs = replace(healthy, rig=replace(spec.rig, A=friction))
    return max(0.5 * (off[0] ** 2 - off[1] ** 2), 0.0) + hidden.nats_apart(spec, rubs, spread)


def _from_a_healthy_rig(spec: hidden.TruthSpec) -> float:
    """Nats by which no healthy rig has the friction of a jam that began at rest, from the spread of rigs.

    A move tells the sum of friction and gravity, one there and one back tell both.
    """
    rig, move, pitch = load_rig(), spec.profile.moves[0], spec.profile.pitch_steps[0][1]
    friction, gravity = rig.model["A"], rig.model["B"] * pitch * np.sign(move.speed)
    spread = friction * rig.spread("A"), abs(gravity) * rig.spread("B")
    rise = spec.rig.A * float(spec.fault.size or 0.0)
    true_gravity = spec.rig.B * pitch * np.sign(move.speed)
    if float(spec.fault.onset_s or 0.0) < move.start_s:
        return float(
            0.5 * (spec.rig.A + rise + true_gravity - friction - gravity) ** 2 / np.hypot(*spread) ** 2
        )
    off = (spec.rig.A + rise / 2.0 - friction) / spread[0], (true_gravity - rise / 2.0 - gravity) / spread[1]
    return float(0.5 * np.hypot(*off) ** 2)


def _intervals(verdict: Event, spec: hidden.TruthSpec) -> tuple[int, int]:
    """How many of the verdict's sizes hold the true one, of how many that are constant in the move."""
    if spec.fault.growth_s:
        return 0, 0
    told = [(s.interval, TRUE_SIZES[s.name](spec)) for s in verdict.severity if s.name in TRUE_SIZES]
    return sum(low <= true <= high for (low, high), true in told), len(told)


def study(jobs: Iterable[Job], workers: int, rows: Path | None = None) -> pd.DataFrame:
    """The rows of all jobs, each appended to the file `rows` as soon as it is there: a study that is cut short still counts."""
    found: list[dict[str, Any]] = []
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(judged, jobs, chunksize=4) if workers > 1 else map(judged, jobs):
            if rows:
                pd.DataFrame([row]).to_csv(rows, mode="a" if found else "w", header=not found, index=False)
            found.append(row)
    return pd.DataFrame(found)


def jobs_of(moves: int, shaped: int, first: int, kinds: Sequence[str]) -> list[Job]:
    """`moves` a kind of fault on trapezoids; `shaped` healthy ones and a tenth as many lost couplings a shape; by seed."""
    shapes = ("", *hidden.SHAPES) if shaped else ()
    jobs = [Job(kind, first + k) for kind in kinds for k in range(moves)]
    jobs += [Job("nominal", first + k, shape) for shape in shapes for k in range(shaped)]
    jobs += [Job("coupling_loss", first + k, shape) for shape in shapes[1:] for k in range(shaped // 5)]
    return sorted(jobs, key=lambda job: job.seed)


def table(frame: pd.DataFrame, by: str) -> pd.DataFrame:
    """One row a kind or shape: what was said where the fault shows by `CLEAR_NATS`, and where it does not."""
    rows = {}
    for name, g in frame.groupby(by, sort=False):
        clear = g[g["nats"] >= CLEAR_NATS]
        wrong = g[~g["right"] & (g["said"] != "nominal") & (g["said"] != "unknown")]
        within = clear["begin_ms"].abs() <= 1e3 * BEGIN_S
        rows[name or "trapezoid"] = {
            "moves": len(g), "clear": len(clear), "clear and right": _percent(clear["right"]),
            "by name alone": _percent(clear["named"]), "clear, unknown": int((clear["said"] == "unknown").sum()),
            "clear, nominal": int(((clear["said"] == "nominal") & ~clear["right"]).sum()),
            "confident and wrong": int((wrong["probability"] > CONFIDENT).sum()),
            "begin within 20 ms": _percent(within[clear["named"]]),
            "sizes in 95 % interval": f"{int(g['inside'].sum())} of {int(g['sizes'].sum())}",
        }  # fmt: skip
    return pd.DataFrame(rows).T


def by_size(frame: pd.DataFrame) -> pd.DataFrame:
    """One row a kind and size: small, middle and large thirds of what the kind's size is drawn from."""
    size = {"overload": "stiffness", "coupling_for_a_while": "lasts", "coupling_loss": "nats"}
    rows = []
    for kind, g in frame[frame["kind"] != "nominal"].groupby("kind", sort=False):
        column = size.get(str(kind), "size")
        ordered = g.iloc[np.argsort(g[column].astype(float), kind="stable")]
        for rows_of_part in np.array_split(np.arange(len(g)), min(3, len(g))):
            part = ordered.iloc[rows_of_part]
            values = part[column].astype(float)
            rows.append({
                "kind": kind, "from": f"{values.min():.3g}", "to": f"{values.max():.3g}", "of": column,
                "moves": len(part), "right": _percent(part["right"]), "said otherwise": _others(part),
            })  # fmt: skip
    return pd.DataFrame(rows).set_index("kind")


def _others(g: pd.DataFrame) -> str:
    counts = g.loc[~g["right"], "said"].value_counts()
    return ", ".join(f"{label} {count}" for label, count in counts.items())


def healthy(frame: pd.DataFrame) -> pd.DataFrame:
    """One row a shape of command: false alarms."""
    g = frame[frame["kind"] == "nominal"]
    rows = {
        shape or "trapezoid": {"moves": len(part), "false alarms": int((part["said"] != "nominal").sum()), "said": _others(part)}
        for shape, part in g.groupby("shape", sort=False)
    }  # fmt: skip
    return pd.DataFrame(rows).T


def _percent(share: pd.Series) -> str:
    return f"{100.0 * float(share.mean()):.0f}%" if len(share) else ""


def summary(frame: pd.DataFrame, first: int) -> str:
    """The report."""
    plain, shaped = frame[frame["shape"] == ""], frame[frame["shape"] != ""]
    faults = plain[plain["kind"] != "nominal"]
    lasted = faults[faults["kind"] == "coupling_for_a_while"]
    both = (lasted["begin_ms"].abs() <= 1e3 * BEGIN_S) & (lasted["end_ms"].abs() <= 1e3 * BEGIN_S)
    lost = shaped[shaped["kind"] == "coupling_loss"]
    return "\n".join((
        "# Faults of any size", "",
        "Made by `pipelines/severity_study.py` from the independent truth of tests/hidden with the paper's spread of rigs,",
        f"seeds from {first} on. Clear: {CLEAR_NATS:g} nats or more from what any rig of that spread does without the fault.",
        "Right: the label, or one that the verdict declares alike. Sizes: those that the verdict tells of a fault that it named.",
        "", "## By kind", "", markdown(table(faults, "kind")), "",
        f"For a while, begin and end both within 20 ms: {_percent(both[lasted['named']])} of {int(lasted['named'].sum())} named.",
        "It is told to last where it ends behind the stop of the motor." if len(lasted) else "", "", *_in_all(faults, lost),
        "", "## By size", "", markdown(by_size(faults)) if len(faults) else "", "",
        "## Healthy moves by shape of the command", "", markdown(healthy(frame)), "",
        "## Lost couplings by shape of the command", "", markdown(table(lost, "shape")) if len(lost) else "", "",
    ))  # fmt: skip


def _in_all(faults: pd.DataFrame, lost: pd.DataFrame) -> tuple[str, ...]:
    """All kinds together: what must not be, and how many intervals hold the truth."""
    every = pd.concat((faults, lost))
    wrong = ~every["right"] & (every["probability"] > CONFIDENT)
    fault = wrong & ~every["said"].isin(["nominal", "unknown"])
    missed = ~every["right"] & (every["said"] == "nominal") & (every["nats"] >= CLEAR_NATS)
    told = missed & (every["gained"].astype(float) >= CLEAR_NATS)
    inside, sizes = int(faults["inside"].sum()), int(faults["sizes"].sum())
    of_a_rig = every[(every["nats"] < CLEAR_NATS) & (every["known"] >= CLEAR_NATS)]
    return (
        f"In all {len(every)} moves with a fault, {int((every['nats'] >= CLEAR_NATS).sum())} of them clear: confident and wrong "
        f"{int(fault.sum())}, clear ones called nominal {int(missed.sum())}; in {int(told.sum())} of these the bank's own filter",
        f"of the true fault beats nominal by {CLEAR_NATS:g} nats. What is clear is told with every constant of the rig but A and",
        "B known; the bank has doubts.",
        f"Further {len(of_a_rig)} are as far only from the same rig: "
        f"{int(of_a_rig['right'].sum())} right, {int((of_a_rig['said'] == 'nominal').sum())} nominal.",
        f"Sizes in their 95 % interval: {inside} of {sizes} ({100.0 * inside / max(sizes, 1):.1f} %).",
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=60, help="moves of each kind of fault")
    parser.add_argument("--shaped", type=int, default=50, help="healthy moves of each shape of command")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="where to write a row a move, as CSV")
    parser.add_argument("--out", type=Path, default=Path("reports/severity.md"))
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS, help="of faults")
    options = parser.parse_args(arguments)
    jobs = jobs_of(options.moves, options.shaped, options.first, options.kinds)
    frame = study(jobs, options.workers, options.rows)
    return write_study(frame, summary(frame, options.first), options.rows, options.out)


if __name__ == "__main__":
    raise SystemExit(main())
