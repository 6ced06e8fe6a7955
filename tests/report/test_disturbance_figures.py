"""Figures of freed equations: every panel is drawn, bumps survive thinning, a band is an area."""

import numpy as np

from observer_fi.improve.freed.smoothed_disturbance import BinnedDisturbance, SmoothedDisturbance
from observer_fi.learn.linear import DISTURBANCES, TORQUE
from observer_fi.report.chart import Figure
from observer_fi.report.disturbance_figures import disturbance_figure, handy


def disturbance(n: int = 40000) -> SmoothedDisturbance:
    t = np.arange(n) / 1600.0
    mean, at = np.sin(t), np.linspace(0.0, 1.0, 60)
    mean[n // 2] = np.nan
    curve = BinnedDisturbance(at, np.sin(at), -np.sin(at), np.full(60, 0.1), 0.9)
    once = BinnedDisturbance(at, at, np.full(60, np.nan), np.full(60, 0.1), 0.1)
    return SmoothedDisturbance(
        DISTURBANCES[TORQUE], 100.0, t, 1e-5 * mean, np.full(n, 1e-6), {"position": curve, "time": once}
    )


def test_a_figure_has_every_panel_and_stays_small():
    svg = disturbance_figure(disturbance(), 0)
    assert svg.count("<clipPath") == 3
    assert "torque [mN m]" in svg and "predicts 90 %" in svg and "position [mm]" in svg
    assert len(svg) < 200_000


def test_a_single_extreme_sample_survives():
    y = np.zeros(50000)
    y[12345] = 1.0
    panel = Figure("f", 500, 200, "").panel(0.0, 0.0, 400.0, 100.0, (0.0, 1.0), (0.0, 1.0))
    panel.ribbon(np.linspace(0.0, 1.0, y.size), y - 0.01, y, "#000")
    heights = [
        float(pair.split()[1])
        for pair in panel.parts[0].split('"')[1].strip("MZ").replace("M", "L").split("L")
    ]
    assert min(heights) == 0.0


def test_a_ribbon_is_broken_where_nothing_is_known():
    x, y = np.arange(6.0), np.array([0.0, 1.0, np.nan, 1.0, 0.5, np.nan])
    panel = Figure("f", 500, 200, "").panel(0.0, 0.0, 400.0, 100.0, (0.0, 5.0), (0.0, 1.0))
    panel.ribbon(x, y - 0.1, y + 0.1, "#000")
    path = panel.parts[0].split('"')[1]
    assert path.count("Z") == 2 and "nan" not in path


def test_units_are_handy():
    assert handy("N m") == ("mN m", 1e3)
    assert handy("deg") == ("deg", 1.0)
