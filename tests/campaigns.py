"""Campaigns of moves that several tests share: simulated by the package, or by the independent truth."""

from dataclasses import replace

import hidden
import numpy as np

from observer_fi.learn.move_data import prepare, select, simulate
from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.rigs import Rig, load_rig, with_values
from observer_fi.records import Log

RIG = load_rig()
LOOP = {"Kx": 40.0, "x_window": 4e-7}  # of a position loop around the servo
NOISE = np.array([1e-2, 3e-4, 1e-5])


def campaign(
    rig: Rig = RIG, seed: int = 1, speeds=(410.0, 200.0), pitches=(0.0, 8.0), hold: float = 0.8
) -> Log:
    """Moves there and back, simulated by the package itself, with white noise."""
    knots, values, pitch_knots, pitch = [0.0], [0.0], [], []
    at = 0.2
    for theta in pitches:
        for speed in speeds:
            pitch_knots.append(at - 0.1)
            pitch.append(theta)
            for signed in (speed, -speed):
                ramp = abs(signed) / 6e4
                knots += [at, at + ramp, at + hold, at + hold + ramp]
                values += [0.0, signed, signed, 0.0]
                at += hold + 0.3
    t = np.arange(int(at * 1600)) / 1600.0
    w_cmd = np.interp(t, knots, values)
    theta = np.array(pitch)[np.maximum(np.searchsorted(pitch_knots, t, side="right") - 1, 0)]
    log = Log("made", t, np.zeros((t.size, 3)), w_cmd, theta)
    experiment = prepare([log], rig)
    z, last = np.zeros((t.size, 3)), np.zeros(2)
    for m in range(experiment.moves):  # each begins where the one before came to rest
        one = replace(select(experiment, [m]), rest=last[None])
        y = simulate(one, rig.model, np.zeros((1, 2)))
        start = int(experiment.start[m])
        z[start:] = y[-1]
        z[start : start + len(y)] = y
        last = y[-1, 1:]
    return replace(log, z=z + np.random.default_rng(seed).normal(size=z.shape) * NOISE)


def log_of(profile: hidden.Profile, rig: hidden.Rig = hidden.TABLE_1, seed: int = 1, **spec: object) -> Log:
    return log_from_frame(hidden.make_log(hidden.TruthSpec(profile, rig, **spec), seed)[0])


def behind_a_loop(rig: Rig = RIG) -> Rig:
    """The rig with a position loop around its servo."""
    kept = {name: q for name, q in rig.quantities.items() if name != "accel_cmd"}
    return with_values(replace(rig, drive="position_servo", quantities=kept), LOOP)


def loop_log(profile: hidden.Profile, rig: hidden.Rig = hidden.TABLE_1, seed: int = 1, **spec: object) -> Log:
    """As `log_of`, behind a position loop."""
    logger = hidden.Logger(log_encoder=True, encoder_edges=4096)
    return log_of(profile, rig, seed, Kx=LOOP["Kx"], window_m=LOOP["x_window"], logger=logger, **spec)
