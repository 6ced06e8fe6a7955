"""What no voltage tells: a position that stands is a mass that was let go, or a sensor that died; the current says which."""

import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from observer_fi.bank import Bank
from observer_fi.logs import position_speed
from observer_fi.physics import NOMINAL, UNKNOWN, Rig
from observer_fi.records import CHANNELS, Array, Event
from observer_fi.verdict.drift import or_as_well
from observer_fi.verdict.stuck import of_dead_sensor, stuck_since

Mask = NDArray[np.bool_]
# By the label and channel of a verdict: what has the same position and nearly the same current. A position that stands, or a
# mass that does, whatever the motor turns (an obstacle that takes all the travel); a current that is more, or reads more: the one
# current that is measured misreads at will as a load does.
SAME_WITHOUT_VOLTAGE: dict[tuple[str, str | None], tuple[tuple[str, str | None], ...]] = {
    ("sensor_fault", "position"): (("coupling_loss", None),),
    ("coupling_loss", None): (("sensor_fault", "position"),),
    ("overload", None): (("coupling_loss", None), ("sensor_fault", "position")),
    ("slip", None): (("coupling_loss", None), ("sensor_fault", "position")),
    ("jam", None): (("sensor_fault", "current"),),
    ("unknown", None): (("sensor_fault", "current"),),
    ("sensor_fault", "current"): (("jam", None),),
}
MISREAD, OF_POSITION = ("sensor_fault", "current"), ("sensor_fault", "position")
PACE = 0.9  # of the speed before, that an obstacle leaves to no mass; faster by as much is no obstacle either
OF_CURRENT = ("jam", "unknown")
_WHY = {
    "coupling_loss": "the current changed as the position stopped: the load is gone, and not the sensor alone",
    "sensor_fault": "the current stayed as it was when the position stopped: the motor still moves its load",
}
BEFORE_S, AFTER_S = (0.35, 0.03), (0.1, 0.5)  # of an onset: where the current is steady
FEWEST = 10  # samples of a mean, or of a slope; where they take longer than that, in so long
SPIKE = 9.0  # times the median distance from a line, six standard deviations: none of a logger without spikes is so far
USUAL = 0.05  # by which a steady current changes from place to place, relative, 1 sigma
DOUBLE = 2.0  # neighbours of a sampled current say half of what they say alone
# Of the current before: a mass that is let go leaves more, so that less is a motor that is being stopped, which began so long
# before it shows.
BRAKES, BRAKED_S = 0.3, 0.03
CHANGED = 3.0  # standard deviations
# Relative change of the steady current: of 24 frozen positions none had more than the first, of 20 lost couplings none less than
# the second.
SAME_CURRENT, LEAST_LOST = 0.01, 0.06
STANDS = 0.03  # of the speed before: a mass that is slower stands
RISEN = 1.0, 1.0  # change of the current at an obstacle that takes all the travel, relative, and its 1 sigma


# Standard deviations of its noise: up to which a current is nothing, and which it had before. Of the speed before: a mass that
# is as fast is driven.
NOTHING, READS, GOES_ON = 5.0, 10.0, 0.5
_SAME_CURRENT = (
    "the current stayed as it was when the position stopped: the motor feels what it felt with its load"
)
_BETWEEN = (
    "the position stopped between two samples that are far apart: its sensor failed, or the mass was let go"
)
_READS_NOTHING = "the {0} reads nothing while the mass goes on for longer than a motor without {0} would turn"


# Of a mass without its motor: how long it stands while that is driven on; standard deviations by which it moves; share of its
# speed that it lost at least, and of that what the current may have taken where it did not take it.
LEFT_S, MOVES, LOST, TAKEN = 0.2, 6.0, 0.2, 0.4
# A steady speed, and how long one takes to become another; by what share of the difference it may drift.
STEADY_S, STEPS_S, DRIFTS = 0.4, 0.2, 0.3
_LEFT = (
    "the mass stopped while the current went on, which fell only later: a servo that held it in its place, or a motor that had "
    "left it"
)
UNCHANGED = 0.01  # of a voltage and a current that show the speed they showed, relative
_TURNS = "voltage and current show the motor at the speed that it had, while the position stands: the mass may have been let go"
STALLED = 0.5  # by which a current that grows is more than any friction of every day takes, relative
_STALLED = "the mass came to stand and its motor is driven harder: an obstacle or a jam would look so between so few samples"
_SLOWED = "the mass became slower, and the current shows nothing that would have slowed its motor: between two samples, or not"


