"""Rows against numbers: every function of a row, and every equation on rows, is that of each number by itself."""

import inspect
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from observer_fi.bank import transition as tr
from observer_fi.numerics import rows
from observer_fi.physics import equations as a
from observer_fi.physics.empirical_curve import Curve, parameters
from observer_fi.physics.rigs import load_rig, override

L = 8
ALL = (0,) * L
RIG = load_rig()
PLANT = override(RIG.model, "stops", x_stop_high=1e-3, x_stop_low=-1e-3)
# What lies around the corners of the equations: both directions, standstill, both limits of the supply, past both stops.
RANGES = {
    "w": (-600.0, 600.0), "w0": (-600.0, 600.0), "I": (-3.0, 3.0), "w_cmd": (-410.0, 410.0), "i": (-0.7, 0.7),
    "i_cmd": (-2.0, 2.0), "h": (0.0, 0.05), "sag": (0.0, 0.4), "torque": (-2e-3, 2e-3), "V": (-15.0, 15.0),
    "x": (-2e-3, 2e-3), "d": (-1e-3, 1e-3), "phi": (-50.0, 50.0), "theta": (-30.0, 30.0), "s": (-1.0, 1.0),
    "seen": (-2e-3, 2e-3), "x_rate": (-1e-3, 1e-3), "pos": (-2e-3, 2e-3), "c": (-0.5, 0.5), "t": (1e-4, 7e-4),
    "c0": (-410.0, 410.0), "mean": (-410.0, 410.0), "rate": (-1e-4, 1e-4), "step": (1e-4, 7e-4), "by_w": (-90.0, 0.0),
    "by_I": (0.0, 2e4), "by_x": (-1e4, 1e4), "by_d": (-1e4, 1e4), "x_by_w": (0.0, 2e-6), "w_slope": (-1e3, 1e3),
    "x_slope": (-1e-3, 1e-3), "supply": (0.0, 15.0), "r": (-2e-3, 2e-3), "emf": (-15.0, 15.0), "R": (20.0, 22.0),
    "limit": (10.0, 15.0), "what": (0.0, 5.0), "given": (0.0, 6.0), "code": (0.0, 6.0),
    "drive": (-1e-2, 1e-2), "depth": (0.0, 1e-3), "now": (0.0, 30.0),
}  # fmt: skip
SIZES = {
    "viscous_positive": 1e-7, "viscous_negative": 2e-7, "stribeck_torque": 1e-4, "friction_asymmetry": 2e-5,
    "load_friction": 0.1, "friction_slope": 1e-2, "friction_curvature": 10.0, "friction_bump": 1e-4, "shaft_ripple_sin": 1e-5,
    "screw_ripple_cos": 1e-5, "gravity_cubic": 1e-7, "gravity_quadratic": 1e-6, "gravity_cosine": 0.5, "torque_offset": 1e-5,
    "heating_gain": 0.1, "heating_rise": 0.1, "brush_drop": 0.2, "sag_resistance": 2.0, "servo_delay": 1e-4, "current_lag": 5e-4,
    "integrator_limit": 1.0, "slip": 0.02, "slip_per_torque": 20.0, "contact_exponent": 1.5, "contact_damping": 1e-4,
    "contact_drag": 1e-7, "position_lag": 2e-3, "position_gain": 1.02, "position_sin": 1e-5, "position_cos": 1e-5,
    "current_offset": 1e-3, "current_gain": 1.02, "voltage_offset": 0.05, "pitch_offset": 0.5,
    "torque_friction": 0.1, "warmup_rise": 0.3, "dead_zone": 5e-3,
}  # fmt: skip
CURVES = [
    Curve("torque", "position", True, -1e-3, 1e-3, (0.0, 1e-5, -2e-5)),
    Curve("torque", "screw_angle", False, 0.0, 2.0, (0.0, 1e-5, -2e-5)),
    Curve("electrical", "current", False, -0.1, 0.1, (0.2, 0.1, 0.3)),
    Curve("sensor:position", "position", False, -1e-3, 1e-3, (0.0, 1e-5, -2e-5)),
    Curve("torque", "shaft_angle", False, 0.0, 2.0, (0.0, 1e-5, -2e-5)),
]
STEPS = ("motion_slopes", "driven", "motion_transition", "constant_transition")
EQUATIONS = [
    f for m in (a, tr) for _, f in inspect.getmembers(m)
    if hasattr(f, "py_func") and f.py_func.__module__ == m.__name__
    and (m is a or f.py_func.__name__ in STEPS)
]  # fmt: skip


