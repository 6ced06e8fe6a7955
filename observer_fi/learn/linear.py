"""Small disturbances of each equation along a simulated motion: how time carries them, and what the sensors show of them.

Deviations of (w, I, x) from the simulated motion are linear in the disturbances, with the slopes that the bank uses
(`physics/linear.py`) taken at the simulated states. Nothing is estimated here.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn.move_data import Experiment, commands, whitened
from observer_fi.numerics import compiled
from observer_fi.physics import Model, linear, plant
from observer_fi.physics import equations as a
from observer_fi.physics import simulation as s
from observer_fi.records import Array


class Disturbance(NamedTuple):
    """What may be disturbed: the equation it stands in, its name in words, and its unit."""

    equation: str
    name: str
    unit: str


DISTURBANCES = (
    Disturbance("torque", "torque", "N m"),
    Disturbance("torque", "torque against the motion", "N m"),
    Disturbance("torque", "drag in proportion to the speed", "N m s/rad"),
    Disturbance("electrical", "voltage in the winding", "V"),
    Disturbance("electrical", "resistance of the winding", "ohm"),
    Disturbance("electrical", "supply voltage", "V"),
    Disturbance("servo", "commanded speed", "rad/s"),
    Disturbance("servo", "commanded current", "A"),
    Disturbance("kinematics", "speed of the mass", "m/s"),
    Disturbance("kinematics", "share of the screw's travel", "1"),
    Disturbance("contact", "torque of a stop", "N m"),
    Disturbance("sensor:voltage", "voltage reading", "V"),
    Disturbance("sensor:current", "current reading", "A"),
    Disturbance("sensor:position", "position reading", "m"),
)
(
    TORQUE, FRICTION, DRAG, WINDING, RESISTANCE, SUPPLY, SPEED_COMMAND, CURRENT_COMMAND, MASS_SPEED, TRAVEL, STOP,
    VOLTAGE, CURRENT, POSITION,
) = range(len(DISTURBANCES))  # fmt: skip
_DEEPER = 1e-5  # m, step of the difference that gives a stop's slope


class Linear(NamedTuple):
    """The motion around the simulated one, N rows, D disturbances.

    F (N, 7): `linear.motion_transition` from each row to the next; held (N,): friction holds the mass over that step;
    H (N, 6): slopes of V by w, I, of i by w, I, of x by w, x. G (D, N, 3): what a unit of each of `DISTURBANCES` adds to w,
    I, x by the next row; S (D, N, 3): what it adds to V, i, x.
    """

    F: Array
    held: NDArray[np.bool_]
    H: Array
    G: Array
    S: Array


def linearised(experiment: Experiment, model: Model, states: Array) -> Linear:
    """The linear system around the motion `states` (N, COLUMNS) of a model."""
    n, d, p = experiment.t.size, len(DISTURBANCES), model.vector
    dt = np.diff(experiment.t, append=experiment.t[-1])
    dt[experiment.bounds[1:] - 1] = 0.0
    made = Linear(
        np.zeros((n, 7)), np.zeros(n, dtype=np.bool_), np.zeros((n, 6)), np.zeros((d, n, 3)), np.zeros((d, n, 3))
    )  # fmt: skip
    late = np.ascontiguousarray(commands(experiment, p)[1][:, 0])
    _fill(experiment.t, dt, states, late, experiment.theta, p, *made)
    return made


@compiled
def _fill(now, dt, states, w_cmd, theta, p, F, held, H, G, S):
    for k in range(dt.size):
        w, x, t, inner = states[k, s.W], states[k, s.X], dt[k], plant.inner_in(states[k], s.INNER)
        d, slow = a.indentation(x, p), plant.Slow(states[k, s.H], states[k, s.SAG], 0.0, 0.0)
        slow = plant.on_the_clock(slow, now[k], p)
        m, still = plant.Motion(w, states[k, s.I], x, d, inner), plant.Free(0.0, 0.0)
        by_w, by_I, by_x, x_by_w, _, _, _, per_J = linear.motion_slopes(m, slow, w_cmd[k], theta[k], still, p)
        if d != 0.0:
            by_x -= (a.stop_torque(w, d + _DEEPER, p) - a.stop_torque(w, d, p)) / _DEEPER * per_J
        (_, H[k, 0], H[k, 1], _), (_, H[k, 2], H[k, 3], _) = linear.electrical_readings(
            w, m.I, inner.c, slow, w_cmd[k], p, 1.0
        )
        H[k, 4] = -(p[a.POSITION_DELAY] + p[a.POSITION_LAG]) * a.mass_speed(1.0, 0.0, 0.0, p)
        H[k, 5] = p[a.POSITION_GAIN]
        held[k] = k + 1 < dt.size and w == 0.0 and states[k + 1, s.W] == 0.0
        f = linear.motion_transition(by_w, by_I, by_x, 0.0, x_by_w, t)
        for r in range(7):
            F[k, r] = f[r]
        _electrical(k, w, m.I, slow, w_cmd[k], p, S)
        for kind in range(WINDING, CURRENT_COMMAND + 1):
            push = p[a.KM] * per_J * S[kind, k, 1]
            G[kind, k, 0] = linear.constant_transition(by_w, by_x, 0.0, push, 0.0, t)
            V = p[a.RM] * (1.0 + slow.h) * S[kind, k, 1]
            S[kind, k, 0] += V
            S[kind, k, 1] = a.current_reading(S[kind, k, 1], p) - a.current_reading(0.0, p)
        G[SPEED_COMMAND, k, 1] = t
        G[TORQUE, k, 0] = linear.constant_transition(by_w, by_x, 0.0, -per_J, 0.0, t)
        G[FRICTION, k, 0] = a.sign_of(w) * G[TORQUE, k, 0]
        G[DRAG, k, 0] = w * G[TORQUE, k, 0]
        G[STOP, k, 0] = G[TORQUE, k, 0] if d != 0.0 else 0.0
        G[MASS_SPEED, k, 2] = t
        G[TRAVEL, k, 2] = t * a.mass_speed(w, d, 0.0, p)
        S[VOLTAGE, k, 0], S[CURRENT, k, 1], S[POSITION, k, 2] = 1.0, 1.0, 1.0


@compiled
def _electrical(k, w, I, slow, w_cmd, p, S):
    """Row k of S: current that a unit of each disturbance between servo and winding drives, and voltage besides R i."""
    asked = a.command_current(w, I, w_cmd, p)
    i_cmd, through = a.passed_current(asked, p), a.passes(asked, p)
    i, _, _, by_limit = linear.driven(i_cmd, w, slow, p)
    S[WINDING, k, 0], S[RESISTANCE, k, 0] = 1.0, i
    S[WINDING, k, 1], S[RESISTANCE, k, 1] = -abs(by_limit), -abs(by_limit) * i
    S[SUPPLY, k, 1] = by_limit
    if i == i_cmd:
        S[SPEED_COMMAND, k, 1], S[CURRENT_COMMAND, k, 1] = through * p[a.KP], through


def response(experiment: Experiment, linear: Linear, kind: int, forcing: Array) -> Array:
    """(K, N, 3) change of the normalised readings for disturbances (K, N) of one of `DISTURBANCES`."""
    out = np.empty((*forcing.shape, 3))
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        F, held, H, G, S = (
            linear.F[rows],
            linear.held[rows],
            linear.H[rows],
            linear.G[kind, rows],
            linear.S[kind, rows],
        )
        _carry(F, held, H, G, S, np.ascontiguousarray(forcing[:, rows].T), out[:, rows])
    out *= experiment.weight
    for column in out:
        whitened(experiment, column)
    return out


@compiled
def _carry(
    F: Array, held: NDArray[np.bool_], H: Array, G: Array, S: Array, forcing: Array, out: Array
) -> None:
    """Readings out (K, n, 3) of one move that disturbances (n, K) lead to; F, held, H, G, S: see `Linear`."""
    w, I, x = np.zeros(forcing.shape[1]), np.zeros(forcing.shape[1]), np.zeros(forcing.shape[1])
    for j in range(forcing.shape[0]):
        for k in range(forcing.shape[1]):
            f, before = forcing[j, k], w[k]
            out[k, j, 0] = H[j, 0] * w[k] + H[j, 1] * I[k] + S[j, 0] * f
            out[k, j, 1] = H[j, 2] * w[k] + H[j, 3] * I[k] + S[j, 1] * f
            out[k, j, 2] = H[j, 4] * w[k] + H[j, 5] * x[k] + S[j, 2] * f
            if held[j]:
                w[k] = 0.0
                continue
            w[k] = F[j, 0] * before + F[j, 1] * I[k] + F[j, 2] * x[k] + G[j, 0] * f
            x[k] += F[j, 5] * before + F[j, 6] * I[k] + G[j, 2] * f
            I[k] = F[j, 3] * before + F[j, 4] * I[k] + G[j, 1] * f


def gradient(experiment: Experiment, linear: Linear, kind: int, r: Array) -> Array:
    """(N,) what a unit of a disturbance at each sample adds to the product of its answer with residuals r (N, 3)."""
    seen = whitened(experiment, r.copy()) * experiment.weight
    out = np.empty(experiment.t.size)
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        _carry_back(
            linear.F[rows], linear.held[rows], linear.H[rows], linear.G[kind, rows], linear.S[kind, rows],
            np.ascontiguousarray(seen[rows]), out[rows],
        )  # fmt: skip
    return out


@compiled
def _carry_back(
    F: Array, held: NDArray[np.bool_], H: Array, G: Array, S: Array, seen: Array, out: Array
) -> None:
    """The transpose of the motion's answer: from readings (n, 3) of one move to its disturbance out (n,)."""
    w, I, x = 0.0, 0.0, 0.0
    for j in range(out.size - 1, -1, -1):
        V, i, p = seen[j, 0], seen[j, 1], seen[j, 2]
        out[j] = S[j, 0] * V + S[j, 1] * i + S[j, 2] * p
        if held[j]:
            w = 0.0
        else:
            out[j] += G[j, 0] * w + G[j, 1] * I + G[j, 2] * x
            w, I, x = (
                F[j, 0] * w + F[j, 3] * I + F[j, 5] * x,
                F[j, 1] * w + F[j, 4] * I + F[j, 6] * x,
                F[j, 2] * w + x,
            )
        w += H[j, 0] * V + H[j, 2] * i + H[j, 4] * p
        I += H[j, 1] * V + H[j, 3] * i
        x += H[j, 5] * p
