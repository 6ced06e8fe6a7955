"""Figures of freed equations: every panel is drawn, bumps survive thinning, a band is an area."""

import numpy as np
import pytest

from observer_fi.improve.freed.smoothed_disturbance import BinnedDisturbance, SmoothedDisturbance
from observer_fi.learn.linear import DISTURBANCES, TORQUE
from observer_fi.report.disturbance_figures import over_regressors, over_time


def disturbance(n: int = 40000) -> SmoothedDisturbance:
    t = np.arange(n) / 1600.0
    mean, at = np.sin(t), np.linspace(0.0, 1.0, 60)
    mean[n // 2] = np.nan
    curve = BinnedDisturbance(at, np.sin(at), -np.sin(at), np.full(60, 0.1), 0.9)
    once = BinnedDisturbance(at, at, np.full(60, np.nan), np.full(60, 0.1), 0.1)
    return SmoothedDisturbance(
        DISTURBANCES[TORQUE], 100.0, t, 1e-5 * mean, np.full(n, 1e-6), {"position": curve, "time": once}
    )


def test_every_quantity_has_a_panel_with_its_band_and_its_share() -> None:
    along, over = over_time(disturbance(), 0), over_regressors(disturbance(), 0)
    assert [panel.unit for panel in (*along.panels, *over.panels)] == ["µN m"] * 3
    titles = {panel.title for panel in over.panels}
    assert titles == {"over position, predicts 90 %", "over time, predicts 10 %"}
    directed = next(panel for panel in over.panels if "position" in panel.title)
    assert [series.name for series in directed.series] == ["forward", "backward"]
    for panel in (*along.panels, *over.panels):
        for series in panel.series:
            known = np.isfinite(series.y)
            assert (series.low[known] < series.y[known]).all() and (
                series.y[known] < series.high[known]
            ).all()
    assert len(along.json) + len(over.json) < 200_000


def test_a_single_extreme_sample_and_a_gap_survive() -> None:
    made = disturbance()
    made.mean[12345] = 1e-3
    (line,) = over_time(made, 0).panels[0].series
    assert np.nanmax(line.y) == pytest.approx(1e3) and np.isnan(line.y).sum() == 1


def test_what_is_known_nowhere_is_drawn_empty() -> None:
    made = disturbance(100)
    made.mean[:] = np.nan
    (panel,) = over_time(made, 0).panels
    assert panel.limits == (-1.0, 1.0) and not np.isfinite(panel.series[0].y).any()
