"""Whether a profile decides: logs with noise are simulated with each rival in turn, and all rivals are fitted to them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer_fi.learn import Experiment, fit, prepare
from observer_fi.numerics import sum_of_squares
from observer_fi.physics import Rig
from observer_fi.plan.evidence import Evidence, logs_of
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import Block
from observer_fi.plan.rivals import Hypothesis, Rival
from observer_fi.records import Array, Log

_STEPS = 8  # of the integration in a transient, as `improve` fits
_FORMS = 2  # of a rival that are fitted: those that left least in the linear look


@dataclass(frozen=True)
class Confirmed:
    """One simulated log: what was in it, and the log-odds [nats] of that against its closest rival after all were fitted."""

    truth: str
    seed: int
    closest: str
    log_odds: float


def confirm(
    blocks: Sequence[Block],
    rivals: Sequence[Rival],
    rig: Rig,
    limits: Limits,
    exact: Evidence,
    seeds: Sequence[int],
) -> tuple[Confirmed, ...]:
    """Every rival as the truth, for every seed of the noise."""
    likely = {rival.name: _likely(rival, exact) for rival in rivals}
    return tuple(
        Confirmed(
            truth.name, seed, *judged(logs_of(blocks, rig, limits, truth, seed), rig, likely, truth.name)
        )
        for truth in rivals
        if not truth.within_all
        for seed in seeds
    )


def judged(
    logs: Sequence[Log], rig: Rig, forms: Mapping[str, Sequence[Hypothesis]], truth: str
) -> tuple[str, float]:
    """The closest rival of one that is true, and the log-odds [nats] against it after all were fitted to logs.

    forms: of each rival, those that are fitted.
    """
    experiment = replace(prepare(logs, rig, share=1.0), steps=_STEPS)
    cost = {name: min(_cost(experiment, h) for h in each) for name, each in forms.items()}
    closest = min((name for name in cost if name != truth), key=lambda name: cost[name])
    return closest, cost[closest] - cost[truth]


def _likely(rival: Rival, exact: Evidence) -> tuple[Hypothesis, ...]:
    """The form that is simulated, and those that could pass best for another rival."""
    order: list[int] = [0]
    for pair in exact.pairs:
        if pair.rival == rival.name:
            left = [form.left(np.ones(exact.seconds.size)) for form in pair.forms]
            order += np.argsort(left)[:_FORMS].tolist()
    return tuple(rival.forms[k] for k in dict.fromkeys(order))


def _cost(experiment: Experiment, h: Hypothesis) -> float:
    """Half the sum of squares after the fit, priors and the price of what `improve` pays for a parameter included [nats]."""
    n = int((experiment.weight > 0.0).sum())
    price = 0.5 * len(h.free) * math.log(n)
    if h.still is None:
        return fit(experiment, h.model, h.free).objective + price
    weight = experiment.weight.copy()
    weight[:, h.still] = 0.0
    rest = _stillness(experiment, h.still)
    return fit(replace(experiment, weight=weight), h.model, h.free).objective + 0.5 * rest + price


def _stillness(experiment: Experiment, channel: int) -> float:
    """Sum of squares of a channel about its mean in each log."""
    total = 0.0
    owner = experiment.log[experiment.owner]
    for k in np.unique(owner):
        rows = (owner == k) & (experiment.weight[:, channel] > 0.0)
        z: Array = experiment.z[rows, channel]
        if z.size:
            total += sum_of_squares((z - z.mean()) * experiment.weight[rows, channel])
    return total
