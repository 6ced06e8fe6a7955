"""Readings that are held until the next one comes, when it may."""

import numpy as np
import pytest
from hidden import draw_move_case, make_log
from other_clocks import on_other_clocks

from observer_fi.logs import acquisition_of, log_from_frame
from observer_fi.logs.logger.readings import Readings
from observer_fi.physics import load_rig

RIG = load_rig()


@pytest.mark.parametrize("jitter", [0.1, 0.35])
@pytest.mark.parametrize("seed", range(72_000, 72_006))
def test_the_pace_of_readings_that_come_when_they_may(seed: int, jitter: float) -> None:
    rate = float(np.random.default_rng(seed).uniform(60.0, 300.0))
    frame, _ = make_log(draw_move_case(seed, "overload"), seed)
    log = log_from_frame(on_other_clocks(frame, (None, rate, rate), seed, jitter=jitter, how="hold"))
    found = acquisition_of(log, RIG.noise_std)
    assert found.voltage.update_hz is None
    taken = Readings(found, log.rate_hz, RIG.noise_std).take(log)
    for c, traits in ((1, found.current), (2, found.position)):
        assert traits.update_hz == pytest.approx(rate, rel=0.03)
        stale = np.append(False, np.diff(log.z[:, c]) == 0.0)
        assert np.isfinite(taken.z[stale, c]).mean() < 1e-3
        assert np.isfinite(taken.z[~stale, c]).all()
