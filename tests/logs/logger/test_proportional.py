"""Noise that grows with the reading is told from every level of a log; noise that comes and goes at one level is none."""

import numpy as np
import pytest

from observer_fi.logs.logger.proportional import grows_with_reading

RATE_HZ, NOISE = 1600.0, 1e-2
T = np.arange(0.0, 4.0, 1.0 / RATE_HZ)
SHAPES = {
    "trapezoid": np.interp(T, [0.0, 0.5, 0.6, 2.5, 2.6, 4.0], [0.0, 0.0, 9.0, 9.0, 0.0, 0.0]),
    "sine": 6.0 * np.sin(2.0 * np.pi * T / 4.0),
    "staircase": np.interp(T, [0.0, 0.5, 0.55, 1.5, 1.55, 2.5, 2.55, 4.0], [0.0, 0.0, 3.0, 3.0, 6.0, 6.0, 9.0, 9.0]),
    "there and back": np.interp(T, [0.0, 0.2, 0.3, 1.9, 2.1, 3.8, 4.0], [0.0, 0.0, 8.0, 8.0, -8.0, -8.0, 0.0]),
}  # fmt: skip


def readings(shape: str, share: float, seed: int) -> np.ndarray:
    rng, y = np.random.default_rng(seed), SHAPES[shape]
    return y + NOISE * rng.standard_normal(y.size) + share * np.abs(y) * rng.standard_normal(y.size)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", [0.003, 0.01, 0.05])
@pytest.mark.parametrize("seed", range(3))
def test_a_share_of_the_reading_is_found(shape: str, share: float, seed: int) -> None:
    found, more = grows_with_reading(readings(shape, share, seed), NOISE)
    assert found == pytest.approx(share, rel=0.2)
    largest = np.abs(SHAPES[shape]).max()
    assert more == pytest.approx(np.hypot(1.0, share * largest / NOISE), rel=0.25)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(20))
def test_noise_that_is_the_same_at_every_level_does_not_grow(shape: str, seed: int) -> None:
    assert grows_with_reading(readings(shape, 0.0, 100 + seed), NOISE) == (0.0, 1.0)


@pytest.mark.parametrize("shape", ["trapezoid", "there and back"])
@pytest.mark.parametrize(("since", "until"), [(1.5, 4.0), (1.2, 2.0), (0.5, 1.5)])
@pytest.mark.parametrize("times", [4.0, 20.0])
def test_a_sensor_that_becomes_noisy_at_one_level_fails(
    shape: str, since: float, until: float, times: float
) -> None:
    for seed in range(4):
        burst = NOISE * times * np.random.default_rng(200 + seed).standard_normal(T.size)
        z = readings(shape, 0.0, seed) + np.where((since <= T) & (until > T), burst, 0.0)
        assert grows_with_reading(z, NOISE) == (0.0, 1.0)


@pytest.mark.parametrize(
    "z", [np.zeros(0), np.full(400, np.nan), np.zeros(4000), np.full(4000, 3.0), np.arange(10.0)]
)
def test_readings_that_tell_nothing_grow_by_nothing(z: np.ndarray) -> None:
    assert grows_with_reading(z, NOISE) == (0.0, 1.0)
    assert grows_with_reading(z, 0.0) == (0.0, 1.0)
