"""The summary of a fleet: what each log asks for, and charts that hold every fault once, at its log."""

import json
from typing import Any

import numpy as np
import pytest

from observer_fi.physics.rigs import load_rig
from observer_fi.report.fleet_page import charts, page, urgency_of


def row(log: str, label: str | None = "nominal", probability: float = 0.99, **parts: Any) -> dict[str, Any]:
    blank = ("channel", "onset_s", "isolated_s", "nis_ratio", "error", "what")
    numbers = {"moves": 1, "faulty_moves": 0, "duration_s": 1.0, "gaps": 0, "rejected": 0}
    return dict.fromkeys(blank) | numbers | {
        "log": log, "status": "done", "label": label, "probability": probability, "open_loop": "nominal", "events": "[]",
        "report": f"{log}/report.html", **parts,
    }  # fmt: skip


def fault(label: str, onset: float | None, channel: str | None = None, **sizes: float) -> dict[str, Any]:
    severity = {name: {"value": value, "unit": "1"} for name, value in sizes.items()}
    return {"label": label, "channel": channel, "probability": 0.99, "onset_s": onset, "severity": severity}


ROWS = [
    row("c", "overload", events=json.dumps([fault("overload", 2.0, share_lost=0.5), fault("slip", 3.0, share_lost=0.1)])),
    row("b", "sensor_fault", 0.7, channel="current", events=json.dumps([fault("sensor_fault", None, "current")])),
    row("d", None, status="bad", report=None, error="empty", events=None),
    row("a", nis_ratio=1.1),
]  # fmt: skip


@pytest.mark.parametrize(
    ("label", "probability", "urgency"),
    [
        ("overload", 0.99, "act"),
        ("overload", 0.9, "look"),
        ("unknown", 0.99, "look"),
        ("nominal", 0.5, "healthy"),
        ("not_tested", None, "none"),
    ],
)
def test_a_verdict_asks_for_something(label: str, probability: float, urgency: str) -> None:
    assert urgency_of(row("x", label, probability)) == urgency
    assert urgency_of(row("x", label, probability) | {"status": "failed"}) == "none"


def test_every_fault_is_a_dot_at_its_log_in_the_order_of_paths() -> None:
    needs, onsets, sizes, fit = charts(ROWS).panels
    assert needs.names == ("a", "b", "c", "d") and needs.links == (
        "a/report.html",
        "b/report.html",
        "c/report.html",
        "",
    )
    heights = np.nansum([s.y for s in needs.series], axis=0)
    np.testing.assert_array_equal(heights, [1.0, 2.0, 3.0, 0.0])
    np.testing.assert_array_equal(onsets.x, [3.0, 3.0])  # without an onset there is no dot
    np.testing.assert_array_equal(np.nansum([s.y for s in onsets.series], axis=0), [2.0, 3.0])
    assert sizes.unit == "%" and [s.name for s in sizes.series] == ["overload", "slip"]
    assert fit.names == ("a",)


def test_the_page_has_the_same_bytes_again_and_leads_to_trends() -> None:
    first, again = (page("logs", load_rig(), ROWS, {"life": "life/trend.html"}) for _ in range(2))
    assert first == again and '<a href="life/trend.html">' in first and "empty" in first


def test_a_fleet_without_logs_that_could_be_read_has_a_page() -> None:
    assert "No verdict" in page("logs", load_rig(), ROWS[2:3], {})
