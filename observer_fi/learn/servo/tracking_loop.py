"""Moves of a motor whose servo nobody knows, simulated with the measured current (docs/decisions/0029).

The current that was measured drives the plant. Its noise is integrated twice, and no friction is known exactly, so a loop around
the simulation keeps it near the measured position,

    i = i_measured + Kp (w_measured - w) + Ki (phi_measured - phi),    Ki = ring^2 J / Km,  Kp = sqrt(2) ring J / Km,

as slow as the noises ask for: ring^4 = (Km i_noise / J)^2 dt / ((x_noise / D)^2 dt), the gain of a Kalman filter that has settled
(Kalman and Bucy 1961, example of a double integrator). What is left of the position is white then, and every effect is in it;
of a voltage, too. It is the servo of equations 3 and 4 with a command that makes these gains do so: everything that simulates a
servo's moves does so with these. Direct and inverse dynamic identification (Gautier, Janot and Vandanjon 2013) simulates moves
behind a loop that is known, and this is one.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second
from numpy.typing import NDArray

from observer_fi.errors import UsageError
from observer_fi.learn.move_data import Experiment, run_alone
from observer_fi.learn.servo.shown_position import shown_ahead
from observer_fi.learn.servo.tracking_doubt import DAMPING, Loop, tracking_doubt
from observer_fi.numerics import runs
from observer_fi.physics import Model, Rig, with_values
from observer_fi.physics import simulation as s
from observer_fi.records import Array

_PASSES = 8  # after which that is the motion of the model, and no longer a smoothed one
_MOST_PASSES = 40  # where what a sensor shows settles slowly, with play of many times the noise
_SETTLED = 0.1  # of the noise of the position: less from one pass to the next is none
_FASTEST = 0.1  # of the samples' rate, the ring of the loop
_RUNS_AWAY = 5.0  # times the fastest command
_NEVER = 4.0  # times the highest voltage: no supply limits what was measured
_STANDS = 0.5  # of the noise of a reading: less in a rest, and its steps hide it
_FEWEST = 8  # readings of a move's current that tell what a line between them misses
_NOT_SIMULATED = ("servo", "sensor:current")
_OF_VOLTAGE = ("electrical", "sensor:voltage")
CURRENT, POSITION = 1, 2


def tracked(experiment: Experiment, rig: Rig, late: float = 0.0) -> tuple[Experiment, Rig]:
    """The moves of a rig without a servo as those of one whose servo is the loop of this module, and the rig with it.

    The current drives and counts no more, and its noise is in the voltage that it makes, which tells nothing where no current was
    read beside it; nor does what is read once friction has caught the mass. late: by which the current was read later than the
    other channels [s]; it is no smoother for that. Raises UsageError for a rig with which no simulation stays near the moves.
    """
    looped = _with_loop(experiment, rig)
    model = looped.model
    seen = experiment.weight > 0.0
    noise = experiment.noise.copy()
    noise[0] = math.hypot(noise[0], model["Rm"] * noise[CURRENT])
    weight = experiment.weight * experiment.noise / noise
    weight[~seen[:, CURRENT], 0] = 0.0
    weight[:, CURRENT] = 0.0
    silent = _NOT_SIMULATED if seen[:, 0].any() else (*_NOT_SIMULATED, *_OF_VOLTAGE)
    loose = replace(
        experiment,
        noise=noise,
        weight=weight,
        silent=silent,
        older_s=float(np.median(np.diff(experiment.t[experiment.rows(0)]))),
        driven=_filled_current(experiment),
        driven_late=late,
    )
    near = followed(loose, model)
    w = run_alone(near, model, np.zeros((near.moves, 2)))[0][:, s.W]
    if not np.abs(w).max() < _RUNS_AWAY * _fastest(experiment):
        raise UsageError(
            f"with the constants of rig {rig.name!r} a simulation of these moves runs away: inertia J and friction A are of "
            "another machine, or guesses; run identify first, on starts from rest at full speed"
        )
    return _with_doubt(near, model, w, _rows_a_reading(experiment)), looped


def _rows_a_reading(experiment: Experiment) -> Array:
    """(3,) rows from one reading of a channel to the next, of the usual move."""
    rows = float(np.median(np.diff(experiment.t[experiment.rows(0)])))
    return np.array([max(_between(experiment, channel) / rows, 1.0) for channel in range(3)])


def _with_doubt(experiment: Experiment, model: Model, w: Array, every: Array) -> Experiment:
    """The experiment with what its loop leaves open in a motion of speed w (N,), until each move has stopped.

    every: (3,) rows from one reading of a channel to the next.
    """
    loop, weight, doubts = Loop.of(model), experiment.weight.copy(), []
    for rows in map(experiment.rows, range(experiment.moves)):
        turning = np.flatnonzero(w[rows])
        weight[rows][turning[-1] + 1 if turning.size else 0 :] = 0.0
        t, i, own = experiment.t[rows], experiment.driven[rows], weight[rows]
        doubts.append(tracking_doubt(t, i, w[rows], own, experiment.noise, every, loop))
    return replace(experiment, weight=weight, doubts=tuple(doubts))


def followed(experiment: Experiment, model: Model) -> Experiment:
    """The experiment whose loop keeps a simulation of this model near what was measured."""
    turning = [_turning(experiment, k, model) for k in range(len(experiment.history))]
    own = [np.zeros(t.size) for t, _ in experiment.history]
    experiment = replace(experiment, shown=np.zeros(experiment.t.size))
    for done in range(1, _MOST_PASSES + 1):
        seen = [_seen(experiment, k, phi) for k, phi in enumerate(turning)]
        off = [_off(experiment, k, model, *pair) for k, pair in enumerate(zip(seen, own, strict=True))]
        motion = [
            w + np.gradient(slow, t)
            for w, (slow, _), (t, _) in zip(own, off, experiment.history, strict=True)
        ]
        experiment = replace(
            experiment,
            knots=tuple(_command(experiment, k, model, w) for k, w in enumerate(motion)),
            rest=_rests(experiment, model, off),
        )
        states, y = run_alone(experiment, model, np.zeros((experiment.moves, 2)))
        if not np.isfinite(states[:, s.W]).all():
            break
        own = [_on_the_log(experiment, k, states[:, s.W]) for k in range(len(own))]
        shown, before = shown_ahead(states, model, y), experiment.shown
        experiment = replace(experiment, shown=shown)
        if done >= _PASSES and model["D"] * np.std(shown - before) < _SETTLED * experiment.noise[POSITION]:
            break
    return experiment


def _with_loop(experiment: Experiment, rig: Rig) -> Rig:
    """The rig with the gains of the loop, and a supply without limits."""
    model = rig.model
    ring = _ring(experiment, model)
    Kp, Ki = (gain * model["J"] / model["Km"] for gain in (DAMPING * ring, ring**2))
    top = model["Rm"] * np.abs(experiment.z[:, CURRENT]).max() + model["Km"] * _fastest(experiment)
    values = {"Kp": Kp, "Ki": Ki, "Rs": 0.0, "Vmax": _NEVER * float(top)}
    return with_values(rig, values, method="loop around the simulation")


def _fastest(experiment: Experiment) -> float:
    """Fastest command of the moves [rad/s]; in that of a position the last way of a move is a ring of its stop."""
    return max(float(np.abs(experiment.w_cmd(m)).max()) for m in range(experiment.moves))


def _ring(experiment: Experiment, model: Model) -> float:
    """The loop's [rad/s]: between two readings the current may also bend."""
    of_current, of_position = (_between(experiment, channel) for channel in (CURRENT, POSITION))
    noise = math.hypot(experiment.noise[CURRENT], _bend(experiment))
    drives = (model["Km"] * noise / model["J"]) ** 2 * of_current
    sees = (experiment.noise[POSITION] / model["D"]) ** 2 * of_position
    return min((drives / sees) ** 0.25, _FASTEST / max(of_current, of_position))


