"""Zero of the current sensor, as motion in both directions tells it: two moves, or one that rings as it stops.

At rest two zero offsets show as one: of voltage and current only their difference is left (`electrical_offset`). In motion an
offset of the current is a torque that drives one way and brakes the other, which no friction does.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import Bank, bank
from observer_fi.logs import moves_from_rest
from observer_fi.numerics import count_in_rows
from observer_fi.physics import Rig, with_values
from observer_fi.records import Log, Segment
from observer_fi.settings import BankSettings
from observer_fi.verdict.drive_off import is_off
from observer_fi.verdict.moves.of_the_day import BEGIN, nats_of

MOVES, LONGEST_S, STOP_S = 4, 20.0, 0.2  # that are looked at, how much of them, and of the stop after one
# Nats that an offset must be worth, and how well nominal then fits: NIS over its expectation.
NOTICED_NATS, FITS = 40.0, 1.3
# Of the noise of a reading: half of how far hills are looked for at first, and how far at most; between two looks; and how well.
FIRST_REACH, FARTHEST, STEP, WITHIN = 6.0, 100.0, 1.5, 0.02
# Where a first look is taken, on either side, in noises; of the noise of a reading, from which a mean at rest is off.
PROBES, SHOWN = (STEP, 3.0 * STEP, 6.0 * STEP), 0.25

ELECTRICAL = np.array([True, True, False])  # of the channels

OffsetOf = Callable[[Rig], float]


class Said(NamedTuple):
    """Of some moves by the nominal filter: their nats, and its NIS in motion over its expectation."""

    nats: float
    misfit: float


def zero_current(log: Log, rig: Rig, settings: BankSettings, offset_of: OffsetOf) -> float:
    """Offset of the current sensor [A], 0 where no moves of the beginning of a log tell one.

    log: as filters may take it, but for the offset of its voltage, which is `offset_of` a rig.
    """
    if not rig.driven.motor or not np.isfinite(log.z[:, :2]).any(axis=0).all():
        return 0.0
    log = _driven(log, rig)
    for part in (*_both_ways(log), *_with_stops(log)):
        moves = _Moves(part, rig, settings, offset_of)
        hinted = moves.hint() > NOTICED_NATS
        zero = moves.best() if hinted else 0.0
        if moves.said(zero).misfit < FITS:
            return zero if hinted and moves.gain(zero) > NOTICED_NATS else 0.0
    return 0.0


def with_zero(rig: Rig, zero: float) -> Rig:
    """The rig whose current sensor is off by so much more [A]."""
    return with_values(rig, {"current_offset": rig.model["current_offset"] + zero}) if zero else rig


def said_by_nominal(log: Log, rig: Rig, settings: BankSettings, read: NDArray[np.int64]) -> Said:
    """What the nominal filter says of moves; read: (n,) readings of each sample."""
    e = Bank(rig, settings, hypotheses=bank(rig, settings)[:1]).advance(log)
    moving = e.active & (read > 0)
    misfit = float(np.mean(e.nis[moving, 0] / read[moving])) if moving.any() else math.inf
    return Said(float(np.nansum(e.density[BEGIN:, 0])), misfit)


class _Moves:
    """Moves that go both ways, by zeros of the current."""

    def __init__(self, log: Log, rig: Rig, settings: BankSettings, offset_of: OffsetOf) -> None:
        self.log, self.rig, self.settings, self.offset_of = log, rig, settings, offset_of
        self.read = count_in_rows(np.isfinite(log.z))
        self.known: dict[float, Said] = {}

    def said(self, zero: float) -> Said:
        """What nominal says of the moves."""
        if zero not in self.known:
            self.known[zero] = self._said(zero)
        return self.known[zero]

    def _said(self, zero: float) -> Said:
        rig, log = self._with(zero)
        return said_by_nominal(log, rig, self.settings, self.read)

    def hint(self) -> float:
        """Nats that are gained a little to one side, or farther where a rest shows an offset.

        Where a motor stands is no matter of a little.
        """
        voltage, current, _ = self.rig.noise_std.tolist()
        usual = math.hypot(voltage, self.rig.model["Rm"] * current)
        probes = PROBES if abs(self.offset_of(self.rig)) > SHOWN * usual else PROBES[:1]
        return max(self.said(at * current).nats for far in probes for at in (far, -far)) - self.said(0.0).nats

    def best(self) -> float:
        """The zero with which nominal explains the moves best.

        Where a motor sticks depends on it, so that there is more than one hill: all of them are looked at.
        """
        from scipy.optimize import minimize_scalar  # loads for as long as most logs are judged

        noise = float(self.rig.noise_std[1])

        def cost(steps: float) -> float:
            return -self.said(steps * noise).nats

        reach, top = FIRST_REACH, 0.0
        costs: dict[float, float] = {}
        while abs(top) > reach - STEP or not costs:
            reach *= 2.0
            costs |= {at: cost(at) for at in np.arange(-reach, reach + STEP, STEP) if at not in costs}
            top = min(costs, key=costs.__getitem__)
            if reach > FARTHEST:
                break
        found = minimize_scalar(
            cost, bounds=(top - STEP, top + STEP), method="bounded", options={"xatol": WITHIN}
        )
        return float(found.x) * noise

    def gain(self, zero: float) -> float:
        """Nats by which the bank, faults and all, explains the moves better than without it."""
        with_it, without = (
            Bank(rig, self.settings).advance(log) for rig, log in map(self._with, (zero, 0.0))
        )
        return nats_of(with_it) - nats_of(without)

    def _with(self, zero: float) -> tuple[Rig, Log]:
        rig = with_zero(self.rig, zero)
        off = np.array([self.offset_of(rig), 0.0, 0.0])
        return rig, replace(self.log, z=self.log.z - off)


def _driven(log: Log, rig: Rig) -> Log:
    """The log without voltage and current of a drive that is off: they are none, whatever the zeros are."""
    off = is_off(log, rig.noise_std)
    return replace(log, z=np.where(off[:, None] & ELECTRICAL, np.nan, log.z)) if off.any() else log


def _both_ways(log: Log) -> list[Log]:
    """Neighbouring moves of the first ones, from the rest before them on, that go both ways."""
    moves = moves_from_rest(log)
    pairs = zip(moves[:MOVES], [*moves[1 : MOVES + 1], *moves[-1:]], strict=False)
    parts = [_part(log, first, last.stop) for first, last in pairs]
    return [part for part in parts if (part.w_cmd > 0.0).any() and (part.w_cmd < 0.0).any()]


def _with_stops(log: Log) -> list[Log]:
    """The first moves one by one, from the rest before them until they stand: a servo that brakes turns back and forth."""
    moves = moves_from_rest(log)[:MOVES]
    ends = [min(move.end, int(np.searchsorted(log.t, _last_s(log, move) + STOP_S))) for move in moves]
    return [_part(log, move, end) for move, end in zip(moves, ends, strict=True)]


def _last_s(log: Log, move: Segment) -> float:
    return float(log.t[min(move.stop, log.t.size - 1)])


def _part(log: Log, move: Segment, end: int) -> Log:
    """The log from the rest before a move on, to no later than LONGEST_S after its start."""
    return log.part(slice(move.rest, min(end, int(np.searchsorted(log.t, log.t[move.start] + LONGEST_S)))))
