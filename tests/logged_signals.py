"""Signals as a logger reads them: one move of smooth readings between two rests, and what may be done to them."""

import numpy as np

from observer_fi.records import Log

RATE = 1600.0
SIGMA = np.array([10e-3, 0.3e-3, 10e-6])  # V, A, m
SPEED, ACCEL = 300.0, 8000.0  # rad/s, rad/s^2


def clock(seconds: float = 3.0, rate: float = RATE) -> np.ndarray:
    return np.arange(round(seconds * rate)) / rate


def command(t: np.ndarray, start: float = 0.7, brake: float = 1.7) -> np.ndarray:
    """A trapezoid [rad/s]."""
    ramp = SPEED / ACCEL
    return np.interp(t, [start, start + ramp, brake, brake + ramp], [0.0, SPEED, SPEED, 0.0])


def clean(t: np.ndarray) -> np.ndarray:
    """(n, 3) voltage, current and position of the move, at rest before and after it."""
    w = command(t)
    travel = np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(t))))
    return np.column_stack((0.02 * w, 6e-5 * w, 0.3 + 3e-6 * travel))


def white(t: np.ndarray, seed: int, times: float = 1.0) -> np.ndarray:
    return times * SIGMA * np.random.default_rng(seed).standard_normal((t.size, 3))


def signal(seed: int = 0, seconds: float = 3.0, times: float = 1.0, rate: float = RATE) -> Log:
    """The log of an ideal logger, of `times` its usual noise."""
    t = clock(seconds, rate)
    return log_of(t, clean(t) + white(t, seed, times))


def log_of(t: np.ndarray, z: np.ndarray) -> Log:
    return Log("signal", t, z, command(t), np.zeros(t.size))


def held(n: int, period: float, phase: float = 0.0) -> np.ndarray:
    """(n,) which sample's reading stands at each one, where a new one comes every `period` samples."""
    tick = np.floor((np.arange(n) - phase) / period)
    return np.searchsorted(tick, tick)


def stepped(z: np.ndarray, step: float, origin: float = 0.0) -> np.ndarray:
    return np.round((z - origin) / step) * step + origin


def coloured(n: int, keep: float, seed: int) -> np.ndarray:
    """(n,) unit noise of which a sample keeps this share of the one before."""
    drive = np.random.default_rng(seed).standard_normal(n)
    out = np.empty(n)
    out[0] = drive[0]
    for k in range(1, n):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep**2) * drive[k]
    return out
