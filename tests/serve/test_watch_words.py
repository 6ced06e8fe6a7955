"""Lines of `watch` in words: every event says what happened, when, and how sure it is."""

import io
from pathlib import Path
from typing import Any

import pytest

from observer_fi.physics import FAULTS, load_rig
from observer_fi.serve.watch import Options, Watch
from observer_fi.serve.watch_words import in_words
from observer_fi.settings import Settings

SAMPLE = Path(__file__).parents[2] / "data" / "coupling_loss_steady.csv.gz"
LINE: dict[str, Any] = {
    "event": "verdict", "time_s": 1.9, "label": "coupling_loss", "channel": None, "probability": 0.9989, "posterior": {},
    "since_s": 1.9, "detected_s": None, "move": 1, "samples": 3054, "skipped": 2, "reasons": [],
}  # fmt: skip


@pytest.mark.slow
def test_a_stream_in_words_says_what_the_json_says() -> None:
    import gzip

    out, again = io.StringIO(), io.StringIO()
    for text, where in ((True, out), (False, again)):
        flow = Watch(Options(load_rig(), Settings(), text=text), "stream", where, print)
        flow.take(gzip.decompress(SAMPLE.read_bytes()))
        flow.finish("the stream ended")
    words, lines = out.getvalue().splitlines(), again.getvalue().splitlines()
    assert len(words) == len(lines) >= 3
    changes = [line for line in words if "coupling loss, probability" in line]
    assert "move 1: coupling loss, probability 9" in changes[0] and "above 95 % since 1." in changes[0]
    assert words[-1].endswith("0 skipped (the stream ended)") and "end, 1 move: coupling loss" in words[-1]
    assert not any("{" in line for line in words)


@pytest.mark.parametrize("label", [*FAULTS, "not_tested"])
@pytest.mark.parametrize("event", ["verdict", "heartbeat", "restart", "end"])
def test_every_event_and_every_label_has_words(event: str, label: str) -> None:
    channel = "current" if label == "sensor_fault" else None
    said = in_words(LINE | {"event": event, "label": label, "channel": channel, "reasons": ["why"]})
    title = "not tested" if label == "not_tested" else FAULTS[label].title.lower()
    assert title in said and "(why)" in said and said.startswith("     1.900 s  ") and "\n" not in said
    assert ("(current)" in said) == (channel is not None)
    assert ("2 skipped" in said) == (event in ("heartbeat", "end"))


def test_a_sample_names_what_is_likely_and_a_stream_without_a_time_says_so() -> None:
    sample = {
        "event": "sample",
        "time_s": 0.5,
        "posterior": {"nominal": 0.9, "overload": 0.0999, "jam": 1e-4},
    }
    assert in_words(sample) == "     0.500 s  no fault 90.0 %, overload 10.0 %"
    assert in_words(LINE | {"time_s": None}).startswith("           –  ")
