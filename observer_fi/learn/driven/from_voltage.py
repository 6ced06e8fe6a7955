"""Winding and mechanics of a motor from its voltage, current and position, by equations 1, 2 and 8 integrated in time.

Equation 8, int (V - Rm i) dt = Km/D (x - x0), tells the winding, whatever the mass does. In it a channel that is read late is its
own reading besides, and a position that is, the speed besides: neither moves Rm or Km. Equation 2 with the speed of equation 1
tells the loads, and Rm once more; but there a current that is late by s is a resistance that is larger by s Km^2/J, and an
inductance of s Rm. Half a sample made Rm 20 % too large at 250 Hz, within a percent by its standard error.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used

from observer_fi.learn.driven.least_squares import (
    SKEW,
    Solution,
    integral,
    load_integrals,
    neighbours,
    of_maker,
    solve,
    without,
)
from observer_fi.learn.driven.windows import Window, interval_of
from observer_fi.logs import change_rate
from observer_fi.physics import Rig
from observer_fi.records import Array

WARMER = 0.1  # of Rm, by which a winding of 25 K more than on its data sheet differs
WINDING = 1e-3  # of Rm, as much as a quarter of a kelvin of copper: by so much trapezoids through a ringing current are off
SHOWS_STD, SHOWS_S = 4.0, 2e-4  # standard errors, and time constant, from which on an inductance is told
LARGEST_S = 5e-3  # time constant of a winding that may be there
STEP = 0.1  # of a standard error: a whole one of an inertia that slow logs hardly tell is no small one
_ELSE = 3.0  # standard errors by which rests say something else than motion
_IN_TIME = 0.05  # of that: as good as none
_HALF = 0.5  # of what every second sample alone changes (Richardson's extrapolation says a third or less)
_RM, _PER_J = (
    0,
    1,
)  # of a solution of the circuit; its last ones are the inductance and by how much the current is late


class FromVoltage(NamedTuple):
    """What voltage, current and position tell. values, covariance: of `names`; solution: Rm, Km^2/J, Km/J times each load, L [H],
    and by how much the current is late [s]; position_late [s] and its standard error. Both: against the voltage. inductance: with
    its standard error, where there is one beyond doubt if the current is not late, which is less likely, and a start shows it.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    solution: Solution
    position_late: tuple[float, float]
    inductance: tuple[float, float] | None


def from_voltage(
    windows: Sequence[Window], rig: Rig, names: tuple[str, ...], at_rest: tuple[float, float] | None = None
) -> FromVoltage:
    """Rm and Km, and what `names` says of the mechanics, J first; maker's data enter as priors. at_rest: Rm as rests tell it, and
    its standard error [ohm].
    """
    s = with_samples_between(circuit(windows, names), lambda w: circuit(w, names, plain=True), windows)
    s, wound = _with_winding(windows, rig, s, at_rest)
    Rm, L = float(s.x[_RM]), float(s.x[-2])
    (_, Km_std), position_late = _torque_constant(windows, rig, Rm, L)

    def values(coefficients: Array) -> Array:
        Rm, *loads, L, _, more = coefficients.tolist()
        Km = _torque_constant(windows, rig, Rm, L)[0][0] + more
        return np.concatenate(([Rm, Km, Km**2 / loads[0]], np.array(loads[1:]) * Km / loads[0]))

    at = np.append(s.x, 0.0)
    covariance = np.zeros((at.size, at.size))
    covariance[:-1, :-1] = s.covariance
    covariance[-1, -1] = Km_std**2
    slope = _slopes(values, at, STEP * np.sqrt(np.diag(covariance)))
    return FromVoltage(
        ("Rm", "Km", *names),
        values(at),
        slope @ covariance @ slope.T,
        s,
        position_late,
        s.of(-2) if wound else None,
    )


def circuit(windows: Sequence[Window], names: Sequence[str], plain: bool = False) -> Solution:
    """Coefficients of V: of i, of int i, of each load, of di/dt.

    The noise of i makes that of i too small in plain least squares, by half where the motion is smooth; each reading has its
    neighbours for an instrument, and each rate those beyond them.
    """
    rows, y, instruments = [], [], []
    for w in windows:
        i, free = w.z[:, 1], np.ones((w.t.size, 1))
        loads = [integral(w.t, i), *load_integrals(w, names[1:])]
        rows.append(without(np.column_stack([i, *loads, change_rate(w.t, i, 1)]), free))
        y.append(without(w.z[:, :1], free)[:, 0])
        beside = (
            [i, *loads, change_rate(w.t, i, 1)] if plain else [neighbours(i), *loads, change_rate(w.t, i, 2)]
        )
        instruments.append(without(np.column_stack(beside), free))
    return solve(rows, y, len(windows), instruments)


def with_samples_between(
    s: Solution, law: Callable[[Sequence[Window]], Solution], windows: Sequence[Window]
) -> Solution:
    """A solution, Rm first, whose covariance holds what integrals between samples leave of a law, and of Rm `WINDING` besides."""
    covariance, fine = s.covariance.copy(), law(windows).x
    covariance[_RM, _RM] += (WINDING * s.x[_RM]) ** 2
    for first in (0, 1):
        half = [w.every_second(first) for w in windows]
        covariance += np.diag((_HALF * (law(half).x - fine)) ** 2)
    return s._replace(covariance=covariance)


