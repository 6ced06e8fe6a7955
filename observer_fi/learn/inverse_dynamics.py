"""Inverse-dynamics identification of a rig that is driven by a commanded force.

No current is measured, so the log says which force was asked for and where the mass went. Differentiating the position
gives, at every sample, the force that the equations of `actuator.py` call for,

    F(t - T) = (J dw/dt + torque(s, w, x, phi, theta)) / D,     w = v / D,  phi = x / D,  s = sgn v,

which is linear in the sizes of all effects: least squares after both sides went through the same low-pass and were
decimated to the band of interest (Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019, and their
Script_IDIM_LS.m). Shapes (a delay T, a width) are found by Gauss-Newton around it.

Units: force N at the mass; parameters as in `actuator.py` (N m, kg m^2, rad at the motor); m samples after decimation.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second

from observer_fi.errors import UsageError
from observer_fi.learn.inverse_columns import FORMS, SHAPES, TERMS, Columns, Sharing, Term
from observer_fi.learn.inverse_motion import InverseSettings, Motion, prepare_motion
from observer_fi.physics import PARAMETERS, Rig, with_values
from observer_fi.records import Array, Fit, Log, Parameter

LAGS = 100  # decimated samples, 1 s: a stroke of the rig, beyond which residuals repeat rather than correlate


@dataclass(frozen=True)
class Structure:
    """The terms of a model, the values of its shapes, which of them are fitted, and within which limits."""

    terms: tuple[Term, ...]
    shapes: dict[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)


class Coefficient(NamedTuple):
    """One column of the design: its term, and the log it belongs to (None: all of them)."""

    term: Term
    log: str | None


@dataclass(frozen=True)
class Solution:
    """A fitted structure.

    logs: names of those it was fitted to. theta (k,): coefficients. jacobian (N, k + number of free shapes).
    residual, force (N,) N. part (N,): number of the part that each sample is held out with.
    """

    structure: Structure
    logs: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]
    theta: Array
    jacobian: Array
    residual: Array
    force: Array
    part: Array

    @property
    def rss(self) -> float:
        """Sum of squared residuals [N^2]."""
        return float(self.residual @ self.residual)

    @property
    def covariance(self) -> Array:
        """(k + f, k + f) of coefficients and free shapes, from the linearised model and the correlation of the residual.

        Where the parts of the logs disagree more than that (jackknife), the standard error is theirs.
        """
        scale = np.linalg.norm(self.jacobian, axis=0)
        scale[scale == 0.0] = 1.0
        J = self.jacobian / scale
        inverse = np.linalg.pinv(J.T @ J)
        spread = J.T @ correlated(J, self.residual)
        C = inverse @ spread @ inverse * self.rss / self.residual.size
        wider = np.maximum(
            _jackknife(J, self.residual, self.part) / np.sqrt(np.maximum(np.diag(C), 1e-300)), 1.0
        )
        return C * np.outer(wider / scale, wider / scale)

    @property
    def relative(self) -> float:
        """Residual relative to the force [per cent]."""
        return relative(self.residual, self.force)


def relative(residual: Array, force: Array) -> float:
    """100 |residual| / |force|."""
    return 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(force))


def layout(structure: Structure, logs: Sequence[str]) -> tuple[Coefficient, ...]:
    """Which columns the design has for these logs, in order."""
    found: list[Coefficient] = []
    for term in structure.terms:
        if term.sharing is Sharing.COMMON:
            found.append(Coefficient(term, None))
        else:
            found += [Coefficient(term, log) for log in logs[term.sharing is Sharing.CONTRAST :]]
    return tuple(found)


def weight(coefficient: Coefficient, log: str, first: str) -> float:
    """With which factor a column of a log enters: deviations of the first log are minus the sum of the others'."""
    if coefficient.log is None or coefficient.log == log:
        return 1.0
    return -1.0 if coefficient.term.sharing is Sharing.CONTRAST and log == first else 0.0


def design(
    columns: Columns,
    motion: Motion,
    shapes: dict[str, float],
    coefficients: Sequence[Coefficient],
    first: str,
) -> Array:
    """(m, k) of one log."""
    X = np.zeros((motion.t.size, len(coefficients)))
    for k, c in enumerate(coefficients):
        share = weight(c, motion.name, first)
        if share:
            X[:, k] = share * columns.term(motion, c.term, shapes)
    return X


