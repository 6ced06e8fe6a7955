"""Constants from campaigns whose voltage or current is a running mean: what it is the mean of is fitted."""

import hidden
import numpy as np
import pandas as pd
import pytest

from observer_fi.learn import identified_rig, identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig

CONSTANTS = ("Rm", "Km", "A", "J", "Kp", "Ki")


def off(frame: pd.DataFrame, truth: hidden.Rig) -> float:
    """The largest relative error of the constants that a campaign tells."""
    model = identified_rig(identify([log_from_frame(frame)], load_rig()), load_rig()).model
    return max(abs(model[name] / getattr(truth, name) - 1.0) for name in CONSTANTS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "column", "samples", "centred"),
    [(78_000, "current_a", 16, False), (78_001, "voltage_v", 9, True)],
)
@pytest.mark.first(1)
def test_a_running_mean_changes_no_constant(seed: int, column: str, samples: int, centred: bool) -> None:
    spec = hidden.draw_effects_case(seed, (), 0.0)
    frame, _ = hidden.make_log(spec, seed)
    mean = frame[column].rolling(samples, center=centred, min_periods=1).mean()
    assert off(frame.assign(**{column: mean}), spec.rig) < 2e-3
    assert np.isfinite(mean).all()
