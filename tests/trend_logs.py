"""Cycles of an actuator of which only current and position are logged, by three lines of physics; digests of a made life."""

from datetime import datetime, timedelta

import numpy as np
import pandas as pd

from observer_fi.physics import load_rig
from observer_fi.trend import Digest, trend

STEP, SPEED = 0.04, 0.024


def cycle_frame(seed=0, friction=0.9, load_n=0.0, per_newton=5e-4, ripple=0.0, unsigned=True):
    """There and back over 120 mm: friction against motion, a load on one side, a ripple of 5 mm, rests between."""
    rng = np.random.default_rng(seed)
    v = np.concatenate([np.zeros(25), np.full(125, SPEED), np.zeros(75), np.full(125, -SPEED), np.zeros(25)])
    goal = 0.02 + np.cumsum(v) * STEP
    x = goal + 2e-5 * rng.standard_normal(v.size)
    uneven = friction * (1.0 + 0.01 * rng.standard_normal()) + ripple * np.sin(2 * np.pi * goal / 5e-3)
    i = np.sign(v) * uneven - per_newton * load_n + 0.02 * rng.standard_normal(v.size)
    return pd.DataFrame({
        "time_s": STEP * np.arange(v.size), "current_a": np.abs(i) if unsigned else i, "position_m": x,
        "position_cmd_m": goal, "load_n": load_n,
    })  # fmt: skip


NAMES = ("J", "A", "Kp", "Ki", "Rm", "torque_offset", "backlash")
UNITS = ("kg m^2", "N m", "A s/rad", "A/rad", "ohm", "N m", "m")
VALUE = np.array([4.7e-7, 4.6e-4, 1.1e-3, 0.45, 20.2, 1e-6, 1e-6])
SCATTER = np.array([5e-10, 5e-6, 1e-6, 4e-4, 0.05, 1e-6, 2e-6])
B = 2e-5  # N m/deg: what pitch does to the offset


def life(seed, logs=40, pitch=8.0, named="{:03d}.csv", dated=True, shift=None):
    """Digests of a life in which `shift(k)` is added, in scatters, to the values of log k."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(logs):
        theta = rng.uniform(-pitch, pitch)
        value = VALUE + SCATTER * rng.standard_normal(len(NAMES))
        value[NAMES.index("torque_offset")] += B * theta
        if shift is not None:
            value = value + SCATTER * shift(k)
        day = (datetime(2026, 1, 1) + timedelta(days=k)).isoformat() if dated else ""
        conditions = {"load_n": 0.0, "pitch_deg": theta, "speed_rad_s": 300.0}
        own = np.diag((0.2 * SCATTER) ** 2)
        found.append(Digest(named.format(k + 1), f"{k:x}", NAMES, UNITS, value, own, conditions, time=day))
    return found


def moved(**sizes):
    """A vector of sizes by name of quantity."""
    return np.array([sizes.get(n, 0.0) for n in NAMES])


def told(digests, rate=1e-3, **given):
    return trend(digests, load_rig(), rate, **given)
