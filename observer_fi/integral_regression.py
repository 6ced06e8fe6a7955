"""Rigs whose servo is unknown: mechanics and winding from V, i and x alone, by equations 1 and 2 integrated in time.

Over a window in which the motor turns one way, equation 1 gives

    w(t) = w(0) + 1/J int (Km i - A s - B theta - b w) dt,         w = (V - Rm i)/Km  (equation 16)

and equation 2 with equation 8 gives int V dt = Rm int i dt + Km/D (x - x(0)). Both are linear in their unknowns with one
or two free constants per window. Noise stands in the measured speed and position; the integrals hardly feel it. Where
no voltage is logged the speed is integrated once more, and compared with the position.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.actuator import PARAMETERS
from observer_fi.kinematic_breaks import motor_angle
from observer_fi.models import Model, Rig
from observer_fi.errors import InvalidLogError
from observer_fi.records import Array, Fit, Log, Parameter

WINDOW_S = 0.25
SLOWEST = 0.05  # of the fastest speed: below it the sign of friction is in doubt
SMOOTH_S = 0.02  # over which the speed is averaged to find where the motor turns
TURNS = 20.0  # rad/s: a motor slower than this stands
CANNOT_TELL = 0.3
PITCH_SPAN = 2.0  # deg
Z95 = 1.959964
_NEEDED = {
    "J": "the speed hardly changes; record starts and stops",
    "A": "no steady motion; record moves of a second or longer",
    "B": "all motion is at one pitch; record moves at two pitches or more, 5 deg apart or farther",
    "viscous_positive": "one speed only; record moves at three speeds or more",
    "Rm": "current and speed change together; record starts and steady moves",
    "Km": "current and speed change together; record starts and steady moves",
    "torque_offset": "all moves go in one direction; record moves in both",
}


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
    windows = [w for log in logs for w in windows_of(log, model)]
    if not windows:
        raise InvalidLogError(f"{logs[0].path}: the motor never turns for {WINDOW_S:g} s; record a move")
    with_voltage = all(np.isfinite(w.z[:, 0]).all() for w in windows) and model["Rm"] > 0.0
    parameters: list[Parameter] = []
    blocks: list[Array] = []
    if with_voltage:
        found, covariance = _electrical(windows, rig)
        parameters += found
        blocks.append(covariance)
    known = {p.name: p.value for p in parameters}
    mechanics, covariance, sigma, n = _mechanics(windows, rig, known, with_voltage)
    parameters += mechanics
    blocks.append(covariance)
    missing = {name: text for name, text in _NEEDED.items() if not any(p.name == name for p in parameters)}
    noise = rig.noise["position"] if not with_voltage else _speed_noise(rig)
    channel = "position_m" if not with_voltage else "speed_rad_s"
    nll = float(np.log(noise * np.sqrt(2.0 * np.pi)) + 0.5 * (sigma / noise) ** 2)
    return Fit(tuple(parameters), _correlation(blocks), missing, nll, {channel: sigma}, {"windows": windows, "samples": n})


def windows_of(log: Log, model: Model) -> list[Window]:
    """Stretches of `WINDOW_S` in which the motor turns one way and nothing is missing."""
    w, sure = _speed(log, model)
    sign = np.where(np.abs(sure) > max(SLOWEST * float(np.nanmax(np.abs(sure), initial=0.0)), TURNS), np.sign(sure), 0.0)
    channels = log.z[:, 1:] if np.isnan(log.z[:, 0]).all() else log.z
    sign[~np.isfinite(channels).all(axis=1)] = 0.0
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], sign, [0.0]))))
    size = round(WINDOW_S * log.rate_hz)
    found = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        if b - a < size // 2 or sign[a] == 0.0:
            continue
        for first in range(a, b - size // 2, size):
            rows = slice(first, min(first + size, b))
            if np.diff(log.t[rows]).max() < 1.5 / log.rate_hz:
                found.append(Window(log.t[rows] - log.t[first], log.z[rows], log.pitch[rows], w[rows], float(sign[a])))
    return found


def _speed(log: Log, model: Model) -> tuple[Array, Array]:
    """Motor speed of equation 16, or from the position where no voltage is logged, and the same smoothed."""
    size = max(1, round(SMOOTH_S * log.rate_hz))
    kernel = np.ones(size) / size
    if np.isnan(log.z[:, 0]).all() or model["Rm"] == 0.0:
        x = np.convolve(np.pad(_filled(log.z[:, 2]), size, mode="edge"), kernel, "same")[size:-size]
        w = np.gradient(x, log.t) / model["D"]
        return w, np.convolve(w, kernel, "same")
    w = _filled((log.z[:, 0] - model["Rm"] * log.z[:, 1]) / model["Km"])
    return w, np.convolve(w, kernel, "same")


def _filled(y: Array) -> Array:
    bad = ~np.isfinite(y)
    k = np.arange(y.size)
    return np.interp(k, k[~bad], y[~bad]) if bad.any() and not bad.all() else y


def _electrical(windows: Sequence[Window], rig: Rig) -> tuple[list[Parameter], Array]:
    """Rm and Km from int V dt = Rm int i dt + Km/D (x - x0), D the maker's; each window keeps a constant."""
    model = rig.model
    rows, y = [], []
    for w in windows:
        once = [motor_angle(w.t, w.z[:, 1]), (w.z[:, 2] - w.z[0, 2]) / model["D"]]
        rows.append(_centred(np.column_stack(once)))
        y.append(_centred(motor_angle(w.t, w.z[:, 0])[:, None])[:, 0])
    # x stands with its noise on the right: the equation is solved for x, which is linear as well.
    G, left = np.concatenate(rows), np.concatenate(y)
    s = solve(np.column_stack([left, -G[:, 0]]), G[:, 1], len(windows))
    Km = 1.0 / s.x[0]
    Rm = s.x[1] * Km
    to_values = np.array([[-(Km**2), 0.0], [-Rm * Km, Km]])
    return _told(("Km", "Rm"), np.array([Km, Rm]), to_values @ s.covariance @ to_values.T, rig)


