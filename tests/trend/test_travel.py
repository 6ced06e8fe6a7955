"""Quantities of logs of current and position at 25 samples a second, simulated by three lines of physics."""

import numpy as np
import pytest
from trend_logs import cycle_frame

from observer_fi.logs import log_from_frame
from observer_fi.trend import digest_of, from_plain, rig_without_constants, to_plain
from observer_fi.trend.ripple import lines_of, quantities


def cycle(seed=0, **given):
    return log_from_frame(cycle_frame(seed, **given), "cycle")


def values(digest):
    return dict(zip(digest.names, digest.value.tolist(), strict=True))


@pytest.mark.parametrize("unsigned", [True, False])
def test_friction_and_load_come_apart_by_direction(unsigned):
    digest = digest_of(cycle(load_n=400.0, unsigned=unsigned), rig_without_constants())
    std = dict(zip(digest.names, np.sqrt(np.diag(digest.covariance)).tolist(), strict=True))
    found = values(digest)
    assert abs(found["A"] - 0.9) < 0.03
    assert abs(found["torque_offset"] + 0.2) < 4.0 * std["torque_offset"]
    assert digest.conditions["load_n"] == pytest.approx(400.0)
    assert bool(digest.notes) == unsigned  # a magnitude is told


def test_a_ripple_is_found_and_sized():
    digests = [digest_of(cycle(seed, ripple=0.05), rig_without_constants()) for seed in range(6)]
    (period,) = lines_of(d.curve for d in digests)
    assert abs(period - 5e-3) < 1e-4
    names, _, theta, _ = quantities(digests[0].curve, (5e-3,))[0]
    assert names[0] == "ripple_sin_forward@0.005"
    assert abs(theta[0] - 0.05) < 0.01 and abs(theta[1]) < 0.01
    assert lines_of(digest_of(cycle(seed), rig_without_constants()).curve for seed in range(6)) == ()


def test_no_motion_and_one_direction_are_told():
    log = cycle()
    still = log.part(slice(0, 24))
    digest = digest_of(still, rig_without_constants())
    assert digest.names == () and digest.missing["everything"]
    one_way = digest_of(log.part(slice(0, 200)), rig_without_constants())
    assert "A" in one_way.missing and "friction_forward" in one_way.names


def test_a_digest_survives_json():
    import json

    digest = digest_of(cycle(), rig_without_constants())
    again = from_plain(json.loads(json.dumps(to_plain(digest))))
    assert again.names == digest.names and again.conditions == digest.conditions
    assert np.array_equal(again.value, digest.value) and np.array_equal(again.covariance, digest.covariance)
    assert np.array_equal(again.curve.torque, digest.curve.torque)
