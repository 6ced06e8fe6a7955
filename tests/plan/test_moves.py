"""Blocks end where they begin, profiles keep the limits, and the corners are what a simulation plays."""

import numpy as np
import pytest

from observer_fi.errors import UsageError
from observer_fi.physics import load_rig, with_values
from observer_fi.plan.limits import limits_of
from observer_fi.plan.moves import (
    LEAD_S,
    corners_of,
    excursion,
    family,
    in_order,
    seconds_of,
    standard,
    total_seconds,
)

RIG = load_rig()


@pytest.fixture(scope="module", params=[None, (-2e-4, 1e-4), (-1e-5, 5e-4)], ids=["free", "down", "up"])
def limits(request):
    return limits_of(RIG, 10.0, (0.0, 8.0), travel=request.param)


def test_every_block_ends_where_it_began_and_keeps_within_the_travel(limits):
    blocks = family(limits)
    assert len(blocks) > 10
    for block in blocks:
        t, w = corners_of([block], limits.accel)
        travelled = float(np.sum(0.5 * (w[1:] + w[:-1]) * np.diff(t)))
        assert abs(travelled) < 1e-9 * limits.speed
        low, high = excursion([block], limits)
        assert limits.low <= low and high <= limits.high


def test_every_block_keeps_speed_acceleration_and_time(limits):
    for block in family(limits):
        t, w = corners_of([block], limits.accel)
        assert np.abs(w).max() <= limits.speed * (1.0 + 1e-12)
        assert np.abs(np.diff(w) / np.diff(t)).max() <= limits.accel * (1.0 + 1e-6)
        assert t[-1] <= limits.seconds
        assert t[-1] == pytest.approx(LEAD_S + seconds_of(block, limits.accel))


def test_the_usual_moves_fill_the_time_at_one_speed(limits):
    blocks = standard(limits)
    assert len(set(blocks)) == 1
    one = seconds_of(blocks[0], limits.accel)
    assert limits.seconds - one < total_seconds(blocks, limits.accel) <= limits.seconds


def test_pitch_changes_as_seldom_as_it_can(limits):
    blocks = in_order(
        tuple(np.random.default_rng(0).permutation(np.array(family(limits), dtype=object))), limits
    )
    pitches = [b.pitch for b in blocks]
    assert sum(a != b for a, b in zip(pitches[:-1], pitches[1:], strict=True)) == 1


def test_a_slow_ramp_lengthens_a_block():
    slow = limits_of(with_values(RIG, {"accel_cmd": 600.0}), 20.0)
    fast = limits_of(RIG, 20.0)
    a, b = standard(slow)[0], standard(fast)[0]
    assert seconds_of(a, slow.accel) == pytest.approx(
        seconds_of(b, fast.accel) + 4 * slow.speed * (1 / 600.0 - 1 / 6e4)
    )


@pytest.mark.parametrize(
    "wrong",
    [
        {"seconds": 0.5}, {"seconds": float("nan")}, {"pitches": ()}, {"pitches": (200.0,)}, {"speed": 2000.0}, {"speed": 0.0},
        {"travel": (1e-3, 2e-3)}, {"travel": (0.0, 0.0)}, {"rate_hz": 0.0},
    ],
)  # fmt: skip
def test_impossible_limits_are_refused(wrong):
    with pytest.raises(UsageError):
        limits_of(RIG, **wrong)


def test_a_drive_that_cannot_be_simulated_is_refused():
    with pytest.raises(UsageError, match="servo"):
        limits_of(load_rig("emps"))


def test_the_stops_of_the_rig_are_the_travel():
    rig = with_values(RIG, {"x_stop_low": -1e-3, "x_stop_high": 2e-3})
    limits = limits_of(rig, travel=(-5e-3, 1e-3))
    assert (limits.low, limits.high) == (-1e-3, 1e-3)
