"""Constants of one log of the independent truth: play as it is, and a fit that ends where the truth is."""

import numpy as np
import pytest
from hidden import Logger, TruthSpec, draw_rest_integral, draw_rig, effect, make_log
from hidden.profiles import there_and_back

from observer_fi.learn import identification
from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.trend import digest_of


def told(speed, pitch, seed, width=0.0):
    """Values by name that one log of two reversals or more tells, and the actuator's truth."""
    rng = np.random.default_rng(seed)
    rig = draw_rig(rng, 2.0)
    effects = (effect("backlash", width=width),) if width else ()
    spec = TruthSpec(
        there_and_back((speed, speed), (2.0, 2.0), (pitch, pitch)), rig, effects=effects, logger=Logger(rate_hz=400.0),
        substep_hz=16_000.0, start_integral_rad=draw_rest_integral(rng, rig, pitch),
    )  # fmt: skip
    digest = digest_of(log_from_frame(make_log(spec, seed)[0], "log.csv"), load_rig())
    return dict(zip(digest.names, digest.value.tolist(), strict=True)), rig


@pytest.mark.parametrize("width", [0.0, 2e-5, 6e-5, 1e-4])
def test_play_is_as_wide_as_it_is(width):
    found, _ = told(300.0, 2.0, 3, width)
    # A noise of 10 um tells play to some 3 um; 5 um of it are taken for slack of the start.
    assert abs(found["backlash"] - width) < 9e-6


@pytest.mark.parametrize(("speed", "pitch", "seed"), [(300.0, -5.3, 117), (300.0, -6.5, 4)])
def test_gains_of_closed_forms_that_are_far_off_lead_no_fit_astray(monkeypatch, speed, pitch, seed):
    closed_forms = identification.closed_form_start

    def far_off(material, model):  # as a log's own closed forms were
        steps, start = closed_forms(material, model)
        return steps, {**start, "Kp": 0.38 * model["Kp"], "Ki": 0.73 * model["Ki"]}

    monkeypatch.setattr(identification, "closed_form_start", far_off)
    found, rig = told(speed, pitch, seed)
    assert found["Ki"] == pytest.approx(rig.Ki, rel=0.01)
    assert found["Rm"] == pytest.approx(rig.Rm, rel=0.01)
    assert found["misfit_current"] < np.log(5e-4)  # the noise is 3e-4 A
