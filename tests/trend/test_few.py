"""Two or three logs: what differs is told in its own standard deviations, and that no scatter is known."""

from dataclasses import replace

import numpy as np
import pytest
from trend_logs import NAMES, SCATTER, VALUE, life, moved, told

from observer_fi.errors import UsageError
from observer_fi.physics import load_rig
from observer_fi.report.trend_page import NO_CHANGE_OF_FEW, page
from observer_fi.trend import CHANGED, NOT_TESTED, UNCHANGED


def shifted(digest, path, **shares):
    """The log again under another name, its quantities larger by shares of their values."""
    factor = np.array([1.0 + shares.get(n, 0.0) for n in NAMES])
    return replace(digest, path=path, time="2027-01-01T00:00:00", value=digest.value * factor)


def test_a_large_change_between_two_logs_is_named_and_sized():
    before = life(21, logs=1)[0]
    t = told([before, shifted(before, "after.csv", A=0.4)])
    assert [j.verdict for j in t.logs] == [UNCHANGED, CHANGED]
    assert [(f.kind, f.name, t.paths[f.row]) for f in t.findings] == [("step", "A", "after.csv")]
    assert "+40 %" in t.findings[0].words and "both directions" in t.findings[0].words
    assert "not known" in t.assumed
    (only,) = t.compared
    first = only.differences[0]
    assert first.name == "A" and first.differs and first.size == pytest.approx(0.4 * before.value[1])
    own = 0.2 * SCATTER[1] * np.sqrt(2.0)
    assert first.std == pytest.approx(own) and first.sigmas == pytest.approx(first.size / own)
    assert not any(d.differs for d in only.differences[1:])


def test_a_difference_beyond_the_noise_alone_is_told_but_no_change():
    before = life(22, logs=1)[0]
    t = told([before, shifted(before, "after.csv", A=0.05)])
    assert [j.verdict for j in t.logs] == [UNCHANGED, UNCHANGED] and t.findings == ()
    assert [d.name for d in t.compared[0].differences if d.differs] == ["A"]
    shown = page(t, "two", [])
    assert (
        f"<h1>{NO_CHANGE_OF_FEW}</h1>" in shown
    )  # "nothing has changed" would be an all-clear for what was not tested
    assert "Beyond the noise of the logs differ friction +5" in shown


def test_noise_alone_differs_in_one_of_a_thousand_pairs():
    rng = np.random.default_rng(0)
    before = life(23, logs=1)[0]
    differ = 0
    for _ in range(25):
        noise = [0.2 * SCATTER * rng.standard_normal(len(NAMES)) for _ in range(2)]
        pair = [replace(before, path=f"{n}.csv", value=VALUE + e) for n, e in enumerate(noise)]
        t = told(pair)
        differ += any(d.differs for d in t.compared[0].differences)
        assert t.findings == ()
    assert differ <= 1


def test_of_three_logs_the_change_begins_where_it_stays():
    before = life(24, logs=1)[0]
    three = [
        before,
        shifted(before, "b.csv", A=0.4),
        replace(shifted(before, "c.csv", A=0.4), time="2027-02-01T00:00:00"),
    ]
    t = told(three)
    assert [t.paths[f.row] for f in t.findings] == ["b.csv"] and len(t.compared) == 2


def test_a_load_that_is_new_is_not_tested():
    before = life(25, logs=1)[0]
    heavy = shifted(before, "after.csv", A=0.2)
    t = told([before, replace(heavy, conditions={**heavy.conditions, "load_n": 400.0})])
    assert t.logs[1].verdict == NOT_TESTED and "load" in t.logs[1].reason


def test_one_log_against_a_rig_file_or_one_healthy_log():
    before = life(26, logs=1)[0]
    worn = shifted(before, "after.csv", A=0.5)
    for given in ({"baseline_rig": load_rig()}, {"healthy": [before]}):
        t = told([worn], **given)
        assert t.logs[0].verdict == CHANGED and t.findings[0].name == "A", given
        assert "A" in {d.name for d in t.compared[0].differences if d.differs}
    sound = told([replace(before, value=VALUE + SCATTER * moved(A=1.0))], baseline_rig=load_rig())
    assert sound.logs[0].verdict == UNCHANGED
    with pytest.raises(UsageError, match="too few"):
        told([worn])