def _between(experiment: Experiment, channel: int) -> float:
    """Time between two readings of a channel that say something new, of the usual move [s]."""
    times = [
        float(np.ptp(t)) / max(int(np.count_nonzero(kept)), 1) for _, t, kept in _moves(experiment, channel)
    ]
    return float(np.median(times))


def _bend(experiment: Experiment) -> float:
    """What a line between two readings of the current misses halfway, in the root mean square [A]."""
    each = [experiment.z[rows, CURRENT][kept] for rows, _, kept in _moves(experiment, CURRENT)]
    found = [np.diff(i, 2) / 8.0 for i in each if i.size >= _FEWEST]
    return float(np.sqrt(np.mean(np.concatenate(found) ** 2))) if found else 0.0


def _filled_current(experiment: Experiment) -> Array:
    """(N,) current at every row of the moves, a line between two readings [A]."""
    i = np.empty(experiment.t.size)
    for rows, t, kept in _moves(experiment, CURRENT):
        i[rows] = np.interp(t, t[kept], experiment.z[rows, CURRENT][kept]) if kept.any() else 0.0
    return i


def _moves(experiment: Experiment, channel: int) -> Iterator[tuple[slice, Array, NDArray[np.bool_]]]:
    """Rows and times of every move, and which of them hold a reading of a channel."""
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        yield rows, experiment.t[rows], experiment.weight[rows, channel] > 0.0


