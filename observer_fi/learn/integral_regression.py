"""Rigs whose servo is unknown: mechanics and winding from V, i and x alone, by equations 1 and 2 integrated in time.

Over a window in which the motor turns one way, equation 1 gives

    w(t) = w(0) + 1/J int (Km i - A s - B theta - b w) dt,         V = Rm i + Km w  (equation 2)

and equation 8 gives int (V - Rm i) dt = Km/D (x - x(0)). Both are linear in their unknowns, with one or two free constants
per window. Noise stands in the measured voltage and position; the integrals hardly feel it. Where no voltage is
logged, the speed is integrated once more and compared with the position.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used

from observer_fi.errors import InvalidLogError
from observer_fi.learn.contacts_and_losses import motor_angle
from observer_fi.logs import change_rate, position_speed
from observer_fi.numerics import constant_runs, correlation_time, digits, filled
from observer_fi.physics import PARAMETERS, Model, Rig, speed
from observer_fi.records import Array, Fit, Log, Parameter

WINDOW_S = 0.25
SLOWEST = 0.05  # of the fastest speed: below it the sign of friction is in doubt
SMOOTH_S = 0.02  # over which the speed is averaged to find where the motor turns
TURNS = 20.0  # rad/s: a motor slower than this stands
CANNOT_TELL = 0.3
MAKER = {
    "Km": 2e-3,
    "D": 1e-3,
}  # relative 1-sigma of what the maker states, where the rig file gives no spread
WARMER = 0.1  # of Rm, by which a winding of 25 K more than on its data sheet differs
PITCH_SPAN = 2.0  # deg
DRAG, NO_DRAG = "viscous_positive", 2.0  # standard errors below which a drag may be none
WINDING = 1e-3  # of Rm, as much as a quarter of a kelvin of copper: by so much trapezoids through a ringing current are off
SHOWS_STD, SHOWS_S = 4.0, 2e-4  # standard errors, and time constant, from which on an inductance is told
SEVERAL = 2.0  # samples of a time constant that tell where the motor begins to turn behind it
Z95 = 1.959964
LONGEST = 2000  # samples over which residuals may be correlated
_OF_MOTION = ("J", "viscous_positive")  # of equation 1, what multiplies an acceleration or a speed
FEWEST_SMOOTH = 4  # samples of a curve
STEP = 0.1  # of a standard error: a whole one of an inertia that slow logs hardly tell is no small one
_MANY = 4  # windows per unknown from which on their scatter is a standard error
_NEEDED = {
    "J": "the speed hardly changes; record starts and stops",
    "A": "no steady motion; record moves of a second or longer",
    "B": "all motion is at one pitch; record moves at two pitches or more, 5 deg apart or farther",
    "viscous_positive": "one speed only; record moves at three speeds or more",
    "Rm": "current and speed change together; record starts and steady moves",
    "Km": "current and speed change together; record starts and steady moves",
    "torque_offset": "all moves go in one direction; record moves in both",
}
# The same where no voltage is logged: the current alone tells every torque in units of the maker's Km.
_WITHOUT_VOLTAGE = {
    "Rm": "no voltage is logged; log it",
    "Km": "no voltage is logged, and torques are as good as the maker's value; log the voltage",
}
# What no healthy move tells, and no fit of this kind looks for: the rig file keeps what it had.
_OF_FAULTS = dict.fromkeys(
    ("C", "E", "A_decoupled", "J_decoupled"),
    "no healthy move shows a stop or an open coupling; faults are told with the wide value of the rig file",
)


class Window(NamedTuple):
    """One stretch of motion one way: times from its start [s], readings, motor speed [rad/s], direction."""

    t: Array
    z: Array
    pitch: Array
    w: Array
    sign: float


class Solution(NamedTuple):
    """Least squares: coefficients and covariance, residual's standard deviation, number of samples."""

    x: Array
    covariance: Array
    sigma: float
    n: int


