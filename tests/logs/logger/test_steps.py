"""Steps of readings that are not the same everywhere: ranges that switch, codes that never come, dead bands."""

import numpy as np
import pytest
from logged_signals import SIGMA, clean, clock, coloured, signal, stepped, white

from observer_fi.logs.logger.acquisition import acquisition_of
from observer_fi.logs.logger.steps import step_of

SEEDS = range(10)


def voltage(seed: int) -> np.ndarray:
    """(n,) a voltage that goes to 6 V and back, with its noise."""
    t = clock()
    return clean(t)[:, 0] + white(t, seed)[:, 0]


def reported(z: np.ndarray, band: float) -> np.ndarray:
    """(n,) the latest of the readings z (n,) that had changed by more than a dead band."""
    out = np.empty(z.size)
    out[0] = z[0]
    for k in range(1, z.size):
        out[k] = z[k] if abs(z[k] - out[k - 1]) > band else out[k - 1]
    return out


@pytest.mark.parametrize("digits", [8, 9, 10])
def test_a_converter_that_ranges_by_itself_has_the_step_of_its_largest_readings(digits: int) -> None:
    """So many binary digits of every reading, of which the largest, of 6 V, are between 4 and 8 V."""
    for seed in SEEDS:
        z = voltage(seed)
        step = 2.0 ** (np.ceil(np.log2(np.abs(z) + 1e-12)) - digits)
        found = step_of(np.round(z / step) * step)
        assert found == pytest.approx(2.0 ** (3 - digits), rel=1e-6)


def test_the_noise_of_rests_in_a_fine_range_and_the_rounding_of_a_coarse_one_are_added() -> None:
    log = signal(3)
    step = np.where(np.abs(log.z[:, 0]) > 1.0, 0.04, 0.002)
    log.z[:, 0] = np.round(log.z[:, 0] / step) * step
    found = acquisition_of(log, SIGMA).voltage
    assert found.noise_std == pytest.approx(SIGMA[0], rel=0.1) and found.resolution == pytest.approx(0.04)
    assert found.as_white > np.hypot(SIGMA[0], 0.04 / np.sqrt(12.0)) * 0.95


def test_even_steps_are_told_as_they_are_and_readings_without_steps_have_none() -> None:
    t = clock()
    for seed in SEEDS:
        z = voltage(seed)
        assert step_of(z) is None
        assert step_of(coloured(t.size, 0.95, seed)) is None
        for step in (0.005, 0.01, 0.03):
            assert step_of(stepped(z, step)) == pytest.approx(step)


def test_codes_that_never_come_double_the_step() -> None:
    for seed in SEEDS:
        codes = np.round(voltage(seed) / 0.01).astype(int)
        assert step_of(0.01 * codes) == pytest.approx(0.01)
        assert step_of(0.01 * np.where(codes % 4 == 3, codes - 1, codes)) == pytest.approx(0.02)


@pytest.mark.parametrize(("channel", "sigmas"), [(0, 3.0), (2, 3.0), (2, 6.0)])
def test_a_dead_band_is_a_step_of_twice_its_width(channel: int, sigmas: float) -> None:
    """Of a voltage that stands at two levels, and of a position that moves on."""
    t = clock()
    for seed in SEEDS:
        z, band = (clean(t) + white(t, seed))[:, channel], sigmas * SIGMA[channel]
        assert step_of(reported(z, band)) == pytest.approx(2.0 * band, rel=0.1)


def test_a_channel_of_zeros_has_no_step() -> None:
    assert not step_of(np.zeros(400))
