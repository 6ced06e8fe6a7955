"""Small and slow changes: means of nominal's innovations over the last tenths of a second to seconds.

What grows slowly never makes another hypothesis certain: the filters follow it. But their innovations stay on one side. An
exponentially weighted mean (Roberts 1959) costs nothing in memory and says when.
"""

import numpy as np

from observer_fi.bank import Bank, Hypothesis, HypothesisState
from observer_fi.numerics import first_beyond, weighted_means
from observer_fi.physics import FAULTS, NOMINAL, Rig
from observer_fi.records import Array, Event, Severity

TIMES_S = (0.1, 0.4, 1.6)  # over which innovations are averaged
# Standard deviations of such a mean. Healthy moves over nine kinds of command reach 5.3; a false one costs a look at the move.
LIMIT = 5.5
STOP_S = 0.5  # of the stop and the rest after a move belong to it: a mass that stands off by half its noise shows by then
SURE, Z95 = 0.95, 1.959964
TINY = 1e-300  # a probability, or a share, that is none
# Of the friction: by so much it may be up and down within a move on a usual day. What goes on to rise is a fault.
COMES_AND_GOES = 0.25
EVERYDAY = 0.08  # of the friction: a rise that is smaller, and no better explained than a usual day, is one
UNUSUAL = 3.3  # standard deviations of the spread of rigs: one healthy one in 2000 has as high a friction
CHANNELS = slice(
    1, 3
)  # current and position: a voltage also follows inertias that a rig file has slightly wrong


def usual_rise(rig: Rig) -> float:
    """Relative rise of the friction that is none of its faults: half of what it has from one day to the next [1]."""
    return 0.5 * rig.spread("A")


def of_every_day(event: Event) -> bool:
    """Whether a friction has risen, or fallen, by no more than it does on a usual day."""
    return all(abs(s.value) < EVERYDAY for s in event.severity if s.name == "friction_rise")


class Drift:
    """Watches one move. since: when a mean was first beyond the limit [s], None so far."""

    def __init__(self) -> None:
        self.means: list[Array] = [np.zeros(2) for _ in TIMES_S]
        self.variances: list[Array] = [np.zeros(2) for _ in TIMES_S]
        self.since: float | None = None

    def add(self, t: Array, normalised: Array, interval: float) -> None:
        """Take the next samples under way.

        normalised: (n, 3) innovations over their deviations, 0 where they do not count, NaN where there is no reading.
        """
        if self.since is not None or not t.size:
            return
        z, kept = normalised[:, CHANNELS], zip(TIMES_S, self.means, self.variances, strict=True)
        first = min(
            first_beyond(z, min(interval / time, 1.0), mean, variance, LIMIT) for time, mean, variance in kept
        )
        if first < t.size:
            self.since = float(t[first])


def largest_means(normalised: Array, interval: float, channels: slice = CHANNELS) -> Array:
    """The largest mean of any of the channels over any of the times, in its standard deviations, at each of (n, 3) innovations,
    (n,).

    They come after a long calm, and those of a channel with fewer readings than rows are as uncertain as these are few.
    """
    z, largest = normalised[:, channels], np.zeros(len(normalised))
    there = np.isfinite(z).astype(np.float64)
    share = there.mean(axis=0) if len(there) else there.sum(axis=0)
    for time in TIMES_S:
        weight = min(interval / time, 1.0)
        mean = weighted_means(np.nan_to_num(z), weight, np.zeros(z.shape[1]))
        part = np.maximum(weighted_means(there, weight * (2.0 - weight), share.copy()), TINY)
        largest = np.maximum(largest, (np.abs(mean) / np.sqrt(weight / (2.0 - weight) * part)).max(axis=1))
    return largest


def mostly(label: str, event: Event) -> dict[str, float]:
    """Probabilities of all labels where one has `SURE` by a rule and no likelihood tells the others apart."""
    others = (1.0 - SURE) / (len(event.posterior) - 1)
    return {k: SURE if k == label else others for k in event.posterior}


def or_else(event: Event, label: str, why: str = "") -> Event:
    """A healthy event that may as well have a fault of this label; why: a reason to tell."""
    posterior = dict.fromkeys(event.posterior, 0.0) | {NOMINAL: 0.5, label: 0.5}
    reasons = (why,) if why else event.reasons
    return event._replace(probability=0.5, posterior=posterior, alike=(label,), reasons=reasons)


def or_as_well(event: Event, label: str, why: str) -> Event:
    """A faulty event that may as well be of this label; why: a reason to tell."""
    posterior = dict.fromkeys(event.posterior, 0.0) | {label: 0.5, event.label: 0.5}
    alike = tuple(dict.fromkeys((*event.alike, label)))
    reasons = (*event.reasons, why)
    return event._replace(probability=0.5, posterior=posterior, alike=alike, isolated_s=None, reasons=reasons)


