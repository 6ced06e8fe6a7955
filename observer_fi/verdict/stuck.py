"""What no sensor that works reads, whatever the machine: one that stands still to the last digit, a position that jumps farther
than any mass goes. Neither the bank nor a whole move need say so.
"""

import math

import numpy as np

from observer_fi.bank import Bank
from observer_fi.logs import stuck_from
from observer_fi.numerics import with_unit
from observer_fi.physics import NOMINAL, UNKNOWN, Rig
from observer_fi.records import CHANNELS, Array, Event
from observer_fi.verdict.drift import mostly

# Readings that stand for so long in motion that their noise does so once in e^30 are those of a dead sensor; noise of which a
# step is at most STEPS repeats a reading two thirds of the time at most, wherever between two steps the signal stands.
DEAD_NATS, REPEATS, STEPS = 30.0, 0.5, 2.0
EARLIER_S = 0.1  # by which a fault that has a name begins before a sensor fails of itself
POSITION = CHANNELS.index("position")
# A position is that of a failing sensor where it goes so many times as far as the motor, without a load, and the noise take it,
# and stays there, over AROUND readings either side; one that does so more often starts anew with each turn, or loses contact.
FASTER, AROUND, FEWEST, MOST_JUMPS = 10.0, 9, 3, 2
USUAL = 0.99  # quantile of the readings' speeds, below which even a rig file that is wrong has none that is a jump
STANDS_STILL = "stands still to the last digit, which no sensor that works does"


def of_a_stuck_sensor(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event as that of the sensor that got stuck in its move, if one did, and no fault had begun before."""
    found = [(name, since) for name in CHANNELS if (since := stuck_since(event, bank, rig, name)) is not None]
    if len(found) != 1:  # all at once are no sensor's
        return event
    channel, since = found[0]
    return _from_then_on(event, channel, since, f"the {channel} {STANDS_STILL}")


def stands_still(event: Event) -> bool:
    """Whether an event is that of a sensor which stands still to the last digit: no other fault does, nor a logger."""
    return any(STANDS_STILL in reason for reason in event.reasons)


def of_a_jumping_sensor(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event as that of the position's sensor where this jumped in its move, if it did, and no fault had begun before."""
    recent = bank.recent
    if recent is None or rig.logger is None:
        return event
    there = (recent.t >= event.start_s) & (recent.t <= event.end_s) & np.isfinite(recent.z[:, POSITION])
    t, x, traits = recent.t[there], recent.z[there, POSITION], rig.logger.position
    held_s = 1.0 / traits.update_hz if traits.update_hz else 0.0
    blur = traits.noise_std + (traits.resolution or 0.0)
    free_run = abs(rig.model["D"]) * rig.model["Vmax"] / rig.model["Km"]
    k = jump_in(t, x, held_s, blur, free_run)
    if k is None:
        return event
    size, within = (
        with_unit(float(v), unit) for v, unit in ((abs(x[k + 1] - x[k]), "m"), (t[k + 1] - t[k], "s"))
    )
    why = f"the position jumps by {size} within {within}, farther than the mass can go"
    return _from_then_on(event, "position", (float(t[k]), float(t[k + 1])), why)


def jump_in(t: Array, x: Array, held_s: float, blur: float, fastest: float) -> int | None:
    """The last reading (n,) before a position jumped, and stayed there, if it did. t [s], x [m], blur: of a reading [m].

    held_s: how long a reading is held. fastest: speed of the mass without a load [m/s].
    """
    if x.size < 2 * FEWEST:
        return None
    step, interval = np.diff(x), np.maximum(np.diff(t), held_s)
    possible = float(np.quantile(np.abs(step) / interval, USUAL))
    possible = max(possible, fastest) if math.isfinite(fastest) else possible
    jumps = np.flatnonzero(np.abs(step) > FASTER * (possible * interval + blur))
    if not 1 <= jumps.size <= MOST_JUMPS:
        return None
    k = int(jumps[0])
    before, after = x[max(k + 1 - AROUND, 0) : k + 1], x[k + 1 : k + 1 + AROUND]
    if min(before.size, after.size) < FEWEST:
        return None
    stays = (float(np.median(after)) - float(np.median(before))) / float(step[k])
    return k if stays > 0.5 else None


def _from_then_on(event: Event, channel: str, since: tuple[float, float], why: str) -> Event:
    """The event as that of a dead sensor, but where a fault that has a name had begun before. since: see `of_dead_sensor`."""
    named = event.label not in (NOMINAL, UNKNOWN, "sensor_fault")
    if named and event.onset_s is not None and event.onset_s < since[0] - EARLIER_S:
        return event
    return of_dead_sensor(event, channel, since, why)


def stuck_since(event: Event, bank: Bank, rig: Rig, channel: str) -> tuple[float, float] | None:
    """The last sample before a channel stood still to the last digit in a move, and the first one after [s], if it did.

    It stands until the rest after the move is over, between readings that were more and less, and for longer in motion than noise
    can repeat itself; a position that alone tells the motion is at rest where it stands, and its noise is that of a rest.
    """
    recent, c = bank.recent, CHANNELS.index(channel)
    if recent is None or rig.logger is None:
        return None
    there = (recent.t <= event.end_s) & np.isfinite(recent.z[:, c])
    t, z, moving = recent.t[there], recent.z[there, c], recent.active[there]
    first = stuck_from(z)
    traits = rig.logger[:3][c]
    if not first or not (traits.resolution or 0.0) <= STEPS * traits.noise_std:
        return None
    alone = channel == "position" and set(rig.watched.columns) <= {"current_a"}
    repeated = (t.size - first if alone else int(moving[first:].sum())) - 1
    lowest, highest = z[:first].min(), z[:first].max()
    inside = channel == "position" or lowest < z[first] < highest  # and no converter at the end of its range
    within_a_step = (
        math.erf(traits.resolution / traits.noise_std / math.sqrt(8.0)) if traits.resolution else 0.0
    )
    dead = -repeated * math.log(max(float(rig.repeats[c]), REPEATS, within_a_step)) >= DEAD_NATS
    return (float(t[first - 1]), float(t[first])) if inside and dead else None


def of_dead_sensor(event: Event, channel: str, onset: tuple[float, float], why: str) -> Event:
    """The event as that of a dead sensor. onset: the last sample before it, and its first one [s]."""
    known = (event.label, event.channel) == ("sensor_fault", channel)
    if known and not event.alike and event.onset_s is not None and event.onset_s > onset[0] - EARLIER_S:
        return event._replace(onset_s=onset[1], onset_interval_s=onset, reasons=(*event.reasons, why))
    posterior = mostly("sensor_fault", event)
    return event._replace(
        label="sensor_fault", channel=channel, probability=posterior["sensor_fault"], posterior=posterior, alike=(),
        onset_s=onset[1], onset_interval_s=onset, over_s=None, severity=(), then=(), reasons=(why,),
        isolated_s=event.isolated_s if known else None,
    )  # fmt: skip
