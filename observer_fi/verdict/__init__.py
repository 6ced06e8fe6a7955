"""Estimates to verdicts: isolation, onset, the open-loop mixture beside it, and what they say in words."""

from observer_fi.verdict import comparison, scores
from observer_fi.verdict.comparison import as_dict, compare, open_loop_estimate, scenarios
from observer_fi.verdict.diagnosis import diagnose, diagnose_log, make_bank
from observer_fi.verdict.isolate import Isolator, log_verdict, tested

__all__ = [
    "Isolator",
    "as_dict",
    "compare",
    "comparison",
    "diagnose",
    "diagnose_log",
    "log_verdict",
    "make_bank",
    "open_loop_estimate",
    "scenarios",
    "scores",
    "tested",
]
