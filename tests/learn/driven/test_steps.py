"""Readings in steps as coarse as what friction takes: constants are as good as that leaves them, and nothing finer is told."""

from functools import cache

import hidden
import numpy as np
import pandas as pd
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.learn import identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import rig_of_sheet
from observer_fi.records import Fit

CURRENT, VOLTAGE = "current_a", "voltage_v"


@cache
def campaign(seed: int) -> tuple[hidden.Actuator, pd.DataFrame]:
    actuator = hidden.draw_actuator(seed, "voltage")
    return actuator, hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)[0]


def stepped(seed: int, column: str, steps: float) -> tuple[hidden.Actuator, Fit]:
    """A fit to a column in so many steps up to its largest reading."""
    actuator, frame = campaign(seed)
    step = frame[column].abs().max() / steps
    coarse = frame.assign(**{column: np.round(frame[column] / step) * step})
    return actuator, identify([log_from_frame(coarse)], rig_of_sheet(drawn_sheet(actuator, "voltage")).rig)


@pytest.mark.slow
@pytest.mark.first(4)
@pytest.mark.parametrize("steps", [10.0, 30.0, 4.0, 100.0])
@pytest.mark.parametrize("column", [CURRENT, VOLTAGE])
@pytest.mark.parametrize("seed", [863743, 863505, 863760, 863752])
def test_constants_are_as_good_as_steps_leave_them(seed: int, column: str, steps: float) -> None:
    actuator, fit = stepped(seed, column, steps)
    for p in fit.parameters:
        if p.name in ("Rm", "Km", "J", "A"):
            assert abs(p.value - getattr(actuator.rig, p.name)) < 3.0 * (p.high - p.low) / 3.92, p.name
    assert fit.inductance is None
    assert all(own.late < 1.0 for own in fit.filters), "steps are no channel that is late"


@pytest.mark.parametrize("column", [CURRENT, VOLTAGE])
def test_fine_steps_widen_nothing(column: str) -> None:
    _, fine = stepped(863743, column, 1e5)
    _, plain = stepped(863743, column, 1e9)
    assert {p.name: p.std for p in fine.parameters} == pytest.approx(
        {p.name: p.std for p in plain.parameters}, rel=0.1
    )
