"""The paper's open-loop mixture (section 4.1): three models run forward from a detection, the nearest wins.

From the detection on, the nominal, overload and coupling-loss models are propagated without looking at the
data; the overload model starts at its point of contact, x_c = x. The residuals are those of equation 14, in
current, position and speed, their scalar that of equation 19 with a constant diagonal covariance. The result
is an Estimate, so that the decision rule of the bank judges the mixture as well.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import in_python, uncounted
from observer_fi.physics import FAULTS, OPEN_LOOP, Model, Rig, broken, corners, quarters, sensor_std
from observer_fi.physics import equations as a
from observer_fi.physics import simulation as sim
from observer_fi.records import Array, Estimate, Log

_PAST = 80  # samples before a detection, and
_PAST_S = 0.05  # of the samples before a chunk: what the corners of the command need


@dataclass(frozen=True)
class MixtureSettings:
    """The constant standard deviations of equation 19, the same for every model, in those of the sensors'
    noise.

    The paper does not print its values. Of a dozen choices on 120 simulated moves of the paper's spread
    (speeds, pitches and phases of pipelines/compare_mixture.py, other seeds) these gave the mixture its best
    verdicts and its shortest delays: parameters that are slightly off show in the current and hardly in the
    position.
    """

    current: float = 3.0
    position: float = 1.0
    speed: float = 5.0

    def std(self, rig: Rig) -> Array:
        """(3,) of current [A], position [m], speed [rad/s]: the order of equation 14."""
        return np.array([self.current, self.position, self.speed]) * sensor_std(
            rig.noise_std, rig.model.vector
        )


class Mixture:
    """The mixture from one detection on: `advance` takes the samples after it, whole or in chunks."""

    def __init__(
        self, rig: Rig, state: Array, settings: MixtureSettings | None = None, before: Log | None = None
    ) -> None:
        """state: (3,) the latest estimate of w [rad/s], I [rad], x [m], at the first sample of `advance`.

        before: some of the log before that sample, for a commanded ramp that may be under way.
        """
        self.plant = rig.model
        self.std = (settings or MixtureSettings()).std(rig)
        self.start = np.asarray(state, dtype=np.float64)
        self.direction = 0.0
        self.states: Array | None = None  # (3, 8) at the last sample seen
        self.last = np.full(3, 1.0 / 3.0)
        self.past_t = before.t[-_PAST:] if before is not None else np.empty(0)
        self.past_w = np.nan_to_num(before.w_cmd[-_PAST:]) if before is not None else np.empty(0)

    def advance(self, log: Log) -> Estimate:
        """Estimate of the next samples; the same whether they come whole or in chunks.

        nis is the squared residual scalar of equation 19 over the channels that are there; probability that
        of a Gaussian mixture of equal weights, so the smallest residual is the most probable; normalised the
        winner's residuals of speed, current and position over their standard deviations.
        """
        n = log.t.size
        w_cmd = np.nan_to_num(log.w_cmd)
        times, command = np.concatenate((self.past_t, log.t)), np.concatenate((self.past_w, w_cmd))
        first = self.past_t.size if self.states is None else self.past_t.size - 1
        self._find_direction(w_cmd)
        p = self._parameters()
        if self.states is None:
            self.states = np.array([_start(self.start, w_cmd[0], row) for row in p])
        ready = _commands(times, command, p[0])
        fine = np.ones(times.size - first, dtype=np.bool_)
        pitch = np.concatenate((np.full(times.size - first - n, log.pitch[0]), log.pitch))
        out = np.empty((len(OPEN_LOOP), times.size - first, sim.COLUMNS))
        y = np.empty((len(OPEN_LOOP), times.size - first, 3))
        for j in range(len(OPEN_LOOP)):
            sim.run(
                times[first:], ready[0][first:], ready[1][first:], fine, pitch, p[j], self.states[j], out[j]
            )
            sim.readings(times[first:], out[j], p[j], y[j])
        self.states = out[:, -1, : len(sim.STATES)].copy()
        active = under_way(command)[self.past_t.size :]
        keep = times >= times[-1] - _PAST_S
        keep[-4:] = True
        self.past_t, self.past_w = times[keep], command[keep]
        return self._estimate(log, w_cmd, active, out[:, -n:], y[:, -n:], p[0])

    def _find_direction(self, w_cmd: Array) -> None:
        """Which way the mass goes when it meets the stop: as it moves, or as it is first told to."""
        if self.direction == 0.0:
            turning = w_cmd[w_cmd != 0.0]
            self.direction = float(np.sign(turning[0])) if turning.size else 0.0
            if self.direction == 0.0 and abs(self.start[0]) > 1.0:
                self.direction = float(np.sign(self.start[0]))

    def _parameters(self) -> tuple[Array, ...]:
        return tuple(model.vector for model in models(self.plant, float(self.start[2]), self.direction))

    def _estimate(
        self, log: Log, w_cmd: Array, active: NDArray[np.bool_], out: Array, y: Array, p: Array
    ) -> Estimate:
        n, m = log.t.size, len(OPEN_LOOP)
        scaled, nis, mu = np.empty((n, m, 3)), np.empty((n, m)), np.empty((n, m))
        _judge(log.z, out, y, p, self.std, self.last, scaled, nis, mu)
        best = mu.argmax(axis=1)
        k = np.arange(n)
        winner = out[best, k]
        states = np.column_stack((winner[:, sim.W], winner[:, sim.I], winner[:, sim.X], w_cmd))
        normalised = -scaled[k, best][:, [2, 0, 1]]
        predicted = np.ascontiguousarray(np.swapaxes(y, 0, 1))
        strain = np.zeros((n, m))  # the models have no constants to stretch
        return Estimate(log.t, OPEN_LOOP, mu, nis, predicted, normalised, states, active, -0.5 * nis, strain)


def models(plant: Model, x: float, direction: float) -> tuple[Model, ...]:
    """The models of `OPEN_LOOP` after a detection at x [m] in a move of this direction: a stop is there."""
    kinds = [next(iter(FAULTS[label].made_by)) for label in OPEN_LOOP]
    return tuple(broken(plant, kind, x, direction >= 0.0) for kind in kinds)


def open_loop(
    log: Log,
    first: int,
    state: Array,
    rig: Rig,
    settings: MixtureSettings | None = None,
    last: int | None = None,
) -> Estimate:
    """Estimate of samples first:last of a log, for a detection at `first` where the state is (w, I, x)."""
    before = cut(log, max(first - _PAST, 0), first) if first else None
    return Mixture(rig, state, settings, before).advance(cut(log, first, last))


def cut(log: Log, first: int, last: int | None = None) -> Log:
    """Samples first:last of a log."""
    return replace(log.part(slice(first, last)), first_row=log.first_row + first)


def under_way(w_cmd: Array) -> NDArray[np.bool_]:
    """(n,) whether the motor is commanded to turn and is not being stopped."""
    before = np.abs(np.concatenate((w_cmd[:1], w_cmd[:-1])))
    return (w_cmd != 0.0) & (np.abs(w_cmd) >= before * (1.0 - 1e-9))


def _start(state: Array, w_cmd: float, p: Array) -> Array:
    """(8,) states of `simulate.py` from w, I, x: an unloaded spindle, a cold winding."""
    start = np.zeros(len(sim.STATES))
    start[sim.W], start[sim.I], start[sim.X] = state
    start[sim.MASS] = state[2]
    start[sim.PHI] = state[2] / p[a.D]
    commanded = in_python(a.command_current)(state[0], state[1], w_cmd, p)
    start[sim.LAGGED] = in_python(a.passed_current)(commanded, p)
    return start


def _commands(t: Array, w_cmd: Array, p: Array) -> tuple[Array, Array]:
    """Command, and command as the proportional path sees it, at quarters of the intervals, (n, 4) each."""
    knots, values = corners(t, w_cmd, float(p[a.ACCEL_CMD]))
    delay, late = float(p[a.INPUT_DELAY] + p[a.TICK_PHASE]), float(p[a.SERVO_DELAY])
    slew = float(p[a.ACCEL_LIMIT]), float(p[a.ACCEL_AHEAD])
    now = quarters(t, knots, values, delay, *slew)
    return now, (quarters(t, knots, values, delay + late, *slew) if late else now)


@uncounted
def _judge(
    z: Array, out: Array, y: Array, p: Array, std: Array, last: Array, scaled: Array, nis: Array, mu: Array
) -> None:
    """Residuals of equation 14 over std (n, m, 3), squared scalars of equation 19, probabilities, (n, m).

    z (n, 3) measured; out (m, n, 9) states and y (m, n, 3) readings of the models; last (m,) the
    probabilities before the first sample, overwritten by those of the last: they hold where nothing was
    measured.
    """
    n, m = nis.shape
    for k in range(n):
        least = np.inf
        w_measured = a.measured_speed(z[k, 0], z[k, 1], p)
        for j in range(m):
            scaled[k, j, 0] = (y[j, k, 1] - z[k, 1]) / std[0]
            scaled[k, j, 1] = (y[j, k, 2] - z[k, 2]) / std[1]
            scaled[k, j, 2] = (out[j, k, 0] - w_measured) / std[2]
            total, count = 0.0, 0
            for c in range(3):
                e = scaled[k, j, c]
                if e == e:
                    total += e * e
                    count += 1
            nis[k, j] = total if count else np.nan
            if count and total < least:
                least = total
        if least < np.inf:
            weight = 0.0
            for j in range(m):
                last[j] = np.exp(-0.5 * (nis[k, j] - least))
                weight += last[j]
            for j in range(m):
                last[j] /= weight
        for j in range(m):
            mu[k, j] = last[j]
