"""Whether a rest may be one of a drive that is switched off: what no all-clear and no doubt may be made of."""

import numpy as np
import pytest

from observer_fi.verdict.drive_off import may_be_off


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