class Around(NamedTuple):
    """What is around an onset. change: of the steady current, relative, None where it is not seen; noise: its standard error;
    pace: speed of the position after it, of that before it; None where that is not seen. voltage: its change, relative, and its
    standard error; conductance: of the current by the voltage before it [A/V].
    """

    change: float | None
    noise: float
    pace: float | None
    voltage: float | None = None
    voltage_noise: float = 0.0
    conductance: float = 0.0

    @property
    def stands(self) -> bool | None:
        """Whether the position does, None where that is not seen."""
        return None if self.pace is None else abs(self.pace) < STANDS


def without_voltage(event: Event, bank: Bank, rig: Rig, alike: float) -> Event:
    """The event of a log that measures no voltage, with the labels that nothing but the current tells from its own.

    alike: probability from which another label is named beside the verdict's.
    """
    if stuck_since(event, bank, rig, "current") is not None:
        return event
    since = lost_reading(event, bank, rig, "current")
    if since is not None:
        return (
            event
            if (event.label, event.channel) == MISREAD
            else of_dead_sensor(event, "current", since, _READS_NOTHING.format("current"))
        )
    key = event.label, event.channel
    others = SAME_WITHOUT_VOLTAGE.get(key, ())
    if not others:
        return event
    if key == MISREAD:
        same = dict.fromkeys((key, *others), 0.0)
        return event if _fallen(event, bank) else _shared(event, same, alike)
    if event.label in OF_CURRENT:
        return _or_misread(event, alike)
    seen = around(event, bank)
    if event.label == "slip" and not seen.stands and _changed(seen):
        return _or_misread(event, alike)
    if event.label == "overload" and seen.pace is not None and not seen.stands:
        other = _without_an_obstacle(seen)
        if other == ("slip", None) and presses_back(event):
            return event
        return event if other is None else _shared(event, {key: 0.0, other: 0.0}, alike)
    takes_all = event.label in ("overload", "slip")
    if (takes_all and not seen.stands) or (key == ("sensor_fault", "position") and seen.stands is False):
        return event
    if seen.change is None and others[0][0] in event.alike:
        return event
    nats = {other: _density(other[0], seen, rig) for other in (key, *others)}
    return _shared(event, nats, alike)


def lost_reading(event: Event, bank: Bank, rig: Rig, channel: str) -> tuple[float, float] | None:
    """The last sample of a faulty move at which its voltage or current read more than noise, and the first one after [s], where
    it is lost.

    It reads nothing until the motion is over, while the mass goes on for longer than a motor without it would coast
    (equation 1): only a load that drives it at just what friction takes would do the same.
    """
    recent, c = bank.recent, CHANNELS.index(channel)
    if recent is None or event.label == NOMINAL:
        return None
    there = (recent.t >= event.start_s) & (recent.t <= event.end_s) & recent.active
    t, y, x = recent.t[there], np.nan_to_num(recent.z[there, c]), recent.z[there, 2]
    read = np.flatnonzero(np.abs(y) > NOTHING * rig.noise_std[c])
    first = int(read[-1]) + 1 if read.size else t.size
    earlier = (t >= t[first] - BEFORE_S[0] - _longer(t)) & (t < t[first]) if first < t.size else there[:0]
    if not earlier.any() or np.abs(y[earlier]).mean() < READS * rig.noise_std[c]:
        return None
    before = slope_of(t[earlier], x[earlier])
    coast = 0.0 if before is None else abs(before) / rig.model["D"] * rig.model["J"] / rig.model["A"]
    later = t > t[first] + coast
    after, moves = slope_of(t[later], x[later]), MOVES * rig.noise_std[2]
    if before is None or after is None or not after / before > GOES_ON:
        return None
    # what stands has no speed to keep
    goes_on = min(_moved(before, t[earlier]), _moved(after, t[later])) > moves
    return (float(t[first - 1]), float(t[first])) if goes_on else None


def _moved(speed: float, t: Array) -> float:
    """The way at a speed [m/s] over some times [m]."""
    return abs(speed) * float(np.ptp(t))


def or_dead_voltage(event: Event, bank: Bank, rig: Rig) -> Event:
    """The event, or that of a dead voltage sensor where it reads nothing while the mass goes on."""
    since = lost_reading(event, bank, rig, "voltage")
    if since is None or (event.label, event.channel) == ("sensor_fault", "voltage"):
        return event
    return of_dead_sensor(event, "voltage", since, _READS_NOTHING.format("voltage"))


def _or_misread(event: Event, alike: float) -> Event:
    """The event or, as likely, a current sensor that misreads."""
    if "sensor_fault" in event.alike:
        return event
    return _shared(event, {(event.label, None): 0.0, ("sensor_fault", "current"): 0.0}, alike)