def _mechanics(
    windows: Sequence[Window], rig: Rig, known: dict[str, float], with_voltage: bool
) -> tuple[list[Parameter], Array, float, int]:
    """J, A, B, viscous friction and torque offset from equation 1 integrated once (speed) or twice (position)."""
    model = rig.model
    Km, Rm = known.get("Km", model["Km"]), known.get("Rm", model["Rm"])
    names = _unknowns(windows)
    rows, y = [], []
    for w in windows:
        speed = (w.z[:, 0] - Rm * w.z[:, 1]) / Km if with_voltage else w.w
        regressors = {
            "A": -w.sign * w.t, "B": -motor_angle(w.t, w.pitch), "viscous_positive": -motor_angle(w.t, speed),
            "torque_offset": -w.t,
        }  # fmt: skip
        G = np.column_stack([Km * motor_angle(w.t, w.z[:, 1]), *(regressors[n] for n in names[1:])])
        target = speed
        if not with_voltage:
            G = np.column_stack([motor_angle(w.t, g) for g in G.T])
            target = (w.z[:, 2] - w.z[0, 2]) / model["D"]
        free = (np.ones(w.t.size),) if with_voltage else (np.ones(w.t.size), w.t)
        rows.append(_without(G, np.column_stack(free)))
        y.append(_without(target[:, None], np.column_stack(free))[:, 0])
    s = solve(np.concatenate(rows), np.concatenate(y), len(windows) * (1 if with_voltage else 2))
    J = 1.0 / s.x[0]
    to_values = np.eye(s.x.size) * J
    to_values[:, 0] = -s.x * J**2
    to_values[0, 0] = -(J**2)
    values = np.concatenate(([J], s.x[1:] * J))
    parameters, covariance = _told(names, values, to_values @ s.covariance @ to_values.T, rig)
    return parameters, covariance, s.sigma * (1.0 if with_voltage else model["D"]), s.n


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


def _centred(G: Array) -> Array:
    return G - G.mean(axis=0)


def _without(G: Array, free: Array) -> Array:
    """Columns with the free constants of their window projected out."""
    q, _ = np.linalg.qr(free)
    return G - q @ (q.T @ G)


def solve(G: Array, y: Array, constants: int) -> Solution:
    """Least squares with standard errors that grow with the residual's correlation. G (n, k), constants already out."""
    scale = np.maximum(np.linalg.norm(G, axis=0), 1e-300)
    inverse = np.linalg.pinv((G / scale).T @ (G / scale), rcond=1e-12)
    x = inverse @ ((G / scale).T @ y)
    r = y - G / scale @ x
    variance = float(r @ r) / max(y.size - x.size - constants, 1)
    return Solution(x / scale, inverse * variance * _time(r) / np.outer(scale, scale), float(np.sqrt(variance)), y.size)


def _time(r: Array) -> float:
    """1 + 2 sum of the autocorrelation up to its first zero."""
    n = r.size
    spectrum = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[: min(2000, n // 4)]
    rho = rho / max(rho[0], 1e-300)
    below: NDArray[np.int64] = np.flatnonzero(rho < 2.0 / np.sqrt(n))
    return float(1.0 + 2.0 * rho[1 : int(below[0]) if below.size else rho.size].sum())


def _told(names: Sequence[str], values: Array, covariance: Array, rig: Rig) -> tuple[list[Parameter], Array]:
    """Parameters whose standard error leaves them a value, and their covariance. A small offset or drag is a value too."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    small = ("torque_offset", "viscous_positive")
    keep = [k for k, n in enumerate(names) if n in small or std[k] < CANNOT_TELL * abs(values[k])]
    found = [
        Parameter(
            names[k], float(values[k]), float(std[k]), rig.model[names[k]], PARAMETERS[names[k]][0],
            float(values[k] - Z95 * std[k]), float(values[k] + Z95 * std[k]),
        )
        for k in keep
    ]  # fmt: skip
    return found, covariance[np.ix_(keep, keep)]


def _speed_noise(rig: Rig) -> float:
    """Standard deviation of one sample of the speed of equation 16 [rad/s]."""
    return float(np.hypot(rig.noise["voltage"], rig.model["Rm"] * rig.noise["current"]) / rig.model["Km"])


def _correlation(blocks: Sequence[Array]) -> Array:
    """Correlation matrix of independent blocks of parameters."""
    k = sum(b.shape[0] for b in blocks)
    out, at = np.zeros((k, k)), 0
    for b in blocks:
        d = np.sqrt(np.maximum(np.diag(b), 1e-300))
        out[at : at + d.size, at : at + d.size] = b / np.outer(d, d)
        at += d.size
    return out
