"""A plan that was made up: its moves are real, what they say is given."""

from observer_fi.physics.rigs import load_rig
from observer_fi.plan.confirm import Confirmed
from observer_fi.plan.limits import limits_of
from observer_fi.plan.moves import family, in_order, standard
from observer_fi.plan.planning import Plan, Profile
from observer_fi.plan.rivals import Rival

RIG = load_rig()


def plan(log_odds: float = 90.1, pitches: tuple[float, ...] = (0.0,), decides: bool = True) -> Plan:
    limits = limits_of(RIG, 10.0, pitches, None, (-1e-3, 1e-3), 1600.0)
    blocks = family(limits)
    several = in_order((blocks[0], blocks[0], blocks[-1]), limits)
    rivals = (Rival("backlash", {"backlash": 3e-5}, ()), Rival("position_lag", {"position_lag": 2e-3}, ()))
    return Plan(
        RIG, limits, rivals, Profile(several, log_odds), Profile(standard(limits), 1.0), Profile((blocks[0],) * 3, 70.3),
        (Confirmed("backlash", 1, "position_lag", 0.9 * log_odds),), decides, "the time binds: about 30 s of such moves would do",
    )  # fmt: skip