def _system(
    columns: Columns, motions: Sequence[Motion], shapes: dict[str, float], coefficients: Sequence[Coefficient]
) -> tuple[Array, Array]:
    first = motions[0].name
    X = np.concatenate([design(columns, m, shapes, coefficients, first)[m.use] for m in motions])
    y = np.concatenate([columns.force(m, shapes)[m.use] for m in motions])
    return X, y


def least_squares(X: Array, y: Array) -> Array:
    """Least squares with columns scaled to one length; what cannot be told apart shares the effect."""
    scale = np.linalg.norm(X, axis=0)
    scale[scale == 0.0] = 1.0
    return np.linalg.lstsq(X / scale, y, rcond=1e-10)[0] / scale


def parts(motions: Sequence[Motion]) -> Array:
    """(N,) number of the part of each fitted sample: blocks of about `block_s`, at least two a log."""
    found, offset = [], 0.0
    for m in motions:
        t = m.t[m.use]
        count = max(round((t[-1] - t[0]) / m.block_s), 2)
        found.append(offset + np.minimum(np.floor((t - t[0]) / (t[-1] - t[0]) * count), count - 1))
        offset += count
    return np.concatenate(found)


def _without(J: Array, residual: Array, part: Array) -> list[Array]:
    """By part: how much the parameters move if it is left out, to first order."""
    return [np.linalg.lstsq(J[part != k], residual[part != k], rcond=1e-10)[0] for k in np.unique(part)]


def _jackknife(J: Array, residual: Array, part: Array) -> Array:
    """(k,) standard errors from the spread of the estimates without each part."""
    moves = np.array(_without(J, residual, part))
    count = moves.shape[0]
    return np.sqrt((count - 1) / count * np.sum((moves - moves.mean(axis=0)) ** 2, axis=0))


def held_out(solution: Solution) -> Array:
    """(N,) residuals of each part under the parameters fitted without it, shapes included, to first order."""
    J = solution.jacobian / np.maximum(np.linalg.norm(solution.jacobian, axis=0), 1e-300)
    seen = solution.residual.copy()
    for k, move in zip(np.unique(solution.part), _without(J, solution.residual, solution.part), strict=True):
        out = solution.part == k
        seen[out] -= J[out] @ move
    return seen


def correlated(columns: Array, residual: Array) -> Array:
    """(N, k) columns times the correlation matrix of the residual, tapered to zero over `LAGS` samples (Bartlett).

    c' R c / c' c says by which factor the variance of the size of a column c exceeds that of white residuals.
    """
    r = residual - residual.mean()
    lags = min(LAGS, r.size - 1)
    full = scipy.signal.fftconvolve(r, r[::-1])[r.size - 1 - lags : r.size + lags] / float(r @ r)
    kernel = full * (1.0 - np.abs(np.arange(-lags, lags + 1)) / (lags + 1))
    return scipy.signal.fftconvolve(columns, kernel[:, None], mode="full", axes=0)[
        lags : lags + columns.shape[0]
    ]


def solve(
    columns: Columns, motions: Sequence[Motion], structure: Structure, iterations: int = 12
) -> Solution:
    """Coefficients by least squares, free shapes by Gauss-Newton with step halving around it."""
    coefficients = layout(structure, [m.name for m in motions])

    def at(shapes: dict[str, float]) -> tuple[Array, Array, Array]:
        X, y = _system(columns, motions, shapes, coefficients)
        theta = least_squares(X, y)
        return X, theta, y - X @ theta

    shapes = dict(structure.shapes)
    X, theta, r = at(shapes)
    for _ in range(iterations if structure.free else 0):
        J = np.column_stack(
            [X, *_shape_columns(columns, motions, coefficients, shapes, structure.free, theta)]
        )
        step = least_squares(J, r)[X.shape[1] :]
        before = float(r @ r)
        for halving in range(6):
            trial = _moved(shapes, structure.free, 0.5**halving * step, structure.limits)
            new = at(trial)
            if float(new[2] @ new[2]) < before:
                shapes, (X, theta, r) = trial, new
                break
        if float(r @ r) > before * (1.0 - 1e-5):
            break
    J = np.column_stack([X, *_shape_columns(columns, motions, coefficients, shapes, structure.free, theta)])
    found = replace(structure, shapes=shapes)
    return Solution(
        found, tuple(m.name for m in motions), coefficients, theta, J, r, r + X @ theta, parts(motions)
    )


