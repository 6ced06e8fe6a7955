"""The figures of a report, from Traces to SVG: what was measured, what was predicted, and how far apart."""

from observer_fi.records import Outcome

CAPTIONS: dict[str, str] = {}


def colour_of(mode: str, channel: str | None = None) -> str:
    return "#000"


def draw(outcome: Outcome) -> dict[str, str]:
    return {}