def identify_driven(logs: Sequence[Log], rig: Rig) -> Fit:
    """Fit of a rig that is driven by its measured voltage or current: J, A, B, viscous friction, and Rm and Km from V.

    Raises InvalidLogError where the motor never turns for long enough.
    """
    model = rig.model
    windows = [w for log in logs for w in windows_of(log, rig)]
    if not windows:
        raise InvalidLogError(f"{logs[0].path}: the motor never turns for {WINDOW_S:g} s; record a move")
    with_voltage = all(np.isfinite(w.z[:, 0]).all() for w in windows) and model["Rm"] > 0.0
    law = _from_voltage if with_voltage else _from_position
    names, values, covariance, s = law(windows, rig, _unknowns(windows))
    if with_voltage and _inductance(s) and s.x[-1] > SEVERAL * s.x[0] / logs[0].rate_hz:
        windows = [w for log in logs for w in windows_of(log, rig, float(s.x[-1]))] or windows
        names, values, covariance, s = law(windows, rig, _unknowns(windows))
    if _drag_hides_friction(names, values, covariance):
        names, values, covariance, s = law(windows, rig, tuple(n for n in _unknowns(windows) if n != DRAG))
    left_open = np.zeros(values.size) if with_voltage else _left_open(names, values, rig)
    parameters, covariance = _reported(names, values, covariance, rig, left_open)
    needed = _NEEDED | _OF_FAULTS | ({} if with_voltage else _WITHOUT_VOLTAGE)
    missing = {name: text for name, text in needed.items() if not any(p.name == name for p in parameters)}
    noise = (
        float(np.hypot(rig.noise["voltage"], model["Rm"] * rig.noise["current"]))
        if with_voltage
        else rig.noise["position"]
    )
    sigma = s.sigma * (1.0 if with_voltage else model["D"])
    error = {"speed_rad_s": sigma / model["Km"]} if with_voltage else {"position_m": sigma}
    nll = float(np.log(noise * np.sqrt(2.0 * np.pi)) + 0.5 * (sigma / noise) ** 2)
    L = _inductance(s) if with_voltage else None
    told = (_told(L, float(s.x[0])),) if L else ()
    figures = {"windows": windows, "samples": s.n}
    return Fit(
        parameters, _correlation(covariance), missing, nll, error, figures, warnings=told, inductance=L
    )


def _inductance(s: Solution) -> Parameter | None:
    """Of a winding that has one beyond doubt, and one that a start shows."""
    Rm, L, std = float(s.x[0]), float(s.x[-1]), float(np.sqrt(s.covariance[-1, -1]))
    if max(SHOWS_STD * std, SHOWS_S * Rm) > L:
        return None
    return Parameter("inductance", L, std, 0.0, "H", L - Z95 * std, L + Z95 * std)


def _told(L: Parameter, Rm: float) -> str:
    return (
        f"the voltage runs ahead of the current as {digits(1e3 * L.value)} mH in the winding make it "
        f"({digits(1e3 * L.value / Rm)} ms): the constants are those behind it, and the rig file has it, so that `diagnose` "
        "takes it out of the voltage"
    )


