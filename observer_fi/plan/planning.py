"""The next log worth recording: the moves within a rig's limits that best tell rivals apart, or pin constants down."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.physics import CAUSES, MOVES, PARAMETERS, Rig
from observer_fi.plan.confirm import Confirmed, confirm
from observer_fi.plan.evidence import Evidence, library, weigh, whole
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import (
    LEAD_S,
    Block,
    campaign,
    corners_of,
    family,
    in_order,
    in_words,
    lay_out,
    repeated,
    standard,
    total_seconds,
)
from observer_fi.plan.rivals import Asked, Rival, aliases, checked, faults_of
from observer_fi.plan.search import best_counts, best_repeated, chosen
from observer_fi.plan.sizes import rivals_of
from observer_fi.records import Array

SCHEMA = "observer-fi/plan/1"
DECISIVE = math.log(100.0)  # nats: posterior odds of 100 between rivals that were even before
_SEEDS = (1, 2)
_MORE_PITCHES = (10.0, -10.0)  # deg: tried where the levels at hand do not decide
_NEARLY = 0.7  # of the log-odds: what a simpler profile must reach to be worth its name

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Profile:
    """Blocks in order, and what they are expected to say: log-odds of the least favourable pair [nats]."""

    blocks: tuple[Block, ...]
    log_odds: float


@dataclass(frozen=True)
class Plan:
    """What to record next, and why.

    rivals: name and values of each. before: moves that are usually recorded, as long. simpler: one kind of move repeated.
    confirmed: simulated logs of the planned moves, fitted by all rivals. decides: whether all of them, and the expectation, are
    above odds of 100. why: what stands in the way, or what carries it.
    """

    rig: Rig
    limits: Limits
    rivals: tuple[tuple[str, Mapping[str, float]], ...]
    planned: Profile
    before: Profile
    simpler: Profile
    confirmed: tuple[Confirmed, ...]
    decides: bool
    why: str

    @property
    def seconds(self) -> float:
        """Of the planned moves."""
        return total_seconds(self.planned.blocks, self.limits.accel)


def plan_causes(asked: Sequence[Asked], rig: Rig, limits: Limits, tell: Tell = lambda text: None) -> Plan:
    """Moves that tell causes apart, or show a single one. Raises UsageError for unknown causes."""
    asked = checked(asked)
    same = aliases([name for name, _ in asked])
    if same:
        return _hopeless(asked, rig, limits, _alias_words(*same))
    tell("sizes of the rivals")
    return _plan(rivals_of(asked, rig, limits), rig, limits, tell)


def plan_faults(text: str, rig: Rig, limits: Limits, tell: Tell = lambda text: None) -> Plan:
    """Moves that tell faults apart which are there when the log begins. Raises UsageError for unknown faults."""
    return _plan(faults_of(text, rig), rig, limits, tell)


def _alias_words(a: str, b: str) -> str:
    return (
        f"{a} and {b} move the readings in exactly the same way, whatever the moves: no move can tell them apart; "
        f"record instead: {CAUSES[a].told_apart_by(MOVES)}"
    )


def _hopeless(asked: Sequence[Asked], rig: Rig, limits: Limits, why: str) -> Plan:
    nothing = Profile((), 0.0)
    return Plan(rig, limits, tuple(asked), nothing, nothing, nothing, (), False, why)


def _plan(rivals: Sequence[Rival], rig: Rig, limits: Limits, tell: Tell) -> Plan:
    tell("what each kind of move says")
    evidence = _evidence(rivals, rig, limits)
    tell("the best profile")
    most = limits.seconds - LEAD_S
    usual = _profile(standard(limits), rivals, rig, limits)
    tried = [best_counts(evidence.value, evidence.seconds, most), best_repeated(evidence.value, evidence.seconds, most)]
    best, simpler = (_profile(in_order(chosen(c, evidence.blocks), limits), rivals, rig, limits) for c in tried)
    planned = max((best, simpler, usual), key=lambda p: p.log_odds)
    simpler = usual if usual.log_odds >= _NEARLY * planned.log_odds else simpler
    tell("does it decide")
    confirmed = confirm(planned.blocks, rivals, rig, limits, _exact(planned.blocks, rivals, rig, limits), _SEEDS)
    least = min((c.log_odds for c in confirmed), default=0.0)
    decides = min(planned.log_odds, least) > DECISIVE
    why = _carries(planned, usual) if decides else _stands_in_the_way(planned, least, rivals, rig, limits)
    named = tuple((r.name, r.values) for r in rivals)
    return Plan(rig, limits, named, planned, usual, simpler, confirmed, decides, why)


def _evidence(rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Evidence:
    blocks = in_order(family(limits), limits)
    if not blocks:
        raise UsageError(f"no move fits into {limits.seconds:g} s and this travel; allow more of either")
    experiment, owner = library(blocks, rig, limits, _warm_up(limits))
    seconds = [total_seconds([b], limits.accel) - LEAD_S for b in blocks]
    return weigh(experiment, owner, rivals, blocks, seconds)


def _warm_up(limits: Limits) -> Block:
    return min(family(limits), key=lambda b: total_seconds([b], limits.accel))


def _exact(blocks: Sequence[Block], rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Evidence:
    return weigh(*whole(blocks, rig, limits), rivals, blocks[:1], [total_seconds(blocks, limits.accel)])


def _profile(blocks: tuple[Block, ...], rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Profile:
    return Profile(blocks, _exact(blocks, rivals, rig, limits).value(np.ones(1)) if blocks else 0.0)


# --- why ---------------------------------------------------------------------------------------------


def _carries(planned: Profile, usual: Profile) -> str:
    if usual.log_odds > DECISIVE:
        return "the usual moves would decide as well"
    return f"moves at one speed leave {usual.log_odds:.2g} nats, and {DECISIVE:.2g} are needed for odds of 100"


def _stands_in_the_way(planned: Profile, least: float, rivals: Sequence[Rival], rig: Rig, limits: Limits) -> str:
    """Which limit binds: what more pitches or more time would do."""
    got = min(planned.log_odds, least)
    words = f"the best moves within the limits are expected to leave {planned.log_odds:.2g} nats between the rivals, {DECISIVE:.2g} are needed"
    if planned.log_odds > DECISIVE >= least:
        words += f"; on simulated logs fits left only {least:.2g}"
    wider = replace(limits, pitches=(*limits.pitches, *(p for p in _MORE_PITCHES if p not in limits.pitches)))
    if len(wider.pitches) > len(limits.pitches):
        evidence = _evidence(rivals, rig, wider)
        more = evidence.value(best_counts(evidence.value, evidence.seconds, limits.seconds - LEAD_S))
        if more > max(DECISIVE, 2.0 * planned.log_odds):
            return f"{words}; the pitch binds: with levels of {', '.join(f'{p:g}' for p in wider.pitches)} deg they would leave {more:.3g}"
    if got > 0.05 * DECISIVE:
        return f"{words}; the time binds: about {1.3 * limits.seconds * DECISIVE / got:.0f} s of such moves would do"
    return f"{words}; within these limits the rivals move the readings alike"


# --- what is written ---------------------------------------------------------------------------------


def moves_csv(plan: Plan) -> str:
    """The command at its corners, linear in between, and the pitch to set: speed [rad/s], or position [m] of a position servo."""
    header = "position_cmd_m" if plan.rig.driven.command else "speed_cmd_rad_s"
    lines = [f"time_s,{header},pitch_deg"]
    if plan.planned.blocks:
        t, w = corners_of(plan.planned.blocks, plan.limits.accel)
        value = _positions(t, w, plan) if plan.rig.driven.command else w
        pitch = _pitches(t, plan)
        rows = zip(t.tolist(), value.tolist(), pitch.tolist(), strict=True)
        lines += [f"{a:.9g},{b:.9g},{p:g}" for a, b, p in rows]
    return "\n".join(lines) + "\n"


def _positions(t: Array, w: Array, plan: Plan) -> Array:
    steps = 0.5 * (w[1:] + w[:-1]) * np.diff(t)
    return plan.rig.model["D"] * np.concatenate(([0.0], np.cumsum(steps)))


def _pitches(t: Array, plan: Plan) -> Array:
    placed = lay_out(plan.planned.blocks, plan.limits.accel)[1]
    ends = np.array([p.end for p in placed])
    number = np.minimum(np.searchsorted(ends, t + 1e-9, "left"), len(placed) - 1)
    return np.array([p.block.pitch for p in placed])[number]


def steps(profile: Profile, limits: Limits) -> list[str]:
    """The moves in words, one line a kind."""
    several = len(limits.pitches) > 1
    return [
        f"{block.words}{f', at {block.pitch:g} deg' if several else ''}{f', {n} times' if n > 1 else ''}"
        for n, block in in_words(profile.blocks)
    ]


def to_json(plan: Plan) -> dict[str, Any]:
    """`plan.json`."""
    return {
        "schema": SCHEMA,
        "rivals": [{"name": name, "parameters": _with_units(values)} for name, values in plan.rivals],
        "moves": _moves_json(plan.planned, plan.limits),
        "seconds": plan.seconds if plan.planned.blocks else 0.0,
        "log_odds": {
            "needed": DECISIVE,
            "before": plan.before.log_odds,
            "planned": plan.planned.log_odds,
            "simpler": plan.simpler.log_odds,
        },
        "simpler": {
            "moves": _moves_json(plan.simpler, plan.limits),
            "seconds": total_seconds(plan.simpler.blocks, plan.limits.accel) if plan.simpler.blocks else 0.0,
        },
        "confirmed": [
            {"truth": c.truth, "seed": c.seed, "closest": c.closest, "log_odds": c.log_odds} for c in plan.confirmed
        ],
        "limits": _limits_json(plan.limits),
        "decides": plan.decides,
        "why": plan.why,
    }


def _with_units(values: Mapping[str, float]) -> dict[str, Any]:
    return {name: {"value": value, "unit": PARAMETERS[name][0]} for name, value in values.items()}


def _moves_json(profile: Profile, limits: Limits) -> list[dict[str, Any]]:
    return [
        {
            "words": block.words,
            "times": n,
            "pitch_deg": block.pitch,
            "legs": [{"speed_rad_s": leg.speed, "seconds": leg.seconds} for leg in block.legs],
        }
        for n, block in in_words(profile.blocks)
    ]


def _limits_json(limits: Limits) -> dict[str, Any]:
    """Infinite ones as null."""
    numbers = {
        "speed_rad_s": limits.speed, "acceleration_rad_s2": limits.accel, "lowest_m": limits.low, "highest_m": limits.high,
        "seconds": limits.seconds,
    }  # fmt: skip
    return {n: v if math.isfinite(v) else None for n, v in numbers.items()} | {"pitches_deg": list(limits.pitches)}
