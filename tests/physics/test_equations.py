"""The equations against the paper's numbers, against their mirror image, and with every effect at its neutral value."""

import inspect
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.physics import equations as a
from observer_fi.physics import simulation as sim
from observer_fi.physics.command import corners
from observer_fi.physics.faults import faulty
from observer_fi.physics.rigs import Model, load_rig, override
from observer_fi.physics.trapezoid import quarters

RIG = load_rig()
PLANT = RIG.model
RATE = 32_000.0  # Hz: the numbers of the design are read off to 0.1 ms


def open_loop(
    model: Model, speed: float = 410.0, seconds: float = 1.0, theta: float = 0.0, start: np.ndarray | None = None,
    rate: float = RATE,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Time and states (n, 9) of a move that starts from rest at t = 0."""
    t = np.arange(round(seconds * rate)) / rate
    ramp = abs(speed) / model["accel_cmd"]
    knots, values = corners(t, np.interp(t, [0.0, ramp], [0.0, speed]), model["accel_cmd"])
    w = quarters(t, knots, values)
    out = np.zeros((t.size, sim.COLUMNS))
    first = np.zeros(len(sim.STATES)) if start is None else start
    fine = np.ones(t.size, dtype=np.bool_)
    sim.run(t, w, w, fine, np.full(t.size, theta), model.vector, first, out)
    return t, out


def supply(out: np.ndarray, p: np.ndarray) -> np.ndarray:
    return (p[a.RM] + p[a.RS]) * out[:, sim.CURRENT] + p[a.KM] * out[:, sim.W]


# --- the numbers of the paper's rig --------------------------------------------------------------


def test_time_constants_of_the_paper() -> None:
    R, Km, Kp, Ki, J = (PLANT[k] for k in ("Rm", "Km", "Kp", "Ki", "J"))
    R += PLANT["Rs"]
    assert (R, 1e3 * R * J / Km**2) == (21.0, pytest.approx(21.96, abs=5e-3))
    assert 1e3 * 2 * J / (Km * Kp) == pytest.approx(40.3, abs=0.05)
    natural, damping = math.sqrt(Km * Ki / J), Km * Kp / (2 * J)
    assert math.sqrt(natural**2 - damping**2) == pytest.approx(140.3, abs=0.1)
    assert (PLANT["Vmax"] - R * PLANT["A"] / Km) / Km == pytest.approx(691.0, abs=0.5)


def test_a_start_saturates_when_and_as_far_as_the_design_says() -> None:
    t, out = open_loop(PLANT)
    p = PLANT.vector
    at_limit = t[np.isclose(supply(out, p), p[a.VMAX], rtol=1e-12)]
    assert 1e3 * at_limit[0] == pytest.approx(5.5, abs=0.1)
    assert 1e3 * at_limit[at_limit < 0.1][-1] == pytest.approx(47.2, abs=0.1)
    assert out[:, sim.W].max() == pytest.approx(600.0, abs=1.0)
    # the current rises by 0.12 A/ms until the limit: its peak lies between two samples
    assert out[:, sim.CURRENT].max() == pytest.approx(0.653, abs=2e-3)
    assert out[:, sim.I].max() == pytest.approx(3.38, abs=0.01)


def test_ringing_is_at_22_hz() -> None:
    t, out = open_loop(PLANT)
    late = (t > 0.06) & (t < 0.25)
    w = out[late, sim.W] - 410.0
    crossings = t[late][:-1][np.diff(np.sign(w)) != 0]
    assert 0.5 / np.diff(crossings).mean() == pytest.approx(22.3, rel=0.01)


def test_steady_state_at_zero_pitch() -> None:
    _, out = open_loop(PLANT, seconds=1.5)
    w, I, i = out[-1, [sim.W, sim.I, sim.CURRENT]]
    p = PLANT.vector
    assert (w, 1e3 * i, I) == (
        pytest.approx(410.0, abs=0.01),
        pytest.approx(21.7, abs=0.05),
        pytest.approx(0.0482, abs=1e-4),
    )
    # the design gives 9.15 V: what the supply drives, source resistance included
    assert supply(out[-1:], p)[0] == pytest.approx(9.15, abs=5e-3)
    assert a.terminal_voltage(i, w, 0.0, p) == pytest.approx(9.15 - 0.8 * i, abs=5e-3)
    assert 1e3 * a.mass_speed(w, 0.0, 0.0, p) == pytest.approx(0.779, abs=5e-4)


def test_decoupled_and_blind_spot() -> None:
    loose = faulty(PLANT, "coupling_loss")
    _, out = open_loop(loose, seconds=1.5)
    assert 1e3 * out[-1, sim.CURRENT] == pytest.approx(16.0, abs=0.05)
    assert np.ptp(out[:, sim.X]) == 0.0
    assert 20.0 * PLANT["B"] == PLANT["A"]
    angle = (PLANT["A_decoupled"] - PLANT["A"]) / PLANT["B"]
    assert angle == pytest.approx(-5.2, abs=0.05)
    assert a.applied_torque(1.0, 410.0, 0.0, 0.0, 0.0, angle, PLANT.vector) == pytest.approx(
        a.applied_torque(1.0, 410.0, 0.0, 0.0, 0.0, angle, loose.vector), rel=1e-12
    )


def test_ceiling_of_the_force_and_stall() -> None:
    R, Km = PLANT["Rm"] + PLANT["Rs"], PLANT["Km"]
    ceiling = (PLANT["Vmax"] - Km * 410.0) / R
    assert ceiling == pytest.approx(0.305, abs=5e-4)
    depth = math.sqrt((Km * ceiling - PLANT["A"]) / PLANT["C"])
    assert 1e3 * depth == pytest.approx(8.41, abs=0.01)
    stall = math.sqrt((Km * PLANT["Vmax"] / R - PLANT["A"]) / PLANT["C"])
    assert 1e3 * stall == pytest.approx(13.2, abs=0.05)
    model = override(faulty(PLANT, "overload"), "stop", x_stop_high=0.0)
    p = model.vector
    torque = a.applied_torque(1.0, 410.0, depth, depth, 0.0, 0.0, p)
    assert torque == pytest.approx(Km * ceiling, rel=1e-9)
    assert 1e3 * a.mass_speed(410.0, depth, torque, p) == pytest.approx(0.374, abs=5e-4)


@pytest.mark.parametrize(("name", "change", "peak_mA"), [("J", 0.05, 201.0), ("A", 0.10, 28.0)])
def test_how_far_a_wrong_constant_moves_a_start(name: str, change: float, peak_mA: float) -> None:
    _, right = open_loop(PLANT)
    _, off = open_loop(override(PLANT, "off", **{name: PLANT[name] * (1.0 + change)}))
    moved = 1e3 * np.abs(off - right)[:, sim.CURRENT]
    assert moved.max() == pytest.approx(peak_mA, rel=0.03)
    if name == "A":
        assert moved[-1] == pytest.approx(2.2, abs=0.05)


# --- laws ----------------------------------------------------------------------------------------


def test_mirrored_moves_mirror() -> None:
    model = override(PLANT, "walled", x_stop_high=1e-4, x_stop_low=-1e-4)
    _, forth = open_loop(model, 410.0, 0.5, 3.0, rate=1600.0)
    _, back = open_loop(model, -410.0, 0.5, -3.0, rate=1600.0)
    odd = [sim.W, sim.I, sim.X, sim.PHI, sim.CURRENT]
    np.testing.assert_array_equal(forth[:, odd], -back[:, odd])
    assert forth[:, sim.X].max() > 2e-4  # it did lean on the stop


def test_energy_is_where_it_should_be() -> None:
    """Work of the motor = kinetic energy + friction + gravity + what the stop holds (with E = 0 it is conservative)."""
    model = override(PLANT, "walled", x_stop_high=1e-4, E=0.0)
    t, out = open_loop(model, seconds=0.6, theta=4.0)
    w, x, i = out[:, sim.W], out[:, sim.X], out[:, sim.CURRENT]
    turned = out[:, sim.PHI]
    work = np.trapezoid(model["Km"] * i * w, t)
    depth = np.maximum(x - model["x_stop_high"], 0.0)
    stored = model["C"] * depth[-1] ** 3 / 3.0 / model["D"]  # integral of C d^2 over the motor angle
    spent = 0.5 * model["J"] * w[-1] ** 2 + model["A"] * turned[-1] + model["B"] * 4.0 * turned[-1] + stored
    assert stored > 1e-4 and (w >= 0.0).all()
    assert spent == pytest.approx(work, rel=1e-5)  # trapezoid rule over 31 us: 2e-6


def test_a_stop_pushes_back_wherever_the_motor_turns() -> None:
    p = override(
        PLANT, "walled", x_stop_high=0.01, x_stop_low=-0.01, contact_damping=10.0, contact_drag=1.0
    ).vector
    for w, x in itertools.product((-400.0, -1.0, 0.0, 1.0, 400.0), (-0.02, -0.0101, 0.0, 0.0101, 0.02)):
        d = a.indentation(x, p)
        assert a.stop_torque(w, d, p) * d >= 0.0
        assert (d == 0.0) == (abs(x) <= 0.01)


@pytest.mark.parametrize("extended", [{}, {"position_delay": 0.01}])
def test_a_stiffness_that_a_filter_has_below_zero_for_a_while_still_shows(extended: dict[str, float]) -> None:
    """A sensor that is late is no reason to lose the slope by which the stiffness comes back."""
    for C, d in itertools.product((-80.0, -1.0, 1.0, 80.0), (-1e-3, 1e-3)):
        p = override(PLANT, "stop", C=C, contact=1.0, **extended).vector
        assert a.stop_torque(100.0, d, p) == pytest.approx(np.sign(d) * abs(C) * d * d, rel=1e-12)


@given(
    w=st.floats(-1500.0, 1500.0), I=st.floats(-10.0, 10.0), w_cmd=st.floats(-410.0, 410.0), sag=st.floats(0.0, 5.0)
)  # fmt: skip
def test_the_supply_never_gives_more_than_it_has(w: float, I: float, w_cmd: float, sag: float) -> None:
    p = PLANT.vector
    i_cmd = a.command_current(w, I, w_cmd, p)
    i = a.limited_current(i_cmd, w, 0.0, sag, p)
    V = (p[a.RM] + p[a.RS]) * i + p[a.KM] * w
    assert abs(V) <= p[a.VMAX] - sag + 1e-9
    asked = (p[a.RM] + p[a.RS]) * i_cmd + p[a.KM] * w
    assert (i == i_cmd) == (abs(asked) <= p[a.VMAX] - sag)
    assert a.measured_speed(a.terminal_voltage(i, w, 0.0, p), i, p) == pytest.approx(w, abs=1e-9)


def test_rest_holds_inside_the_friction_band_and_breaks_outside() -> None:
    band = PLANT["A"] / (PLANT["Km"] * PLANT["Ki"])
    for share, moves in ((0.99, False), (1.01, True), (-1.01, True)):
        start = np.zeros(len(sim.STATES))
        start[sim.I] = share * band
        _, out = open_loop(PLANT, 0.0, 0.05, start=start, rate=1600.0)
        assert (np.abs(out[:, sim.W]).max() > 0.0) == moves
        if moves:
            assert np.sign(out[5, sim.W]) == np.sign(share)


# --- effects -------------------------------------------------------------------------------------

EFFECTS = tuple(name for name, (_, neutral) in a.PARAMETERS.items() if neutral is not None)
# A size at which each effect shows, away from its neutral value; shapes need the size that they shape.
SIZES = {
    "viscous_positive": 1e-7, "viscous_negative": 1e-7, "stribeck_torque": 1e-4, "friction_asymmetry": 2e-5,
    "load_friction": 0.1, "friction_slope": 1e-2, "friction_curvature": 10.0, "friction_bump": 1e-4,
    "shaft_ripple_sin": 1e-5, "shaft_ripple_cos": 1e-5, "screw_ripple_sin": 1e-5, "screw_ripple_cos": 1e-5,
    "gravity_cubic": 1e-7, "gravity_quadratic": 1e-6, "gravity_cosine": 0.5, "torque_offset": 1e-5,
    "heating_gain": 0.1, "heating_rise": 0.1, "brush_drop": 0.2, "sag_resistance": 2.0, "supply_drift": -0.5,
    "servo_delay": 1e-4, "current_lag": 5e-4, "input_delay": 5e-4, "dead_zone": 5e-3, "integrator_limit": 1.0, "accel_limit": 2e4,
    "backlash": 5e-5, "slip": 0.02, "slip_per_torque": 20.0, "contact_exponent": 1.5, "contact_damping": 1e-4,
    "contact_drag": 1e-7, "position_lag": 2e-3, "position_delay": 2e-3, "position_gain": 1.02, "position_sin": 1e-5,
    "position_cos": 1e-5, "current_offset": 1e-3, "current_gain": 1.02, "voltage_delay": 1e-3, "voltage_offset": 0.05,
    "pitch_offset": 0.5, "torque_friction": 0.1, "warmup_rise": 0.3,
}  # fmt: skip


def shown(model: Model) -> np.ndarray:
    """Readings of a start against the upper stop at 5 deg, with the command and its delays as the model has them."""
    t = np.arange(480) / 1600.0
    knots, values = corners(t, np.interp(t, [0.01, 0.01 + 410.0 / 6e4], [0.0, 410.0]), 6e4)
    p = model.vector
    now = quarters(t, knots, values, model["input_delay"], model["accel_limit"])
    late = quarters(t, knots, values, model["input_delay"] + model["servo_delay"], model["accel_limit"])
    out, y = np.zeros((t.size, sim.COLUMNS)), np.empty((t.size, 3))
    sim.run(t, now, late, np.ones(t.size, dtype=np.bool_), np.full(t.size, 5.0), p, np.zeros(8), out)
    sim.readings(t, out, p, y)
    return y


WALLED = override(PLANT, "walled", x_stop_high=5e-5)


def test_every_effect_at_its_neutral_value_changes_nothing() -> None:
    """Bitwise: with all effects in the equations but neutral, and without them."""
    p = WALLED.vector
    extended = p.copy()
    extended[a.EXTENDED] = 1.0
    t = np.arange(480) / 1600.0
    w = quarters(t, t, np.interp(t, [0.01, 0.0169], [0.0, 410.0]))
    out = [np.zeros((t.size, sim.COLUMNS)) for _ in range(2)]
    y = [np.empty((t.size, 3)) for _ in range(2)]
    for k, vector in enumerate((p, extended)):
        sim.run(t, w, w, np.ones(t.size, dtype=np.bool_), np.full(t.size, 5.0), vector, np.zeros(8), out[k])
        sim.readings(t, out[k], vector, y[k])
    np.testing.assert_array_equal(out[0], out[1])
    np.testing.assert_array_equal(y[0], y[1])


def test_a_pitch_sensor_shows_the_pitch_and_its_offset() -> None:
    """The formula of the cause: theta_seen = theta + theta0."""
    size = {"load_friction": 0.2, "gravity_cubic": 1e-7}
    straight, tilted = (override(PLANT, "tilted", **size, pitch_offset=off).vector for off in (0.0, 0.5))
    for seen, true in ((5.5, 5.0), (-4.5, -5.0)):
        expected = a.applied_torque(1.0, 100.0, 0.0, 0.0, 0.0, true, straight)
        assert a.applied_torque(1.0, 100.0, 0.0, 0.0, 0.0, seen, tilted) == pytest.approx(expected, rel=1e-12)


def test_table_one_is_all_that_a_rig_must_give() -> None:
    assert len(a.PARAMETERS) - len(EFFECTS) == 15
    assert set(a.PARAMETERS) - set(EFFECTS) == set(RIG.quantities)
    assert a.NAMES[a.A_DECOUPLED] == "A_decoupled" and a.NAMES[a.PITCH_OFFSET] == "pitch_offset"
    for name in a.NAMES[: a.CURVE]:
        assert getattr(a, name.upper()) == a.INDEX[name], name
    assert a.NAMES[a.CURVE :] == tuple(f"curve_{k:02d}" for k in range(a.MOST_POINTS))


@pytest.mark.parametrize("name", SIZES)
def test_every_effect_shows(name: str) -> None:
    model = override(WALLED, "extended", **{name: SIZES[name]})
    if name == "viscous_negative":
        model = override(model, "extended", friction_slope=0.0)
        assert a.load_torque(-100.0, 0.0, 0.0, 0.0, 0.0, model.vector) < 0.0
        return
    assert model.effects == (name,)
    assert np.abs(shown(model) - shown(WALLED)).max() > 1e-9


@pytest.mark.parametrize(
    "pair", [("slip", "viscous_positive"), ("heating_rise", "position_gain"), ("brush_drop", "torque_offset")]
)
def test_order_of_effects_is_free(pair: tuple[str, str]) -> None:
    one = override(override(WALLED, "a", **{pair[0]: SIZES[pair[0]]}), "b", **{pair[1]: SIZES[pair[1]]})
    two = override(override(WALLED, "a", **{pair[1]: SIZES[pair[1]]}), "b", **{pair[0]: SIZES[pair[0]]})
    assert one == two
    np.testing.assert_array_equal(shown(one), shown(two))


def test_small_torques_add_up() -> None:
    """Effects are terms of one sum: two at once do what each does alone, to second order."""
    base, names = shown(WALLED), ("viscous_positive", "torque_offset")
    sizes = {name: 0.01 * SIZES[name] for name in names}
    alone = sum(shown(override(WALLED, "one", **{name: sizes[name]})) - base for name in names)
    both = shown(override(WALLED, "both", **sizes)) - base
    np.testing.assert_allclose(both, alone, atol=2e-3 * np.abs(both).max())


@pytest.mark.parametrize("step", [0.0, 1.0])
def test_a_dead_zone_passes_nothing_below_its_threshold(step: float) -> None:
    p = override(PLANT, "dead", dead_zone=0.01, zone_step=step).vector
    for asked, out in ((0.005, 0.0), (-0.009, 0.0), (0.03, 0.02 + 0.01 * step), (-0.03, -0.02 - 0.01 * step)):
        assert a.passed_current(asked, p) == pytest.approx(out, abs=1e-15)
        assert a.passes(asked, p) == (out != 0.0)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize(("s", "drive"), [(1.0, 3e-3), (1.0, -3e-3), (-1.0, 3e-3), (1.0, 2e-4)])
def test_a_gear_loses_a_share_of_what_the_rotor_leaves_it(s: float, drive: float, share: float) -> None:
    """friction = k |drive - r J dw/dt| with dw/dt of equation 1 at that very friction; braked and driven."""
    p = override(PLANT, "geared", torque_friction=0.15, rotor_share=share).vector
    torque = a.applied_torque(s, 300.0 * s, 0.0, 0.0, 0.0, 2.0, p)
    loss = a.transmission_loss(s, drive, torque, p)
    dw = a.acceleration(drive / p[a.KM], torque + s * loss, p)
    assert loss == pytest.approx(0.15 * abs(drive - share * a.inertia(p) * dw), rel=1e-12)
    assert loss >= 0.0


def test_servo_delay_is_eliminated_exactly() -> None:
    """i = Kp (w_cmd - w) + Ki I + Kp delay dw/dt, with dw/dt of equation 1 at that very current."""
    p = override(PLANT, "late", servo_delay=2e-4).vector
    torque = a.applied_torque(1.0, 300.0, 0.0, 0.0, 0.0, 2.0, p)
    i_cmd = a.command_current(300.0, 0.1, 410.0, p)
    i = a.late_current(i_cmd, torque, p)
    assert i == pytest.approx(i_cmd + p[a.KP] * 2e-4 * a.acceleration(i, torque, p), rel=1e-12)


def test_equations_run_without_numba() -> None:
    """Every equation is plain Python underneath, and says the same."""
    p = override(
        WALLED, "extended", **{k: v for k, v in SIZES.items() if k not in ("integrator_limit", "accel_limit")}
    ).vector
    arguments = {
        "w": 210.0, "I": 0.1, "w_cmd": 410.0, "i": 0.05, "i_cmd": 0.05, "h": 0.01, "sag": 0.1, "torque": 5e-4, "V": 9.0,
        "x": 6e-5, "d": 1e-5, "phi": 7.0, "theta": 3.0, "s": 1.0, "seen": 1e-4, "x_rate": 7e-4, "r": 0.4, "p": p,
        "emf": 4.0, "R": 21.0, "limit": 15.0, "what": 2.0, "given": 2.0, "code": 3.0, "drive": 1e-3, "now": 3.0, "depth": 3e-5,
    }  # fmt: skip
    compiled = [f for _, f in inspect.getmembers(a) if hasattr(f, "py_func")]
    if not compiled:
        pytest.skip("numba is switched off")
    assert len(compiled) >= 19
    for function in compiled:
        values = [arguments[name] for name in inspect.signature(function.py_func).parameters]
        assert function(*values) == pytest.approx(function.py_func(*values), rel=1e-12), (
            function.py_func.__name__
        )
