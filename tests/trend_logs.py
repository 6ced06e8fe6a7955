"""Cycles of an actuator of which only current and position are logged, by three lines of physics."""

import numpy as np
import pandas as pd

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
