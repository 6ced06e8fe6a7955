"""What one unit of a parameter adds to the force that a motion calls for: the columns of inverse dynamics.

A column is the difference of two `applied_torque`: the equations stand in `actuator.py` and nowhere else.
"""

import math
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple, TypeVar

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second

from observer_fi.learn.inverse_motion import Motion, low_passed, slope, zero_phase
from observer_fi.numerics import compiled
from observer_fi.physics import CAUSES, FORCE, INDEX, PARAMETERS, Coverage, Rig, applied_torque
from observer_fi.physics import Term as Effect
from observer_fi.records import Array

T = TypeVar("T")


class Sharing(Enum):
    """How the coefficient of a term is shared between logs."""

    COMMON = "one value for all logs"
    EACH = "a value for each log"
    CONTRAST = "how each log departs from their mean"


class Term(NamedTuple):
    """One coefficient. moves: the parameters of the equations, and by how much one unit of it moves each."""

    name: str
    moves: tuple[tuple[str, float], ...]
    sharing: Sharing = Sharing.COMMON


def term_of(effect: Effect) -> Term:
    """The coefficient of an effect's size."""
    moves = ((effect.parameter, 1.0), *effect.with_it)
    name = "".join(
        (effect.parameter, *(f"{'+' if share > 0.0 else '-'}{other}" for other, share in effect.with_it))
    )
    return Term(name, moves, Sharing.EACH if effect.per_log else Sharing.COMMON)


_FORMS = [v for cause in CAUSES.values() for v in cause.variants(Coverage(lead=2.0), FORCE)]

# Of force and clock, not of the motion: how late the force arrives, and how late the position is seen.
TIMING = tuple(dict.fromkeys(t.parameter for v in _FORMS for t in v.sizes if t.unit == "s"))
# Every size that a rig file may give, forms with fewer coefficients first; and how the friction of logs differs.
TERMS: dict[str, Term] = {
    **{name: Term(name, ((name, 1.0),)) for name in ("J", "A", "B")},
    **{t.name: t for v in _FORMS for t in map(term_of, v.sizes) if t.name not in TIMING},
    "level": Term("level", (("A", 1.0),), Sharing.CONTRAST),
}

# Which shapes a column depends on, by the parameter that it is the column of.
_SHAPES_OF = {t.parameter: v.shapes for v in _FORMS for t in v.sizes if v.shapes}
FORMS = tuple(dict.fromkeys(name for v in _FORMS for name, _ in v.fixed))


class Shape(NamedTuple):
    """How a shape is searched: bounds, the step of its differences (relative if `relative`)."""

    low: float
    high: float
    step: float
    relative: bool = False


# Absolute steps are far above rounding and far below what any log resolves: 30 us, 10 um.
SHAPES: dict[str, Shape] = {
    **{name: Shape(0.0, math.inf, 3e-5) for name in TIMING},
    **{
        t.parameter: Shape(0.0, math.inf, 0.05, relative=True)
        if t.low > 0.0
        else Shape(-math.inf, math.inf, 1e-5)
        for v in _FORMS
        for t in v.terms
        if t.shape
    },
}


@compiled
def torque_series(s: Array, w: Array, x: Array, phi: Array, theta: Array, p: Array) -> Array:
    """applied_torque of every sample, (n,) N m."""
    torque = np.empty(w.size)
    for k in range(w.size):
        torque[k] = applied_torque(s[k], w[k], x[k], 0.0, phi[k], theta[k], p)
    return torque


