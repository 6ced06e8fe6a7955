"""The bank on filterpy: equal to the compiled one, and one test for each trap of filterpy that fails without its cure."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator, MerweScaledSigmaPoints, UnscentedKalmanFilter
from hidden import make_log_with
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from moves import case, cut, holed, move, onset, rows
from scipy.linalg import cholesky, expm

from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank import transition as tr
from observer_fi.bank.filterpy_bank import Ekf, FilterpyBank, LogIMM, Observer, Step, Ukf
from observer_fi.bank.hypotheses import Hypothesis, arrays, bank
from observer_fi.bank.rig_scale import between_samples
from observer_fi.bank.ukf import factor
from observer_fi.logs.ingest import log_from_frame, read_log
from observer_fi.physics import rigs as models
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Log
from observer_fi.settings import BankSettings
from observer_fi.verdict.logger.as_logged import AsLogged

DATA = Path(__file__).parents[2] / "data"
SAMPLES = json.loads((DATA / "samples.json").read_text())
RIG = load_rig()
SETTINGS = BankSettings()
HYPOTHESES = bank(RIG, SETTINGS)
NOMINAL, OVERLOAD, LOOSE = HYPOTHESES[:3]
DT = 1.0 / 1600.0
STEADY = Step(DT, np.full((1, 2), 300.0), 300.0, 0.0)


def at_speed(
    kind: type[Observer], hypothesis: Hypothesis = NOMINAL, settings: BankSettings = SETTINGS
) -> Observer:
    """A filter in steady motion at 300 rad/s that has seen no sample yet."""
    f = kind(hypothesis, RIG, settings)  # type: ignore[call-arg]
    b = f.b
    f.x, f.P = b.entry_mean[0].copy(), np.diag(b.entry_var[0])
    f.x[:3] = 300.0, RIG.model["A"] / RIG.model["Km"] / RIG.model["Ki"], 0.01
    f.P[1, 1], f.P[2, 2] = 1e-6, 1e-9
    return f


def expected(f: Observer) -> np.ndarray:
    """(3,) what the filter expects to read at rest of the step."""
    return f._readings(f.x)[0]


def log_imm(filters: list[Observer], hypotheses: tuple[Hypothesis, ...], mu: list[float]) -> LogIMM:
    b = arrays(hypotheses, RIG, SETTINGS)
    with np.errstate(divide="ignore"):
        return LogIMM(filters, np.log(mu), b, SETTINGS.bias_entry, SETTINGS.mended)


# --- both engines ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize(
    ("seed", "label", "rate_hz"),
    [
        (3, "overload", 1600.0),
        (4, "coupling_loss", 1600.0),
        (6, "sensor_fault", 1600.0),
        (5, "nominal", 400.0),
        (3, "overload", 400.0),
    ],
)
@pytest.mark.first(1, 2)
def test_both_engines_say_the_same(seed: int, label: str, rate_hz: float, kind: str) -> None:
    """Around the onset and with missing readings; the start of the move where nothing happens."""
    first = 0.28 if label == "nominal" else onset(seed, label) - 0.04
    log = holed(cut(move(seed, label, rate_hz), first, first + 0.12), seed)
    ours = FilterpyBank(RIG, SETTINGS, filter_kind=kind).advance(log)
    compiled = kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(log)
    np.testing.assert_allclose(ours.probability, compiled.probability, rtol=0.0, atol=1e-8)
    np.testing.assert_array_equal(ours.probability.argmax(1), compiled.probability.argmax(1))
    np.testing.assert_array_equal(ours.active, compiled.active)
    np.testing.assert_array_equal(np.isnan(ours.normalised), np.isnan(compiled.normalised))
    for name in ("nis", "predicted", "normalised", "states", "density", "strain"):
        np.testing.assert_allclose(
            getattr(ours, name), getattr(compiled, name), rtol=1e-7, atol=1e-7, err_msg=name
        )


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize("voltage", [True, False])
def test_both_engines_say_the_same_of_a_slow_log_whose_servo_nobody_knows(voltage: bool, kind: str) -> None:
    """Through its start and a lost coupling, at 50 samples a second."""
    rig = replace(RIG, drive="voltage" if voltage else "current")
    settings = between_samples(BankSettings(), rig, 50.0)
    log = cut(move(4, "coupling_loss", 50.0), 0.0, onset(4, "coupling_loss") + 0.2)
    if not voltage:
        log = replace(log, z=np.where([True, False, False], np.nan, log.z))
    ours = FilterpyBank(rig, settings, filter_kind=kind).advance(log)
    compiled = kernels.Bank(rig, settings, filter_kind=kind).advance(log)
    assert settings.meanwhile == 1.0 and settings.repeat_weight == 0.0
    np.testing.assert_allclose(ours.probability, compiled.probability, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.density, compiled.density, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seconds"), [("ekf", 0.6), ("ukf", 0.5), pytest.param("ekf", 3.4, marks=pytest.mark.study)]
)
@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.first(1)
def test_both_engines_agree_on_the_sample_logs(name: str, kind: str, seconds: float) -> None:
    log = read_log(DATA / f"{name}.csv.gz")
    log = cut(log, log.t[0], log.t[0] + seconds)
    ours = FilterpyBank(RIG, SETTINGS, filter_kind=kind).advance(log)
    compiled = kernels.Bank(RIG, SETTINGS, filter_kind=kind).advance(log)
    np.testing.assert_allclose(ours.probability, compiled.probability, rtol=0.0, atol=1e-8)
    if seconds > 3.0:
        best = ours.modes[int(ours.probability[ours.active][-1].argmax())]
        assert best == SAMPLES[name]["label"]


SLOW_ENGINES = (
    ("position_100hz", "ekf"),
    ("position_averaged", "ekf"),
    ("hum_50hz", "ekf"),
    ("steps_3_all", "ukf"),
    ("voltage_late", "ukf"),
)


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("steps_3_all", "ekf"),
        ("voltage_late", "ekf"),
        ("position_100hz", "ukf"),
        *(pytest.param(name, kind, marks=pytest.mark.slow) for name, kind in SLOW_ENGINES),
    ],
)
def test_both_engines_agree_on_what_a_logger_leaves(name: str, kind: str) -> None:
    """Readings left out, steps, a rig with the logger's noise and delays; around the onset of a lost coupling."""
    spec = case(4, "coupling_loss")
    log = log_from_frame(make_log_with(name, spec, 4)[0])
    known = AsLogged(log, RIG, SETTINGS)
    assert known.rig is not RIG or not known.readings.plain
    at = onset(4, "coupling_loss")
    log = cut(known.take(log), at - 0.04, at + 0.12)
    ours = FilterpyBank(known.rig, known.settings, filter_kind=kind).advance(log)
    compiled = kernels.Bank(known.rig, known.settings, filter_kind=kind).advance(log)
    np.testing.assert_allclose(ours.probability, compiled.probability, rtol=0.0, atol=1e-8)
    np.testing.assert_array_equal(np.isnan(ours.normalised), np.isnan(compiled.normalised))
    for part in ("nis", "normalised", "states", "density", "strain"):
        np.testing.assert_allclose(
            getattr(ours, part), getattr(compiled, part), rtol=1e-7, atol=1e-7, err_msg=part
        )


