"""Whether a rest may be one of a drive that is switched off: what no all-clear and no doubt may be made of."""

import numpy as np
import pytest

from observer_fi.verdict.drive_off import goes_off, may_be_off, until_off, zero_of

NO_ZERO = np.full(2, np.nan)


@pytest.mark.parametrize("noise", [(0.02, 3e-4), (0.5, 0.05)])
@pytest.mark.parametrize("seed", range(3))
def test_a_drive_that_holds_is_on_and_one_that_reads_nothing_may_be_off(
    seed: int, noise: tuple[float, float]
) -> None:
    scale = np.array(noise)
    reading = scale * np.random.default_rng(seed).standard_normal((200, 2))
    assert may_be_off(reading, scale, NO_ZERO)
    assert may_be_off(reading + 3.0 * scale, scale, NO_ZERO)  # offsets of the readings
    assert not may_be_off(reading + np.array([6.0, 20.0]) * scale, scale, NO_ZERO)  # a holding current
    assert not may_be_off(
        np.column_stack([np.full(200, np.nan), reading[:, 1] + 20.0 * scale[1]]), scale, NO_ZERO
    )  # no voltage is logged


def test_readings_that_nobody_has_leave_it_open() -> None:
    assert may_be_off(np.full((50, 2), np.nan), np.ones(2), NO_ZERO)


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
    assert goes_off(reading, noise, at, 1.0 / hz, NO_ZERO)
    assert not goes_off(reading, noise, 2 * at, 1.0 / hz, NO_ZERO)  # there it is off already
    held = reading + np.array([0.2, 10e-3])
    assert not goes_off(held, noise, at, 1.0 / hz, NO_ZERO)
    assert not goes_off(reading[: at + 10], noise, at, 1.0 / hz, NO_ZERO)  # too few samples to say so


@pytest.mark.parametrize("offset", [(0.3, 0.0), (0.0, -5e-3), (-0.4, 20e-3)])
def test_nothing_is_what_was_read_before_the_first_move_too(offset: tuple[float, float]) -> None:
    """Zero offsets of any size, where the rest before shows the same; a holding current is another one."""
    noise, rng = np.array([0.01, 3e-4]), np.random.default_rng(2)
    before = noise * rng.standard_normal((200, 2)) + np.array(offset)
    stop = noise * rng.standard_normal((300, 2)) + np.array(offset)
    stop[:80] += np.array([-2.0, -0.12])
    zero = zero_of(before)
    assert 70 <= until_off(stop, noise, 1.0 / 1600.0, zero) <= 80
    assert until_off(stop, noise, 1.0 / 1600.0, NO_ZERO) == 300
    assert may_be_off(stop, noise, zero) and goes_off(stop, noise, 80, 1.0 / 1600.0, zero)
    held = stop + np.array([0.2, 10e-3])
    assert until_off(held, noise, 1.0 / 1600.0, zero) == 300 and not may_be_off(held, noise, zero)


def test_a_log_that_begins_in_motion_has_no_rest_before() -> None:
    assert np.isnan(zero_of(np.empty((0, 2)))).all()
