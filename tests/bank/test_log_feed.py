"""The command between samples against an analytic trapezoid; whole logs, chunks and single samples alike; gaps filled."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.bank.log_feed import (
    LARGEST,
    LONGEST_S,
    MISSING_PER_SAMPLE,
    MOST_MISSING,
    SETTLING,
    CommandStream,
    LogStream,
    place,
)
from observer_fi.physics.rigs import load_rig, override
from observer_fi.records import Log

MODEL = load_rig().model
ACCEL = MODEL["accel_cmd"]
SUBSTEP_S = 7e-4


def stream(**parameters: float) -> CommandStream:
    return CommandStream(override(MODEL, "fed", **parameters), SUBSTEP_S)


def trapezoid(start: float, brake: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Knots and values of one move."""
    ramp = abs(speed) / ACCEL
    return np.array([-9.0, start, start + ramp, brake, brake + ramp, 9.0]), np.array(
        [0, 0, speed, speed, 0, 0.0]
    )


def area(knots: np.ndarray, values: np.ndarray, until: np.ndarray) -> np.ndarray:
    """Integral of the piecewise linear command up to some times, exact."""
    grid = np.union1d(knots, until)
    w = np.interp(grid, knots, values)
    total = np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(grid))))
    return np.interp(until, grid, total)


# --- corners -------------------------------------------------------------------------------------


@given(
    speed=st.floats(200.0, 410.0), sign=st.sampled_from((-1.0, 1.0)), start=st.floats(0.05, 0.06),
    hold=st.floats(0.03, 0.04), rate=st.sampled_from((800.0, 1600.0, 3200.0)), delay=st.floats(0.0, 0.02),
)  # fmt: skip
def test_command_is_exact_between_samples(
    speed: float, sign: float, start: float, hold: float, rate: float, delay: float
) -> None:
    """Values at the half-steps' edges and the integral over every half-step are those of the trapezoid."""
    t = np.arange(round(0.15 * rate)) / rate
    knots, values = trapezoid(start, start + hold, sign * speed)
    feed = stream(input_delay=delay)
    w, interval = feed.intervals(t, np.interp(t, knots, values))
    np.testing.assert_allclose(w, np.interp(t - delay, knots, values), atol=2e-6 * speed)
    steps = interval.shape[1] // 2
    edges = t[:-1, None] + np.diff(t)[:, None] * np.arange(steps + 1) / steps - delay
    begin, middle = interval[1:, 0::2], interval[1:, 1::2]
    np.testing.assert_allclose(begin, np.interp(edges[:, :-1], knots, values), atol=2e-6 * speed)
    end = np.concatenate((begin[:, 1:], w[1:, None]), axis=1)
    h = np.diff(edges, axis=1)
    simpson = h / 6.0 * (begin + 4.0 * middle + end)
    exact = np.diff(area(knots, values, edges.ravel()).reshape(edges.shape), axis=1)
    np.testing.assert_allclose(simpson, exact, atol=1e-7 * speed * h.max())


def test_a_hold_would_be_half_a_sample_late() -> None:
    """What the corners are for: the error integral of a start is right to 1e-6 of itself, not to half a percent."""
    t = np.arange(160) / 1600.0
    knots, values = trapezoid(0.0502, 9.0, 410.0)
    w = np.interp(t, knots, values)
    _, interval = stream().intervals(t, w)
    integral = ((interval[:, 0] + 4.0 * interval[:, 1] + w) / 6.0)[1:].sum() / 1600.0
    exact = area(knots, values, t[-1:])[0]
    held = w[:-1].sum() / 1600.0
    assert integral == pytest.approx(exact, rel=1e-6) and abs(held - exact) > 4e-3 * exact


def test_steps_are_no_longer_than_asked() -> None:
    for rate, steps in ((3200.0, 1), (1600.0, 1), (1000.0, 2), (400.0, 4), (50.0, 8)):
        feed = stream()
        _, interval = feed.intervals(np.arange(20) / rate, np.zeros(20))
        assert interval.shape == (20, 2 * steps)


