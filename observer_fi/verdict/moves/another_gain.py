"""A log's first move whose position shows another share of the motor's travel than the rig file says, from begin to end.

A slip that began before the log, a sensor that had failed by then, and a rig file with another lead, gear or gain of the
position look the same.
"""

import math

import numpy as np

from observer_fi.bank import Bank, LogSamples
from observer_fi.numerics import with_unit
from observer_fi.physics import NOMINAL, Rig
from observer_fi.records import Array, Estimate, Event
from observer_fi.settings import Settings
from observer_fi.verdict.drift import STOP_S, or_healthy
from observer_fi.verdict.moves.of_the_day import LEAST
from observer_fi.verdict.moves.pairs import Explained
from observer_fi.verdict.moves.whole_move import window_of

POSITION = 2
FEWEST = 50  # readings of the position under way, that tell its gain
MOST = 0.5  # relative: what lies beyond is another unit, or a mass that was lost


def or_another_gain(event: Event, bank: Bank, rig: Rig, settings: Settings, found: Explained | None) -> Event:
    """The event, shared with health where another gain of the position explains the whole move as well, and what was before the
    event's onset no worse than the rig file's.

    event: the first of a log; bank: with the move's samples at hand; found: the best story of the move.
    """
    of_position = event.label == "slip" or (event.label, event.channel) == ("sensor_fault", "position")
    window = window_of(event, bank, STOP_S) if of_position and NOMINAL not in event.alike else None
    gain = None if window is None else _gain(window[0], float(window[1].x[POSITION]), rig.model["D"])
    if window is None or gain is None:
        return event
    samples, memory = window
    nominal = Bank(rig, settings.bank, hypotheses=bank.hypotheses[:1])
    as_read = _nats(nominal.again(samples, memory))
    z, rest = samples.z.copy(), float(memory.x[POSITION])
    z[:, POSITION] = rest + (z[:, POSITION] - rest) / gain
    of_a_reading = np.where(np.isfinite(z[1:, POSITION]), math.log(gain), 0.0)
    gains = _nats(nominal.again(samples._replace(z=z), memory)) - of_a_reading - as_read
    least = -settings.decision.move_nats
    onset = samples.t[0] if event.onset_s is None else event.onset_s
    if gains[samples.t[1:] < onset].sum() <= least:
        return event
    story = (
        found.gain
        if found is not None
        else _nats(Bank(rig, settings.bank).again(*window)).sum() - as_read.sum()
    )
    return _shared(event, gain) if gains.sum() > story + least else event


def _nats(e: Estimate) -> Array:
    """(n - 1,) log-likelihoods of the readings of a move and of its stop: densities by the probabilities before them."""
    before = np.log(np.maximum(e.probability[:-1], LEAST))
    return np.logaddexp.reduce(before + e.density[1:], axis=1)


def _gain(samples: LogSamples, rest: float, lead: float) -> float | None:
    """Travel that the position shows over that of the command, None where it does not tell.

    rest: position before the move [m]; lead: of the motor's angle [m/rad]. The servo is a while behind its command.
    """
    step = np.diff(samples.t, prepend=samples.t[0])
    travel = lead * np.cumsum(samples.interval.mean(axis=1) * step)
    moved = samples.z[:, POSITION] - rest
    use = np.isfinite(moved) & samples.active
    if int(use.sum()) < FEWEST:
        return None
    columns = np.stack((travel, lead * samples.w_cmd), axis=1)[use]
    gain = float(np.linalg.lstsq(columns, moved[use], rcond=None)[0][0])
    return gain if abs(gain - 1.0) < MOST else None


def _shared(event: Event, gain: float) -> Event:
    """The event, or as well health on a machine that the rig file has slightly wrong."""
    share = with_unit(100.0 * abs(gain - 1.0), "%")
    why = (
        f"the position shows {share} {'more' if gain > 1.0 else 'less'} travel than the motor makes from the log's first motion "
        "to the move's end: a lead, a gear or a gain that the rig file has wrong looks the same; a log that begins with a "
        "healthy move tells"
    )
    return or_healthy(event, why)
