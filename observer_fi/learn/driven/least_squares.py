"""Least squares over windows of readings, of integrals of equation 1 from the beginning of each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used

from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.learn.driven.windows import Window
from observer_fi.numerics import correlation_time
from observer_fi.physics import Rig
from observer_fi.records import Array

MAKER = {
    "Km": 2e-3,
    "D": 1e-3,
}  # relative 1-sigma of what the maker states, where the rig file gives no spread
SKEW = 0.5  # of a sample, by which the channels of a converter that reads them in turn are off, one standard deviation
LONGEST = 2000  # samples over which residuals may be correlated
FEWEST_SMOOTH = 4  # samples of a curve
_MANY = 4  # windows per unknown from which on their scatter is a standard error


class Solution(NamedTuple):
    """Least squares: coefficients and covariance, residual's standard deviation, number of samples."""

    x: Array
    covariance: Array
    sigma: float
    n: int

    def knowing(self, k: int, value: float, std: float) -> "Solution":
        """The same, of which the coefficient k is known from elsewhere."""
        return self.knowing_all([k], np.array([value]), np.array([[std**2]]))

    def knowing_all(self, k: Sequence[int], values: Array, covariance: Array) -> "Solution":
        """The same, of which the coefficients k (m,) are known from elsewhere, with their covariance (m, m)."""
        own = self.covariance[k]
        gain = np.linalg.solve(own[:, k] + covariance, own).T
        return self._replace(x=self.x + gain @ (values - self.x[k]), covariance=self.covariance - gain @ own)

    def beside(self, value: float, std: float) -> "Solution":
        """The same with one coefficient more, of which nothing else is known."""
        covariance = np.zeros((self.x.size + 1, self.x.size + 1))
        covariance[:-1, :-1], covariance[-1, -1] = self.covariance, std**2
        return self._replace(x=np.append(self.x, value), covariance=covariance)

    def of(self, k: int) -> tuple[float, float]:
        """A coefficient and its standard error."""
        return float(self.x[k]), float(np.sqrt(max(self.covariance[k, k], 0.0)))


def solve(
    G: Sequence[Array], y: Sequence[Array], constants: int, instruments: Sequence[Array] | None = None
) -> Solution:
    """Least squares over windows. G: (n, k) each, constants already out; constants: how many there were.

    instruments: (n, k) each, which have the signal of G and other noise than it: residuals are at right angles to them, in
    place of G, whose own noise makes a coefficient too small. Standard errors from the scatter between windows, since
    integrated noise is alike within one; from the residual's autocorrelation where windows are too few for that.
    """
    Z = G if instruments is None else instruments
    stacked, target, at_right = np.concatenate(G), np.concatenate(y), np.concatenate(Z)
    scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    inverse = np.linalg.pinv((at_right / scale).T @ (stacked / scale), rcond=1e-12)
    x = inverse @ ((at_right / scale).T @ target)
    r = target - stacked / scale @ x
    variance = float(r @ r) / max(target.size - x.size - constants, 1)
    spread = inverse @ ((at_right / scale).T @ (at_right / scale)) @ inverse.T
    covariance = spread * variance * correlation_time(r, min(LONGEST, r.size // 4))
    if len(G) >= _MANY * x.size:
        windows = zip(G, Z, y, strict=True)
        pulls = np.array([(h / scale).T @ (t - g / scale @ x) for g, h, t in windows])
        between = inverse @ (pulls.T @ pulls) @ inverse.T * len(G) / (len(G) - x.size)
        wider = np.sqrt(np.maximum(np.diag(between) / np.maximum(np.diag(covariance), 1e-300), 1.0))
        covariance = covariance * np.outer(wider, wider)
    return Solution(x / scale, covariance / np.outer(scale, scale), float(np.sqrt(variance)), target.size)


def integral(t: Array, y: Array) -> Array:
    """(n,) integral of y (n,) from the first sample on, through a smooth curve: a line between the samples of a slow log loses
    percents of what a current rings.
    """
    if t.size < FEWEST_SMOOTH:
        return motor_angle(t, y)
    return np.asarray(scipy.interpolate.Akima1DInterpolator(t, y, method="makima").antiderivative()(t))


def load_integrals(w: Window, names: Sequence[str]) -> list[Array]:
    """Integrals of what the loads multiply, with their sign in equation 1."""
    columns = {
        "A": -w.sign * w.t,
        "B": -integral(w.t, w.pitch),
        "viscous_positive": -integral(w.t, w.w),
        "torque_offset": -w.t,
    }
    return [columns[n] for n in names]


def without(G: Array, free: Array) -> Array:
    """Columns with the free constants of their window projected out."""
    q, _ = np.linalg.qr(free)
    return G - q @ (q.T @ G)


def neighbours(y: Array) -> Array:
    """(n,) mean of the readings before and after each: what they have in common with it is signal, and no noise."""
    padded = np.concatenate((y[1:2], y, y[-2:-1]))
    return np.asarray(0.5 * (padded[:-2] + padded[2:]))


def of_maker(rig: Rig, name: str) -> float:
    """Relative standard deviation of a value of the maker's."""
    return rig.spread(name) or MAKER[name]
