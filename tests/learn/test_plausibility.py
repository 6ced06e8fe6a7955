"""What is refused, a column of another sign, and what is said of a fit: that it misses something, or is far from the rig file."""

from functools import cache
from html import escape

import hidden
import pandas as pd
import pytest
from drawn_sheets import drawn_sheet

from observer_fi.errors import InvalidLogError
from observer_fi.improve import improve
from observer_fi.learn import identified_rig, identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, load_rig, rig_of_sheet
from observer_fi.report import identify_files

COLUMNS = ("voltage_v", "current_a", "position_m", "speed_cmd_rad_s")


@cache
def served() -> pd.DataFrame:
    """A campaign behind the paper's servo."""
    return hidden.make_log(hidden.draw_effect_case(99985510, None, 1.0), 99985510)[0]


@cache
def driven(drive: str, seed: int) -> tuple[pd.DataFrame, Rig]:
    actuator = hidden.draw_actuator(seed, drive)
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), seed)
    return frame, rig_of_sheet(drawn_sheet(actuator, drive)).rig


@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("command", [identify, improve])
def test_of_a_servo_whose_command_is_known(column: str, command) -> None:
    log = log_from_frame(served().assign(**{column: -served()[column]}))
    with pytest.raises(InvalidLogError, match=f"{column} goes the other way than"):
        command([log], load_rig())


@pytest.mark.parametrize(
    ("drive", "column", "said"),
    [("voltage", "voltage_v", "voltage_v"), ("voltage", "current_a", "current_a"), ("voltage", "position_m", "position_m"),
     ("current", "current_a", "position_m goes the other way than current_a"),
     ("current", "position_m", "position_m goes the other way than current_a")],
)  # fmt: skip
def test_of_a_motor_whose_servo_nobody_knows(drive: str, column: str, said: str) -> None:
    frame, rig = driven(drive, 863752)
    with pytest.raises(InvalidLogError, match=said):
        identify([log_from_frame(frame.assign(**{column: -frame[column]}))], rig)


def test_a_current_without_a_sign() -> None:
    log = log_from_frame(served().assign(current_a=served()["current_a"].abs()))
    with pytest.raises(InvalidLogError, match="is it a magnitude"):
        identify([log], load_rig())


@pytest.mark.parametrize("seed", [99985661, 99985662])
def test_nothing_is_said_of_a_fit_that_explains_its_logs(seed: int) -> None:
    frame, _ = hidden.make_log(hidden.draw_effect_case(seed, None, 1.0), seed)
    assert identify([log_from_frame(frame)], load_rig()).warnings == ()


@pytest.mark.slow
@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [99985666, 99985667])
@pytest.mark.parametrize(
    "trait",
    ["wandering", "noise_3", "steps_3_all", "csv_3_decimals", "drive_400hz", "position_100hz", "hum_60hz", "coloured",
     "position_averaged", "missing_rows", "spikes", "jitter", "pwm_line", "noise_third", "twelve_bits"],
)  # fmt: skip
def test_noise_of_a_logger_is_nothing_that_a_fit_misses(trait: str, seed: int) -> None:
    frame, _ = hidden.make_log_with(trait, hidden.draw_effect_case(seed, None, 1.0), seed)
    assert identify([log_from_frame(frame)], load_rig()).warnings == ()


@pytest.mark.slow
@pytest.mark.first(2)
@pytest.mark.parametrize(("size", "seed"), [(10.0, 99985663), (50.0, 99985664), (10.0, 99985665)])
@pytest.mark.parametrize(
    "cause",
    [
        "viscous_friction",
        "brush_drop",
        "gravity_nonlinearity",
        "integrator_clamp",
        "screw_ripple",
        "voltage_delay",
    ],
)
def test_a_fit_that_misses_something_says_so(cause: str, size: float, seed: int) -> None:
    frame, _ = hidden.make_log(hidden.draw_effect_case(seed, cause, size), seed)
    told = identify([log_from_frame(frame)], load_rig()).warnings
    assert any("is no noise: the equations miss something" in text for text in told)


@pytest.mark.parametrize(
    ("column", "gain", "name"),
    [("current_a", 0.9, "Rm"), ("voltage_v", 1.05, "Km"), ("position_m", 1.02, "D")],
)
def test_a_constant_far_from_the_rig_files_is_named(column: str, gain: float, name: str) -> None:
    """A gain of a reading fits as well as none: nothing is left, and constants are others."""
    frame = served().assign(**{column: gain * served()[column]})
    fit = identify([log_from_frame(frame)], load_rig())
    assert any(text.startswith(f"{name} is ") and "than the rig file says" in text for text in fit.warnings)
    assert not any("is no noise" in text for text in fit.warnings)


def test_the_page_begins_with_what_is_said() -> None:
    rig = load_rig()
    log = log_from_frame(served().assign(current_a=0.9 * served()["current_a"]))
    fit = identify([log], rig)
    page = identify_files(fit, rig, identified_rig(fit, rig), {}, "log", ["log.csv"])["identify.html"]
    (warning,) = fit.warnings
    assert page.index("Before you trust it") < page.index(escape(warning)) < page.index("<h2>Parameters</h2>")
