"""Rows that a logger lost, one by one or a few at once: an integral goes over them."""

import hidden
import numpy as np
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import rig_of_sheet


@pytest.mark.slow
@pytest.mark.first(4)
@pytest.mark.parametrize("share", [0.03, 0.001, 0.1])
@pytest.mark.parametrize("burst", [1, 2, 20])
@pytest.mark.parametrize(
    ("drive", "seed"), [("voltage", 863904), ("current", 863905), ("voltage", 863906), ("current", 863907)]
)
def test_constants_do_without_them(drive: str, seed: int, burst: int, share: float) -> None:
    actuator = hidden.draw_actuator(seed, drive)
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    lost = np.random.default_rng(seed).random(len(frame)) < share / burst
    lost = np.convolve(lost, np.ones(burst), "full")[: len(frame)] > 0.0
    log = log_from_frame(frame[~lost].reset_index(drop=True))
    fit = identify([log], rig_of_sheet(drawn_sheet(actuator, drive)).rig)
    found = {p.name: p for p in fit.parameters}
    told = ("Rm", "Km", "J", "A") if drive == "voltage" else ("J", "A")
    sheet = rig_of_sheet(drawn_sheet(actuator, drive)).rig.model["Km"] / actuator.rig.Km
    for name in told:  # the torque of a current is what the sheet says of it
        p, true = found[name], getattr(actuator.rig, name) * (1.0 if drive == "voltage" else sheet)
        assert abs(p.value - true) < 4.0 * max((p.high - p.low) / 3.92, 2e-3 * true), name


@pytest.mark.slow
@pytest.mark.first(2)
@pytest.mark.parametrize("seed", [863904, 863906, 863909])
@pytest.mark.parametrize("what", ["a row a message", "blank cells"])
def test_constants_do_with_rows_that_lack_a_channel(seed: int, what: str) -> None:
    """A bus writes a row for each message, whose other cells are blank; or single cells are."""
    actuator = hidden.draw_actuator(seed, "voltage")
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    rows, rng = np.arange(len(frame)), np.random.default_rng(seed)
    for k, column in enumerate(("voltage_v", "current_a", "position_m")):
        frame.loc[rows % 3 != k if what == "a row a message" else rng.random(len(frame)) < 0.05, column] = (
            np.nan
        )
    fit = identify([log_from_frame(frame)], rig_of_sheet(drawn_sheet(actuator, "voltage")).rig)
    found = {p.name: p for p in fit.parameters}
    for name in ("Rm", "Km", "J", "A"):
        p, true = found[name], getattr(actuator.rig, name)
        assert abs(p.value - true) < 4.0 * max((p.high - p.low) / 3.92, 2e-3 * true), name
