"""Inverse dynamics of force-driven rigs, on a rig that shares no code with the package (force_rig.py)."""

from dataclasses import replace

import numpy as np
import pytest
from force_rig import COULOMB, MASS, TURN, D, Truth, log

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve.inverse_improvement import extended, findings, inverse_json
from observer_fi.improve.inverse_ladder import name_causes
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
from observer_fi.physics.rigs import Quantity, Rig, load_rig, rig_toml
from observer_fi.records import Log
from observer_fi.report.inverse_learning import inverse_files, inverse_headline

DRAG = 150.0
VISCOUS = {
    "viscous_positive": Quantity(DRAG * D**2, "N m s/rad"),
    "viscous_negative": Quantity(DRAG * D**2, "N m s/rad"),
}


def rig(**quantities: Quantity) -> Rig:
    """Inertia and Coulomb friction a tenth off, the hold of the controller known."""
    base = {
        "J": Quantity(0.9 * MASS * D**2, "kg m^2"),
        "A": Quantity(0.9 * COULOMB * D, "N m"),
        "D": Quantity(D, "m/rad"),
        "input_delay": Quantity(5e-4, "s"),
    }
    return Rig("bench", "", "force", base | quantities)


def named(truth: Truth, own: Rig, seed: int = 1) -> tuple[list[str], object]:
    ladder = name_causes(own, [prepare_motion(log(truth, seed=seed))])
    return [f.cause for f in findings(ladder)], ladder


# --- columns ---


