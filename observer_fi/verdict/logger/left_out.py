"""Whether one channel alone contradicts the rig file from a log's first motion on: it is not read as the rig file says.

Another unit, a leak between channels, a rectifier or a curved characteristic spoil one channel in every move. Without it the
first start is explained by what is left, with it by nothing; the log is then judged without it. Which channel it is must be
told: where two may be left out, neither is. A rig file of another machine explains its starts without none.

Nor is a fault of the actuator certain that one of voltage and current tells alone: what loads a motor, or lets go of it, shows in
both. Without the other one the whole move is then healthy.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, Hypothesis
from observer_fi.logs import CHUNK_ROWS, log_segments, suspect_units
from observer_fi.physics import COLUMNS, FAULTS, NOMINAL, UNKNOWN, Rig, commanded, label_of
from observer_fi.records import CHANNELS, Array, Event, Log, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict.drift import (
    LIMIT,
    SURE,
    UNUSUAL,
    friction_in_spreads,
    largest_means,
    mostly,
    or_else,
)
from observer_fi.verdict.explain import explanation
from observer_fi.verdict.isolate import log_verdict
from observer_fi.verdict.logger.as_followed import NO_FAULT_OF_IT, is_odd
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.logger.lateness import first_start
from observer_fi.verdict.moves.of_the_day import nats_of, told_by
from observer_fi.verdict.moves.whole_move import SETTLED_S
from observer_fi.verdict.wrong_rig import begins_with_the_motion

# Times the expected NIS of a start: with all channels, and without the one that is wrong.
CONTRADICTS, EXPLAINED = 1.5, 1.15
FITS = 1.5  # times the expected NIS of the log that is left
NOT_AS_FILED = (
    "{} contradicts the other channels from the log's first motion on, and they do not contradict each other: the log was judged "
    "without it. It is read, scaled or filtered in another way than the rig file says, or had failed before: look at it with "
    "observer-fi inspect"
)
TOLD_BY_ONE = (
    "without {} the log is that of a healthy actuator from its first sample to the end of the move, and no fault of the actuator "
    "shows in one channel alone: the log was judged without it. Look at it with observer-fi inspect"
)
CHANGES = 2.0  # times what means of innovations were before
TELLS = 3.0  # nats that a fault must gain on health in channels to be told by them, what it costs to come at any sample paid
ONE_OF_TWO = 0.5  # probability of a fault that is as likely as another
ELECTRICAL = ("voltage", "current")
_EITHER = "without {}, which contradicts the others, the actuator is healthy"


def may_be_a_channel(outcome: Outcome) -> bool:
    """Whether a verdict may come of a channel that never fitted: an odd one, or a fault that begins with the log's first motion.

    What a changed circuit is told with its size is the motor's.
    """
    found = outcome.isolation
    if found is None or (found.verdict.label == UNKNOWN and found.verdict.severity):
        return False
    first = all(found.verdict.start_s <= event.start_s for event in found.events)
    return is_odd(outcome) or (first and begins_with_the_motion(found.verdict))


def left_out(log: Log, rig: Rig, settings: Settings) -> int | None:
    """Index of the channel without which the first start of a log is explained, None where it is no or more than one.

    A start that a fault of the rig file explains with all of them is the actuator's, and a suspected unit is told as such.
    """
    log = log.part(slice(0, CHUNK_ROWS))
    if not (rig.watched.servo and rig.driven.motor) or not np.isfinite(log.z).any(axis=0).all():
        return None
    if suspect_units(log, log_segments(log), rig.model) or _misfit(log, rig, settings) < CONTRADICTS:
        return None
    found = [
        c for c in range(len(CHANNELS)) if _misfit(without(log, c), rig, settings, healthy=True) < EXPLAINED
    ]
    return found[0] if len(found) == 1 else None


def is_of_the_actuator(verdict: Event) -> bool:
    """Whether a verdict is a fault of the actuator, likelier than all else; one without a name where it begins with the motion.

    What a changed circuit is told with its size is the motor's.
    """
    row = FAULTS.get(verdict.label)
    if verdict.label == NOMINAL or row is None or row.by_channel or verdict.probability <= ONE_OF_TWO:
        return False
    return verdict.label != UNKNOWN or (not verdict.severity and begins_with_the_motion(verdict))


def told_alone(log: Log, verdict: Event, rig: Rig, settings: Settings) -> tuple[int, ...]:
    """Indices of those of voltage and current without which a log is healthy up to the end of the verdict's move.

    None of them where that ends behind the first samples that are at hand, nor both where the verdict has no name: a circuit
    may have changed.
    """
    until = end_of_move(log, verdict, rig)
    if until is None:
        return ()
    names = (name for name in ELECTRICAL if healthy_without(until, name, verdict, rig, settings).explains)
    found = tuple(CHANNELS.index(name) for name in names)
    return () if verdict.label == UNKNOWN and len(found) > 1 else found


def end_of_move(log: Log, verdict: Event, rig: Rig) -> Log | None:
    """The log up to the end of a verdict's move, None where that is not at hand or voltage and current are not told."""
    first = log.part(slice(0, CHUNK_ROWS))
    whole = all(np.isfinite(first.z[:, CHANNELS.index(name)]).any() for name in ELECTRICAL)
    if not (rig.watched.servo and rig.driven.motor and whole) or verdict.end_s > first.t[-1]:
        return None
    return first.part(slice(0, int(np.searchsorted(first.t, verdict.end_s, "right"))))


