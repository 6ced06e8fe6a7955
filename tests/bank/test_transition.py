"""One sample of one hypothesis: against a textbook integrator, its Jacobian against finite differences of itself."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from observer_fi.bank import transition as tr
from observer_fi.bank.filterpy_bank import Ekf, Step
from observer_fi.bank.hypotheses import BankArrays, arrays, bank
from observer_fi.bank.motion_moments import meanwhile
from observer_fi.physics import equations as a
from observer_fi.physics.rigs import Rig, load_rig, with_values
from observer_fi.settings import BankSettings

RIG = load_rig()
SETTINGS = BankSettings()
HYPOTHESES = bank(RIG, SETTINGS)
ARRAYS = arrays(HYPOTHESES, RIG, SETTINGS)
NAMES = [h.name for h in HYPOTHESES]
DT = 1.0 / 1600.0
# w, I, x, command: steady, saturated either way, ringing, backward, slow
SITUATIONS = {
    "steady": (410.0, 0.0482, 1e-3, 410.0),
    "saturated": (200.0, 1.5, 1e-3, 410.0),
    "saturated backward": (-150.0, -1.5, -1e-3, -410.0),
    "ringing": (520.0, 0.2, 1e-3, 410.0),
    "backward": (-205.0, -0.05, -2e-3, -205.0),
    "braking": (100.0, -0.1, 1e-3, 0.0),
}


def state(j: int, situation: tuple[float, ...], d: float = 2e-4) -> np.ndarray:
    """(m, n) states of a bank whose row j is at the situation, with constants a little off one."""
    x = ARRAYS.entry_mean.copy()
    x[j, :3] = situation[:3]
    for k, name in enumerate(HYPOTHESES[j].states):
        if name == "d":
            x[j, k] = d * np.sign(situation[0])
        elif name == "torque":
            x[j, k] = 3e-5
        elif name == "rate":
            x[j, k] = -1e-4
        elif k >= 3:
            x[j, k] = 1.03
    return x


def step(
    j: int,
    x: np.ndarray,
    w_cmd: float,
    theta: float = 4.0,
    dt: float = DT,
    steps: int = 1,
    b: BankArrays = ARRAYS,
) -> tuple[np.ndarray, bool]:
    """State j one sample later, and whether the motor rests."""
    x, p, slow, at = x[j].copy(), b.parameters[j].copy(), tr.slow_at_rest(b.parameters[j]), b.layout[j]
    has = (at >= 0).astype(float)
    tr.load_parameters(x, at, has, b.parameters[j], p)
    interval = np.full((1, 2 * steps), w_cmd)
    resting, _ = tr.propagate(x, at, has, slow, dt, dt, interval, 0, w_cmd, theta, p)
    return x, bool(resting)


def jacobian(j: int, x: np.ndarray, w_cmd: float, resting: bool = False, theta: float = 4.0) -> np.ndarray:
    """F of hypothesis j as the filters take it, (n, n): here filterpy's, whose moments the compiled ones must have."""
    f = Ekf(HYPOTHESES[j], RIG, SETTINGS)
    f.x, f.resting = x[j, : f.n].copy(), resting
    slopes = f._slopes(Step(DT, np.full((1, 2), w_cmd), w_cmd, theta))
    return f._transition(slopes, DT)


def spread(j: int) -> np.ndarray:
    """(n,) how far each state may be off: what an error of the Jacobian is weighed with."""
    std = np.sqrt(ARRAYS.entry_var[j])
    std[:3] = 1.0, 1e-3, 1e-5
    return std


def differences(j: int, x: np.ndarray, w_cmd: float) -> np.ndarray:
    """The Jacobian of `step` by central differences, (n, n)."""
    n, out = int(ARRAYS.size[j]), []
    for k in range(n):
        h = 1e-4 * spread(j)[k]
        up, down = x.copy(), x.copy()
        up[j, k] += h
        down[j, k] -= h
        out.append((step(j, up, w_cmd)[0] - step(j, down, w_cmd)[0])[:n] / (2.0 * h))
    return np.array(out).T