def test_chunks_of_the_filterpy_bank_equal_the_whole() -> None:
    log = cut(move(3, "overload"), 0.4, 0.46)
    whole = FilterpyBank(RIG, SETTINGS).advance(log)
    parts = FilterpyBank(RIG, SETTINGS)
    got = [parts.advance(rows(log, s)) for s in (slice(0, 20), slice(20, 21), slice(21, 60), slice(60, None))]
    np.testing.assert_allclose(
        np.vstack([e.probability for e in got]), whole.probability, rtol=0.0, atol=1e-12
    )


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@examples(max_examples=10)
@given(data=st.data())
def test_no_input_makes_the_filterpy_bank_unlawful(kind: str, data: st.DataObject) -> None:
    n = data.draw(st.integers(2, 10))
    z = data.draw(arrays_of.arrays(float, (n, 3), elements=st.floats(allow_nan=True, allow_infinity=True)))
    w_cmd = np.array(
        data.draw(st.lists(st.sampled_from([0.0, 410.0, -1e300, np.nan]), min_size=n, max_size=n))
    )
    log = Log("any", np.arange(n) * DT, z, w_cmd, np.full(n, 5.0))
    got = FilterpyBank(RIG, SETTINGS, filter_kind=kind).advance(log)
    np.testing.assert_allclose(got.probability.sum(axis=1), 1.0, rtol=0.0, atol=1e-9)
    for name in ("probability", "nis", "predicted", "states", "density"):
        assert np.isfinite(getattr(got, name)).all(), name


