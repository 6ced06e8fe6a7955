"""Does identification find the truth? Rigs of the independent truth, each identified from its own logs.

python -m pipelines.identify_study [--rigs 100] [--seed 20000] [--workers 1] [--out reports/identify.md]

Development used seeds below 10000; the report's begin at 20000. Needs the checkout: the truth is `tests/hidden`.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import hidden
import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn import identified_rig, identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, load_rig
from observer_fi.records import Fit, Isolation, Log
from observer_fi.report import markdown_table
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log, scores

TRUTH_NAMES = {
    "A_decoupled": "A_loose", "J_decoupled": "J_loose", "x_stop_high": "stop_high_m", "x_stop_low": "stop_low_m",
}  # fmt: skip
LIMITS = {"J": 2.0, "A": 2.0, "Kp": 2.0, "Ki": 2.0, "C": 5.0, "E": 5.0}  # %, median
X_LIMIT_M = 1e-4
DIAGNOSIS_HEAD = (
    "truth", "right, Table 1", "right, identified", "delay, Table 1", "delay, identified", "Brier, Table 1", "Brier, identified",
)  # fmt: skip
LABELS = ("nominal", "overload", "coupling_loss", "sensor_fault", "unknown")


@dataclass(frozen=True)
class Estimate:
    """One parameter of one rig: estimate, interval, truth, and section 3's value alone (nan where it gives none)."""

    name: str
    value: float
    std: float
    low: float
    high: float
    truth: float
    closed: float

    @property
    def held(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass(frozen=True)
class Trial:
    """One rig: its estimates, the time that identification took, and its diagnoses with both rigs."""

    estimates: tuple[Estimate, ...]
    campaign_seconds: float
    all_seconds: float
    table_cases: tuple[scores.Case, ...]
    own_cases: tuple[scores.Case, ...]


def draw_logs(seed: int) -> tuple[hidden.Rig, list[Log]]:
    """A rig and its logs: the 20 s campaign, one that leans on both stops, one that loses its coupling on the way."""
    rng = np.random.default_rng([seed, 77])
    rig = hidden.draw_rig(rng, identification_percent=3.0)
    rig = replace(rig, stop_low_m=rng.uniform(-7e-4, -4e-4), stop_high_m=rng.uniform(4e-4, 7e-4))
    far = replace(rig, stop_low_m=-0.05, stop_high_m=0.05)
    loss = hidden.Fault("coupling_loss", 1.0 + rng.uniform(0.0, 0.5))
    plans = (
        (hidden.campaign(), far, hidden.NO_FAULT),
        (hidden.contact_campaign(), rig, hidden.NO_FAULT),
        (hidden.there_and_back((410.0, 410.0), (2.0, 2.0), (0.0, 0.0)), far, loss),
    )
    specs = [hidden.TruthSpec(p, r, f, start_integral_rad=_rest(rng, r)) for p, r, f in plans]
    return rig, [_log(spec, 10 * seed + k) for k, spec in enumerate(specs)]


def _rest(rng: np.random.Generator, rig: hidden.Rig) -> float:
    return hidden.draw_rest_integral(rng, rig, 0.0)


def _log(spec: hidden.TruthSpec, seed: int) -> Log:
    return log_from_frame(hidden.make_log(spec, seed)[0])


def run_trial(seed: int, diagnoses: bool = True) -> Trial:
    """Identify one rig, from its campaign alone (for the time) and from all its logs, and diagnose with the result."""
    truth, logs = draw_logs(seed)
    paper = load_rig()
    began = time.perf_counter()
    identify(logs[:1], paper)
    campaign_seconds = time.perf_counter() - began
    began = time.perf_counter()
    fit = identify(logs, paper)
    seconds = time.perf_counter() - began
    own = identified_rig(fit, paper)
    cases = [_judge(seed, label, truth, (paper, own)) for label in LABELS] if diagnoses else []
    return Trial(
        estimates_of(fit, truth),
        campaign_seconds,
        seconds,
        tuple(c[0] for c in cases),
        tuple(c[1] for c in cases),
    )


def run_all(seeds: Sequence[int], workers: int = 1, diagnoses: bool = True) -> list[Trial]:
    """Trials of all seeds, in order; the same whatever the number of workers."""
    run = partial(run_trial, diagnoses=diagnoses)
    if workers == 1:
        return [run(seed) for seed in seeds]
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(run, seeds))


def estimates_of(fit: Fit, truth: hidden.Rig) -> tuple[Estimate, ...]:
    """The parameters of a fit beside the truth; nuisances of the servo's timing and the time of a loss are left out."""
    closed: dict[str, float] = {}
    for step in fit.figures["steps"].values():
        closed |= step.values
    found = []
    for p in fit.parameters:
        name = p.name.split("@")[0]
        if name in ("onset", "servo_delay", "input_delay"):
            continue
        value = 0.0 if name == "torque_offset" else float(getattr(truth, TRUTH_NAMES.get(name, name)))
        found.append(Estimate(name, p.value, p.std, p.low, p.high, value, closed.get(name, np.nan)))
    return tuple(found)