@pytest.mark.parametrize(("name", "situation"), list(itertools.product(NAMES, SITUATIONS)))
def test_jacobian_is_the_slope_of_the_step(name: str, situation: str) -> None:
    """Taylor to second order, weighed with the prior spreads.

    w: the ring turns by 0.09 rad a sample and J is not linear: 2 % at worst. x: 1e-4. I: second-order terms of constants
    are left out, half of what w passes on in one sample.
    """
    j = NAMES.index(name)
    at = SITUATIONS[situation]
    x = state(j, at)
    n, states = int(ARRAYS.size[j]), HYPOTHESES[j].states
    exact, F = differences(j, x, at[3]) * spread(j)[:n], jacobian(j, x, at[3]) * spread(j)[:n]
    assert np.abs(F[0] - exact[0]).max() <= 0.025 * np.abs(exact[0]).max()
    assert np.abs(F[2] - exact[2]).max() <= 1e-4 * np.abs(exact[2]).max()
    np.testing.assert_allclose(F[1, :2], exact[1, :2], rtol=2e-3)
    assert (np.abs(F[1, 2:] - exact[1, 2:]) <= 0.52 * DT * np.abs(exact[0, 2:]) + 1e-12).all()
    if "d" in states:
        d = states.index("d")
        assert np.abs(F[d] - exact[d]).max() <= 2e-4 * np.abs(exact[d]).max()
    constants = [k for k in range(3, n) if states[k] != "d"]
    np.testing.assert_allclose(exact[constants], np.diag(spread(j)[:n])[constants], atol=1e-9)


def test_a_motor_at_rest_forgets_its_speed_and_keeps_the_rest() -> None:
    for j, h in enumerate(HYPOTHESES):
        x = state(j, (0.0, 0.01, 1e-3, 0.0))
        x[j, [k for k, s in enumerate(h.states) if s in ("torque", "rate", "d")]] = 0.0
        after, resting = step(j, x, 0.0, theta=0.0)
        assert resting
        np.testing.assert_array_equal(after, x[j])
        F = jacobian(j, x, 0.0, resting=True)
        expected = np.eye(len(h.states))
        expected[0, 0] = 0.0
        np.testing.assert_array_equal(F, expected)


# --- the mean ------------------------------------------------------------------------------------


def textbook(j: int, x: np.ndarray, w_cmd: float, theta: float = 4.0, dt: float = DT) -> np.ndarray:
    """(w, I, x, d) of equations 1 to 13 by a Runge-Kutta of order 8 with tight tolerances, sliding."""
    h = HYPOTHESES[j]
    c = {name: x[j, k] for k, name in enumerate(h.states)}
    v = {
        name: h.model[name] * c.get(name, 1.0)
        for name in ("Rm", "Rs", "Km", "D", "Vmax", "Kp", "Ki", "A", "B", "C", "E")
    }
    loose = h.model["coupling"] == 0.0
    J = (h.model["J_decoupled"] if loose else h.model["J"]) * c.get("J", 1.0)
    A = h.model["A_decoupled"] * c.get("A_decoupled", 1.0) if loose else v["A"]

    def rates(_: float, y: np.ndarray) -> list[float]:
        w, I, _x, d = y
        V = (v["Rm"] + v["Rs"]) * (v["Kp"] * (w_cmd - w) + v["Ki"] * I) + v["Km"] * w
        i = (np.clip(V, -v["Vmax"], v["Vmax"]) - v["Km"] * w) / (v["Rm"] + v["Rs"])
        load = np.sign(w) * A + (0.0 if loose else v["B"] * theta) + c.get("torque", 0.0)
        load += v["C"] * d * abs(d) if "d" in c else 0.0
        dx = 0.0 if loose else v["D"] * w * (1.0 - v["E"] if "d" in c else 1.0)
        dx += c.get("rate", 0.0)
        return [(v["Km"] * i - load) / J, w_cmd - w, dx, dx if "d" in c else 0.0]

    start = [*x[j, :3], c.get("d", 0.0)]
    return solve_ivp(rates, (0.0, dt), start, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]


