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
_RM, _PER_J = 0, 1  # of a solution of the circuit
_L, _LATE, _DROP = -3, -2, -1  # of one whose winding is told
LARGEST_DROP = 0.2  # of the largest voltage, that brushes or a converter may take
LIKELIER = 3.0  # nats by which a drop must be, than a winding without one
DROP = ("brush_drop", "brush_current")
TINY = 1e-30  # squares of steps, at least
KNEES = (0.01, 0.03, 0.1)  # of the current, within which a drop changes its sign
KNEE_RANGE, KNEE_STD = (0.003, 0.5), 0.2  # of the current, and of a knee, as it is known then


class FromVoltage(NamedTuple):
    """What voltage, current and position tell. values, covariance: of `names`; sigma: of n residuals of the circuit [V].

    current_late, position_late: against the voltage [s], each with its standard error. inductance [H]: with its standard error,
    where there is one beyond doubt if the current is not late, which is less likely, and a start shows it. drops: whether a
    drop that changes its sign with the current is likelier than none; it is then among the `names`, with its knee.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    sigma: float
    n: int
    current_late: tuple[float, float]
    position_late: tuple[float, float]
    inductance: tuple[float, float] | None
    drops: bool


class _Winding(NamedTuple):
    """A circuit whose winding is told, and whether there are an inductance and a drop in it. Its last coefficients are the
    inductance [H], by how much the current is late [s], and the drop [V].
    """

    solution: Solution
    wound: bool
    drops: bool

    @property
    def shows_drop(self) -> bool:
        """Whether there is a drop beyond doubt."""
        drop, std = self.solution.of(_DROP)
        return drop > SHOWS_STD * std


def from_voltage(
    windows: Sequence[Window],
    rig: Rig,
    names: tuple[str, ...],
    at_rest: tuple[float, float] | None = None,
    drop: float = 0.0,
    coarse: bool = False,
) -> FromVoltage:
    """Rm and Km, and what `names` says of the mechanics, J first; maker's data enter as priors. at_rest: Rm as rests tell it, and
    its standard error [ohm]. drop: that is known to be there [V]. coarse: whether readings come in steps, which look like any of
    an inductance, a channel that is late, and a drop: none is told then.
    """
    knee = _knee_in_circuit(windows, names, drop) if drop else _knee(windows, rig)

    def law(windows: Sequence[Window], plain: bool = True) -> Solution:
        return circuit(windows, names, drop, knee, plain)

    s = with_samples_between(law(windows, False), law, windows)
    s, wound, drops = _with_winding(windows, rig, s, at_rest, knee, drop > 0.0, coarse)
    L, left = float(s.x[_L]), float(s.x[_DROP])
    (_, Km_std), position_late = _torque_constant(windows, rig, float(s.x[_RM]), L, left, knee)

    def values(coefficients: Array) -> Array:
        Rm, *loads, L, _, drop, more = coefficients.tolist()
        (Km, _), (late, _) = _torque_constant(windows, rig, Rm, L, drop, knee)
        Km += more
        found = np.concatenate(([Rm, Km, Km**2 / loads[0]], np.array(loads[1:]) * Km / loads[0]))
        return np.append(found, (drop, knee, late) if drops else late)

    with_Km = s.beside(0.0, Km_std)
    at, covariance = with_Km.x, with_Km.covariance
    slope = _slopes(values, at, STEP * np.sqrt(np.maximum(np.diag(covariance), TINY)))
    known = slope @ covariance @ slope.T
    known[-2, -2] += drops * (KNEE_STD * knee) ** 2
    position_late = position_late[0], float(np.hypot(position_late[1], np.sqrt(known[-1, -1])))
    return FromVoltage(
        ("Rm", "Km", *names, *(DROP if drops else ())), values(at)[:-1], known[:-1, :-1], s.sigma, s.n, s.of(_LATE),
        position_late, s.of(_L) if wound else None, drops,
    )  # fmt: skip


def circuit(
    windows: Sequence[Window], names: Sequence[str], drop: float = 0.0, knee: float = 1.0, plain: bool = False
) -> Solution:
    """Coefficients of V less a drop [V] that changes its sign with the current within a knee [A]: of i, of int i, of each load,
    of di/dt.

    The noise of i makes that of i too small in plain least squares, by half where the motion is smooth; each reading has its
    neighbours for an instrument, and each rate those beyond them.
    """
    rows, y, instruments = [], [], []
    for w in windows:
        V, i, free = w.z[:, 0], w.z[:, 1], np.ones((w.t.size, 1))
        loads = [integral(w.t, i), *load_integrals(w, names[1:])]
        rows.append(without(np.column_stack([i, *loads, change_rate(w.t, i, 1)]), free))
        y.append(without((V - drop * np.tanh(i / knee))[:, None], free)[:, 0])
        beside = (
            [i, *loads, change_rate(w.t, i, 1)] if plain else [neighbours(i), *loads, change_rate(w.t, i, 2)]
        )
        instruments.append(without(np.column_stack(beside), free))
    return solve(rows, y, len(windows), instruments)


def with_samples_between(
    s: Solution,
    law: Callable[[Sequence[Window]], Solution],
    windows: Sequence[Window],
    together: bool = False,
) -> Solution:
    """A solution, Rm first, whose covariance holds what integrals between samples leave of a law, and of Rm `WINDING` besides.

    together: whether that is off as a whole, as coefficients are of which only a sum is sure.
    """
    covariance, fine = s.covariance.copy(), law(windows).x
    covariance[_RM, _RM] += (WINDING * s.x[_RM]) ** 2
    for first in (0, 1):
        half = [w.every_second(first) for w in windows]
        off = _HALF * (law(half).x - fine)
        covariance += np.outer(off, off) if together else np.diag(off**2)
    return s._replace(covariance=covariance)


def _with_winding(
    windows: Sequence[Window],
    rig: Rig,
    s: Solution,
    at_rest: tuple[float, float] | None,
    knee: float,
    with_drop: bool,
    coarse: bool,
) -> _Winding:
    """The circuit with Rm in place of the coefficient of i, L in that of di/dt, a current that is late, and a drop.

    What equation 8, the maker and a winding that may be warmer say of Rm counts; what rests say, where no drop is likely and
    motion says nothing else.
    """
    Rm, late = rig.model["Rm"], SKEW * interval_of(windows)
    wide = LARGEST_DROP * max(float(np.abs(w.z[:, 0]).max()) for w in windows)
    s = _of_late_and_drop(s, late, wide).knowing(
        _RM, Rm, Rm * float(np.hypot(rig.spread("Rm") or 0.0, WARMER))
    )
    without = s.knowing(_DROP, 0.0, WINDING * wide).knowing(_RM, *_resistance(windows, rig, None).of(_RM))
    if coarse:
        plain = without.knowing(_L, 0.0, 0.5 * SHOWS_S * Rm).knowing(_LATE, 0.0, _IN_TIME * late)
        return _Winding(plain, False, False)
    if at_rest and abs(at_rest[0] - without.x[_RM]) < _ELSE * np.hypot(at_rest[1], without.of(_RM)[1]):
        without = without.knowing(_RM, at_rest[0], float(np.hypot(at_rest[1], WINDING * Rm)))
    loss = _resistance(windows, rig, knee)
    s = s.knowing_all([_RM, _DROP], loss.x, loss.covariance)
    kinds = [(True, s, _nats_of_drop(s, wide)[1])]
    kinds += [] if with_drop else [(False, without, _nats_of_drop(s, wide)[0])]
    found = _likeliest([
        (more + of_way, _Winding(one, wound, drops))
        for drops, base, more in kinds
        for of_way, one, wound in _wound_or_late(base, Rm, late)
    ])  # fmt: skip
    return found._replace(wound=found.wound and _shows(found.solution, Rm))


def _of_late_and_drop(s: Solution, late: float, wide: float) -> Solution:
    """A circuit whose coefficients are those of a current that may be late [s], and with a drop [V]: standard deviations."""
    of_i, per_J = float(s.x[_RM]), float(s.x[_PER_J])
    s = s.beside(0.0, late).beside(0.0, wide)
    T = np.eye(s.x.size)
    T[_RM, _LATE], T[_L, _LATE] = -per_J, -of_i
    return s._replace(covariance=T @ s.covariance @ T.T)


def _nats_of_drop(s: Solution, wide: float) -> tuple[float, float]:
    """How likely no drop is, and one [nats], of a circuit in which it is free. wide: standard deviation of one before [V]."""
    (drop, std), log_density = s.of(_DROP), scipy.stats.norm.logpdf
    none = log_density(0.0, drop, np.hypot(std, WINDING * wide)) - log_density(0.0, 0.0, wide)
    return float(none), float(np.log(2.0) + scipy.stats.norm.logcdf(drop / std))


def _likeliest(ways: Sequence[tuple[float, _Winding]]) -> _Winding:
    """The likeliest of several windings [nats], whose covariance holds what the others say, as likely as they are.

    A drop is one of them where nothing simpler is about as likely, and is told where it shows for all that the others say.
    """
    most = max(nats for nats, _ in ways)
    simple = any(nats > most - LIKELIER and not one.drops and not one.wound for nats, one in ways)
    ways = [(nats, one) for nats, one in ways if not (simple and one.drops)]
    best = max(ways, key=lambda way: way[0])[1]
    found = best._replace(solution=_mixed(best.solution, ways))
    others = [way for way in ways if not way[1].drops]
    if found.shows_drop or not best.drops or not others:
        return found
    best = max(others, key=lambda way: way[0])[1]
    return best._replace(solution=_mixed(best.solution, ways))


def _mixed(best: Solution, ways: Sequence[tuple[float, _Winding]]) -> Solution:
    """A solution with the covariance of all, as likely as they are, around it."""
    share = scipy.special.softmax([nats for nats, _ in ways])
    parts = [
        p * (one.solution.covariance + np.outer(one.solution.x - best.x, one.solution.x - best.x))
        for p, (_, one) in zip(share, ways, strict=True)
    ]
    return best._replace(covariance=np.sum(parts, axis=0))


def _wound_or_late(s: Solution, Rm: float, skew: float) -> list[tuple[float, Solution, bool]]:
    """A circuit without an inductance, one whose current is in time, and one with both, how likely each is [nats], and whether it
    has an inductance; the last one alone where both are beyond doubt.

    skew: standard deviation of the time by which channels are late that nobody has timed [s].
    """
    (L, L_std), (late, late_std) = s.of(_L), s.of(_LATE)
    little = 0.5 * SHOWS_S * Rm
    unwound, in_time = s.knowing(_L, 0.0, little), s.knowing(_LATE, 0.0, _IN_TIME * skew)
    log_density, log_share = scipy.stats.norm.logpdf, scipy.stats.norm.logcdf
    there = [log_share(np.divide(*one.of(_L))) - np.log(LARGEST_S * Rm) for one in (in_time, s)]
    both = (there[1], s, True)
    if abs(L) > SHOWS_STD * L_std and abs(late) > SHOWS_STD * late_std:
        return [both]
    timed = log_density(0.0, late, late_std) - log_density(0.0, 0.0, skew)
    return [
        (log_density(0.0, L, np.hypot(L_std, little)), unwound, False),
        (timed + there[0], in_time, True),
        both,
    ]


def _shows(s: Solution, Rm: float) -> bool:
    L, std = s.of(_L)
    return max(SHOWS_STD * std, SHOWS_S * Rm) < L


def _knee(windows: Sequence[Window], rig: Rig) -> float:
    """The current within which a drop changes its sign, as equation 8 fits best [A]."""
    usual = _usual_current(windows)
    return min((share * usual for share in KNEES), key=lambda knee: _losses(windows, rig, knee).sigma)


def _usual_current(windows: Sequence[Window]) -> float:
    """Root mean square of the current in motion [A]."""
    return float(np.sqrt(np.mean(np.concatenate([w.z[:, 1] for w in windows]) ** 2)))


def _knee_in_circuit(windows: Sequence[Window], names: Sequence[str], drop: float) -> float:
    """The same of a drop that is known [V], as the circuit fits best, whose voltage is read with less noise than an angle has."""
    usual = _usual_current(windows)

    def left(log_share: float) -> float:
        return circuit(windows, names, drop, usual * float(np.exp(log_share)), plain=True).sigma

    low, high = (float(np.log(share)) for share in KNEE_RANGE)
    found = scipy.optimize.minimize_scalar(
        left, bounds=(low, high), method="bounded", options={"xatol": 0.02}
    )
    return usual * float(np.exp(found.x))


def _losses(windows: Sequence[Window], rig: Rig, knee: float | None) -> Solution:
    """Coefficients of x/D: of int V, of int i, of the integral of the current's sign where it has a knee, of i and of V."""
    rows, y = [], []
    for w in windows:
        V, i = w.z[:, 0], w.z[:, 1]
        lost = [integral(w.t, V), integral(w.t, i)]
        lost += [integral(w.t, np.tanh(i / knee))] if knee else []
        G = w.where_seen(np.column_stack([*lost, i, V]))
        free = np.ones((len(G), 1))
        rows.append(without(G, free))
        y.append(without(w.positions[1][:, None] / rig.model["D"], free)[:, 0])
    return solve(rows, y, len(windows))


