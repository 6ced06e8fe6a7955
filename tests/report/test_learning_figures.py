"""Charts of identify: what was measured and fitted comes back, correlations stand in a table."""

import json

import numpy as np
import pytest
from packed import unpacked

from observer_fi.improve import Value
from observer_fi.learn.section3 import Step
from observer_fi.physics import Curve
from observer_fi.records import Fit, Parameter
from observer_fi.report.learning import correlated, errors_words, fitted
from observer_fi.report.learning_figures import ALONG, fit_over_data, kept_curve, of_identify, step_chart

TWO = tuple(Parameter(name, 1.0, 0.1, 1.1, "N m", 0.8, 1.2) for name in ("A", "B"))


def fit(correlation: np.ndarray, **figures: object) -> Fit:
    return Fit(TWO, correlation, {}, 1.0, {}, dict(figures))


def log_of(n: int) -> dict[str, np.ndarray]:
    t = np.arange(n) / 1600.0
    y = np.column_stack([np.sin(t), 0.02 * np.cos(3.0 * t), 1e-3 * t])
    return {"time": t, "measured": y + 1e-3, "simulated": y, "residual": y / 1e-3}


@pytest.mark.parametrize("n", [500, 60_000])
def test_measured_and_simulated_stand_over_their_residuals_on_one_axis(n: int) -> None:
    one = log_of(n)
    one["measured"][n // 2, 1] = 9.0  # a spike that must not be thinned away
    panels = fit_over_data(one, 2).panels
    assert [panel.unit for panel in panels] == ["V", "", "mA", "", "mm", ""]
    assert {panel.link for panel in panels} == {"fit-2"} and max(
        panel.x.size for panel in panels
    ) <= 1.1 * ALONG
    measured, simulated = panels[2].series
    assert measured.y.max() == 9e3 and simulated.y.max() == pytest.approx(20.0, rel=1e-3)
    rows = np.searchsorted(one["time"], panels[4].x)
    np.testing.assert_allclose(panels[4].series[0].y, 1e3 * one["measured"][rows, 2])


def test_a_step_shows_its_data_as_dots_and_a_line_for_each_direction() -> None:
    x = np.array([0.3, 0.1, 0.2, 0.4])
    arrays = {"pitch": x, "torque": 2.0 * x, "fitted": 3.0 * x, "direction": np.array([1.0, 1.0, -1.0, -1.0])}
    charts = step_chart("friction", Step("7", {"A": 1.0}, {"A": 0.1}, arrays))
    (panel,) = charts.panels
    np.testing.assert_array_equal(panel.x, np.sort(x))
    data, *ways = panel.series
    assert data.width == 0.0 and data.points > 0.0 and [line.width > 0.0 for line in ways] == [True, True]
    np.testing.assert_allclose(data.y, 2e3 * panel.x)  # mN m
    assert panel.title.endswith("motor torque [mN m]") and [w.name for w in ways] == [
        "fitted, backward",
        "fitted, forward",
    ]
    known = [np.isfinite(line.y) for line in ways]
    assert (known[0] ^ known[1]).all()
    assert unpacked(json.loads(charts.json)["panels"][0]["series"][0]["y"]) == pytest.approx(data.y)


def test_a_step_without_curves_is_not_drawn() -> None:
    lone = Step("7", {"A": 1.0}, {"A": 0.1}, {"pitch": np.array([1.0, 2.0])})
    assert set(of_identify(fit(np.eye(2), fits=[log_of(100)], steps={"friction": lone}))) == {"fit_1"}


def test_correlations_are_a_triangle_and_none_where_nothing_is_known() -> None:
    assert correlated(fit(np.array([[1.0, -0.9], [-0.9, 1.0]]))) == [("A", [1.0]), ("B", [-0.9, 1.0])]
    assert correlated(fit(np.empty((0, 0)))) == []


def test_a_kept_curve_has_a_band_of_two_standard_errors() -> None:
    curve = Curve("torque", "position", True, 0.0, 1e-3, (1e-3, 2e-3, 3e-3), (1e-4, 1e-4, 1e-4))
    (panel,) = kept_curve(curve).panels
    (line,) = panel.series
    np.testing.assert_allclose(panel.x, [0.0, 1.0, 2.0])
    np.testing.assert_allclose(line.high - line.y, 0.2)
    assert (panel.unit, panel.title) == ("mN m", "Torque over position")


def test_errors_that_stay_are_not_said_to_fall() -> None:
    ratios = {"voltage_v": 0.27, "current_a": 1.21, "position_m": 0.996}
    assert errors_words(ratios) == (
        "; their rms error falls to 27 % (voltage), rises to 121 % (current), stays as it was (position)"
    )
    assert (
        errors_words({"voltage_v": 0.5}) == "; their rms error falls to 50 % (voltage)"
        and errors_words({}) == ""
    )


def test_a_choice_between_forms_is_no_size() -> None:
    limit, ahead = Value(18e3, 0.7, 0.0, "rad/s^2"), Value(1.0, 0.0, 0.0, "1")
    assert fitted({"accel_limit": limit, "accel_ahead": ahead}) == {"accel_limit": limit}
    assert fitted({"accel_ahead": ahead}) == {"accel_ahead": ahead}
