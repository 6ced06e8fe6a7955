"""What a better model is worth to `diagnose` on simulated faults; on measured moves `new_moves.py` counts."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.physics import OPEN_LOOP, Rig, synthesise
from observer_fi.records import Isolation, Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log, scenarios, scores

CASES = 3  # simulated logs: a third healthy, a third each fault
FAULTS = OPEN_LOOP[1:]
TOLD_S = 1.0  # after an onset: these faults are told within tenths of that, and a rig that tells none looks at every sample


class DiagnosisGain(NamedTuple):
    """`diagnose` with one rig on simulated logs: false_alarms of healthy, right of faults.

    delay_s: median from onset to isolation, by fault [s], NaN where none was isolated.
    """

    false_alarms: int
    healthy: int
    right: int
    faults: int
    delay_s: dict[str, float]


def diagnosis_gain(given: Rig, extended: Rig) -> tuple[DiagnosisGain, DiagnosisGain] | None:
    """`diagnose` with the rig as it was given, and with the extended one; None for a rig whose faults it cannot tell."""
    if not given.driven.servo:
        return None
    with ThreadPoolExecutor(2) as pool:  # filters leave the interpreter's lock
        before, after = pool.map(
            lambda rig: measure_diagnosis_gain(extended, rig, Settings()), (given, extended)
        )
    return before, after


def measure_diagnosis_gain(plant: Rig, rig: Rig, settings: Settings, cases: int = CASES) -> DiagnosisGain:
    """How `diagnose` does with `rig` on logs simulated from `plant`, the best model there is."""
    judged = []
    for k, (group, scenario) in enumerate(scenarios(cases, seed=0)):
        log, truth = synthesise(replace(scenario, spread=False), plant, f"simulated_{k}")
        if truth.onset_s is not None:
            log = log.part(slice(0, int(np.searchsorted(log.t, truth.onset_s + TOLD_S))))
        judged.append(scores.case(truth.label, group, truth.onset_s, _isolation(log, rig, settings)))
    healthy = [c for c in judged if c.truth == "nominal"]
    faults = [c for c in judged if c.truth != "nominal"]
    delays = {f: [c.delay_s for c in faults if c.truth == f and np.isfinite(c.delay_s)] for f in FAULTS}
    return DiagnosisGain(
        sum(not c.right for c in healthy),
        len(healthy),
        sum(c.right for c in faults),
        len(faults),
        {f: float(np.median(d)) if d else float("nan") for f, d in delays.items()},
    )


def _isolation(log: Log, rig: Rig, settings: Settings) -> Isolation:
    outcome = diagnose_log(log, rig, settings)
    if outcome.isolation is None:
        raise ValueError(f"{log.path}: diagnosed without a verdict ({outcome.error})")
    return outcome.isolation