def test_unknown_kind_of_filter_is_named() -> None:
    for make in (FilterpyBank, kernels.Bank):
        with pytest.raises(ValueError, match="one of ekf, ukf, got 'pf'"):
            make(RIG, SETTINGS, filter_kind="pf")


# --- filterpy's likelihood ------------------------------------------------------------------------


def test_density_counts_every_channel_where_filterpy_drops_small_eigenvalues() -> None:
    """A wide w makes the voltage's variance 1e12 times that of the position, in SI units: filterpy drops the position."""
    settings = BankSettings(glitch_sigma=1e3)
    drops, counts = [], []
    for off in (0.0, 20 * 1e-5):
        f = at_speed(Ekf, settings=settings)
        f.P[0, 0], f.P[2, 2] = 1e6, 1e-12
        z = expected(f) + [0.0, 0.0, off]
        plain = ExtendedKalmanFilter(f.n, 3)
        plain.x, plain.P, plain.R = f.x.copy(), f.P.copy(), np.diag(f.b.noise)
        y, H = f._readings(f.x)
        plain.update(z, HJacobian=lambda x, H=H: H, Hx=lambda x, y=y: y)
        drops.append(plain.log_likelihood)
        f.update(z)
        counts.append(f.log_density)
    assert (
        abs((drops[0] - drops[1]) - 0.5 * 20**2) > 50.0
    )  # the trap: nothing, or minus infinity where scipy notices
    assert counts[0] - counts[1] == pytest.approx(0.5 * 20**2, rel=0.02)


def test_hypotheses_far_below_the_floor_of_likelihoods_keep_their_order() -> None:
    """40 and 42 sigma off: filterpy's likelihood is 2.2e-308 for both."""
    settings = BankSettings(glitch_sigma=1e3, timing=0.0)
    near, far = at_speed(Ekf, settings=settings), at_speed(Ekf, settings=settings)
    imm = log_imm([near, far], (NOMINAL, NOMINAL), [0.5, 0.5])
    imm.predict(STEADY)
    spread = np.sqrt(1.0 + (near._predicted_readings()[1])[2, 2])
    z = np.array([np.nan, np.nan, expected(near)[2] + 40 * spread * 1e-5])
    far.x[2] -= 2 * spread * 1e-5
    plain = ExtendedKalmanFilter(1, 1)
    plain._log_likelihood, plain._likelihood = -0.5 * 40**2, None
    floor = plain.likelihood
    plain._log_likelihood, plain._likelihood = -0.5 * 42**2, None
    assert plain.likelihood == floor > 0.0  # the trap
    imm.update(z)
    assert near.log_density - far.log_density == pytest.approx(0.5 * (42**2 - 40**2), rel=1e-6)
    assert imm.mu[0] == pytest.approx(1.0, abs=1e-12)


# --- filterpy's IMM -------------------------------------------------------------------------------


