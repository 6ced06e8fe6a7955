"""Ripple once a turn of the motor, in logs that are fast enough: size and phase, and what two recordings say of them."""

import numpy as np
import pandas as pd
import pytest

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.trend import digest_of, rig_without_constants, trend

TURN = 2.0 * np.pi * load_rig("emps_published").model["D"]


def recording(seed, size=0.9, phase=0.0, rate=1000.0, noise=0.5, friction=20.0):
    """A carriage of 95 kg, there and back by S-curves of 0.15 m/s, with so much ripple [N] a turn and noise [N]."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 16.0, 1.0 / rate)
    # Its own plant: positions from a sum of smooth steps, forces from Newton and not from any model of the package.
    v = np.zeros(t.size)
    for begin, way in ((1.0, 1.0), (5.0, -1.0), (9.0, 1.0), (12.5, -1.0)):
        rise, fall = (0.5 * (1.0 + np.tanh((t - s) / 0.08)) for s in (begin + 0.4, begin + 2.4))
        v += 0.15 * way * (rise - fall)
    x = np.cumsum(v) / rate
    a = np.gradient(v, t)
    force = 95.0 * a + (
        friction + 100.0 * np.abs(v) + size * np.cos(2.0 * np.pi * x / TURN - phase)
    ) * np.tanh(v / 1e-3)
    frame = pd.DataFrame(
        {
            "time_s": t,
            "force_cmd_n": force + noise * rng.standard_normal(t.size),
            "position_m": x + 5e-8 * rng.standard_normal(t.size),
        }
    )
    return log_from_frame(frame, f"{seed}.csv")


def ripple(digest, way="forward"):
    """Sine and cosine [N] and their standard error."""
    row = {n: k for k, n in enumerate(digest.names)}
    at = [row[f"ripple_{part}_{way}@{TURN:.6g}"] for part in ("sin", "cos")]
    D = load_rig("emps_published").model["D"]
    return digest.value[at] / D, np.sqrt(digest.covariance[at[0], at[0]]) / D


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("size", "phase"), [(0.9, 0.0), (0.9, 2.0), (0.0, 0.0), (6.0, -1.0)])
def test_a_ripple_is_as_large_as_it_is(size, phase, seed):
    digest = digest_of(recording(seed, size, phase), load_rig("emps_published"))
    for way in ("forward", "backward"):
        found, std = ripple(digest, way)
        assert np.abs(found - size * np.array([np.sin(phase), np.cos(phase)])).max() < max(
            4.0 * std, 0.1 * size
        )
        assert std < 0.1


def test_a_logger_of_fifty_samples_a_second_has_none():
    digest = digest_of(recording(1, rate=50.0), load_rig("emps_published"))
    assert digest.names and not [n for n in digest.names if n.startswith("ripple")]


def test_a_travel_per_turn_that_nobody_gave_is_asked_for_nothing():
    log = recording(1)
    frame = pd.DataFrame({"time_s": log.t, "current_a": log.force, "position_m": log.z[:, 2]})
    digest = digest_of(log_from_frame(frame, "x.csv"), rig_without_constants())
    assert digest.names and not [n for n in digest.names if n.startswith("ripple")]


def test_another_phase_is_a_difference_and_no_change():
    rig = load_rig("emps_published")
    digests = [digest_of(recording(k, 6.0, phase), rig) for k, phase in ((1, 0.0), (2, 1.5))]
    told = trend(digests, rig, 1e-3)
    assert not [j for j in told.logs if j.verdict == "changed"]
    (compared,) = told.compared
    differ = [d.name for d in compared.differences if d.differs]
    assert any(n.startswith("ripple") for n in differ) and "A" not in differ
