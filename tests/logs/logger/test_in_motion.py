"""Noise that comes with the motion is the logger's; noise that begins later, or is over before, is not."""

import numpy as np
import pytest

from observer_fi.logs.logger.in_motion import more_in_motion, quiet_begin

RATE_HZ, START_S, RAMP_S, STOP_S, END_S = 1600.0, 0.4, 0.05, 2.4, 3.0
T = np.arange(0.0, END_S, 1.0 / RATE_HZ)
W_CMD = np.interp(T, [0.0, START_S, START_S + RAMP_S, STOP_S, STOP_S + RAMP_S, END_S], [0, 0, 400, 400, 0, 0])
REST, NOISE = slice(0, int(0.9 * START_S * RATE_HZ)), 1e-3
MOVING = (START_S, STOP_S + RAMP_S)


def readings(seed: int, since: float, until: float, times: float) -> np.ndarray:
    """A current that rings in its start, with `times` its noise from `since` to `until` [s]."""
    rng = np.random.default_rng(seed)
    gone = np.clip(T - START_S, 0.0, None)
    ring = 0.02 * (W_CMD > 0.0) + 0.5 * np.exp(-gone / 0.04) * np.sin(140.0 * gone)
    return ring + NOISE * np.where((since <= T) & (until > T), times, 1.0) * rng.standard_normal(T.size)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("times", [2.0, 4.0, 20.0])
def test_what_comes_with_the_motion_is_told(seed: int, times: float) -> None:
    found = more_in_motion(T, readings(seed, *MOVING, times), W_CMD, REST, NOISE)
    assert found == pytest.approx(times, rel=0.25)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("since", "until"),
    [
        (START_S + 0.1, STOP_S),  # within the ring of the start
        (START_S + 0.15, END_S),
        (START_S, START_S + 1.0),
        (START_S + 0.12, START_S + 0.6),
    ],
)
@pytest.mark.parametrize("times", [4.0, 20.0])
def test_what_begins_later_or_ends_before_is_a_sensor_that_fails(
    seed: int, since: float, until: float, times: float
) -> None:
    assert more_in_motion(T, readings(seed, since, until, times), W_CMD, REST, NOISE) == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_a_sensor_that_stands_still_later_takes_nothing_of_it(seed: int) -> None:
    z = readings(seed, *MOVING, 5.0)
    z[T > 1.5] = z[np.searchsorted(T, 1.5)]
    assert more_in_motion(T, z, W_CMD, REST, NOISE) == pytest.approx(5.0, rel=0.25)


@pytest.mark.parametrize("seed", range(4))
def test_an_ordinary_channel_has_no_more(seed: int) -> None:
    assert more_in_motion(T, readings(seed, *MOVING, 1.0), W_CMD, REST, NOISE) == 1.0


BEGUN = int((START_S + 0.2) * RATE_HZ)  # of a log that begins under way
BEHIND = slice(int((STOP_S + 0.3) * RATE_HZ), T.size)


@pytest.mark.parametrize("seed", range(4))
def test_the_begin_tells_that_a_channel_became_noisy_on_the_way(seed: int) -> None:
    z = readings(seed, 1.4, END_S, 16.0)[BEGUN:]
    quiet = quiet_begin(z, BEHIND.start - BEGUN, 16.0 * NOISE / 8.0)
    assert quiet.start == 0 and quiet.stop / RATE_HZ == pytest.approx(1.4 - BEGUN / RATE_HZ, abs=0.03)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("since", "times"), [(0.0, 16.0), (1.4, 4.0), (START_S + 0.22, 16.0)])
def test_a_noisy_channel_or_another_range_is_the_loggers(seed: int, since: float, times: float) -> None:
    z = readings(seed, since, END_S, times)[BEGUN:]
    assert quiet_begin(z, BEHIND.start - BEGUN, times * NOISE / 8.0).stop == 0


def test_a_sensor_that_stood_still_at_first_was_not_quiet() -> None:
    z = readings(0, 0.0, END_S, 1.0)[BEGUN:]
    z[:800] = z[800]
    assert quiet_begin(z, BEHIND.start - BEGUN, NOISE / 8.0).stop == 0
