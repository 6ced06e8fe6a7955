"""Which equation the data want to free: the one that was made wrong, and none where nothing is."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG, campaign

from observer_fi.improve.freed.freed_equations import CLOSE_SHARE, WANTED_NATS, climb
from observer_fi.improve.freed.smoothed_disturbance import free_equations
from observer_fi.improve.improvement import refitted
from observer_fi.physics.rigs import with_values
from observer_fi.records import Log


def hide(cause: str, seed: int, size: float = 3.0) -> Log:
    spec = hidden.draw_effects_case(seed, (cause,) if cause else (), size)
    frame, _ = hidden.make_log(spec, seed)
    z = frame[["voltage_v", "current_a", "position_m"]].to_numpy()
    w_cmd, pitch = frame["speed_cmd_rad_s"].to_numpy(), frame["pitch_deg"].to_numpy()
    return Log(cause, frame["time_s"].to_numpy(), z, w_cmd, pitch)


# The independent truth; seeds on which thresholds were set. The second of a pair is declared to look like the first.
@pytest.mark.slow
@pytest.mark.parametrize(
    "cause, equations",
    [
        pytest.param("shaft_ripple", {"torque"}, marks=pytest.mark.slow),
        pytest.param("winding_heating", {"electrical"}, marks=pytest.mark.slow),
        pytest.param("current_offset", {"sensor:current"}, marks=pytest.mark.slow),
        ("current_lag", {"servo"}),
    ],
)
@pytest.mark.first(1)
def test_the_hidden_equation_comes_first(cause, equations):
    rows, disturbances = free_equations(*refitted([hide(cause, 9000)], RIG))
    assert rows[0].verdict == "first" and rows[0].equation in equations
    assert [row.gain for row in rows] == sorted((row.gain for row in rows), reverse=True)
    assert disturbances[0].gain <= rows[0].gain
    assert all(row.rms > 0.0 for row in rows if row.verdict != "no")


@pytest.mark.slow
def test_nothing_hidden_nothing_wanted():
    rows, disturbances = free_equations(*refitted([hide("", 9002)], RIG))
    assert {row.verdict for row in rows} == {"no"}
    assert disturbances == ()
    assert rows[0].gain < 0.5 * WANTED_NATS


@pytest.mark.slow
def test_the_pitch_sensor_stands_beside_a_load_torque():
    rows, _ = free_equations(*refitted([hide("torque_offset", 9000)], RIG))
    torque, pitch = (next(r for r in rows if r.equation == e) for e in ("torque", "sensor:pitch"))
    assert (torque.verdict, pitch.verdict) == ("first", "close")
    assert pitch.gain == pytest.approx(torque.gain, rel=CLOSE_SHARE)
    assert pitch.rms == pytest.approx(torque.rms / RIG.model["B"], rel=0.3)


@pytest.mark.slow
def test_a_position_gain_is_told_with_the_screw():
    rows, _ = free_equations(*refitted([hide("position_gain", 9000)], RIG))
    told = {row.equation for row in rows if row.verdict in ("first", "close")}
    assert told == {"kinematics", "sensor:position"}


@pytest.mark.slow
def test_an_extended_rig_that_has_the_effect_wants_less():
    log = hide("viscous_friction", 9000)
    lacking, _ = free_equations(*refitted([log], RIG))
    drag = lacking[0].rms
    having, _ = free_equations(
        *refitted([log], with_values(RIG, {"viscous_positive": drag, "viscous_negative": drag}))
    )
    assert lacking[0].disturbance.startswith("drag")
    assert drag == pytest.approx(3 * 8e-9, rel=0.2)
    assert max(row.gain for row in having) < 0.05 * lacking[0].gain


def test_one_short_move_with_gaps_is_enough_to_run():
    log = campaign(speeds=(200.0,), pitches=(0.0,), hold=0.4)
    z = log.z[:900].copy()
    z[400:430], z[::5, 1], z[500:600, 0] = np.nan, np.nan, np.nan
    short = replace(log, z=z, t=log.t[:900], w_cmd=log.w_cmd[:900], pitch=log.pitch[:900])
    experiment, baseline = refitted([short], RIG)
    assert experiment.moves == 1
    rows, _ = free_equations(experiment, baseline)
    assert {row.verdict for row in rows} == {"no"}
    assert all(np.isfinite(row.gain) for row in rows)


@pytest.mark.slow
def test_two_logs_do_not_hand_their_disturbance_on():
    log = campaign(seed=6, speeds=(300.0,))
    one, _ = free_equations(*refitted([log, replace(log, t=log.t + 100.0)], RIG))
    other, _ = free_equations(*refitted([log, replace(log, t=log.t + 2000.0)], RIG))
    assert [row.gain for row in one] == pytest.approx([row.gain for row in other], abs=0.05)


@pytest.mark.parametrize("peak", [-4.3, -2.0, 0.6])
def test_climbing_finds_the_peak(peak):
    most, at = climb(lambda d: -((d - peak) ** 2), -2.0, 1.0)
    most, at = climb(lambda d: -((d - peak) ** 2), at, 0.4, 1)
    assert abs(at - peak) <= 0.4 and most == pytest.approx(-((at - peak) ** 2))
