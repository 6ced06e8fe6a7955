"""Rigs whose servo is unknown: mechanics and winding from V, i and x alone, by equations 1 and 2 integrated in time.

Over a window in which the motor turns one way, equation 1 gives

    w(t) = w(0) + 1/J int (Km i - A s - B theta - b w) dt,         V = Rm i + Km w  (equation 2)

and equation 8 gives int (V - Rm i) dt = Km/D (x - x(0)). Both are linear in their unknowns, with one or two free constants
per window. Noise stands in the measured voltage and position; the integrals hardly feel it. Where no voltage is
logged, the speed is integrated once more and compared with the position.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn.driven.at_rest import resistance_at_rest
from observer_fi.learn.driven.from_position import FromPosition, from_position, left_open
from observer_fi.learn.driven.from_voltage import DROP, FromVoltage, from_voltage
from observer_fi.learn.driven.lateness import as_filters, shows, with_voltage_later
from observer_fi.learn.driven.windows import (
    WINDOW_S,
    Ahead,
    Driven,
    Window,
    driven,
    interval_of,
    windows_of,
)
from observer_fi.numerics import digits, with_unit
from observer_fi.physics import PARAMETERS, Rig
from observer_fi.records import Array, Filter, Fit, Log, Parameter

CANNOT_TELL = 0.3
PITCH_SPAN = 2.0  # deg
DRAG, NO_DRAG = "viscous_positive", 2.0  # standard errors below which a drag may be none
SEVERAL = 2.0  # samples of a time constant that tell where the motor begins to turn behind it
Z95 = 1.959964
COARSE = (
    0.01  # of a steady reading, by which steps are off, from which on nothing finer than constants is told
)
_SHIFTS = 4  # after which a channel is as late as it is
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

_Law = TypeVar("_Law", FromVoltage, FromPosition)


class _Told(NamedTuple):
    """What the windows tell: a fit but for what is missing in it."""

    names: tuple[str, ...]
    values: Array
    covariance: Array
    left_open: Array
    sigma: float
    noise: float
    unit: str
    samples: int
    late: tuple[Filter, ...]
    inductance: Parameter | None


def identify_driven(logs: Sequence[Log], rig: Rig) -> Fit:
    """Fit of a rig that is driven by its measured voltage or current: J, A, B, viscous friction, and Rm and Km from V.

    Raises InvalidLogError where the motor never turns for long enough.
    """
    each, rate_hz = [driven(log, rig) for log in logs], logs[0].rate_hz
    windows = [w for one in each for w in windows_of(one, rig)]
    if not windows:
        raise InvalidLogError(f"{logs[0].path}: the motor never turns for {WINDOW_S:g} s; record a move")
    with_voltage = all(np.isfinite(w.z[:, 0]).all() for w in windows) and rig.model["Rm"] > 0.0
    s = _by_voltage(each, rig, rate_hz) if with_voltage else _by_position(windows, rig, rate_hz)
    parameters, covariance = _reported(s.names, s.values, s.covariance, rig, s.left_open)
    needed = _NEEDED | _OF_FAULTS | ({} if with_voltage else _WITHOUT_VOLTAGE)
    missing = {name: text for name, text in needed.items() if not any(p.name == name for p in parameters)}
    nll = float(np.log(s.noise * np.sqrt(2.0 * np.pi)) + 0.5 * (s.sigma / s.noise) ** 2)
    error = {s.unit: s.sigma / rig.model["Km"] if with_voltage else s.sigma}
    told = [_of_winding(s.inductance, float(s.values[0]))] if s.inductance else []
    told += [_of_drop(float(s.values[s.names.index(DROP[0])]))] if DROP[0] in s.names else []
    return Fit(
        parameters, _correlation(covariance), missing, nll, error, {"samples": s.samples},
        filters=s.late, warnings=tuple(told), inductance=s.inductance,
    )  # fmt: skip


def _by_voltage(each: Sequence[Driven], rig: Rig, rate_hz: float) -> _Told:
    """Behind the winding's inductance where it has one, and with a voltage as late as the current. rate_hz: of the log."""
    late, ahead, at_rest = 0.0, Ahead(), resistance_at_rest(each, rig)
    moving = [w for one in each for w in windows_of(one, rig)]
    rounded = _rounded(each, moving, rig)
    coarse = max(rounded) > COARSE

    def found(late: float, ahead: Ahead) -> FromVoltage:
        later = [with_voltage_later(one, late) for one in each]
        windows = [w for one in later for w in windows_of(one, rig, ahead)]
        windows = windows or [w for one in later for w in windows_of(one, rig)]
        return _without_drag(
            lambda names: from_voltage(windows, rig, names, at_rest, ahead.drop, coarse), windows
        )

    interval = 1.0 / each[0].log.rate_hz
    s = found(late, ahead)
    if s.drops:
        with_drop = Ahead(0.0, *s.values[-2:].tolist())
        s, ahead = found(late, with_drop), with_drop
    for _ in range(_SHIFTS):
        more, std = s.current_late
        if coarse or not shows(more, std, interval):
            break
        late += more
        s = found(late, ahead)
    L = s.inductance
    if L and L[0] > SEVERAL * float(s.values[0]) * interval:
        s = found(late, ahead._replace(inductance=L[0]))
        L = s.inductance
    position, std = s.position_late
    behind = (0.0, late, late + position if not coarse and shows(late + position, std, interval) else 0.0)
    noise = float(np.hypot(rig.noise["voltage"], rig.model["Rm"] * rig.noise["current"]))
    inductance = Parameter("inductance", *L, 0.0, "H", L[0] - Z95 * L[1], L[0] + Z95 * L[1]) if L else None
    covariance = s.covariance + _of_steps(s, rounded, moving)
    return _Told(
        s.names, s.values, covariance, np.zeros(s.values.size), s.sigma, noise, "speed_rad_s",
        s.n, as_filters(behind, rate_hz), inductance,
    )  # fmt: skip


