"""How large a rival is where nobody says: what would just be named in a usual campaign."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from observer_fi.improve import coverage_of
from observer_fi.learn import Experiment
from observer_fi.physics import Coverage, Rig, Variant
from observer_fi.plan.evidence import normals, readings, whole
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import campaign
from observer_fi.plan.rivals import (
    NONE,
    Asked,
    Hypothesis,
    Rival,
    forms_of,
    holds_neutral,
    hypothesis,
    is_limit,
    limit_values,
    no_cause,
    sized,
)

_NAMED_NATS = 30.0  # in the campaign, beside the refit: a little more than `improve` asks for
_TIMES = tuple(0.25 * 2.0**k for k in range(12))  # of a start: a cause that needs more does not show
_PITCHES = (10.0, -10.0)  # deg: of the campaign, where the rig can move there
_HELD = 0.5  # of the torque at stall that a pitch may take


def rivals_of(asked: Sequence[Asked], rig: Rig, limits: Limits) -> list[Rival]:
    """The causes with their forms and sizes. Raises UsageError for parameters that a cause has not."""
    usual = _usual(rig, limits)
    experiment, _ = whole(campaign(usual), rig, usual)
    coverage = coverage_of(experiment, rig.model, np.zeros((experiment.moves, 2)))
    return [
        no_cause(rig) if name == NONE else _rival(name, given, rig, experiment, coverage)
        for name, given in asked
    ]


def _rival(
    name: str, given: Mapping[str, float], rig: Rig, experiment: Experiment, coverage: Coverage
) -> Rival:
    variants = forms_of(name, given, coverage)
    first = variants[0]
    own = given if any(t.parameter in given for t in first.sizes) else {}
    values = [_values(v, rig, experiment) for v in variants]
    if given:
        values[0] = {**(sized(first, own, 1.0) if own else values[0]), **given}
    forms = tuple(hypothesis(rig, v, x) for v, x in zip(variants, values, strict=True))
    absent = () if all(holds_neutral(v) for v in variants) else no_cause(rig).forms
    return Rival(name, values[0], (*forms, *absent))


def _values(variant: Variant, rig: Rig, experiment: Experiment) -> dict[str, float]:
    """The smallest size tried at which a form stands out by `_NAMED_NATS`, the largest where none does."""
    limit = is_limit(variant)
    tried = limit_values(variant) if limit else [sized(variant, {}, times) for times in _TIMES]
    nats = _standing_out([hypothesis(rig, variant, values) for values in tried], rig, experiment)
    enough = (values for values, n in zip(tried, nats, strict=True) if n >= _NAMED_NATS)
    return next(enough, tried[-1])


def _standing_out(forms: Sequence[Hypothesis], rig: Rig, experiment: Experiment) -> list[float]:
    """Nats that the refitted rig leaves of each."""
    base = no_cause(rig).forms[0]
    owner = np.zeros(experiment.moves, dtype=np.int64)
    truths = [readings(experiment, form) for form in forms]
    return [fitted.left(np.ones(1)) for fitted in normals(experiment, owner, base, truths)]


def _usual(rig: Rig, limits: Limits) -> Limits:
    """The limits, with what pitches a campaign has."""
    m = rig.model
    stall = m["Km"] * m["Vmax"] / (m["Rm"] + m["Rs"])
    more = [p for p in _PITCHES if m["A"] + abs(m["B"] * p) < _HELD * stall and p not in limits.pitches]
    return replace(limits, pitches=(*limits.pitches, *more))
