"""The study of faults of any size: where faults begin, what a move is worth, and its recipe on one move."""

from dataclasses import replace
from pathlib import Path

import hidden
import numpy as np
import pandas as pd
import pytest

from observer_fi.logs import log_from_frame
from pipelines import severity_study
from pipelines.severity_study import SPREAD, Job, drawn, gained, since_begin, since_end, worth


@pytest.mark.parametrize("seed", range(5))
def test_faults_begin_where_their_kind_says(seed: int) -> None:
    specs = {kind: drawn(Job(kind, seed)) for kind in hidden.PLACED_KINDS}
    onset = {kind: float(spec.fault.onset_s or 0.0) for kind, spec in specs.items()}
    start = specs["in_a_start"].profile.moves[0].start_s
    assert start <= onset["in_a_start"] <= start + 0.25
    assert onset["before_the_first_sample"] == 0.0
    forth, back = specs["in_a_rest"].profile.moves
    assert forth.brake_s < onset["in_a_rest"] < back.start_s and forth.speed == -back.speed
    turning = specs["at_a_reversal"]
    each = turning.profile.moves[0].hold_s / 4
    assert abs((onset["at_a_reversal"] - start + each / 2) % each - each / 2) <= 0.02 + 1e-9
    for kind, labels in hidden.PAIRS_OF_FAULTS.items():
        spec = specs[kind]
        assert (spec.fault.label, spec.then.label) == labels
        assert float(spec.then.onset_s or 0.0) >= onset[kind] + 0.4


def test_what_begins_at_rest_may_be_told_until_the_next_motion() -> None:
    spec = drawn(Job("in_a_rest", 3))
    forth, back = spec.profile.moves
    assert since_begin(back.start_s, spec) == 0.0 == since_begin(forth.brake_s + 0.1, spec)
    assert since_begin(back.start_s + 0.05, spec) == pytest.approx(0.05)
    assert since_begin(forth.brake_s - 0.2, spec) == pytest.approx(-0.2)


def test_what_ends_behind_the_stop_is_told_to_last() -> None:
    spec = drawn(Job("coupling_for_a_while", 3))
    stop = spec.profile.moves[-1].brake_s
    within = replace(spec, fault=replace(spec.fault, duration_s=stop - spec.fault.onset_s - 0.1))
    behind = replace(spec, fault=replace(spec.fault, duration_s=stop - spec.fault.onset_s + 0.1))
    assert since_end(stop - 0.09, within) == pytest.approx(0.01) and np.isnan(since_end(None, within))
    assert since_end(None, behind) == 0.0 and since_end(stop - 0.1, behind) == pytest.approx(-0.2)


@pytest.mark.slow
def test_friction_that_rose_at_rest_is_worth_what_no_healthy_rig_has() -> None:
    spec = drawn(Job("in_a_rest", 3))
    level = replace(spec.profile, pitch_steps=((0.0, 1e-6),))
    spec = replace(spec, rig=hidden.TABLE_1, profile=level)
    early = replace(spec, fault=hidden.Fault("jam", 0.0, size=0.2))
    assert worth(early, SPREAD) == pytest.approx(0.5 * (0.2 / 0.1) ** 2, rel=1e-4)
    later = replace(early, fault=replace(early.fault, onset_s=1.0))
    between = replace(early, fault=replace(early.fault, onset_s=spec.fault.onset_s))
    assert worth(later, SPREAD) > 1000.0 and worth(between, SPREAD) > 1000.0  # level, no gravity hides it
    on_a_slope = replace(between, profile=replace(level, pitch_steps=((0.0, 12.0),)))
    assert worth(on_a_slope, SPREAD) < 2.0


@pytest.mark.slow
def test_a_jam_as_the_motion_begins_is_a_rig_that_rubs_more() -> None:
    spec = replace(drawn(Job("jam", 3)), rig=hidden.TABLE_1)
    start = spec.profile.moves[0].start_s
    jam = replace(spec, fault=hidden.Fault("jam", start + 0.0005, size=0.4))
    prior = 0.5 * (0.4 / 0.1) ** 2
    assert worth(jam, SPREAD) == pytest.approx(prior, abs=20.0) and worth(jam, {}) > 1e4
    assert worth(replace(jam, fault=hidden.Fault("jam", start + 0.5, size=0.4)), SPREAD) > 1e4


@pytest.mark.slow
def test_the_recipe_writes_a_row_a_move_and_its_table(tmp_path: Path) -> None:
    rows, out = tmp_path / "rows.csv", tmp_path / "severity.md"
    given = ["--moves", "1", "--shaped", "0", "--kinds", "jam", "--first", "61000", "--workers", "1"]
    assert severity_study.main([*given, "--rows", str(rows), "--out", str(out)]) == 0
    assert pd.read_csv(rows)["kind"].tolist() == ["jam"]
    assert "| jam | 1 | 1 | 100% |" in out.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed", "much"), [("jam", 210001, True), ("in_a_start", 210010, False)])
@pytest.mark.first(1)
def test_what_the_filters_of_the_bank_gain_by_the_true_fault(kind: str, seed: int, much: bool) -> None:
    """In a start they still learn the friction that rises, which truths that know every constant tell apart."""
    spec = drawn(Job(kind, seed))
    log = log_from_frame(hidden.make_log(spec, seed)[0])
    assert (gained(log, spec) >= severity_study.CLEAR_NATS) is much and worth(
        spec, SPREAD
    ) > severity_study.CLEAR_NATS
