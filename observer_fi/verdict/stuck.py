"""A sensor that stands still to the last digit, which none with noise does: neither the bank nor a whole move need say so."""

import math

import numpy as np

from observer_fi.bank import Bank
from observer_fi.logs import stuck_from
from observer_fi.physics import NOMINAL, UNKNOWN, Rig
from observer_fi.records import CHANNELS, Event
from observer_fi.verdict.drift import mostly

# Readings that stand for so long in motion that their noise does so once in e^30 are those of a dead sensor; noise of which a
# step is at most STEPS repeats a reading half the time at most, wherever between two steps the signal stands.
DEAD_NATS, REPEATS, STEPS = 30.0, 0.5, 1.5
EARLIER_S = (
    0.1  # by which a fault that has a name begins before a sensor gets stuck that has nothing to do with it
)
STANDS_STILL = "stands still to the last digit, which no sensor that works does"


def of_a_stuck_sensor(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event as that of the sensor that got stuck in its move, if one did, and no fault had begun before."""
    found = [(name, since) for name in CHANNELS if (since := stuck_since(event, bank, rig, name)) is not None]
    if len(found) != 1:  # all at once are no sensor's
        return event
    channel, since = found[0]
    named = event.label not in (NOMINAL, UNKNOWN, "sensor_fault")
    if named and event.onset_s is not None and event.onset_s < since[0] - EARLIER_S:
        return event
    why = f"the {channel} {STANDS_STILL}"
    return of_dead_sensor(event, channel, since, why)


def stuck_since(event: Event, bank: Bank, rig: Rig, channel: str) -> tuple[float, float] | None:
    """The last sample of a move before a channel stood still to the last digit, and the first one after [s], if it did.

    It stands until the rest after the move is over, between readings that were more and less, and for longer in motion than noise
    can repeat itself.
    """
    recent, c = bank.recent, CHANNELS.index(channel)
    if recent is None or rig.logger is None:
        return None
    there = (recent.t >= event.start_s) & (recent.t <= event.end_s) & np.isfinite(recent.z[:, c])
    t, z, moving = recent.t[there], recent.z[there, c], recent.active[there]
    first = stuck_from(z)
    traits = rig.logger[:3][c]
    if not first or not (traits.resolution or 0.0) <= STEPS * traits.noise_std:
        return None
    repeated, lowest, highest = int(moving[first:].sum()) - 1, z[:first].min(), z[:first].max()
    inside = channel == "position" or lowest < z[first] < highest  # and no converter at the end of its range
    dead = -repeated * math.log(max(float(rig.repeats[c]), REPEATS)) >= DEAD_NATS
    return (float(t[first - 1]), float(t[first])) if inside and dead else None


def of_dead_sensor(event: Event, channel: str, onset: tuple[float, float], why: str) -> Event:
    """The event as that of a dead sensor. onset: the last sample before it, and its first one [s]."""
    known = (event.label, event.channel) == ("sensor_fault", channel)
    if known and event.onset_s is not None and event.onset_s > onset[0] - EARLIER_S:
        return event._replace(onset_s=onset[1], onset_interval_s=onset)
    posterior = mostly("sensor_fault", event)
    return event._replace(
        label="sensor_fault", channel=channel, probability=posterior["sensor_fault"], posterior=posterior, alike=(),
        onset_s=onset[1], onset_interval_s=onset, over_s=None, severity=(), then=(), reasons=(why,),
    )  # fmt: skip