def _with_winding(
    windows: Sequence[Window], rig: Rig, s: Solution, at_rest: tuple[float, float] | None
) -> tuple[Solution, bool]:
    """The circuit with Rm in place of the coefficient of i, L in that of di/dt, and the time by which the current is late; and
    whether there is an inductance.

    What equation 8, the maker and a winding that may be warmer say of Rm counts; what rests say, where motion says nothing else.
    """
    of_i, per_J = float(s.x[_RM]), float(s.x[_PER_J])
    late = SKEW * interval_of(windows)
    k = s.x.size
    T = np.eye(k + 1)
    T[_RM, k], T[k - 1, k] = -per_J, -of_i
    spread = np.zeros((k + 1, k + 1))
    spread[:k, :k], spread[k, k] = s.covariance, late**2
    s = s._replace(x=np.append(s.x, 0.0), covariance=T @ spread @ T.T)
    s = s.knowing(_RM, *_resistance(windows, rig))
    Rm = rig.model["Rm"]
    s = s.knowing(_RM, Rm, Rm * float(np.hypot(rig.spread("Rm") or 0.0, WARMER)))
    if at_rest and abs(at_rest[0] - s.x[_RM]) < _ELSE * np.hypot(at_rest[1], s.of(_RM)[1]):
        s = s.knowing(_RM, at_rest[0], float(np.hypot(at_rest[1], WINDING * Rm)))
    return _wound_or_late(s, Rm, late)


def _wound_or_late(s: Solution, Rm: float, skew: float) -> tuple[Solution, bool]:
    """A circuit with an inductance, or a current that is late, or both, whichever is likeliest, and whether it has an inductance;
    its covariance holds what the others say, as likely as they are. Where both are beyond doubt they are as they are.

    skew: standard deviation of the time by which channels are late that nobody has timed [s].
    """
    (L, L_std), (late, late_std) = s.of(-2), s.of(-1)
    if abs(L) > SHOWS_STD * L_std and abs(late) > SHOWS_STD * late_std:
        return s, _shows(s, Rm)
    wound, timed, little = s.x.size - 2, s.x.size - 1, 0.5 * SHOWS_S * Rm
    unwound, in_time = s.knowing(wound, 0.0, little), s.knowing(timed, 0.0, _IN_TIME * skew)
    log_density, log_share = scipy.stats.norm.logpdf, scipy.stats.norm.logcdf
    there = [log_share(np.divide(*one.of(-2))) - np.log(LARGEST_S * Rm) for one in (in_time, s)]
    nats = np.array([
        log_density(0.0, L, np.hypot(L_std, little)),
        log_density(0.0, late, late_std) - log_density(0.0, 0.0, skew) + there[0],
        there[1],
    ])  # fmt: skip
    each, share = (unwound, in_time, s), scipy.special.softmax(nats)
    best = each[int(np.argmax(nats))]
    apart = [one.x - best.x for one in each]
    parts = zip(share, each, apart, strict=True)
    covariance = sum(
        (p * (one.covariance + np.outer(d, d)) for p, one, d in parts), np.zeros_like(s.covariance)
    )
    return best._replace(covariance=covariance), best is not unwound and _shows(best, Rm)


def _shows(s: Solution, Rm: float) -> bool:
    L, std = s.of(-2)
    return max(SHOWS_STD * std, SHOWS_S * Rm) < L


def _resistance(windows: Sequence[Window], rig: Rig) -> tuple[float, float]:
    """Rm and its standard error from x = D/Km int (V - Rm i) dt, with the readings of i and V besides for what is late."""

    def law(windows: Sequence[Window]) -> Solution:
        rows, y = [], []
        for w in windows:
            V, i = w.z[:, 0], w.z[:, 1]
            G = w.where_seen(np.column_stack([integral(w.t, V), integral(w.t, i), i, V]))
            free = np.ones((len(G), 1))
            rows.append(without(G, free))
            y.append(without(w.positions[1][:, None] / rig.model["D"], free)[:, 0])
        s = solve(rows, y, len(windows))
        per_volt, per_amp = s.x[:2]
        Rm = -per_amp / per_volt
        slope = np.array([-Rm / per_volt, -1.0 / per_volt])
        return s._replace(x=np.array([Rm]), covariance=np.array([[slope @ s.covariance[:2, :2] @ slope]]))

    return with_samples_between(law(windows), law, windows).of(_RM)


def _torque_constant(
    windows: Sequence[Window], rig: Rig, Rm: float, L: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Km from int (V - Rm i - L di/dt) dt = Km/D (x - x0), mixed with the maker's Km and D, and by how much the position is late
    [s]; each with its standard error.
    """
    model = rig.model
    rows, y = [], []
    for w in windows:
        emf = w.z[:, 0] - Rm * w.z[:, 1]
        G = w.where_seen(np.column_stack([integral(w.t, emf) - L * w.z[:, 1], -emf]))
        free = np.ones((len(G), 1))
        rows.append(without(G, free))
        y.append(without(w.positions[1][:, None] / model["D"], free)[:, 0])
    s = solve(rows, y, len(windows))
    Km = 1.0 / float(s.x[0])
    late, late_std = s.of(1)
    std = float(np.hypot(np.sqrt(s.covariance[0, 0]) * Km**2, of_maker(rig, "D") * Km))
    maker = of_maker(rig, "Km") * model["Km"]
    weight = maker**2 / (std**2 + maker**2)
    mixed = weight * Km + (1.0 - weight) * model["Km"], std * float(np.sqrt(weight))
    return mixed, (late * Km, late_std * Km)


def _slopes(function: Callable[[Array], Array], at: Array, step: Array) -> Array:
    """Jacobian by central differences of `step`."""
    moved = [np.diag(step)[k] for k in range(at.size)]
    return np.column_stack(
        [(function(at + m) - function(at - m)) / (2.0 * h) for m, h in zip(moved, step, strict=True)]
    )
