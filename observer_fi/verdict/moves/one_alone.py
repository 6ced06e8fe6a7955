"""A voltage or a current that changes alone, while the mass goes on as it did: what its sensor reads, and no motor does.

What a motor draws more its winding takes from its speed, or asks of its voltage (equation 2).
"""

import math
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import Rig
from observer_fi.records import Array, Event
from observer_fi.verdict.drift import SURE, mostly, or_as_well
from observer_fi.verdict.moves.unloaded import (
    AFTER_S,
    BEFORE_S,
    CHANGED,
    DOUBLE,
    OF_POSITION,
    SAME_CURRENT,
    Around,
    around,
    slope_of,
)

MECHANICAL = ("unknown", "overload", "slip", "jam", "coupling_loss")
STEADY = 0.003  # by which voltage and current change together from place to place, relative, 1 sigma
SEEN = 0.5  # of what a change would ask of the other channels, what may be seen of it
_ALONE = "the {} alone changed: {} and speed of the position stayed what they were, which no motor does"
_PERHAPS = "the {} changed without the {}: its sensor may be what fails, but the position is too noisy to show the speed"


class Alone(NamedTuple):
    """The channel that changed while the other one did not; by what the speed would have changed were it true, relative."""

    channel: str
    other: str
    slower: float


class Pace(NamedTuple):
    """Speed of the position behind an onset, of that before it, and its standard error."""

    value: float
    noise: float


def or_of_one_alone(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event or, where the speed of the position and one of voltage and current stay what they were and the other one does
    not, that of its sensor.

    Of a position that fails with any servo; with one that nobody knows of every fault whose mass is seen to go on, which is
    shared where the position is too noisy to show the speed.
    """
    position = (event.label, event.channel) == OF_POSITION
    if not position and (rig.watched.servo or event.label not in (*MECHANICAL, "sensor_fault")):
        return event
    steady = _steady(event, bank)
    if steady is None:
        return event
    seen = around(event._replace(end_s=min(steady[1], event.end_s)), bank, brakes=False)
    alone, pace = _alone(seen, rig.model["Rm"]), _pace(event, bank, *steady)
    if (
        alone is None
        or pace is None
        or abs(pace.value - 1.0) > max(SEEN * alone.slower, CHANGED * pace.noise)
    ):
        return event
    if event.label == "sensor_fault" or CHANGED * pace.noise <= SEEN * alone.slower:
        return _of_its_sensor(event, alone)
    why = _PERHAPS.format(alone.channel, alone.other)
    return event if "sensor_fault" in event.alike else or_as_well(event, "sensor_fault", why)


def _alone(seen: Around, resistance: float) -> Alone | None:
    """Which of voltage and current changed alone, None where neither or both did, or they are not seen."""
    if seen.change is None or seen.voltage is None:
        return None
    dropped = resistance * seen.conductance  # in the winding, of the voltage
    if dropped >= 1.0:
        return None
    asks, spared = dropped * abs(seen.change), 1.0 / (1.0 - dropped)
    if _beyond(seen.change, seen.noise) and abs(seen.voltage) <= SEEN * asks - CHANGED * seen.voltage_noise:
        return Alone("current", "voltage", asks * spared)
    same = abs(seen.change) <= SAME_CURRENT + CHANGED * seen.noise
    if _beyond(seen.voltage, seen.voltage_noise) and same:
        return Alone("voltage", "current", abs(seen.voltage) * spared)
    return None


def _beyond(change: float, noise: float) -> bool:
    return abs(change) > CHANGED * math.hypot(STEADY, noise)


def _steady(event: Event, bank: Bank) -> tuple[float, float] | None:
    """From when until when the motor is told to go at the speed of the onset [s]; None where that is not at hand."""
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return None
    k = min(int(np.searchsorted(recent.t, onset)), recent.t.size - 1)
    other = np.flatnonzero(recent.w_cmd != recent.w_cmd[k])
    begun, over = other[other < k], other[other > k]
    first = recent.t[begun[-1]] if begun.size else recent.t[0]
    last = recent.t[over[0]] if over.size else recent.t[-1]
    return float(first), float(last)


def _pace(event: Event, bank: Bank, first: float, last: float) -> Pace | None:
    """The pace of a mass in a motion at one speed from first to last [s]; None where that is too short."""
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return None
    before = (recent.t > first + BEFORE_S[0]) & (recent.t < onset - BEFORE_S[1])
    after = (recent.t > onset + AFTER_S[0]) & (recent.t < min(last, event.end_s))
    was, goes = (_slope_and_error(recent.t[part], recent.z[part, 2]) for part in (before, after))
    if was is None or goes is None or not was[0]:
        return None
    return Pace(goes[0] / was[0], math.hypot(goes[1], was[1]) / abs(was[0]))


def _slope_and_error(t: Array, x: Array) -> tuple[float, float] | None:
    """Slope of a position and its standard error [m/s]; None of too few readings."""
    slope = slope_of(t, x)
    if slope is None:
        return None
    known = np.isfinite(x)
    t, x = t[known], x[known]
    return slope, float(np.std(x - slope * t)) * math.sqrt(DOUBLE / t.size) / float(np.std(t))


def _of_its_sensor(event: Event, alone: Alone) -> Event:
    """The event as that of the sensor of a channel that changed alone, as sure as a rule is."""
    why = _ALONE.format(alone.channel, alone.other)
    if event.label == "sensor_fault":
        return (
            event if event.channel == alone.channel else event._replace(channel=alone.channel, reasons=(why,))
        )
    return event._replace(
        label="sensor_fault", channel=alone.channel, probability=SURE, posterior=mostly("sensor_fault", event), alike=(),
        reasons=(why,), severity=(), over_s=None,
    )  # fmt: skip
