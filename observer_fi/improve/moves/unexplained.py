"""What no named cause explains: a smooth term in one equation, against one regressor, judged on held-out moves."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.improve.moves.lines import order_lines, time_lines, waves
from observer_fi.improve.moves.screening import Projector
from observer_fi.improve.steps import Smooth
from observer_fi.learn import (
    CURRENT,
    CURRENT_COMMAND,
    DISTURBANCES,
    FRICTION,
    POSITION,
    RESISTANCE,
    SPEED_COMMAND,
    TORQUE,
    TRAVEL,
    VOLTAGE,
    WINDING,
    Experiment,
    FitResult,
    Linear,
    commands,
    linearised,
    response,
    run,
)
from observer_fi.numerics import matvec, self_gram
from observer_fi.physics import Model
from observer_fi.physics import simulation as s
from observer_fi.records import Array

KNOTS = 9
_ERROR_KNOTS = 9  # close to each other where the error is small
_LEVELS = 6
_RIDGE = 1e-6
_SETTLING_S = (1.5, 5.0, 20.0)
_OF_SERVO = ("time", "speed", "current")
_BLOCK = 8  # samples, 5 ms: half a turn of the motor at full speed
_FEWEST_STEPS = 4  # between moves
_DRAWN = 200  # points of a curve that is drawn from its functions
_STEP_DOUBT = 1.3  # on the standard error of a step: development seeds without effects scatter by so much
# Of every equation what is disturbed, the second for a torque against the direction of motion.
KINDS = {
    "torque": (TORQUE, FRICTION), "electrical": (RESISTANCE, WINDING), "kinematics": (TRAVEL,), "sensor:position": (POSITION,),
    "sensor:current": (CURRENT,), "sensor:voltage": (VOLTAGE,), "servo": (SPEED_COMMAND, CURRENT_COMMAND),
}  # fmt: skip

_OF_THEIR_OWN = (
    WINDING,
    SPEED_COMMAND,
    CURRENT_COMMAND,
)  # whose curves are in a unit that is not their equation's

LINES_OF = {TORQUE: 3, RESISTANCE: 1}  # how many orders of each disturbance are looked at


class Shape(NamedTuple):
    """A basis (K, N) over one regressor, over (N,); at (K,): the points, where the coefficients are values of the curve.

    order, frequency_hz: of a line. servo: what only a servo knows of the regressor, in words; `_OF_SERVO` are the others that
    it may know.
    """

    regressor: str
    basis: Array
    over: Array
    at: Array | None = None
    order: float | None = None
    frequency_hz: float | None = None
    servo: str = ""

    def fits(self, equation: str) -> bool:
        """Whether what an equation misses can go with this regressor: a servo does not know angles, place or pitch."""
        if equation == "servo":
            return bool(self.servo) or (self.regressor in _OF_SERVO and self.frequency_hz is None)
        return not self.servo


def smooth_terms(experiment: Experiment, fitted: FitResult, excess: float) -> list[Smooth]:
    """Every (equation, regressor) pair, the best on held-out moves first.

    excess: misfit over the noise of this fit [nats], of which the shares are told.
    """
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    projector, linear = Projector(experiment, fitted), linearised(experiment, fitted.model, states)
    found = []
    for shape in _shapes(experiment, projector, fitted.model, linear, states):
        for equation in (name for name in KINDS if shape.fits(name) and name not in experiment.silent):
            for kind in KINDS[equation]:
                columns = response(experiment, linear, kind, shape.basis)
                term = _judge(experiment, projector, columns, equation, shape, excess)
                what = DISTURBANCES[kind] if kind in _OF_THEIR_OWN else None
                unit, name = (what.unit, what.name) if what else ("", "")
                found.append(replace(term, directed=kind == FRICTION, unit=unit, what=name, over=shape.servo))
    return sorted(found, key=lambda term: -term.held_out)


def price(experiment: Experiment, term: Smooth) -> float:
    """What the coefficients of a smooth term cost [nats], by Schwarz's criterion."""
    return 0.5 * term.coefficients * math.log(int((experiment.weight > 0.0).sum()))


def regressors(experiment: Experiment, states: Array, lead: float) -> dict[str, Array]:
    """(N,) each: what a disturbance may depend on. lead: of the screw [m].

    temperature: energy lost in the winding since the log began [J].
    """
    i, x = states[:, s.CURRENT], states[:, s.MASS]
    heat = np.concatenate([
        np.interp(experiment.t[experiment.rows(m)], t, np.cumsum(c * c) * float(np.median(np.diff(t))))
        for m in range(experiment.moves)
        for t, c in [experiment.history[experiment.log[m]]]
    ])  # fmt: skip
    return {
        "time": experiment.t,
        "speed": states[:, s.W],
        "position": x,
        "shaft_angle": states[:, s.PHI],
        "screw_angle": 2.0 * math.pi * x / lead,
        "pitch": experiment.theta,
        "current": i,
        "load": np.abs(i),
        "temperature": heat,
    }


