"""What the simulation gets wrong: its name, the extended model, and what it gains on moves never fitted."""

from observer_fi.improve.diagnosis_gain import DiagnosisGain, diagnosis_gain, measure_diagnosis_gain
from observer_fi.improve.force.calculated_force import CalculatedForce, calculated_force
from observer_fi.improve.freed.freed_equations import CLOSE_ALIKE, CLOSE_SHARE, LOOKS_LIKE, WANTED_NATS
from observer_fi.improve.freed.smoothed_disturbance import (
    DRAWN,
    BinnedDisturbance,
    SmoothedDisturbance,
    free_equations,
)
from observer_fi.improve.improvement import (
    FoundCause,
    Improvement,
    Value,
    findings_of,
    improve,
    improvement_of,
    refitted,
    to_json,
)
from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.rig_refit import base_parameters
from observer_fi.improve.moves.screening import coverage_of, free_of, start_values
from observer_fi.improve.moves.simulated_moves import MOST_ROWS
from observer_fi.improve.residual_tables import Residuals
from observer_fi.improve.steps import Ladder, Smooth

__all__ = [
    "BinnedDisturbance",
    "CLOSE_ALIKE",
    "CLOSE_SHARE",
    "CalculatedForce",
    "DRAWN",
    "FoundCause",
    "Improvement",
    "LOOKS_LIKE",
    "MOST_ROWS",
    "SmoothedDisturbance",
    "Ladder",
    "Residuals",
    "Smooth",
    "Value",
    "WANTED_NATS",
    "DiagnosisGain",
    "base_parameters",
    "calculated_force",
    "coverage_of",
    "diagnosis_gain",
    "findings_of",
    "free_equations",
    "free_of",
    "improve",
    "improvement_of",
    "name_causes",
    "refitted",
    "start_values",
    "to_json",
    "measure_diagnosis_gain",
]