@pytest.mark.parametrize(
    ("term", "textbook"),
    [
        ("J", lambda m: m.a / D**2),
        ("A", lambda m: np.sign(m.v) / D),
        ("viscous", lambda m: m.v / D**2),
        ("viscous_asymmetry", lambda m: np.abs(m.v) / D**2),
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


# --- naming ---


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_nothing_is_named_where_nothing_is_missing(seed):
    assert named(Truth(), rig(), seed)[0] == []
    assert named(Truth(DRAG, DRAG, noise=2e-7), rig(**VISCOUS), seed)[0] == []


@pytest.mark.slow
@pytest.mark.parametrize("noise", [1e-8, 2e-7, 2e-6])
def test_nothing_is_named_on_many_logs(noise):
    for seed in range(100, 120):
        assert named(Truth(DRAG, DRAG, noise=noise), rig(**VISCOUS), seed)[0] == []
        if noise == 1e-8:
            assert named(Truth(noise=noise), rig(), seed)[0] == []


CASES = {
    "viscous_friction": (Truth(DRAG, DRAG), {}),
    "asymmetric_friction": (Truth(DRAG, 210.0), VISCOUS),
    "stribeck_friction": (Truth(DRAG, DRAG, 5.0, 0.012), VISCOUS),
    "shaft_ripple": (Truth(DRAG, DRAG, ripple=1.0), VISCOUS),
    "torque_offset": (Truth(DRAG, DRAG, offset=1.5), VISCOUS),
    "input_delay": (Truth(DRAG, DRAG, delay=6e-4), VISCOUS),
}


@pytest.mark.parametrize("cause", CASES)
def test_one_cause_is_named(cause):
    truth, quantities = CASES[cause]
    assert named(truth, rig(**quantities))[0] == [cause]


def test_all_at_once_with_their_sizes():
    truth = Truth(DRAG, 210.0, -7.0, 0.012, 1.0, 1.0, 3e-4)
    causes, ladder = named(truth, rig())
    wanted = {"viscous_friction", "asymmetric_friction", "stribeck_friction", "shaft_ripple", "input_delay"}
    assert set(causes) == wanted
    found = parameters_of(ladder.final)
    # actuator.py: torque += sin c sin(phi) + cos c cos(phi); the truth has sin(phi + 1)
    true = {
        "J": MASS * D**2, "A": COULOMB * D, "viscous_positive": DRAG * D**2, "viscous_negative": 210.0 * D**2,
        "stribeck_torque": -7.0 * D, "stribeck_speed": 0.012 / D, "input_delay": 8e-4,
        "shaft_ripple_sin": np.cos(1.0) * D, "shaft_ripple_cos": np.sin(1.0) * D,
    }  # fmt: skip
    for name, value in true.items():
        # Within three standard errors, or within what the filters do to this rig, which no standard error knows.
        share = {"J": 0.002, "input_delay": 0.075}.get(name, 0.03)  # 0.06 ms of delay
        error = abs(found[name][0] - value)
        assert error <= max(3.0 * found[name][1], share * abs(value)), name
    delay = next(f for f in findings(ladder) if f.cause == "input_delay")
    assert {"current_lag", "position_delay"} <= set(delay.indistinguishable_from)


def test_outside_the_vocabulary_ends_as_unexplained():
    """A spring along the rails: its mean is an offset, its slope has no name."""
    causes, ladder = named(Truth(DRAG, DRAG, field=30.0), rig(**VISCOUS))
    assert set(causes) <= {"torque_offset"}
    assert ladder.unexplained[0][0] == "position"
    assert ladder.unexplained[0][1] > 0.2


def test_extended_rig_is_complete_and_needs_nothing_more(tmp_path):
    truth = Truth(DRAG, 210.0, ripple=1.0)
    _, ladder = named(truth, rig())
    path = tmp_path / "extended.toml"
    path.write_text(rig_toml(extended(ladder, "extended")), encoding="utf-8")
    again = load_rig(path)
    assert again == extended(ladder, "extended")
    causes, second = named(truth, again)
    assert causes == []
    assert second.start.rss == pytest.approx(ladder.final.rss, rel=1e-6)


def test_json_has_the_shape_of_the_contract():
    result = inverse_json(name_causes(rig(), [prepare_motion(log(Truth(DRAG, DRAG)))]))
    assert list(result) == ["schema", "baseline", "refit", "findings", "unexplained", "extended"]
    assert result["schema"] == "observer-fi/improve/1"
    for part in ("baseline", "extended"):
        assert list(result[part]) == ["nll_per_sample", "rmse", "whiteness_p"]
    assert result["extended"]["rmse"]["force_n"] < 0.1 * result["baseline"]["rmse"]["force_n"]
    assert set(result["refit"]["J"]) == {"value", "std", "prior", "unit"}
    (finding,) = result["findings"]
    assert set(finding) == {
        "cause", "equation", "parameters", "evidence", "gain", "indistinguishable_from", "separate_by",
    }  # fmt: skip
    assert finding["evidence"]["delta_bic"] > 0.0
    assert set(finding["parameters"]["viscous_positive"]) == {"value", "std", "unit"}
    assert finding["gain"]["heldout_nll_drop_per_sample"] > 0.0
    assert finding["gain"]["heldout_rmse_ratio"]["force_n"] < 1.0


def test_the_same_logs_give_the_same_result():
    logs: list[Log] = [log(Truth(DRAG, 210.0))]
    ladder = name_causes(rig(), [prepare_motion(logs[0])])
    assert inverse_json(ladder) == inverse_json(name_causes(rig(), [prepare_motion(one) for one in logs]))


def test_files_of_the_command():
    ladder = name_causes(rig(), [prepare_motion(log(Truth(DRAG, DRAG)))])
    files = inverse_files(ladder, "bench", ["bench.csv"])
    assert set(files) == {
        "improve.json",
        "improve.html",
        "extended_rig.toml",
        "ladder.svg",
        "force.svg",
        "curves.svg",
    }
    assert "The equations miss viscous friction" in files["improve.html"]
    assert inverse_files(ladder, "bench", ["bench.csv"]) == files
    nothing = name_causes(rig(**VISCOUS), [prepare_motion(log(Truth(DRAG, DRAG)))])
    assert inverse_headline(nothing) == "Nothing with a name is missing"
    assert "load_friction: not detectable here" in inverse_files(nothing, "bench", [])["improve.html"]


# --- forward ---


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
    assert [t.name for t in structure_of(rig(**VISCOUS), [motion]).terms] == ["J", "A", "viscous"]