def plants() -> np.ndarray:
    """(VECTOR_SIZE, L) parameters: plain, in contact, decoupled, and with effects, about as many each as a lane has."""
    rng, out = np.random.default_rng(1), []
    faults: tuple[dict[str, float], ...] = ({}, {"contact": 1.0}, {"coupling": 0.0})
    for k in range(L):
        drawn = {name: size for name, size in SIZES.items() if rng.random() < 0.5}
        drawn |= parameters(CURVES[k % len(CURVES)])
        out.append(override(PLANT, "lane", **faults[k % 3], **(drawn if k >= 3 else {})).vector)
    return np.array(out).T.copy()


def on_rows(function: Any, names: list[str], outs: int) -> Callable[..., None]:
    """A compiled call of an equation on rows of its arguments: (k, L) numbers, (VECTOR_SIZE, L) parameters, (outs, L) results."""
    places = ", ".join("side_by_side(p, ALL)" if n == "p" else f"r[{k}]" for k, n in enumerate(names))
    got = "".join(f"    o[{k}] = got{f'[{k}]' if outs > 1 else ''}\n" for k in range(outs))
    source = (
        "def call(given, p, out):\n    r, o = side_by_side(given, ALL), side_by_side(out, ALL)\n"
        f"    got = function({places})\n{got}"
    )
    known = {"function": function, "side_by_side": rows.side_by_side, "ALL": ALL}
    exec(source, known)
    return numba.njit(error_model="numpy")(known["call"])


@pytest.mark.skipif(not EQUATIONS, reason="numba is switched off")
@pytest.mark.parametrize("function", EQUATIONS, ids=lambda f: f.py_func.__name__)
@pytest.mark.first(17)
def test_equations_on_rows(function: Any) -> None:
    """To rounding of each number by itself; the rows mix plants, corners of the equations and standstill."""
    names, p = list(inspect.signature(function.py_func).parameters), plants()
    rng = np.random.default_rng(2)
    call = None
    for _ in range(30):
        given = np.array([rng.uniform(*RANGES[n], L) if n != "p" else np.zeros(L) for n in names])
        for n in ("w", "d", "s"):
            if n in names:
                given[names.index(n), rng.random(L) < 0.2] = 0.0
        expected = np.array([
            function(*(p[:, l].copy() if n == "p" else given[k, l] for k, n in enumerate(names))) for l in range(L)
        ]).T.reshape(-1, L)  # fmt: skip
        got = np.full(expected.shape, np.nan)
        call = call or on_rows(function, names, len(expected))
        call(given, p, got)
        scale = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose(got, expected, rtol=1e-11, atol=1e-13 * float(scale.max() + 1e-3))


U = np.array([-3.0, -0.5, -0.0, 0.0, 1e-9, 0.7, 2.0, np.nan])
V = np.array([-3.0, 0.5, 0.0, -0.0, 2e-9, -0.7, np.nan, 1.0])


@numba.njit
def _functions(u, v, out):  # type: ignore[no-untyped-def]
    r, s, o = rows.side_by_side(u, ALL), rows.side_by_side(v, ALL), rows.side_by_side(out, ALL)
    o[0], o[1], o[2] = (
        rows.where_above(r[0], s[0], 1.0, r[0]),
        rows.maximum(r[0], s[0]),
        rows.copysign(r[0], s[0]),
    )
    o[3], o[4], o[5] = rows.tanh(r[0]), rows.sin(r[0]), rows.cos(r[0])
    o[6], o[7], o[8] = abs(r[0]), -r[0], rows.zeros_like(r[0])
    o[9] = abs(r[0]) ** s[0]


@numba.njit
def _numbers(u, v):  # type: ignore[no-untyped-def]
    return (
        rows.where_above(u, v, 1.0, u), rows.maximum(u, v), rows.copysign(u, v), rows.tanh(u), rows.sin(u),
        rows.cos(u), abs(u), -u,
        rows.zeros_like(u), abs(u) ** v,
    )  # fmt: skip


