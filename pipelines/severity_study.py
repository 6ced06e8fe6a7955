"""Faults of any size, for a while and growing, on moves of any shape: writes reports/severity.md.

    python -m pipelines.severity_study [--moves 60] [--shaped 50] [--workers 2] [--out reports/severity.md]

Seeds from 80000 on: none of them was looked at while thresholds were set.
"""

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import hidden
import numpy as np
import pandas as pd

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from pipelines.diagnose_study import markdown
from pipelines.study_output import write_study

FIRST_SEED = 80_000
CLEAR_NATS = 30.0  # over a move: less than this may be called healthy
CONFIDENT = 0.95
BEGIN_S = 0.02
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
    spec = hidden.draw_severity_case(job.seed, job.kind, job.shape)
    frame, truth = hidden.make_log(spec, job.seed)
    outcome = diagnose_log(log_from_frame(frame), load_rig(), Settings())
    if outcome.isolation is None:
        raise RuntimeError(f"{job}: no verdict: {outcome.error}")
    verdict = outcome.isolation.verdict
    named = verdict.label == truth["label"]
    inside, sizes = _intervals(verdict, spec) if named else (0, 0)
    ends = spec.fault.onset_s is not None and np.isfinite(spec.fault.duration_s)
    end = spec.fault.onset_s + spec.fault.duration_s if ends else None
    return {
        **job._asdict(), "label": truth["label"], "said": verdict.label, "channel": verdict.channel or "",
        "alike": " ".join(verdict.alike), "probability": verdict.probability, "named": named,
        "right": named or truth["label"] in verdict.alike, "nats": worth(spec), "inside": inside, "sizes": sizes,
        "size": spec.fault.size, "stiffness": spec.rig.C, "share": spec.rig.E,
        "begin_ms": None if verdict.onset_s is None or not named else 1e3 * (verdict.onset_s - spec.fault.onset_s or 0.0),
        "lasts": None if end is None else spec.fault.duration_s,
        "end_ms": None if end is None or verdict.over_s is None or not named else 1e3 * (verdict.over_s - end),
    }  # fmt: skip


def worth(spec: hidden.TruthSpec) -> float:
    """How far the move is from the same one without the fault, in the channels: half the squared distance in their noise."""
    if spec.fault.onset_s is None:
        return 0.0
    clean = hidden.without_noise(spec)
    faulty, healthy = (
        hidden.make_log(clean, 0)[0],
        hidden.make_log(replace(clean, fault=hidden.NO_FAULT), 0)[0],
    )
    noise = load_rig().noise_std
    columns = ("voltage_v", "current_a", "position_m")
    return float(
        sum(((faulty[c] - healthy[c]) ** 2).sum() / s**2 for c, s in zip(columns, noise, strict=True)) / 2.0
    )


def _intervals(verdict: Event, spec: hidden.TruthSpec) -> tuple[int, int]:
    """How many of the verdict's sizes hold the true one, of how many that are constant in the move."""
    if spec.fault.growth_s:
        return 0, 0
    told = [(s.interval, TRUE_SIZES[s.name](spec)) for s in verdict.severity if s.name in TRUE_SIZES]
    return sum(low <= true <= high for (low, high), true in told), len(told)


def study(jobs: Iterable[Job], workers: int) -> pd.DataFrame:
    """The rows of all jobs."""
    with ProcessPoolExecutor(workers) as pool:
        return pd.DataFrame(pool.map(judged, jobs, chunksize=4) if workers > 1 else map(judged, jobs))


def jobs_of(moves: int, shaped: int, first: int) -> list[Job]:
    """`moves` a kind of fault on trapezoids; `shaped` healthy ones and a tenth as many lost couplings a shape."""
    faults = [Job(kind, first + k) for kind in hidden.SEVERITY_KINDS for k in range(moves)]
    healthy = [Job("nominal", first + k, shape) for shape in ("", *hidden.SHAPES) for k in range(shaped)]
    lost = [Job("coupling_loss", first + k, shape) for shape in hidden.SHAPES for k in range(shaped // 5)]
    return [*faults, *healthy, *lost]


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
            "clear, nominal": int((clear["said"] == "nominal").sum()),
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
        f"seeds from {first} on. Clear: the channels are {CLEAR_NATS:g} nats or more from those without the fault.",
        "Right: the label, or one that the verdict declares alike. Sizes: those that the verdict tells of a fault that it named.",
        "", "## By kind", "", markdown(table(faults, "kind")), "",
        f"For a while, begin and end both within 20 ms: {_percent(both[lasted['named']])} of {int(lasted['named'].sum())} named.",
        "", "## By size", "", markdown(by_size(faults)), "",
        "## Healthy moves by shape of the command", "", markdown(healthy(frame)), "",
        "## Lost couplings by shape of the command", "", markdown(table(lost, "shape")) if len(lost) else "", "",
    ))  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run the study and write its report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=60, help="moves of each kind of fault")
    parser.add_argument("--shaped", type=int, default=50, help="healthy moves of each shape of command")
    parser.add_argument("--first", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="where to write a row a move, as CSV")
    parser.add_argument("--out", type=Path, default=Path("reports/severity.md"))
    options = parser.parse_args(arguments)
    frame = study(jobs_of(options.moves, options.shaped, options.first), options.workers)
    return write_study(frame, summary(frame, options.first), options.rows, options.out)


if __name__ == "__main__":
    raise SystemExit(main())
