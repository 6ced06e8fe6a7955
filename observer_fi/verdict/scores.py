"""Verdicts against the truth: confusion, delays, onset errors, calibration. One score sheet for any isolator."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.physics import LABELS
from observer_fi.records import Event, Isolation

CERTAINTY_BINS = (0.0, 0.5, 0.8, 0.95, 0.99, 0.999, 1.0)


class Case(NamedTuple):
    """One log judged: the truth, and the verdict of one isolator.

    onset_s: of the truth, None without a fault. delay_s: from the true onset to the isolation, NaN where it
    was not isolated or is wrong; onset_error_s: stated minus true onset, NaN likewise. nis_ratio: mean NIS
    over its expectation.
    """

    truth: str
    group: str
    onset_s: float | None
    verdict: str
    probability: float
    delay_s: float
    onset_error_s: float
    nis_ratio: float

    @property
    def right(self) -> bool:
        """Whether the verdict is the truth."""
        return self.truth == self.verdict


class Delay(NamedTuple):
    """Of the right verdicts on one fault: how many, how many never isolated, and quantiles in seconds."""

    right: int
    never: int
    median_s: float
    p90_s: float
    onset_error_median_s: float


class Bin(NamedTuple):
    """Reliability: verdicts whose probability lies in a bin, their mean probability, and the share that is right."""

    low: float
    high: float
    cases: int
    stated: float
    right: float


def case(truth: str, group: str, onset_s: float | None, isolation: Isolation) -> Case:
    """One case from an isolation."""
    verdict = isolation.verdict
    fit = isolation.consistency
    return Case(
        truth, group, onset_s, verdict.label, verdict.probability, delay(truth, onset_s, verdict),
        onset_error(truth, onset_s, verdict), fit.nis_mean / fit.nis_expected,
    )  # fmt: skip


def delay(truth: str, onset_s: float | None, verdict: Event) -> float:
    """Time from the true onset to the isolation [s], NaN where there is none."""
    if onset_s is None or verdict.label != truth or verdict.isolated_s is None:
        return math.nan
    return verdict.isolated_s - onset_s


def onset_error(truth: str, onset_s: float | None, verdict: Event) -> float:
    """Stated minus true onset [s], NaN where there is none."""
    if onset_s is None or verdict.label != truth or verdict.onset_s is None:
        return math.nan
    return verdict.onset_s - onset_s


def accuracy(cases: Sequence[Case]) -> float:
    """Share of right verdicts, NaN without any."""
    return sum(c.right for c in cases) / len(cases) if cases else math.nan


def confusion(cases: Sequence[Case]) -> dict[str, dict[str, int]]:
    """Counts {truth: {verdict: n}}, truths in the order of `LABELS`, verdicts all of them."""
    truths = [label for label in LABELS if any(c.truth == label for c in cases)]
    return {t: {v: sum(c.truth == t and c.verdict == v for c in cases) for v in LABELS} for t in truths}


def delays(cases: Sequence[Case]) -> dict[str, Delay]:
    """Delay and onset error for each kind of fault, over its right verdicts."""
    found = {}
    for label in LABELS:
        right = [c for c in cases if c.truth == label and c.right and c.onset_s is not None]
        if not right:
            continue
        d = np.array([c.delay_s for c in right])
        e = np.abs([c.onset_error_s for c in right])
        never = int(np.isnan(d).sum())
        found[label] = Delay(len(right), never, quantile(d, 0.5), quantile(d, 0.9), quantile(e, 0.5))
    return found


def reliability(cases: Sequence[Case]) -> list[Bin]:
    """Stated probability of the verdicts against the share that is right, in bins of certainty."""
    bins = []
    for low, high in zip(CERTAINTY_BINS[:-1], CERTAINTY_BINS[1:], strict=True):
        inside = [c for c in cases if low < c.probability <= high]
        if inside:
            stated = float(np.mean([c.probability for c in inside]))
            bins.append(Bin(low, high, len(inside), stated, accuracy(inside)))
    return bins


def brier(cases: Sequence[Case]) -> float:
    """Mean square of stated probability minus being right: 0 is perfect, 0.25 a coin that says so."""
    return float(np.mean([(c.probability - c.right) ** 2 for c in cases])) if cases else math.nan


def quantile(values: np.ndarray, share: float) -> float:
    """Quantile of the finite values, NaN without any."""
    good = np.asarray(values, dtype=float)
    good = good[np.isfinite(good)]
    return float(np.quantile(good, share)) if good.size else math.nan


def summary(cases: Sequence[Case]) -> dict[str, object]:
    """The whole score sheet as plain data."""
    return {
        "cases": len(cases),
        "accuracy": accuracy(cases),
        "accuracy_by_group": {
            g: accuracy([c for c in cases if c.group == g]) for g in sorted({c.group for c in cases})
        },
        "confusion": confusion(cases),
        "delays": {label: d._asdict() for label, d in delays(cases).items()},
        "reliability": [b._asdict() for b in reliability(cases)],
        "brier": brier(cases),
        "nis_ratio_median": quantile(np.array([c.nis_ratio for c in cases]), 0.5),
    }
