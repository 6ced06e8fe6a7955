"""The algebra of the covariance of w, I, x, (ww, wI, wx, II, Ix, xx), compiled: numbers, or rows of them.

f is the transition matrix as `transition.motion_transition` gives it.
"""

from observer_fi.numerics import inlined


@inlined
def through(f, p):
    """F P, row by row."""
    f00, f01, f02, f10, f11, f20, f21 = f
    p00, p01, p02, p11, p12, p22 = p
    return (
        f00 * p00 + f01 * p01 + f02 * p02, f00 * p01 + f01 * p11 + f02 * p12, f00 * p02 + f01 * p12 + f02 * p22,
        f10 * p00 + f11 * p01, f10 * p01 + f11 * p11, f10 * p02 + f11 * p12,
        f20 * p00 + f21 * p01 + p02, f20 * p01 + f21 * p11 + p12, f20 * p02 + f21 * p12 + p22,
    )  # fmt: skip


@inlined
def onto(f, t):
    """T F' with T = F P."""
    f00, f01, f02, f10, f11, f20, f21 = f
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = t
    return (
        f00 * t00 + f01 * t01 + f02 * t02, f00 * t10 + f01 * t11 + f02 * t12, f00 * t20 + f01 * t21 + f02 * t22,
        f10 * t10 + f11 * t11, f10 * t20 + f11 * t21, f20 * t20 + f21 * t21 + t22,
    )  # fmt: skip


@inlined
def P_times_h(h, p):
    """P h'."""
    h0, h1, h2 = h
    return (
        h0 * p[0] + h1 * p[1] + h2 * p[2],
        h0 * p[1] + h1 * p[3] + h2 * p[4],
        h0 * p[2] + h1 * p[4] + h2 * p[5],
    )


@inlined
def without(p, w, per_S):
    """P - w w' / S; the products wait for no division."""
    return (
        p[0] - (w[0] * w[0]) * per_S, p[1] - (w[0] * w[1]) * per_S, p[2] - (w[0] * w[2]) * per_S,
        p[3] - (w[1] * w[1]) * per_S, p[4] - (w[1] * w[2]) * per_S, p[5] - (w[2] * w[2]) * per_S,
    )  # fmt: skip


@inlined
def meanwhile(p, of_w, of_I, by_I, x_by_w, dt):
    """Covariance p of w, I, x with what w and I, which grew by variances of_w, of_I in a step of dt, did meanwhile.

    by_I: dw/dt by I, x_by_w: dx/dt by w. The growth is even in time: 1/2, 1/3, 1/6, 1/8, 1/20 are integrals of Wiener processes.
    """
    D, u = x_by_w * dt, by_I * dt
    v = u * D
    p00, p01, p02, p11, p12, p22 = p
    return (
        p00 + of_I * u * u * (1.0 / 3.0), p01 + of_I * u * 0.5, p02 + of_w * D * 0.5 + of_I * u * v * 0.125,
        p11, p12 + of_I * v * (1.0 / 6.0), p22 + of_w * D * D * (1.0 / 3.0) + of_I * v * v * 0.05,
    )  # fmt: skip
