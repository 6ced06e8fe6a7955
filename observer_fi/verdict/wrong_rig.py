"""Whether a rig file describes the machine at all: a log of another actuator, or in another unit, is no faulty one."""

from collections.abc import Container, Sequence

from observer_fi.numerics import digits
from observer_fi.physics import NOMINAL, NOT_TESTED, UNKNOWN
from observer_fi.records import Consistency, Event, Outcome
from observer_fi.verdict.stuck import STANDS_STILL

SAID = "this rig file does not describe this machine"
FAR_OFF = 10.0  # times the expected NIS: a fault that nobody knows leaves the free hypothesis near 1
FAR_UNKNOWN = 4.0  # the same where the free hypothesis itself has won
CLEAN_S = 0.05  # of motion before a fault that nominal explains: on a wrong rig it explains none
AT_ONCE_S = 4e-3  # after a start: no fault comes with the motion, but a wrong rig does
FIRST_START_S = (
    0.06  # of a log, in which a sensor that fails is not told from one that was never what the rig file says
)
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


def or_never_fitted(event: Event) -> Event:
    """The first event of a log, of a sensor that did not fit from its first motion on shared with health; not one that stands."""
    at_once = event.onset_s is not None and event.onset_s - event.start_s <= FIRST_START_S
    stuck = any(STANDS_STILL in reason for reason in event.reasons)
    if event.label != "sensor_fault" or not at_once or stuck:
        return event
    posterior = dict.fromkeys(event.posterior, 0.0) | {NOMINAL: 0.5, "sensor_fault": 0.5}
    alike = tuple(dict.fromkeys((*event.alike, NOMINAL)))
    return event._replace(
        probability=0.5,
        posterior=posterior,
        alike=alike,
        isolated_s=None,
        reasons=(*event.reasons, _OR_NEVER_WAS),
    )


def _explained(verdict: Event, told: Container[float]) -> bool:
    """Whether the whole move is explained by a fault with a name, and by none in the motion before it."""
    onset, whole = verdict.onset_s, bool(verdict.severity) or verdict.start_s in told
    return whole and verdict.label != UNKNOWN and onset is not None and onset - verdict.start_s >= CLEAN_S


def wrong_rig(
    verdict: Event,
    events: Sequence[Event],
    consistency: Consistency,
    suspects: Sequence[str],
    told: Container[float] = (),
) -> str:
    """Why a fault that was found is none, "" where it may be one. suspects: what is odd about the size of channels.

    told: starts of the moves whose every sample a story explains. A rig that one move fits, the first of `events`, is this
    machine's, and one whose move a fault with a name explains that begins in motion which nominal does. The free hypothesis
    follows any torque and any voltage, so that even a fault without a name leaves it small innovations.
    """
    if verdict.label in (NOMINAL, NOT_TESTED) or (events and events[0].label == NOMINAL):
        return ""
    if not suspects and _explained(verdict, told):
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
