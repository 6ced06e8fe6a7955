"""`improve` for motors whose servo nobody knows: by the measured current alone, or with the voltage and no commanded speed."""

import json
from dataclasses import replace
from functools import cache

import hidden
import numpy as np
import pytest
from drawn_sheets import drawn_sheet
from hidden.effects import Effect, effect

from observer_fi.improve import Improvement, improve
from observer_fi.learn import identified_rig, identify
from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, rig_of_sheet
from observer_fi.records import Log
from observer_fi.report import improve_files

CASES = [("voltage", 853004), ("current", 853004), ("voltage", 853005), ("current", 853005)]
HEALTHY = [("voltage", 854001), ("current", 854000), ("voltage", 854002), ("current", 854002)]
OF_A_SERVO = (
    "input_delay",
    "current_lag",
    "integrator_clamp",
    "acceleration_limit",
    "dead_zone",
    "current_gain",
)


@cache
def campaign(drive: str, seed: int, *effects: Effect) -> tuple[Log, Rig]:
    """A campaign of a drawn actuator, and the rig file that its user learned from a healthy one."""
    actuator = hidden.draw_actuator(seed, drive)
    spec = replace(hidden.healthy_spec(actuator), effects=effects)
    log = log_from_frame(hidden.actuator_log(actuator, spec, seed)[0])
    if effects:
        return log, campaign(drive, seed)[1]
    rig = rig_of_sheet(drawn_sheet(actuator, drive)).rig
    return log, identified_rig(identify([log], rig), rig)


@cache
def improved(drive: str, seed: int, *effects: Effect) -> Improvement:
    log, rig = campaign(drive, seed, *effects)
    return improve([log], rig)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(("drive", "seed"), CASES)
def test_viscous_friction_has_its_name_and_size(drive: str, seed: int) -> None:
    actuator = hidden.draw_actuator(seed, drive)
    size = 0.3 * actuator.rig.A / actuator.speed
    found = improved(drive, seed, effect("viscous_friction", plus=size, minus=size))
    assert [one.cause for one in found.findings] == ["viscous_friction"]
    for value in found.findings[0].parameters.values():
        assert value.value == pytest.approx(size, rel=0.1)
    assert found.extended_rig.drive == drive and found.new_moves.best == "extended"


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("seed", [859005, 853004])
def test_a_friction_that_warms_up_has_its_name_and_size(seed: int) -> None:
    """Of 859005 a move is slow beside the noise of the position, and no name fits behind a loop around the cold machine."""
    found = improved("current", seed, effect("friction_warmup", rise=0.3, time=4.0))
    assert [one.cause for one in found.findings] == ["friction_warmup"]
    sizes = {name: value.value for name, value in found.findings[0].parameters.items()}
    assert sizes == pytest.approx({"warmup_rise": 0.3, "warmup_time": 4.0}, rel=0.1)


SHOWN_ELSEWHERE = [
    ("current", 862001, "play", 0.002),
    ("current", 862001, "play", 0.02),
    ("voltage", 859006, "play", 0.02),
    ("voltage", 862004, "play", 0.002),
    ("voltage", 862007, "play", 0.005),
    ("voltage", 859006, "lag", 0.02),
    ("voltage", 862004, "lag", 0.02),
    ("current", 862001, "lag", 0.02),
    ("voltage", 859006, "gain", 0.05),
]


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(("drive", "seed", "what", "size"), SHOWN_ELSEWHERE)
@pytest.mark.usefixtures("not_on_new_moves")
def test_a_position_that_is_shown_elsewhere_has_its_name_and_size(
    drive: str, seed: int, what: str, size: float
) -> None:
    """A lag in s, a gain off by a part, play in parts of the travel.

    Behind a loop that followed what it shows "torque over pitch" was told, or a friction beside it; of play, that the winding or
    the torque wanted to be free.
    """
    play = size * hidden.draw_actuator(seed, drive).travel
    made, parameter, value = {
        "lag": (effect("position_lag", lag=size), "position_lag", size),
        "gain": (effect("position_gain", gain=size), "position_gain", 1.0 + size),
        "play": (effect("backlash", width=play, start=1.0), "backlash", play),
    }[what]
    found = improved(drive, seed, made)
    assert [parameter in one.parameters for one in found.findings] == [True] and found.unexplained == ()
    # Of a gain a part may lie in the pitch of the screw.
    limit = 0.3 * size if what == "gain" else 0.05 * value
    assert found.findings[0].parameters[parameter].value == pytest.approx(value, abs=limit)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("drive", ["current", "voltage"])
def test_an_offset_of_the_current_that_drives_is_declared(drive: str) -> None:
    """It is a torque, and with a voltage that is logged an offset of this one beside it."""
    actuator = hidden.draw_actuator(853004, drive)
    offset = 0.1 * actuator.rig.A / actuator.rig.Km
    found = improved(drive, 853004, effect("current_offset", offset=offset))
    names = ["torque_offset", "voltage_offset"][: 1 if drive == "current" else 2]
    assert sorted(one.cause for one in found.findings) == names
    assert all("current_offset" in one.indistinguishable_from for one in found.findings)


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "seed"), HEALTHY)
@pytest.mark.first(1)
def test_a_healthy_campaign_misses_nothing(drive: str, seed: int) -> None:
    found = improved(drive, seed)
    assert found.findings == ()
    assert found.baseline.nll_per_sample < found.baseline.noise_floor_nll + 0.3
    given = set(found.extended_rig.quantities) - set(campaign(drive, seed)[1].quantities)
    assert not given & {"Kp", "Ki", "Vmax", "Rs"}  # of the loop that stood for a servo
    untold = [name for name in OF_A_SERVO if found.detectable[name] is not None]
    assert not untold and found.detectable["viscous_friction"] is not None


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize(("column", "named"), [("current_a", []), ("voltage_v", ["voltage_delay"])])
@pytest.mark.usefixtures("not_on_new_moves")
def test_a_channel_that_is_read_half_a_sample_late(column: str, named: list[str]) -> None:
    """A current that is late has no name: it left 1.3 nats, told as "torque over pitch", and 59 where it was interpolated."""
    actuator = hidden.draw_actuator(863009, "voltage")
    frame, _ = hidden.actuator_log(actuator, hidden.healthy_spec(actuator), 863009)
    t = frame["time_s"].to_numpy()
    late = 0.5 * float(np.median(np.diff(t)))
    frame[column] = np.interp(t - late, t, frame[column])
    log, rig = log_from_frame(frame), rig_of_sheet(drawn_sheet(actuator, "voltage")).rig
    found = improve([log], identified_rig(identify([log], rig), rig))
    assert [one.cause for one in found.findings] == named and found.unexplained == ()
    assert found.extended.nll_per_sample < found.extended.noise_floor_nll + 0.3
    told = [one.parameters["voltage_delay"].value for one in found.findings]
    told += [own.late / log.rate_hz for own in found.filters]
    assert told == [pytest.approx(late, rel=0.2)]


@pytest.mark.slow
def test_its_page_says_what_was_not_tested_and_draws_what_was() -> None:
    drive, seed = HEALTHY[1]
    found = improved(drive, seed)
    assert "servo, current sensor, winding are not tested" in found.warnings[-1]
    assert found.before.channels == ("position",)
    files = improve_files(found, None, "rig", [campaign(drive, seed)[0].path])
    record = json.loads(files["improve.json"])
    assert set(record["baseline"]["whiteness_p"]) == {"position_m"}
