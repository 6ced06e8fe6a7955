"""The compiled bank: textbook oracles, reductions, laws, rates, chunks, consistency with the hidden truth."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import oracles
import pytest
from hidden import true_motion
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from moves import case, cut, holed, move, onset, rows
from scipy.linalg import expm
from scipy.stats import chi2

from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank.bank_state import state_of
from observer_fi.bank.filterpy_bank import FilterpyBank
from observer_fi.bank.first_state import first_readings, start
from observer_fi.bank.hypotheses import Hypothesis, bank, transition_rates
from observer_fi.physics.rigs import load_rig, override, with_values
from observer_fi.records import Estimate, Log
from observer_fi.settings import BankSettings

RIG = load_rig()
SETTINGS = BankSettings()
KINDS = ("ekf", "ukf")
DT = 1.0 / 1600.0
SPEED = 300.0
# No friction and no limit of the voltage: the servo is linear, and nothing but its noise is uncertain.
LINEAR_RIG = with_values(RIG, {"A": 1e-30, "A_decoupled": 1e-30, "B": 1e-30, "Vmax": 1e6})
LINEAR = BankSettings(augment=False, timing=0.0, agility=0.0, tick_s=0.0, glitch_sigma=1e6, bias_entry=1.0)


def linear_hypothesis(name: str, factor: float = 1.0) -> Hypothesis:
    """The linear servo with this much of its inertia."""
    model = LINEAR_RIG.model
    return Hypothesis(name, name, override(model, name, J=factor * model["J"]), ("w", "I", "x"))


def linear_log(n: int, seed: int = 0) -> Log:
    """Steady motion and the sensors' noise, with missing readings."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) * DT
    z = np.column_stack(
        (np.full(n, LINEAR_RIG.model["Km"] * SPEED), np.zeros(n), LINEAR_RIG.model["D"] * SPEED * t)
    )
    z += rng.normal(size=z.shape) * LINEAR_RIG.noise_std
    z[n // 3 : n // 3 + 5] = np.nan
    return Log("linear", t, z, np.full(n, SPEED), np.zeros(n))


def textbook_start(h: Hypothesis, log: Log) -> tuple[np.ndarray, np.ndarray]:
    made = kernels.Bank(LINEAR_RIG, LINEAR, (h,))
    (first,) = start((h,), made.arrays, first_readings(log.z, SPEED), SPEED, LINEAR_RIG.driven)
    return first.x, first.P


def textbook_update(
    h: Hypothesis, x: np.ndarray, P: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """The oracle's update in units of the sensors' sigma, its density back in SI."""
    if np.isnan(z).any():
        return x, P, 0.0
    *_, H, direct = oracles.servo(h.model, DT)
    sigma = LINEAR_RIG.noise_std
    x, P, density = oracles.kalman_update(x, P, (z - direct * SPEED) / sigma, H / sigma[:, None], np.eye(3))
    return x, P, density - np.log(sigma).sum()


def textbook_step(
    h: Hypothesis, x: np.ndarray, P: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    F, push, *_ = oracles.servo(h.model, DT)
    Q = np.diag(kernels.Bank(LINEAR_RIG, LINEAR, (h,)).arrays.diffusion[0] * DT)
    return textbook_update(h, *oracles.kalman_predict(x, P, F, Q, push * SPEED), z)


def assert_moments(x: np.ndarray, P: np.ndarray, x_true: np.ndarray, P_true: np.ndarray) -> None:
    """Equal to 1e-10 of what a standard deviation can resolve."""
    std = np.sqrt(np.diag(P_true))
    np.testing.assert_allclose(x / std, x_true / std, rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(P / np.outer(std, std), P_true / np.outer(std, std), rtol=0.0, atol=1e-8)


# --- oracles and reductions -----------------------------------------------------------------------


def moments_of(made: kernels.Bank) -> list[tuple[np.ndarray, np.ndarray]]:
    """Mean (n,) and covariance (n, n) of each hypothesis after the last sample."""
    assert made.state is not None
    memories = [state_of(made.state, j, at) for j, at in enumerate(made.seats)]
    return [(memory.x, memory.P) for memory in memories]


@pytest.mark.parametrize("kind", KINDS)
def test_one_linear_hypothesis_is_a_kalman_filter(kind: str) -> None:
    h, log = linear_hypothesis("nominal"), linear_log(60)
    x, P = textbook_start(h, log)
    x, P, density = textbook_update(h, x, P, log.z[0])
    densities = [density]
    for z in log.z[1:]:
        x, P, density = textbook_step(h, x, P, z)
        densities.append(density)
    made = kernels.Bank(LINEAR_RIG, LINEAR, (h,), filter_kind=kind)
    got = made.advance(log)
    np.testing.assert_allclose(got.density[:, 0], densities, rtol=1e-10, atol=1e-8)
    assert_moments(*moments_of(made)[0], x, P)


@pytest.mark.parametrize("kind", KINDS)
def test_linear_hypotheses_are_a_textbook_imm(kind: str) -> None:
    hypotheses = tuple(linear_hypothesis(f"J{f}", f) for f in (1.0, 0.5, 3.0))
    settings = BankSettings(
        **{**LINEAR.__dict__, "fault_rate": 2.0, "recovery_rate": 1.0, "between_rate": 0.5}
    )
    log = linear_log(60, seed=1)
    log.w_cmd[:] = SPEED
    M = expm(transition_rates(hypotheses, settings) * DT)
    moments = [textbook_update(h, *textbook_start(h, log), log.z[0])[:2] for h in hypotheses]
    mu = np.array([1.0 - 2e-9, 1e-9, 1e-9])
    expected = [mu]
    steps = [lambda x, P, z, h=h: textbook_step(h, x, P, z) for h in hypotheses]
    for z in log.z[1:]:
        mu, moments, _ = oracles.imm_step(mu, moments, M, z, steps)
        expected.append(mu)
    made = kernels.Bank(LINEAR_RIG, settings, hypotheses, filter_kind=kind)
    got = made.advance(log)
    np.testing.assert_allclose(got.probability, expected, rtol=0.0, atol=1e-10)
    for found, (x, P) in zip(moments_of(made), moments, strict=True):
        assert_moments(*found, x, P)


def test_ekf_and_ukf_of_a_linear_bank_agree() -> None:
    hypotheses = tuple(linear_hypothesis(f"J{f}", f) for f in (1.0, 0.5))
    log = linear_log(200, seed=3)
    ekf, ukf = (kernels.Bank(LINEAR_RIG, LINEAR, hypotheses, filter_kind=k).advance(log) for k in KINDS)
    np.testing.assert_allclose(ekf.probability, ukf.probability, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(ekf.nis, ukf.nis, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_equal_hypotheses_are_one_filter(kind: str) -> None:
    """And the evidence moves no probability: they follow the Markov chain."""
    log = cut(move(5, "nominal"), 0.25, 0.6)
    nominal = bank(RIG, SETTINGS)[0]
    three = kernels.Bank(RIG, SETTINGS, (nominal,) * 3, filter_kind=kind).advance(log)
    one = kernels.Bank(RIG, SETTINGS, (nominal,), filter_kind=kind).advance(log)
    for j in range(3):
        np.testing.assert_allclose(three.nis[:, j], one.nis[:, 0], rtol=1e-6, atol=1e-8)
    steps = int(three.active.sum())
    chain = np.array([1.0 - 2e-9, 1e-9, 1e-9]) @ expm(transition_rates((nominal,) * 3, SETTINGS) * DT * steps)
    np.testing.assert_allclose(three.probability[-1], chain, rtol=0.0, atol=1e-10)


# --- laws -----------------------------------------------------------------------------------------


def assert_lawful(got: Estimate) -> None:
    np.testing.assert_allclose(got.probability.sum(axis=1), 1.0, rtol=0.0, atol=1e-9)
    assert (got.probability >= 0.0).all()
    for name in ("probability", "nis", "predicted", "states", "density", "strain"):
        assert np.isfinite(getattr(got, name)).all(), name


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
plausible = st.one_of(st.floats(-20.0, 20.0), st.just(np.nan))
commands = st.sampled_from([0.0, 1e-3, 205.0, 410.0, -410.0, 1e5, -1e300, np.nan])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("values", [anything, plausible], ids=["anything", "plausible"])
@examples(max_examples=40)
@given(data=st.data())
def test_no_input_makes_the_bank_unlawful(
    kind: str, values: st.SearchStrategy[float], data: st.DataObject
) -> None:
    n = data.draw(st.integers(2, 30))
    steps = data.draw(
        st.lists(st.sampled_from([1e-5, DT, DT, DT, 2.5e-3, 0.05, 0.5]), min_size=n, max_size=n)
    )
    z = data.draw(arrays_of.arrays(float, (n, 3), elements=values))
    w_cmd = np.array(data.draw(st.lists(commands, min_size=n, max_size=n)))
    pitch = np.array(
        data.draw(st.lists(st.sampled_from([0.0, 12.0, -90.0, 1e300, np.nan]), min_size=n, max_size=n))
    )
    got = kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(Log("any", np.cumsum(steps), z, w_cmd, pitch))
    assert got.t.size == n
    assert_lawful(got)


@examples(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    share=st.floats(0.0, 1.0),
    label=st.sampled_from(["nominal", "overload", "coupling_loss"]),
)
def test_any_mask_leaves_the_bank_lawful(seed: int, share: float, label: str) -> None:
    log = holed(cut(move(5 if label == "nominal" else 3, label), 0.28, 0.9), seed, share)
    assert_lawful(kernels.Bank(RIG, SETTINGS).advance(log))


@pytest.mark.parametrize("kind", KINDS)
def test_missing_samples_follow_the_markov_chain(kind: str) -> None:
    made = kernels.Bank(RIG, SETTINGS, filter_kind=kind)
    log = cut(move(3, "overload"), 0.28, onset(3, "overload") + 0.1)
    half = log.t.size - 100
    log.z[half:] = np.nan
    got = made.advance(log)
    M = expm(transition_rates(made.hypotheses, SETTINGS) * DT)
    assert got.active[half:].all()
    for k in range(half, log.t.size):
        np.testing.assert_allclose(got.probability[k], got.probability[k - 1] @ M, rtol=0.0, atol=1e-12)
    assert (got.nis[half:] == 0.0).all() and (got.density[half:] == 0.0).all()


def test_rest_overturns_nothing() -> None:
    log = move(3, "overload")
    got = kernels.Bank(RIG, SETTINGS).advance(log)
    last = np.flatnonzero(got.active)[-1]
    assert last < log.t.size - 100
    np.testing.assert_allclose(got.probability[last:] - got.probability[last], 0.0, atol=1e-15)


# --- rates, gaps, chunks --------------------------------------------------------------------------


def isolated_at(got: Estimate, log: Log) -> float:
    """When the last winner's probability went above 0.95 to stay."""
    below = np.flatnonzero(got.probability[:, got.probability[-1].argmax()] < 0.95)
    return float(log.t[below[-1]]) if below.size else float(log.t[0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("label", "seed"), [(l, s) for l in ("nominal", "overload", "coupling_loss") for s in (1, 2, 3, 4)]
)
def test_four_times_fewer_samples_say_the_same(label: str, seed: int, kind: str) -> None:
    """The same motion at 400 and 1600 samples a second. A coarser clock and a quarter of the readings cost at most 40 ms."""
    fine = cut(move(seed, label), 0.0, onset(seed, label) + 0.9)
    coarse = rows(fine, slice(None, None, 4))
    a, b = (kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(log) for log in (fine, coarse))
    assert a.modes[int(a.probability[-1].argmax())] == b.modes[int(b.probability[-1].argmax())] == label
    assert abs(a.probability[-1].max() - b.probability[-1].max()) < 1e-3
    if label != "nominal":
        assert abs(isolated_at(a, fine) - isolated_at(b, coarse)) < 0.04


def test_probabilities_are_per_second_not_per_sample() -> None:
    """Half a second of motion without a reading leads to the same prior at any rate."""
    ends = []
    for rate in (400.0, 1600.0, 3200.0):
        t = np.arange(int(0.5 * rate) + 1) / rate
        log = Log("blind", t, np.full((t.size, 3), np.nan), np.full(t.size, 300.0), np.zeros(t.size))
        ends.append(kernels.Bank(RIG, SETTINGS).advance(log).probability[-1])
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, rtol=1e-6)


@pytest.mark.parametrize("gap_s", [0.005, 0.05, 0.3, 1.0])
def test_a_gap_in_a_move_is_bridged(gap_s: float) -> None:
    """One step over a gap would be unstable beyond 10 ms: the mean after it was volts off, and an overload unknown."""
    for label, seed in (("nominal", 5), ("overload", 3)):
        log = move(seed, label)
        holey = rows(log, (log.t < 1.5) | (log.t >= 1.5 + gap_s))
        got = kernels.Bank(RIG, SETTINGS).advance(holey)
        assert got.t.size == holey.t.size
        k = int(np.searchsorted(holey.t, 1.5))
        best = got.modes.index(label)
        assert (got.probability[k : k + 800, best] > 0.99).all()
        assert abs(got.predicted[k, best, 0] - holey.z[k, 0]) < 0.1  # ten sigma of the sensor


@pytest.mark.parametrize("kind", KINDS)
def test_chunks_equal_the_whole(kind: str) -> None:
    log = holed(cut(move(4, "coupling_loss"), 0.0, 1.5), 0)
    whole = kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(log)
    rng = np.random.default_rng(0)
    edges = [0, *sorted(rng.choice(np.arange(10, log.t.size), 12, replace=False)), log.t.size]
    parts = kernels.Bank(RIG, SETTINGS, filter_kind=kind)
    got = [parts.advance(rows(log, slice(a, b))) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    for name in ("probability", "nis", "predicted", "normalised", "states", "density", "strain", "active"):
        joined = np.concatenate([getattr(e, name) for e in got])
        np.testing.assert_array_equal(joined, getattr(whole, name), err_msg=name)


def test_sample_by_sample_equals_the_whole() -> None:
    log = cut(move(3, "overload"), 0.25, 0.6)
    whole = kernels.Bank(RIG, SETTINGS).advance(log)
    parts = kernels.Bank(RIG, SETTINGS)
    got = [parts.advance(rows(log, slice(0, 10)))] + [
        parts.advance(rows(log, slice(k, k + 1))) for k in range(10, log.t.size)
    ]
    np.testing.assert_array_equal(np.vstack([e.probability for e in got]), whole.probability)


_WITHOUT_COMPILER = """
import json, sys
import numpy as np
from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank.bank_state import state_of
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Log
from observer_fi.settings import BankSettings
log = Log("", *(np.array(a) for a in json.load(sys.stdin)))
out = [kernels.Bank(load_rig(), BankSettings(), filter_kind=k).advance(log).probability.tolist() for k in ("ekf", "ukf")]
json.dump(out, sys.stdout)
"""


@pytest.mark.slow
def test_works_without_the_compiler() -> None:
    log = cut(move(4, "coupling_loss"), onset(4, "coupling_loss") - 0.02, onset(4, "coupling_loss") + 0.012)
    assert 45 < log.t.size < 60
    given_log = json.dumps([log.t.tolist(), log.z.tolist(), log.w_cmd.tolist(), log.pitch.tolist()])
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT_COMPILER], input=given_log, capture_output=True, text=True, check=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    for kind, expected in zip(KINDS, json.loads(done.stdout), strict=True):
        got = kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(log).probability
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-9)


# --- consistency ----------------------------------------------------------------------------------

SEEDS = range(20)
INSTANTS = (0.12, 0.2, 0.33, 0.36, 1.0, 1.3, 1.6)  # twice at rest, saturated, ringing, in steady motion
REST, SATURATED, RINGING, STEADY = slice(0, 2), 2, 3, slice(4, 7)


@cache
def healthy(seed: int) -> tuple[Log, np.ndarray]:
    """Two seconds of a healthy move, and its true w, I, x (n, 3)."""
    truth = true_motion(case(seed, "nominal"))
    log = cut(move(seed, "nominal"), 0.0, 2.0)
    return log, np.column_stack((truth.speed, truth.integral, truth.position))[: log.t.size]


def errors(seed: int, kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the nominal filter: errors (k, 3) of w, I, x and their covariances at the INSTANTS; NIS (n,)."""
    log, truth = healthy(seed)
    made = kernels.Bank(RIG, SETTINGS, filter_kind=kind)
    off, P, nis = [], [], []
    edges = [0, *(int(np.searchsorted(log.t, t)) for t in INSTANTS), log.t.size]
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        nis.append(made.advance(rows(log, slice(a, b))).nis[:, 0])
        x, covariance = moments_of(made)[0]
        off.append(x[:3] - truth[b - 1])
        P.append(covariance[:3, :3])
    return np.array(off[:-1]), np.array(P[:-1]), np.concatenate(nis)


def bounds(size: int) -> tuple[float, float]:
    """99 % interval of the mean over SEEDS of a chi-square of this size."""
    low, high = chi2.ppf([0.005, 0.995], size * len(SEEDS)) / len(SEEDS)
    return float(low), float(high)


def mean_nees(off: np.ndarray, P: np.ndarray, states: list[int]) -> np.ndarray:
    """Mean over seeds of the normalised squared error of some states, (k,)."""
    e, S = off[..., states], P[..., states, :][..., states]
    return np.einsum("skc,skc->sk", e, np.linalg.solve(S, e[..., None])[..., 0]).mean(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.first(1)
def test_filters_know_how_wrong_they_are(kind: str) -> None:
    """NEES of w, I, x and NIS of 20 healthy rigs, each with its own friction, against chi-square bounds.

    Both bounds hold at rest, and for x in the start. In starts and in steady motion the filters are cautious (their
    variances grow as a start of a rig that is off needs it), so only the upper bound can hold.
    """
    runs = [errors(seed, kind) for seed in SEEDS]
    off, P, nis = (np.array(part) for part in zip(*runs, strict=True))
    x, all_three = mean_nees(off, P, [2]), mean_nees(off, P, [0, 1, 2])
    (low_1, high_1), (low_3, high_3) = bounds(1), bounds(3)
    assert (x[:4] > low_1).all() and (x < high_1).all(), x
    assert (all_three[REST] > low_3).all() and (all_three[REST] < high_3).all(), all_three
    assert (all_three[STEADY] < high_3).all() and (all_three[STEADY] > 0.3).all(), all_three
    assert all_three[SATURATED] < high_3 and all_three[RINGING] < high_3, all_three
    assert np.sqrt((off[:, RINGING, 1] ** 2).mean()) < 5e-3
    assert 2.85 < nis[:, 1600:2080].mean() < 3.15  # 9600 dependent samples: 3 within 5 %
    assert nis[:, 480:576].mean() < 3.0


# --- hypotheses side by side ----------------------------------------------------------------------


def test_the_order_in_which_hypotheses_name_their_states_does_not_matter() -> None:
    log = cut(move(3, "overload"), 0.25, onset(3, "overload") + 0.1)
    usual = bank(RIG, SETTINGS)
    turned = tuple(
        replace(h, states=(*h.states[:3], *h.states[:2:-1])) if k % 2 else h for k, h in enumerate(usual)
    )
    a, b = (kernels.Bank(RIG, SETTINGS, hypotheses).advance(log) for hypotheses in (usual, turned))
    np.testing.assert_allclose(a.probability, b.probability, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(a.density, b.density, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("kind", KINDS)
def test_more_hypotheses_and_states_than_a_row_has_numbers(kind: str) -> None:
    """Ten hypotheses, one of them with twelve states, against filterpy."""
    log = cut(move(3, "overload"), onset(3, "overload") - 0.05, onset(3, "overload") + 0.05)
    usual = bank(RIG, SETTINGS)
    every = tuple(dict.fromkeys(state for h in usual for state in h.states))
    own = tuple({s.name: s for h in usual for s in h.own}.values())
    rich = replace(usual[1], name="rich", states=every[:12], own=own)
    hypotheses = (*usual, rich, *usual[1:3])
    got, expected = (
        made(RIG, SETTINGS, hypotheses, filter_kind=kind).advance(log)
        for made in (kernels.Bank, FilterpyBank)
    )
    assert got.probability.shape[1] == 10 and len(rich.states) == 12
    np.testing.assert_allclose(got.probability, expected.probability, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(got.density, expected.density, rtol=1e-5, atol=1e-5)


def test_two_runs_write_the_same_bits_wherever_their_arrays_lie() -> None:
    """LLVM chooses between two forms of a loop by the addresses of its arrays: both have to round alike."""
    log = cut(move(3, "overload"), 0.2, 0.5)
    rng, held, found = np.random.default_rng(0), [], set()
    for _ in range(40):
        held.append([np.full(int(rng.integers(1, 3000)), np.nan) for _ in range(20)])
        got = kernels.Bank(RIG, SETTINGS).advance(log)
        found.add((got.probability.tobytes(), got.density.tobytes(), got.predicted.tobytes()))
    assert len(found) == 1
