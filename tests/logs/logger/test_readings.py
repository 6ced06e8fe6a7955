"""What filters may take of readings: held ones once a tick, coarse standing ones ever more rarely, everything else as it is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from logged_signals import RATE, SIGMA, clean, clock, held, log_of, signal, stepped

from observer_fi.logs.logger.readings import Readings
from observer_fi.records import Acquisition, ChannelTraits, Clock, Log

IDEAL = ChannelTraits(0.0, 0.0)
CLOCK = Clock(0.0, None, 1.0 / RATE)


def readings(position: ChannelTraits = IDEAL, voltage: ChannelTraits = IDEAL) -> Readings:
    return Readings(Acquisition(voltage, IDEAL, position, CLOCK), RATE, SIGMA)


def fresh(z: np.ndarray, traits: ChannelTraits, t: np.ndarray | None = None) -> np.ndarray:
    """Samples whose position is taken; z: (n,) readings of the position."""
    t = np.arange(z.size) / RATE if t is None else t
    table = np.column_stack((np.zeros(z.size), np.zeros(z.size), z))
    out = readings(traits).take(Log("log", t, table, np.zeros(z.size), np.zeros(z.size)))
    assert np.array_equal(out.z[:, :2], table[:, :2])
    return np.flatnonzero(np.isfinite(out.z[:, 2]))


def held_at(hz: float) -> ChannelTraits:
    return ChannelTraits(1e-5, 1e-5, update_hz=hz)


COARSE = ChannelTraits(1e-5, 1e-4, resolution=1e-4)


def test_plain_readings_are_the_very_log() -> None:
    log = signal(1)
    assert readings().plain and readings().take(log) is log
    fine = ChannelTraits(
        1e-5, 1e-5, resolution=1.9e-5
    )  # steps within two sigma are noise, not standing readings
    assert readings(fine).plain
    assert not readings(held_at(100.0)).plain and not readings(COARSE).plain


@pytest.mark.parametrize("hz", [400.0, 100.0, 60.0, 230.0])
def test_a_held_reading_counts_when_it_is_fresh(hz: float) -> None:
    at = held(2000, RATE / hz, 0.4)
    z = np.random.default_rng(2).standard_normal(2000)[at]
    changes = np.flatnonzero(np.diff(z, prepend=np.nan) != 0.0)
    taken = fresh(z, held_at(hz))
    assert np.isin(changes, taken).all()
    assert taken.size <= changes.size + 1


def test_a_frozen_sensor_still_gives_a_reading_a_tick() -> None:
    """At 100 Hz every 16 samples: that it did not change may be a sensor that has died."""
    z = np.random.default_rng(3).standard_normal(800)[held(800, 16.0)]
    z[400:] = z[399]
    taken = fresh(z, held_at(100.0))
    assert np.array_equal(taken, np.arange(0, 800, 16))


@given(hz=st.floats(5.0, 1500.0), seed=st.integers(0, 99))
def test_a_frozen_sensor_is_read_no_more_often_than_it_could_be_fresh(hz: float, seed: int) -> None:
    n = 3000
    at = fresh(np.full(n, float(seed)), held_at(hz))
    assert at[0] == 0
    assert (np.diff(at) >= math.ceil(RATE / hz - 1e-3) - 1).all() and at.size >= n // math.ceil(RATE / hz)


def test_coarse_readings_that_stand_count_at_powers_of_four() -> None:
    z = np.repeat([1.0, 2.0, 3.0], [100, 3, 40])
    runs = [0, *(4**k for k in range(4))], [100, 101], [103, *(103 + 4**k for k in range(3))]
    assert fresh(z, COARSE).tolist() == [k for run in runs for k in run]


def test_coarse_and_held_ones_at_ticks_that_are_powers_of_four() -> None:
    assert fresh(np.ones(200), COARSE._replace(update_hz=100.0)).tolist() == [0, 16, 64]


def test_a_reading_that_is_not_there_is_none_and_ends_no_run() -> None:
    z = np.ones(80)
    z[5:30] = np.nan
    assert fresh(z, held_at(100.0)).tolist() == [
        0,
        30,
        32,
        48,
        64,
    ]  # at 30 the tick of 16 is still to be seen
    assert fresh(np.full(80, np.nan), held_at(100.0)).size == 0


def test_missing_rows_do_not_move_the_ticks() -> None:
    kept = np.random.default_rng(4).random(1600) > 0.1
    kept[0] = True
    taken = fresh(np.ones(1600)[kept], held_at(100.0), (np.arange(1600) / RATE)[kept])
    tick = np.flatnonzero(kept)[taken] // 16
    assert np.unique(tick).size == tick.size == 100


def test_a_log_is_not_written_to() -> None:
    log = signal(5)
    before = log.z.copy()
    assert readings(held_at(100.0)).take(log) is not log and np.array_equal(log.z, before)


@given(
    cuts=st.lists(st.integers(1, 999), max_size=12),
    hz=st.sampled_from((None, 60.0, 100.0)),
    coarse=st.booleans(),
)
def test_chunks_make_no_difference(cuts: list[int], hz: float | None, coarse: bool) -> None:
    t = clock(1000 / RATE)
    z = clean(clock())[1100:2100].copy()
    z[:, 2] = stepped(z[:, 2][held(1000, RATE / (hz or RATE))], 1e-4)
    z[300:320, 2] = np.nan
    log = log_of(t, z)
    traits = ChannelTraits(1e-5, 1e-4, 1e-4 if coarse else None, hz)
    one, many = readings(traits), readings(traits)
    edges = [0, *sorted(set(cuts)), 1000]
    parts = [
        many.take(replace(log, t=t[a:b], z=z[a:b], w_cmd=log.w_cmd[a:b], pitch=log.pitch[a:b]))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    np.testing.assert_array_equal(np.concatenate([part.z for part in parts]), one.take(log).z)


@pytest.mark.parametrize("cut", [0, 400, 503, 505])
def test_a_coarse_reading_that_stands_through_a_new_command_counts_again(cut: int) -> None:
    """A frozen voltage in steps of three sigma had counted four times in a rest, and was an all-clear."""
    n, taken, w = 2000, readings(COARSE), np.zeros(2000)
    w[500:504], w[504:] = (50.0, 100.0, 150.0, 180.0), 200.0
    log = Log("log", np.arange(n) / RATE, np.full((n, 3), 0.3), w, np.zeros(n))
    parts = [taken.take(log.part(part)) for part in (slice(0, cut), slice(cut, n)) if part.stop > part.start]
    seen = np.flatnonzero(np.isfinite(np.concatenate([part.z[:, 2] for part in parts])))
    assert seen[seen > 256].tolist() == [505, 506, 509, 521, 569, 761, 1529]