def windows_of(log: Log, rig: Rig, inductance: float = 0.0) -> list[Window]:
    """Stretches of `WINDOW_S` in which the motor turns one way and nothing is missing.

    inductance: of the winding [H]; at a start its voltage runs ahead, and the motor seems to turn while it stands.
    """
    ahead = inductance * change_rate(log.t, log.z[:, 1], 1) if inductance else np.zeros(log.t.size)
    w, smooth = _speed(replace(log, z=log.z - np.outer(ahead, (1.0, 0.0, 0.0))), rig.model)
    sign = np.where(
        np.abs(smooth) > max(SLOWEST * float(np.nanmax(np.abs(smooth), initial=0.0)), TURNS),
        np.sign(smooth),
        0.0,
    )
    channels = log.z[:, 1:] if np.isnan(log.z[:, 0]).all() else log.z
    sign[~np.isfinite(channels).all(axis=1)] = 0.0
    size = round(WINDOW_S * log.rate_hz)
    found = []
    for a, b in constant_runs(sign):
        if b - a < size // 2 or sign[a] == 0.0:
            continue
        for first in range(a, b - size // 2, size):
            rows = slice(first, min(first + size, b))
            if np.diff(log.t[rows]).max() < 1.5 / log.rate_hz:
                found.append(
                    Window(log.t[rows] - log.t[first], log.z[rows], log.pitch[rows], w[rows], float(sign[a]))
                )
    return found


def _speed(log: Log, model: Model) -> tuple[Array, Array]:
    """Motor speed of equation 16, or from the position where no voltage is logged, and the same smoothed."""
    size = max(1, round(SMOOTH_S * log.rate_hz))
    kernel = np.ones(size) / size
    if np.isnan(log.z[:, 0]).all() or model["Rm"] == 0.0:
        w = position_speed(log.t, log.z[:, 2], model["D"]).w
        return w, w
    w = filled(speed(log.z, model.vector))
    return w, np.convolve(w, kernel, "same")


def _from_voltage(
    windows: Sequence[Window], rig: Rig, names: tuple[str, ...], plain: bool = False
) -> tuple[tuple[str, ...], Array, Array, Solution]:
    """Names, values, covariance from equations 1 and 2, V = Rm i + L di/dt + V0 + Km/J int (Km i - A s - B theta - b w) dt.

    Km then follows from equation 8: the integral of V - Rm i - L di/dt is Km/D (x - x0). Maker's data enter as priors. L, the
    inductance that equation 2 leaves out, would be a smaller Rm and a larger J; it is none of the plant's, and not reported.
    """
    s = _circuit(windows, names, plain)
    if not plain:
        s = _with_maker(_with_samples_between(s, windows, names), rig)
    Km_std = _torque_constant(windows, rig, float(s.x[0]), float(s.x[-1]))[1]

    def values(coefficients: Array) -> Array:
        Rm, *loads, L, more = coefficients.tolist()
        Km = _torque_constant(windows, rig, Rm, L)[0] + more
        return np.concatenate(([Rm, Km, Km**2 / loads[0]], np.array(loads[1:]) * Km / loads[0]))

    at = np.append(s.x, 0.0)
    covariance = np.zeros((at.size, at.size))
    covariance[:-1, :-1] = s.covariance
    covariance[-1, -1] = Km_std**2
    slope = _slopes(values, at, STEP * np.sqrt(np.diag(covariance)))
    return ("Rm", "Km", *names), values(at), slope @ covariance @ slope.T, s


def _circuit(windows: Sequence[Window], names: Sequence[str], plain: bool) -> Solution:
    """Coefficients of V: Rm, Km^2/J, Km/J times each load, L.

    The noise of i makes Rm too small in plain least squares, by half where the motion is smooth; each reading has its
    neighbours for an instrument, and each rate those beyond them.
    """
    rows, y, instruments = [], [], []
    for w in windows:
        i, free = w.z[:, 1], np.ones((w.t.size, 1))
        loads = [_integral(w.t, i), *_loads(w, names[1:])]
        rows.append(_without(np.column_stack([i, *loads, change_rate(w.t, i, 1)]), free))
        y.append(_without(w.z[:, :1], free)[:, 0])
        beside = (
            [i, *loads, change_rate(w.t, i, 1)] if plain else [_neighbours(i), *loads, change_rate(w.t, i, 2)]
        )
        instruments.append(_without(np.column_stack(beside), free))
    return solve(rows, y, len(windows), instruments)


def _with_samples_between(s: Solution, windows: Sequence[Window], names: Sequence[str]) -> Solution:
    """A solution whose covariance holds what integrals between samples leave: half of what every second sample alone changes
    (Richardson's extrapolation says a third or less), and of the resistance `WINDING` besides.
    """
    covariance, fine = s.covariance.copy(), _circuit(windows, names, plain=True).x
    covariance[0, 0] += (WINDING * s.x[0]) ** 2
    for first in (0, 1):
        rows = slice(first, None, 2)
        half = [Window(w.t[rows] - w.t[first], w.z[rows], w.pitch[rows], w.w[rows], w.sign) for w in windows]
        changed = 0.5 * (_circuit(half, names, plain=True).x - fine)
        covariance += np.outer(changed, changed)
    return s._replace(covariance=covariance)


def _with_maker(s: Solution, rig: Rig) -> Solution:
    """A solution that knows of the maker's Rm, and that a winding may be warmer: only where the log tells less it counts."""
    maker = rig.model["Rm"] * np.hypot(rig.spread("Rm") or 0.0, WARMER)
    gain = s.covariance[:, 0] / (s.covariance[0, 0] + maker**2)
    moved = s.x + gain * (rig.model["Rm"] - s.x[0])
    return s._replace(x=moved, covariance=s.covariance - np.outer(gain, s.covariance[0]))


def _slopes(function: Callable[[Array], Array], at: Array, step: Array) -> Array:
    """Jacobian by central differences of `step`."""
    moved = [np.diag(step)[k] for k in range(at.size)]
    return np.column_stack(
        [(function(at + m) - function(at - m)) / (2.0 * h) for m, h in zip(moved, step, strict=True)]
    )


def _torque_constant(windows: Sequence[Window], rig: Rig, Rm: float, L: float) -> tuple[float, float]:
    """Km and its standard error from int (V - Rm i - L di/dt) dt = Km/D (x - x0), mixed with the maker's Km and D."""
    model = rig.model
    turned = [_integral(w.t, w.z[:, 0] - Rm * w.z[:, 1]) - L * w.z[:, 1] for w in windows]
    rows = [_without(one[:, None], np.ones((one.size, 1))) for one in turned]
    y = [_without(w.z[:, 2:] / model["D"], np.ones((w.t.size, 1)))[:, 0] for w in windows]
    s = solve(rows, y, len(windows))
    Km = 1.0 / float(s.x[0])
    std = float(np.hypot(np.sqrt(s.covariance[0, 0]) * Km**2, _of_maker(rig, "D") * Km))
    maker = _of_maker(rig, "Km") * model["Km"]
    weight = maker**2 / (std**2 + maker**2)
    return weight * Km + (1.0 - weight) * model["Km"], std * float(np.sqrt(weight))


def _from_position(
    windows: Sequence[Window], rig: Rig, names: tuple[str, ...]
) -> tuple[tuple[str, ...], Array, Array, Solution]:
    """As `_from_voltage` without voltage: equation 1 integrated twice against the position, Km the maker's.

    All values are in proportion to that Km, and what multiplies a speed or an acceleration to D as well (`_left_open`). The
    covariance is for these two as they are: whoever takes the values takes them, too.
    """
    model = rig.model
    rows, y = [], []
    for w in windows:
        once = np.column_stack([model["Km"] * _integral(w.t, w.z[:, 1]), *_loads(w, names[1:])])
        G = np.column_stack([_integral(w.t, g) for g in once.T])
        free = np.column_stack([np.ones(w.t.size), w.t])
        rows.append(_without(G, free))
        y.append(_without(w.z[:, 2:] / model["D"], free)[:, 0])
    s = solve(rows, y, 2 * len(windows))
    values = np.concatenate(([1.0], s.x[1:])) / s.x[0]
    slope = np.eye(s.x.size) / s.x[0]
    slope[:, 0] = -values / s.x[0]
    return names, values, slope @ s.covariance @ slope.T, s


def _drag_hides_friction(names: Sequence[str], values: Array, covariance: Array) -> bool:
    """Whether friction has no value only because a drag is free beside it that is none: less than its standard errors say."""
    if DRAG not in names:
        return False
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    a, drag = names.index("A"), names.index(DRAG)
    return bool(std[a] > CANNOT_TELL * abs(values[a]) and values[drag] < NO_DRAG * std[drag])


def _left_open(names: Sequence[str], values: Array, rig: Rig) -> Array:
    """Standard deviations that the maker's Km and D leave of values from current and position."""
    moved = _of_maker(rig, "D") * np.isin(names, _OF_MOTION)
    return np.asarray(np.abs(values) * np.hypot(_of_maker(rig, "Km"), moved))


def _of_maker(rig: Rig, name: str) -> float:
    """Relative standard deviation of a value of the maker's."""
    return rig.spread(name) or MAKER[name]


def _loads(w: Window, names: Sequence[str]) -> list[Array]:
    """Integrals of what the loads multiply, with their sign in equation 1."""
    columns = {
        "A": -w.sign * w.t,
        "B": -_integral(w.t, w.pitch),
        "viscous_positive": -_integral(w.t, w.w),
        "torque_offset": -w.t,
    }
    return [columns[n] for n in names]


def _unknowns(windows: Sequence[Window]) -> tuple[str, ...]:
    """J, A and what the motion can tell."""
    names = ["J", "A"]
    pitch = np.array([w.pitch.mean() for w in windows])
    speed = np.array([np.abs(w.w).mean() for w in windows])
    if np.ptp(pitch) > PITCH_SPAN:
        names.append("B")
    if np.ptp(speed) > 0.2 * speed.max():
        names.append("viscous_positive")
    if len({w.sign for w in windows}) == 2:
        names.append("torque_offset")
    return tuple(names)


def _integral(t: Array, y: Array) -> Array:
    """(n,) integral of y (n,) from the first sample on, through a smooth curve: a line between the samples of a slow log loses
    percents of what a current rings.
    """
    if t.size < FEWEST_SMOOTH:
        return motor_angle(t, y)
    return np.asarray(scipy.interpolate.Akima1DInterpolator(t, y, method="makima").antiderivative()(t))


def _neighbours(y: Array) -> Array:
    """(n,) mean of the readings before and after each: what they have in common with it is signal, and no noise."""
    padded = np.concatenate((y[1:2], y, y[-2:-1]))
    return np.asarray(0.5 * (padded[:-2] + padded[2:]))


def _without(G: Array, free: Array) -> Array:
    """Columns with the free constants of their window projected out."""
    q, _ = np.linalg.qr(free)
    return G - q @ (q.T @ G)


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


def _reported(
    names: Sequence[str], values: Array, covariance: Array, rig: Rig, left_open: Array
) -> tuple[tuple[Parameter, ...], Array]:
    """Parameters whose standard error leaves them a value, and their covariance. A small offset or drag is a value too.

    left_open: standard deviations that intervals hold besides.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    half = Z95 * np.hypot(std, left_open)
    small = ("torque_offset", "viscous_positive")
    sure = [k for k, n in enumerate(names) if n in small or std[k] < CANNOT_TELL * abs(values[k])]
    found = tuple(
        Parameter(
            names[k], float(values[k]), float(std[k]), rig.model[names[k]], PARAMETERS[names[k]][0],
            float(values[k] - half[k]), float(values[k] + half[k]),
        )
        for k in sure
    )  # fmt: skip
    return found, covariance[np.ix_(sure, sure)]


def _correlation(covariance: Array) -> Array:
    d = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return covariance / np.outer(d, d)
