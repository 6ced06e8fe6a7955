"""What the simulation gets wrong: its name, the extended model, and what it gains on moves never fitted."""

from observer_fi.improve.diagnosis_gain import Worth, worth
from observer_fi.improve.freed_equations import CLOSE_ALIKE, CLOSE_SHARE, LOOKS_LIKE, WANTED_NATS
from observer_fi.improve.improvement import Improvement, improve, refitted, to_json
from observer_fi.improve.inverse_improvement import extended, findings, inverse_json, inverse_refit, judge
from observer_fi.improve.inverse_ladder import Ladder, name_causes
from observer_fi.improve.inverse_screening import Score
from observer_fi.improve.inverse_vocabulary import Candidate
from observer_fi.improve.residual_tables import Residuals
from observer_fi.improve.smoothed_disturbance import DRAWN, BinnedDisturbance, Latent, free_equations
from observer_fi.improve.unexplained import Smooth

__all__ = [
    "BinnedDisturbance",
    "CLOSE_ALIKE",
    "CLOSE_SHARE",
    "Candidate",
    "DRAWN",
    "Improvement",
    "LOOKS_LIKE",
    "Ladder",
    "Latent",
    "Residuals",
    "Score",
    "Smooth",
    "WANTED_NATS",
    "Worth",
    "extended",
    "findings",
    "free_equations",
    "improve",
    "inverse_json",
    "inverse_refit",
    "judge",
    "name_causes",
    "refitted",
    "to_json",
    "worth",
]