def linear_pair() -> list[UnscentedKalmanFilter]:
    """Two plain UKFs of a position and its rate, one with more process noise."""
    pair = []
    for q in (1.0, 100.0):
        points = MerweScaledSigmaPoints(2, 1.0, 2.0, 0.0)
        f = UnscentedKalmanFilter(
            2, 1, 0.1, hx=lambda s: s[:1], fx=lambda s, dt: np.array([s[0] + dt * s[1], s[1]]), points=points
        )
        f.Q *= q
        pair.append(f)
    return pair


def test_a_bare_ekf_in_filterpys_imm_raises_and_ours_runs() -> None:
    plain = [ExtendedKalmanFilter(2, 1) for _ in range(2)]
    for f in plain:
        f.x = np.zeros(2)
    imm = IMMEstimator(plain, [0.5, 0.5], np.eye(2) * 0.8 + 0.1)
    imm.predict(0)
    with pytest.raises(TypeError, match="HJacobian"):
        imm.update(np.zeros(1))
    ours = log_imm([at_speed(Ekf), at_speed(Ekf)], (NOMINAL, NOMINAL), [0.5, 0.5])
    ours.predict(STEADY)
    ours.update(expected(ours.filters[0]))
    assert ours.mu == pytest.approx([0.5, 0.5])


def test_an_input_is_no_time_step() -> None:
    """A bare UKF in an IMM takes u for its dt."""
    plain = linear_pair()
    for f in plain:
        f.x = np.array([0.0, 1.0])
    imm = IMMEstimator(plain, [0.5, 0.5], np.eye(2))
    imm.predict(7.0)
    assert plain[0].x[0] == pytest.approx(7.0)  # the trap: 7 s, not 0.1 s with an input of 7
    f = at_speed(Ukf)
    f.predict(STEADY)
    assert f.x[2] == pytest.approx(0.01 + RIG.model["D"] * 300.0 * DT, rel=1e-6)


def test_missing_samples_follow_the_markov_chain_alone() -> None:
    """filterpy counts the last likelihood again at every update(None)."""
    pair = linear_pair()
    M = np.array([[0.999, 0.001], [0.001, 0.999]])
    plain = IMMEstimator(pair, [0.5, 0.5], M)
    plain.predict()
    plain.update(np.array([2.0]))
    before = plain.mu[1]
    for _ in range(20):
        plain.predict()
        plain.update(None)
    assert abs(plain.mu[1] - before) > 0.1  # the trap
    ours = log_imm([at_speed(Ekf), at_speed(Ekf, LOOSE)], (NOMINAL, LOOSE), [0.5, 0.5])
    ours.predict(STEADY)
    ours.update(expected(ours.filters[0]) + [0.01, 0.0, 0.0])
    mu = ours.mu
    assert abs(mu[0] - 0.5) > 1e-3
    for missing in [None, np.full(3, np.nan)] * 10:
        ours.predict(STEADY)
        ours.update(missing)
        assert [f.log_density for f in ours.filters] == [0.0, 0.0]
    np.testing.assert_allclose(ours.mu, mu @ expm(ours.b.rates * 20 * DT), rtol=1e-12)


def test_one_missing_reading_does_not_kill_the_bank() -> None:
    pair = linear_pair()
    plain = IMMEstimator(pair, [0.5, 0.5], np.eye(2) * 0.8 + 0.1)
    plain.predict()
    plain.update(np.array([np.nan]))
    assert np.isnan(plain.mu).all()  # the trap
    for kind in (Ekf, Ukf):
        ours = log_imm([at_speed(kind), at_speed(kind, LOOSE)], (NOMINAL, LOOSE), [0.5, 0.5])
        ours.predict(STEADY)
        z = expected(ours.filters[0])
        z[1] = np.nan
        ours.update(z)
        assert np.isfinite(ours.mu).all() and np.isfinite(ours.x).all()
        assert np.isnan(ours.filters[0].seen).tolist() == [False, True, False]


