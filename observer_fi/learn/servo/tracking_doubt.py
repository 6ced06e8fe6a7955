"""What a loop that follows the measured position leaves open in the readings of a move (`tracking_loop.py`).

The noise of the position moves the simulation through the loop, that of the current by itself, and both make the voltage wander
as slowly as the loop is, with a spectrum that is known: it is whitened in cosines over a move. Where the current bends between
two readings, the speed that it makes is off by a step, and friction may hold a motor back where it turns round. Those are known
in shape and in size, and projected out as `reversal_doubt.py` does.

An error e = phi - phi_simulated obeys e'' = a - L e, where L = (sqrt(2) ring d/dt + ring^2) times the low-pass of what the loop
follows, which looks as far ahead as back: so does e. a: an acceleration that nobody knows [rad/s^2].
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used: `fft` takes a while
from numpy.typing import NDArray

from observer_fi.learn.reversal_doubt import HELD_S, Doubt, Waves, doubt_along
from observer_fi.physics import Model
from observer_fi.records import Array

DAMPING = math.sqrt(2.0)  # twice that of the settled filter
SMOOTH = 2.0  # times the ring of the loop: faster, the measured motion is the simulation's own
_NYQUIST = 0.9  # of half the sampling rate, beyond which no low-pass goes

_LEAST = 0.3  # standard deviations: a smaller step is none beside the noise
_MOST_STEPS = 20  # of one move
# Parts of the loop's ring in which a spectrum is asked for, and at least and at most of the spacing of two cosines.
_FINE, _FINEST = 4, 64
_IN_A_SAMPLE = 1.0 / math.sqrt(12.0)  # of a sample: when in it a servo jumped
_MOST_ROWS = 1 << 19  # on either side of it
_SETTLED = 40.0  # radians of the ring on either side, after which a step has no more effect


class Loop(NamedTuple):
    """A loop that rings at `ring` [rad/s] around a model."""

    ring: float
    model: Model

    @classmethod
    def of(cls, model: Model) -> "Loop":
        """That of the gains of a model."""
        return cls(math.sqrt(model["Ki"] * model["Km"] / model["J"]), model)

    def back(self, at: Array) -> NDArray[np.complex128]:
        """(k,) L at angular frequencies [rad/s], 1/s^2."""
        low_pass = 1.0 / (1.0 + (at / (SMOOTH * self.ring)) ** 4)
        return np.asarray((DAMPING * self.ring * 1j * at + self.ring**2) * low_pass, dtype=np.complex128)

    def low_pass(self, dt: float) -> Array:
        """(1, 6) second-order sections of what the loop follows of a measured motion, in steps of dt [s]; forth and back."""
        return _sections(min(SMOOTH * self.ring * dt / math.pi, _NYQUIST))

    def voltage(self, at: Array) -> Array:
        """(k,) V s/rad: what an error of the speed makes of the voltage, with the current that follows it."""
        m = self.model
        return m["Km"] * np.hypot(1.0, at * m["J"] * m["Rm"] / m["Km"] ** 2)


@lru_cache(maxsize=64)
def _sections(corner: float) -> Array:
    """Second-order sections of a Butterworth low-pass of order two. corner: of half the sampling rate."""
    return np.asarray(scipy.signal.butter(2, corner, output="sos"))


def tracking_doubt(
    t: Array, i: Array, w: Array, weight: Array, noise: Array, every: Array, loop: Loop
) -> Doubt:
    """Doubt in the readings of one move at t (n,), driven by a current i (n,), of speed w (n,), with weights (n, 3).

    noise: (3,) of a reading each. every: (3,) rows from one reading of a channel to the next; a line goes between them.
    """
    steps = _steps(t, i, w, noise, every, loop)
    B = np.array(steps).reshape(len(steps), t.size, 3) * weight
    return doubt_along(B, _waves(t, weight[:, 0], noise * np.sqrt(every), loop))


def _waves(t: Array, weight: Array, noise: Array, loop: Loop) -> Waves | None:
    """Cosines over the voltages of a move, of weights (n,), as high as they wander; none where no voltage is logged.

    noise: (3,) at every row, that makes as much of what is slow as that of the readings.
    """
    rows = np.flatnonzero(weight)
    if rows.size < 2:
        return None
    spacing = math.pi * (rows.size - 1) / (rows.size * float(t[rows[-1]] - t[rows[0]]))
    fine = min(max(math.ceil(_FINE * spacing / loop.ring), _FINE), _FINEST)
    at = np.asarray(spacing / fine * np.arange(rows.size * fine), dtype=np.float64)
    high = _within_a_move(_wander(at, noise, loop), fine) * rows.size / t.size
    return Waves(0, rows, 1.0 - 1.0 / np.sqrt(1.0 + high * np.mean(weight[rows]) ** 2))


def _within_a_move(spectrum: Array, fine: int) -> Array:
    """(n,) variances of the cosines over a move, from a spectrum (n fine,) at so many parts of their spacing.

    A move is short beside what is slow: a cosine k takes of a frequency x, both in spacings, a share of
    8/pi^2 x^2 sin^2(pi/2 (x - k)) / (x^2 - k^2)^2, half of that where k = 0. That is the sum of 1/d^2 and 1/(k d), d = x - k,
    over the frequencies of either sign.
    """
    both = np.concatenate([spectrum[:0:-1], spectrum])
    d = np.arange(1 - spectrum.size, spectrum.size) / fine
    near, odd = 0.5 * np.sinc(0.5 * d) ** 2, -0.5 * d * np.sinc(0.5 * d) ** 2
    mean, slope = (
        scipy.signal.fftconvolve(both, kernel, "same")[spectrum.size - 1 :: fine] for kernel in (near, odd)
    )
    return np.asarray(
        np.maximum(mean + slope / np.maximum(np.arange(mean.size), 1), 0.0) / fine, dtype=np.float64
    )


def _wander(at: Array, noise: Array, loop: Loop) -> Array:
    """(k,) variance of a cosine of the voltage over samples [V^2], but for what the current's noise makes of it at once."""
    L = loop.back(at)
    by_position, by_current = (
        loop.voltage(at) * at * np.abs(shaken / (L - at**2))
        for shaken in (L * noise[2] / loop.model["D"], _push(loop.model) * noise[1])
    )
    at_once = loop.model["Rm"] * noise[1]
    return np.asarray(by_position**2 + np.maximum(by_current**2 - at_once**2, 0.0), dtype=np.float64)


