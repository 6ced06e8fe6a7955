"""The overview keeps extremes and stays small; what is drawn around a fault is every sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.bank.compiled_bank import Bank
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.diagnosis import ZOOM_AFTER_S, ZOOM_BEFORE_S, Zoom
from observer_fi.verdict.traces import BUCKETS, Overview, rows, unpacked


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
    traces = unpacked(rows(log, e, rig, log.z), m)
    for name, value in (("t", log.t), ("z", log.z), ("w_cmd", log.w_cmd), ("pitch", log.pitch), ("probability", e.probability),
                        ("predicted", e.predicted), ("normalised", e.normalised)):  # fmt: skip
        np.testing.assert_array_equal(getattr(traces, name), value)
    w = (log.z[:, 0] - rig.model["Rm"] * log.z[:, 1]) / rig.model["Km"]
    np.testing.assert_allclose(traces.w, w, rtol=1e-12)
    assert traces.norm.shape == traces.w_predicted.shape == (60, m) and traces.mixture_t.size == 0


# --- the zoom ------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [10_000, 1600, 331])
@pytest.mark.parametrize("point", [0.05, 1.0, 2.4, 4.95])
def test_the_zoom_holds_every_sample_around_its_point_however_the_log_comes(step: int, point: float) -> None:
    whole, zoom = table(8000), Zoom()
    for first in range(0, 8000, step):
        part = whole[first : first + step]
        zoom.add(
            part[:, 0], part.__getitem__, point if part[-1, 0] >= point else None
        )  # known as soon as it has passed
    t = whole[:, 0]
    near = (t >= point - ZOOM_BEFORE_S) & (t <= point + ZOOM_AFTER_S)
    np.testing.assert_array_equal(zoom.result(), whole[near])


def test_without_a_point_the_zoom_is_the_last_second() -> None:
    whole, zoom = table(8000), Zoom()
    zoom.add(whole[:5000, 0], whole[:5000].__getitem__, None)
    zoom.add(whole[5000:, 0], whole[5000:].__getitem__, None)
    assert zoom.result()[0, 0] == pytest.approx(whole[-1, 0] - 1.0, abs=1e-3)
    assert Zoom().result().size == 0