def test_a_hypothesis_that_nothing_leads_to_is_not_zero_by_zero() -> None:
    with np.errstate(invalid="ignore"):
        plain = IMMEstimator(linear_pair(), [1.0, 0.0], np.eye(2))
    assert np.isnan(plain.omega).any()  # the trap
    dead = log_imm([at_speed(Ekf), at_speed(Ekf)], (NOMINAL, NOMINAL), [1.0, 0.0])
    dead.b.rates[:] = 0.0
    dead.filters[1].x[2] += 5e-3  # 150 standard deviations: 1e4 nats, once it is no glitch any more
    for _ in range(8):
        dead.predict(STEADY)
        dead.update(np.array([np.nan, np.nan, 0.01]))
    assert np.isfinite(dead.filters[1].x).all() and np.isfinite(dead.mu).all()
    still = BankSettings(fault_rate=0.0, recovery_rate=0.0, between_rate=0.0)
    log = cut(
        move(4, "coupling_loss"), 0.28, onset(4, "coupling_loss") + 1.0
    )  # thousands of nats against all but one
    got = kernels.Bank(RIG, still).advance(log)
    assert np.isfinite(got.probability).all() and np.isfinite(got.predicted).all()
    assert 0.0 < got.probability[-1].min() < 1e-290


def test_rates_are_from_row_to_column() -> None:
    """filterpy's docstring has it the other way round."""
    imm = log_imm([at_speed(Ekf), at_speed(Ekf)], (NOMINAL, NOMINAL), [1.0 - 1e-9, 1e-9])
    imm.b.rates[:] = [[-1.0, 1.0], [0.0, 0.0]]
    for _ in range(160):
        imm.predict(STEADY)
        imm.update(None)
    assert imm.mu[1] == pytest.approx(1.0 - np.exp(-0.1), rel=1e-6)
    np.testing.assert_allclose(imm.M.sum(axis=1), 1.0, rtol=1e-12)


def test_moments_of_the_bank_are_new_arrays() -> None:
    pair = linear_pair()
    plain = IMMEstimator(pair, [0.5, 0.5], np.eye(2) * 0.8 + 0.1)
    kept = plain.x
    plain.predict()
    plain.update(np.array([5.0]))
    assert kept is plain.x and kept[0] != 0.0  # the trap
    ours = log_imm([at_speed(Ekf), at_speed(Ekf)], (NOMINAL, NOMINAL), [0.5, 0.5])
    x, P, mu = ours.x, ours.P, ours.mu
    copies = x.copy(), P.copy(), mu.copy()
    ours.predict(STEADY)
    ours.update(expected(ours.filters[0]) + 1e-3)
    for before, copy in zip((x, P, mu), copies, strict=True):
        np.testing.assert_array_equal(before, copy)


