"""Score sheets, against cases small enough to count by hand."""

import math

import pytest

from observer_fi.records import Consistency, Event, Isolation
from observer_fi.verdict import scores
from observer_fi.verdict.scores import Case


def judged(
    truth: str, verdict: str, p: float = 0.99, delay: float = math.nan, error: float = math.nan
) -> Case:
    onset = None if truth == "nominal" else 1.0
    return Case(truth, "a" if p > 0.9 else "b", onset, verdict, p, delay, error, 1.0)


CASES = [
    judged("nominal", "nominal", 0.999),
    judged("nominal", "overload", 0.6),
    judged("overload", "overload", 0.99, 0.03, -0.001),
    judged("overload", "overload", 0.97, 0.05, 0.003),
    judged("overload", "overload", 0.7),  # right, never isolated
    judged("coupling_loss", "unknown", 0.96),
]


def isolation(label: str, onset_s: float | None = None, isolated_s: float | None = None) -> Isolation:
    event = Event(
        label, None, 0.98, onset_s, (onset_s, onset_s), isolated_s, isolated_s, 0.0, 2.0, {label: 0.98}
    )
    return Isolation(event, (event,), Consistency(3.3, 3.0, 0.5))


def test_a_case_has_a_delay_and_an_onset_error_only_where_it_is_right() -> None:
    right = scores.case("overload", "steady", 1.0, isolation("overload", 1.002, 1.04))
    assert (right.delay_s, right.onset_error_s) == pytest.approx((0.04, 0.002))
    assert right.nis_ratio == pytest.approx(1.1) and right.right
    wrong = scores.case("overload", "steady", 1.0, isolation("coupling_loss", 1.002, 1.04))
    late = scores.case("overload", "steady", 1.0, isolation("overload", None, None))
    healthy = scores.case("nominal", "steady", None, isolation("nominal", None, 0.3))
    for case in (wrong, late, healthy):
        assert math.isnan(case.delay_s) and math.isnan(case.onset_error_s)
    assert not wrong.right and healthy.right


def test_confusion_counts_every_case_once() -> None:
    table = scores.confusion(CASES)
    assert list(table) == ["nominal", "overload", "coupling_loss"]
    assert table["nominal"]["overload"] == 1 and table["overload"]["overload"] == 3
    assert table["coupling_loss"]["unknown"] == 1
    assert sum(sum(row.values()) for row in table.values()) == len(CASES)
    assert scores.accuracy(CASES) == pytest.approx(4 / 6)
    assert math.isnan(scores.accuracy([]))


def test_delays_are_those_of_right_verdicts_and_count_the_never() -> None:
    found = scores.delays(CASES)
    assert set(found) == {"overload"}
    assert (found["overload"].right, found["overload"].never) == (3, 1)
    assert found["overload"].median_s == pytest.approx(0.04)
    assert found["overload"].onset_error_median_s == pytest.approx(0.002)  # of the size, not the sign


def test_reliability_sets_what_was_stated_against_what_was_right() -> None:
    bins = scores.reliability(CASES)
    assert sum(b.cases for b in bins) == len(CASES)
    middle = next(b for b in bins if b.low == 0.5)
    assert (middle.cases, middle.stated, middle.right) == (2, pytest.approx(0.65), 0.5)
    assert scores.brier([judged("overload", "overload", 1.0)]) == 0.0
    assert scores.brier([judged("overload", "nominal", 1.0)]) == 1.0


def test_the_sheet_is_plain_data() -> None:
    sheet = scores.summary(CASES)
    assert sheet["cases"] == 6
    assert sheet["accuracy_by_group"] == {"a": 0.75, "b": 0.5}
    assert sheet["delays"]["overload"]["never"] == 1
