"""The readings of a model as they come through a low-pass filter: order one, or Butterworth's two, of an amplifier or a clamp.

A fit compares them with the readings as they were logged. Noise that comes after a filter stays what it is, which no filter
that is taken out of the readings can say.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second
from numpy.typing import NDArray

from observer_fi.learn.gauss_newton import Free
from observer_fi.logs import LowPass, LowPasses
from observer_fi.records import Array

TIME, LATE = "low_pass_s", "low_pass_late_s"
NAMES = (TIME, LATE)
DRIVE = (0, 1)  # voltage and current
_FINE = 0.02  # share of the rows that stand nearer than those of a filter's grid: transients have more than there are samples
_POLES = {1: (1.0,), 2: (0.75, -0.75)}  # by order: angles of Butterworth's poles, in half turns


class Through(NamedTuple):
    """The same filter before some channels (0 voltage, 1 current, 2 position); order: one, two, or none, which only delays."""

    channels: tuple[int, ...]
    order: int

    def taken(self, t: Array, y: Array, values: Mapping[str, float]) -> Array:
        """Readings (n, 3) of one move at times (n,) [s], from a rest on, with the filter's channels behind it."""
        step = float(np.quantile(np.diff(t), _FINE)) if t.size > 1 else 1.0
        grid = np.arange(t[0], t[-1] + step, step)
        out = y.copy()
        for c in self.channels:
            rest = y[0, c]
            even = np.interp(grid, t, y[:, c]) - rest
            filtered = self._filtered(even, step, values[TIME]) if self.order else even
            out[:, c] = rest + np.interp(t - values.get(LATE, 0.0), grid, filtered)
        return out

    def _filtered(self, even: Array, step: float, time: float) -> Array:
        return np.asarray(scipy.signal.lfilter(*_sampled(self.order, step, time), even))

    def free(self, interval: float) -> list[Free]:
        """Time constant and delay as parameters of a fit. interval: of samples [s], which a delay is about, or less.

        Voltage and current that are late together are those of a servo that is late.
        """
        if not self.order:
            return [Free(LATE, 0.02 * interval, 0.0, 32.0 * interval)]
        time = Free(TIME, 0.01 * interval, 0.1 * interval, 100.0 * interval)
        if self.channels == DRIVE:
            return [time]
        late = Free(LATE, 0.02 * interval, -4.0 * interval, 4.0 * interval, 0.0, interval)
        return [time, late]

    def told(self, values: Mapping[str, float], interval: float) -> LowPasses:
        """The filters and delays that these values are, of samples with an interval [s]."""
        own = LowPass(1.0 / (2.0 * math.pi * values[TIME]), self.order) if self.order else LowPass()
        late = own.left(interval) + values.get(LATE, 0.0) / interval
        return LowPasses().of(self.channels, own._replace(late=late))


@lru_cache(maxsize=256)  # a fit asks for one filter at every other constant that it tries
def _sampled(order: int, step: float, time: float) -> tuple[Array, Array]:
    """Numerator and denominator of a filter for samples `step` [s] apart, between which readings are straight lines.

    Its answer to a ramp is t + sum R (exp(p t) - 1) over its poles p; samples of it are divided by those of the ramp.
    scipy's cont2discrete (method foh) gives the same in ten times the time.
    """
    poles = np.exp(1j * math.pi * np.array(_POLES[order])) / time
    each = [np.delete(poles, k) for k in range(order)]
    R = [np.prod(-poles) / (p * p * np.prod(p - others)) for p, others in zip(poles, each, strict=True)]
    a = np.poly(np.exp(poles * step))
    b: NDArray[np.complex128] = np.append(0.0, a) - sum(R) / step * np.convolve([1.0, -1.0], a)
    for residue, others in zip(R, each, strict=True):
        b += residue / step * np.convolve([1.0, -2.0, 1.0], np.poly(np.exp(others * step)))
    return np.real(b[1:]).astype(np.float64), np.real(a).astype(np.float64)