@pytest.mark.parametrize(("name", "situation"), list(itertools.product(NAMES[:4], SITUATIONS)))
def test_mean_is_the_textbooks(name: str, situation: str) -> None:
    """The midpoint rule's error in one sample, against what speed changes put in doubt anyway (`agility`).

    As current it is 0.002 standard deviations in steady motion, 0.15 in the deepest ring; as position 1e-4.
    """
    j = NAMES.index(name)
    at = SITUATIONS[situation]
    x = state(j, at)
    got, resting = step(j, x, at[3])
    exact = textbook(j, x, at[3])
    assert not resting
    off = got[:3] - exact[:3]
    assert abs(off[0]) < 0.1 * SETTINGS.agility * abs(exact[0] - at[0])
    p = ARRAYS.parameters[j]
    current = abs(p[a.KP] * off[0]) + abs(p[a.KI] * off[1])
    assert current < (0.2 if abs(exact[0] - at[0]) > 1.0 else 0.005) * RIG.noise_std[1]
    assert abs(off[2]) < 1e-4 * RIG.noise_std[2]
    if "d" in HYPOTHESES[j].states:
        assert got[HYPOTHESES[j].states.index("d")] == pytest.approx(exact[3], abs=1e-9)


@given(
    w=st.floats(-700.0, 700.0), I=st.floats(-3.0, 3.0), w_cmd=st.floats(-410.0, 410.0), theta=st.floats(-12.0, 12.0),
    j=st.integers(0, len(NAMES) - 1),
)  # fmt: skip
def test_a_mirrored_step_mirrors(w: float, I: float, w_cmd: float, theta: float, j: int) -> None:
    x = state(j, (w, I, 1e-3, w_cmd))
    odd = np.array([s in ("w", "I", "x", "d", "torque", "rate") for s in HYPOTHESES[j].states])
    odd = np.pad(odd, (0, x.shape[1] - odd.size))
    back = x.copy()
    back[j, odd] *= -1.0
    forth, rests = step(j, x, w_cmd, theta)
    mirrored, rests_too = step(j, back, -w_cmd, -theta)
    np.testing.assert_array_equal(forth, np.where(odd, -mirrored, mirrored))
    assert rests == rests_too


def test_a_motor_that_brakes_comes_to_rest_within_the_sample_and_stays() -> None:
    j = 0
    x = state(j, (0.3, 0.0, 1e-3, 0.0))
    after, resting = step(j, x, 0.0)
    assert resting and after[0] == 0.0 and abs(after[2] - x[j, 2]) < 1e-9
    again, still = step(j, np.vstack([after, x[1:]]), 0.0)
    assert still and again[0] == 0.0 and again[2] == after[2]


def test_half_steps_of_the_command_are_used() -> None:
    """Four substeps over 2.5 ms are four samples of 0.625 ms."""
    for j in range(4):
        x = state(j, SITUATIONS["ringing"])
        once, _ = step(j, x, 410.0, dt=4 * DT, steps=4)
        four = x.copy()
        for _ in range(4):
            four[j] = step(j, four, 410.0)[0]
        np.testing.assert_allclose(once, four[j], rtol=1e-12)


# --- channels ------------------------------------------------------------------------------------