def test_functions_of_rows_are_those_of_numbers_and_of_plain_python() -> None:
    """NaN, both zeros and equal numbers among them."""
    out = np.full((10, L), np.inf)
    _functions(U[None], V[None], out)
    numbers = np.array([_numbers(u, v) for u, v in zip(U, V, strict=True)]).T
    with np.errstate(invalid="ignore"):
        plain = np.array([
            rows.where_above(U, V, 1.0, U), rows.maximum(U, V), rows.copysign(U, V), rows.tanh(U), rows.sin(U),
            rows.cos(U), np.abs(U),
            -U, rows.zeros_like(U), np.abs(U) ** V,
        ])  # fmt: skip
    for other in (numbers, plain):
        np.testing.assert_allclose(out, other, rtol=1e-15)
        np.testing.assert_array_equal(np.signbit(out[:9])[:, :7], np.signbit(other[:9])[:, :7])


@numba.njit
def _some(u, out):  # type: ignore[no-untyped-def]
    row = rows.side_by_side(u, ALL)[0]
    out[0], out[1] = rows.any_of(row), rows.any_of_rare(row)
    out[2], out[3] = rows.any_of(u[0, 3]), rows.any_of_rare(u[0, 3])


@pytest.mark.parametrize(("value", "expected"), [(0.0, False), (-0.0, False), (1e-300, True), (np.nan, True)])
def test_some_looks_at_every_number(value: float, expected: bool) -> None:
    u, out = np.zeros((1, L)), np.zeros(4, dtype=np.bool_)
    u[0, 3] = value
    _some(u, out)
    assert out.tolist() == [expected] * 4
    assert rows.any_of(u[0]) is expected and rows.any_of_rare(value) is expected


@numba.njit
def _places(given, out):  # type: ignore[no-untyped-def]
    r, o = rows.side_by_side(given, ALL), rows.side_by_side(out, ALL)
    for i in range(given.shape[0]):
        part = r[i]
        for j in range(given.shape[1]):
            o[j, i] = part[j] + r[i, j]


def test_rows_of_an_array_stand_where_numpy_has_them() -> None:
    given = np.arange(2 * 3 * L, dtype=np.float64).reshape(2, 3, L)
    out = np.zeros((3, 2, L))
    _places(given, out)
    np.testing.assert_array_equal(out, 2.0 * given.transpose(1, 0, 2))


@numba.njit(error_model="numpy")
def _transcendental(u, out):  # type: ignore[no-untyped-def]
    r, o = rows.side_by_side(u, ALL), rows.side_by_side(out, ALL)
    for k in range(u.shape[0]):
        o[k, 0], o[k, 1], o[k, 2] = rows.exp(-abs(r[k])), rows.log(abs(r[k])), rows.sqrt(abs(r[k]))


@numba.njit(error_model="numpy")
def _of_a_number(u):  # type: ignore[no-untyped-def]
    return rows.exp(-abs(u)), rows.log(abs(u)), rows.sqrt(abs(u))


def test_exp_log_and_sqrt_of_rows_to_the_last_digits() -> None:
    """Over all magnitudes that densities and variances have, and of numbers and in plain Python alike."""
    rng = np.random.default_rng(4)
    u = np.concatenate((rng.uniform(0.0, 700.0, 4000), 10.0 ** rng.uniform(-300.0, 2.8, 4000))).reshape(-1, L)
    out = np.empty((len(u), 3, L))
    _transcendental(u, out)
    for k, exact in enumerate((np.exp(-u), np.log(u), np.sqrt(u))):
        np.testing.assert_allclose(out[:, k], exact, rtol=4e-16, atol=3e-16 if k == 1 else 0.0)
    for value in u[:20, 0]:
        np.testing.assert_allclose(
            _of_a_number(value), (np.exp(-value), np.log(value), np.sqrt(value)), rtol=4e-16
        )
    plain = rows.exp(-u[0]), rows.log(u[0]), rows.sqrt(u[0])
    np.testing.assert_array_equal(plain, (np.exp(-u[0]), np.log(u[0]), np.sqrt(u[0])))
    np.testing.assert_array_equal(rows.log(np.array([-1.0, 0.0, np.inf])), [np.nan] * 3)


def test_rows_in_memory_begin_where_a_cache_line_does() -> None:
    for shape in ((3, L), (2, 5, L), (7,)):
        a = rows.aligned_copy(np.arange(np.prod(shape), dtype=float).reshape(shape))
        assert a.ctypes.data % 64 == 0 and a.flags.c_contiguous
        np.testing.assert_array_equal(a.ravel(), np.arange(a.size))