def or_frozen(event: Event, bank: Bank) -> Event:
    """A coupling loss or, as likely, a position that froze, where the steady current is seen to stay what it was.

    What the motor feels is then what it felt with the mass, by chance or because it still has it. A current too noisy to show
    what a lost mass leaves says nothing.
    """
    if event.label != "coupling_loss" or "sensor_fault" in event.alike:
        return event
    lasts = event.end_s if event.over_s is None else event.over_s
    seen = around(event._replace(end_s=lasts), bank)
    same = seen.change is not None and abs(seen.change) <= SAME_CURRENT + CHANGED * seen.noise
    if not same or CHANGED * seen.noise > LEAST_LOST:
        return event
    return or_as_well(event, "sensor_fault", _SAME_CURRENT)


def or_let_go(event: Event, bank: Bank) -> Event:
    """A position sensor that fails in a slow log or, as likely, a mass that was let go between two samples.

    Not where the position goes on, nor where the steady current is seen to stay what it was.
    """
    if (event.label, event.channel) != ("sensor_fault", "position") or "coupling_loss" in event.alike:
        return event
    seen = around(event, bank)
    same = seen.change is not None and abs(seen.change) <= SAME_CURRENT + CHANGED * seen.noise
    return event if same or seen.stands is False else or_as_well(event, "coupling_loss", _BETWEEN)


def or_left_behind(event: Event, bank: Bank, rig: Rig, alike: float) -> Event:
    """Health or, as likely, a mass that stands or is slower without its motor, where only a current tells of that."""
    recent = bank.recent
    if event.label != NOMINAL or event.alike or recent is None:
        return event
    of_it = (recent.t >= event.start_s) & (recent.t <= event.end_s) & np.isfinite(recent.z[:, 1:]).all(axis=1)
    t, i, x, w = recent.t[of_it], recent.z[of_it, 1], recent.z[of_it, 2], recent.w_cmd[of_it]
    stood = _stands_while_driven(t, x, w != 0.0, rig.model["D"])
    if stood is None and not _slows_unseen(t[w != 0.0], i[w != 0.0], w[w != 0.0], rig):
        return event
    nats: dict[tuple[str, str | None], float] = {("slip", None): 0.0, OF_POSITION: 0.0}
    if stood is not None:
        seen = around(event._replace(onset_s=stood), bank)
        nats = {key: _density(key[0], seen, rig) for key in (("coupling_loss", None), OF_POSITION)}
    health: dict[tuple[str, str | None], float] = {(NOMINAL, None): max(nats.values())}
    share = event._replace(posterior=dict.fromkeys(event.posterior, 0.0) | {NOMINAL: 1.0})
    told_as = _shared(share, health | nats, alike)
    return told_as._replace(isolated_s=None, reasons=(_SLOWED if stood is None else _LEFT,))


def _stands_while_driven(t: Array, x: Array, told: Mask, D: float) -> float | None:
    """When a mass at x (n,) came to stand for good, long before its motor is `told` to no more [s]; None where it did not."""
    last = int(np.flatnonzero(told)[-1]) if told.any() else t.size
    if last >= t.size - FEWEST // 2:
        return None
    w, _, std = position_speed(t, x, D)
    moves = np.flatnonzero(np.abs(w) > max(MOVES * std, STANDS * float(np.abs(w).max())))
    stood = int(moves[-1]) if moves.size else last
    return float(t[stood]) if last - stood >= FEWEST and t[last] - t[stood] > LEFT_S else None


