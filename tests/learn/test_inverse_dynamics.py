"""Inverse dynamics of force-driven rigs, on a rig that shares no code with the package (force_rig.py)."""

from dataclasses import replace

import numpy as np
import pytest
from force_rig import COULOMB, DRAG, MASS, TURN, VISCOUS, D, Truth, log, rig

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.learn.inverse_checks import predict, tune
from observer_fi.learn.inverse_columns import TERMS, Columns
from observer_fi.learn.inverse_dynamics import (
    Structure,
    correlated,
    held_out,
    identify_force,
    least_squares,
    parameters_of,
    solve,
    structure_of,
)
from observer_fi.learn.inverse_motion import low_passed, prepare_motion, sensor_noise
from observer_fi.physics.rigs import Quantity, load_rig

# --- columns ---


@pytest.mark.parametrize(
    ("term", "textbook"),
    [
        ("J", lambda m: m.a / D**2),
        ("A", lambda m: np.sign(m.v) / D),
        ("viscous_positive+viscous_negative", lambda m: m.v / D**2),
        ("viscous_positive-viscous_negative", lambda m: np.abs(m.v) / D**2),
        ("torque_offset", lambda m: np.ones_like(m.v) / D),
        ("stribeck_torque", lambda m: np.sign(m.v) * np.exp(-((m.v / D / 30.0) ** 2)) / D),
        ("friction_slope", lambda m: np.sign(m.v) * m.x / D),
        ("shaft_ripple_sin", lambda m: np.sin(4.0 * np.pi * m.x / TURN) / D),
    ],
)
def test_column_is_textbook(term, textbook):
    motion = prepare_motion(log(Truth(), 5.0))
    shapes = {"stribeck_speed": 30.0, "shaft_order": 2.0}
    got = Columns(rig()).term(motion, TERMS[term], shapes)
    want = low_passed(textbook(motion), motion)
    assert np.abs(got - want).max() <= 1e-8 * np.abs(want).max()


def test_delay_shifts_the_force_and_lag_is_a_delay_of_its_time_constant():
    motion = prepare_motion(log(Truth(), 5.0))
    columns = Columns(rig())
    late = columns.force(motion, {"input_delay": 2e-3})
    lagged = columns.force(motion, {"current_lag": 2e-3})
    slope = np.gradient(columns.force(motion, {}), motion.t)
    inner = slice(10, -10)
    assert np.std((late - columns.force(motion, {}) + 2e-3 * slope)[inner]) < 0.25 * np.std(
        2e-3 * slope[inner]
    )
    assert np.std((late - lagged)[inner]) < 0.25 * np.std(2e-3 * slope[inner])


def test_low_pass_keeps_constants_and_the_last_sample():
    motion = prepare_motion(log(Truth(), 5.0))
    assert np.allclose(
        low_passed(np.ones(motion.x.size), motion), 10 ** (-0.05 / 10), rtol=1e-6
    )  # twice -0.05 dB / 2
    assert motion.t[-1] == motion.clock[-1]


def test_sensor_noise_is_found():
    noise = 1e-6 * np.random.default_rng(0).standard_normal(20000)
    assert sensor_noise(np.linspace(0.0, 0.1, 20000) + noise) == pytest.approx(1e-6, rel=0.03)


# --- least squares ---


def test_held_out_equals_fits_without_the_part():
    motion = prepare_motion(log(Truth(DRAG, DRAG), 20.0))
    columns = Columns(rig(**VISCOUS))
    solution = solve(columns, [motion], structure_of(columns.rig, [motion]))
    seen = held_out(solution)
    for k in np.unique(solution.part):
        out = solution.part == k
        theta = least_squares(solution.jacobian[~out], solution.force[~out])
        assert np.allclose(seen[out], solution.force[out] - solution.jacobian[out] @ theta, atol=1e-8)


def test_white_residuals_are_uncorrelated():
    rng = np.random.default_rng(3)
    column = rng.standard_normal((4000, 1))
    inflation = (column.T @ correlated(column, rng.standard_normal(4000)))[0, 0] / (column.T @ column)[0, 0]
    assert inflation == pytest.approx(1.0, abs=0.2)  # a hundred lags of sampling error


def test_standard_errors_of_correlated_residuals():
    """A mean of AR(1) noise: the textbook says (1 + a) / (1 - a) times the variance of white noise."""
    a, rng = 0.8, np.random.default_rng(5)
    found = []
    for _ in range(40):
        e = rng.standard_normal(4000)
        for k in range(1, e.size):
            e[k] += a * e[k - 1]
        column = np.ones((e.size, 1))
        found.append(float((column.T @ correlated(column, e))[0, 0]) / e.size)
    assert np.mean(found) == pytest.approx(
        (1 + a) / (1 - a), rel=0.25
    )  # the taper and the mean take a little off


# --- identification ---


