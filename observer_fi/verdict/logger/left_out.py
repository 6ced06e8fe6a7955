"""Whether one channel alone contradicts the rig file from a log's first motion on: it is not read as the rig file says.

Another unit, a leak between channels, a rectifier or a curved characteristic spoil one channel in every move. Without it the
first start is explained by what is left, with it by nothing; the log is then judged without it. Which channel it is must be
told: where two may be left out, neither is. A rig file of another machine explains its starts without none.
"""

from dataclasses import replace

import numpy as np

from observer_fi.bank import Bank
from observer_fi.logs import CHUNK_ROWS, log_segments, suspect_units
from observer_fi.physics import COLUMNS, NOMINAL, UNKNOWN, Rig, commanded
from observer_fi.records import CHANNELS, Event, Log, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict.drift import SURE, mostly, or_else
from observer_fi.verdict.explain import explanation
from observer_fi.verdict.logger.as_followed import NO_FAULT_OF_IT, is_odd
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.logger.lateness import first_start
from observer_fi.verdict.moves.of_the_day import told_by
from observer_fi.verdict.wrong_rig import begins_with_the_motion

# Times the expected NIS of a start: with all channels, and without the one that is wrong.
CONTRADICTS, EXPLAINED = 1.5, 1.15
FITS = 1.5  # times the expected NIS of the log that is left
NOT_AS_FILED = (
    "{} contradicts the other channels from the log's first motion on, and they do not contradict each other: the log was judged "
    "without it. It is read, scaled or filtered in another way than the rig file says, or had failed before: look at it with "
    "observer-fi inspect"
)
_EITHER = "without {}, which contradicts the others from the first motion on, the actuator is healthy"


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


def without(log: Log, channel: int) -> Log:
    """The log without the readings of a channel."""
    z = log.z.copy()
    z[:, channel] = np.nan
    return replace(log, z=z)


def of_the_rest(outcome: Outcome, rest: Outcome, channel: int, rig: Rig) -> Outcome:
    """`rest`, the verdict on a log without a `channel`, where a hypothesis of the actuator explains it.

    `outcome`, the verdict with it, else, and where the rest is healthy and a sensor is what fails.
    """
    found, before = rest.isolation, outcome.isolation
    if found is None or before is None or found.verdict.label in NO_FAULT_OF_IT:
        return outcome
    fits = found.consistency.nis_mean <= FITS * found.consistency.nis_expected
    if not fits or (found.verdict.label == NOMINAL and before.verdict.label == "sensor_fault"):
        return outcome
    column = COLUMNS[CHANNELS[channel]]
    events = tuple(_told(event, column) for event in found.events)
    told = replace(found, verdict=_told(found.verdict, column), events=events)
    warnings = (NOT_AS_FILED.format(column), *rest.warnings)
    words = rest.explanation if rest.log is None else explanation(told, rig, rest.log)
    return replace(rest, isolation=told, warnings=warnings, explanation=words)


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
