"""Onsets recovered within their intervals, from logs of the independent truth and from a likelihood made by hand."""

import numpy as np
import pytest
from hidden import draw_move_case, make_log

from observer_fi.bank.compiled_bank import Bank
from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.rigs import load_rig
from observer_fi.settings import BankSettings
from observer_fi.verdict import onset
from observer_fi.verdict.onset import Filters, Onset, find_onset, onset_in

RIG = load_rig()
SETTINGS = BankSettings()


def found(
    seed: int, label: str, before: float = 0.1, after: float = 0.15, chunk: int | None = None
) -> tuple[float, Onset]:
    """True onset, and the one found between two times around it."""
    frame, truth = make_log(draw_move_case(seed, label), seed)
    log = log_from_frame(frame)
    at = truth["onset_s"]
    last = at + after
    bank = Bank(RIG, SETTINGS)
    step = chunk or log.t.size
    for first in range(0, log.t.size, step):
        part = slice(first, first + step)
        bank.advance(type(log)(log.path, log.t[part], log.z[part], log.w_cmd[part], log.pitch[part]))
        if log.t[part][-1] >= last:
            break
    fault = next(h for h in bank.hypotheses if h.name == label)
    posterior = onset_in(bank, fault, max(at - before, truth["moves"][0]["start_s"]), last)
    assert posterior is not None
    return at, posterior


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("label", "median_ms", "width_ms"), [("overload", 6.0, 40.0), ("coupling_loss", 0.5, 3.0)]
)
def test_onsets_are_found_and_their_intervals_hold_the_truth(
    label: str, median_ms: float, width_ms: float
) -> None:
    """16 seeds: 95 % intervals miss at most 3 (p = 0.007 of more), errors are not on one side."""
    truth, posterior = zip(*(found(seed, label) for seed in range(16)), strict=True)
    at = np.array(truth)
    median, low, high = np.array(posterior).T
    assert ((low <= at) & (at <= high)).sum() >= 13
    assert 1e3 * np.median(np.abs(median - at)) < median_ms
    assert 1e3 * np.median(high - low) < width_ms
    assert (low <= median).all() and (median <= high).all()
    assert 2 <= (median > at).sum() <= 14  # 8 +- 2 expected of an unbiased one


def test_windows_and_chunks_matter_little() -> None:
    at, whole = found(3, "coupling_loss")
    _, chunked = found(3, "coupling_loss", chunk=700)
    _, longer = found(3, "coupling_loss", before=0.3, after=0.3)
    assert chunked == whole
    assert longer.median == pytest.approx(whole.median, abs=3e-4) and abs(whole.median - at) < 2e-3


def test_the_posterior_of_a_likelihood_made_by_hand() -> None:
    t = np.arange(100) / 1000.0
    flat = onset._posterior(t, dict.fromkeys(range(100), 0.0), during=True)
    assert flat.median == pytest.approx(0.049, abs=1e-3)
    assert (flat.low, flat.high) == (
        pytest.approx(0.025 * 0.098, abs=1e-3),
        pytest.approx(0.975 * 0.098, abs=1e-3),
    )
    sharp = {k: 0.0 if k == 40 else -100.0 for k in range(100)}
    plant, sensor = onset._posterior(t, sharp, during=True), onset._posterior(t, sharp, during=False)
    assert plant.median == pytest.approx(0.039) and sensor.median == pytest.approx(0.0395)
    # nothing is known within a sample
    assert plant.high - plant.low == pytest.approx(0.95e-3) and sensor.high - sensor.low == pytest.approx(
        0.95e-3
    )


def test_sparse_samples_stand_for_their_cells() -> None:
    """Every fourth sample of a flat likelihood, and every one of a part of it, are still flat."""
    t = np.arange(101) / 1000.0
    some = {k: 0.0 for k in (*range(0, 101, 4), *range(40, 61))}
    posterior = onset._posterior(t, some, during=True)
    assert posterior.median == pytest.approx(0.05, abs=1.5e-3)
    assert posterior.high - posterior.low == pytest.approx(0.095, abs=2e-3)


def test_a_window_needs_two_samples() -> None:
    frame, _ = make_log(draw_move_case(0, "nominal"), 0)
    bank = Bank(RIG, SETTINGS)
    log = log_from_frame(frame)
    bank.advance(log)
    nominal, fault = bank.hypotheses[:2]
    with pytest.raises(ValueError, match="at least 2 samples, got 1"):
        find_onset(bank.snapshots[0][1], nominal, fault, bank.recent.cut(0, 1), Filters(RIG, SETTINGS))
    assert onset_in(bank, fault, 99.0, 99.5) is None
    assert onset_in(Bank(RIG, SETTINGS), fault, 0.0, 1.0) is None


def test_looking_for_an_onset_leaves_the_bank_alone() -> None:
    frame, truth = make_log(draw_move_case(5, "overload"), 5)
    bank = Bank(RIG, SETTINGS)
    bank.advance(log_from_frame(frame))
    before = [np.array(a) for a in bank.state]
    snapshots = [[np.array(a) for a in s] for _, s in bank.snapshots]
    one = onset_in(bank, bank.hypotheses[1], truth["onset_s"] - 0.1, truth["onset_s"] + 0.2)
    two = onset_in(bank, bank.hypotheses[1], truth["onset_s"] - 0.1, truth["onset_s"] + 0.2)
    assert one == two
    for a, b in zip(before, bank.state, strict=True):
        np.testing.assert_array_equal(a, b)
    for old, (_, new) in zip(snapshots, bank.snapshots, strict=True):
        for a, b in zip(old, new, strict=True):
            np.testing.assert_array_equal(a, b)


def test_filters_that_join_in_one_run_are_those_that_run_one_by_one() -> None:
    """Across a boundary of the room too, where a run is cut in two; memories on the way are those of short runs."""
    frame, _ = make_log(draw_move_case(5, "overload"), 5)
    bank = Bank(RIG, SETTINGS)
    bank.advance(log_from_frame(frame))
    nominal, samples, last = bank.hypotheses[0], [10, 11, 260, 700], 900
    window = bank.recent.cut(0, last)
    filters = Filters(RIG, SETTINGS)
    alone = filters.of(nominal, 1, 300)
    memories, density, misfit = alone.followed(window, bank.snapshots[0][1], [0, *samples, last])
    entered = dict(zip(samples, memories, strict=False))
    together = filters.of(nominal, onset.MOST, 300).joined(window, entered, last)
    for row, first in enumerate(samples):
        alone.begin(entered[first])
        expected = alone.density(window, first, last)[:, 0].copy()
        np.testing.assert_array_equal(together[first - samples[0] :, row], expected)
        np.testing.assert_array_equal(density[first:], expected)
    for left, right in zip(memories[-1], alone.memory(), strict=True):
        np.testing.assert_array_equal(left, right)
    assert (misfit >= 0.0).all() and misfit.size == last
