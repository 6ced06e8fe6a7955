"""Truth against `plan`: one row a pair of rivals, and the table of `reports/plan.md`."""

import io
import math
import time
from dataclasses import dataclass
from typing import Any

import hidden
import numpy as np
import pandas as pd

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.plan import DECISIVE, Plan, judged, limits_of, moves_csv, plan_causes

LEVEL, TILTED = (0.0,), (0.0, 10.0, -10.0)


@dataclass(frozen=True)
class Pair:
    """Two causes at times their small size, and the pitches that can be set."""

    causes: tuple[str, str]
    times: tuple[float, float]
    pitches: tuple[float, ...] = LEVEL


PAIRS = (
    Pair(("backlash", "position_lag"), (0.4, 0.4)),
    Pair(("viscous_friction", "load_dependent_friction"), (0.25, 0.25), TILTED),
    Pair(("shaft_ripple", "screw_ripple"), (0.2, 0.2)),
    Pair(("stribeck_friction", "brush_drop"), (0.45, 0.18)),
    Pair(("backlash", "position_delay"), (0.4, 0.4)),
    Pair(("shaft_ripple", "position_dependent_friction"), (0.25, 0.33)),
    Pair(("stribeck_friction", "load_dependent_friction"), (0.6, 0.25), TILTED),
    Pair(("position_lag", "position_delay"), (1.5, 1.5)),
    Pair(("brush_drop", "load_dependent_friction"), (0.25, 0.25), TILTED),
    Pair(("screw_ripple", "position_dependent_friction"), (0.2, 0.3)),
)


def run_pair(pair: Pair, seed: int) -> dict[str, Any]:
    """Odds on the truth's logs of the planned moves, and of moves to and fro at one speed of the same length."""
    rng = np.random.default_rng([seed, 7])
    effects = [hidden.sized_effect(c, x, rng) for c, x in zip(pair.causes, pair.times, strict=True)]
    rig, began = load_rig(), time.process_time()
    plan = plan_causes([_asked(e) for e in effects], rig, limits_of(rig, 10.0, pair.pitches))
    seconds = time.process_time() - began
    before, after = (
        [_odds(plan, moves_csv(plan, profile), effect, seed) for effect in effects]
        for profile in (plan.before, plan.planned)
    )
    return {
        "causes": list(pair.causes),
        "seed": seed,
        "expected": [plan.before.log_odds, plan.planned.log_odds],
        "before": before,
        "after": after,
        "decides": plan.decides,
        "length_s": plan.seconds,
        "cpu_s": seconds,
    }


def profile_of(moves: str) -> hidden.Profile:
    """What the truth plays of a moves.csv."""
    table = pd.read_csv(io.StringIO(moves))
    t, w, pitch = (table[c].to_numpy() for c in ("time_s", "speed_cmd_rad_s", "pitch_deg"))
    starts = np.flatnonzero((w[:-1] == 0.0) & (w[1:] != 0.0))
    each = tuple(hidden.Move(float(t[k]), float(w[k + 1]), 0.1) for k in starts)
    new = np.flatnonzero(np.diff(pitch, prepend=np.nan))
    steps = tuple((float(t[k]), float(pitch[k])) for k in new)
    return hidden.Profile(each, float(t[-1]), steps, curve=(tuple(t.tolist()), tuple(w.tolist())))


def _odds(plan: Plan, moves: str, effect: hidden.Effect, seed: int) -> float:
    """Log-odds [nats] of the effect that a truth hides against its rival."""
    rng = np.random.default_rng([seed, 8])
    drawn = hidden.draw_rig(rng, identification_percent=2.0)
    spec = hidden.TruthSpec(
        profile_of(moves),
        drawn,
        effects=(effect,),
        start_integral_rad=hidden.draw_rest_integral(rng, drawn, 0.0),
    )
    log = log_from_frame(hidden.make_log(spec, seed)[0])
    forms = {rival.name: rival.forms for rival in plan.rivals}
    return judged([log], plan.rig, forms, effect.cause)[1]


def _asked(effect: hidden.Effect) -> tuple[str, dict[str, float]]:
    """The effect in the words of the package; of a ripple, half of it each in sine and cosine."""
    size = hidden.right_size(effect)
    if size is None:
        return effect.cause, {}
    share = size.value / math.sqrt(len(size.parameters))
    values = dict.fromkeys(size.parameters, share)
    if effect.cause == "viscous_friction":
        values["viscous_negative"] = share
    return effect.cause, values


def decided(odds: list[float]) -> bool:
    """Whether both truths are told at odds of 100."""
    return min(odds) > DECISIVE


def summary(rows: list[dict[str, Any]]) -> str:
    """The text of `reports/plan.md`."""
    seeds = sorted({r["seed"] for r in rows})
    told = [sum(decided(r[key]) for r in rows) for key in ("before", "after")]
    cpu = float(np.median([r["cpu_s"] for r in rows])) if rows else math.nan
    lines = [
        "# What `plan` decides",
        "",
        f"Made by `pipelines/plan_study.py`, seeds {seeds[0]} to {seeds[-1]}: two rivals each, smaller than what a campaign",
        "names. Logs are of an independent truth whose rig differs from the rig file as rigs do. Log-odds in nats of each",
        f"truth against the other cause, fitted with everything else; {DECISIVE:.1f} are odds of 100.",
        "",
        f"Told apart by moves to and fro at one speed: {told[0]} of {len(rows)}; by the planned moves: {told[1]} of {len(rows)}."
        f" A plan took {cpu:.1f} s of CPU (median).",
        "",
        "| rivals | expected, one speed | planned | truth, one speed | planned | told before, after; plan says |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_line(r) for r in rows]
    return "\n".join(lines) + "\n"


def _line(r: dict[str, Any]) -> str:
    before, after = (" / ".join(f"{x:.3g}" for x in r[key]) for key in ("before", "after"))
    told = ", ".join("yes" if decided(r[key]) else "no" for key in ("before", "after"))
    expected = " | ".join(f"{x:.3g}" for x in r["expected"])
    says = "decides" if r["decides"] else "does not"
    return f"| {' / '.join(r['causes'])} | {expected} | {before} | {after} | {told}; {says} |"
