"""A channel that is the same from the first sample to the last: what shows in it only is no all-clear, and no fault."""

import hidden
import pytest

from observer_fi.logs.ingest import log_from_frame
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict.diagnosis import diagnose_log


def without(column: str, label: str, seed: int) -> Event:
    """The verdict on a move of the paper's spread whose `column` is dead."""
    frame, _ = hidden.make_log_with("ideal", hidden.draw_move_case(seed, label), seed)
    frame[column] = frame[column].iloc[0]
    isolation = diagnose_log(log_from_frame(frame), load_rig(), Settings()).isolation
    assert isolation is not None
    return isolation.verdict


def test_what_to_do_about_it_is_to_read_the_channel_again() -> None:
    frame, _ = hidden.make_log_with("ideal", hidden.draw_move_case(257004, "nominal"), 257004)
    frame["position_m"] = frame["position_m"].iloc[0]
    told = diagnose_log(log_from_frame(frame), load_rig(), Settings()).explanation
    assert "read again and repeat the move" in told and "next moves" not in told


@pytest.mark.parametrize(
    ("label", "seed"),
    [*(("coupling_loss", seed) for seed in (257000, 257001, 257002, 257003)), ("overload", 257000)],
)
@pytest.mark.first(2)
def test_a_fault_without_a_position_is_told_or_told_beside_health(label: str, seed: int) -> None:
    verdict = without("position_m", label, seed)
    assert label in (verdict.label, *verdict.alike)


@pytest.mark.parametrize("seed", [257000, 257001, 257002, 257003])
def test_health_without_a_position_is_health_or_a_slip(seed: int) -> None:
    """A mass that follows in part shows in nothing else: without its position there is no all-clear for it."""
    verdict = without("position_m", "nominal", seed)
    assert (verdict.label, verdict.alike) == ("nominal", ("slip",))
    assert verdict.probability == verdict.posterior["slip"] == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [256001, 256007, 256010, 256014])
@pytest.mark.first(1)
def test_a_coupling_lost_in_a_start_without_a_position_is_no_all_clear(seed: int) -> None:
    """The motor alone turns with the friction of a light rig: the whole move once overruled a bank that was sure."""
    verdict = without("position_m", "coupling_loss", seed)
    assert "coupling_loss" in (verdict.label, *verdict.alike)
    assert not (verdict.label == "nominal" and verdict.probability > 0.95)
