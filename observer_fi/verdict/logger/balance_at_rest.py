"""Whether voltage and current still agree at rest: where the motor stands, the one is the other times the winding's resistance.

Equation 16 without speed. Nothing that happens to an actuator changes that, and no command is needed to see it; a sensor that
drifted, lost its zero or dropped out on the way does, however slowly it came.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.logs import SHORTEST_REST, rests_of
from observer_fi.numerics import in_python, with_unit
from observer_fi.physics import UNKNOWN, Rig, equations
from observer_fi.records import Acquisition, Log, Outcome
from observer_fi.verdict.drift import SURE, or_as_well
from observer_fi.verdict.logger.left_out import ELECTRICAL, shared

PARTS = 8  # of a rest, whose means tell how well its level is known
# Standard deviations of a level, and by what share a winding may differ from the rig file's: 65 K warmer.
SURELY, WINDING = 6.0, 0.25
FLOWS = 0.25  # of a drop, that a current must take in the winding to have a direction
_UNBALANCED = (
    "in the rest at {} voltage_v reads {} more for its current_a than in the rest before any move: one of the two drifts, or "
    "has lost its zero"
)


class _Level(NamedTuple):
    """What the voltage of a rest is beyond what the rig makes of its current [A], and how far that may be off [V]."""

    at_s: float
    volts: float
    doubt: float
    current: float


def or_unbalanced(outcome: Outcome, begin: Callable[[], Log], rig: Rig) -> Outcome:
    """The outcome of a log, sure of something else than voltage or current, shared with a failed sensor where these disagree at
    a rest as they did not in the one before the first move. begin: the first chunk of the log.

    A circuit that has changed, by a size that is told, explains it; and so does a voltage that turns its sign with the current,
    as brushes and the dead time of a converter drop it.
    """
    found, logger = outcome.isolation, outcome.acquisition
    if found is None or logger is None or not rig.driven.motor or found.verdict.channel in ELECTRICAL:
        return outcome
    circuit = found.verdict.label == UNKNOWN and bool(found.verdict.severity)
    if circuit or not found.verdict.probability > SURE:
        return outcome
    levels = _levels(begin(), logger, rig)
    off = [one for one in levels[1:] if abs(one.volts - levels[0].volts) > one.doubt + levels[0].doubt]
    if not off or _turns_with_current(off, levels[0], rig.model["Rm"]):
        return outcome
    why = _UNBALANCED.format(with_unit(off[0].at_s, "s"), with_unit(off[0].volts - levels[0].volts, "V"))
    return shared(outcome, found.verdict, lambda event: or_as_well(event, "sensor_fault", why), rig)


def _levels(log: Log, logger: Acquisition, rig: Rig) -> list[_Level]:
    """The levels of all rests, the first before any move; none where that is not in the log."""
    rests = rests_of(log.t, log.w_cmd, SHORTEST_REST)
    if not rests or rests[0].start > 0:
        return []
    found = (_level(log, rest, logger, rig) for rest in rests)
    levels = [one for one in found if one is not None]
    return levels if levels and levels[0].at_s == log.t[0] else []


def _level(log: Log, rest: slice, logger: Acquisition, rig: Rig) -> _Level | None:
    """The level of one rest, None where it is hardly read."""
    resistance = rig.model["Rm"]
    z = log.z[rest, :2]
    z = z[np.isfinite(z).all(axis=1)]
    if len(z) < SHORTEST_REST:
        return None
    volts = z[:, 0] - in_python(equations.terminal_voltage)(z[:, 1], 0.0, 0.0, rig.model.vector)
    means = np.array([float(np.median(part)) for part in np.array_split(volts, PARTS)])
    steps = (logger.voltage.resolution or 0.0) + resistance * (logger.current.resolution or 0.0)
    chance = SURELY * float(means.std()) / math.sqrt(PARTS)
    current = float(np.median(z[:, 1]))
    doubt = chance + steps + WINDING * resistance * abs(current)
    return _Level(float(log.t[rest.start]), float(means.mean()), doubt, current)


def _turns_with_current(off: Sequence[_Level], first: _Level, resistance: float) -> bool:
    """Whether rests are off by as much along the current, either way, as no sensor is that drifts, or reads nothing."""
    way = np.sign([one.current for one in off])
    volts = way * np.array([one.volts - first.volts for one in off])
    drop = float(np.median(volts))
    flows = resistance * np.abs([one.current for one in off]) > FLOWS * drop
    alike = np.abs(volts - drop) <= np.array([one.doubt + first.doubt for one in off])
    return drop > 0.0 and bool(flows.all() and alike.all()) and np.unique(way).size == 2
