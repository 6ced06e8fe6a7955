"""A healthy move in which the noise of a channel changes while its motor runs steadily: its sensor may be what fails.

Where the noise of a logger wanders, or carries lines, filters give its readings so little weight that neither a burst of noise
nor a sensor at the end of its range shows in their innovations. The noise itself shows it.
"""

from collections.abc import Callable, Iterator

import numpy as np

from observer_fi.logs import SWITCHED, NoiseChange, noise_change, shown_by
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import COLUMNS, NOMINAL, Rig
from observer_fi.records import CHANNELS, Acquisition, ChannelTraits, Event, Log, Outcome
from observer_fi.verdict.drift import SURE, mostly, or_else
from observer_fi.verdict.logger.left_out import shared

ALL_READ = 0.9  # share of the rows with a reading, from which neighbours are readings in a row
_LOUDER = (
    "the noise of {} grows {} times at {}, while the motor runs steadily: another range, or a failing sensor"
)
_QUIETER = "the noise of {} falls to {} % at {}, while the motor runs steadily: the sensor may be at its limit, or stuck"
_BURST = "the noise of {} grows {} times at {}, while the motor runs steadily, as that of no other range does"


def or_a_changed_noise(outcome: Outcome, begin: Callable[[], Log], rig: Rig) -> Outcome:
    """The outcome, in which a healthy move may be one of a failed sensor where the noise of a channel changes within it.

    A sensor that became louder than another range makes it has failed, and not that of a channel which it contradicts. begin: the
    first chunk of the log.
    """
    found = outcome.isolation
    if found is None or outcome.acquisition is None or found.verdict.label not in (NOMINAL, "sensor_fault"):
        return outcome
    changes = list(_changes(begin(), outcome.acquisition))
    for name, change in changes:
        moved = (e for e in found.events if e.start_s <= change.at_s <= e.end_s)
        event = next(moved, None)
        if event is None:
            continue
        healthy = event.label == NOMINAL and not event.alike
        if healthy or (len(changes) == 1 and _blames_another(event, name, change)):
            return shared(outcome, event, lambda one: _failed(one, name, change), rig)  # noqa: B023
    return outcome


def _blames_another(event: Event, name: str, change: NoiseChange) -> bool:
    """Whether a sensor is said to fail where another one alone becomes louder than another range would make it."""
    other = event.label == "sensor_fault" and event.channel != name and change.factor > SWITCHED[1]
    return other and event.onset_s is not None and abs(event.onset_s - change.at_s) <= 2.0 * change.within_s


def _changes(log: Log, logger: Acquisition) -> Iterator[tuple[str, NoiseChange]]:
    """Channels whose noise changes; held readings count once, and of those in steps only noise that is larger than a step's."""
    for c, name in enumerate(CHANNELS):
        traits, z = getattr(logger, name), log.z[:, c]
        if not _shows_noise(traits):
            continue
        new = np.diff(z, prepend=np.nan) != 0.0 if traits.update_hz else np.ones(z.size, bool)
        floor = shown_by(traits.resolution or 0.0, name == "position")
        change = noise_change(log.t[new], z[new], log.w_cmd[new], floor)
        if change is not None:
            yield name, change


def _shows_noise(traits: ChannelTraits) -> bool:
    held = traits.hold_s is not None and traits.update_hz is None
    return not held and not traits.in_a_band and not traits.share and traits.read > ALL_READ


def _failed(event: Event, name: str, change: NoiseChange) -> Event:
    column, at = COLUMNS[name], with_unit(change.at_s, "s", count=4)
    if change.factor < 1.0:
        return or_else(event, "sensor_fault", _QUIETER.format(column, digits(100.0 * change.factor, 2), at))
    times = digits(change.factor, 2)
    if change.factor <= SWITCHED[1]:
        return or_else(event, "sensor_fault", _LOUDER.format(column, times, at))
    known = change.at_s - change.within_s, change.at_s + change.within_s
    return event._replace(
        label="sensor_fault", channel=name, probability=SURE, posterior=mostly("sensor_fault", event), onset_s=change.at_s,
        onset_interval_s=known, detected_s=change.at_s, reasons=(_BURST.format(column, times, at),),
    )  # fmt: skip