def _push(model: Model) -> float:
    """Acceleration by a current [rad/(s^2 A)]."""
    return model["Km"] / model["J"]


def _steps(t: Array, i: Array, w: Array, noise: Array, every: Array, loop: Loop) -> list[Array]:
    """(n, 3) each: what goes with steps of the speed where the current bends the most, and where the motor turns round.

    A jump between two readings is a slope of the line between them, less steep and longer the farther they are apart.
    """
    dt = np.gradient(t)
    turns = np.flatnonzero((w[1:] * w[:-1] <= 0.0) & (w[1:] != w[:-1]))
    step = _push(loop.model) * _IN_A_SAMPLE * np.abs(np.diff(i, 2, append=[i[-1]] * 2)) * dt * every[1] ** 2
    held = np.abs(np.diff(w))[turns] * np.maximum(HELD_S / dt[turns], _IN_A_SAMPLE)
    step[turns] = np.hypot(step[turns], held)
    D, Km = loop.model["D"], loop.model["Km"]
    seen = np.maximum(Km * step / noise[0], D * step / loop.ring / noise[2])
    rows = [row for row in np.argsort(-seen)[:_MOST_STEPS].tolist() if seen[row] > _LEAST]
    if not rows:
        return []
    since, shown = _around_a_step(float(np.median(dt)), loop)
    return [
        step[row] * np.column_stack([np.interp(t - t[row], since, c, 0.0, 0.0) for c in shown.T])
        for row in rows
    ]


def _around_a_step(dt: float, loop: Loop) -> tuple[Array, Array]:
    """Times (K,) [s] around a step of 1 rad/s in the speed, and what V, i, x are off there (K, 3)."""
    size = scipy.fft.next_fast_len(2 * min(math.ceil(_SETTLED / (loop.ring * dt)), _MOST_ROWS))
    at = np.asarray(2.0 * math.pi * np.fft.rfftfreq(size, dt), dtype=np.float64)
    L = loop.back(at)
    phi, pulled = (np.fft.fftshift(np.fft.irfft(E, size)) / dt for E in (1.0 / (L - at**2), L / (L - at**2)))
    since = np.asarray(dt * (np.arange(size) - size // 2), dtype=np.float64)
    w = (since >= 0.0) - dt * np.cumsum(pulled)
    i = -pulled / _push(loop.model)
    m = loop.model
    return since, np.column_stack([m["Rm"] * i + m["Km"] * w, np.zeros(size), m["D"] * phi])
