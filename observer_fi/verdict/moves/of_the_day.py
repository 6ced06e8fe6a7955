"""What differs from day to day without being a fault, as the first start of a log tells it: winding, gains of servo and voltage.

They are no constants of the rig: a winding warms, and a servo's amplifier with it; a voltage is read through a divider. Each is
told where the motion with another value explains the start, and better than any fault with that of the rig file.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank
from observer_fi.physics import Rig, with_values
from observer_fi.records import Array, Estimate, Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.lateness import first_start

# Of the resistance of the rig file: copper has 0.39 % more a kelvin, and a winding that is cold or has run is 15 K cooler to 45 K
# warmer. What lies beyond is a fault.
# A servo's gains are over those of the rig file, readings of voltage and current over what the motor gets.
COARSE = {
    "winding": (0.94, 1.06, 1.12, 1.18),
    "gains": (0.8, 0.9, 1.1, 1.2),
    "voltage": (0.85, 0.92, 0.97, 0.99, 0.996, 1.004, 1.01, 1.03, 1.08, 1.15),
    "current": (0.85, 0.92, 0.97, 1.03, 1.08, 1.15),
}
FINER = (0.03, 0.015, 0.007, 0.0035)
LOOKED_AT = 0.85  # times the expected NIS: a start that is explained better tells of no other day
NOTICED_NATS, FITS = 40.0, 1.3  # that another day must gain at a start, and how well it then fits
MORE_NATS = 20.0  # that each further part of a day must gain
TOPS = 3  # parabolas, one after the other
BEGIN = 8  # samples until a filter has found its state
LEAST = 1e-300  # probability


class Day(NamedTuple):
    """winding, gains: resistance and the servo's gains over those of the rig file; voltage, current: readings over what they are;
    offset: of the voltage at rest, of readings over `voltage` [V].
    """

    winding: float = 1.0
    gains: float = 1.0
    voltage: float = 1.0
    current: float = 1.0
    offset: float = 0.0

    @property
    def usual(self) -> bool:
        """Whether the rig file's constants hold."""
        return self.winding == self.gains == self.voltage == self.current == 1.0

    def of(self, rig: Rig) -> Rig:
        """The rig as it is that day."""
        shares = {"Rm": self.winding, "Kp": self.gains, "Ki": self.gains, "current_gain": self.current}
        return with_values(rig, {n: s * rig.model[n] for n, s in shares.items() if s != 1.0})

    def true(self, z: Array) -> Array:
        """Readings (n, 3) with the voltage that the motor gets."""
        return z / np.array([self.voltage, 1.0, 1.0]) if self.voltage != 1.0 else z


class Told(NamedTuple):
    """Nats of a start on a day, its NIS in motion over its expectation, and the nats of that motion less those of as many
    samples at rest.
    """

    nats: float
    misfit: float
    by_motion: float