def test_hypotheses_of_different_states_mix_what_they_share() -> None:
    with pytest.raises(ValueError, match="same state dimension"):
        IMMEstimator([at_speed(Ekf), at_speed(Ekf, OVERLOAD)], [0.5, 0.5], np.eye(2))  # the trap
    source, target = at_speed(Ekf), at_speed(Ekf, OVERLOAD)
    source.x[0] = 310.0
    imm = log_imm([source, target], (NOMINAL, OVERLOAD), [1.0 - 1e-9, 1e-9])
    assert isinstance(imm, IMMEstimator)
    imm.predict(Step(np.nan, STEADY.interval, 300.0, 0.0))
    assert target.x[0] == 300.0  # nothing mixes before the first interval
    imm.predict(STEADY._replace(active=False))
    assert target.x[0] < 301.0  # nor while nothing counts as evidence
    imm.predict(STEADY)
    weight = imm.omega[0, 1]
    assert weight > 0.99 and abs(target.x[0] - source.x[0]) < 1.0
    own = [k for k, state in enumerate(OVERLOAD.states) if state not in NOMINAL.states]
    np.testing.assert_allclose(target.x[own], target.b.entry_mean[0, own], atol=2e-6)
    np.testing.assert_allclose(np.diag(target.P)[own], target.b.entry_var[0, own], rtol=0.3)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_glitch_counts_at_the_gate_and_moves_nothing(kind: str) -> None:
    """For three samples; the fourth in a row is believed."""
    log = cut(move(5, "nominal"), 0.5, 0.53)
    k = log.t.size - 6
    for make in (FilterpyBank, kernels.Bank):
        ends = []
        for spikes, reading in ((3, log.z[k, 0] + 5.0), (3, np.nan), (4, log.z[k, 0] + 5.0)):
            spoilt = rows(log, slice(None))
            spoilt.z[k : k + spikes, 0] = reading
            got = make(RIG, SETTINGS, (NOMINAL, NOMINAL), filter_kind=kind).advance(spoilt)
            ends.append(got)
        np.testing.assert_allclose(ends[0].states, ends[1].states, rtol=1e-12)
        assert ends[0].nis[k, 0] - ends[1].nis[k, 0] == pytest.approx(SETTINGS.glitch_sigma**2, rel=1e-6)
        assert abs(ends[2].states[-1, 0] - ends[1].states[-1, 0]) > 0.5


# --- filterpy's filters ---------------------------------------------------------------------------


def test_the_mean_moves_by_the_equations_not_by_the_jacobian() -> None:
    f = at_speed(Ekf)
    f.x[:2] = 50.0, 1.5  # saturated
    x = f.x.copy()
    assert not f._moved(x, tr.slow_at_rest(f.base), STEADY)
    before = f.x.copy()
    f.predict(STEADY)
    np.testing.assert_array_equal(f.x, x)
    assert abs((f.F @ before)[0] - f.x[0]) > 1.0  # the trap: filterpy's predict_x


def test_states_stay_one_dimensional() -> None:
    plain = ExtendedKalmanFilter(2, 1)
    assert plain.x.shape == (2, 1)
    plain.update(np.zeros(1), HJacobian=lambda x: np.array([[1.0, 0.0]]), Hx=lambda x: np.zeros(1))
    column = ExtendedKalmanFilter(2, 2)
    column.update(np.ones(2), HJacobian=lambda x: np.eye(2), Hx=lambda x: x)
    assert column.x.shape == (2, 2)  # the trap
    for kind in (Ekf, Ukf):
        f = at_speed(kind)
        f.predict(STEADY)
        f.update(expected(f))
        assert f.x.shape == (f.n,) and f.P.shape == (f.n, f.n)


def test_a_covariance_that_rounding_spoilt_still_has_sigma_points() -> None:
    """Flat and a little asymmetric, as after a 10 nm sensor took its share of P = I."""
    P = np.array([[1.0, 1.0 + 1e-15, 0.0], [1.0 - 1e-15, 1.0 - 1e-13, 0.0], [0.0, 0.0, 1e-16]])
    with pytest.raises(np.linalg.LinAlgError):
        cholesky(P)  # the trap
    L = np.zeros((3, 3))
    factor(0.5 * (P + P.T), 3, L)
    np.testing.assert_allclose(L @ L.T, 0.5 * (P + P.T), rtol=0.0, atol=2e-12)
    sharp = models.Rig(RIG.name, "", RIG.drive, RIG.quantities, RIG.noise | {"position": 1e-8})
    settings = BankSettings(augment=False, glitch_sigma=1e12)
    f = Ukf(bank(sharp, settings)[0], sharp, settings)
    assert (np.eye(3) == f.P).all()
    f.x[0] = 300.0
    for k in range(50):
        f.predict(STEADY)
        f.update(np.array([9.0, 0.02, 1e-3 + 1e-8 * (-1) ** k]))
    assert np.isfinite(f.x).all() and np.isfinite(f.P).all()
    assert f.x[2] == pytest.approx(1e-3, abs=2e-6)  # it expects 0.4 um of travel a sample
