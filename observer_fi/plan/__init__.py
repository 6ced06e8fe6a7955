"""Plan: the next log worth recording, within the limits of a rig."""

from observer_fi.plan.confirm import judged
from observer_fi.plan.limits import Limits, limits_of
from observer_fi.plan.moves import total_seconds
from observer_fi.plan.planning import DECISIVE, Plan, Profile, plan_causes, plan_constants, plan_faults
from observer_fi.plan.rivals import Rival, asked_by, parse
from observer_fi.plan.separation import with_moves
from observer_fi.plan.written import course, in_lines, moves_csv, steps, to_json

__all__ = [
    "DECISIVE",
    "Limits",
    "Plan",
    "Profile",
    "Rival",
    "asked_by",
    "course",
    "in_lines",
    "judged",
    "limits_of",
    "moves_csv",
    "parse",
    "plan_causes",
    "plan_constants",
    "plan_faults",
    "steps",
    "to_json",
    "total_seconds",
    "with_moves",
]
