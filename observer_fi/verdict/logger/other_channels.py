"""What the other channels say of a verdict that is sure of one: a sensor, or a fault of the actuator that a sensor shows alone.

What takes or adds a load shows in voltage and current too, a sensor that fails leaves the rest of the log healthy.
"""

from collections.abc import Callable

import numpy as np

from observer_fi.logs import is_recovered, quarter_of_a_ring
from observer_fi.physics import COLUMNS, FAULTS, NOMINAL, UNKNOWN, Rig
from observer_fi.records import CHANNELS, Event, Log, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict.drift import SURE, or_as_well, or_healthy
from observer_fi.verdict.logger.as_followed import NO_FAULT_OF_IT
from observer_fi.verdict.logger.left_out import ELECTRICAL, ONE_OF_TWO, end_of_move, healthy_without, shared

SAME_LOAD = (
    "voltage and current of the motor are those of a healthy move, as neither a lost coupling nor an obstacle leaves them: the "
    "position may as well be wrong"
)
A_LOAD_CAME = "voltage and current show another load from then on, as an obstacle brings it and a nut that slips does not"
OF_THE_COMMAND = (
    "the command was recovered from voltage and current: where one of them is wrong, so is the command"
)
OR_THE_OTHER = "{0} and {1} contradict each other, and either may be wrong: the log is healthy without {1}, and not without {0}"
AS_WELL = "the other channels are not those of a healthy move, and show {}: its sensor may be right, or both have failed"
OF_ITS_RING = (
    "it is over within the ring of a change of the command, which was recovered from voltage and current: where its corner is "
    "off by little, health looks so too"
)
RINGS = 3.5  # of a servo that a change of speed is followed by
LOUD = 2.0  # times the noise of the rig file: a position that no longer shows how an obstacle is met


def not_the_sensor_alone(log: Log, verdict: Event, rig: Rig, settings: Settings) -> int | None:
    """Index of a channel that is sure to have failed, where without it a log is not healthy up to the end of the verdict's move.

    None where it is, so that only the sensor fails, and where the log does not tell.
    """
    until = end_of_move(log, verdict, rig) if verdict.channel and verdict.probability > SURE else None
    if until is None or healthy_without(until, verdict.channel or "", verdict, rig, settings).explains:
        return None
    return CHANNELS.index(verdict.channel or "")


def with_the_actuator(outcome: Outcome, rest: Outcome, rig: Rig) -> Outcome:
    """The outcome of a failed sensor, shared with the faults of the actuator of which the rest of its channels tell one."""
    found, before = rest.isolation, outcome.isolation
    if found is None or before is None:
        return outcome
    said = found.verdict
    if said.label in NO_FAULT_OF_IT or NOMINAL in (said.label, *said.alike):
        return outcome
    labels = [label for label in (said.label, *said.alike) if label not in NO_FAULT_OF_IT]
    why = AS_WELL.format(" or ".join(FAULTS[label].words for label in labels))
    shares = {before.verdict.label: ONE_OF_TWO, **dict.fromkeys(labels, (1.0 - ONE_OF_TWO) / len(labels))}

    def shown(event: Event) -> Event:
        told = or_as_well(event, labels[0], why)
        return told._replace(posterior={**told.posterior, **shares}, alike=(*told.alike, *labels[1:]))

    return shared(outcome, before.verdict, shown, rig)


def or_another(outcome: Outcome, begin: Callable[[], Log], rig: Rig, settings: Settings) -> Outcome:
    """An outcome that is sure of what the other channels do not say, shared with what they say. begin: the first chunk."""
    verdict = outcome.isolation.verdict if outcome.isolation is not None else None
    if verdict is None or verdict.probability <= SURE:
        return outcome
    if _rings(verdict, begin, outcome, rig):
        return shared(outcome, verdict, lambda event: or_healthy(event, OF_ITS_RING), rig)
    if verdict.label in ("coupling_loss", "overload", "slip"):
        return _or_the_position(outcome, verdict, begin, rig, settings)
    if verdict.label == "sensor_fault" and verdict.channel in ELECTRICAL:
        return _or_the_other(outcome, verdict, begin, rig, settings)
    nameless = verdict.label == UNKNOWN and not verdict.severity
    if nameless and outcome.log is not None and is_recovered(outcome.log):
        return shared(outcome, verdict, lambda event: or_as_well(event, "sensor_fault", OF_THE_COMMAND), rig)
    return outcome


def _rings(verdict: Event, begin: Callable[[], Log], outcome: Outcome, rig: Rig) -> bool:
    """Whether a fault is over within the ring that follows a change of the command, which was recovered: off by as little as its
    corner is, it leaves a misfit there.
    """
    onset, over = verdict.onset_s, verdict.over_s
    if outcome.log is None or not is_recovered(outcome.log) or verdict.label == NOMINAL:
        return False
    ring_s = RINGS * 4.0 * quarter_of_a_ring(rig.model)
    if onset is None or over is None or over - onset > ring_s:
        return False
    log = begin()
    near = log.w_cmd[(log.t >= onset - ring_s) & (log.t <= over)]
    return bool(near.size) and float(np.ptp(near)) > 0.0


def _or_the_position(
    outcome: Outcome, verdict: Event, begin: Callable[[], Log], rig: Rig, settings: Settings
) -> Outcome:
    """A fault that the position tells, shared with what voltage and current say of the motor.

    A lost coupling takes its load from the motor, an obstacle adds one: where they see none go or come the position alone tells
    it, which may be what failed; of an obstacle, which shows where it is met, only one with much noise. A nut that slips leaves
    the load as it was: where they see another one from then on, an obstacle may be in the way.
    """
    until = end_of_move(begin(), verdict, rig)
    if until is None:
        return outcome
    motor = healthy_without(until, "position", verdict, rig, settings)
    hides = (
        outcome.acquisition is not None
        and outcome.acquisition.position.as_white > LOUD * rig.file_noise_std[2]
    )
    if motor.explains and (verdict.label == "coupling_loss" or (verdict.label == "overload" and hides)):
        return shared(outcome, verdict, lambda event: or_as_well(event, "sensor_fault", SAME_LOAD), rig)
    if verdict.label == "slip" and not verdict.then and motor.sees_a_change(verdict.onset_s):
        return shared(outcome, verdict, lambda event: or_as_well(event, "overload", A_LOAD_CAME), rig)
    return outcome


def _or_the_other(
    outcome: Outcome, verdict: Event, begin: Callable[[], Log], rig: Rig, settings: Settings
) -> Outcome:
    """A failed voltage or current, in doubt which of them it is where the log is healthy without the other one only."""
    own = verdict.channel or ""
    (other,) = set(ELECTRICAL) - {own}
    until = end_of_move(begin(), verdict, rig)
    if until is None or not healthy_without(until, other, verdict, rig, settings).explains:
        return outcome
    if healthy_without(until, own, verdict, rig, settings).explains:
        return outcome
    why = OR_THE_OTHER.format(COLUMNS[own], COLUMNS[other])
    return shared(
        outcome,
        verdict,
        lambda event: event._replace(probability=0.5, isolated_s=None, reasons=(*event.reasons, why)),
        rig,
    )