def _slows_unseen(t: Array, i: Array, w: Array, rig: Rig) -> bool:
    """Whether a mass that goes at w (n,) [rad/s], of its motor, became slower at once, from one steady speed to another, and the
    current i (n,) shows next to nothing that would have taken as much from the motor (equation 1).
    """
    step = float(np.median(np.diff(t))) if t.size > 1 else math.inf
    size, apart = round(STEADY_S / step), round(STEPS_S / step)
    if size < FEWEST // 2 or t.size < 2 * size + apart:
        return False
    pieces = sliding_window_view(w, size)
    means, drifts = (
        pieces.mean(axis=1),
        np.abs(pieces[:, size // 2 :].mean(axis=1) - pieces[:, : size // 2].mean(axis=1)),
    )
    before, after = means[: -size - apart], means[size + apart :]
    lost = np.abs(before) - np.abs(after)
    steady = np.maximum(drifts[: -size - apart], drifts[size + apart :]) < DRIFTS * lost
    k = int(np.argmax(np.where(steady & (before * after > 0.0), lost / np.abs(before), 0.0)))
    if not steady[k] or lost[k] < LOST * abs(before[k]):
        return False
    first, last = (
        k + size // 2,
        k + size + apart + size // 2,
    )  # when between the two the speed changed, nobody knows
    level, later = float(np.median(i[k:first])), float(np.median(i[last : k + 2 * size + apart]))
    noise = float(np.std(i[k:first])) + float(np.std(i[last : k + 2 * size + apart]))
    taken = math.copysign(1.0, before[k]) * float((level - i[first:last]).sum()) * step
    taken *= rig.model["Km"] / rig.model["J"]
    return abs(later - level) < SAME_CURRENT * abs(level) + noise and taken < TAKEN * float(lost[k])


def or_still_turning(event: Event, bank: Bank, rig: Rig, alike: float) -> Event:
    """A voltage sensor that fails or, as likely, a mass that was let go: it stands, and voltage and current still show the motor
    at the speed that it had (equation 2).
    """
    recent, onset = bank.recent, event.onset_s
    if (event.label, event.channel) != ("sensor_fault", "voltage") or recent is None or onset is None:
        return event
    seen = around(event, bank)
    if not seen.stands or seen.change is None or seen.voltage is None:
        return event
    earlier = (recent.t > onset - BEFORE_S[0] - _longer(recent.t)) & (recent.t < onset - BEFORE_S[1])
    voltage, current, _ = np.nanmedian(recent.z[earlier], axis=0)
    dropped = rig.model["Rm"] * current
    turned, turns = voltage - dropped, voltage * (1.0 + seen.voltage) - dropped * (1.0 + seen.change)
    if abs(turns - turned) > UNCHANGED * abs(turned):
        return event
    nats: dict[tuple[str, str | None], float] = {
        (event.label, event.channel): 0.0,
        ("coupling_loss", None): 0.0,
    }
    told = _shared(event, nats, alike)
    return told._replace(isolated_s=None, reasons=(*event.reasons, _TURNS))


def or_stalled(event: Event, bank: Bank) -> Event:
    """A fault without a name or, as likely, an obstacle or a jam: a mass that came to stand, while its motor is driven harder
    than before, was stopped by one of them, however few samples show how.
    """
    if event.label != UNKNOWN or event.probability <= 0.5 or event.severity:
        return event
    seen = around(event, bank)
    if not seen.stands or seen.change is None or seen.change < STALLED:
        return event
    told = _shared(event, {(label, None): 0.0 for label in (UNKNOWN, "overload", "jam")}, 0.0)
    return told._replace(isolated_s=None, reasons=(*event.reasons, _STALLED))


def presses_back(event: Event) -> bool | None:
    """Whether the stiffness of an obstacle is one within its interval; None where none was found."""
    found = [s.interval for s in event.severity if s.name == "stiffness"]
    return not found[0][0] <= 0.0 <= found[0][1] if found else None


def feels_another_load(event: Event, bank: Bank) -> bool:
    """Whether the steady current behind an onset is another one than before it."""
    return _changed(around(event, bank))


def _without_an_obstacle(seen: Around) -> tuple[str, str | None] | None:
    """What goes on like a mass at an obstacle, and presses against none: a sensor whose mass is no slower, or a slip whose motor
    feels nothing; None where an obstacle takes speed and current.
    """
    assert seen.pace is not None
    if seen.pace > PACE:
        return OF_POSITION if seen.pace > 1.0 / PACE else MISREAD
    same = seen.change is not None and abs(seen.change) <= SAME_CURRENT + CHANGED * seen.noise
    return ("slip", None) if same else None


def _changed(seen: Around) -> bool:
    """Whether the steady current is another one: a nut that slips leaves it."""
    return seen.change is not None and abs(seen.change) > CHANGED * math.hypot(USUAL, seen.noise)


def _density(label: str, seen: Around, rig: Rig) -> float:
    """Log-density of the change of the current under a label [nats]; 0 of all where it was not seen.

    A motor that has lost its mass needs the share A'/A of its current, as far as that is known; one whose position sensor died
    needs what it needed.
    """
    if seen.change is None:
        return 0.0
    if label == "sensor_fault":
        return _log_density(seen.change, 0.0, math.hypot(USUAL, seen.noise))
    if label != "coupling_loss":
        return _log_density(seen.change, RISEN[0], math.hypot(RISEN[1], seen.noise))
    share = rig.model["A_decoupled"] / rig.model["A"]
    return _log_density(
        seen.change, share - 1.0, math.hypot(share * rig.spread("A_decoupled"), USUAL, seen.noise)
    )


def _shared(event: Event, nats: dict[tuple[str, str | None], float], alike: float) -> Event:
    """The event with the probability of some labels shared out anew among them."""
    top = max(nats.values())
    weights = {key: math.exp(max(value - top, -50.0)) for key, value in nats.items()}
    share = sum(event.posterior[label] for label, _ in nats) / sum(weights.values())
    posterior = event.posterior | {key[0]: share * weight for key, weight in weights.items()}
    label, channel = max(weights, key=lambda key: weights[key])
    told = event._replace(
        label=label,
        channel=channel,
        probability=posterior[label],
        posterior=posterior,
        alike=tuple(k for k, p in posterior.items() if k != label and p > alike),
    )
    return told if label == event.label else told._replace(reasons=(_WHY[label],), severity=())


def around(event: Event, bank: Bank, brakes: bool = True) -> Around:
    """What the current and the position do at an onset, as long as the motor is not being stopped.

    brakes: whether a current that is gone is a motor that is.
    """
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return Around(None, 0.0, None)
    since, longer = recent.t - onset, _longer(recent.t)
    i = np.where(recent.active, recent.z[:, 1], np.nan)
    earlier = (since > -BEFORE_S[0] - longer) & (since < -BEFORE_S[1])
    before = _mean(i[earlier])
    if before is None:
        return Around(None, 0.0, None)
    left = np.flatnonzero((since > 0.0) & (i * math.copysign(1.0, before[0]) < BRAKES * abs(before[0])))
    most = AFTER_S[1] + longer
    braked = float(since[left[0]]) - BRAKED_S if left.size and brakes else most
    until = min(most, braked, event.end_s - onset)
    later = (since > AFTER_S[0]) & (since < until)
    speeds = slope_of(recent.t[earlier], recent.z[earlier, 2]), slope_of(recent.t[later], recent.z[later, 2])
    pace = None if not speeds[0] or speeds[1] is None else speeds[1] / speeds[0]
    after = _mean(i[later])
    if after is None or abs(before[0]) < 3.0 * before[1]:
        return Around(None, 0.0, pace)
    noise = math.hypot(after[1], before[1]) / abs(before[0])
    given, gives = _mean(recent.z[earlier, 0]), _mean(recent.z[later, 0])
    change = after[0] / before[0] - 1.0
    if not (given and gives and given[0]):
        return Around(change, noise, pace)
    error = math.hypot(gives[1], given[1]) / abs(given[0])
    return Around(change, noise, pace, gives[0] / given[0] - 1.0, error, before[0] / given[0])


def _longer(t: Array) -> float:
    """Seconds by which a stretch must be longer for readings at t (n,) [s] to be as many as a mean needs."""
    return (
        max(0.0, (FEWEST + 2) * float(np.median(np.diff(t))) - (BEFORE_S[0] - BEFORE_S[1]))
        if t.size > 1
        else 0.0
    )


def _fallen(event: Event, bank: Bank) -> bool:
    """Whether the current is less after an onset than before it, of which a jam is no cause."""
    recent, onset = bank.recent, event.onset_s
    if recent is None or onset is None:
        return False
    since, i, longer = recent.t - onset, np.where(recent.active, recent.z[:, 1], np.nan), _longer(recent.t)
    before = _mean(i[(since > -BEFORE_S[0] - longer) & (since < -BEFORE_S[1])])
    after = _mean(i[(since > AFTER_S[0]) & (since < AFTER_S[1] + longer)])
    return (
        before is not None and after is not None and after[0] * math.copysign(1.0, before[0]) < abs(before[0])
    )


def slope_of(t: Array, x: Array) -> float | None:
    """Slope of a position [m/s], without its spikes; None of too few readings."""
    known = np.isfinite(x)
    if known.sum() < FEWEST:
        return None
    t, x = t[known] - t[known][0], x[known]
    off = np.abs(x - np.polyval(np.polyfit(t, x, 1), t))
    near = off <= SPIKE * float(np.median(off))
    return float(np.polyfit(t[near], x[near], 1)[0])


def _mean(i: Array) -> tuple[float, float] | None:
    """Mean of a current and its standard error [A]; None of too few readings."""
    known = i[np.isfinite(i)]
    if known.size < FEWEST:
        return None
    return float(known.mean()), float(known.std()) * math.sqrt(DOUBLE / known.size)


def _log_density(value: float, mean: float, std: float) -> float:
    return -0.5 * ((value - mean) / std) ** 2 - math.log(std)