def _resistance(windows: Sequence[Window], rig: Rig, knee: float | None) -> Solution:
    """Rm, and the drop where it has a knee, from x = D/Km int (V - Rm i - U tanh(i/knee)) dt, with the readings of i and V for
    what is late.
    """
    k = 2 if knee else 1

    def law(windows: Sequence[Window]) -> Solution:
        s = _losses(windows, rig, knee)
        if knee:  # a drop of a steady motion is a torque constant that is larger
            per_Km = 1.0 / rig.model["Km"]
            s = s.knowing(0, per_Km, of_maker(rig, "Km") * per_Km)
        found = -s.x[1 : k + 1] / s.x[0]
        slope = np.column_stack([found, np.eye(k)]) / -s.x[0]
        return s._replace(x=found, covariance=slope @ s.covariance[: k + 1, : k + 1] @ slope.T)

    return with_samples_between(law(windows), law, windows, together=True)


def _torque_constant(
    windows: Sequence[Window], rig: Rig, Rm: float, L: float, drop: float, knee: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Km from int (V - Rm i - L di/dt - U tanh(i/knee)) dt = Km/D (x - x0), mixed with the maker's Km and D, and by how much the
    position is late [s]; each with its standard error.
    """
    model = rig.model
    rows, y = [], []
    for w in windows:
        V, i = w.z[:, 0], w.z[:, 1]
        emf = V - Rm * i - drop * np.tanh(i / knee)
        G = w.where_seen(np.column_stack([integral(w.t, emf) - L * i, -emf]))
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
