"""Observer bank against open-loop mixture over a Monte Carlo of faults, on the same logs, with the same
decision rule.

The bank detects for itself. The mixture needs an external detector (section 4.1 of the paper); it gets a
perfect one, which calls at the true onset, and on healthy moves a false alarm at a random time.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from observer_fi.physics import OPEN_LOOP, Rig, Scenario, Truth, drawn_scenario, synthesise
from observer_fi.records import Estimate, Isolation, Log
from observer_fi.settings import Settings
from observer_fi.verdict import scores
from observer_fi.verdict.diagnosis import judged
from observer_fi.verdict.isolate import Isolator
from observer_fi.verdict.open_loop import open_loop
from observer_fi.verdict.scores import Case

GROUPS = ("steady state", "start transient")
FALSE_ALARM_S = (0.05, 1.0)  # after the start of a healthy move


class Pair(NamedTuple):
    """Both verdicts on one log."""

    truth: Truth
    bank: Case
    mixture: Case


def scenarios(count: int, seed: int) -> list[tuple[str, Scenario]]:
    """(group, scenario) of `count` logs: the three classes in turn, half of them in the start transient."""
    found = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        transient = (k // len(OPEN_LOOP)) % 2 == 1
        scenario = drawn_scenario(rng, OPEN_LOOP[k % len(OPEN_LOOP)], transient, seed=1_000_000 * seed + k)
        found.append((GROUPS[transient], scenario))
    return found


def compare(
    count: int, seed: int, rig: Rig, settings: Settings, engine: str = "compiled", filter_kind: str = "ekf"
) -> Iterator[Pair]:
    """One pair of cases after another. The truth has its own rig each: drawn from the spread of `rig`."""
    for k, (group, scenario) in enumerate(scenarios(count, seed)):
        log, truth = synthesise(scenario, rig, f"case_{k:04d}")
        outcome, estimate = judged(log, rig, settings, engine, filter_kind)
        if outcome.isolation is None:
            raise ValueError(f"{log.path}: diagnosed without a verdict ({outcome.error})")
        alarm = truth.onset_s
        if alarm is None:
            start = scenario.moves[0].start_s
            alarm = start + float(np.random.default_rng([seed, k, 1]).uniform(*FALSE_ALARM_S))
        baseline = open_loop_isolation(log, estimate, rig, settings, alarm)
        yield Pair(
            truth,
            scores.case(truth.label, group, truth.onset_s, outcome.isolation),
            scores.case(truth.label, group, truth.onset_s, baseline),
        )


def open_loop_isolation(
    log: Log, estimate: Estimate, rig: Rig, settings: Settings, detected_s: float
) -> Isolation:
    """The mixture's verdict on a log, for a detection at this time."""
    mixture = open_loop_estimate(log, estimate, rig, detected_s)
    isolator = Isolator(mixture.modes, settings.decision)
    for _ in isolator.add(mixture):
        pass
    return isolator.result()


def open_loop_estimate(log: Log, estimate: Estimate, rig: Rig, detected_s: float) -> Estimate:
    """The mixture from a detection to the end of that move, started from the bank's estimate there."""
    first = min(int(np.searchsorted(log.t, detected_s)), log.t.size - 1)
    return open_loop(log, first, estimate.states[first, :3], rig, last=_end_of_move(log, first))


def _end_of_move(log: Log, first: int) -> int:
    """First sample after `first` at which the command has come to rest."""
    still = np.flatnonzero((log.w_cmd[first:] == 0.0) & (np.arange(log.t.size - first) > 0))
    return first + int(still[0]) if still.size else log.t.size


def as_dict(pairs: list[Pair], seed: int, rig: Rig) -> dict[str, Any]:
    """compare.json as plain data."""
    return {
        "schema": "observer-fi/compare/1",
        "rig": rig.name,
        "seed": seed,
        "bank": scores.summary([p.bank for p in pairs]),
        "mixture": scores.summary([p.mixture for p in pairs]),
        "cases": [
            {
                "label": p.truth.label,
                "group": p.bank.group,
                "onset_s": p.truth.onset_s,
                "speed_rad_s": p.truth.scenario.moves[0].speed,
                "pitch_deg": p.truth.scenario.pitch_deg,
                "seed": p.truth.scenario.seed,
                "bank": p.bank._asdict(),
                "mixture": p.mixture._asdict(),
            }
            for p in pairs
        ],
    }
