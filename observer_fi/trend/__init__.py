"""What changed: an actuator's life from its logs. One log's quantities, a baseline of healthy logs, changes and their causes."""

from observer_fi.trend.baseline import Baseline, departure, learn, score_of
from observer_fi.trend.digests import Digest, from_plain, to_plain
from observer_fi.trend.few import Difference, in_percent
from observer_fi.trend.kinds import in_words, kind_of
from observer_fi.trend.life import CHANGED, NOT_TESTED, UNCHANGED, Compared, Finding, Judged, Trend, trend
from observer_fi.trend.read import digest_of, rig_without_constants

__all__ = [
    "Baseline",
    "CHANGED",
    "Compared",
    "Difference",
    "Digest",
    "Finding",
    "Judged",
    "NOT_TESTED",
    "Trend",
    "UNCHANGED",
    "departure",
    "digest_of",
    "from_plain",
    "in_percent",
    "in_words",
    "kind_of",
    "learn",
    "rig_without_constants",
    "score_of",
    "to_plain",
    "trend",
]
