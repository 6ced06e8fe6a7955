"""What no voltage tells: a position that stands is a mass that was let go, or a sensor that died; the current says which."""

import math

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import Rig
from observer_fi.records import Array, Event

# By the label and channel of a verdict: what has the same position and nearly the same current. A position that stands, or a
# mass that does, whatever the motor turns; a current that is more, or reads more.
SAME_WITHOUT_VOLTAGE: dict[tuple[str, str | None], tuple[str, str | None]] = {
    ("sensor_fault", "position"): ("coupling_loss", None),
    ("coupling_loss", None): ("sensor_fault", "position"),
    ("jam", None): ("sensor_fault", "current"),
}
_WHY = {
    "coupling_loss": "the current changed as the position stopped: the load is gone, and not the sensor alone",
    "sensor_fault": "the current stayed as it was when the position stopped: the motor still moves its load",
}
BEFORE_S, AFTER_S = (0.35, 0.03), (0.1, 0.5)  # of an onset: where the current is steady
FEWEST = 10  # samples of a mean
USUAL = 0.05  # by which a steady current changes from place to place, relative, 1 sigma
DOUBLE = 2.0  # neighbours of a sampled current say half of what they say alone


def without_voltage(event: Event, bank: Bank, rig: Rig, alike: float) -> Event:
    """The event of a log that measures no voltage, with the label that nothing but the current tells from its own.

    alike: probability from which another label is named beside the verdict's.
    """
    other = SAME_WITHOUT_VOLTAGE.get((event.label, event.channel))
    if other is None:
        return event
    nats = 0.0 if event.label == "jam" else _let_go(event, bank, rig)
    if other[0] in event.alike and not nats:
        return event
    nats = -nats if event.label == "coupling_loss" else nats
    both = event.probability + event.posterior[other[0]]
    theirs = both / (1.0 + math.exp(-min(max(nats, -50.0), 50.0)))
    posterior = event.posterior | {event.label: both - theirs, other[0]: theirs}
    label, channel = other if theirs > both - theirs else (event.label, event.channel)
    told = event._replace(
        label=label,
        channel=channel,
        probability=posterior[label],
        posterior=posterior,
        alike=tuple(k for k, p in posterior.items() if k != label and p > alike),
    )
    return told if label == event.label else told._replace(reasons=(_WHY[label],), severity=())


def _let_go(event: Event, bank: Bank, rig: Rig) -> float:
    """Log-likelihood of the current around an onset with the mass let go, over that with the sensor dead [nats]; 0 where unknown.

    A motor that has lost its mass needs the share A'/A of its current, as far as that is known; one whose position sensor died
    needs what it needed.
    """
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return 0.0
    since = recent.t - onset
    i = np.where(recent.active, recent.z[:, 1], np.nan)
    before = _mean(i[(since > -BEFORE_S[0]) & (since < -BEFORE_S[1])])
    after = _mean(i[(since > AFTER_S[0]) & (since < AFTER_S[1]) & (recent.t <= event.end_s)])
    if before is None or after is None or abs(before[0]) < 3.0 * before[1]:
        return 0.0
    change = after[0] / before[0] - 1.0
    noise = math.hypot(after[1], before[1]) / abs(before[0])
    share = rig.model["A_decoupled"] / rig.model["A"]
    let_go = _log_density(change, share - 1.0, math.hypot(share * rig.spread("A_decoupled"), USUAL, noise))
    return let_go - _log_density(change, 0.0, math.hypot(USUAL, noise))


def _mean(i: Array) -> tuple[float, float] | None:
    """Mean of a current and its standard error [A]; None of too few readings."""
    known = i[np.isfinite(i)]
    if known.size < FEWEST:
        return None
    return float(known.mean()), float(known.std()) * math.sqrt(DOUBLE / known.size)


def _log_density(value: float, mean: float, std: float) -> float:
    return -0.5 * ((value - mean) / std) ** 2 - math.log(std)
