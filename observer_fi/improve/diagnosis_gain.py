"""What a better model is worth to `diagnose`: the measured moves, and simulated faults, with either rig."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from observer_fi.logs import CHUNK_ROWS, moves_from_rest, with_command
from observer_fi.physics import NOMINAL, NOT_TESTED, OPEN_LOOP, Rig, synthesise
from observer_fi.records import Isolation, Log
from observer_fi.settings import Settings
from observer_fi.verdict import describes, diagnose_log, scenarios, scores

CASES = 6  # simulated logs: a third healthy, a third each fault, half of them in the start
FAULTS = OPEN_LOOP[1:]


class DiagnosisGain(NamedTuple):
    """`diagnose` with one rig.

    alarms of moves: measured moves that are not nominal. false_alarms of healthy, right of faults: simulated logs.
    delay_s: median from onset to isolation, by fault [s], NaN where none was isolated.
    """

    alarms: int
    moves: int
    false_alarms: int
    healthy: int
    right: int
    faults: int
    delay_s: dict[str, float]


def diagnosis_gain(
    logs: Sequence[Log], given: Rig, extended: Rig
) -> tuple[DiagnosisGain, DiagnosisGain] | None:
    """`diagnose` with the rig as it was given, and with the extended one; None for a rig whose faults it cannot tell."""
    if not given.driven.servo:
        return None
    commanded = [with_command(log, given) for log in logs]
    with ThreadPoolExecutor(2) as pool:  # filters leave the interpreter's lock
        rigs = (given, extended)
        before, after = pool.map(
            lambda rig: measure_diagnosis_gain(commanded, extended, rig, Settings()), rigs
        )
    return before, after


def measure_diagnosis_gain(
    logs: Sequence[Log], plant: Rig, rig: Rig, settings: Settings, cases: int = CASES
) -> DiagnosisGain:
    """How `diagnose` does with `rig` on the measured logs, and on logs simulated from `plant`, the best model there is.

    Measured moves count as healthy, as those that a model is learned from should be.
    """
    labels = [label for log in logs for part in pieces(log) for label in _labels(part, rig, settings)]
    judged = []
    for k, (group, scenario) in enumerate(scenarios(cases, seed=0)):
        log, truth = synthesise(replace(scenario, spread=False), plant, f"simulated_{k}")
        judged.append(scores.case(truth.label, group, truth.onset_s, _isolation(log, rig, settings)))
    healthy = [c for c in judged if c.truth == "nominal"]
    faults = [c for c in judged if c.truth != "nominal"]
    delays = {f: [c.delay_s for c in faults if c.truth == f and np.isfinite(c.delay_s)] for f in FAULTS}
    return DiagnosisGain(
        sum(label != NOMINAL for label in labels),
        len(labels),
        sum(not c.right for c in healthy),
        len(healthy),
        sum(c.right for c in faults),
        len(faults),
        {f: float(np.median(d)) if d else float("nan") for f, d in delays.items()},
    )


def _labels(part: Log, rig: Rig, settings: Settings) -> list[str]:
    """One for each move; of a part of which nothing is said because the rig is another's, one for all the moves that it holds."""
    outcome = diagnose_log(part, rig, settings)
    events = outcome.isolation.events if outcome.isolation else ()
    return [e.label for e in events] if describes(outcome) else [NOT_TESTED] * len(moves_from_rest(part))


def _isolation(log: Log, rig: Rig, settings: Settings) -> Isolation:
    outcome = diagnose_log(log, rig, settings)
    if outcome.isolation is None:
        raise ValueError(f"{log.path}: diagnosed without a verdict ({outcome.error})")
    return outcome.isolation


def pieces(log: Log, rows: int = CHUNK_ROWS) -> list[Log]:
    """A log cut at rests into parts of about so many samples: what a bank says of a log takes thirty times its memory."""
    cuts, last = [0], 0
    for move in moves_from_rest(log)[1:]:
        rest = (move.rest + move.start) // 2
        if rest - cuts[-1] > rows and last > cuts[-1]:
            cuts.append(last)
        last = rest
    return [log.part(slice(a, b)) for a, b in pairwise([*cuts, log.t.size])]
