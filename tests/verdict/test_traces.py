"""The overview keeps extremes and stays small; what is drawn around a fault is every sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.bank.compiled_bank import Bank
from observer_fi.physics.faults import LABELS
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Estimate, Event, Log, Traces
from observer_fi.settings import BankSettings
from observer_fi.verdict.traces import (
    BUCKETS,
    MORE_A_SECOND,
    MOST_NATS,
    MOST_SAMPLES,
    REMEMBERED_S,
    Evidence,
    Overview,
    Samples,
    as_judged,
    rows,
    since_onsets,
    together,
    unpacked,
)


def table(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([np.arange(n) / 1600.0, rng.normal(size=(n, 3)), np.arange(n)])


def sketched(whole: np.ndarray, *cuts: int) -> np.ndarray:
    overview = Overview()
    for part in np.split(whole, sorted(cuts)):
        overview.add(part[:, 1:4], part.__getitem__)
    return overview.result()


def test_a_short_log_is_kept_whole() -> None:
    whole = table(2 * BUCKETS)
    np.testing.assert_array_equal(sketched(whole), whole)
    np.testing.assert_array_equal(sketched(whole, *range(50, 1200, 50)), whole)


@given(
    n=st.integers(1, 40_000), pieces=st.integers(1, 40),
    spikes=st.lists(st.tuples(st.integers(0, 39_999), st.integers(1, 3)), max_size=5),
)  # fmt: skip
def test_extremes_stay_and_the_sketch_is_small(n: int, spikes: list[tuple[int, int]], pieces: int) -> None:
    whole = table(n)
    for k, (at, channel) in enumerate(spikes):
        whole[at % n, channel] = 100.0 + k
    kept = sketched(whole, *np.random.default_rng(pieces).integers(1, n + 1, pieces - 1))
    assert kept.shape[0] <= 14 * BUCKETS
    assert (np.diff(kept[:, 0]) > 0.0).all()
    np.testing.assert_array_equal(kept, whole[kept[:, 4].astype(int)])  # rows are samples, not means
    for c in (1, 2, 3):
        assert kept[:, c].max() == whole[:, c].max() and kept[:, c].min() == whole[:, c].min()


def test_a_quarter_of_an_hour_is_as_small_as_a_minute() -> None:
    overview = Overview()
    rng = np.random.default_rng(5)
    most = 0
    for k in range(25):
        part = np.column_stack([(57_600 * k + np.arange(57_600)) / 1600.0, rng.normal(size=(57_600, 3))])
        overview.add(part[:, 1:4], part.__getitem__)
        most = max(most, sum(r.size for _, r in overview.kept))
    assert most < 32 * BUCKETS * 4
    t = overview.result()[:, 0]
    assert t[0] == 0.0 and t[-1] > 899.0 and np.diff(t).max() < 2.0 * 900.0 / BUCKETS


def test_missing_samples_do_not_hide_the_others() -> None:
    whole = table(5000)
    whole[::3, 1] = np.nan
    whole[1234, 1] = 50.0
    kept = sketched(whole)
    assert np.nanmax(kept[:, 1]) == 50.0


def test_rows_and_traces_are_each_others_inverse() -> None:
    t = np.arange(60) / 1600.0
    log = Log(
        "log", t, np.random.default_rng(1).normal(size=(60, 3)), np.linspace(0, 9, 60), np.full(60, 2.0)
    )
    rig = load_rig()
    e = Bank(rig, BankSettings()).advance(log)
    m = len(e.modes)
    traces = unpacked(rows(log, e, rig, log.z, np.hstack((e.nis, e.predicted.reshape(60, -1)))), m)
    for name, value in (("t", log.t), ("z", log.z), ("w_cmd", log.w_cmd), ("pitch", log.pitch), ("probability", e.probability),
                        ("predicted", e.predicted), ("normalised", e.normalised),
                        ("evidence", e.nis), ("spared", e.predicted)):  # fmt: skip
        np.testing.assert_array_equal(getattr(traces, name), value)
    w = (log.z[:, 0] - rig.model["Rm"] * log.z[:, 1]) / rig.model["Km"]
    np.testing.assert_allclose(traces.w, w, rtol=1e-12)
    assert traces.norm.shape == traces.w_predicted.shape == (60, m) and traces.mixture_t.size == 0


# --- every sample near what matters ---------------------------------------------------------------


@pytest.mark.parametrize("step", [10_000, 1600, 331])
@pytest.mark.parametrize("span", [(0.0, 0.5), (0.85, 1.45), (2.25, 2.7), (4.8, 9.0)])
def test_every_sample_of_a_span_is_kept_however_the_log_comes(step: int, span: tuple[float, float]) -> None:
    whole, near = table(8000), Samples()
    for first in range(0, 8000, step):
        part = whole[first : first + step]
        near.add(
            part[:, 0], part.__getitem__, [span] if part[-1, 0] >= span[0] else []
        )  # known once it has begun
    inside = (whole[:, 0] >= span[0]) & (whole[:, 0] <= span[1])
    np.testing.assert_array_equal(near.result(), whole[inside])


def test_spans_that_overlap_keep_each_sample_once_and_what_is_kept_is_bounded() -> None:
    whole, near = table(8000), Samples()
    near.add(whole[:, 0], whole.__getitem__, [(1.0, 1.4), (1.2, 1.6)])
    inside = (whole[:, 0] >= 1.0) & (whole[:, 0] <= 1.6)
    np.testing.assert_array_equal(near.result(), whole[inside])
    for k in range(40):
        near.keep([(0.1 * k, 0.1 * k + 0.09)])
    assert MOST_SAMPLES - 200 < len(near.result()) <= MOST_SAMPLES + 5 * MORE_A_SECOND


def test_what_is_told_late_is_kept_as_far_as_it_is_remembered() -> None:
    whole, near = table(8000), Samples()
    near.add(whole[:5000, 0], whole[:5000].__getitem__, [])
    near.add(whole[5000:, 0], whole[5000:].__getitem__, [])
    np.testing.assert_array_equal(near.result()[-1], whole[-1])  # nothing told: the last second
    assert near.result()[0, 0] == pytest.approx(whole[-1, 0] - REMEMBERED_S, abs=1e-3)
    near.keep([(2.0, 3.2)])
    assert near.result()[0, 0] == pytest.approx(whole[4999, 0] - REMEMBERED_S, abs=1e-3)
    assert Samples().result().size == 0


def test_the_log_and_its_samples_are_drawn_as_one() -> None:
    whole = table(8000)
    both = together(whole[::50], whole[1000:1100])
    expected = np.unique(np.concatenate((np.arange(0, 8000, 50), np.arange(1000, 1100))))
    np.testing.assert_array_equal(both, whole[expected])


# --- what samples tell, and what verdicts make of it ---------------------------------------------


def estimate(density: np.ndarray, probability: np.ndarray, active: np.ndarray | None = None) -> Estimate:
    n, m = density.shape
    t = 0.001 * np.arange(n)
    none = np.zeros((n, 3))
    active = np.ones(n, dtype=np.bool_) if active is None else active
    return Estimate(t, MODES[:m], probability, np.zeros((n, m)), np.zeros((n, m, 3)), none, np.zeros((n, 4)), active, density,
                    np.zeros((n, m)))  # fmt: skip


MODES = ("nominal", "overload", "unknown")


@pytest.mark.parametrize("cuts", [[], [7], [1, 2, 40, 63]])
def test_evidence_is_the_sum_of_log_densities_of_the_move_in_motion(cuts: list[int]) -> None:
    rng = np.random.default_rng(3)
    density, active = rng.normal(size=(90, 3)), rng.random(90) > 0.3
    density[5, 1], density[11] = -1e12, np.nan
    e = estimate(density, np.full((90, 3), 1.0 / 3.0), active)
    start = 50
    less = np.nan_to_num(density - density.max(axis=1, keepdims=True)).clip(-MOST_NATS, None)
    less[~active] = 0.0
    expected = np.concatenate((less[:start].cumsum(axis=0), less[start:].cumsum(axis=0)))
    z, std = rng.normal(size=(90, 3)), np.array([1.0, 0.5, 2.0])
    z[3, 1] = np.nan
    half = np.minimum(0.5 * np.nan_to_num(z / std) ** 2, MOST_NATS) * active[:, None]
    left = -np.concatenate(
        (half[:start].cumsum(axis=0), half[start:].cumsum(axis=0))
    )  # the predictions are all 0
    gathered, evidence = [], Evidence()
    for rows_ in np.split(np.arange(90), cuts):
        chosen = np.zeros(90, dtype=np.bool_)
        chosen[rows_] = True
        gathered.append(evidence.add(e.at(chosen), z[chosen], std, [e.t[start]] if start in rows_ else []))
    np.testing.assert_allclose(np.vstack(gathered), np.hstack((expected, left, left, left)), atol=1e-9)


def drawn(probability: np.ndarray, evidence: np.ndarray) -> Traces:
    n, m = probability.shape
    empty = np.zeros((n, m))
    one = np.arange(n) * 0.1
    return Traces(one, np.zeros((n, 3)), one, one, one, probability, np.zeros((n, m, 3)), empty, empty, np.zeros((n, 3)),
                  np.empty(0), np.empty((0, 3)), np.empty((0, 3, 3)), evidence,
                  np.zeros((n, m, 3)), empty)  # fmt: skip


def event(label: str, isolated: float | None, onset: float | None = None) -> Event:
    posterior = dict.fromkeys(LABELS, 0.0) | {label: 0.9, "nominal": 0.1}
    return Event(label, None, 0.9, onset, (None, None), None, isolated, 0.2, 0.8, posterior)


def test_the_verdict_has_the_last_word_in_what_is_drawn() -> None:
    p = np.tile([0.1, 0.9, 0.0], (11, 1))
    for label, isolated, first in (("unknown", 0.5, 5), ("slip", None, 8), ("overload", 0.5, 9)):
        judged = as_judged(drawn(p, p), MODES, [event(label, isolated)])
        assert judged[8].argmax() == LABELS.index(label)  # the end of the move
        assert (judged[:first, LABELS.index("overload")] == 0.9).all() and (
            judged[9:, 1] == judged[0, 1]
        ).all()
        np.testing.assert_allclose(judged.sum(axis=1), 1.0)


def test_evidence_begins_at_the_onset() -> None:
    evidence = np.arange(33.0).reshape(11, 3) ** 2
    traces = drawn(evidence, evidence)
    found = since_onsets(traces.evidence, traces.t, [event("overload", 0.5, 0.4)])
    np.testing.assert_array_equal(found[4:9], evidence[4:9] - evidence[4])
    assert np.isnan(found[:4]).all() and np.isnan(found[9:]).all()
