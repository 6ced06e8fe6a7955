"""Plan: the next log worth recording, within the limits of a rig."""

from observer_fi.plan.limits import Limits, limits_of
from observer_fi.plan.planning import DECISIVE, Plan, moves_csv, plan_causes, plan_faults, steps, to_json
from observer_fi.plan.rivals import parse

__all__ = [
    "DECISIVE",
    "Limits",
    "Plan",
    "limits_of",
    "moves_csv",
    "parse",
    "plan_causes",
    "plan_faults",
    "steps",
    "to_json",
]
