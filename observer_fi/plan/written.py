"""A plan as text: the command as CSV, `plan.json`, the moves in words."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from observer_fi.numerics import digits
from observer_fi.physics import PARAMETERS
from observer_fi.plan.limits import Limits
from observer_fi.plan.moves import Block, corners_of, in_words, lay_out, total_seconds
from observer_fi.plan.planning import DECISIVE, Plan, Profile
from observer_fi.records import Array

SCHEMA = "observer-fi/plan/1"
_POINTS = 1500  # of a course between its corners: a ramp is a curve in the travel


class Course(NamedTuple):
    """A profile over time: t [s], w [rad/s], x [m] from where the log begins, pitch [deg], all (n,).

    begins: when each line of `steps` begins [s].
    """

    t: Array
    w: Array
    x: Array
    pitch: Array
    begins: tuple[float, ...]


def course(profile: Profile, limits: Limits) -> Course:
    """The command of a profile with moves, and where it leads."""
    at, speed = corners_of(profile.blocks, limits.accel)
    t = np.union1d(at, np.linspace(at[0], at[-1], _POINTS))
    w = np.interp(t, at, speed)
    x = limits.unit * np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))))
    placed = lay_out(profile.blocks, limits.accel)[1]
    counts = [n for n, _ in in_words(profile.blocks)]
    firsts = np.cumsum([0, *counts[:-1]]).tolist()
    begins = tuple(placed[k].begin for k in firsts)
    return Course(t, w, x, _pitches(t, profile.blocks, limits), begins)


def moves_csv(plan: Plan, profile: Profile | None = None) -> str:
    """The command at its corners, linear in between, and the pitch to set: speed [rad/s], or position [m] of a position servo.

    profile: by default the planned one.
    """
    blocks = (profile or plan.planned).blocks
    header = "position_cmd_m" if plan.rig.driven.command else "speed_cmd_rad_s"
    lines = [f"time_s,{header},pitch_deg"]
    if blocks:
        t, w = _with_settings(*corners_of(blocks, plan.limits.accel), blocks, plan.limits)
        value = _positions(t, w, plan) if plan.rig.driven.command else w
        pitch = _pitches(t, blocks, plan.limits)
        rows = zip(t.tolist(), value.tolist(), pitch.tolist(), strict=True)
        lines += [f"{a:.9g},{b:.9g},{p:g}" for a, b, p in rows]
    return "\n".join(lines) + "\n"


def _positions(t: Array, w: Array, plan: Plan) -> Array:
    steps = 0.5 * (w[1:] + w[:-1]) * np.diff(t)
    return plan.rig.model["D"] * np.concatenate(([0.0], np.cumsum(steps)))


def _with_settings(t: Array, w: Array, blocks: Sequence[Block], limits: Limits) -> tuple[Array, Array]:
    """The corners, with a row in the middle of every rest in which another pitch is set."""
    placed = lay_out(blocks, limits.accel)[1]
    new = [b.begin for a, b in zip(placed[:-1], placed[1:], strict=True) if a.block.pitch != b.block.pitch]
    at = np.array(new) - 0.5 * limits.rest_s
    where = np.searchsorted(t, at)
    return np.insert(t, where, at), np.insert(w, where, 0.0)


def _pitches(t: Array, blocks: Sequence[Block], limits: Limits) -> Array:
    """The level from each time on: that of a block is set in the rest before it."""
    placed = lay_out(blocks, limits.accel)[1]
    ends = np.array([p.end for p in placed]) - 0.5 * limits.rest_s
    number = np.minimum(np.searchsorted(ends, t + 1e-9, "left"), len(placed) - 1)
    return np.array([p.block.pitch for p in placed])[number]


def steps(profile: Profile, limits: Limits) -> list[str]:
    """The moves in words, one line a kind."""
    several = len(limits.pitches) > 1
    return [
        f"{block.words}{f', at {block.pitch:g} deg' if several else ''}{f', {n} times' if n > 1 else ''}"
        for n, block in in_words(profile.blocks)
    ]


def in_lines(plan: Plan) -> list[str]:
    """The moves in words, what they decide, and the simpler ones."""
    names = " or ".join(rival.name for rival in plan.rivals) or ", ".join(plan.std)
    lines = [f"{names}: {'decided' if plan.decides else 'not decided'}; {plan.why}"]
    if plan.planned.blocks:
        lines += [f"{k}. {text}" for k, text in enumerate(steps(plan.planned, plan.limits), start=1)]
        lines.append(
            f"{digits(plan.seconds)} s in all; simpler: {'; '.join(steps(plan.simpler, plan.limits))}{_odds(plan)}"
        )
    return lines


def _odds(plan: Plan) -> str:
    return (
        ""
        if plan.std
        else f" ({digits(plan.simpler.log_odds)} nats in place of {digits(plan.planned.log_odds)})"
    )


def to_json(plan: Plan) -> dict[str, Any]:
    """`plan.json`."""
    return {
        "schema": SCHEMA,
        "rivals": [{"name": r.name, "parameters": _with_units(r.values)} for r in plan.rivals],
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
            {"truth": c.truth, "seed": c.seed, "closest": c.closest, "log_odds": c.log_odds}
            for c in plan.confirmed
        ],
        "std": {
            name: dict(zip(("before", "planned", "simpler"), std, strict=True), unit=PARAMETERS[name][0])
            for name, std in plan.std.items()
        },
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
    return {n: v if math.isfinite(v) else None for n, v in numbers.items()} | {
        "pitches_deg": list(limits.pitches)
    }
