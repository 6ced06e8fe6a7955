"""Doubt in the speed after a reversal: friction may hold the mass there for a moment that nobody can foresee.

When the speed passes zero under a torque that friction could not hold for long, a real mass, a servo between two
ticks, and every simulation of them stand still for up to some microseconds. What follows is the loop's free
response to a small step in speed, of unknown size. It is known in shape, so it is projected out (damped by a prior)
instead of leaving out the stop:

    cov of the normalised readings of a move = 1 + sum over reversals b b',   r -> (1 + B B')^-1/2 r
"""

from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used: `fft` takes a while
from numpy.typing import NDArray
from scipy.linalg import expm

from observer_fi.physics import Model, speed
from observer_fi.records import Array

# s: 1-sigma. Field logs show 0 to 39 us at each reversal, the period of a servo of 25.6 kHz; slower servos exist.
HELD_S = 1e-4
CAUGHT_A = (
    2e-3  # 1-sigma of the current in the rest after a stop: it depends on the instant when friction catches
)
_LEAST = 2000.0  # rad/s^2: slower reversals make steps of the speed below the noise
# Samples on either side of a reversal that tell its slope, ten times the slope's noise at `_LEAST`; of a slow log as many as
# lie so near, where the slope is still that of the reversal [s].
_ROWS, _NEAR_S = 3, 2e-3
_APART_S = 5e-3
_FULL = 0.98  # of the highest voltage seen: the supply is at its limit
_NEGLIGIBLE = 0.01  # standard deviations of the noise, less than which is not left open
_STILL = 3.0  # rad/s: five times the noise of the measured speed


class Waves(NamedTuple):
    """Cosines over the readings of one channel of a move (a DCT): its rows (k,), and the share taken of each cosine (k,)."""

    channel: int
    rows: NDArray[np.int64]
    share: Array

    def subtract(self, r: Array) -> None:
        """Takes them from normalised residuals (n, 3) of the move in place, or (k, n, 3) of them."""
        of = r[..., self.rows, self.channel]
        left = scipy.fft.dct(of, norm="ortho") * (1.0 - self.share)
        r[..., self.rows, self.channel] = scipy.fft.idct(left, norm="ortho")


class Doubt(NamedTuple):
    """Directions of one move's stop: first row within the move, orthonormal (K, 3 n), and the share taken of each.

    kicks: row within the move and standard deviation of the step in speed [rad/s] at every reversal; still: the row from
    which friction holds the mass, and the current is open by `CAUGHT_A`. waves: taken before the directions.
    """

    first: int
    directions: Array
    share: Array
    kicks: tuple[tuple[int, float], ...] = ()
    still: int = 0
    waves: Waves | None = None


def doubt_of(t: Array, z: Array, weight: Array, brake: int, model: Model) -> Doubt:
    """Doubt in the readings z (n, 3), without gaps, of one move at t (n,); from the row `brake` on the command falls."""
    w = speed(z, model.vector)
    rows = int(np.clip(round(_NEAR_S / float(np.median(np.diff(t)))), 1, _ROWS))
    fast = np.flatnonzero(np.abs(_smooth(w, rows)) > _STILL)
    kicks = _reversals(t, w, brake, rows)
    if not kicks or not fast.size:
        return no_doubt(t.size)
    still = t[fast[-1]]
    steps = tuple((int(np.searchsorted(t, at)), HELD_S * abs(slope)) for at, slope in kicks)
    source = np.abs(z[:, 0] + model["Rs"] * z[:, 1])
    full = source > _FULL * max(float(source.max()), model["Vmax"])
    first = int(np.searchsorted(t, kicks[0][0]))
    t, weight, full = t[first:], weight[first:], full[first:]
    caught = np.where(t > still, CAUGHT_A, 0.0)[:, None] * np.array([model["Rm"], 1.0, 0.0])
    speeds = [HELD_S * slope * _response(t - at, still - at, full, model) for at, slope in kicks]
    B = np.array([*speeds, caught]) * weight
    return doubt_along(B)._replace(first=first, kicks=steps, still=int(fast[-1]) + 1)


