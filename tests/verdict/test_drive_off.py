"""Whether a rest may be one of a drive that is switched off: what no all-clear and no doubt may be made of."""

import numpy as np
import pytest

from observer_fi.verdict.drive_off import goes_off, may_be_off


@pytest.mark.parametrize("noise", [(0.02, 3e-4), (0.5, 0.05)])
@pytest.mark.parametrize("seed", range(3))
def test_a_drive_that_holds_is_on_and_one_that_reads_nothing_may_be_off(
    seed: int, noise: tuple[float, float]
) -> None:
    scale = np.array(noise)
    reading = scale * np.random.default_rng(seed).standard_normal((200, 2))
    assert may_be_off(reading, scale)
    assert may_be_off(reading + 3.0 * scale, scale)  # offsets of the readings
    assert not may_be_off(reading + np.array([6.0, 20.0]) * scale, scale)  # a holding current
    assert not may_be_off(
        np.column_stack([np.full(200, np.nan), reading[:, 1] + 20.0 * scale[1]]), scale
    )  # no voltage is logged


def test_readings_that_nobody_has_leave_it_open() -> None:
    assert may_be_off(np.full((50, 2), np.nan), np.ones(2))


@pytest.mark.parametrize("hz", [500.0, 1600.0, 5000.0])
@pytest.mark.parametrize("last", [(0.06, -6e-3), (0.0, 20e-3), (1.5, 0.0)])
def test_where_both_become_nothing_for_good_the_drive_may_have_gone_off(
    hz: float, last: tuple[float, float]
) -> None:
    """While the motor rings, too: no drop of more than what a ring passes through."""
    noise, count = np.array([0.01, 3e-4]), round(0.2 * hz)
    at = count // 3
    reading = noise * np.random.default_rng(1).standard_normal((count, 2))
    reading[:at] += np.linspace(4.0, 1.0, at)[:, None] * np.array(last)
    assert goes_off(reading, noise, at, 1.0 / hz)
    assert not goes_off(reading, noise, 2 * at, 1.0 / hz)  # there it is off already
    held = reading + np.array([0.2, 10e-3])
    assert not goes_off(held, noise, at, 1.0 / hz)
    assert not goes_off(reading[: at + 10], noise, at, 1.0 / hz)  # too few samples to say so
