"""Truth against the diffusion test: one row a case, and the table of `reports/freed.md`."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import hidden
import numpy as np

from observer_fi.improve import LOOKS_LIKE, WANTED_NATS, free_equations, refitted
from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig


@dataclass(frozen=True)
class FreedCase:
    """A hidden cause (empty: none), its size, seed and equations; the equation freed first (empty: none), those that count
    as close to it, the gains [nats] of the best and of each equation, and the seconds of the test.
    """

    cause: str
    size: float
    seed: int
    equations: list[str]
    first: str
    close: list[str]
    gain: float
    gains: dict[str, float]
    seconds: float


def run_case(cause: str, size: float, seed: int) -> FreedCase:
    """One row; cause empty: nothing is hidden."""
    frame, _ = hidden.make_log(hidden.draw_effects_case(seed, (cause,) if cause else (), size), seed)
    equations = sorted(hidden.ALL[cause].equations) if cause else []
    experiment, baseline = refitted([log_from_frame(frame)], load_rig())
    began = time.perf_counter()
    rows, _ = free_equations(experiment, baseline)
    seconds = time.perf_counter() - began
    first = next((row.equation for row in rows if row.verdict == "first"), "")
    close = [row.equation for row in rows if row.verdict == "close" and row.equation != "sensor:pitch"]
    gains = {row.equation: round(row.gain, 1) for row in rows}
    return FreedCase(cause, size, seed, equations, first, close, rows[0].gain, gains, seconds)


def right(case: FreedCase) -> bool:
    """The hidden equation is first."""
    return case.first in case.equations


def declared(case: FreedCase) -> bool:
    """The first is the hidden equation, or one that is declared to look like it."""
    return any(_stands_for(case.first, e) for e in case.equations)


def among_the_close(case: FreedCase) -> bool:
    """The hidden equation, or one declared to look like it, is first or close to the first."""
    return any(_stands_for(f, e) for e in case.equations for f in (case.first, *case.close))


def _stands_for(first: str, equation: str) -> bool:
    return first == equation or equation in LOOKS_LIKE.get(first, ())


def summary(cases: Sequence[FreedCase]) -> str:
    """The text of `reports/freed.md`."""
    controls = [c for c in cases if not c.cause]
    hidden = [c for c in cases if c.cause]
    seeds = sorted({c.seed for c in cases}) or [0]
    alarms = sum(bool(c.first) for c in controls)
    most = max((c.gain for c in controls), default=0.0)
    lines = [
        "# Which equation the data want to free",
        "",
        f"Made by `pipelines/freed_study.py` from an independent truth, seeds {seeds[0]} to {seeds[-1]}.",
        "Sizes are in units of the detectable one (50 standard deviations of the noise over a whole log).",
        "",
        f"Controls: {alarms} of {len(controls)} want any equation free; the largest gain is {most:.1f} nats, the",
        f"threshold {WANTED_NATS:g}.",
        f"Seconds a log, median on a busy machine: {np.median([c.seconds for c in cases]) if cases else 0.0:.1f}.",
        "",
        "Wanted: some equation gains more than the threshold. First: the hidden equation gains most. Declared: the first is",
        "the hidden equation or one that is declared to look like it. Close: such a one is first, or close to it.",
        "",
        "| size | hidden | equation | cases | wanted | first | declared | close | what else came first |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for size in sorted({c.size for c in hidden}, reverse=True):
        for cause in dict.fromkeys(c.cause for c in hidden):
            lines += _line([c for c in hidden if c.cause == cause and c.size == size], size)
        lines += _line([c for c in hidden if c.size == size and c.first], size, "all that want any")
    return "\n".join(lines) + "\n"


def _line(cases: Sequence[FreedCase], size: float, name: str = "") -> list[str]:
    if not cases:
        return []
    wrong = sorted({c.first for c in cases if c.first and not right(c)})
    equations = "" if name else ", ".join(cases[0].equations)
    counts = " | ".join(str(sum(map(test, cases))) for test in (_wanted, right, declared, among_the_close))
    return [
        f"| {size:g} x | {name or cases[0].cause} | {equations} | {len(cases)} | {counts} | {', '.join(wrong)} |"
    ]


def _wanted(case: FreedCase) -> bool:
    return bool(case.first)