def or_healthy(event: Event, why: str) -> Event:
    """A faulty event that may as well be none; why: a reason to tell."""
    return or_as_well(event, NOMINAL, why)


def raised_friction(event: Event, bank: Bank, strain_limit: float) -> Event:
    """A move that began with a friction as no rig of the rig file has, which nominal took up: jammed from its first sample on.

    strain_limit: standard deviations of the spread from rig to rig that are believable.
    """
    known = _after_the_start(event, bank) if event.label == NOMINAL else None
    if known is None:
        return event
    memory, slope = known
    return jammed_before(event, memory, bank.hypotheses[0], bank.rig, strain_limit, slope)


def friction_in_spreads(event: Event, bank: Bank) -> float | None:
    """How much higher than the rig file's friction and gravity are after the start of a move, in spreads from rig to rig."""
    known, nominal = _after_the_start(event, bank), bank.hypotheses[0]
    if known is None or "A" not in nominal.states or not bank.rig.spread("A"):
        return None
    return risen_drag(nominal, *known)[0] / _spread(nominal, known[1], bank.rig)


def _after_the_start(event: Event, bank: Bank) -> tuple[HypothesisState, float] | None:
    """What nominal knows once a start is over, and the pitch against the motion [deg]; None where it is no longer at hand."""
    recent = bank.recent
    if (
        recent is None or not bank.snapshots or event.end_s < bank.snapshots[0][0]
    ):  # as of most moves of a long log
        return None
    known = [(t, state) for t, state in bank.snapshots if event.start_s + TIMES_S[1] < t <= event.end_s]
    if not known:
        return None
    k = min(int(np.searchsorted(recent.t, known[0][0])), recent.t.size - 1)
    return known[0][1], float(np.sign(recent.w_cmd[k]) * recent.theta[k])


def _shares(nominal: Hypothesis, slope: float) -> dict[str, float]:
    """Of what friction and gravity take together (equation 1), by how much each constant that is in doubt changes it [1]."""
    model = nominal.model
    shares = {"A": 1.0, "B": model["B"] * slope / model["A"]}
    return {name: share for name, share in shares.items() if name in nominal.states}


def risen_drag(nominal: Hypothesis, memory: HypothesisState, slope: float) -> tuple[float, float]:
    """By how much friction and gravity together are above those of the rig file, and the standard deviation of that.

    Both in units of the rig file's friction. slope: pitch against the motion [deg].
    """
    shares = _shares(nominal, slope)
    if not shares:
        return 0.0, 0.0
    at, c = [nominal.states.index(name) for name in shares], np.array([*shares.values()])
    var = float(c @ memory.P[np.ix_(at, at)] @ c)
    return float(c @ (memory.x[at] - 1.0)), float(np.sqrt(max(var, 0.0)))


def _spread(nominal: Hypothesis, slope: float, rig: Rig) -> float:
    """Spread from rig to rig of friction and gravity together, in units of the rig file's friction."""
    shares = _shares(nominal, slope)
    return float(np.hypot.reduce([rig.spread(name) * share for name, share in shares.items()]))


def jammed_before(
    event: Event, memory: HypothesisState, nominal: Hypothesis, rig: Rig, strain_limit: float, slope: float
) -> Event:
    """The event as a jam from its first sample on where nominal's memory has a friction as no rig has; either where few have it.

    slope: pitch against the motion [deg]. In one move nothing tells friction from what gravity does on it: their sum counts.
    """
    if "A" not in nominal.states or not rig.spread("A"):
        return event
    rise, std = risen_drag(nominal, memory, slope)
    spread = _spread(nominal, slope, rig)
    if rise < UNUSUAL * spread or std > spread:
        return event
    factor = 1.0 + rise
    if rise < strain_limit * spread:
        return or_else(
            event,
            "jam",
            f"friction is {factor:.2f} times that of the rig file from the start on: it rose then, or this rig's is so",
        )
    half = Z95 * float(np.hypot(std, factor * rig.spread("A")))
    own = next(own for own in FAULTS["jam"].sizes if own.of_friction)
    return event._replace(
        label="jam", probability=SURE, posterior=mostly("jam", event), onset_s=event.start_s, detected_s=event.start_s,
        onset_interval_s=(event.start_s, event.start_s), alike=(NOMINAL,),
        severity=(Severity(own.tells or "friction_rise", rise, (rise - half, rise + half), "1", own.says(rise, "1")),),
        reasons=(f"friction is {factor:.2f} times that of the rig file from the first sample on: jammed before, or another rig",),
    )  # fmt: skip
