"""Estimates to verdicts: isolation, onset, the open-loop mixture beside it, and what they say in words."""

from observer_fi.verdict import comparison, scores
from observer_fi.verdict.comparison import as_dict, compare, open_loop_estimate, scenarios
from observer_fi.verdict.diagnosis import Diagnosis, diagnose, diagnose_log, make_bank
from observer_fi.verdict.drift import or_as_well
from observer_fi.verdict.isolate import SETTLING, EventTracker, Isolator, log_verdict, tested
from observer_fi.verdict.last_word import LastWord
from observer_fi.verdict.logger.as_logged import LEARNABLE, AsLogged
from observer_fi.verdict.logger.begun_at_the_limit import at_the_limit, known_from
from observer_fi.verdict.logger.no_pitch import another_pitch, with_its_pitch
from observer_fi.verdict.onset import Filters
from observer_fi.verdict.testable import FEWEST_MOVING, for_readings, moving_samples
from observer_fi.verdict.wrong_rig import describes

__all__ = [
    "FEWEST_MOVING",
    "LEARNABLE",
    "SETTLING",
    "AsLogged",
    "Diagnosis",
    "EventTracker",
    "Filters",
    "Isolator",
    "LastWord",
    "another_pitch",
    "as_dict",
    "at_the_limit",
    "compare",
    "comparison",
    "describes",
    "diagnose",
    "diagnose_log",
    "for_readings",
    "known_from",
    "log_verdict",
    "make_bank",
    "moving_samples",
    "open_loop_estimate",
    "or_as_well",
    "scenarios",
    "scores",
    "tested",
    "with_its_pitch",
]