def _moved(
    shapes: dict[str, float], free: Iterable[str], step: Array, limits: dict[str, tuple[float, float]]
) -> dict[str, float]:
    """Shapes after a step, in units of each shape's search, kept within a factor of 2 and within their limits."""
    moved = dict(shapes)
    for name, d in zip(free, step, strict=True):
        shape = SHAPES[name]
        value = moved[name] * math.exp(min(max(d, -0.7), 0.7)) if shape.relative else moved[name] + d
        low, high = limits.get(name, (shape.low, shape.high))
        moved[name] = float(min(max(value, low), high))
    return moved


def _shape_columns(
    columns: Columns,
    motions: Sequence[Motion],
    coefficients: Sequence[Coefficient],
    shapes: dict[str, float],
    free: Iterable[str],
    theta: Array,
) -> list[Array]:
    """How the modelled force changes with each free shape: central differences, one-sided at zero."""
    found = []
    for name in free:
        shape = SHAPES[name]
        parts = []
        for sign in (1.0, -1.0):
            moved = _moved(shapes, [name], np.array([sign * shape.step]), {})
            X, y = _system(columns, motions, moved, coefficients)
            parts.append((X @ theta - y, moved[name]))
        above, below = parts[0][1], parts[1][1]
        width = math.log(above / below) if shape.relative else above - below
        found.append((parts[0][0] - parts[1][0]) / width)
    return found


def residual_on(columns: Columns, motion: Motion, solution: Solution) -> tuple[Array, Array]:
    """Residual and force (m,) N of a motion under frozen parameters.

    Of a log that the fit never saw the friction level is the mean of those it saw, and ripple is left out: its phase
    is unknown.
    """
    X = design(columns, motion, solution.structure.shapes, solution.coefficients, solution.logs[0])
    y = columns.force(motion, solution.structure.shapes)
    return y - X @ solution.theta, y


# --- rigs -----------------------------------------------------------------------------------------


def check_force_rig(rig: Rig) -> None:
    """Raises UsageError unless the rig is driven by force."""
    if rig.driven.motor:
        raise UsageError(f'rig {rig.name!r} is driven by {rig.drive}; inverse dynamics needs drive = "force"')


def structure_of(rig: Rig, motions: Sequence[Motion]) -> Structure:
    """The terms that a rig file speaks of: inertia and Coulomb friction, and every effect it gives a size.

    A shape is fitted where its value was (it has a standard error); a known one, such as the hold of a controller,
    stays. With two logs or more each has its own friction level.
    """
    model = rig.model
    terms = [TERMS["J"], TERMS["A"]]
    if any(np.ptp(m.theta) > 0.0 for m in motions) and model["B"] != 0.0:
        terms.append(TERMS["B"])
    for name, term in TERMS.items():
        size = sum(share * model[parameter] for parameter, share in term.moves)
        if name not in ("J", "A", "B", "level") and size != 0.0:
            terms.append(term)
    if len(motions) > 1:
        terms.append(TERMS["level"])
    shapes = {name: model[name] for name in (*SHAPES, *FORMS) if name in rig.quantities}
    free = tuple(name for name in shapes if name in SHAPES and rig.quantities[name].std is not None)
    return Structure(tuple(terms), shapes, free)


def parameters_of(solution: Solution) -> dict[str, tuple[float, float]]:
    """Parameters of the equations, value and standard error: common ones as they are, per-log ones as the first log's."""
    first = next(
        (c.log for c in solution.coefficients if c.log is not None and c.term.sharing is Sharing.EACH), None
    )
    rows: dict[str, Array] = {}
    size = solution.jacobian.shape[1]
    for k, c in enumerate(solution.coefficients):
        if c.term.sharing is Sharing.CONTRAST or (c.term.sharing is Sharing.EACH and c.log != first):
            continue
        for parameter, share in c.term.moves:
            rows.setdefault(parameter, np.zeros(size))[k] += share
    values = {name: float(row[: solution.theta.size] @ solution.theta) for name, row in rows.items()}
    for k, name in enumerate(solution.structure.free):
        value = solution.structure.shapes[name]
        rows[name] = np.zeros(size)
        rows[name][solution.theta.size + k] = value if SHAPES[name].relative else 1.0
        values[name] = value
    C = solution.covariance
    return {name: (values[name], math.sqrt(max(float(row @ C @ row), 0.0))) for name, row in rows.items()}