def doubt_along(B: Array, waves: Waves | None = None) -> Doubt:
    """Doubt in a whole move along normalised readings (K, n, 3), each as large as its standard deviation, and in waves."""
    if waves is not None:
        waves.subtract(B)
    rows = B.reshape(len(B), 3 * B.shape[1])
    if not np.isfinite(rows).all():  # a model that runs away tells nothing of its doubt
        rows = rows[:0]
    _, size, v = np.linalg.svd(rows, full_matrices=False)
    open_ = size > _NEGLIGIBLE
    directions = v[open_] * rows.any(axis=0)
    return Doubt(0, directions, 1.0 - 1.0 / np.sqrt(1.0 + size[open_] ** 2), (), B.shape[1], waves)


def no_doubt(rows: int) -> Doubt:
    """Nothing left open in a move of so many rows."""
    return Doubt(rows, np.empty((0, 0)), np.empty(0), (), rows)


def subtract_doubt(r: Array, doubt: Doubt) -> None:
    """Whitens normalised residuals or columns (n, 3) of one move in place, or (k, n, 3) of them."""
    if doubt.waves is not None:
        doubt.waves.subtract(r)
    if not len(doubt.directions):
        return
    part = r[..., doubt.first :, :]
    along = part.reshape(-1, doubt.directions.shape[1]) @ doubt.directions.T
    part -= ((doubt.share * along) @ doubt.directions).reshape(part.shape)


def _smooth(w: Array, rows: int) -> Array:
    return np.convolve(w, np.ones(rows) / rows, mode="same")


def _reversals(t: Array, w: Array, brake: int, rows: int) -> list[tuple[float, float]]:
    """Time and acceleration [rad/s^2] of every reversal from the row `brake` on, of so many rows on either side."""
    found: list[tuple[float, float]] = []
    sign = np.signbit(_smooth(w, rows))
    for k in np.flatnonzero(sign[1:] != sign[:-1]):
        near = slice(k - rows + 1, k + rows + 1)
        if k < brake + rows or k + rows >= t.size or (found and t[k] - found[-1][0] < _APART_S):
            continue
        slope, level = np.polyfit(t[near] - t[k], w[near], 1)
        at = float(t[k] - level / slope) if abs(slope) > _LEAST else np.inf
        if at < t[-1]:  # of noise alone a line may pass zero anywhere
            found.append((at, float(slope)))
    return found


def _response(since: Array, still: float, full: NDArray[np.bool_], model: Model) -> Array:
    """(n, 3) V, i, x after a step of 1 rad/s in the speed at `since` = 0, zero before.

    J dw' = Km di, dI' = -dw, dx' = D dw; di = Ki dI - Kp dw, and -Km dw/R where the supply is at its limit (full).
    still: when friction holds the mass for good [s].
    """
    Rm, Km, D, Kp, Ki, J = (model[name] for name in ("Rm", "Km", "D", "Kp", "Ki", "J"))
    current = (np.array([-Kp, Ki, 0.0]), np.array([-Km / (Rm + model["Rs"]), 0.0, 0.0]))
    rates = [np.array([Km / J * di, [-1.0, 0.0, 0.0], [D, 0.0, 0.0]]) for di in current]
    steps = [expm(A * float(np.median(np.diff(since)))) for A in rates]
    first = int(np.searchsorted(since, 0.0))
    y = np.zeros((since.size, 3))
    state = expm(rates[int(full[first])] * since[first])[:, 0].copy()
    for k in range(first, since.size):
        if since[k] > still:
            state[0] = 0.0
        di = current[int(full[k])] @ state
        y[k] = Rm * di + Km * state[0], di, state[2]
        state = state if since[k] > still else steps[int(full[k])] @ state
    return y
