"""Readings of a motor whose winding has an inductance, as one without would give them: V' = V - L di/dt.

Equation 2 leaves the inductance out, and i = (V' - Km w) / R then holds as it stands. The rate of the current comes from readings
on either side. Where that bends within a sample or two, as at the corners of a command, no reading tells the rate of the
moment: the voltage is then missing.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.physics import Rig
from observer_fi.records import Array, Log

OVER_S = 5e-4  # on either side of a reading, over which the rate of the current is taken: noise outgrows it over less
# What a bend may add: of the noise that the rate has, as some bends are chance, and of the noise of a reading of the voltage.
BY_CHANCE, NOTICED = 4.0, 1.5
FOURTH = 2.1  # a quarter of fourth differences of white noise, in its standard deviations
SIGMA_OF_MAD = 1.4826  # of normal noise
REACH = 3  # strides on either side, of which the doubt in a rate is made
MATTERS = 0.02  # of an interval between samples: the current of a winding with a shorter time constant has settled long before
STANDS = (
    16  # readings alike in motion, of a voltage that is taken as it is: it may be a sensor that got stuck
)
GAP = 1.5  # intervals between two samples from which one is missing


def change_rate(t: Array, y: Array, away: int) -> Array:
    """(n,) rate at which y (n,) changes, from the readings `away` samples before and after each, or the last ones at the ends."""
    before, after = _beside(t.size, away)
    return np.asarray((y[after] - y[before]) / (t[after] - t[before]))


def stride(rate_hz: float) -> int:
    """Samples on either side of a reading, over which the rate of the current is taken."""
    return max(1, round(OVER_S * rate_hz))


def _bends(t: Array, y: Array, away: int) -> Array:
    """(n,) by how much y (n,) bends around each sample, as an error of its rate: a quarter of its fourth difference."""
    before, after = _beside(t.size, away)
    bend = y[after] - 2.0 * y + y[before]
    return np.asarray(0.25 * np.abs(bend[after] - 2.0 * bend + bend[before]) / (0.5 * (t[after] - t[before])))


def _rate_doubt(bent: Array, away: int) -> Array:
    """(n,) by how much a rate may be off, of its `bends`: a bend between samples shows in one of three."""
    before, after = _beside(bent.size, away)
    return np.asarray(np.maximum(np.maximum(bent[before], bent[after]), bent))


def _chance_of(bent: Array, noise_std: float, interval_s: float, away: int) -> float:
    """Standard deviation of the `bends` of a current of which noise is all that there is. noise_std: of the rig file [A]."""
    known = bent[np.isfinite(bent)]
    seen = SIGMA_OF_MAD * float(np.median(known)) if known.size else 0.0
    return max(seen, FOURTH * noise_std / (away * interval_s))


class Uninductive:
    """Voltages of one log less what an inductance [H] makes of its current, chunk by chunk; noise_std: (3,) of the rig file.

    causal: whether a reading must do without those after it, as in a stream: its rate is then of those before it.
    """

    def __init__(self, inductance: float, noise_std: Array, interval_s: float, causal: bool = False) -> None:
        self.inductance, self.noise_std, self.interval, self.causal = (
            inductance,
            noise_std,
            interval_s,
            causal,
        )
        self.away = stride(1.0 / interval_s)
        self.before = np.empty((0, 2))  # time and current of the last samples
        self.voltage, self.same = np.nan, 0  # last reading, and how often it has been repeated
        self.chance: float | None = None

    def take(self, log: Log) -> Log:
        """The next chunk; as it is where no current is read, or there is no inductance."""
        if not self.inductance or not log.t.size or not np.isfinite(log.z[:, 1]).any():
            return log
        known = np.vstack((self.before, np.column_stack((log.t, log.z[:, 1]))))
        rate, doubt = self._causal(*known.T) if self.causal else self._central(*known.T)
        own = slice(len(self.before), None)
        z = log.z.copy()
        z[:, 0] -= self.inductance * rate[own]
        z[self.inductance * doubt[own] > self._most(), 0] = np.nan
        stands = self._stands(log.z[:, 0]) & (log.w_cmd != 0.0)
        z[stands, 0] = log.z[stands, 0]
        self.before = known[-REACH * self.away - 1 :]
        return replace(log, z=z)

    def _central(self, t: Array, i: Array) -> tuple[Array, Array]:
        """(n,) rates of the current, and by how much each may be off; none is known of the last samples."""
        bent = _bends(t, i, self.away)
        if self.chance is None:
            self.chance = _chance_of(bent, float(self.noise_std[1]), self.interval, self.away)
        rate, doubt = change_rate(t, i, self.away), _rate_doubt(bent, self.away)
        rate[t.size - self.away :] = np.nan
        if self.before.size == 0:
            rate[: self.away] = 0.0  # at rest
        rate[self._beside_gaps(t)] = np.nan
        return rate, np.nan_to_num(doubt)

    def _causal(self, t: Array, i: Array) -> tuple[Array, Array]:
        """The same of readings before each."""
        last = np.maximum(np.arange(t.size) - self.away, 0)
        past = (i - i[last]) / np.where(last < np.arange(t.size), t - t[last], np.inf)
        rate = past + 0.5 * (past - past[last])  # that of half a stride ago, and how it changes
        doubt = 0.5 * np.abs(past - 2.0 * past[last] + past[last][last])
        if self.chance is None:
            self.chance = max(
                SIGMA_OF_MAD * float(np.nanmedian(doubt)),
                float(self.noise_std[1]) / (self.away * self.interval),
            )
        rate[self._beside_gaps(t)] = np.nan
        return rate, np.nan_to_num(doubt)

    def _stands(self, voltage: Array) -> NDArray[np.bool_]:
        """(n,) whether a reading has been repeated for long: a sensor that stands still must be seen to."""
        changed = voltage != np.append(self.voltage, voltage[:-1])
        at = np.arange(1, voltage.size + 1)
        last = np.maximum.accumulate(np.where(changed, at, 0))
        same = np.where(last > 0, at - last, at + self.same)
        self.voltage, self.same = float(voltage[-1]), int(same[-1])
        return np.asarray(same >= STANDS)

    def _beside_gaps(self, t: Array) -> Array:
        """(n,) whether samples are missing where the rate would be taken."""
        broken = np.diff(t) > GAP * self.interval
        count = np.concatenate(([0], np.cumsum(broken)))
        before, after = _beside(t.size, self.away)
        return np.asarray(count[after] > count[before])

    def _most(self) -> float:
        """Error of the voltage from which on it counts as missing [V]."""
        by_chance = BY_CHANCE * self.inductance * (self.chance or 0.0)
        return float(np.hypot(by_chance, NOTICED * self.noise_std[0]))


def without_inductance(log: Log, inductance: float) -> Log:
    """A whole log whose voltage is that of a winding without this inductance [H], also where the current bends."""
    z = log.z.copy()
    z[:, 0] -= inductance * change_rate(log.t, z[:, 1], stride(log.rate_hz))
    return replace(log, z=z)


def without_winding(log: Log, rig: Rig) -> Log:
    """A whole log without what the inductance of a rig's winding makes of its voltage; as it is where none shows."""
    L = inductance_of(rig, log.rate_hz)
    return without_inductance(log, L) if L else log


def inductance_of(rig: Rig, rate_hz: float) -> float:
    """The inductance of a rig's winding [H]; 0 where none is known, and where no log of this rate shows it."""
    if rig.inductance is None or not rig.driven.motor or rig.model["Rm"] <= 0.0:
        return 0.0
    L = rig.inductance.value
    return L if MATTERS * rig.model["Rm"] / rate_hz < L else 0.0


def _beside(n: int, away: int) -> tuple[Array, Array]:
    """Indices (n,) of the samples before and after each, at the ends the last ones."""
    at = np.arange(n)
    return np.maximum(at - away, 0), np.minimum(at + away, n - 1)
