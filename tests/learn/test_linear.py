"""Small disturbances along a simulated motion, against the simulation with the parameter that stands for each of them."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import RIG, campaign

from observer_fi.learn import linear as pt
from observer_fi.learn.move_data import prepare, run
from observer_fi.physics.rigs import override

M = RIG.model
# Disturbance, the parameter that does the same where there is one, its change, and the size of the disturbance for it.
SAME = [
    (pt.TORQUE, "torque_offset", 1e-6, 1e-6),
    (pt.FRICTION, "A", 1e-6, 1e-6),
    (pt.RESISTANCE, "Rm", 2e-3, 2e-3),
    (pt.SUPPLY, "Vmax", 2e-3, 2e-3),
    (pt.TRAVEL, "slip", 1e-3, -1e-3),
    (pt.VOLTAGE, "voltage_offset", 1e-3, 1e-3),
]


@pytest.fixture(scope="module")
def motion():
    """A move forward and one back, started from the same rests whatever is changed."""
    experiment = prepare([campaign(speeds=(300.0,), pitches=(5.0,))], RIG)
    experiment = replace(experiment, steps=8)
    states, y = run(experiment, M, np.zeros((experiment.moves, 2)))
    return experiment, states, y


def respond(linear: pt.Linear, kind: int, size: float, first: int, stop: int) -> np.ndarray:
    """(rows, 3) change of the readings of one move for a disturbance of constant size, step by step."""
    d, out = np.zeros(3), np.empty((stop - first, 3))
    for k in range(first, stop):
        h = linear.H[k]
        out[k - first] = [h[0] * d[0] + h[1] * d[1], h[2] * d[0] + h[3] * d[1], h[4] * d[0] + h[5] * d[2]]
        out[k - first] += size * linear.S[kind, k]
        f = linear.F[k]
        moved = np.array(
            [
                f[0] * d[0] + f[1] * d[1] + f[2] * d[2],
                f[3] * d[0] + f[4] * d[1],
                f[5] * d[0] + f[6] * d[1] + d[2],
            ]
        )
        d = np.array([0.0, d[1], d[2]]) if linear.held[k] else moved + size * linear.G[kind, k]
    return out


@pytest.mark.parametrize("move", [0, 1])
@pytest.mark.parametrize("kind, parameter, value, size", SAME, ids=lambda v: str(v))
def test_a_disturbance_does_what_its_parameter_does(motion, move, kind, parameter, value, size):
    experiment, states, y = motion
    first, end = experiment.bounds[move : move + 2]
    stop = first + int(0.75 * (end - first))  # without the end, where friction catches the mass
    changed = override(M, M.name, **{parameter: M[parameter] + value})
    expected = (run(experiment, changed, np.zeros((experiment.moves, 2)))[1] - y)[first:stop]
    linear = pt.linearised(experiment, M, states)
    found = respond(linear, kind, size, first, stop)
    for c in range(3):
        # the instants at which the supply's limit begins and ends lie between samples
        off = np.sqrt(np.mean((found[:, c] - expected[:, c]) ** 2))
        assert off < 0.03 * max(np.abs(expected[:, c]).max(), 1e-12)


def test_no_stop_is_touched_no_stop_is_disturbed(motion):
    experiment, states, _ = motion
    linear = pt.linearised(experiment, M, states)
    assert not linear.G[pt.STOP].any()
    stop = override(M, M.name, x_stop_high=float(states[:, 2].max()) - 1e-5)
    touched, _ = run(experiment, stop, np.zeros((experiment.moves, 2)))
    assert pt.linearised(experiment, stop, touched).G[pt.STOP].any()
