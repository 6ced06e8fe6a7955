"""The study of real seeded faults, on a few of its cycles: what it flags, and what it leaves alone."""

import os
from pathlib import Path

import pytest

from pipelines.trend_cranfield import BASELINE, RATE_RUNS, FeatureJudge, by_runs, cycles_of, judged, share

DATA = Path(os.environ.get("OBSERVER_FI_DATA", "nowhere")) / "data" / "cranfield"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="needs the Cranfield data (OBSERVER_FI_DATA)")


@pytest.fixture(scope="module")
def normal():
    return cycles_of(DATA / "normal.csv.gz")


@pytest.fixture(scope="module")
def healthy(normal):
    return [c for c in normal if c.run in BASELINE], [c for c in normal if c.run in RATE_RUNS]


@pytest.mark.slow
def test_dry_cycles_are_flagged_for_their_friction_and_healthy_ones_are_not(healthy):
    base, others = healthy
    dry = [c for c in cycles_of(DATA / "lack_lubrication1.csv.gz") if c.load != -40 and c.run <= 2]
    found = judged(dry, base, others, 0.01)
    assert share(found.logs) >= 0.95
    assert share(found.logs) >= FeatureJudge(base, others, 0.01).share(dry) - 0.05
    assert (
        sum(any(m.name == "A" and m.after > m.before for m in j.changed) for j in found.logs) >= len(dry) / 2
    )
    assert share(judged(others, base, others, 0.01).logs) <= 0.05


@pytest.mark.slow
def test_a_load_that_the_baseline_never_had_is_not_tested(healthy):
    base, _ = healthy
    pulling = [c for c in base if c.load == -40][:5]
    found = judged(
        pulling, [c for c in base if c.load != -40], [c for c in base if c.load != -40 and c.run == 5], 0.01
    )
    assert share(found.logs) == 0.0


@pytest.mark.slow
def test_runs_pool_their_cycles(healthy):
    base, _ = healthy
    runs = by_runs(base)
    assert len(runs) == len(base) // 5
    assert runs[0].digest.covariance[0, 0] < base[0].digest.covariance[0, 0]
