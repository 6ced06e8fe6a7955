"""How large a rival is where nobody says: what would just be named in a usual campaign."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from observer_fi.improve import coverage_of, start_values
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
    hypothesis,
    is_limit,
    limit_values,
    no_cause,
    sized,
)

_NAMED_NATS = 50.0  # in the campaign, beside the refit: twice what `improve` asks for
_MOST_TIMES = 300.0  # of a start: a cause that needs more does not show


def rivals_of(asked: Sequence[Asked], rig: Rig, limits: Limits) -> list[Rival]:
    """The causes with their forms and sizes. Raises UsageError for parameters that a cause has not."""
    experiment, _ = whole(campaign(limits), rig, limits)
    coverage = coverage_of(experiment, rig.model, np.zeros((experiment.moves, 2)))
    return [
        no_cause(rig) if name == NONE else _rival(name, given, rig, experiment, coverage) for name, given in asked
    ]


def _rival(name: str, given: Mapping[str, float], rig: Rig, experiment: Experiment, coverage: Coverage) -> Rival:
    variants = forms_of(name, given, coverage)
    first = variants[0]
    own = given if any(t.parameter in given for t in first.sizes) else {}
    values = _values(variants, rig, experiment)
    if given:
        values[0] = {**(sized(first, own, 1.0) if own else values[0]), **given}
    forms = tuple(hypothesis(rig, v, x) for v, x in zip(variants, values, strict=True))
    return Rival(name, values[0], forms)


def _values(variants: Sequence[Variant], rig: Rig, experiment: Experiment) -> list[dict[str, float]]:
    """Of every form, the size at which it stands out by `_NAMED_NATS`."""
    tried = [limit_values(v) if is_limit(v) else [start_values(v)] for v in variants]
    forms = [hypothesis(rig, v, values) for v, each in zip(variants, tried, strict=True) for values in each]
    nats = iter(_standing_out(forms, rig, experiment))
    found = []
    for variant, each in zip(variants, tried, strict=True):
        seen = [next(nats) for _ in each]
        if is_limit(variant):
            enough = [values for values, n in zip(each, seen, strict=True) if n >= _NAMED_NATS]
            found.append((enough or each[-1:])[0])
        else:
            times = math.sqrt(_NAMED_NATS / max(seen[0], 1e-12))
            found.append(sized(variant, {}, min(times, _MOST_TIMES)))
    return found


def _standing_out(forms: Sequence[Hypothesis], rig: Rig, experiment: Experiment) -> list[float]:
    """Nats that the refitted rig leaves of each."""
    base = no_cause(rig).forms[0]
    owner = np.zeros(experiment.moves, dtype=np.int64)
    truths = [readings(experiment, form) for form in forms]
    return [fitted.left(np.ones(1)) for fitted in normals(experiment, owner, base, truths)]
