"""What the hypotheses of a bank believe before its first sample."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import transition as tr
from observer_fi.bank.bank_state import HypothesisState
from observer_fi.bank.hypotheses import BankArrays, Hypothesis
from observer_fi.physics import Drive, Model, equations, speed
from observer_fi.records import CHANNELS, Array

START_ROWS, START_READINGS = (
    64,
    5,
)  # samples looked at for the first readings of a channel, and how many count
CURRENT = CHANNELS.index("current")
HELD_ROWS = 10  # samples of the current that friction holds: as many as any first chunk has
REST_VARIANCE = tr.REST_VARIANCE
BELIEVABLE = 5.0  # standard deviations: a motor that holds more than such a friction is held, or read, by something else


class Held(NamedTuple):
    """A motor that stood under a current [A], known to so much [A], at a pitch [deg]."""

    current: float
    std: float
    theta: float


def held_at_first(z: Array, w_cmd: Array, theta: Array, noise: Array) -> Held | None:
    """What friction held before the first command, None where the log begins under way or shows too little of its rest.

    z (n, 3), w_cmd (n,), theta (n,): the first samples; noise (3,): variances of the channels.
    """
    rows = min(HELD_ROWS, len(z))
    still = int(np.argmax(w_cmd[:rows] != 0.0)) if (w_cmd[:rows] != 0.0).any() else rows
    current = z[:still, 1][np.isfinite(z[:still, 1])]
    if current.size < START_READINGS:
        return None
    # As doubtful as one reading: noise behind a filter is alike from sample to sample, and ten of them tell no better.
    return Held(float(np.median(current)), math.sqrt(noise[1]), float(theta[0]))


def start(
    hypotheses: tuple[Hypothesis, ...],
    b: BankArrays,
    z0: Array,
    command0: float,
    drive: Drive,
    held: Held | None = None,
) -> list[HypothesisState]:
    """Each hypothesis before its first sample: at rest, or turning at the command, where the sensors say.

    z0: (3,) first finite reading of each channel (NaN where there is none). What drives the motor is what its drive says.
    held: what its friction has held.
    """
    z, out = np.where(np.isfinite(z0), z0, 0.0), []
    for j, h in enumerate(hypotheses):
        model, n = h.model, len(h.states)
        rest = drive.at_rest(z[1], model.vector)
        x, var = b.entry_mean[j, :n].copy(), b.entry_var[j, :n].copy()
        w, w_var = _speed_at_first(z0, command0, var[0], model)
        I, I_var = rest.I, rest.I_std**2
        if command0 != 0.0 and drive.servo and model["Ki"]:
            I, I_var = _under_way(I, I_var, float(command0 - w), w_var, model)
        x[:3] = w, I, z[2] / model["position_gain"]
        var[:3] = w_var, I_var, 10.0 * b.noise[2]
        slow, bias = (
            tr.slow_at_rest(b.parameters[j]),
            np.array([0.0, b.noise[h.failed] if h.failed >= 0 else 0.0]),
        )
        if held is not None and "A" in h.states and h.failed != CURRENT:
            at = h.states.index("A")
            x[at], var[at] = _friction_that_held(x[at], var[at], held, b.parameters[j])
        slow[tr.LAGGED], slow[tr.PHI] = rest.c, _whole_turns(z[2], model["D"])
        out.append(
            HypothesisState(
                x, np.diag(var), slow, bias, np.full(3, np.nan), np.zeros(3), np.full(3, np.nan), np.full(1, np.nan),
                np.zeros(1),
            )
        )  # fmt: skip
    return out


def _speed_at_first(z0: Array, command0: float, usual: float, model: Model) -> tuple[float, float]:
    """Mean and variance of the speed of a motor at its first sample [rad/s].

    usual: variance of what voltage and current say of one under way. Where one of them is not there, the command is all that is
    known of the speed: a log may begin within a start, anywhere between rest and overshoot.
    """
    if command0 == 0.0:
        return 0.0, REST_VARIANCE
    if not model["Km"]:
        return 0.0, usual
    if np.isfinite(z0[:2]).all():
        return float(speed(z0, model.vector)), usual
    return command0, max(command0 * command0, usual)


def _under_way(I: float, I_var: float, error: float, w_var: float, model: Model) -> tuple[float, float]:
    """Mean and variance of the integral of a servo in motion [rad]. I, I_var: if it made all of the current; error: of the speed
    [rad/s]; w_var: its variance.

    What the proportional path makes is no integral. At its limit a current tells nothing of the servo: what the integral may be
    then grows with an error that lasts for the radian in which a loop swings.
    """
    share = model["Kp"] / model["Ki"]
    swing = math.sqrt(model["J"] / (model["Km"] * model["Ki"])) if model["Km"] else 0.0
    return I - share * error, I_var + share * share * w_var + swing * swing * (error * error + w_var)


def _friction_that_held(mean: float, var: float, held: Held, p: Array) -> tuple[float, float]:
    """Mean and variance of the factor of A, which is no less than what it held; how much more is open.

    The moments of a normal prior under the chance that a threshold in doubt was not reached (probit; Rasmussen and Williams 2006,
    equations 3.84 to 3.87). A filter that begins below the friction that holds would see the motor creep, and learn a friction.
    """
    usual = float(p[equations.A])
    if usual <= 0.0:
        return mean, var
    push = float(p[equations.KM]) * held.current - float(
        equations.load_torque(0.0, 0.0, 0.0, 0.0, held.theta, p)
    )
    push -= float(p[equations.FRICTION_ASYMMETRY])
    rest = float(equations.friction(0.0, 0.0, held.theta, p)) - usual
    least, doubt = (abs(push) - rest) / usual, float(p[equations.KM]) * held.std / usual
    wide = math.sqrt(var + doubt * doubt)
    z = (mean - least) / wide if wide else 0.0
    if wide == 0.0 or z < -BELIEVABLE:
        return mean, var
    density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    ratio = density / (0.5 * math.erfc(-z / math.sqrt(2.0)))
    return mean + var * ratio / wide, max(var - var * var * ratio * (z + ratio) / wide**2, 0.0)


def _whole_turns(x: float, per_rad: float) -> float:
    """Angle of a motor that is at x [m], in whole turns: a position does not tell less [rad]."""
    turn = 2.0 * np.pi * per_rad
    return 2.0 * np.pi * round(x / turn) if turn else 0.0


def first_readings(z: Array, w_cmd: float) -> Array:
    """(3,) first finite reading of each channel, NaN where there is none; the first few of them damp noise.

    At rest their median, at a command w_cmd [rad/s] what their line (Theil 1950, Sen 1968) begins with: a log may begin within a
    start. Only START_ROWS samples are looked at: a stream that begins cannot wait for more.
    """
    first = np.full(3, np.nan)
    for c in range(3):
        rows = np.flatnonzero(np.isfinite(z[:START_ROWS, c]))[:START_READINGS]
        if not rows.size:
            continue
        dense = rows.size == START_READINGS and rows[-1] < 2 * START_READINGS
        good = z[rows, c]
        first[c] = _begin_of_line(rows, good) if w_cmd and dense else np.median(good)
    return first


def _begin_of_line(x: NDArray[np.int64], y: Array) -> float:
    """The line through points, its slope the median of those of all pairs, at 0. scipy.stats takes longer to import."""
    a, b = np.triu_indices(x.size, 1)
    slope = np.median((y[b] - y[a]) / (x[b] - x[a]))
    return float(np.median(y) - slope * np.median(x))
