"""What no named cause explains, kept as an empirical curve of the rig, if it helps on moves that its fit never saw."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer_fi.improve.moves.misfit import held_out_residuals
from observer_fi.improve.moves.unexplained import regressors
from observer_fi.improve.steps import Smooth
from observer_fi.learn import Experiment, FitResult, Free, fit, run
from observer_fi.numerics import sum_of_squares
from observer_fi.physics import (
    ANGLES,
    FRAME,
    MOST_POINTS,
    Curve,
    curve_of,
    override,
    parameters,
    value_names,
)

# Points that are tried; held-out moves choose among them.
_POINTS = {"pitch": (3, 5, 9), "shaft_angle": (12, 24), "screw_angle": (12, 24)}
_OTHER_POINTS = (8, 16, MOST_POINTS)
_WIDE = 10.0  # prior of a value, in sizes of the curve that the residual asked for
_HELD_OUT = 0.3  # share of the fit's gain that other moves must see, as for a named cause


@dataclass(frozen=True)
class Kept:
    """A curve with its fit. held_out: nats that moves gain from a curve that was fitted without them."""

    fitted: FitResult
    curve: Curve
    held_out: float


def fit_kept_curve(experiment: Experiment, fitted: FitResult, terms: Sequence[Smooth]) -> Kept | None:
    """The first of the terms that can stand in the equations and helps, as a curve fitted with everything else."""
    for term in terms:
        if not term.can_be_kept:
            continue
        before = sum_of_squares(held_out_residuals(experiment, fitted))
        tried = [_with_curve(experiment, fitted, frame) for frame in _frames(experiment, fitted, term)]
        after = [sum_of_squares(held_out_residuals(experiment, result)) for result in tried]
        best = int(np.argmin(after))
        gain = 0.5 * (before - after[best])
        if gain > _HELD_OUT * (fitted.objective - tried[best].objective) > 0.0:
            return Kept(tried[best], _curve(tried[best]), gain)
    return None


def _frames(experiment: Experiment, fitted: FitResult, term: Smooth) -> list[tuple[Curve, float]]:
    """Curves without values yet, of several numbers of points, and the size of what the residual asked for."""
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    low, high = np.quantile(
        regressors(experiment, states, fitted.model["screw_lead"])[term.regressor], (0.002, 0.998)
    )
    size = max(float(np.sqrt(np.mean(term.curve**2))), float(np.max(term.band)))
    frames = []
    for count in _POINTS.get(term.regressor, _OTHER_POINTS):
        first, step = (
            (0.0, 2.0 * math.pi / count) if term.regressor in ANGLES else (low, (high - low) / (count - 1))
        )
        empty = Curve(term.equation, term.regressor, term.directed, float(first), float(step), (0.0,) * count)
        frames.append((empty, size))
    return frames


def _with_curve(experiment: Experiment, fitted: FitResult, frame: tuple[Curve, float]) -> FitResult:
    empty, size = frame
    model = override(fitted.model, fitted.model.name, **parameters(empty))
    values = tuple(Free(name, 0.3 * size, prior_std=_WIDE * size) for name in empty.names)
    return fit(experiment, model, (*fitted.free, *values), fitted.nuisance)


def _curve(fitted: FitResult) -> Curve:
    values = {name: fitted.model[name] for name in (*FRAME, *value_names(MOST_POINTS))}
    curve = curve_of(values, fitted.std)
    if curve is None:
        raise ValueError("the fit holds no curve")
    return curve
