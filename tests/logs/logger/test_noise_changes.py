"""Noise that changes while a motor runs steadily is told with its size and time; chance, and what comes with motion, is none."""

import numpy as np
import pytest

from observer_fi.logs import noise_change, shown_by

RATE = 1600.0
T = np.arange(7000) / RATE  # s
W = np.where((T > 0.3) & (T < 4.0), 300.0, 0.0)  # rad/s


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(T.size)


def test_noise_that_stays_as_it_is_tells_no_change() -> None:
    assert all(noise_change(T, noise(seed), W) is None for seed in range(100))


@pytest.mark.parametrize("factor", [0.02, 0.5, 2.5, 12.0])
def test_a_change_is_told_with_its_size_and_time(factor: float) -> None:
    found = noise_change(T, noise(7) * np.where(T < 2.1, 1.0, factor), W)
    assert found is not None
    assert found.factor == pytest.approx(factor, rel=0.25)  # six stretches, known to 5 % each
    assert found.at_s == pytest.approx(2.1, abs=2.0 * found.within_s)


def test_a_burst_that_is_over_is_told() -> None:
    found = noise_change(T, noise(8) * np.where((T > 1.5) & (T < 1.8), 5.0, 1.0), W)
    assert found is not None and (found.factor > 3.0 or found.factor < 1.0 / 3.0)


def test_noise_that_comes_with_the_motion_or_its_speed_is_no_change() -> None:
    fast = np.where((T > 2.0) & (T < 4.0), 400.0, W)
    assert noise_change(T, noise(9) * np.where(W == 0.0, 1.0, 6.0), W) is None
    assert noise_change(T, noise(9) * (1.0 + fast / 50.0), fast) is None


def test_what_moves_and_a_reading_that_jumps_are_no_noise() -> None:
    z = noise(10) + 500.0 * np.sin(2.0 * np.pi * 5.0 * T) + np.where(T < 2.0, 0.0, 50.0)
    assert noise_change(T, z, W) is None


STEPS = [0.5, 1.0, 2.0, 3.5]  # standard deviations of the noise


@pytest.mark.parametrize("step", STEPS)
def test_readings_in_steps_show_a_change_that_is_larger_than_they_are(step: float) -> None:
    for seed in range(20):
        z = noise(seed) * np.where(T < 2.1, 1.0, 6.0) + 0.3 * seed
        found = noise_change(T, in_steps(z, step), W, shown_by(step, moves=False))
        assert found is not None and 1.5 < found.factor < 8.0
        assert found.at_s == pytest.approx(2.1, abs=3.0 * found.within_s)


@pytest.mark.parametrize("step", [*STEPS, 8.0, 50.0])
@pytest.mark.parametrize("a_sample", [0.0, 0.001, 0.37, 3.0])
def test_rounding_to_steps_is_no_change(step: float, a_sample: float) -> None:
    for seed in range(20):
        sways = 20.0 * a_sample * RATE / 400.0 * np.sin(2.0 * np.pi * T / 2.3 + seed)
        z = in_steps(noise(seed) + a_sample * np.arange(T.size) + sways + 0.1 * seed, step)
        assert noise_change(T, z, W, shown_by(step, moves=a_sample > 0.0)) is None


def in_steps(z: np.ndarray, step: float) -> np.ndarray:
    return np.round(z / step) * step
