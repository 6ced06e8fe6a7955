"""Lines of `watch` in words, for people: what happened, when, and how sure it is."""

from typing import Any

from observer_fi.physics import FAULTS, NOT_TESTED
from observer_fi.report import diagnosis

SHOWN = 0.005  # hypotheses less likely than this are left out of a sample's line


def in_words(line: dict[str, Any]) -> str:
    """One line of `watch` as one line of text."""
    now = f"{diagnosis.seconds(line['time_s']):>12}  "
    if line["event"] == "sample":
        return now + _odds(line["posterior"])
    moves = "1 move" if line["move"] == 1 else f"{line['move']} moves"
    said = _BEGINS[line["event"]].format(move=line["move"], moves=moves) + _verdict(line)
    why = f" ({'; '.join(line['reasons'])})" if line["reasons"] else ""
    if line["event"] in ("heartbeat", "end"):
        said += f"; {line['samples']} samples, {line['skipped']} skipped"
    return now + said + why


_BEGINS = {
    "verdict": "move {move}: ",
    "heartbeat": "still, move {move}: ",
    "restart": "a new bank begins; until now: ",
    "end": "end, {moves}: ",
}


def _verdict(line: dict[str, Any]) -> str:
    label = line["label"]
    if label == NOT_TESTED:
        return "not tested"
    channel = f" ({line['channel']})" if line["channel"] else ""
    said = f"{FAULTS[label].title.lower()}{channel}, probability {diagnosis.percent(line['probability'])}"
    if line["since_s"] is not None:
        said += f", above 95 % since {diagnosis.seconds(line['since_s'])}"
    if line["detected_s"] is not None:
        said += f", suspected since {diagnosis.seconds(line['detected_s'])}"
    return said


def _odds(posterior: dict[str, float]) -> str:
    likely = sorted(((p, label) for label, p in posterior.items() if p >= SHOWN), reverse=True)
    return ", ".join(f"{FAULTS[label].title.lower()} {diagnosis.percent(p)}" for p, label in likely)
