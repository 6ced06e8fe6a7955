"""Textbook versions, simpler than the code they judge. One reading a call, plain numpy, no scaling, no masks but None."""

import numpy as np


def kalman_predict(x, P, F, Q, push=0.0):
    """Kalman (1960): mean and covariance a step on."""
    return F @ x + push, F @ P @ F.T + Q


def kalman_update(x, P, z, H, R):
    """Kalman (1960): mean and covariance given z, and the log-density of z."""
    e, S = z - H @ x, H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    log_density = -0.5 * (z.size * np.log(2 * np.pi) + np.log(np.linalg.det(S)) + e @ np.linalg.solve(S, e))
    return x + K @ e, P - K @ S @ K.T, log_density


def imm_step(mu, moments, M, z, steps):
    """Blom and Bar-Shalom (1988): one cycle of interacting multiple models with equal states.

    mu (m,); moments: a list of (x, P); M (m, m), rows sum to one; steps: a list of functions (x, P, z) -> (x, P, log-density).
    """
    c = mu @ M
    omega = M * mu[:, None] / c
    mixed, log_density = [], np.empty(mu.size)
    for j, step in enumerate(steps):
        x = sum(omega[i, j] * moments[i][0] for i in range(mu.size))
        off = [moments[i][0] - x for i in range(mu.size)]
        P = sum(omega[i, j] * (moments[i][1] + np.outer(off[i], off[i])) for i in range(mu.size))
        x, P, log_density[j] = step(x, P, z)
        mixed.append((x, P))
    weight = c * np.exp(log_density - log_density.max())
    return weight / weight.sum(), mixed, log_density


def servo(model, dt):
    """The motor under its PI servo without friction or saturation, x = (w, I, x), z = (V, i, x), command w_c held over dt.

    Returns F, the push of w_c by step, H, and the direct share of w_c in z; by the midpoint rule.
    """
    Kp, Ki, Km, Rm, J, D = (model[name] for name in ("Kp", "Ki", "Km", "Rm", "J", "D"))
    A = np.array([[-Kp * Km / J, Ki * Km / J, 0.0], [-1.0, 0.0, 0.0], [D, 0.0, 0.0]])
    B = np.array([Kp * Km / J, 1.0, 0.0])
    half = np.eye(3) * dt + 0.5 * dt**2 * A
    i_by = np.array([-Kp, Ki, 0.0])
    H = np.array([Rm * i_by + [Km, 0.0, 0.0], i_by, [0.0, 0.0, 1.0]])
    return np.eye(3) + A @ half, half @ B, H, np.array([Rm * Kp, Kp, 0.0])