def test_identify_recovers():
    truth = Truth(DRAG, 210.0, offset=1.5)
    own = rig(
        viscous_positive=Quantity(1e-6, "N m s/rad"),
        viscous_negative=Quantity(2e-6, "N m s/rad"),
        torque_offset=Quantity(1e-4, "N m"),
    )
    fit = identify_force([log(truth)], own)
    values = {p.name: p.value for p in fit.parameters}
    assert values["J"] / D**2 == pytest.approx(MASS, rel=2e-3)
    assert values["A"] / D == pytest.approx(COULOMB, rel=2e-3)
    assert values["viscous_positive"] / D**2 == pytest.approx(DRAG, rel=5e-3)
    assert values["viscous_negative"] / D**2 == pytest.approx(210.0, rel=5e-3)
    assert values["torque_offset"] / D == pytest.approx(1.5, rel=2e-2)
    assert fit.rmse["force_n"] < 0.2
    assert np.allclose(np.diag(fit.correlation), 1.0)
    assert "position_gain" in fit.not_identifiable


def test_identify_says_what_it_cannot_tell():
    one = log(Truth(DRAG, DRAG), 4.0, seed=2)
    still = np.abs(np.gradient(one.z[:, 2], one.t)) < 1e-3
    turn = int(np.argmax(still[500:])) + 500  # the first stroke only: one direction
    part = replace(one, t=one.t[:turn], z=one.z[:turn], force=one.force[:turn], pitch=one.pitch[:turn])
    offset = Quantity(1e-4, "N m")
    fit = identify_force([part], rig(torque_offset=offset))
    assert {"A", "torque_offset"} <= set(fit.not_identifiable)
    assert not {"A", "torque_offset"} & {p.name for p in fit.parameters}


def test_gaps_and_masked_samples_do_no_harm():
    whole = log(Truth(DRAG, DRAG))
    keep = np.ones(whole.t.size, dtype=bool)
    keep[7000:7050] = False
    z = whole.z.copy()
    z[12000:12003, 2] = np.nan
    holed = replace(whole, t=whole.t[keep], z=z[keep], force=whole.force[keep], pitch=whole.pitch[keep])
    fit = identify_force([holed], rig(**VISCOUS))
    assert {p.name: p.value for p in fit.parameters}["J"] / D**2 == pytest.approx(MASS, rel=2e-3)
    assert fit.rmse["force_n"] < 0.2


def test_two_logs_may_differ_in_friction():
    logs = [log(Truth(DRAG, DRAG), seed=4), replace(log(Truth(DRAG, DRAG), seed=5))]
    logs[1] = replace(logs[1], force=logs[1].force + 2.0 * np.sign(np.gradient(logs[1].z[:, 2])))
    motions = [prepare_motion(one) for one in logs]
    own = rig(**VISCOUS)
    solution = solve(Columns(own), motions, structure_of(own, motions))
    level = {c.log: th / D for c, th in zip(solution.coefficients, solution.theta, strict=True) if c.log}
    assert level == {"seed5": pytest.approx(1.0, abs=0.05)}  # half the difference: from the mean of the two
    assert parameters_of(solution)["A"][0] / D == pytest.approx(COULOMB + 1.0, abs=0.05)


def test_wrong_rig_or_log_is_one_line():
    with pytest.raises(UsageError, match="driven by pi_servo"):
        identify_force([log(Truth(), 3.0)], load_rig())
    with pytest.raises(InvalidLogError, match="force_cmd_n is missing"):
        identify_force([replace(log(Truth(), 3.0), force=None)], rig())
    still = log(Truth(), 3.0)
    with pytest.raises(InvalidLogError, match="no motion"):
        identify_force([replace(still, z=np.zeros_like(still.z))], rig())


# --- forward ---


@pytest.mark.slow
def test_observer_gains_from_the_right_model():
    one = log(Truth(DRAG, 210.0, noise=2e-8), 8.0)
    motion = prepare_motion(one)
    right = rig(viscous_positive=Quantity(1e-6, "N m s/rad"), viscous_negative=Quantity(2e-6, "N m s/rad"))
    scores = []
    for own in (rig(), right):
        solution = solve(Columns(own), [motion], structure_of(own, [motion]))
        found = predict(own, solution, one, tune(own, solution, one), 50)
        scores.append((found.nll(500), found.rms_ahead(500)))
    assert scores[1][0] < scores[0][0]
    assert scores[1][1] < 0.5 * scores[0][1]


def test_structure_holds_only_what_the_rig_gives():
    motion = prepare_motion(log(Truth(), 5.0))
    plain = structure_of(rig(), [motion])
    assert isinstance(plain, Structure)
    assert [t.name for t in plain.terms] == ["J", "A"]
    assert plain.free == ()
    assert [t.name for t in structure_of(rig(**VISCOUS), [motion]).terms] == [
        "J", "A", "viscous_positive+viscous_negative",
    ]  # fmt: skip