def _shapes(
    experiment: Experiment, projector: Projector, model: Model, linear: Linear, states: Array
) -> list[Shape]:
    """Everything that a disturbance is tried with: curves over one regressor, pitch by speed, decays in time, and lines."""
    given = regressors(experiment, states, model["screw_lead"])
    since = experiment.t - experiment.t.min()
    decays = np.array([np.exp(-since / tau) for tau in _SETTLING_S])
    orders = {"shaft_angle": 1.0, "screw_angle": 2.0 * math.pi * model["D"] / model["screw_lead"]}
    return [
        *(_shape(name, values, orders.get(name)) for name, values in given.items()),
        _pitch_by_speed(given["pitch"], given["speed"]),
        _tilted(given["pitch"], given["shaft_angle"]),
        *_of_servo(commands(experiment, model.vector)[1][:, 0] - given["speed"], linear, states),
        Shape("time", decays, experiment.t),
        *(_in_time(line.at, experiment.t) for line in time_lines(experiment, projector, linear)),
        *(
            _of_order(line.at, given["shaft_angle"])
            for kind, most in LINES_OF.items()
            if DISTURBANCES[kind].equation not in experiment.silent
            for line in order_lines(experiment, projector, linear, states, most, kind)
        ),
    ]


def _in_time(hz: float, t: Array) -> Shape:
    return Shape("time", waves(2.0 * math.pi * t, hz), t, frequency_hz=hz)


def _of_order(order: float, phi: Array) -> Shape:
    return Shape("shaft_angle", waves(phi, order), np.remainder(phi, 2.0 * math.pi / order), order=order)


def _shape(regressor: str, r: Array, order: float | None = None) -> Shape:
    """Harmonics of an angle, hats at levels, or hats at knots."""
    if regressor.endswith("_angle"):
        turn = np.remainder(r, 2.0 * math.pi)
        basis = np.array([np.sin(r), np.cos(r), np.sin(2.0 * r), np.cos(2.0 * r)])
        return Shape(regressor, basis, turn, order=order)
    at = _points(regressor, r)
    return Shape(regressor, np.array([np.interp(r, at, row) for row in np.eye(at.size)]), r, at)


def _points(regressor: str, r: Array) -> Array:
    """(K,) knots over the regressor, or its levels where it has few."""
    levels = np.unique(np.round(r, 1)) if regressor == "pitch" else np.empty(0)
    if 1 < levels.size <= _LEVELS:
        at = levels
    else:
        low, high = np.quantile(r, (0.002, 0.998))
        at = np.linspace(low, high, KNOTS + (6 if regressor in ("position", "time") else 0))
    return at if at[-1] - at[0] > 0.0 else np.array([at[0], at[0] + 1.0])


def _pitch_by_speed(pitch: Array, speed: Array) -> Shape:
    """A curve over the speed for every level of pitch: a torque that needs both."""
    levels = _shape("pitch", pitch)
    knots = np.linspace(0.0, float(np.abs(speed).max()), 4)
    hats = [np.interp(np.abs(speed), knots, row) for row in np.eye(knots.size)[1:]]
    return Shape("pitch", np.array([level * hat for level in levels.basis for hat in hats]), pitch)


def _tilted(pitch: Array, phi: Array) -> Shape:
    """A wave over a turn of the motor that is as high as the pitch: what is out of balance in a motor that gravity turns to."""
    return Shape("shaft_angle", pitch * waves(phi, 1.0), np.remainder(phi, 2.0 * math.pi), order=1.0)


def _of_servo(error: Array, linear: Linear, states: Array) -> Iterator[Shape]:
    """What only a servo knows: the error of the speed (N,), the same while the supply limits the current, the integral."""
    most = max(float(np.abs(error).max()), 1e-300)
    at = np.linspace(-1.0, 1.0, _ERROR_KNOTS)
    at = most * at * np.abs(at)
    hats = np.array([np.interp(error, at, row) for row in np.eye(at.size)])
    limited = linear.S[SPEED_COMMAND, :, 1] == 0.0
    yield Shape("speed", hats, error, at, servo="error of the speed [rad/s]")
    yield Shape("speed", hats * limited, error, at, servo="error of the speed at the limit [rad/s]")
    integral = states[:, s.I]
    yield Shape("current", integral[None], integral, servo="integral of the error [rad]")


