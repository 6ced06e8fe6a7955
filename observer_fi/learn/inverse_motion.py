"""A log of commanded force and position, filtered, differentiated and decimated: what inverse dynamics works on.

The filters are those of Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019 (Script_IDIM_LS.m).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.records import Array, Log

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class InverseSettings:
    """Filters of the published recipe, and which samples count.

    position_cutoff_hz: 4th-order Butterworth, forward and backward, before differentiating; five times the band of
    20 Hz in which the rig moves. band_hz: what the decimation keeps. border: samples left out at the start.
    edge: decimated samples at the end that are scored but not fitted, for both low-passes end there.
    block_s: length of the parts that are held out in turn, about a stroke there and back.
    rest_share, rest_s: slower than this share of the top speed for this long is a rest, where friction may have any
    value: samples that it reaches through the filters are left out. A reversal under way is not one (EMPS: 7 ms).
    """

    position_cutoff_hz: float = 100.0
    band_hz: float = 40.0
    border: int = 49
    edge: int = 6
    block_s: float = 6.2
    rest_share: float = 0.005
    rest_s: float = 0.02


@dataclass(frozen=True)
class Motion:
    """One log, differentiated: x m, v m/s, a m/s^2, jerk m/s^3, force N, theta deg at the log's rate (n,).

    t (m,) s: the decimated samples; use (m,): which of them count; step s, factor: of the decimation; block_s: length
    of the parts that are held out in turn; noise m: of the position sensor.
    """

    name: str
    x: Array
    v: Array
    a: Array
    jerk: Array
    force: Array
    theta: Array
    clock: Array
    t: Array
    use: Mask
    step: float
    factor: int
    block_s: float
    noise: float

    @property
    def acceleration_noise(self) -> float:
        """Standard deviation of the acceleration that the noise of the position makes in the fitted band [m/s^2]."""
        band = 0.4 / (self.factor * self.step)  # what the decimation keeps
        return self.noise * math.sqrt(2.0 * self.step * (2.0 * math.pi) ** 4 * band**5 / 5.0)

    @property
    def kept(self) -> slice:
        """Which samples of the log's rate the decimated ones are."""
        return slice(_first_kept(self.x.size, self.factor) if self.factor > 1 else 0, None, self.factor)

    def between(self, start_s: float, end_s: float) -> "Motion":
        """The same motion, of which only the samples with start_s <= t < end_s count."""
        return replace(self, use=self.use & (self.t >= start_s) & (self.t < end_s))


def low_passed(columns: Array, motion: Motion) -> Array:
    """(m, ...) columns (n, ...) decimated as Matlab's `decimate`: Chebyshev forward and backward, the last sample kept."""
    if motion.factor == 1:
        return columns
    filtered = zero_phase(scipy.signal.cheby1(8, 0.05, 0.8 / motion.factor), columns)
    return filtered[motion.kept]


def _first_kept(n: int, factor: int) -> int:
    return factor - (factor * math.ceil(n / factor) - n) - 1


def zero_phase(coefficients: tuple[Array, Array], values: Array) -> Array:
    b, a = coefficients
    return scipy.signal.filtfilt(
        b, a, values, axis=0, padlen=3 * (max(len(a), len(b)) - 1)
    )  # Matlab's padding


def slope(values: Array, step: float) -> Array:
    """Central difference, one-sided at the ends."""
    inside = (values[2:] - values[:-2]) / 2
    return np.concatenate(([values[1] - values[0]], inside, [values[-1] - values[-2]])) / step


def sensor_noise(x: Array) -> float:
    """Standard deviation of white noise of a position (n,) [m], from its sixth differences, outliers aside."""
    low, high = np.percentile(np.diff(x, 6), (16.0, 84.0))
    return float(high - low) / 2.0 / math.sqrt(math.comb(12, 6))


def prepare_motion(log: Log, settings: InverseSettings | None = None) -> Motion:
    """The log filtered, differentiated and decimated. Raises InvalidLogError where it holds no force or no motion."""
    settings = settings or InverseSettings()
    t, x, force, known = _uniform(log)
    step = float(t[-1] - t[0]) / (t.size - 1)
    noise = sensor_noise(x)
    x = zero_phase(scipy.signal.butter(4, min(settings.position_cutoff_hz * 2 * step, 0.8)), x)
    v = slope(x, step)
    a = slope(v, step)
    keep = slice(settings.border, None)
    factor = max(round(0.8 * 0.5 / (step * settings.band_hz)), 1)
    pitch = np.interp(t, log.t, log.pitch)
    n = t[keep].size
    reach = (
        6 * factor
    )  # the response of the decimation to a force of 20 N that no column explains is below 0.1 N
    counts = (known & _moving(v, step, settings))[keep]
    rows = np.arange(_first_kept(n, factor), n, factor) if factor > 1 else np.arange(n)
    use = np.array([counts[max(k - reach, 0) : k + reach + 1].all() for k in rows])
    use[use.size - settings.edge :] = False
    jerk = slope(a, step)[keep]
    x, v, a, force, pitch, t = (y[keep] for y in (x, v, a, force, pitch, t))
    return Motion(
        log.path, x, v, a, jerk, force, pitch, t, t[rows], use, step, factor, settings.block_s, noise
    )


def _uniform(log: Log) -> tuple[Array, Array, Array, Mask]:
    """The log on an even clock, with gaps bridged and marked (they are neither fitted nor scored)."""
    if log.force is None:
        raise InvalidLogError(f"{log.path}: column force_cmd_n is missing; a rig driven by force needs it")
    x = log.z[:, 2]
    good = np.isfinite(x) & np.isfinite(log.force)
    if np.count_nonzero(good) < 1000 or np.ptp(x[good]) == 0.0:
        raise InvalidLogError(
            f"{log.path}: no motion to learn from; record a second or more of moves in both directions"
        )
    n = round(float((log.t[-1] - log.t[0]) / np.median(np.diff(log.t)))) + 1
    t = np.linspace(log.t[0], log.t[-1], n)
    step = t[1] - t[0]
    nearest = log.t[good][np.searchsorted(log.t[good], t, side="left").clip(max=np.count_nonzero(good) - 1)]
    known = np.abs(nearest - t) < 1.5 * step
    if n == log.t.size and good.all():
        return t, x, log.force, known
    return t, np.interp(t, log.t[good], x[good]), np.interp(t, log.t[good], log.force[good]), known


def _moving(v: Array, step: float, settings: InverseSettings) -> Mask:
    """Everything but rests."""
    slow = np.abs(v) < settings.rest_share * np.abs(v).max()
    edges = np.flatnonzero(np.diff(np.concatenate(([0], slow.astype(np.int8), [0]))))
    moving = np.ones(v.size, dtype=np.bool_)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if (stop - start) * step >= settings.rest_s:
            moving[start:stop] = False
    return moving