def extended_rig(rig: Rig, solution: Solution, name: str, source: str = "") -> Rig:
    """The rig with what was found: values with standard errors, and the shapes of its forms."""
    found = parameters_of(solution)
    forms = {k: v for k, v in solution.structure.shapes.items() if k not in found and v != rig.model[k]}
    values = {k: v for k, (v, _) in found.items()}
    std = {k: s for k, (_, s) in found.items()}
    changed = with_values(with_values(rig, forms, method="form"), values, std, method="inverse dynamics")
    quantities = {k: replace(q, source="") if k in values else q for k, q in changed.quantities.items()}
    return replace(changed, name=name, source=source or rig.source, quantities=quantities)


def identify_force(logs: Sequence[Log], rig: Rig, settings: InverseSettings | None = None) -> Fit:
    """The parameters that the rig file gives, learned from logs of a rig driven by force.

    rmse: force_n [N] in the fitted band; nll_per_sample: Gaussian, per decimated sample [nats].
    """
    check_force_rig(rig)
    motions = [prepare_motion(log, settings) for log in logs]
    columns = Columns(rig)
    solution = solve(columns, motions, structure_of(rig, motions))
    found = parameters_of(solution)
    hopeless = unseen(solution)
    sigma = math.sqrt(solution.rss / solution.residual.size)
    parameters = tuple(
        Parameter(n, v, s, rig.model[n], PARAMETERS[n][0], v - 1.96 * s, v + 1.96 * s)
        for n, (v, s) in found.items()
        if n not in hopeless
    )
    return Fit(
        parameters,
        _correlation(solution, [p.name for p in parameters]),
        hopeless | _never_from_force(),
        0.5 * math.log(2 * math.pi * sigma**2) + 0.5,
        {"force_n": sigma},
        {"force": {"t": np.concatenate([m.t[m.use] for m in motions]), "measured": solution.force,
                   "predicted": solution.force - solution.residual}},
    )  # fmt: skip


def unseen(solution: Solution) -> dict[str, str]:
    """Parameters whose column is zero, or nearly a sum of the others, with what to record."""
    J = solution.jacobian / np.maximum(np.linalg.norm(solution.jacobian, axis=0), 1e-300)
    found = {}
    for k, c in enumerate(solution.coefficients):
        others = np.delete(J, k, axis=1)
        left = J[:, k] - others @ np.linalg.lstsq(others, J[:, k], rcond=1e-10)[0]
        if np.linalg.norm(left) < 1e-4:
            for parameter, _ in c.term.moves:
                found[parameter] = "record moves in both directions, at four speeds, over the whole travel"
    return found


def _never_from_force() -> dict[str, str]:
    return {
        "position_gain": "a wrong scale of position changes every value in proportion: use a gauge block",
    }


def _correlation(solution: Solution, names: Sequence[str]) -> Array:
    """(k, k) of the common parameters, from the covariance of their coefficients."""
    size = solution.jacobian.shape[1]
    rows = np.zeros((len(names), size))
    first = next(
        (c.log for c in solution.coefficients if c.log is not None and c.term.sharing is Sharing.EACH), None
    )
    for k, c in enumerate(solution.coefficients):
        for parameter, share in c.term.moves:
            common = c.term.sharing is Sharing.COMMON or (c.term.sharing is Sharing.EACH and c.log == first)
            if parameter in names and common:
                rows[names.index(parameter), k] += share
    for k, name in enumerate(solution.structure.free):
        if name in names:
            rows[names.index(name), solution.theta.size + k] = 1.0
    C = rows @ solution.covariance @ rows.T
    d = np.sqrt(np.maximum(np.diag(C), 1e-300))
    return C / np.outer(d, d)
