"""Simulated lives of an actuator against the independent truth of tests/hidden: writes reports/trend_lives.md.

    python -m pipelines.trend_lives [--lives 1] [--first-seed 70000] [--rate 0.001] [--out reports/trend_lives.md]

A life is forty logs of five seconds, one every second day, its first thirteen taken as healthy. Friction and winding scatter by
2 % from log to log, and pitch and speed differ: what changes must stand out from that.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden import Effect, Logger, Rig, TruthSpec, draw_rest_integral, draw_rig, effect, make_log
from hidden.profiles import there_and_back

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.report import markdown_table
from observer_fi.trend import CHANGED, Digest, Trend, digest_of, trend

LOGS, ONSET = 40, 20
FRICTION_SCATTER, WINDING_SCATTER = 0.02, 0.02
Change = Callable[[Rig, float], tuple[Rig, tuple[Effect, ...]]]


class Life(NamedTuple):
    """What happens: `change` gives rig and effects when so much of it has happened; the quantities and kind that are right."""

    change: Change
    drift: bool
    right: tuple[str, ...]


def _rig(**factors: float) -> Change:
    """Constants that grow by these shares."""

    def change(rig: Rig, much: float) -> tuple[Rig, tuple[Effect, ...]]:
        return replace(rig, **{n: getattr(rig, n) * (1.0 + much * f) for n, f in factors.items()}), ()

    return change


def _effect(cause: str, **sizes: float) -> Change:
    def change(rig: Rig, much: float) -> tuple[Rig, tuple[Effect, ...]]:
        return rig, ((effect(cause, **{n: much * v for n, v in sizes.items()}),) if much > 0.0 else ())

    return change


def _nothing(rig: Rig, much: float) -> tuple[Rig, tuple[Effect, ...]]:
    return rig, ()


LIVES = {
    "none": Life(_nothing, False, ()),
    "slow wear of friction": Life(_rig(A=0.25), True, ("A",)),
    "step of friction": Life(_rig(A=0.12), False, ("A",)),
    "growing backlash": Life(_effect("backlash", width=8e-5), True, ("backlash",)),
    "warming": Life(_rig(Rm=0.12), True, ("Rm",)),
    "changed load": Life(_rig(B=0.3), False, ("torque_offset", "B")),
    "position sensor replaced": Life(_effect("position_gain", gain=0.02), False, ("D",)),
    "current sensor replaced": Life(_effect("current_gain", gain=0.05), False, ("Ki", "Kp", "J", "A", "Rm")),
}


def digests_of(life: Life, seed: int) -> list[Digest]:
    """The logs of one life, read."""
    rng = np.random.default_rng([seed, 16])
    own, rig = draw_rig(rng, 2.0), load_rig()
    found = []
    for k in range(LOGS):
        gone = max(k - ONSET + 1, 0)
        much = gone / (LOGS - ONSET) if life.drift else float(gone > 0)
        now, effects = life.change(own, much)
        now = replace(now, A=now.A * np.exp(FRICTION_SCATTER * rng.standard_normal()))
        now = replace(now, Rm=now.Rm * np.exp(WINDING_SCATTER * rng.standard_normal()))
        pitch, speed = rng.uniform(-8.0, 8.0), float(rng.choice([205.0, 300.0, 410.0]))
        profile = there_and_back((speed, speed), (2.0, 2.0), (pitch, pitch))
        spec = TruthSpec(
            profile, now, effects=effects, logger=Logger(rate_hz=400.0), start_integral_rad=draw_rest_integral(rng, now, pitch)
        )  # fmt: skip
        log = log_from_frame(make_log(spec, int(rng.integers(1 << 31)))[0], f"{k + 1:04d}.csv")
        day = (datetime(2026, 1, 1) + timedelta(days=2 * k)).isoformat()
        found.append(replace(digest_of(log, rig), time=day))
    return found


def row_of(name: str, life: Life, seed: int, rate: float) -> list[str]:
    """What was found in one life, beside the truth."""
    t = trend(digests_of(life, seed), load_rig(), rate)
    changed = [int(j.digest.path[:4]) for j in t.logs if j.verdict == CHANGED]
    false = sum(k <= ONSET or not life.right for k in changed)
    words = [f"{f.kind} {f.name} {_size(f.size, f.before, f.unit)} since {f.row + 1}" for f in t.findings]
    said = "; ".join(words)
    return [name, str(seed), said or "–", _verdict(life, t), str(len(changed) - false), str(false)]


def _size(size: float, before: float, unit: str) -> str:
    return f"{100.0 * size / before:+.1f} %" if abs(before) > abs(size) else f"{size:+.2g} {unit}"


def _verdict(life: Life, t: Trend) -> str:
    """Whether the change that was made is named, of its kind, within five logs, and nothing else."""
    if not life.right:
        return "right" if not t.findings else "false alarm"
    named = [f for f in t.findings if f.name in life.right]
    if not named:
        return "missed" if not t.findings else "wrong"
    wrong = "" if len(named) == len(t.findings) else ", and more"
    late = min(abs(f.row - ONSET) for f in named)
    return ("right" if late <= 5 else f"named, onset {late} logs off") + wrong


def main() -> None:
    """Every kind of life, some seeds each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lives", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=70_000)
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--out", type=Path, default=Path("reports/trend_lives.md"))
    args = parser.parse_args()
    rows = []
    for name, life in LIVES.items():
        for seed in range(args.first_seed, args.first_seed + args.lives):
            rows.append(row_of(name, life, seed, args.rate))
            print(rows[-1], flush=True)
    head = ["life", "seed", "found", "judged", "logs changed since the onset", "false"]
    args.out.write_text(TEXT.format(table=markdown_table(head, rows), onset=ONSET + 1, rate=args.rate))


TEXT = """# What changed: simulated lives

Written by `pipelines/trend_lives.py` against the independent truth of `tests/hidden`. Forty logs of five seconds a life,
the first thirteen taken as healthy; what happens begins at log {onset}; false alarms at {rate:g} a log. Friction and
winding scatter by 2 % from log to log, pitch and speed are drawn anew for each.

{table}
"""

if __name__ == "__main__":
    main()
