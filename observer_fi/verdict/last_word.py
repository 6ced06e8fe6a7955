"""The last word on a move: what the bank left without a name, or doubted for a moment, by every path of the whole move.

The bank knows faults of the rig file's size that stay; here a fault has any severity, may have come for a while, and has a
label that needs the whole move. Verdicts that the bank is sure of stand.
"""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.bank import Bank, Hypothesis, of_a_move
from observer_fi.physics import FAULTS, NOMINAL, PARAMETERS, UNKNOWN, OwnState, Rig, channel_of, label_of
from observer_fi.records import Event, Severity
from observer_fi.settings import DecisionSettings
from observer_fi.verdict.onset import Filters
from observer_fi.verdict.whole_move import Path, WholeMove

BEFORE_S, AFTER_S = 1.0, 0.05  # of the bank's first doubt: where a fault may have begun
SETTLED_S = 0.15  # a fault that begins and ends within the ring of a start is the ring
RARE_NATS = math.log(10.0)  # that a rare fault must be better
BELIEVABLE = 3.0  # standard deviations by which a constant may be beyond what is believable
Z95 = 1.959964


class LastWord:
    """Asks whole moves; filters are made once a log."""

    def __init__(self, rig: Rig, filters: Filters, settings: DecisionSettings) -> None:
        self.rig, self.filters, self.settings = rig, filters, settings
        self.hypotheses: tuple[Hypothesis, ...] = ()

    def needed(self, event: Event) -> bool:
        """Whether the bank left the move without a name, or doubted a healthy one for a moment."""
        return event.label == UNKNOWN or (event.label == NOMINAL and event.doubted_s is not None)

    def on(self, event: Event, bank: Bank) -> Event:
        """The event as the whole move has it; as it is where the move is no longer at hand or says nothing else."""
        move = self._move(event, bank)
        doubted = event.detected_s if event.label == UNKNOWN else event.doubted_s
        if move is None or doubted is None:
            return event
        whole, first = move
        t = whole.window.t
        begins = np.searchsorted(t, (max(event.start_s, doubted - BEFORE_S), doubted + AFTER_S))
        paths = [p for p in whole.paths(int(begins[0]), int(begins[1])) if self._credible(p, t, first)]
        return self._told(event, paths, whole) if paths else event

    def _move(self, event: Event, bank: Bank) -> tuple[WholeMove, float] | None:
        """The move from a rest before it to its last sample under way, and when it starts [s]."""
        recent = bank.recent
        starts = [(t, m) for t, m in bank.snapshots if t <= event.start_s]
        if recent is None or not starts or recent.t[0] > starts[-1][0] + 1e-9:
            return None
        since, memory = starts[-1]
        under_way = np.flatnonzero(recent.active & (recent.t <= event.end_s))
        first = int(np.searchsorted(recent.t, since - 1e-9))
        if not under_way.size or under_way[-1] + 1 - first < 2:
            return None
        self.hypotheses = self.hypotheses or of_a_move(self.rig, self.filters.settings)
        window = recent.cut(first, int(under_way[-1]) + 1)
        return WholeMove(self.hypotheses, window, memory, self.filters), event.start_s

    def _credible(self, path: Path, t: np.ndarray, start_s: float) -> bool:
        """Whether its constants are such as exist, and it is more than the ring of a start."""
        ring = path.end is not None and t[path.end] < start_s + SETTLED_S
        if ring or path.gain < self.settings.move_nats:
            return False
        for own in path.hypothesis.own:
            value, std = _constant(path, own)
            if value < own.low - BELIEVABLE * std or value > own.high + BELIEVABLE * std:
                return False
        return True

    def _told(self, event: Event, paths: Sequence[Path], whole: WholeMove) -> Event:
        """The event with the label, times and severity of the best path."""
        best, t = paths[0], whole.window.t
        posterior = _posterior(event, paths)
        label = label_of(best.hypothesis.name)
        alike = tuple(k for k, p in posterior.items() if k != label and p > self.settings.alike)
        begin = float(t[max(best.begin - 1, 0)])
        return event._replace(
            label=label, channel=channel_of(best.hypothesis.name), probability=posterior[label], posterior=posterior,
            onset_s=begin, onset_interval_s=(begin, float(t[best.begin])),
            detected_s=event.detected_s or event.doubted_s,
            over_s=None if best.end is None else float(t[best.end]), alike=alike,
            severity=tuple(self._severity(best, own, whole) for own in best.hypothesis.own if own.tells),
            reasons=() if label != UNKNOWN else event.reasons,
        )  # fmt: skip

    def _severity(self, path: Path, own: OwnState, whole: WholeMove) -> Severity:
        value, std = _constant(path, own)
        scale, unit = 1.0, "1"
        if own.of_friction:
            scale = float(np.sign(whole.window.w_cmd[path.begin])) / self.rig.model["A"]
        elif not own.absolute:
            scale, unit = self.rig.model[own.name], PARAMETERS[own.name][0]
        value, half = scale * value, Z95 * abs(scale) * std
        return Severity(own.tells, value, (value - half, value + half), unit, own.words.format(value))


def _constant(path: Path, own: OwnState) -> tuple[float, float]:
    """A constant of a fault at the end of its path, and its standard deviation; absolute ones in their unit."""
    k = path.hypothesis.states.index(own.name)
    unit = own.mean if own.absolute else 1.0
    return unit * float(path.memory.x[k]), unit * math.sqrt(max(float(path.memory.P[k, k]), 0.0))


def _posterior(event: Event, paths: Sequence[Path]) -> dict[str, float]:
    """Probability of each label: its best path against nominal and the others'."""
    nats = {NOMINAL: 0.0}
    for path in paths:
        label = label_of(path.hypothesis.name)
        worth = path.gain - (RARE_NATS if FAULTS[label].rare else 0.0)
        nats[label] = max(nats.get(label, -math.inf), worth)
    top = max(nats.values())
    weights = {label: math.exp(nats.get(label, -math.inf) - top) for label in event.posterior}
    total = sum(weights.values())
    return {label: weight / total for label, weight in weights.items()}
