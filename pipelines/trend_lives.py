"""Simulated lives of an actuator against the independent truth of tests/hidden: writes reports/trend_lives.md.

    python -m pipelines.trend_lives [--actuators 5] [--logs 200] [--first-seed 70000] [--rate 0.001] [--kept FOLDER] [--out FILE]
        [--lives NAME ...] [--orders 8]

Each actuator lives eight times: once unchanged, seven times with a change at half of its logs; the logs before are the same.
Friction and winding scatter by 2 % from log to log, and pitch and speed differ: what changes must stand out from that. With
`--kept`, what each log tells is read from there if it was made before.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden import Effect, Logger, Rig, TruthSpec, draw_rest_integral, draw_rig, effect, make_log
from hidden.profiles import there_and_back

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.report import markdown_table
from observer_fi.trend import CHANGED, Digest, Trend, digest_of, from_plain, to_plain, trend

UNCHANGED = "none"
FRICTION_SCATTER, WINDING_SCATTER = 0.02, 0.02
ORDERS = 8  # in which an actuator's healthy logs are told as lives without change
SUBSTEP_HZ = 16_000.0  # of the truth: at 48 kHz a log's constants differ by a thousandth of their errors
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
    UNCHANGED: Life(_nothing, False, ()),
    "slow wear of friction": Life(_rig(A=0.25), True, ("A",)),
    "step of friction": Life(_rig(A=0.12), False, ("A",)),
    "growing backlash": Life(_effect("backlash", width=8e-5), True, ("backlash",)),
    "warming": Life(_rig(Rm=0.12), True, ("Rm",)),
    "changed load": Life(_rig(B=0.3), False, ("torque_offset", "B")),
    "position sensor replaced": Life(_effect("position_gain", gain=0.02), False, ("D",)),
    "current sensor replaced": Life(_effect("current_gain", gain=0.05), False, ("Ki", "Kp", "J", "A", "Rm")),
}


# --- the logs of a life -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Actuator:
    """One actuator, drawn by its seed, with so many logs a life. kept: folder of what its logs told before, None for none."""

    seed: int
    logs: int
    kept: Path | None = None

    @property
    def onset(self) -> int:
        """Row of the first changed log."""
        return self.logs // 2

    def lives(self, names: Sequence[str]) -> Iterator[tuple[str, list[Digest]]]:
        """The lives of these names: the unchanged one, and those that change at the onset."""
        healthy = self._digests(UNCHANGED, range(self.logs))
        for name in names:
            late = [] if name == UNCHANGED else self._digests(name, range(self.onset, self.logs))
            yield name, [*healthy[: self.logs - len(late)], *late]

    def _digests(self, name: str, rows: range) -> list[Digest]:
        place = (
            None
            if self.kept is None
            else self.kept / f"{self.seed}-{self.logs}-{name.replace(' ', '_')}.json"
        )
        if place is not None and place.is_file():
            return [from_plain(d) for d in json.loads(place.read_text())]
        found = [self._digest(LIVES[name], k) for k in rows]
        if place is not None:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(json.dumps([to_plain(d) for d in found]))
        return found

    def _digest(self, life: Life, k: int) -> Digest:
        own = draw_rig(np.random.default_rng([self.seed, 16]), 2.0)
        rng = np.random.default_rng([self.seed, 16, k, list(LIVES.values()).index(life)])
        gone = max(k - self.onset + 1, 0)
        much = gone / (self.logs - self.onset) if life.drift else float(gone > 0)
        now, effects = life.change(own, much)
        now = replace(now, A=now.A * np.exp(FRICTION_SCATTER * rng.standard_normal()))
        now = replace(now, Rm=now.Rm * np.exp(WINDING_SCATTER * rng.standard_normal()))
        pitch, speed = rng.uniform(-8.0, 8.0), float(rng.choice([205.0, 300.0, 410.0]))
        profile = there_and_back((speed,), (2.0,), (pitch,))
        spec = TruthSpec(
            profile, now, effects=effects, logger=Logger(rate_hz=400.0), substep_hz=SUBSTEP_HZ,
            start_integral_rad=draw_rest_integral(rng, now, pitch),
        )  # fmt: skip
        log = log_from_frame(make_log(spec, int(rng.integers(1 << 31)))[0], f"{k + 1:04d}.csv")
        return replace(digest_of(log, load_rig()), time=_day(k))


def _day(k: int) -> str:
    """One log every second day."""
    return (datetime(2026, 1, 1) + timedelta(days=2 * k)).isoformat()


def reordered(healthy: list[Digest], seed: int) -> list[Digest]:
    """The same logs as a life in which they came in another order."""
    order = np.random.default_rng(seed).permutation(len(healthy))
    return [replace(healthy[j], path=f"{k + 1:04d}.csv", time=_day(k)) for k, j in enumerate(order)]


# --- what was found ---------------------------------------------------------------------------------


class Told(NamedTuple):
    """What was found in one life: its name, the actuator's seed, in words, the judgement, rows from the true onset to the one
    found (None where none is right) and whether the interval given holds it, logs changed since the onset, false ones, and how
    many logs could be false: those after the baseline and before the onset.
    """

    life: str
    seed: int
    words: str
    judged: str
    late: int | None
    inside: bool
    changed: int
    false: int
    of: int


def told(name: str, seed: int, digests: list[Digest], onset: int, rate: float) -> Told:
    """What was found in one life, beside the truth."""
    life, t = LIVES[name], trend(digests, load_rig(), rate)
    onset = onset if life.right else len(digests)
    learned = len(t.baseline.reference.paths)
    changed = [k for k, j in enumerate(t.logs) if j.verdict == CHANGED]
    words = "; ".join(
        f"{f.kind} {f.name} {_size(f.size, f.before, f.unit)} since {f.row + 1}" for f in t.findings
    )
    named = [f for f in t.findings if f.name in life.right]
    best = min(named, key=lambda f: abs(f.row - onset), default=None)
    false = sum(learned <= k < onset for k in changed)
    return Told(
        name, seed, words or "–", _judged(life, t, bool(named)), None if best is None else best.row - onset,
        best is not None and best.low <= onset <= best.high, sum(k >= onset for k in changed), false, onset - learned,
    )  # fmt: skip


def _size(size: float, before: float, unit: str) -> str:
    return f"{100.0 * size / before:+.1f} %" if abs(before) > abs(size) else f"{size:+.2g} {unit}"


def _judged(life: Life, t: Trend, named: bool) -> str:
    """Whether the change that was made is named, and nothing else."""
    if not life.right:
        return "false alarm" if t.findings else "right"
    if not named:
        return "wrong" if t.findings else "missed"
    return "right" if all(f.name in life.right for f in t.findings) else "named, and more"


def summary(rows: list[Told]) -> list[list[str]]:
    """A row for each kind of life."""
    found = []
    for name in dict.fromkeys(r.life for r in rows):
        same = [r for r in rows if r.life == name]
        late = [r.late for r in same if r.late is not None]
        near, inside = (
            f"{n} of {len(late)}" for n in (sum(abs(k) <= 5 for k in late), sum(r.inside for r in same))
        )
        found.append([
            name, str(len(same)), str(sum(r.judged == "right" for r in same)), str(sum(r.judged in RIGHT for r in same)),
            near if late else "–", inside if late else "–", f"{sum(r.false for r in same)} of {sum(r.of for r in same)}",
        ])  # fmt: skip
    return found


RIGHT = ("right", "named, and more")
HEAD = [
    "life",
    "lives",
    "right",
    "named",
    "onset within five logs",
    "onset in its interval",
    "logs falsely changed",
]
HEAD_EACH = ["life", "seed", "found", "judged", "onset off by", "logs changed since the onset", "false"]


def rows_of(
    actuator: Actuator, rate: float, names: Sequence[str] = tuple(LIVES), orders: int = ORDERS
) -> Iterator[Told]:
    """Lives of an actuator, and its unchanged one in other orders."""
    for name, digests in actuator.lives(names):
        yield told(name, actuator.seed, digests, actuator.onset, rate)
        for k in range(1, orders if name == UNCHANGED else 1):
            yield told(name, actuator.seed, reordered(digests, k), actuator.onset, rate)


def report(rows: list[Told], logs: int, rate: float, orders: int = ORDERS) -> str:
    """The page of the study as far as it has come."""
    each = [
        [r.life, str(r.seed), r.words, r.judged, "–" if r.late is None else f"{r.late:+d}", str(r.changed), str(r.false)]
        for r in rows
        if r.life != UNCHANGED or r.judged != "right"
    ]  # fmt: skip
    tables = (markdown_table(HEAD, summary(rows)), markdown_table(HEAD_EACH, each))
    return TEXT.format(
        summary=tables[0], each=tables[1], logs=logs, onset=logs // 2 + 1, rate=rate, orders=orders
    )


def main() -> None:
    """Every kind of life of some actuators; the report is written anew after each life."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--actuators", type=int, default=5)
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=70_000)
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--lives", nargs="+", choices=tuple(LIVES), default=tuple(LIVES))
    parser.add_argument("--orders", type=int, default=ORDERS)
    parser.add_argument("--out", type=Path, default=Path("reports/trend_lives.md"))
    args = parser.parse_args()
    rows: list[Told] = []
    for seed in range(args.first_seed, args.first_seed + args.actuators):
        for row in rows_of(Actuator(seed, args.logs, args.kept), args.rate, args.lives, args.orders):
            rows.append(row)
            print(row, flush=True)
            args.out.write_text(report(rows, args.logs, args.rate, args.orders))


TEXT = """# What changed: simulated lives

Written by `pipelines/trend_lives.py` against the independent truth of `tests/hidden`. A life is {logs} logs of five seconds, no
baseline given (the first logs are it); what happens begins at log {onset}; false alarms at {rate:g} a log. Friction and winding
scatter by 2 % from log to log, pitch and speed are drawn anew for each. An actuator's lives share the logs before the change; its
unchanged life is told in {orders} order(s) of its logs.

{summary}

"Right": the change that was made is named, and nothing else; "named": whatever else is. An interval is that of `since_interval`.
A log is falsely changed after the baseline and before the onset.

Each life, unchanged ones only where something was found:

{each}
"""

if __name__ == "__main__":
    main()
