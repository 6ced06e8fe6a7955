"""Cells of the page of a trend: sizes in one unit, causes that do not contradict the sentence."""

import json

from observer_fi.report.diagnosis import json_rows_text, json_text
from observer_fi.report.trend_page import _cause, _sizes
from observer_fi.trend import Finding

FRICTION = Finding(
    "drift",
    30,
    "asymmetric_friction",
    "torque",
    "A",
    7.14e-5,
    5.55e-6,
    "N m",
    4.125e-4,
    (),
    ("A",),
    29,
    32,
    "",
)
PLAY = Finding(
    "step",
    55,
    "backlash",
    "kinematics",
    "backlash",
    9.49e-5,
    1.57e-6,
    "m",
    -3.28e-7,
    (),
    ("backlash",),
    55,
    55,
    "",
)


def test_a_life_is_written_with_a_line_for_each_log_and_says_the_same():
    found = {
        "schema": "x",
        "of": {"a": float("nan"), "b": [1, 2]},
        "logs": [{"at": k, "n": "µ"} for k in range(50)],
        "bad": [],
    }
    text = json_rows_text(found)
    assert json.loads(text) == json.loads(json_text(found))
    assert len([line for line in text.splitlines() if '"at"' in line]) == 50
    assert "NaN" not in text and "µ" in text


def test_sizes_stand_in_one_unit_to_the_digit_of_their_error() -> None:
    assert _sizes(FRICTION) == ("412.5 µN m", "+71.4 µN m", "5.5 µN m")
    assert _sizes(PLAY) == ("-0.3 µm", "+94.9 µm", "1.6 µm")  # and not -328 nm, of which nothing is known
    assert _sizes(FRICTION._replace(unit="1", size=0.1, std=0.01)) == ("", "+10.5 %", "1.01 %")


def test_a_friction_in_both_directions_is_not_called_asymmetric() -> None:
    assert _cause(FRICTION) == "friction, in both directions"
    assert _cause(FRICTION._replace(name="friction_forward")) == "asymmetric friction"
    assert _cause(PLAY) == "backlash"