class Columns:
    """Columns of the regression, kept: a search over shapes asks for most of them again and again.

    rig gives D, B and the shapes of forms; reference (inertia J, viscous b) is what small kinematic errors are seen through.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.D = rig.model["D"]
        self.B = rig.model["B"]
        self._forms = {name: rig.model[name] for name in FORMS}
        self.reference = (
            rig.model["J"],
            0.5 * (rig.model["viscous_positive"] + rig.model["viscous_negative"]),
        )
        self._kept: dict[tuple, Any] = {}

    def force(self, motion: Motion, shapes: dict[str, float]) -> Array:
        """(m,) the commanded force as it arrives: late by input_delay, through the lag of the drive [N]."""
        lag, late = shapes.get("current_lag", 0.0), shapes.get("input_delay", 0.0)
        smooth = self._remember(("force", motion.name, motion.clock.size, lag), lambda: _lagged(motion, lag))
        if late == 0.0:
            return smooth[motion.kept]
        spline = self._remember(
            ("spline", motion.name, motion.clock.size, lag),
            lambda: scipy.interpolate.CubicSpline(motion.clock, smooth),
        )
        return np.asarray(spline(motion.t - late))

    def term(self, motion: Motion, term: Term, shapes: dict[str, float]) -> Array:
        """(m,) force for one unit of the term's coefficient [N per unit]."""
        used = {name for parameter, _ in term.moves for name in _SHAPES_OF.get(parameter, ())}
        values = {name: shapes.get(name, self._forms.get(name, 0.0)) for name in used}
        lag = shapes.get("position_lag", 0.0)
        key = (term.moves, motion.name, motion.clock.size, lag, tuple(sorted(values.items())), self.reference)
        return self._remember(key, lambda: low_passed(self._column(motion, term, values, lag), motion))

    def _remember(self, key: tuple, make: Callable[[], T]) -> T:
        if key not in self._kept:
            if len(self._kept) > 4000:
                self._kept.clear()
            self._kept[key] = make()
        found: T = self._kept[key]
        return found

    def _column(self, motion: Motion, term: Term, shapes: dict[str, float], lag: float) -> Array:
        x, v, a = motion.x + lag * motion.v, motion.v + lag * motion.a, motion.a + lag * motion.jerk
        moves = dict(term.moves)
        if "J" in moves:
            return moves["J"] * a / self.D**2
        kinematic = _KINEMATIC.get(term.name)
        if kinematic is not None:
            return self._seen_through(motion, kinematic(motion, self.D, shapes)) / self.D
        w, phi, s = v / self.D, x / self.D, np.sign(v)
        plain = self._vector(shapes, {})
        with_term = self._vector(shapes, moves)
        arrays = (s, w, x, phi, motion.theta)
        return (torque_series(*arrays, with_term) - torque_series(*arrays, plain)) / self.D

    def _vector(self, shapes: dict[str, float], moves: dict[str, float]) -> Array:
        """(VECTOR_SIZE,) neutral plant, but for the shapes and one unit of a term.

        A is large, for the equations clip a negative friction; the difference of two torques does not see it.
        """
        p = np.array([0.0 if neutral is None else neutral for _, neutral in PARAMETERS.values()] + [1.0])
        p[INDEX["D"]], p[INDEX["B"]], p[INDEX["A"]] = self.D, self.B, 1e3
        for name, value in shapes.items():
            p[INDEX[name]] = value
        for name, value in moves.items():
            p[INDEX[name]] += value
        return p

    def _seen_through(self, motion: Motion, dw: Array) -> Array:
        """Torque for a motor speed that differs by dw (n,) rad/s from v / D."""
        J, b = self.reference
        return J * slope(dw, motion.step) + b * dw


def _lagged(motion: Motion, lag: float) -> Array:
    """Force behind a first-order lag (bilinear, so that it adds no delay of its own), low-passed, at the log's rate."""
    force = motion.force
    if lag > 0.0:
        near, far = 2.0 * lag + motion.step, 2.0 * lag - motion.step
        state = np.array([force[0] * (far + motion.step) / near])
        force = scipy.signal.lfilter([motion.step / near] * 2, [1.0, -far / near], force, zi=state)[0]
    if motion.factor == 1:
        return force
    return zero_phase(scipy.signal.cheby1(8, 0.05, 0.8 / motion.factor), force)


def _play(motion: Motion, D: float, shapes: dict[str, float]) -> Array:
    """The motor is half the gap ahead of the mass in the direction of motion."""
    ahead = zero_phase(scipy.signal.butter(4, min(200.0 * motion.step, 0.8)), 0.5 * np.sign(motion.v))
    return slope(ahead, motion.step) / D


def _slipping(motion: Motion, D: float, shapes: dict[str, float]) -> Array:
    """D w (1 - k |torque|) = v, to first order in k."""
    return motion.v / D * np.abs(motion.force * D)


def _scale_error(motion: Motion, D: float, turned: Array) -> Array:
    """The true position is the seen one less the error of the scale."""
    return -slope(turned, motion.step) / D


_KINEMATIC = {
    "backlash": _play,
    "slip_per_torque": _slipping,
    "position_sin": lambda m, D, s: _scale_error(m, D, np.sin(2 * math.pi * m.x / s["position_period"])),
    "position_cos": lambda m, D, s: _scale_error(m, D, np.cos(2 * math.pi * m.x / s["position_period"])),
}
