"""Verdicts of logs whose channels were put on one table by lines or holds, from readings at times of their own."""

import numpy as np
import pytest
from hidden import draw_move_case, make_log
from other_clocks import on_other_clocks

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG, SETTINGS = load_rig(), Settings()
CLASSES = ("nominal", "overload", "coupling_loss")
KINDS = {
    "position by lines": ((None, None, (20.0, 200.0)), "line"),
    "current by lines": ((None, (150.0, 400.0), None), "line"),
    "all by lines": (((200.0, 500.0), (200.0, 500.0), (50.0, 500.0)), "line"),
    "all held": (((300.0, 500.0), (300.0, 500.0), (80.0, 500.0)), "hold"),
}


def is_right(kind: str, seed: int) -> bool:
    ranges, how = KINDS[kind]
    rng = np.random.default_rng(seed)
    hz = tuple(None if limits is None else float(rng.uniform(*limits)) for limits in ranges)
    frame, _ = make_log(draw_move_case(seed, CLASSES[seed % 3]), seed)
    frame = on_other_clocks(frame, hz, seed, jitter=float(rng.uniform(0.0, 0.2)), how=how)
    found = diagnose_log(log_from_frame(frame), RIG, SETTINGS).isolation
    assert found is not None
    return found.verdict.label == CLASSES[seed % 3]


@pytest.mark.parametrize(("kind", "seed"), list(zip(KINDS, range(73_000, 73_004), strict=True)))
@pytest.mark.first(1)
def test_a_verdict_does_not_depend_on_the_clock_of_the_table(kind: str, seed: int) -> None:
    assert is_right(kind, seed)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("kind", KINDS)
def test_most_verdicts_do_not(kind: str) -> None:
    assert sum(is_right(kind, seed) for seed in range(73_100, 73_118)) >= 17
