"""A coupling lost beside a servo that nobody knows may look like the end of a move: the mass stands, and the rest tells."""

import hidden
import numpy as np
import pytest

import pipelines.rigs_study as study
from observer_fi.physics import Rig
from observer_fi.records import Event
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

ROWS = 4  # for which the position is held


def said(actuator: hidden.Actuator, rig: Rig, label: str) -> Event:
    spec = hidden.fault_spec(actuator, label, actuator.seed)
    frame, _ = hidden.actuator_log(actuator, spec, actuator.seed + 1)
    found = diagnose_log(study._read(frame, rig), rig, Settings()).isolation
    assert found is not None
    return found.verdict


def loss_is_told_and_health_is_sure(seed: int) -> None:
    """Of one actuator driven by current: its lost coupling, alone or beside health, and its healthy move."""
    actuator = hidden.draw_actuator(seed, "current")
    rig = study._learned(actuator)
    verdict = said(actuator, rig, "coupling_loss")
    assert "coupling_loss" in (verdict.label, *verdict.alike)
    healthy = said(actuator, rig, "nominal")
    assert (healthy.label, healthy.probability > 0.95) == ("nominal", True)


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every log with a position of every fourth row."""
    plain = hidden.actuator_log

    def held(*args):
        frame, truth = plain(*args)
        stands = np.arange(len(frame)) // ROWS * ROWS
        return frame.assign(position_m=frame["position_m"].to_numpy()[stands]), truth

    monkeypatch.setattr(hidden, "actuator_log", held)


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("seed", [863768, 863773, 863769])
def test_a_lost_coupling_is_no_sure_all_clear(seed: int) -> None:
    loss_is_told_and_health_is_sure(seed)


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [863922, 863911, 863923])
def test_a_mass_that_stops_as_friction_alone_would_stop_it_may_be_lost(seed: int) -> None:
    """What its motor goes on to draw looks like the integral of a servo that has stopped; the rest says otherwise by a little."""
    loss_is_told_and_health_is_sure(seed)
