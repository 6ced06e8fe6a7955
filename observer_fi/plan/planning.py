"""The next log worth recording: the moves within a rig's limits that best tell rivals apart, or pin constants down."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import UsageError
from observer_fi.learn import Experiment
from observer_fi.numerics import digits
from observer_fi.physics import CAUSES, MOVES, Rig, unknown_name
from observer_fi.plan.confirm import Confirmed, confirm
from observer_fi.plan.evidence import (
    Evidence,
    Fitted,
    library,
    normals,
    precision,
    readings,
    std_of,
    weigh,
    whole,
)
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import (
    LEAD_S,
    Block,
    family,
    in_order,
    standard,
    total_seconds,
)
from observer_fi.plan.rivals import Asked, Rival, aliases, checked, faults_of, no_cause
from observer_fi.plan.search import best_counts, best_repeated, chosen
from observer_fi.plan.sizes import rivals_of
from observer_fi.records import Array

DECISIVE = math.log(100.0)  # nats: posterior odds of 100 between rivals that were even before
_SEEDS = (1, 2)
_MORE_PITCHES = (10.0, -10.0)  # deg: tried where the levels at hand do not decide
SURE = 20.0  # nats expected: noise then seldom leaves less than `DECISIVE`
_SOMETHING = 0.2  # nats: less is no ground for an estimate of the time
_KNOWN = 0.05  # relative standard error of a constant that counts as known
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

    rivals: of two that no move can tell apart, without forms. before: moves that are usually recorded, as long. simpler: one
    kind of move repeated. confirmed: simulated logs of the planned moves, fitted by all rivals. decides: whether all of them,
    and the expectation, are above odds of 100. why: what stands in the way, or what carries it. std: where constants are asked
    for, their standard errors after the usual moves, the planned and the simpler ones; log_odds are then 0.
    """

    rig: Rig
    limits: Limits
    rivals: tuple[Rival, ...]
    planned: Profile
    before: Profile
    simpler: Profile
    confirmed: tuple[Confirmed, ...]
    decides: bool
    why: str
    std: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

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


def expected_profile(
    asked: Sequence[Asked], rig: Rig, limits: Limits, tell: Tell = lambda text: None
) -> Profile:
    """The moves that are expected to tell causes apart best; no log is simulated with noise. Raises UsageError."""
    tell("sizes of the rivals")
    rivals = rivals_of(checked(asked), rig, limits)
    tell("what each kind of move says")
    evidence = _evidence(rivals, rig, limits)
    tell("the best profile")
    counts = best_counts(evidence.value, evidence.seconds, limits.seconds - LEAD_S)
    return Profile(in_order(chosen(counts, evidence.blocks), limits), evidence.value(counts))


def plan_faults(text: str, rig: Rig, limits: Limits, tell: Tell = lambda text: None) -> Plan:
    """Moves that tell faults apart which are there when the log begins. Raises UsageError for unknown faults."""
    return _plan(faults_of(text, rig), rig, limits, tell)


def plan_constants(names: Sequence[str], rig: Rig, limits: Limits, tell: Tell = lambda text: None) -> Plan:
    """Moves after which constants of the rig are known best. Raises UsageError for what no move can tell."""
    base = no_cause(rig)
    known = tuple(f.name for f in base.forms[0].free)
    for name in names:
        if name not in known:
            raise unknown_name(name, known, "constant that moves can tell")
    tell("what each kind of move says")
    blocks, seconds = _blocks(limits)
    fitted = _about(library(blocks, rig, limits, _warm_up(limits)), base)

    def value(counts: Array) -> float:
        return precision(fitted, counts, names)

    most = limits.seconds - LEAD_S
    tried = [best_counts(value, np.array(seconds), most), best_repeated(value, np.array(seconds), most)]
    three = [standard(limits), *(in_order(chosen(c, blocks), limits) for c in tried)]
    after = [std_of(_about(whole(p, rig, limits), base), np.ones(1)) for p in three]
    std = {n: (after[0][n], after[1][n], after[2][n]) for n in names}
    before, planned, simpler = (Profile(p, 0.0) for p in three)
    off = {n: [v / abs(rig.model[n] or 1.0) for v in std[n]] for n in names}
    worst = max(names, key=lambda n: off[n][1])
    why = f"least known afterwards is {worst}, to {off[worst][1]:.2%}; after moves to and fro at one speed to {off[worst][0]:.2%}"
    return Plan(rig, limits, (), planned, before, simpler, (), off[worst][1] < _KNOWN, why, std)


def _about(part: tuple[Experiment, NDArray[np.int64]], base: Rival) -> Fitted:
    """What the refitted rig makes of its own readings: its normal equations."""
    (fitted,) = normals(*part, base.forms[0], [readings(part[0], base.forms[0])])
    return fitted