def _turning(experiment: Experiment, log: int, model: Model) -> Array:
    """(n,) angle of the motor at the samples of a log, as its position tells it; a line between moves [rad]."""
    # Readings of a log's first start count nothing, but were read.
    read = (experiment.weight[:, POSITION] > 0.0) | (experiment.z[:, POSITION] != 0.0)
    own = (experiment.log[experiment.owner] == log) & read
    t = experiment.history[log][0]
    if not own.any():
        return np.zeros(t.size)
    return np.interp(t, experiment.t[own], experiment.z[own, POSITION]) / model["D"]


def _seen(experiment: Experiment, log: int, phi: Array) -> Array:
    """(n,) angle of the motor at the samples of a log, of what its position tells (n,), with the sensor of the model [rad]."""
    own, t = experiment.log[experiment.owner] == log, experiment.history[log][0]
    return phi - np.interp(t, experiment.t[own], experiment.shown[own]) if own.any() else phi


def _on_the_log(experiment: Experiment, log: int, w: Array) -> Array:
    """(n,) a speed (N,) at the samples of a log, 0 between moves [rad/s]."""
    t = experiment.history[log][0]
    whole = np.zeros(t.size)
    for m in np.flatnonzero(experiment.log == log).tolist():
        rows = experiment.rows(m)
        first = int(experiment.start[m])
        whole[first : first + rows.stop - rows.start] = w[rows]
    return whole


def _off(experiment: Experiment, log: int, model: Model, phi: Array, own: Array) -> tuple[Array, Array]:
    """(n,) by which a measured angle phi (n,) is ahead of that of the simulation's own speed (n,) [rad]: the slow part of it,
    which the loop follows, and all of it.
    """
    t = experiment.history[log][0]
    step, loop = float(np.median(np.diff(t))), Loop.of(model)
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (own[1:] + own[:-1]) * np.diff(t))))
    ahead = phi - turned
    if own.any():
        noise = float(experiment.noise[POSITION]) / model["D"]
        ahead = _while_it_stood(ahead, phi, own != 0.0, noise, 1.0 / (loop.ring * step))
    return scipy.signal.sosfiltfilt(loop.low_pass(step), ahead), ahead


def _while_it_stood(ahead: Array, phi: Array, moving: NDArray[np.bool_], noise: float, rows: float) -> Array:
    """The same where a rest shows readings phi (n,) [rad] without their noise, which are all off by the same: a line between the
    means of so many rows of the motion on either side.
    """
    ahead = ahead.copy()
    for first, last in zip(*runs(~moving), strict=True):
        if np.std(phi[first:last]) < _STANDS * noise:
            near = max(round(rows), 1)
            before, after = ahead[max(first - near, 0) : first], ahead[last : last + near]
            means = [float(side.mean()) for side in (before, after) if side.size]
            ahead[first:last] = np.linspace(means[0], means[-1], last - first)
    return ahead


def _rests(experiment: Experiment, model: Model, off: Sequence[tuple[Array, Array]]) -> Array:
    """(M, 2) current [A] and position [m] that moves begin with: the integral knows already what is slow and comes later."""
    rest = experiment.rest.copy()
    for m, log in enumerate(experiment.log.tolist()):
        slow, ahead = off[log]
        still = slice(int(experiment.start[m]), int(experiment.start[m] + experiment.moving[m]))
        rest[m, 0] = _at_rest(experiment, m) + model["Ki"] * (slow[still.start] - ahead[still].mean())
    return rest


def _at_rest(experiment: Experiment, move: int) -> float:
    """Mean of the current in the rest before a move [A]."""
    rows = experiment.rows(move)
    return float(experiment.driven[rows][: int(experiment.moving[move])].mean())


def _command(experiment: Experiment, log: int, model: Model, w: Array) -> tuple[Array, Array]:
    """Knots [s] and the command there [rad/s] that drives a log's moves with their measured current, near a speed w (n,)."""
    Kp, Ki = model["Kp"], model["Ki"]
    times, values = [], []
    for m in np.flatnonzero(experiment.log == log).tolist():
        rows = experiment.rows(m)
        t, i = experiment.t[rows], experiment.driven[rows]
        held = _held(t, i, _at_rest(experiment, m), Kp / Ki)
        t = t - experiment.driven_late
        measured = np.interp(t, experiment.history[log][0], w)
        times.append(t)
        values.append(measured + (i - held) / Kp)
    t, u = np.concatenate(times), np.concatenate(values)
    later = np.append(True, t[1:] > np.maximum.accumulate(t)[:-1])
    return t[later], u[later]


def _held(t: Array, i: Array, start: float, time: float) -> Array:
    """(n,) part of a current i (n,) that the loop's integral makes [A]: a lag of `time` [s], from the current of the rest."""
    keep = np.exp(-np.diff(t) / time)
    between = 0.5 * (i[1:] + i[:-1])
    held = np.empty(t.size)
    held[0] = start
    for k, (stay, now) in enumerate(zip(keep.tolist(), between.tolist(), strict=True)):
        held[k + 1] = held[k] * stay + now * (1.0 - stay)
    return held