class Healthy(NamedTuple):
    """How nominal explains a log: NIS over its expectation; times (n,) [s] in the verdict's move once its start has settled, and
    the largest means (n,) of innovations then; the friction, in spreads from rig to rig; the nats that the verdict's fault gains.
    """

    misfit: float
    t: Array
    means: Array
    friction: float | None
    gain: float

    @property
    def explains(self) -> bool:
        """Whether every move is healthy, no mean stays on one side, friction is what many rigs have, and no fault is told."""
        usual = self.friction is None or abs(self.friction) < UNUSUAL
        calm = self.misfit <= EXPLAINED and self.means.max(initial=0.0) <= LIMIT
        return calm and usual and self.gain < TELLS

    def sees_a_change(self, onset_s: float | None) -> bool:
        """Whether means leave where they were before an onset."""
        if onset_s is None:
            return False
        before = self.means[self.t < onset_s].max(initial=0.0)
        return bool(self.means.max(initial=0.0) > max(LIMIT, CHANGES * before))


def healthy_without(log: Log, channel: str, verdict: Event, rig: Rig, settings: Settings) -> Healthy:
    log = commanded(without(log, CHANNELS.index(channel)), rig)
    known = AsLogged(log, rig, settings.bank)
    taken = known.take(log)
    hypotheses = Bank(known.rig, known.settings).hypotheses
    nominal = Bank(known.rig, known.settings, hypotheses=hypotheses[:1])
    e, own = nominal.advance(taken), hypotheses[:1] + _of_the_actuator(hypotheses, verdict.label)
    told = Bank(known.rig, known.settings, hypotheses=own).advance(taken) if len(own) > 1 else e
    settled = e.active & (e.t > verdict.start_s + SETTLED_S)
    means = largest_means(e.normalised[settled], 1.0 / log.rate_hz, slice(0, len(CHANNELS)))
    friction = friction_in_spreads(verdict, nominal)
    return Healthy(told_by(e, taken.z).misfit, e.t[settled], means, friction, nats_of(told) - nats_of(e))


def _of_the_actuator(hypotheses: tuple[Hypothesis, ...], label: str) -> tuple[Hypothesis, ...]:
    """Those of a label, none where that is health, a sensor's, or none of the named."""
    named = label in FAULTS and not FAULTS[label].by_channel and label not in (NOMINAL, UNKNOWN)
    return tuple(h for h in hypotheses if named and label_of(h.name) == label)


def shared(outcome: Outcome, event: Event, doubted: Callable[[Event], Event], rig: Rig) -> Outcome:
    """The outcome with one of its events in doubt, and the verdict that follows."""
    found = outcome.isolation
    if found is None:
        return outcome
    which = event.start_s, event.label
    events = tuple(doubted(e) if (e.start_s, e.label) == which else e for e in found.events)
    verdict = log_verdict(list(events))
    told = replace(
        found,
        verdict=verdict,
        events=events,
        could_show=found.could_show if verdict.label == NOMINAL else None,
    )
    words = outcome.explanation if outcome.log is None else explanation(told, rig, outcome.log)
    return replace(outcome, isolation=told, explanation=words)


def without(log: Log, channel: int) -> Log:
    """The log without the readings of a channel."""
    z = log.z.copy()
    z[:, channel] = np.nan
    return replace(log, z=z)


def of_the_rest(
    outcome: Outcome, rest: Outcome, channels: Sequence[int], rig: Rig, words: str = NOT_AS_FILED
) -> Outcome:
    """`rest`, the verdict on a log without one of the `channels`, where a hypothesis of the actuator explains it.

    `outcome`, the verdict with it, else, and where the rest is healthy and a sensor is what fails.
    """
    found, before = rest.isolation, outcome.isolation
    if found is None or before is None or found.verdict.label in NO_FAULT_OF_IT:
        return outcome
    fits = found.consistency.nis_mean <= FITS * found.consistency.nis_expected
    if not fits or (found.verdict.label == NOMINAL and before.verdict.label == "sensor_fault"):
        return outcome
    column = " or ".join(COLUMNS[CHANNELS[c]] for c in channels)
    events = tuple(_told(event, column) for event in found.events)
    told = replace(found, verdict=_told(found.verdict, column), events=events)
    warnings = (words.format(column), *rest.warnings)
    said = rest.explanation if rest.log is None else explanation(told, rig, rest.log)
    return replace(rest, isolation=told, warnings=warnings, explanation=said)


def _told(event: Event, column: str) -> Event:
    """An event of the rest: health may as well be a sensor that had failed; of a fault nobody is surer than `SURE`."""
    if event.label == NOMINAL:
        return event if event.alike else or_else(event, "sensor_fault", _EITHER.format(column))
    return (
        event._replace(probability=SURE, posterior=mostly(event.label, event))
        if event.probability > SURE
        else event
    )


def _misfit(log: Log, rig: Rig, settings: Settings, healthy: bool = False) -> float:
    """How badly the best hypothesis of the actuator, or nominal, explains the first start: NIS over its expectation.

    0 where the log has no start that tells.
    """
    log = commanded(log, rig)
    known = AsLogged(log, rig, settings.bank)
    cut = first_start(known.take(log))
    if cut is None:
        return 0.0
    bank = Bank(known.rig, replace(known.settings, unknown=False, sensors=False))
    asked = Bank(known.rig, known.settings, hypotheses=bank.hypotheses[:1]) if healthy else bank
    return told_by(asked.advance(cut), cut.z).misfit
