"""Voltages without what a winding's inductance makes of its current: an RL circuit in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from observer_fi.logs import Uninductive, inductance_of, without_inductance
from observer_fi.physics import Quantity, load_rig
from observer_fi.records import Log

R, L, RATE = 2.0, 3e-3, 2000.0  # ohm, H, Hz
NOISE = np.array([1e-3, 1e-4, 1e-5])


def circuit(noise: float = 0.0) -> Log:
    """A current that rises from rest at 0.2 s within 20 ms, and the voltage of a winding with an inductance."""
    t = np.arange(0.0, 0.6, 1.0 / RATE)
    since = np.maximum(t - 0.2, 0.0)
    i, di = 1.0 - np.exp(-since / 0.02), np.where(since > 0.0, np.exp(-since / 0.02) / 0.02, 0.0)
    rng = np.random.default_rng(0)
    z = np.column_stack((R * i + L * di, i, np.zeros(t.size))) + noise * rng.normal(size=(t.size, 3)) * NOISE
    return Log("circuit", t, z, np.where(since > 0.0, 100.0, 0.0), np.zeros(t.size))


def test_what_is_left_is_the_voltage_of_the_resistance() -> None:
    log = circuit()
    z = Uninductive(L, NOISE, 1.0 / RATE).take(log).z
    known = np.isfinite(z[:, 0])
    np.testing.assert_allclose(z[known, 0], R * log.z[known, 1], atol=1.5 * NOISE[0])
    assert (z[:, 1:] == log.z[:, 1:]).all()


def test_where_the_current_bends_at_once_the_voltage_is_missing() -> None:
    log = circuit()
    missing = np.flatnonzero(np.isnan(Uninductive(L, NOISE, 1.0 / RATE).take(log).z[:-1, 0]))
    corner = int(np.searchsorted(log.t, 0.2))
    assert corner in missing and missing.size < 12
    assert np.abs(missing - corner).max() <= 6


def test_chance_alone_leaves_no_reading_out() -> None:
    log = circuit(noise=1.0)
    still = log.t < 0.19
    assert np.isfinite(Uninductive(L, NOISE, 1.0 / RATE).take(log).z[still, 0]).mean() > 0.98


def test_no_inductance_changes_nothing() -> None:
    log = circuit()
    assert Uninductive(0.0, NOISE, 1.0 / RATE).take(log) is log


@pytest.mark.parametrize("size", [1, 7, 100])
def test_a_stream_is_the_same_in_any_pieces(size: int) -> None:
    log = circuit(noise=1.0)
    whole, pieces = (Uninductive(L, NOISE, 1.0 / RATE, causal=True) for _ in range(2))
    for one in (whole, pieces):
        one.take(log.part(slice(0, 300)))
    parts = [pieces.take(log.part(slice(k, k + size))).z for k in range(300, log.t.size, size)]
    np.testing.assert_array_equal(np.concatenate(parts), whole.take(log.part(slice(300, None))).z)


def test_chunks_lack_no_more_than_their_last_reading() -> None:
    log = circuit()
    one, two = (Uninductive(L, NOISE, 1.0 / RATE) for _ in range(2))
    whole = one.take(log).z[:, 0]
    parts = np.concatenate([two.take(log.part(slice(k, k + 250))).z[:, 0] for k in range(0, log.t.size, 250)])
    both = np.isfinite(parts) & np.isfinite(whole)
    np.testing.assert_allclose(parts[both], whole[both], rtol=1e-12)
    assert np.count_nonzero(np.isfinite(whole) & ~both) <= 3 * -(-log.t.size // 250)


def test_a_missing_sample_leaves_its_neighbours_without_a_rate() -> None:
    log = circuit()
    rows = np.delete(np.arange(log.t.size), 900)
    z = Uninductive(L, NOISE, 1.0 / RATE).take(log.part(rows)).z
    assert np.isnan(z[899:901, 0]).all() and np.isfinite(z[890:898, 0]).all()


def test_a_whole_log_for_fits_misses_nothing() -> None:
    log = circuit()
    z = without_inductance(log, L).z
    assert np.isfinite(z).all()
    np.testing.assert_allclose(z[500:-1, 0], R * log.z[500:-1, 1], atol=NOISE[0])


def test_an_inductance_that_settles_long_before_the_next_sample_is_none() -> None:
    rig = load_rig()
    assert inductance_of(rig, RATE) == 0.0
    small, large = (replace(rig, inductance=Quantity(tau * rig.model["Rm"], "H")) for tau in (1e-6, 1e-3))
    assert inductance_of(small, RATE) == 0.0
    assert inductance_of(large, RATE) == large.inductance.value  # type: ignore[union-attr]


def test_a_voltage_that_stands_still_in_motion_stays_as_it_is() -> None:
    log = circuit(noise=1.0)
    z = log.z.copy()
    z[600:, 0] = z[600, 0]
    taken = Uninductive(L, NOISE, 1.0 / RATE).take(replace(log, z=z)).z
    assert (taken[620:, 0] == z[600, 0]).all()
    assert (taken[550:600, 0] != z[550:600, 0]).any()
