"""A log on the clock that its logger meant: even stamps where they were rounded, and unread rows where some are missing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged_signals import ACCEL, SPEED, clean, clock, command, white

from observer_fi.logs.logger.clock import LONGEST_S, by_rows, even, on_its_clock
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.records import SAMPLES, Log

RIG = with_values(load_rig(), {"accel_cmd": ACCEL})
RATES = (200.0, 400.0, 800.0, 1600.0)


def whole(rate: float, seed: int, start: float = 0.7) -> Log:
    """Every column there is; the command leaves its rest at `start`, wherever that is between two samples."""
    t = clock(3.0, rate)
    line = 0.1 * t - 2.0
    return Log(
        "whole", t, clean(t) + white(t, seed), command(t, start), line, encoder=3.0 * line, force=np.sin(t),
        position_cmd=-line, load=5.0 * line, notes=("a note",),
    )  # fmt: skip


def without(log: Log, lost: np.ndarray) -> Log:
    return replace(log, **{name: getattr(log, name)[~lost] for name in SAMPLES})


def some(n: int, share: float, seed: int) -> np.ndarray:
    """(n,) rows to lose, never the first nor the last, which no gap would show."""
    lost = np.random.default_rng(seed).random(n) < share
    lost[[0, -1]] = False
    return lost


# --- rows that are missing -----------------------------------------------------------------------


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("jitter", [0.0, 0.05])
def test_a_log_with_nothing_missing_is_the_very_log(rate: float, jitter: float) -> None:
    for seed in range(5):
        log = whole(rate, seed)
        late = jitter / rate * np.random.default_rng(seed).standard_normal(log.t.size).clip(-3.0, 3.0)
        log = replace(log, t=log.t + late)
        assert on_its_clock(log, RIG) is log


@given(
    rate=st.sampled_from(RATES),
    share=st.floats(1e-3, 0.2),
    start=st.floats(0.5, 0.9),
    seed=st.integers(0, 999),
)
def test_missing_rows_come_back_unread_with_the_command_that_was(
    rate: float, share: float, start: float, seed: int
) -> None:
    log = whole(rate, seed, start)
    lost = some(log.t.size, share, seed)
    back = on_its_clock(without(log, lost), RIG)
    np.testing.assert_allclose(back.t, log.t, atol=1e-12)
    np.testing.assert_allclose(back.w_cmd, log.w_cmd, atol=1e-9 * SPEED)
    assert np.isnan(back.z[lost]).all() and np.isnan(back.force[lost]).all()
    for name in ("pitch", "encoder", "position_cmd", "load"):  # straight lines here, and so between rows
        np.testing.assert_allclose(getattr(back, name), getattr(log, name), atol=1e-9)


@pytest.mark.parametrize("rate", RATES)
def test_rows_beside_the_corners_may_be_lost(rate: float) -> None:
    """A corner within a gap follows from the acceleration."""
    for start in np.random.default_rng(round(rate)).uniform(0.6, 0.8, 8):
        log = whole(rate, 1, start)
        ramp = SPEED / ACCEL
        corners = np.array([start, start + ramp, 1.7, 1.7 + ramp])
        lost = (np.abs(log.t[:, None] - corners) < 1.0 / rate).any(axis=1)
        assert lost.sum() >= 6
        back = on_its_clock(without(log, lost), RIG)
        np.testing.assert_allclose(back.w_cmd, log.w_cmd, atol=1e-9 * SPEED)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("seed", range(3))
def test_rows_that_are_there_stay_to_the_last_bit(rate: float, seed: int) -> None:
    log = whole(rate, seed)
    lost = some(log.t.size, 0.05, seed)
    cut = without(log, lost)
    kept = {name: getattr(cut, name).copy() for name in SAMPLES}
    back = on_its_clock(cut, RIG)
    for name in SAMPLES:
        np.testing.assert_array_equal(getattr(back, name)[~lost], kept[name])
        np.testing.assert_array_equal(getattr(cut, name), kept[name])  # nor is the argument written to
    assert (back.path, back.notes) == (log.path, log.notes)
    assert on_its_clock(back, RIG) is back


def test_columns_that_a_log_has_not_it_still_has_not() -> None:
    log = whole(400.0, 1)
    cut = without(log, some(log.t.size, 0.05, 1))
    bare = on_its_clock(replace(cut, encoder=None, force=None, position_cmd=None, load=None), RIG)
    assert bare.t.size == log.t.size
    assert (bare.encoder, bare.force, bare.position_cmd, bare.load) == (None,) * 4


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("seed", range(3))
def test_a_clock_that_jitters_counts_its_missing_rows_too(rate: float, seed: int) -> None:
    log = whole(rate, seed)
    late = 0.05 / rate * np.random.default_rng([seed, 1]).standard_normal(log.t.size).clip(-3.0, 3.0)
    lost = some(log.t.size, 0.03, seed)
    back = on_its_clock(without(replace(log, t=log.t + late), lost), RIG)
    assert np.abs(back.t - log.t).max() < 0.2 / rate  # three standard deviations are 0.15
    np.testing.assert_array_equal(np.isnan(back.z).all(axis=1), lost)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("at", [0.3, 1.2, 2.5])
def test_a_longer_gap_stays(rate: float, at: float) -> None:
    log = whole(rate, 1)
    for seconds, closed in ((0.8 * LONGEST_S, True), (1.2 * LONGEST_S, False)):
        lost = (log.t > at) & (log.t < at + seconds - 1.0 / rate)
        cut = without(log, lost)
        back = on_its_clock(cut, RIG)
        assert back.t.size == log.t.size if closed else back is cut


def test_a_command_that_was_not_logged_is_not_made_up() -> None:
    log = whole(400.0, 2)
    cut = without(replace(log, w_cmd=np.full(log.t.size, np.nan)), some(log.t.size, 0.05, 2))
    back = on_its_clock(cut, RIG)
    assert back.t.size == log.t.size and np.isnan(back.w_cmd).all()


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_a_log_of_no_clock_stays_as_it_is(n: int) -> None:
    log = whole(400.0, 3).part(slice(0, n))
    assert on_its_clock(log, RIG) is log


# --- stamps that were rounded --------------------------------------------------------------------


def test_rounded_stamps_of_an_even_clock_are_made_even() -> None:
    true = clock(2.0, 800.0) + 3.0
    out = even(np.round(true, 3), 1.0 / 800.0, 1e-3)
    assert np.abs(out - true).max() < 0.51e-3  # a phase within a stamp's step cannot be known
    assert np.ptp(out - true) < 1e-5 and (np.diff(out) > 0.0).all()


@given(share=st.floats(0.0, 0.1), seed=st.integers(0, 50))
def test_also_where_rows_are_missing(share: float, seed: int) -> None:
    true = clock(2.0, 800.0)
    true = true[~some(true.size, share, seed)]
    out = even(np.round(true, 3), 1.0 / 800.0, 1e-3)
    assert np.abs(out - true).max() < 0.6e-3
    assert np.ptp(out - true) < 5e-5 and (np.diff(out) > 0.0).all()


@given(seed=st.integers(0, 50), wander=st.floats(0.0, 0.3))
def test_a_clock_that_is_not_even_stays_as_it_is(seed: int, wander: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(1.25e-3 * (1.0 + wander * rng.uniform(-1.0, 1.0, 900)))
    stamps = np.unique(np.round(t, 3))
    out = even(stamps, 1.25e-3, 1e-3)
    assert (np.diff(out) > 0.0).all()
    off = t - np.polyval(np.polyfit(np.arange(t.size), t, 1), np.arange(t.size))
    if np.abs(off).max() > 2e-3:
        assert out is stamps


def test_few_stamps_and_steps_of_a_whole_interval_stay_as_they_are() -> None:
    t = np.round(clock(2.0, 800.0), 3)
    assert even(t[:99], 1.25e-3, 1e-3).base is t or np.array_equal(even(t[:99], 1.25e-3, 1e-3), t[:99])
    assert even(t, 1e-3, 1e-3) is t


@pytest.mark.parametrize("rate", [700.0, 800.0, 900.0])
@pytest.mark.parametrize("begin", [0.0, 0.37e-3, 11.0])
def test_a_whole_log_gets_its_even_clock_back_and_no_row(rate: float, begin: float) -> None:
    """Gaps between rounded stamps are none: of those of 800 Hz every fourth is twice as long."""
    log = whole(rate, 1)
    true = log.t + begin
    back = on_its_clock(replace(log, t=np.round(true, 3)), RIG)
    assert np.ptp(np.diff(back.t)) < 1e-9
    assert np.abs(back.t - true).max() < 0.51e-3
    np.testing.assert_array_equal(back.z, log.z)
    np.testing.assert_array_equal(back.w_cmd, log.w_cmd)


# --- stamps that say when rows came --------------------------------------------------------------


def arrived(t: np.ndarray, packet: int, seed: int) -> np.ndarray:
    """(n,) stamps of rows that come in packets: when the last row of each was read, and up to some ms later."""
    row = np.arange(t.size)
    late = np.random.default_rng(seed).exponential(3e-4, t.size // packet + 1)
    return (
        t[np.minimum(row // packet * packet + packet - 1, t.size - 1)]
        + 2e-5 * (row % packet)
        + late[row // packet]
    )


STAMPS = {
    "packets": lambda t: arrived(t, 16, 1),
    "whole milliseconds": lambda t: np.round(t, 3),
    "ticks of 15.6 ms": lambda t: np.floor(t / 0.015625) * 0.015625,
    "seconds of a day in 32 bits": lambda t: (t + 5e4).astype(np.float32).astype(float),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_rows_that_came_together_are_set_on_an_even_clock(kind: str) -> None:
    """Whatever the chunks: intervals within a thousandth of what they were, which later stamps change by little."""
    t = clock(20.0)
    stamps = STAMPS[kind](t)
    told = by_rows(stamps[:1800])
    assert told is not None
    whole = told.take(stamps)
    again = by_rows(stamps[:1800])
    assert np.array_equal(np.concatenate([again.take(part) for part in np.array_split(stamps, 37)]), whole)
    apart = np.diff(whole)
    assert apart.mean() == pytest.approx(1.0 / 1600.0, rel=1e-4)
    assert np.abs(apart * 1600.0 - 1.0).max() < 0.03
    assert np.ptp(whole - t) < 4e-3


def test_a_clock_behind_a_gap_goes_on_where_its_stamps_do() -> None:
    t = clock(4.0)
    t[3200:] += 5.0
    stamps = arrived(t, 16, 2)
    told = by_rows(stamps[:1800]).take(stamps)
    assert (np.diff(told) > 0.0).all() and np.abs(told - t).max() < 0.02


@pytest.mark.parametrize("seed", range(5))
def test_single_stamps_are_taken_as_they_are(seed: int) -> None:
    """Even ones, jitter, missing rows, rows that stand twice, a stamp that is far off."""
    t, rng = clock(2.0), np.random.default_rng(seed)
    assert by_rows(t) is None
    assert by_rows(np.sort(t + 5e-5 * rng.standard_normal(t.size))) is None
    assert by_rows(t[rng.random(t.size) > 0.1]) is None
    assert by_rows(np.sort(np.concatenate((t, rng.choice(t, 300))))) is None
    assert by_rows(np.append(t[:-1], 1e9)) is None


@pytest.mark.parametrize("rate", [320.0, 900.0, 1600.0])
@pytest.mark.parametrize(("write", "begin"), [("{:.7g}", 0.0), ("{:.6g}", 0.0), ("{:.5f}", 3.0)])
def test_stamps_of_so_many_digits_are_those_of_an_even_clock(rate: float, write: str, begin: float) -> None:
    """Seven digits hold microseconds before ten seconds, and ten of them from there on: too little to be seen as rounding."""
    long = begin + np.arange(int(14.0 * rate)) / rate
    stamped = np.array([float(write.format(stamp)) for stamp in long])
    assert np.abs(stamped - long).max() > 1e-6
    nothing = np.zeros(long.size)
    again = on_its_clock(Log("long", stamped, np.zeros((long.size, 3)), nothing, nothing), RIG).t
    assert again.size == long.size and np.abs(again - long).max() < 1e-7


@pytest.mark.parametrize("seed", range(3))
def test_a_clock_that_jitters_by_more_than_its_stamps_are_rounded_stays_as_it_is(seed: int) -> None:
    log = whole(1600.0, seed=seed)
    t = np.round(log.t + np.random.default_rng(seed).normal(0.0, 2e-5, log.t.size), 5)
    assert on_its_clock(replace(log, t=t), RIG).t is t
