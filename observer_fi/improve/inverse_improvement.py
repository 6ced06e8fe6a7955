"""`improve` for a rig that is driven by force: the ladder of causes as findings, JSON and an extended rig."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from observer_fi.improve.inverse_ladder import Ladder, nll
from observer_fi.improve.inverse_vocabulary import Candidate
from observer_fi.learn import (
    Columns,
    Motion,
    Solution,
    extended_rig,
    held_out,
    parameters_of,
    relative,
    residual_on,
    whiteness,
)
from observer_fi.physics import CAUSES, PARAMETERS, Rig
from observer_fi.records import Finding, Parameter


def findings(ladder: Ladder) -> tuple[Finding, ...]:
    """The accepted causes in order, with their final sizes."""
    found = parameters_of(ladder.final)
    result = []
    for rung in ladder.rungs:
        ratio = rung.after / rung.before
        for candidate, net in zip(rung.candidates, rung.nets, strict=True):
            names = [parameter for term in candidate.terms for parameter, _ in term.moves] + list(
                candidate.shapes
            )
            fixed = {name: (ladder.final.structure.shapes[name], 0.0) for name in candidate.shapes}
            parameters = tuple(_parameter(name, *(fixed | found)[name], ladder.rig) for name in names)
            cause, rivals = CAUSES[candidate.cause], rung.rivals[candidate.cause]
            result.append(
                Finding(
                    cause.name, cause.equation, parameters, net, rung.drop, {"force_n": ratio}, rivals,
                    _separate_by(candidate, rivals),
                )
            )  # fmt: skip
    return tuple(result)


def _separate_by(candidate: Candidate, rivals: Sequence[str]) -> str:
    """What to record to tell a cause from its rivals, or to be surer of it."""
    texts = [_SEPARATE.get(name, CAUSES[name].separate_by) for name in (candidate.cause, *rivals)]
    return "; ".join(dict.fromkeys(text for text in texts if text))


# Where the table of causes speaks of a servo or of pitch.
_SEPARATE = {
    "asymmetric_friction": "steady moves at four speeds or more, both directions, and again with the rig turned round",
    "input_delay": "the force itself (a load cell, or the motor current) on the clock of the position",
    "current_lag": "the motor current, through a step of force",
}


def _parameter(name: str, value: float, std: float, rig: Rig) -> Parameter:
    return Parameter(
        name, value, std, rig.model[name], PARAMETERS[name][0], value - 1.96 * std, value + 1.96 * std
    )


def inverse_refit(ladder: Ladder) -> tuple[Parameter, ...]:
    """Parameters that only moved: of the final model those that no finding speaks of."""
    named = {p.name for finding in findings(ladder) for p in finding.parameters}
    found = parameters_of(ladder.final).items()
    return tuple(_parameter(name, *value, ladder.rig) for name, value in found if name not in named)


def inverse_json(ladder: Ladder) -> dict[str, Any]:
    """The ladder as `improve.json`; the force residual [N] stands for the readings, for nothing else was predicted."""
    return {
        "schema": "observer-fi/improve/1",
        "baseline": _summary(ladder.start),
        "refit": {
            p.name: {"value": p.value, "std": p.std, "prior": p.prior, "unit": p.unit}
            for p in inverse_refit(ladder)
        },
        "findings": [_finding(f) for f in findings(ladder)],
        "unexplained": [
            {"equation": "torque", "regressor": name, "share_of_residual_variance": share}
            for name, share in ladder.unexplained
        ],
        "extended": _summary(ladder.final),
    }


def _summary(solution: Solution) -> dict[str, Any]:
    seen = held_out(solution)
    return {
        "nll_per_sample": nll(seen, solution),
        "rmse": {"force_n": float(np.sqrt(np.mean(seen**2)))},
        "whiteness_p": {"force_n": whiteness(seen)},
    }


def _finding(found: Finding) -> dict[str, Any]:
    return {
        "cause": found.cause,
        "equation": found.equation,
        "parameters": {p.name: {"value": p.value, "std": p.std, "unit": p.unit} for p in found.parameters},
        "evidence": {"delta_bic": found.delta_bic},
        "gain": {
            "heldout_nll_drop_per_sample": found.heldout_nll_drop_per_sample,
            "heldout_rmse_ratio": found.heldout_rmse_ratio,
        },
        "indistinguishable_from": list(found.indistinguishable_from),
        "separate_by": found.separate_by,
    }


def extended(ladder: Ladder, name: str) -> Rig:
    """The rig with every accepted cause, which all other commands take."""
    causes = ", ".join(c.cause for rung in ladder.rungs for c in rung.candidates)
    return extended_rig(
        ladder.rig, ladder.final, name, f"{ladder.rig.source}; extended by {causes or 'nothing'}"
    )


def judge(columns: Columns, solution: Solution, motion: Motion, start_s: float = -math.inf) -> float:
    """Force residual of a motion from a time on, relative to the force, under frozen parameters [per cent].

    Every sample counts, those at the end too where the filters end: that is how the published figures are made.
    """
    e, y = residual_on(columns, motion, solution)
    rows = motion.t >= start_s
    return relative(e[rows], y[rows])
