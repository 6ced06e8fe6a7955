"""The page of a plan: whether it decides in words and figures that agree, and the command as it is written to moves.csv."""

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest
from made_plan import plan

from observer_fi.plan.planning import Profile
from observer_fi.plan.written import course, moves_csv, steps
from observer_fi.report.plan_page import charts, headline, odds, page
from observer_fi.report.results.figures import of_plan


def test_the_headline_says_what_is_decided() -> None:
    assert headline(plan()) == "These moves tell backlash from position lag"
    assert headline(plan(2.0, decides=False)) == "These moves may not tell backlash from position lag"
    nothing = Profile((), 0.0)
    hopeless = replace(plan(decides=False), planned=nothing, before=nothing, simpler=nothing, confirmed=())
    assert headline(hopeless) == "No move tells backlash from position lag"
    text = page(hopeless)
    assert "The time binds" in text and "What to record" not in text and of_plan(hopeless) == {}
    known = replace(plan(), rivals=(), std={"A": (1e-5, 1e-6, 2e-6)}, confirmed=())
    assert headline(known) == "These moves pin down A" and "nats" not in page(known)


def test_odds_are_words() -> None:
    assert odds(0.0) == "even" and odds(math.log(100.0)) == "100 to 1"
    assert odds(2.0) == "7.4 to 1" and odds(90.1) == "over a million to 1"


def test_the_page_holds_every_step_and_size_and_is_the_same_twice() -> None:
    made = plan(pitches=(0.0, 10.0))
    text = page(made)
    for profile in (made.planned, made.simpler):
        for line in steps(profile, made.limits):
            assert line[1:] in text
    assert "<th>backlash</th><td>30 µm</td>" in text and "<th>position lag</th><td>2 ms</td>" in text
    assert page(made) == text
    assert "pitch to set" in text and "pitch to set" not in page(plan())


@pytest.mark.parametrize("pitches", [(0.0,), (0.0, 10.0)])
def test_the_drawn_command_is_the_one_that_is_written(pitches: tuple[float, ...]) -> None:
    made = plan(pitches=pitches)
    drawn = course(made.planned, made.limits)
    rows = list(csv.DictReader(io.StringIO(moves_csv(made))))
    at, speed = (np.array([float(row[name]) for row in rows]) for name in ("time_s", "speed_cmd_rad_s"))
    assert np.interp(drawn.t, at, speed) == pytest.approx(drawn.w, abs=1e-3)
    assert np.abs(drawn.x).max() <= 1e-3 and drawn.x[-1] == pytest.approx(0.0, abs=1e-9)
    assert len(drawn.begins) == len(steps(made.planned, made.limits))
    assert len(charts(made).panels) == (6 if len(pitches) > 1 else 4)


def test_the_still_figure_has_both_profiles() -> None:
    (figure,) = of_plan(plan()).values()
    assert [axes.get_ylabel() for axes in figure.axes] == ["speed [rad/s]", "travel [µm]", "speed [rad/s]"]
