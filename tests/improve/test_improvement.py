"""`improve` on logs whose plant is the package's own: findings, none where there is none, and the contract's keys."""

import json
from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import behind_a_loop, campaign, loop_log
from hidden.acquisition import ideal

from observer_fi.errors import InvalidLogError
from observer_fi.improve.diagnosis_gain import DiagnosisGain
from observer_fi.improve.improvement import Improvement, improve, to_json
from observer_fi.learn.output_error import whiteness
from observer_fi.logs import log_from_frame
from observer_fi.logs.moves import Excitation
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.report.learning import freed_sentence, improve_files, likeness

RIG = load_rig()


@pytest.fixture(scope="module")
def control() -> Improvement:
    return improve([campaign(with_values(RIG, {"A": 4.2e-4, "J": 4.9e-7}), seed=3)], RIG)


@pytest.fixture(scope="module")
def sticky() -> Improvement:
    """A plant with viscous friction that the rig file lacks."""
    plant = with_values(RIG, {"viscous_positive": 1e-7, "viscous_negative": 1e-7})
    return improve([campaign(plant, seed=4)], RIG)


@pytest.mark.study
@pytest.mark.slow
def test_a_parameter_that_only_moved_is_no_finding(control):
    assert control.findings == ()
    assert control.unexplained == ()
    assert control.refit["A"].value == pytest.approx(4.2e-4, rel=0.01)
    assert control.refit["A"].prior == RIG.model["A"]


@pytest.mark.study
@pytest.mark.slow
def test_the_hidden_friction_is_named_with_its_size(sticky):
    assert [f.cause for f in sticky.findings] == ["viscous_friction"]
    for value in sticky.findings[0].parameters.values():
        assert abs(value.value - 1e-7) < 5.0 * value.std
    assert sticky.findings[0].heldout_nll_drop_per_sample > 0.0
    assert sticky.extended.nll_per_sample < sticky.baseline.nll_per_sample


@pytest.mark.slow
def test_the_extended_rig_carries_what_was_found(sticky):
    model = sticky.extended_rig.model
    assert model["viscous_positive"] == pytest.approx(1e-7, rel=0.1)
    assert "viscous_positive" in model.effects


@pytest.mark.slow
def test_json_has_the_keys_of_the_contract(sticky):
    table = json.loads(json.dumps(to_json(sticky)))
    assert list(table) == [
        "schema",
        "baseline",
        "refit",
        "findings",
        "unexplained",
        "extended",
        "new_moves",
        "freed",
    ]
    assert table["schema"] == "observer-fi/improve/1"
    assert set(table["baseline"]["rmse"]) == {"current_a", "position_m", "speed_rad_s"}
    finding = table["findings"][0]
    assert set(finding) == {
        "cause", "equation", "parameters", "evidence", "gain", "indistinguishable_from", "separate_by",
    }  # fmt: skip
    assert set(finding["gain"]) == {"heldout_nll_drop_per_sample", "heldout_rmse_ratio"}


@pytest.mark.slow
def test_json_tells_which_equation_the_data_want_to_free(sticky, control):
    rows = to_json(sticky)["freed"]
    assert rows[0]["verdict"] == "first" and rows[0]["gain"] > rows[-1]["gain"] >= 0.0
    assert {"equation", "disturbance", "unit", "intensity", "memory", "rms", "gain_per_sample"} < set(rows[0])
    assert {row["verdict"] for row in to_json(control)["freed"]} == {"no"}


@pytest.mark.slow
def test_every_cause_says_what_could_have_been_seen(control):
    assert control.detectable["contact_exponent"] is None
    assert 0.0 < control.detectable["viscous_friction"]["viscous_positive"] < 1e-7


def test_whiteness_tells_white_from_coloured():
    noise = np.random.default_rng(5).normal(size=5000)
    assert whiteness(noise) > 1e-3
    assert whiteness(np.convolve(noise, np.ones(5))) < 1e-6