def _alias_words(a: str, b: str) -> str:
    return (
        f"{a} and {b} move the readings in exactly the same way, whatever the moves: no move can tell them apart; "
        f"record instead: {CAUSES[a].told_apart_by(MOVES)}"
    )


def _hopeless(asked: Sequence[Asked], rig: Rig, limits: Limits, why: str) -> Plan:
    nothing = Profile((), 0.0)
    named = tuple(Rival(name, values, ()) for name, values in asked)
    return Plan(rig, limits, named, nothing, nothing, nothing, (), False, why)


def _plan(rivals: Sequence[Rival], rig: Rig, limits: Limits, tell: Tell) -> Plan:
    tell("what each kind of move says")
    evidence = _evidence(rivals, rig, limits)
    tell("the best profile")
    most = limits.seconds - LEAD_S
    usual = _profile(standard(limits), rivals, rig, limits)
    tried = [
        best_counts(evidence.value, evidence.seconds, most),
        best_repeated(evidence.value, evidence.seconds, most),
    ]
    best, simpler = (
        _profile(in_order(chosen(c, evidence.blocks), limits), rivals, rig, limits) for c in tried
    )
    planned = max((best, simpler, usual), key=lambda p: p.log_odds)
    simpler = usual if usual.log_odds >= _NEARLY * planned.log_odds else simpler
    tell("does it decide")
    confirmed = confirm(
        planned.blocks, rivals, rig, limits, _exact(planned.blocks, rivals, rig, limits), _SEEDS
    )
    least = min((c.log_odds for c in confirmed), default=0.0)
    decides = min(planned.log_odds, least) > DECISIVE
    why = _carries(planned, usual) if decides else _stands_in_the_way(planned, least, rivals, rig, limits)
    return Plan(rig, limits, tuple(rivals), planned, usual, simpler, confirmed, decides, why)


def _evidence(rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Evidence:
    blocks, seconds = _blocks(limits)
    return weigh(*library(blocks, rig, limits, _warm_up(limits)), rivals, blocks, seconds)


def _blocks(limits: Limits) -> tuple[tuple[Block, ...], list[float]]:
    """What there is to choose from, and how long each lasts. Raises UsageError where nothing fits."""
    blocks = in_order(family(limits), limits)
    if not blocks:
        raise UsageError(f"no move fits into {limits.seconds:g} s and this travel; allow more of either")
    return blocks, [total_seconds([b], limits.accel) - LEAD_S for b in blocks]


def _warm_up(limits: Limits) -> Block:
    return min(family(limits), key=lambda b: total_seconds([b], limits.accel))


def _exact(blocks: Sequence[Block], rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Evidence:
    return weigh(*whole(blocks, rig, limits), rivals, blocks[:1], [total_seconds(blocks, limits.accel)])


def _profile(blocks: tuple[Block, ...], rivals: Sequence[Rival], rig: Rig, limits: Limits) -> Profile:
    return Profile(blocks, _exact(blocks, rivals, rig, limits).value(np.ones(1)) if blocks else 0.0)


# --- why ---------------------------------------------------------------------------------------------


def _carries(planned: Profile, usual: Profile) -> str:
    leave = f"moves to and fro at one speed are expected to leave {digits(usual.log_odds)} nats, these {digits(planned.log_odds)}"
    return f"{leave}; {digits(DECISIVE, 2)} are odds of 100"


def _stands_in_the_way(
    planned: Profile, least: float, rivals: Sequence[Rival], rig: Rig, limits: Limits
) -> str:
    """Which limit binds: what more pitches or more time would do."""
    words = f"the best moves within the limits are expected to leave {digits(planned.log_odds, 2)} nats, "
    words += f"{digits(DECISIVE, 2)} are needed"
    touching = [r.name for r in rivals if r.name in CAUSES and CAUSES[r.name].equation == "contact"]
    if touching:
        return (
            f"{words}; {' and '.join(touching)} show at a stop only, and these moves keep clear of the stops"
        )
    if planned.log_odds > DECISIVE >= least:
        words += f", and with noise fits of simulated logs left {digits(least, 2)}"
    wider = replace(limits, pitches=(*limits.pitches, *(p for p in _MORE_PITCHES if p not in limits.pitches)))
    if len(wider.pitches) > len(limits.pitches):
        evidence = _evidence(rivals, rig, wider)
        more = evidence.value(best_counts(evidence.value, evidence.seconds, limits.seconds - LEAD_S))
        if more > max(DECISIVE, 2.0 * planned.log_odds):
            levels = ", ".join(f"{p:g}" for p in wider.pitches)
            return f"{words}; the pitch binds: with levels of {levels} deg they would leave {digits(more)}"
    if planned.log_odds > _SOMETHING:
        enough = limits.seconds * max(SURE / planned.log_odds, 1.5)
        return f"{words}; the time binds: about {enough:.0f} s of such moves would do"
    return f"{words}; within these limits the rivals move the readings alike"
