"""What an inverse-dynamics model is worth forward: one step ahead in an observer, and in simulation of the closed loop.

Judged by the position: an observer of three states (position, speed, slow force) predicts the next sample, and a
simulation runs plant and controller from the reference alone. Open loop is not used: a position integrates what friction
gets wrong and ranks models the wrong way.

F force [N], x position [m], v speed [m/s], s sign of motion in [-1, 1], late: time from the command to the motion [s].
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer_fi.learn.inverse_columns import TIMING, Sharing
from observer_fi.learn.inverse_dynamics import Solution, weight
from observer_fi.numerics import compiled
from observer_fi.physics import NAMES, D, J, Rig, plant
from observer_fi.records import Array, Log


class Tuning(NamedTuple):
    """Of the observer: intensity of the speed's process noise [m^2/s^3], of the slow force's [N^2/s], variance [m^2]."""

    speed: float
    force: float
    position: float


class PositionServo(NamedTuple):
    """Controller kv (kp (reference - x) - dx/dt), dx/dt over two samples, clipped; gain N/V, limit V, resolution m."""

    kp: float
    kv: float
    gain: float
    limit: float
    resolution: float


@dataclass(frozen=True)
class Prediction:
    """Of an observer: innovations (n,) m, their variance (n,), errors some samples ahead (n,) m (NaN where not made)."""

    innovation: Array
    variance: Array
    ahead: Array

    def nll(self, start: int) -> float:
        """Gaussian negative log-likelihood a sample [nats] from a sample on."""
        e, S = self.innovation[start:-5], self.variance[start:-5]
        return 0.5 * float(np.mean(np.log(2.0 * math.pi * S) + e * e / S))

    def rms(self, start: int) -> float:
        """Root mean square of the innovations from a sample on [m]."""
        return float(np.sqrt(np.mean(self.innovation[start:-5] ** 2)))

    def rms_ahead(self, start: int) -> float:
        """Root mean square of the errors ahead from a sample on [m]."""
        return float(np.sqrt(np.nanmean(self.ahead[start:-5] ** 2)))


def fitted_plant(rig: Rig, solution: Solution, log: str) -> tuple[Array, float]:
    """Parameter vector of the fitted plant for a log, and how late its force acts beyond the hold of a sample [s]."""
    values = dict(zip(NAMES, rig.model.values, strict=True))
    moved = {name for c in solution.coefficients for name, _ in c.term.moves}
    values |= dict.fromkeys(moved, 0.0)
    for c, theta in zip(solution.coefficients, solution.theta, strict=True):
        share = weight(c, log, solution.logs[0]) if c.term.sharing is not Sharing.COMMON else 1.0
        for name, part in c.term.moves:
            values[name] += share * part * float(theta)
    shapes = solution.structure.shapes
    values |= {name: value for name, value in shapes.items() if name not in TIMING}
    p = np.array([*(values[name] for name in NAMES), 1.0])
    return p, sum(shapes.get(name, 0.0) for name in TIMING)


@compiled
def advance(
    p: Array,
    x: float,
    v: float,
    s: float,
    old: float,
    new: float,
    theta: float,
    late: float,
    step: float,
    substeps: int,
) -> tuple[float, float, float]:
    """One sample of the plant; `new` acts after `late` [s]."""
    h = step / substeps
    m = plant.Motion(v / p[D], 0.0, x, 0.0, plant.inner_at(x / p[D], 0.0))
    for k in range(substeps):
        s, m = plant.sampled_force(s, m, new if (k + 0.5) * h > late else old, h, theta, p)
    return m.x, m.w * p[D], s


@compiled
def observe(
    p: Array,
    measured: Array,
    force: Array,
    theta: Array,
    step: float,
    late: float,
    speed: float,
    slow: float,
    variance: float,
    ahead: int,
) -> tuple[Array, Array, Array]:
    """Innovations, their variances, and errors `ahead` samples on, of a Kalman filter around the plant; (n,) each."""
    n = measured.size
    M = p[J] / (p[D] * p[D])
    innovation, S, error = np.zeros(n), np.ones(n), np.full(n, np.nan)
    x, v, f, s = measured[0], (measured[3] - measured[0]) / (3.0 * step), 0.0, 1.0
    P = np.diag(np.array([1e-14, 1e-6, 1e1]))
    A = np.array([[1.0, step, -step * step / 2.0 / M], [0.0, 1.0, -step / M], [0.0, 0.0, 1.0]])
    Q = np.array(
        [
            [speed * step**3 / 3.0, speed * step**2 / 2.0, 0.0],
            [speed * step**2 / 2.0, speed * step, 0.0],
            [0.0, 0.0, slow * step],
        ]
    )
    for k in range(n - 1):
        innovation[k], S[k] = measured[k] - x, P[0, 0] + variance
        K = P[:, 0].copy() / S[k]
        x, v, f = x + K[0] * innovation[k], v + K[1] * innovation[k], f + K[2] * innovation[k]
        P = P - np.outer(K, P[0, :].copy())
        old = force[max(k - 1, 0)]
        if ahead > 1 and k > 200 and k % 5 == 0 and k + ahead < n:
            xx, vv, ss, before = x, v, s, old
            for j in range(ahead):
                xx, vv, ss = advance(p, xx, vv, ss, before - f, force[k + j] - f, theta[k + j], late, step, 4)
                before = force[k + j]
            error[k] = measured[k + ahead] - xx
        x, v, s = advance(p, x, v, s, old - f, force[k] - f, theta[k], late, step, 10)
        P = A @ P @ A.T + Q
    return innovation, S, error


@compiled
def run_closed_loop(
    p: Array,
    reference: Array,
    pulse: Array,
    kp: float,
    kv: float,
    gain: float,
    limit: float,
    resolution: float,
    x: float,
    v: float,
    step: float,
    late: float,
) -> tuple[Array, Array]:
    """Positions (n,) m and commands (n,) V of plant and controller."""
    n = reference.size
    positions, commands = np.empty(n), np.empty(n)
    s, old = 1.0, 0.0
    one, two = x - v * step, x - 2.0 * v * step
    for k in range(n):
        positions[k] = x
        seen = np.round(x / resolution) * resolution
        u = kv * (kp * (reference[k] - seen) - (seen - two) / (2.0 * step)) + pulse[k]
        u = min(limit, max(-limit, u))
        commands[k] = u
        two, one = one, seen
        x, v, s = advance(p, x, v, s, gain * old, gain * u, 0.0, late, step, 20)
        old = u
    return positions, commands


def closed_loop(
    rig: Rig, solution: Solution, log: Log, reference: Array, pulse: Array, servo: PositionServo
) -> tuple[Array, Array]:
    """Simulated positions (n,) m and commands (n,) V, from the reference (n,) m and added pulses (n,) V alone."""
    p, late = fitted_plant(rig, solution, log.path)
    step, x = _step(log), log.z[:, 2]
    v = (x[3] - x[0]) / (3.0 * step)
    return run_closed_loop(p, reference, pulse, *servo, x[0], v, step, _beyond_hold(late, step))


def predict(rig: Rig, solution: Solution, log: Log, tuning: Tuning, ahead: int = 1) -> Prediction:
    """The observer on a log."""
    p, late = fitted_plant(rig, solution, log.path)
    step = _step(log)
    force = np.asarray(log.force)
    found = observe(p, log.z[:, 2], force, log.pitch, step, _beyond_hold(late, step), *tuning, ahead)
    return Prediction(*found)


def tune(rig: Rig, solution: Solution, log: Log, start: Tuning | None = None, rounds: int = 3) -> Tuning:
    """Noise of the observer by likelihood on a log: coordinate search on a logarithmic grid that gets finer."""
    best = np.log(np.array(start or Tuning(3e-7, 15.0, rig.noise["position"] ** 2)))
    least = predict(rig, solution, log, Tuning(*np.exp(best))).nll(300)
    for width in (2.0, 0.7, 0.25)[:rounds]:
        improved = True
        while improved:
            improved = False
            for k in range(3):
                for sign in (1.0, -1.0):
                    trial = best.copy()
                    trial[k] += sign * width
                    value = predict(rig, solution, log, Tuning(*np.exp(trial))).nll(300)
                    if value < least - 1e-4:
                        best, least, improved = trial, value, True
    return Tuning(*(float(y) for y in np.exp(best)))


def _step(log: Log) -> float:
    return float(log.t[-1] - log.t[0]) / (log.t.size - 1)


def _beyond_hold(late: float, step: float) -> float:
    """Half a sample of a delay is the hold, which the simulation has of its own; more than a sample it cannot do."""
    return min(max(late - 0.5 * step, 0.0), step)