def test_a_slower_servo_follows_as_fast_as_it_can() -> None:
    t = np.arange(320) / 1600.0
    w, _ = stream(accel_limit=1e4).intervals(t, np.where(t > 0.05, 300.0, 0.0))
    assert np.diff(w).max() == pytest.approx(1e4 / 1600.0)
    assert w[-1] == 300.0 and np.abs(np.diff(w, 2)).max() <= 1e4 / 1600.0 + 1e-9


def test_a_missing_command_is_no_command() -> None:
    w, interval = stream().intervals(np.arange(20) / 1600.0, np.full(20, np.nan))
    assert not w.any() and not interval.any()


# --- chunks --------------------------------------------------------------------------------------


def moves(rate: float, jitter: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = (np.arange(600) + jitter * rng.uniform(-0.4, 0.4, 600)) / rate
    knots = np.concatenate([trapezoid(a, a + 0.05, s)[0][1:5] for a, s in ((0.03, 410.0), (0.15, -205.0))])
    values = np.concatenate([trapezoid(0.0, 0.05, s)[1][1:5] for s in (410.0, -205.0)])
    return t, np.interp(t, knots, values)


@given(
    cuts=st.lists(st.integers(SETTLING + 1, 599), max_size=6, unique=True), delay=st.sampled_from((0.0, 0.013)),
    limit=st.sampled_from((np.inf, 3e4)), jitter=st.sampled_from((0.0, 1.0)), rate=st.sampled_from((400.0, 1600.0)),
)  # fmt: skip
def test_whole_and_chunks_are_the_same_to_the_last_bit(
    cuts: list[int], delay: float, limit: float, jitter: float, rate: float
) -> None:
    t, command = moves(rate, jitter, 1)
    whole = stream(input_delay=delay, accel_limit=limit).intervals(t, command)
    feed = stream(input_delay=delay, accel_limit=limit)
    pieces = [
        feed.intervals(a, b)
        for a, b in zip(np.split(t, sorted(cuts)), np.split(command, sorted(cuts)), strict=True)
    ]
    for k in range(2):
        np.testing.assert_array_equal(np.concatenate([p[k] for p in pieces]), whole[k])


@pytest.mark.parametrize("delay", [0.0, 0.013])
def test_whole_and_single_samples_are_the_same_to_the_last_bit(delay: float) -> None:
    t, command = moves(1600.0, 1.0, 2)
    whole = stream(input_delay=delay).intervals(t, command)
    feed = stream(input_delay=delay)
    first = SETTLING + 1
    parts = [slice(0, first), *(slice(k, k + 1) for k in range(first, t.size))]
    pieces = [feed.intervals(t[p], command[p]) for p in parts]
    for k in range(2):
        np.testing.assert_array_equal(np.concatenate([p[k] for p in pieces]), whole[k])


def test_a_stream_of_days_needs_no_more_memory() -> None:
    feed = stream(input_delay=0.02)
    rng = np.random.default_rng(3)
    size = 0
    for k in range(50):
        t = (1000 * k + np.arange(1000)) / 1600.0
        feed.intervals(t, np.cumsum(rng.normal(size=1000)))
        size = size or feed.knots.shape[0]
        assert feed.knots.shape[0] == size < 300


# --- gaps ----------------------------------------------------------------------------------------


def log_of(t: np.ndarray, **columns: np.ndarray) -> Log:
    z = columns.get("z", np.column_stack((t, 2.0 * t, 3.0 * t)))
    return Log("log", t, z, columns.get("w_cmd", 100.0 * t), columns.get("pitch", np.zeros(t.size)))


def gapped() -> Log:
    t = np.arange(400) / 1600.0
    return log_of(t[(t < 0.1) | (t > 0.15)])


def test_gaps_are_filled_with_samples_that_say_nothing() -> None:
    log = gapped()
    filled, own = LogStream().take(log)
    np.testing.assert_array_equal(filled.t[own], log.t)
    np.testing.assert_array_equal(filled.z[own], log.z)
    assert np.isnan(filled.z[~own]).all() and (~own).sum() >= 19
    step = np.diff(filled.t)
    assert step.min() > 0.0 and step.max() <= LONGEST_S * (1.0 + 1e-9)
    np.testing.assert_allclose(filled.w_cmd, 100.0 * filled.t, atol=1e-9)


@given(cuts=st.lists(st.integers(SETTLING + 1, 318), max_size=5, unique=True))
def test_gaps_are_filled_alike_in_chunks(cuts: list[int]) -> None:
    log, stream_ = gapped(), LogStream()
    whole, own = LogStream().take(log)
    edges = [0, *sorted(cuts), log.t.size]
    parts = [stream_.take(log_of(log.t[a:b])) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    np.testing.assert_array_equal(np.concatenate([p.t for p, _ in parts]), whole.t)
    np.testing.assert_array_equal(np.concatenate([o for _, o in parts]), own)
    np.testing.assert_allclose(np.concatenate([p.w_cmd for p, _ in parts]), whole.w_cmd, atol=1e-12)


def test_what_cannot_be_a_reading_is_none() -> None:
    t = np.arange(20) / 1600.0
    z = np.ones((20, 3))
    z[3, 1], z[4, 2], z[5, 0] = 2.0 * LARGEST, np.inf, -np.inf
    pitch, w = np.full(20, 5.0), np.full(20, 10.0)
    pitch[[0, 7, 8]], w[6] = np.nan, np.nan
    filled, own = LogStream().take(log_of(t, z=z, pitch=pitch, w_cmd=w))
    assert own.all() and np.argwhere(np.isnan(filled.z)).tolist() == [[3, 1], [4, 2], [5, 0]]
    assert filled.pitch.tolist() == [0.0] + [5.0] * 19  # the latest known, 0 before there is one
    assert filled.w_cmd[6] == 0.0


ODD = (np.nan, np.inf, -np.inf, 181.0, -180.0, LARGEST, 0.01)


@pytest.mark.parametrize(
    "column, odd", [(0, None), (0, 0.01), *((c, odd) for c in range(1, 6) for odd in ODD)]
)
def test_what_is_placed_is_what_a_log_stream_leaves_as_it_is(column: int, odd: float | None) -> None:
    rows = np.random.default_rng(column).normal(size=(20, 6))
    rows[:, 0] = 1.0 + np.arange(20) / 1600.0
    if odd is not None:
        rows[12, column] = rows[12, 0] + odd if column == 0 else odd
    whole, later = LogStream(), slice(10, 20)
    log = Log("rows", rows[:, 0], rows[:, 1:4], rows[:, 5], rows[:, 4])
    whole.take(Log("start", *(a[:10] for a in (log.t, log.z, log.w_cmd, log.pitch))))
    before, longest = whole.t, whole.longest
    taken, own = whole.take(Log("rest", *(a[later] for a in (log.t, log.z, log.w_cmd, log.pitch))))
    t, z, pitch, w = np.empty(10), np.empty((10, 3)), np.empty(10), np.empty(10)
    fits = place(rows[later], before, longest, t, z, pitch, w)
    given = (log.t[later], log.z[later], log.pitch[later], log.w_cmd[later])
    left = own.all() and all(
        np.array_equal(a, b, equal_nan=True)
        for a, b in zip(given, (taken.t, taken.z, taken.pitch, taken.w_cmd), strict=True)
    )
    assert fits == left
    if fits:
        placed = zip((t, z, pitch, w), given, strict=True)
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in placed)


def bursts(count: int, samples: int = 30, pause: float = 1000.0) -> np.ndarray:
    return np.concatenate([k * pause + np.arange(samples) / 1600 for k in range(count)])


def test_a_long_gap_alone_gets_all_its_samples() -> None:
    _, own = LogStream().take(log_of(bursts(2)))
    assert np.count_nonzero(~own) == MOST_MISSING - 1


@pytest.mark.parametrize("cut", [1, 29, 30, 31, 3000])
def test_many_gaps_cost_no_more_than_the_samples_allow_also_in_chunks(cut: int) -> None:
    t = bursts(600)
    filled, own = LogStream().take(log_of(t))
    assert filled.t.size <= MOST_MISSING + (1 + MISSING_PER_SAMPLE) * t.size
    assert np.array_equal(filled.t[own], t) and np.all(np.diff(filled.t) > 0.0)
    chunked = LogStream()
    parts = [chunked.take(log_of(part))[0] for part in np.split(t, range(cut, t.size, cut)[:50])]
    assert np.array_equal(np.concatenate([part.t for part in parts]), filled.t)
