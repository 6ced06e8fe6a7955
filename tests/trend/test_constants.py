"""Constants of one log of the independent truth: play as it is, and a fit that ends where the truth is."""

from dataclasses import replace

import numpy as np
import pytest
from hidden import Logger, TruthSpec, draw_rest_integral, draw_rig, effect, make_log
from hidden.profiles import there_and_back

from observer_fi.learn import identification
from observer_fi.logs import log_from_frame
from observer_fi.physics import Quantity, load_rig
from observer_fi.trend import constants, digest_of


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
    # A motor that swings back as it stops has taken some 3 um of the play up already.
    assert abs(found["backlash"] - width) < 6e-6


@pytest.mark.slow
def test_no_play_scatters_about_zero_as_little_as_its_reversal_tells():
    found = np.array([told(300.0, 2.0, seed)[0]["backlash"] for seed in range(109200, 109206)])
    assert found.min() < 0.0 < found.max()  # nothing is cut off
    assert np.abs(found).max() < 4e-6  # the position has 10 um of noise


@pytest.mark.parametrize("speed", [205.0, 410.0])
@pytest.mark.slow
@pytest.mark.first(1)
def test_play_does_not_drag_the_travel_per_turn_along(speed):
    for seed in range(109220, 109223):
        tight, loose = (told(speed, 2.0, seed, width)[0]["D"] for width in (0.0, 8e-5))
        assert loose == pytest.approx(tight, rel=1.5e-3)  # without play beside it D fell by 5e-3


def test_a_lag_that_the_log_shows_is_no_play():
    rng = np.random.default_rng(109210)
    t = np.linspace(0.0, 2.0, 800)
    v = 0.02 * np.minimum(1.0, np.minimum(t, 2.0 - t) / 0.5)  # m/s
    x = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))))
    samples = np.full(t.size, 1.0)
    gone, way = np.concatenate([x, x]), np.concatenate([0.0 * samples, -samples])
    others = np.zeros((2 * t.size, 4))
    others[:, 0], others[:, 1] = np.concatenate([-v, v]), np.concatenate([x, -x])
    others[: t.size, 2] = others[t.size :, 3] = 1.0
    for lag, play in ((0.03, 0.0), (0.0, 4e-5), (0.03, 4e-5)):
        left = lag * others[:, 0] - way * np.minimum(gone, play) + 1e-5 * rng.standard_normal(way.size)
        seen = constants.Reversals(left, gone, way, others, np.array([[0.0, 0.0, 0.0, 10.0]]), np.zeros(1))
        theta, covariance = constants.play_and_lag(seen)
        assert abs(theta[0] - play) < 4.0 * np.sqrt(covariance[0, 0]) < 1e-5
        assert abs(theta[1] - lag) < 4.0 * np.sqrt(covariance[1, 1]) < 1e-3


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


@pytest.mark.first(1)
@pytest.mark.parametrize("tau_s", [7e-4, 1.5e-3])
def test_a_winding_of_the_rig_file_is_taken_out(tau_s):
    """An inductance that no equation has shows in the resistance or in the gains of the servo."""
    rng = np.random.default_rng(109230)
    rig = draw_rig(rng, 0.0)
    rig = replace(rig, L=tau_s * (rig.Rm + rig.Rs))
    spec = TruthSpec(
        there_and_back((300.0, 300.0), (2.0, 2.0), (2.0, 2.0)), rig, substep_hz=16_000.0,
        start_integral_rad=draw_rest_integral(rng, rig, 2.0),
    )  # fmt: skip
    log = log_from_frame(make_log(spec, 109230)[0], "log.csv")
    left = []
    for inductance in (None, Quantity(rig.L, "H", "identified")):
        digest = digest_of(log, replace(load_rig(), inductance=inductance))
        found = dict(zip(digest.names, digest.value.tolist(), strict=True))
        left.append([abs(found[name] / getattr(rig, name) - 1.0) for name in ("Rm", "J", "Ki")])
    assert max(left[1]) < 0.03
    assert sum(left[1]) < sum(left[0])
