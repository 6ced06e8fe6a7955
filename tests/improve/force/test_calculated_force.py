"""Causes of a force-driven rig, on a rig that shares no code with the package (force_rig.py)."""

import json
from dataclasses import replace

import numpy as np
import pytest
from force_rig import COULOMB, DRAG, MASS, VISCOUS, D, Truth, log, rig

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.improve.force.calculated_force import (
    CalculatedForce,
    calculated_force,
    coverage_of,
    smallest_gap,
)
from observer_fi.improve.force.force_screening import vocabulary
from observer_fi.improve.improvement import Improvement, improve, to_json
from observer_fi.improve.ladder import name_causes
from observer_fi.learn.inverse_dynamics import parameters_of
from observer_fi.learn.inverse_motion import prepare_motion
from observer_fi.physics.rigs import Rig, load_rig, rig_toml
from observer_fi.report.learning import improve_files, improve_headline


def problem(truth: Truth, own: Rig, seed: int = 1) -> CalculatedForce:
    return calculated_force([log(truth, seed=seed)], own)


def named(truth: Truth, own: Rig, seed: int = 1) -> list[str]:
    ladder = name_causes(problem(truth, own, seed))
    return [name for step in ladder.steps for name in step.trial.causes]


def improved(truth: Truth, own: Rig) -> Improvement:
    return improve([log(truth)], own)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_nothing_is_named_where_nothing_is_missing(seed):
    assert named(Truth(), rig(), seed) == []
    assert named(Truth(DRAG, DRAG, noise=2e-7), rig(**VISCOUS), seed) == []


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("noise", [1e-8, 2e-7, 2e-6])
def test_nothing_is_named_on_many_logs(noise):
    for seed in range(100, 120):
        assert named(Truth(DRAG, DRAG, noise=noise), rig(**VISCOUS), seed) == []
        if noise == 1e-8:
            assert named(Truth(noise=noise), rig(), seed) == []


CASES = {
    "viscous_friction": (Truth(DRAG, DRAG), {}),
    "asymmetric_friction": (Truth(DRAG, 210.0), VISCOUS),
    "stribeck_friction": (Truth(DRAG, DRAG, 5.0, 0.012), VISCOUS),
    "viscous_friction that saturates": (Truth(DRAG, DRAG, local_speed=0.015, saturating=6.0), VISCOUS),
    "shaft_ripple": (Truth(DRAG, DRAG, ripple=1.0), VISCOUS),
    "torque_offset": (Truth(DRAG, DRAG, offset=1.5), VISCOUS),
    "input_delay": (Truth(DRAG, DRAG, delay=6e-4), VISCOUS),
}


@pytest.mark.parametrize("cause", CASES)
@pytest.mark.first(2)
def test_one_cause_is_named(cause):
    truth, quantities = CASES[cause]
    assert named(truth, rig(**quantities)) == [cause.split()[0]]


@pytest.mark.parametrize("falls", [-5.0, -8.0])
def test_friction_that_falls_towards_standstill_is_never_stribecks(falls: float) -> None:
    """Whatever its law: the friction that Stribeck described rises there."""
    found = name_causes(problem(Truth(DRAG, DRAG, falls, 0.012), rig(**VISCOUS)))
    names = {name for step in found.steps for name in (*step.trial.causes, *sum(step.rivals.values(), ()))}
    assert "viscous_friction" in names and "stribeck_friction" not in names


@pytest.mark.slow
def test_all_at_once_with_their_sizes():
    truth = Truth(DRAG, 210.0, 7.0, 0.012, 1.0, 1.0, 3e-4)
    force = problem(truth, rig())
    ladder = name_causes(force)
    wanted = {"viscous_friction", "asymmetric_friction", "stribeck_friction", "shaft_ripple", "input_delay"}
    assert {name for step in ladder.steps for name in step.trial.causes} == wanted
    found = parameters_of(ladder.extended)
    # actuator.py: torque += sin c sin(phi) + cos c cos(phi); the truth has sin(phi + 1)
    true = {
        "J": MASS * D**2, "A": COULOMB * D, "viscous_positive": DRAG * D**2, "viscous_negative": 210.0 * D**2,
        "stribeck_torque": 7.0 * D, "stribeck_speed": 0.012 / D, "input_delay": 8e-4,
        "shaft_ripple_sin": np.cos(1.0) * D, "shaft_ripple_cos": np.sin(1.0) * D,
    }  # fmt: skip
    for name, value in true.items():
        # Within three standard errors, or within what the filters do to this rig, which no standard error knows.
        share = {"J": 0.002, "input_delay": 0.075}.get(name, 0.03)  # 0.06 ms of delay
        error = abs(found[name][0] - value)
        assert error <= max(3.0 * found[name][1], share * abs(value)), name
    delay = next(step for step in ladder.steps if "input_delay" in step.trial.causes)
    assert {"current_lag", "position_delay"} <= set(delay.rivals["input_delay"])
    assert len(ladder.path) == 5 and ladder.path[-1].rss < ladder.path[0].rss < ladder.baseline.rss


def test_outside_the_vocabulary_ends_as_unexplained():
    """A spring along the rails: its mean is an offset, its slope has no name."""
    record = improved(Truth(DRAG, DRAG, field=30.0), rig(**VISCOUS))
    assert {f.cause for f in record.findings} <= {"torque_offset"}
    first = record.unexplained[0]
    assert (first.equation, first.regressor) == ("torque", "position")
    assert first.share > 0.2
    assert "over the position" not in improve_headline(record) and "without a name" in improve_headline(
        record
    )