def test_a_log_without_the_force_of_its_rig_is_refused():
    with pytest.raises(InvalidLogError, match="force_cmd_n"):
        improve([campaign()], replace(RIG, drive="force"))


@pytest.mark.slow
def test_the_wish_names_what_it_cannot_be_told_from(control, sticky):
    assert freed_sentence(control).startswith("None")
    first = replace(sticky.freed[0], equation="servo", verdict="first", alike="")
    lone = replace(sticky, freed=(first, replace(first, equation="torque", verdict="wanted")))
    assert freed_sentence(lone).startswith("The servo (") and likeness(lone) == ""
    close = replace(first, equation="sensor:current", verdict="close")
    assert "cannot tell it from the current sensor" in likeness(replace(sticky, freed=(first, close)))


@pytest.mark.slow
def test_the_report_tells_the_gain_of_diagnosis(sticky):
    nothing = DiagnosisGain(1, 8, 9, 16, {"overload": float("nan"), "coupling_loss": 0.02})
    better = DiagnosisGain(0, 8, 16, 16, {"overload": 0.04, "coupling_loss": 0.004})
    shown = Excitation(
        8, (200.0, 410.0), (-1, 1), (-5.0, 0.0), 2, {"steady": 8.0, "saturation": 0.3, "rest": 0.0}
    )
    record = replace(sticky, excitations=(shown,))
    files = improve_files(record, (nothing, better), "sticky", ["sticky.csv"])
    found = json.loads(files["improve.json"])["diagnosis"]
    assert found["baseline"]["right"] == 9 and found["baseline"]["delay_s"]["overload"] is None
    assert found["extended"]["delay_s"] == {"overload": 0.04, "coupling_loss": 0.004}
    held = "8 moves, both directions, 2 reversals without a rest; speeds 200, 410 rad/s; pitch -5, 0 deg; 8 s steady"
    assert held in files["improve.html"]
    assert "<h2>Which equation the data want to free</h2>" in files["improve.html"]
    assert sticky.disturbances and 'id="charts-disturbance-0-over"' in files["improve.html"]
    assert "9 of 16" in files["improve.html"] and "40.0 ms" in files["improve.html"]


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.usefixtures("not_on_new_moves")
def test_a_cause_is_named_behind_a_position_loop():
    """The independent truth under a position loop, with a bearing that drags; the rig file has no commanded acceleration."""
    effects = (hidden.effect("viscous_friction", plus=2e-7, minus=2e-7),)
    profile = hidden.there_and_back((410.0, 200.0, 90.0), (1.0,) * 3, (0.0, 8.0, -8.0))
    rig = behind_a_loop()
    found = improve([loop_log(profile, effects=effects)], rig)
    assert [f.cause for f in found.findings] == ["viscous_friction"]
    for value in found.findings[0].parameters.values():
        assert value.value == pytest.approx(2e-7, rel=0.1)
    assert (
        found.extended_rig.drive == "position_servo"
        and found.extended.nll_per_sample < found.baseline.nll_per_sample
    )


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.usefixtures("not_on_new_moves")
@pytest.mark.parametrize("seed", [8432])
def test_two_zero_offsets_are_named_although_one_smooth_torque_stands_for_both(seed: int) -> None:
    """Of a voltage and a current that are off by what the winding makes of each other: the speed is right, the torque is not."""
    spec = hidden.draw_effects_case(seed, (), 0.0)
    logger = ideal(spec.logger)
    zero = {"voltage": 0.036, "current": 0.0018}
    for channel, offset in zero.items():
        logger.chains[channel] = replace(logger.chains[channel], offset=offset)
    found = improve([log_from_frame(hidden.make_log_through(logger, spec, seed)[0])], RIG)
    sizes = {f.cause: f.parameters for f in found.findings}
    assert set(sizes) == {"voltage_offset", "current_offset"} and found.unexplained == ()
    for channel, offset in zero.items():
        name = f"{channel}_offset"
        assert sizes[name][name].value == pytest.approx(offset, rel=0.05)