def _rounded(each: Sequence[Driven], windows: Sequence[Window], rig: Rig) -> tuple[float, float]:
    """Relative standard deviations that the steps of voltage and current leave in what steady motion tells, and in what its
    winding takes, of which the voltage is only a part.
    """
    left = [max(one.rounding[c] for one in each) for c in (0, 1)]
    usual = [float(np.median(np.abs(np.concatenate([w.z[:, c] for w in windows])))) for c in (0, 1)]
    steady = math.hypot(_share(left[0], usual[0]), _share(left[1], usual[1]))
    return steady, math.hypot(steady, _share(left[0], rig.model["Rm"] * usual[1]))


def _share(left: float, usual: float) -> float:
    """What steps leave, of a reading: all of it at most."""
    return left / max(left, usual) if left else 0.0


def _of_steps(s: FromVoltage, rounded: tuple[float, float], windows: Sequence[Window]) -> Array:
    """(k, k) covariance of what steps of these relative sizes do to each value."""
    speed = max(float(np.abs(w.w).mean()) for w in windows)
    friction = abs(float(s.values[s.names.index("A")]))
    of_friction = {"torque_offset": friction, "viscous_positive": friction / speed}
    pairs = zip(s.names, s.values.tolist(), strict=True)
    return np.diag([
        (rounded[name in ("Rm", "J")] * of_friction.get(name, value)) ** 2 for name, value in pairs
    ])  # fmt: skip


def _by_position(windows: list[Window], rig: Rig, rate_hz: float) -> _Told:
    """With a position as late as it shows. rate_hz: of the log."""
    late, interval = 0.0, interval_of(windows)

    def found(late: float) -> FromPosition:
        earlier = [w.with_position_earlier(late) for w in windows] if late else windows
        return _without_drag(lambda names: from_position(earlier, rig, names), windows)

    s = found(late)
    for _ in range(_SHIFTS):
        if not shows(*s.late, interval):
            break
        late += s.late[0]
        s = found(late)
    return _Told(
        s.names, s.values, s.covariance, left_open(s.names, s.values, rig), rig.model["D"] * s.sigma,
        rig.noise["position"], "position_m", s.n, as_filters((0.0, 0.0, late), rate_hz), None,
    )  # fmt: skip


def _of_winding(L: Parameter, Rm: float) -> str:
    return (
        f"the voltage runs ahead of the current as {digits(1e3 * L.value)} mH in the winding make it "
        f"({digits(1e3 * L.value / Rm)} ms): the constants are those behind it, and the rig file has it, so that `diagnose` "
        "takes it out of the voltage"
    )


def _of_drop(volts: float) -> str:
    return (
        f"brushes, or the dead time of a converter, take {with_unit(volts, 'V')} whichever way the current flows: the constants "
        "are those behind it, and the rig file has it as brush_drop"
    )


def _without_drag(law: Callable[[tuple[str, ...]], _Law], windows: Sequence[Window]) -> _Law:
    """What a law tells, without a viscous drag where that only hides the friction."""
    names = _unknowns(windows)
    s = law(names)
    hidden = _drag_hides_friction(s.names, s.values, s.covariance)
    return law(tuple(n for n in names if n != DRAG)) if hidden else s


def _drag_hides_friction(names: Sequence[str], values: Array, covariance: Array) -> bool:
    """Whether friction has no value only because a drag is free beside it that is none: less than its standard errors say."""
    if DRAG not in names:
        return False
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    a, drag = names.index("A"), names.index(DRAG)
    return bool(std[a] > CANNOT_TELL * abs(values[a]) and values[drag] < NO_DRAG * std[drag])


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


def _reported(
    names: Sequence[str], values: Array, covariance: Array, rig: Rig, left_open: Array
) -> tuple[tuple[Parameter, ...], Array]:
    """Parameters whose standard error leaves them a value, and their covariance. A small offset, drag or drop is a value too.

    left_open: standard deviations that intervals hold besides.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    half = Z95 * np.hypot(std, left_open)
    small = ("torque_offset", "viscous_positive", *DROP)
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