@pytest.mark.slow
def test_extended_rig_is_complete_and_needs_nothing_more(tmp_path):
    truth = Truth(DRAG, 210.0, ripple=1.0)
    record = improved(truth, rig())
    path = tmp_path / "extended.toml"
    path.write_text(rig_toml(record.extended_rig), encoding="utf-8")
    again = load_rig(path)
    assert again == record.extended_rig
    second = improved(truth, again)
    assert second.findings == ()
    assert second.baseline.rmse["force_n"] == pytest.approx(record.extended.rmse["force_n"], rel=1e-6)


def test_json_is_that_of_every_other_drive():
    result = to_json(improved(Truth(DRAG, DRAG), rig()))
    assert list(result) == [
        "schema",
        "baseline",
        "refit",
        "findings",
        "unexplained",
        "extended",
        "new_moves",
        "freed",
    ]
    assert result["schema"] == "observer-fi/improve/1"
    for part in ("baseline", "extended"):
        assert list(result[part]) == ["nll_per_sample", "rmse", "whiteness_p", "noise_floor_nll"]
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


def test_the_same_logs_give_the_same_files():
    files = [
        improve_files(improved(Truth(DRAG, DRAG), rig()), None, "bench", ["bench.csv"]) for _ in range(2)
    ]
    assert files[0] == files[1]
    assert set(files[0]) == {"improve.json", "improve.html", "extended_rig.toml"}
    page = files[0]["improve.html"]
    assert all(f'id="charts-{name}"' in page for name in ("over-time", "curves-0", "spectra"))
    assert "The simulation misses viscous friction" in page and "N s/m" in page
    assert "What <code>diagnose</code> gains" not in page and "want to free" not in page


def test_nothing_missing_is_said_and_so_is_what_cannot_be_seen():
    record = improved(Truth(DRAG, DRAG), rig(**VISCOUS))
    assert improve_headline(record) == "Nothing with a name is missing"
    assert record.detectable["load_dependent_friction"] is None
    assert record.detectable["backlash"]["backlash"] > 0.0
    assert json.loads(json.dumps(to_json(record)))["findings"] == []


def test_wrong_rig_log_or_wish_is_one_line():
    with pytest.raises(UsageError, match="driven by pi_servo"):
        calculated_force([log(Truth(), 3.0)], load_rig())
    with pytest.raises(InvalidLogError, match="force_cmd_n is missing"):
        improve([replace(log(Truth(), 3.0), force=None)], rig())
    with pytest.raises(UsageError, match="keep-unexplained"):
        improve([log(Truth(), 3.0)], rig(), keep_unexplained=True)


# --- scores ---


def test_a_score_is_what_a_refit_gains():
    """The projected columns of a linear cause say exactly by how much the sum of squares falls."""
    force = problem(Truth(DRAG, DRAG, ripple=1.0), rig())
    base = force.baseline()
    scores = {s.cause.name: s for s in reversed(force.screen(base, ())) if not s.free}
    for name in ("viscous_friction", "torque_offset", "shaft_ripple"):
        fitted = force._trial(base, scores[name]).fitted
        assert base.rss - fitted.rss == pytest.approx(scores[name].power, rel=1e-6), name


def test_a_cause_that_went_in_comes_out_again():
    force = problem(Truth(DRAG, 210.0, 7.0, 0.012), rig())
    base = force.baseline()
    lowest = next(s for s in force.screen(base, ()) if s.cause.name == "stribeck_friction")
    inside = force._trial(base, lowest).fitted
    assert inside.rss < base.rss and "stribeck_speed" in inside.structure.free
    outside = force.without(inside, [lowest])
    assert outside.structure == base.structure
    assert outside.rss == pytest.approx(base.rss, rel=1e-9)


def test_a_known_delay_stays_known_when_its_cause_is_taken_out():
    force = problem(Truth(DRAG, DRAG, delay=6e-4), rig(**VISCOUS))
    base = force.baseline()
    late = next(s for s in force.screen(base, ()) if s.cause.name == "input_delay")
    inside = force._trial(base, late).fitted
    assert inside.structure.shapes["input_delay"] > 8e-4
    assert force.without(inside, [late]).structure.shapes == {"input_delay": 5e-4}


def test_vocabulary_follows_travel_and_speed():
    motions = [prepare_motion(log(Truth(), 5.0))]
    twice = [replace(m, x=2.0 * m.x, v=2.0 * m.v) for m in motions]
    starts = []
    for one in (motions, twice):
        forms = {c.variant.name: c for c in vocabulary(coverage_of(rig(), one))}
        bump = next(c for name, c in forms.items() if name.startswith("bump"))
        starts.append((bump.shapes["bump_width"], forms["below 6 % of top speed"].shapes["stribeck_speed"]))
    assert np.array(starts[1]) == pytest.approx(2.0 * np.array(starts[0]), rel=1e-6)


def test_a_play_below_what_friction_imitates_is_not_told():
    force = problem(Truth(DRAG, DRAG), rig(**VISCOUS))
    base = force.baseline()
    play = next(s for s in force.screen(base, ()) if s.cause.name == "backlash")
    assert (
        play.detectable["backlash"] >= smallest_gap(base, D) == pytest.approx(COULOMB / MASS * 1e-4, rel=0.01)
    )