def _judge(
    experiment: Experiment,
    projector: Projector,
    columns: Array,
    equation: str,
    shape: Shape,
    excess: float,
) -> Smooth:
    """Gain of a smooth term, in all and predicted for every move from the others."""
    C = np.array([projector(column) for column in columns])
    size = np.sqrt([matvec(row[None], row)[0] for row in C])
    good = size > 1e-9 * max(float(size.max()), 1e-300)
    C = C[good] / size[good][:, None]
    H, g = self_gram(C), matvec(C, projector.r)
    ridge = _RIDGE * np.eye(g.size)
    weights = np.linalg.solve(H + ridge, g)
    gain = 0.5 * float(g @ weights)
    held_out = 0.0
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        block = C[:, 3 * rows.start : 3 * rows.stop]
        Hm, gm = self_gram(block), matvec(block, projector.r[3 * rows.start : 3 * rows.stop])
        other = np.linalg.lstsq(H - Hm + ridge, g - gm, rcond=1e-9)[0]
        held_out += float(gm @ other) - 0.5 * float(other @ Hm @ other)
    K = columns.shape[0]
    coefficients, errors = np.zeros(K), np.zeros(K)
    coefficients[good] = weights / size[good]
    errors[good] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(H + ridge)), 0.0)) / size[good]
    share = min(max(held_out / excess, 0.0), 1.0) if excess > 0.0 else 0.0
    drawn = _drawn(shape, coefficients, errors)
    line = (shape.order, shape.frequency_hz)
    return Smooth(equation, shape.regressor, False, gain, held_out, share, *drawn, K, *line)


def _drawn(shape: Shape, coefficients: Array, errors: Array) -> tuple[Array, Array, Array]:
    """The curve with its points and standard errors: the values themselves, or functions over their regressor."""
    if shape.at is not None:
        return shape.at, coefficients, errors
    order = np.argsort(shape.over, kind="stable")
    k = order[np.linspace(0, order.size - 1, min(_DRAWN, order.size)).astype(int)]
    basis = shape.basis[:, k]
    return shape.over[k], coefficients @ basis, np.sqrt(errors**2 @ basis**2)


def slow_excess(experiment: Experiment, r: Array, channel: int | None = None) -> float:
    """Misfit over the noise [nats] of means over blocks of the residuals, of all or of one channel.

    What any smooth term could hope to gain.
    """
    total, chosen = 0.0, slice(None) if channel is None else channel
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        count = (rows.stop - rows.start) // _BLOCK
        part = slice(rows.start, rows.start + count * _BLOCK)
        seen = (experiment.weight[part] > 0.0).reshape(count, _BLOCK, 3).sum(axis=1)
        means = r[part].reshape(count, _BLOCK, 3).sum(axis=1) / np.sqrt(np.maximum(seen, 1))
        total += 0.5 * float(np.sum((means**2 - (seen > 0))[:, chosen]))
    return total


def rest_steps(experiment: Experiment, fitted: FitResult) -> list[Smooth]:
    """Steps of the shown position between the end of one move and the start of the next, where the mass rests.

    One move's own rest position hides a sensor that drifts or tilts; the steps between the moves show it. Each move
    tells its offset to a thirtieth of the noise. A rest that slips turns the motor by di/Ki, 0.1 um of x at most. Where the
    simulation follows the position that was measured, nothing can be told.
    """
    if experiment.driven.size:
        return []
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    pairs = np.flatnonzero((np.diff(experiment.log) == 0) & _nothing_between(experiment))
    if pairs.size < _FEWEST_STEPS:
        return []
    size = np.diff(experiment.bounds)
    std = _STEP_DOUBT * experiment.noise[2] * np.sqrt(1.0 / size[pairs] + 1.0 / size[pairs + 1])
    first, last = experiment.bounds[:-1], experiment.bounds[1:] - 1
    step = (states[first[pairs + 1], s.MASS] - states[last[pairs], s.MASS]) / std
    middle = 0.5 * (experiment.t[first] + experiment.t[last])
    found = [_stepped("pitch", experiment.pitch, pairs, step, std)]
    found += [_stepped("time", np.exp(-middle / tau), pairs, step, std) for tau in _SETTLING_S]
    return [term for term in found if term is not None]


def _nothing_between(experiment: Experiment) -> NDArray[np.bool_]:
    """(M - 1,) whether the command is zero between a move and the next: a move there that no fit took moves the mass."""
    last, first = experiment.t[experiment.bounds[1:-1] - 1], experiment.t[experiment.bounds[1:-1]]
    quiet = []
    for a, b, log in zip(last, first, experiment.log, strict=False):
        t, w = experiment.knots[log]
        quiet.append(not np.any(w[(t > a) & (t < b)]))
    return np.array(quiet, dtype=bool)


def _stepped(
    regressor: str, shape: Array, pairs: NDArray[np.int64], step: Array, std: Array
) -> Smooth | None:
    """The position error `slope` times a shape (M,), and how well it predicts each step from the others."""
    u = (shape[pairs + 1] - shape[pairs]) / std
    power = float(u @ u)
    if power == 0.0:
        return None
    slope = float(u @ step) / power
    left_out = (step - slope * u) / np.maximum(1.0 - u * u / power, 1e-3)
    whole = 0.5 * float(step @ step)
    held_out = whole - 0.5 * float(left_out @ left_out)
    at = np.array([shape.min(), shape.max()])
    share = min(max(held_out / whole, 0.0), 1.0) if whole > 0.0 else 0.0
    gain = 0.5 * slope**2 * power
    return Smooth(
        "sensor:position",
        regressor,
        False,
        gain,
        held_out,
        share,
        at,
        slope * at,
        np.abs(at) / math.sqrt(power),
        1,
    )