def seen(
    j: int, x: np.ndarray, w_cmd: float, b: BankArrays = ARRAYS, trail: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Readings (3,) and their slopes (3, 4) by w, I, x and the factor of the supply; trail: what the lag is behind [m]."""
    base, at, slow = b.parameters[j], b.layout[j], tr.slow_at_rest(b.parameters[j])
    slow[tr.TRAIL] = trail
    p = base.copy()
    tr.load_parameters(x[j], at, (at >= 0).astype(float), base, p)
    V, i, shown, V_w, V_I, V_v, i_w, i_I, i_v, x_x = tr.readings(
        *x[j, :3], tr.carried_in(slow), w_cmd, p, base[a.VMAX]
    )
    H = np.array([[V_w, V_I, 0.0, V_v], [i_w, i_I, 0.0, i_v], [0.0, 0.0, x_x, 0.0]])
    return np.array([V, i, shown]), H


@pytest.mark.parametrize(("name", "situation"), list(itertools.product(NAMES, SITUATIONS)))
def test_slopes_of_the_channels(name: str, situation: str) -> None:
    j = NAMES.index(name)
    at = SITUATIONS[situation]
    x = state(j, at)
    columns = [0, 1, 2, int(ARRAYS.layout[j, tr.AT_SUPPLY])]
    y, H = seen(j, x, at[3])
    assert y[2] == x[j, 2]
    for c, k in enumerate(columns):
        if k < 0:
            continue
        up, down = x.copy(), x.copy()
        up[j, k] += 1e-4 * spread(j)[k]
        down[j, k] -= 1e-4 * spread(j)[k]
        slope = (seen(j, up, at[3])[0] - seen(j, down, at[3])[0]) / (up[j, k] - down[j, k])
        np.testing.assert_allclose(H[:, c], slope, rtol=1e-6, atol=1e-9)


def test_saturated_voltage_is_the_supply_less_its_resistance() -> None:
    x = state(0, SITUATIONS["saturated"])
    (V, i, _), _ = seen(0, x, 410.0)
    at = ARRAYS.layout[0, tr.AT_SUPPLY]
    assert V + RIG.model["Rs"] * i == pytest.approx(RIG.model["Vmax"] * x[0, at], rel=1e-12)


def test_effects_of_the_sensors_are_seen_and_their_slopes_too() -> None:
    rig: Rig = with_values(
        RIG, {"voltage_offset": 0.1, "current_gain": 1.02, "current_offset": 1e-3, "position_gain": 1.1}
    )
    b = arrays(bank(rig, SETTINGS), rig, SETTINGS)
    x = state(0, SITUATIONS["steady"])
    plain, _ = seen(0, x, 410.0)
    y, H = seen(0, x, 410.0, b, trail=1e-4)
    assert y[0] - plain[0] == pytest.approx(0.1) and y[1] == pytest.approx(1.02 * plain[1] + 1e-3)
    assert y[2] == pytest.approx(1.1 * (plain[2] - 1e-4)) and H[2, 2] == pytest.approx(1.1)
    up = x.copy()
    up[0, 0] += 1e-3
    np.testing.assert_allclose(H[:, 0], (seen(0, up, 410.0, b, 1e-4)[0] - y) / 1e-3, rtol=1e-6, atol=1e-12)


# --- what the mean carries -----------------------------------------------------------------------


@pytest.mark.parametrize("delay", [2e-4, 3e-3, 0.05])
def test_what_is_on_its_way_through_a_delay_is_now_less_then(delay: float) -> None:
    """A signal linear between samples of an uneven clock, 0.01 each; what falls into one part of the delay is not told apart."""
    rng = np.random.default_rng(1)
    t = 5.0 + np.cumsum(rng.uniform(2e-4, 1.2e-3, 600))
    y = 1.0 + np.cumsum(rng.normal(size=600)) * 0.01
    cells, late = np.zeros(tr.CELLS + 2), [0.0]
    for k in range(1, t.size):
        late.append(tr._delayed(cells, 0, y[k] - y[k - 1], t[k], t[k] - t[k - 1], delay))
    begun = t > t[0] + delay
    then = np.interp(t - delay, t, y)
    np.testing.assert_allclose((y - late)[begun], then[begun], atol=1e-3 if delay < 1e-3 else 0.04)


def test_the_place_in_the_play_is_unknown_until_the_screw_has_crossed_it() -> None:
    p = with_values(RIG, {"backlash": 1e-4}).model.vector
    c = tr.carried_in(tr.slow_at_rest(p))
    assert c.high - c.low == pytest.approx(1e-4)
    x, screw, doubt = 0.0, 0.0, 0.0
    for _ in range(30):
        before = c
        c, x, grip = tr._behind_play(c, x, x + 1e-5, DT, p)
        screw, doubt = screw + 1e-5, doubt + tr.play_doubt(before.high - before.low, c.high - c.low)
    assert grip == 1.0 and c.low == c.high == pytest.approx(5e-5)
    assert x == pytest.approx(screw - 5e-5)  # half of the play, for nobody knows better
    assert doubt > 0.0
    back, _, grip = tr._behind_play(c, x, x - 4e-5, DT, p)
    assert grip == 0.0 and back.low == pytest.approx(1e-5)


# --- a failed channel ----------------------------------------------------------------------------

TUNING = np.array([SETTINGS.repeat_weight, SETTINGS.noisy_weight, SETTINGS.noisy_scale])


def failed(
    z: float, previous: float, variance: float = 0.0, sigma: float = 1.0, bias: float = 0.0
) -> tuple[float, float, float]:
    """Log-density, and mean and variance of the bias afterwards."""
    return tr.failed_channel(z, previous, 0.0, 0.0, sigma, SETTINGS.repeat_scale, bias, variance, TUNING)


def test_density_of_a_failed_channel_integrates_to_one() -> None:
    z = np.linspace(-3000.0, 3000.0, 3_000_001)
    density = np.exp([failed(v, 40.0, variance=9e4)[0] for v in z[::50]])
    fine = z[np.abs(z - 40.0) < 0.5]
    repeat = np.exp([failed(v, 40.0, variance=9e4)[0] for v in fine])
    smooth = np.abs(z[::50] - 40.0) >= 0.5
    total = density[smooth].sum() * 0.1 + np.trapezoid(repeat, fine)
    assert total == pytest.approx(1.0, abs=2e-3)


def test_a_bias_is_learned_and_a_burst_of_noise_is_not() -> None:
    bias, variance = 0.0, 9e4
    for _ in range(50):
        _, bias, variance = failed(200.0, np.inf, variance, bias=bias)
    assert bias == pytest.approx(200.0, abs=0.5) and variance < 0.1
    _, *after = failed(240.0, np.inf, variance, bias=bias)  # 40 sigma off: noise, not the bias
    np.testing.assert_allclose(after, [bias, variance], rtol=1e-6)


def test_a_repeated_reading_speaks_for_a_frozen_converter() -> None:
    assert failed(5.0, 5.0)[0] - failed(5.0, 4.0)[0] > 2.0
    assert np.isfinite(failed(5.0, np.inf)[0])


# --- what drives an unknown servo within an interval ------------------------------------------------


@pytest.mark.parametrize("dt", [0.01, 0.04])
def test_what_grows_within_an_interval_moves_the_motor_as_small_steps_say(dt: float) -> None:
    """Against 1000 steps of the covariance of w, I, x, with noise on w and I."""
    by_I, x_by_w, of_w, of_I, n = 300.0, 1e-4, 4.0, 2e-3, 1000
    F = np.eye(3) + dt / n * np.array([[0.0, by_I, 0.0], [0.0, 0.0, 0.0], [x_by_w, 0.0, 0.0]])
    P = np.zeros((3, 3))
    for _ in range(n):
        P = F @ P @ F.T + np.diag([of_w, of_I, 0.0]) / n
    p = meanwhile((of_w, 0.0, 0.0, of_I, 0.0, 0.0), of_w, of_I, by_I, x_by_w, dt)
    found = np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])
    np.testing.assert_allclose(found, P, rtol=5e-3, atol=1e-12 * P.max())


def test_a_current_grows_no_more_than_it_was_seen_to() -> None:
    p, growth, noise = ARRAYS.parameters[0], 1e-2, 1e-8
    z = np.array([[10.0, 1.0, 0.0]])
    nothing = tr.changed(z, 0, z[0], 0.0), tr.changed(z, 0, np.full(3, np.nan), 1.0)
    assert nothing == ((np.inf, np.inf),) * 2
    assert tr.grown_current(growth, nothing[0], noise, p) == growth
    still = tr.grown_current(growth, tr.changed(z, 0, z[0], 1.0), noise, p)
    assert still == pytest.approx(noise / p[a.KI] ** 2 + tr.LEAST * growth)
    alone = tr.changed(z, 0, np.array([np.nan, 0.9, 0.0]), 1.0)
    assert alone == pytest.approx((0.01, 0.0))
    jumped = tr.grown_current(growth, tr.changed(z, 0, np.array([0.0, 1.0, 0.0]), 1.0), noise, p)
    assert still < jumped <= growth
