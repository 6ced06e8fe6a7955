"""A rig from its logs: section 3 of the paper, likelihoods of whole moves, inverse dynamics."""

from observer_fi.learn.contacts_and_losses import find_stops, stops_of_travel
from observer_fi.learn.gauss_newton import Free, objective, scales
from observer_fi.learn.identification import identified_rig, identify, residuals_by_phase
from observer_fi.learn.inverse_checks import PositionServo, closed_loop, predict, tune
from observer_fi.learn.inverse_columns import TERMS, TIMING, Columns, Sharing, Term
from observer_fi.learn.inverse_dynamics import (
    Solution,
    Structure,
    correlated,
    extended_rig,
    held_out,
    identify_force,
    parameters_of,
    relative,
    residual_on,
    solve,
    structure_of,
)
from observer_fi.learn.inverse_motion import InverseSettings, Motion, prepare_motion
from observer_fi.learn.linear import (
    DISTURBANCES,
    DRAG,
    FRICTION,
    POSITION,
    TORQUE,
    WINDING,
    Disturbance,
    Linear,
    linearised,
)
from observer_fi.learn.move_data import Experiment, prepare, run, select, unwhitened, whitened
from observer_fi.learn.output_error import (
    FitResult,
    fit,
    inflation,
    nll_per_sample,
    nuisance_columns,
    residuals,
    whiteness,
    without_moves,
)
from observer_fi.learn.reversal_doubt import CAUGHT_A
from observer_fi.learn.unknown_servo import with_servo

__all__ = [
    "CAUGHT_A",
    "Columns",
    "DISTURBANCES",
    "DRAG",
    "Disturbance",
    "Experiment",
    "FRICTION",
    "FitResult",
    "Free",
    "InverseSettings",
    "Linear",
    "Motion",
    "POSITION",
    "PositionServo",
    "Sharing",
    "Solution",
    "Structure",
    "TERMS",
    "TIMING",
    "TORQUE",
    "Term",
    "WINDING",
    "closed_loop",
    "correlated",
    "extended_rig",
    "find_stops",
    "fit",
    "held_out",
    "identified_rig",
    "identify",
    "identify_force",
    "inflation",
    "linearised",
    "nll_per_sample",
    "nuisance_columns",
    "objective",
    "parameters_of",
    "predict",
    "prepare",
    "prepare_motion",
    "relative",
    "residual_on",
    "residuals",
    "residuals_by_phase",
    "run",
    "scales",
    "select",
    "solve",
    "stops_of_travel",
    "structure_of",
    "tune",
    "unwhitened",
    "whitened",
    "whiteness",
    "with_servo",
    "without_moves",
]
