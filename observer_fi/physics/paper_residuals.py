"""Residuals of a prediction, as the paper takes them (section 2.6 and equation 19)."""

import numpy as np

from observer_fi.physics import equations
from observer_fi.physics.equations import INDEX
from observer_fi.records import Array


def speed(z: Array, p: Array) -> Array:
    """Motor speed from voltage and current, equation 16 [rad/s]: (V - Rm i) / Km over the last axis of z (..., 3)."""
    return equations.speed_behind_readings(z[..., 0], z[..., 1], p)


def residual_vector(predicted: Array, z: Array, p: Array) -> Array:
    """Equation 14: predicted minus measured current [A], position [m] and speed [rad/s], (..., 3).

    predicted, z: (..., 3) voltage, current, position.
    """
    w = speed(predicted, p) - speed(z, p)
    return np.stack(
        np.broadcast_arrays(predicted[..., 1] - z[..., 1], predicted[..., 2] - z[..., 2], w), axis=-1
    )


def residual_norm(residuals: Array, std: Array) -> Array:
    """Equation 19 with a diagonal covariance: sqrt(D' S^-1 D). residuals (..., 3), std (3,); missing channels count 0."""
    scaled = np.nan_to_num(residuals / std)
    return np.sqrt((scaled * scaled).sum(axis=-1))


def sensor_std(noise_std: Array, p: Array) -> Array:
    """(3,) standard deviation of equation 14 from sensor noise: current, position, and speed made from V and i.

    noise_std: (3,) voltage, current, position. The speed's error is correlated with the current's (Rm / Km = 953 rad/s
    per A on the paper's rig), which is why the bank scores V, i, x and only prints these coordinates.
    """
    v, i, x = noise_std
    return np.array([i, x, np.hypot(v, p[INDEX["Rm"]] * i) / p[INDEX["Km"]]])