def _judge(seed: int, label: str, truth: hidden.Rig, rigs: Sequence[Rig]) -> list[scores.Case]:
    """One move of this rig with a fault of a class, diagnosed with each rig file."""
    spec = hidden.draw_move_case(seed, label)
    rng = np.random.default_rng([seed, 78])
    rig = replace(truth, stop_low_m=-0.05, stop_high_m=0.05)
    pitch = spec.profile.pitch_steps[0][1]
    spec = replace(spec, rig=rig, start_integral_rad=hidden.draw_rest_integral(rng, rig, pitch))
    log = _log(spec, seed)
    return [scores.case(label, label, spec.fault.onset_s, _isolated(log, r)) for r in rigs]


def _isolated(log: Log, rig: Rig) -> Isolation:
    """What is said of a move. Raises InvalidLogError where that is nothing: a case less would be a better share."""
    found = diagnose_log(log, rig, Settings())
    if found.isolation is None:
        raise InvalidLogError(f"{log.path}: no verdict ({found.error})")
    return found.isolation


# --- the report -----------------------------------------------------------------------------------


def coverage_rows(trials: Sequence[Trial]) -> list[tuple[str, ...]]:
    """Per parameter: rigs, share of 95 % intervals that hold the truth, median errors, standard error."""
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(e.name for t in trials for e in t.estimates):
        some = [e for t in trials for e in t.estimates if e.name == name]
        held = f"{100.0 * np.mean([e.held for e in some]):.0f} %"
        score = np.array([(e.value - e.truth) / e.std for e in some])
        errors = (_error(some, "value"), _error(some, "closed"))
        rows.append((name, str(len(some)), held, *errors, f"{score.mean():+.2f}", f"{score.std():.2f}"))
    return rows


def _error(some: Sequence[Estimate], which: str) -> str:
    """Median absolute error: relative in %, in micrometres for a place, as a share of A for a torque offset."""
    error = np.array([abs(getattr(e, which) - e.truth) for e in some])
    error = error[np.isfinite(error)]
    if not error.size:
        return "-"
    if some[0].name.startswith("x_stop"):
        return f"{1e6 * np.median(error):.2f} um"
    if some[0].truth == 0.0:
        return f"{1e6 * np.median(error):.3f} uN m"
    return f"{100.0 * np.median(error / abs(some[0].truth)):.4f} %"


def diagnosis_rows(trials: Sequence[Trial]) -> list[tuple[str, ...]]:
    """Per label: right verdicts and median delay with Table 1 and with the identified rig."""
    table = [c for t in trials for c in t.table_cases]
    own = [c for t in trials for c in t.own_cases]
    rows = []
    for label in (*LABELS, "all"):
        pair = [[c for c in cases if label in (c.truth, "all")] for cases in (table, own)]
        if not pair[0]:
            continue
        delays = [f"{1e3 * scores.quantile(np.array([c.delay_s for c in some]), 0.5):.0f}" for some in pair]
        right = [f"{sum(c.right for c in some)} of {len(some)}" for some in pair]
        brier = [f"{scores.brier(some):.4f}" for some in pair]
        rows.append((label, *right, *(d.replace("nan", "-") for d in delays), *brier))
    return rows


def report(trials: Sequence[Trial], seed: int) -> str:
    """The report as Markdown."""
    times = np.array([(t.campaign_seconds, t.all_seconds) for t in trials])
    parts = [
        "# Identification of rigs from their own logs",
        f"{len(trials)} rigs of the independent truth (paper's spread; 3 % on J, Kp, Ki, Rs, Vmax; a servo of 8 kHz), seeds "
        f"{seed} to {seed + len(trials) - 1}. Per rig: the 20 s campaign, 29 s on both stops, 10 s that lose the coupling. "
        f"Time: {np.median(times[:, 0]):.1f} s for the campaign alone, {np.median(times[:, 1]):.1f} s for all three (medians).",
        "## Intervals and errors",
        "95 % intervals should hold the truth in 90 to 99 % of rigs. Errors are medians of absolute errors; section 3 alone "
        "stands beside the likelihood. z is (value - truth) over the standard error.",
        markdown_table(
            ("parameter", "rigs", "held", "median error", "section 3 alone", "mean z", "sd z"),
            coverage_rows(trials),
        ),
        "Rm, Km and D of the truth are the maker's, which are the fit's priors (0.2, 0.2 and 0.1 %).",
    ]
    if any(t.own_cases for t in trials):
        parts += [
            "## Diagnosis with Table 1 and with the identified rig",
            "One move a rig and class of fault, the same logs for both rig files. Delays [ms] from onset to isolation, medians "
            "of right verdicts.",
            markdown_table(DIAGNOSIS_HEAD, diagnosis_rows(trials)),
        ]
    return "\n\n".join(parts) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, identify, compare, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=20000)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--no-diagnoses", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("reports/identify.md"))
    options = parser.parse_args(arguments)
    seeds = range(options.seed, options.seed + options.rigs)
    trials = run_all(seeds, options.workers, not options.no_diagnoses)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(report(trials, options.seed), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
