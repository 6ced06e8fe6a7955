"""Whether a rig file describes the machine at all: a log of another actuator, or in another unit, is no faulty one."""

from collections.abc import Container, Sequence

import numpy as np

from observer_fi.numerics import digits
from observer_fi.physics import NOMINAL, NOT_TESTED, UNKNOWN
from observer_fi.records import Consistency, Event, Outcome
from observer_fi.verdict.drift import or_as_well, or_else, or_healthy
from observer_fi.verdict.moves.circuit import is_dead
from observer_fi.verdict.moves.whole_move import FITS, SETTLED_S, WholeMove
from observer_fi.verdict.stuck import stands_still

SAID = "this rig file does not describe this machine"
FAR_OFF = 10.0  # times the expected NIS: a fault that nobody knows leaves the free hypothesis near 1
# The same, where the hypothesis that won is the least bad one only: of 50 right verdicts on the actuator through spoilt loggers
# one has 2.7, the next 1.7.
UNEXPLAINED = 2.5
FAR_UNKNOWN = 4.0  # the same where the free hypothesis itself has won
CLEAN_S = 0.05  # of motion before a fault that nominal explains: on a wrong rig it explains none
AT_ONCE_S = 4e-3  # after a start: no fault comes with the motion, but a wrong rig does
# After the first start of a log: a sensor that fails so soon is not told from one that was never what the rig file says.
FIRST_START_S = 0.06
_OR_NEVER_WAS = (
    "the channel contradicts the others from the log's first motion on, so that it may as well be read, scaled or filtered "
    "in another way than the rig file says, of a healthy actuator: a log that begins with a healthy move tells"
)

_FROM_THE_START = (
    f"{SAID}, or it had failed before the log begins: from the instant it first moves nothing that has a name fits. Learn the "
    "rig from healthy moves with observer-fi identify; if it was learned, look at the actuator"
)


def describes(outcome: Outcome) -> bool:
    """Whether a diagnosis takes its rig file for that of the machine."""
    return not any(warning.startswith(SAID) for warning in outcome.warnings)


def _from_the_start(verdict: Event) -> bool:
    """Whether a fault without a name begins with the motion itself."""
    onset = verdict.onset_s
    return verdict.label == UNKNOWN and onset is not None and onset - verdict.start_s <= AT_ONCE_S


def begins_with_the_motion(event: Event) -> bool:
    """Whether a fault begins with its move's start."""
    return event.onset_s is not None and event.onset_s - event.start_s <= FIRST_START_S


def or_never_fitted(event: Event) -> Event:
    """The first event of a log; one of a sensor that contradicts the others from its first motion on, or nobody knows since when,
    is shared with health.

    Not where the sensor stands still to the last digit, which no setting of a logger does.
    """
    fitted_before = event.onset_s is not None and not begins_with_the_motion(event)
    if event.label != "sensor_fault" or fitted_before or stands_still(event):
        return event
    return or_healthy(event, _OR_NEVER_WAS)


def or_unexplained(events: Sequence[Event], consistency: Consistency) -> tuple[Event, ...]:
    """The events of a log; those that a hypothesis of the actuator won which explains the log by far too badly may be anything.

    The likelihood only says which hypothesis is the least bad. Not where a sensor fails, which leaves the others to explain, nor
    where the whole move has told a fault with its size, which no filter of the bank has.
    """
    if not consistency.nis_mean > UNEXPLAINED * consistency.nis_expected:
        return tuple(events)
    why = (
        f"of all hypotheses it is the best, and still far from the readings (normalised innovation squared "
        f"{digits(consistency.nis_mean)}, {digits(consistency.nis_expected)} expected)"
    )
    return tuple(_or_unknown(event, why) for event in events)


def _or_unknown(event: Event, why: str) -> Event:
    if event.label in (UNKNOWN, NOT_TESTED, "sensor_fault") or event.severity or is_dead(event):
        return event
    return or_else(event, UNKNOWN, why) if event.label == NOMINAL else or_as_well(event, UNKNOWN, why)


def _explained(verdict: Event, told: Container[float]) -> bool:
    """Whether the whole move is explained by a fault with a name, and by none in the motion before it."""
    onset, whole = verdict.onset_s, bool(verdict.severity) or verdict.start_s in told
    return whole and verdict.label != UNKNOWN and onset is not None and onset - verdict.start_s >= CLEAN_S


def fits_at_first(whole: WholeMove, start_s: float, believable: float) -> bool:
    """Whether nominal explains a move from its start on until the ring of that is over: then the machine is the rig file's.

    believable: by how much the friction that it takes up may differ from the rig file's, as a share of that.
    """
    moving = whole.window.active & (whole.window.t >= start_s)
    settled = np.flatnonzero(moving & (whole.window.t >= start_s + SETTLED_S))
    if not settled.size:
        return False
    mean = np.cumsum(np.where(moving, whole.nis, 0.0)) / np.maximum(np.cumsum(moving), 1)
    fits = settled[mean[settled] <= FITS * whole.expected(whole.nominal)]
    return bool(fits.size) and abs(whole.friction(int(fits[0])) - 1.0) <= believable


def wrong_rig(
    verdict: Event,
    events: Sequence[Event],
    consistency: Consistency,
    suspects: Sequence[str],
    told: Container[float] = (),
    fitted: bool = False,
) -> str:
    """Why a fault that was found is none, "" where it may be one. suspects: what is odd about the size of channels.

    told: starts of the moves whose every sample a story explains. fitted: whether nominal explains the start of a move. A rig
    that one move fits, the first of `events`, or a start, is this machine's, and one whose move a fault with a name explains that
    begins in motion which nominal does. The free hypothesis follows any torque and any voltage, so that even a fault without a
    name leaves it small innovations.
    """
    if verdict.label in (NOMINAL, NOT_TESTED) or (events and events[0].label == NOMINAL):
        return ""
    if not suspects and (fitted or is_dead(verdict) or _explained(verdict, told)):
        return ""
    if suspects:
        return f"{SAID}, or a column has another unit or sign than its map says: {suspects[0]}"
    seen, expected = consistency.nis_mean, consistency.nis_expected
    if not seen > (FAR_UNKNOWN if verdict.label == UNKNOWN else FAR_OFF) * expected:
        return _FROM_THE_START if _from_the_start(verdict) else ""
    return (
        f"{SAID}: no hypothesis comes near its readings, not even one that allows for any torque and any voltage (normalised "
        f"innovation squared {digits(seen)}, {digits(expected)} expected). Look at the columns with observer-fi inspect, "
        "make a rig file with observer-fi rig new, and learn it from healthy moves with observer-fi identify"
    )
