"""A log's first fault that begins with the brake is not told from a rig file that has something slightly wrong."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hidden import draw_move_case, make_log

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.moves.with_the_brake import or_the_brake


def event(label: str, onset_s: float | None) -> Event:
    posterior = {"nominal": 0.0, "coupling_loss": 1.0}
    return Event(label, None, 1.0, onset_s, (onset_s, onset_s), 0.9, None, 0.1, 2.0, posterior)


def bank(rate_hz: float) -> Any:
    t = np.arange(0.0, 2.0, 1.0 / rate_hz)
    w = np.interp(t, [0.1, 0.12, 0.5, 0.51, 1.0, 1.02], [0.0, 300.0, 300.0, 200.0, 200.0, 0.0])
    return SimpleNamespace(recent=SimpleNamespace(t=t, w_cmd=-w))


@pytest.mark.parametrize("rate_hz", [100.0, 1600.0])
@pytest.mark.parametrize(
    ("onset_s", "shared"),
    [(1.002, True), (0.998, True), (0.93, False), (1.06, False), (0.502, False), (0.1, False)],
)
def test_only_what_begins_with_the_brake_is_shared(onset_s: float, shared: bool, rate_hz: float) -> None:
    told = or_the_brake(event("coupling_loss", onset_s), bank(rate_hz))
    assert ("nominal" in told.alike, told.probability) == (shared, 0.5 if shared else 1.0)


def test_health_and_faults_without_a_begin_stay_what_they_are() -> None:
    for kept in (event("nominal", 1.0), event("coupling_loss", None)):
        assert or_the_brake(kept, bank(1600.0)) is kept


@pytest.mark.slow
@pytest.mark.parametrize("seed", [81_000, 81_003, 81_006])
@pytest.mark.first(1)
def test_a_current_with_a_share_of_the_voltage_is_no_fault_for_sure(seed: int) -> None:
    """A lost coupling at 1.0, which began with the brake."""
    frame, _ = make_log(draw_move_case(seed, "nominal"), seed)
    log = log_from_frame(frame.assign(current_a=frame["current_a"] + 1e-3 * frame["voltage_v"]))
    found = diagnose_log(log, load_rig(), Settings()).isolation
    assert found is not None
    assert found.verdict.label == "nominal" or not found.verdict.probability > 0.95
