"""An independent truth hides an effect; `improve` sees the log and nothing else."""

from dataclasses import replace

import hidden
import pytest

from observer_fi.improve import improve
from observer_fi.improve.improvement import findings_of
from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.learn import campaign_readings, with_servo
from observer_fi.logs import log_from_frame
from observer_fi.physics import PARAMETERS, load_rig
from pipelines.improve_study_cases import PAIRS, Case, run_case

pytestmark = pytest.mark.usefixtures("not_on_new_moves")
SEED = 4100  # a development seed: the committed report uses others


def hide(causes: tuple[str, ...], size: float, seed: int = SEED) -> dict:
    return run_case(Case(causes, size, seed, all(c in hidden.CAUSES for c in causes)))


@pytest.mark.slow
def test_a_hidden_cause_is_found_first_and_its_size_compared_with_the_truth():
    row = hide(("voltage_offset",), 3.0)
    assert "voltage_offset" in row["found"][0]
    assert len(row["found"]) == 1
    assert row["errors"] and all(0.0 < abs(error) < 4.0 for error in row["errors"].values())


def test_every_right_size_is_a_parameter_of_the_model():
    """The truth's names and ours meet in `hidden.right_size` alone; a cause that we lack, or cannot size, has none."""
    sizes = {cause: hidden.right_size(hidden.sized_effect(cause, 3.0)) for cause in hidden.ALL}
    assert {cause for cause, size in sizes.items() if size is None} == {
        *hidden.OUTSIDE, "asymmetric_friction", "contact_damping", "pitch_offset"
    }  # fmt: skip
    assert {name for size in sizes.values() if size for name in size.parameters} <= set(PARAMETERS)
    assert sizes["position_gain"] == (("position_gain",), pytest.approx(1.06))


@pytest.mark.slow
def test_nothing_hidden_nothing_found():
    assert hide((), 0.0)["found"] == []


@pytest.mark.study
@pytest.mark.slow
def test_what_has_no_name_stays_without_one():
    row = hide(("torque_bump",), 3.0)
    assert row["found"] == []
    assert row["unexplained"][0] == ["torque", "position"]


@pytest.mark.slow
@pytest.mark.study
def test_two_at_once():
    row = hide(PAIRS[0], 3.0)
    assert {names[0] for names in row["found"]} == set(PAIRS[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "seed"),  # the study reports many seeds
    [(c, 4201 + k % 2) for k, c in enumerate(hidden.CAUSES) if c != "gravity_nonlinearity"],
)
@pytest.mark.first(1)
def test_every_cause_is_found_at_three_times_the_detectable_size(cause, seed):
    assert any(cause in names for names in named(cause, seed))


def named(cause: str, seed: int) -> list[list[str]]:
    """The causes that `improve` names, each with those that look like it, without what it tells beside them: half of its time."""
    log, rig = (
        log_from_frame(hidden.make_log(hidden.draw_effects_case(seed, (cause,), 3.0), seed)[0]),
        load_rig(),
    )
    campaign = campaign_readings([log], rig)
    rig = campaign.known(with_servo([log], rig))
    problem = simulated_moves(campaign.logs, rig, filters=campaign.low_passes.told)
    ladder = problem.reconsidered(name_causes(problem))
    return [[found.cause, *found.indistinguishable_from] for found in findings_of(problem, ladder)]


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(
    ("cause", "values", "right"),
    [
        ("load_dependent_friction", {"loss": 2e-3}, {"torque_friction": 2e-3}),
        ("dead_zone", {"threshold": 3.5e-3, "jump": 1.0}, {"dead_zone": 3.5e-3}),
    ],
)
def test_a_second_law_of_a_cause_is_found_with_its_size(cause, values, right):
    spec = replace(hidden.draw_effects_case(SEED, (), 0.0), effects=(hidden.effect(cause, **values),))
    record = improve([log_from_frame(hidden.make_log(spec, SEED)[0])], load_rig())
    assert [found.cause for found in record.findings] == [cause]
    for name, size in right.items():
        assert record.findings[0].parameters[name].value == pytest.approx(size, rel=0.05)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("seed", [4512])
def test_a_law_of_contact_far_from_the_square_does_not_drag_the_stops_past_each_other(seed):
    row = hide(("contact_exponent",), 10.0, seed)
    assert [names[0] for names in row["found"]] == ["contact_exponent"]
    assert row["unexplained"] == []


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("seed", [4502])
def test_a_slip_at_the_limit_of_detection_shows_in_the_position_alone(seed):
    assert hide(("partial_slip",), 1.0, seed)["found"][0][0] == "partial_slip"


@pytest.mark.slow
@pytest.mark.study
def test_a_stop_that_only_a_missing_cause_asked_for_is_taken_back():
    """A lag of the current with an offset of the torque looks like a stop at the end of the travel."""
    row = hide(("current_lag", "torque_offset"), 3.0, 4500)
    assert {names[0] for names in row["found"]} == {"current_lag", "torque_offset"}
    assert row["gain_share"] > 0.95


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("rate_hz", "first", "every"),
    [(1920.0, 0, 1), (48e3, 3, 30), (9600.0, 0, 1), (3200.0, 0, 1), (48e3, 5, 30), (48e3, 20, 48)],
)
def test_a_healthy_campaign_is_clean_whenever_its_logger_samples(rate_hz, first, every):
    """Any rate beside the 8000 ticks of its servo, and any time in a tick: of every `every`th row from `first` on."""
    spec = hidden.draw_effects_case(874001 + first, (), 0.0)
    spec = replace(spec, logger=replace(spec.logger, rate_hz=rate_hz))
    frame, _ = hidden.make_log(spec, 874001 + first)
    record = improve([log_from_frame(frame.iloc[first::every].reset_index(drop=True))], load_rig())
    assert record.findings == ()
    assert record.unexplained == ()