class FirstStart:
    """The first start of a log as filters may take it, but for the offset of its voltage: that is `offset_of` a rig and a gain
    of the voltage, as what a current at rest makes of it depends on the winding.
    """

    def __init__(
        self, log: Log, rig: Rig, settings: BankSettings, offset_of: Callable[[Rig, float], float]
    ) -> None:
        self.rig, self.offset_of, self.full = rig, offset_of, settings
        self.settings = replace(settings, unknown=False, sensors=False)
        cut = first_start(log, risen=True) if rig.driven.motor else None
        tells = cut is not None and rig.model["Rm"] > 0.0 and np.isfinite(log.z[:, :2]).any(axis=0).all()
        self.cut = cut if tells else None
        self.free = tuple(COARSE) if rig.watched.servo else ("winding",)
        self.known: dict[Day, Told] = {}

    def day(self) -> Day:
        """The day that explains the start, that of the rig file where the start does not tell."""
        usual = self._with(Day())
        if self.cut is None or self.told(usual).misfit < LOOKED_AT:
            return usual
        best, parts = usual, list[str]()
        while len(parts) < len(self.free) and self.told(best).misfit >= LOOKED_AT:
            left = [name for name in self.free if name not in parts]
            name, more = max(
                ((name, self._coarsely(best, name)) for name in left),
                key=lambda tried: self.told(tried[1]).nats,
            )
            if self.told(more).nats < self.told(best).nats + MORE_NATS:
                break
            parts.append(name)
            best = self._finer(more, parts)
        nats, misfit, _ = self.told(best)
        return best if misfit < FITS and nats > max(self._as_filed(usual), NOTICED_NATS) else usual

    def told(self, day: Day) -> Told:
        """How well the motion on a day explains the start, healthy or with a fault of the rig file."""
        if day not in self.known:
            self.known[day] = self._told(day, self.settings)
        return self.known[day]

    def _finer(self, day: Day, parts: list[str]) -> Day:
        """The best day near another one, of which these parts are not as usual.

        A start tells the gain of a voltage to 0.01 %: that is at the top of the parabola through its neighbours.
        """
        for step in FINER:
            for name in parts:
                day = self._best(day, name, [getattr(day, name) + more for more in (-step, step)])
        if day.voltage == 1.0:
            return day
        near = [self._with(day._replace(voltage=day.voltage + by)) for by in (-FINER[-1], 0.0, FINER[-1])]
        return self._best(day, "voltage", _vertex([(one.voltage, self.told(one).nats) for one in near]))

    def _coarsely(self, day: Day, name: str) -> Day:
        """The best day of those that differ in one part.

        The gain of a voltage is told more finely than they lie apart, so that the right one may be between two that explain
        nothing: it is at the top of the parabola through the best of them and its neighbours.
        """
        best = self._best(day, name, COARSE[name])
        if name != "voltage":
            return best
        values = sorted({*COARSE[name], day.voltage})
        for _ in range(TOPS):
            k = values.index(best.voltage)
            near = [self._with(day._replace(voltage=v)) for v in values[max(k - 1, 0) : k + 2]]
            top = _vertex([(one.voltage, self.told(one).nats) for one in near])
            best, values = self._best(best, name, top), sorted({*values, *top})
        return best

    def _best(self, day: Day, name: str, values: Sequence[float]) -> Day:
        """The best of some values of one part of the day."""
        tried = [self._with(day._replace(**{name: value})) for value in values]
        return max((day, *tried), key=lambda one: self.told(one).nats)

    def _with(self, day: Day) -> Day:
        """The day with the offset that its winding leaves at rest."""
        return day._replace(offset=self.offset_of(day.of(self.rig), day.voltage))

    def _as_filed(self, usual: Day) -> float:
        """Nats of the constants of the file with any fault, and of none with what another day must gain."""
        return max(self.told(usual).nats + NOTICED_NATS, self._told(usual, self.full).nats)

    def _told(self, day: Day, settings: BankSettings) -> Told:
        assert self.cut is not None
        cut = replace(self.cut, z=day.true(self.cut.z) - np.array([day.offset, 0.0, 0.0]))
        return told_by(Bank(day.of(self.rig), settings).advance(cut), cut.z)


def _vertex(points: Sequence[tuple[float, float]]) -> list[float]:
    """Where the parabola through three points (value, nats) has its top; none where they have no top between them."""
    if len(points) < 3:
        return []
    (a, low), (b, mid), (c, high) = points
    left, right = (mid - low) / (b - a), (high - mid) / (c - b)
    bent = (right - left) / (c - a)
    top = 0.5 * (a + b) - 0.5 * left / bent if bent < 0.0 else math.nan
    return [top] if a < top < c else []


def told_by(e: Estimate, z: Array) -> Told:
    """What the estimate of a start says of how well it is explained; z: its readings (n, 3)."""
    read = np.isfinite(z).sum(axis=1)
    moving = e.active & (read > 0)
    if not moving.any():
        return Told(-math.inf, math.inf, -math.inf)
    nis = e.nis[np.arange(e.t.size), e.probability.argmax(axis=1)]
    nats = _nats(e)
    rest = ~moving[BEGIN:]
    calm = float(nats[rest].mean()) if rest.any() else 0.0
    by_motion = float(nats[~rest].sum() - calm * np.count_nonzero(~rest))
    return Told(float(nats.sum()), float(np.mean(nis[moving] / read[moving])), by_motion)


def nats_of(e: Estimate) -> float:
    """Log-likelihood of the readings under the whole bank: each sample's densities by the probabilities before it."""
    return float(_nats(e).sum())


def _nats(e: Estimate) -> Array:
    """(n - BEGIN,) the same of each sample."""
    before = np.log(np.maximum(e.probability[BEGIN - 1 : -1], LEAST))
    return np.logaddexp.reduce(before + e.density[BEGIN:], axis=1)
