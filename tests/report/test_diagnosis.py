"""Reports say what the records say, in the contract's words, with the same bytes each time."""

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from packed import unpacked

from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import ChannelTraits, Clock, Consistency, Line, Outcome
from observer_fi.report import diagnosis as report
from observer_fi.report import diagnosis_figures as figures
from observer_fi.settings import Settings
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.explain import explanation

RIG = load_rig()
CONTRACT = {
    "log": ["path", "sha256", "samples", "rate_hz", "gaps", "notes"],
    "verdict": [
        "label",
        "channel",
        "probability",
        "onset_s",
        "onset_interval_s",
        "detected_s",
        "isolated_s",
    ],
    "posterior": ["nominal", "overload", "coupling_loss", "slip", "jam"],
    "open_loop": ["label", "isolated_s"],
    "consistency": ["nis_mean", "nis_expected", "whiteness_p"],
}


def diagnosed(kind: str, channel: str | None = None) -> Outcome:
    move = (Move(0.2, 410.0, 1.4),)
    log, _ = synthesise(Scenario(move, 1.9, fault=Fault(kind, 0.9, channel), seed=8), RIG, f"{kind}.csv")
    return diagnose_log(log, RIG, Settings())


@pytest.fixture(scope="module", params=["none", "overload", "coupling_loss", "sensor_frozen", "slip"])
def outcome(request: pytest.FixtureRequest) -> Outcome:
    return diagnosed(request.param, "position" if request.param == "sensor_frozen" else None)


@pytest.fixture(scope="module")
def overload() -> Outcome:
    return diagnosed("overload")


@pytest.mark.first(2, 4)
def test_report_json_has_the_keys_of_the_contract_in_its_order(outcome: Outcome) -> None:
    result = json.loads(report.json_text(report.report_dict(outcome)))
    top = ["schema", "log", "verdict", "posterior", "open_loop", "consistency", "explanation"]
    assert [key for key in result if key in top] == top
    assert result["schema"] == "observer-fi/report/1"
    for key, names in CONTRACT.items():
        assert list(result[key])[: len(names)] == names
    assert sum(result["posterior"].values()) == pytest.approx(1.0, abs=1e-6)
    assert result["verdict"]["label"] == outcome.isolation.verdict.label
    assert len(result["verdict"]["onset_interval_s"]) == 2
    assert len(result["explanation"]) > 20


CHANNEL_KEYS = [
    "noise_std",
    "as_white",
    "resolution",
    "update_hz",
    "lines_hz",
    "line_amplitudes",
    "correlation_s",
    "spikes",
    "averaged_samples",
    "low_pass_hz",
]


def test_report_json_tells_what_the_logger_does(outcome: Outcome) -> None:
    """In the contract's words, null where there is no such trait; an ideal logger hides nothing."""
    told = json.loads(report.json_text(report.report_dict(outcome)))
    acquisition = told["acquisition"]
    assert list(acquisition) == ["voltage_v", "current_a", "position_m", "clock"]
    for column in ("voltage_v", "current_a", "position_m"):
        channel = acquisition[column]
        assert sorted(channel) == sorted(CHANNEL_KEYS) and channel["noise_std"] > 0.0
        assert (
            channel["resolution"]
            is channel["update_hz"]
            is channel["correlation_s"]
            is channel["low_pass_hz"]
            is None
        )
        assert channel["lines_hz"] == [] and channel["spikes"] == 0 and channel["averaged_samples"] == 1
    assert acquisition["clock"] == {"jitter_s": 0.0, "resolution_s": None}
    assert told["warnings"] == []


def through_a_poor_logger(overload: Outcome) -> Outcome:
    assert overload.acquisition is not None
    voltage, current, position, _ = overload.acquisition
    poor = overload.acquisition._replace(
        voltage=ChannelTraits(math.nan, math.nan),
        current=current._replace(lines=(Line(50.02, 2e-3),), correlation_s=20e-3, spikes=4),
        position=position._replace(update_hz=100.0, resolution=1e-5, averaged=32),
        clock=Clock(2.9e-4, 1e-3, 1.25e-3),
    )
    return replace(overload, acquisition=poor, warnings=("position_m is held, fresh 100 times a second",))


def test_the_traits_of_a_poor_logger_stand_in_json_and_on_the_page(overload: Outcome) -> None:
    outcome = through_a_poor_logger(overload)
    files = report.files(outcome, RIG)
    told = json.loads(files["report.json"])
    assert list(told["acquisition"]) == [
        "current_a",
        "position_m",
        "clock",
    ]  # a channel that is not there has no traits
    assert told["acquisition"]["current_a"]["lines_hz"] == [50.02]
    assert told["acquisition"]["current_a"]["line_amplitudes"] == [2e-3]
    assert told["acquisition"]["position_m"]["update_hz"] == 100.0
    assert told["acquisition"]["clock"] == {"jitter_s": 2.9e-4, "resolution_s": 1e-3}
    assert told["warnings"] == list(outcome.warnings)
    text = visible_text(files["report.html"])
    assert "what it does to its readings, measured from this log" in text
    for words in (
        "is held, fresh 100 times a second",
        "50.02",
        "20 ms",
        "290 µs",
        "every sample",
    ):
        assert words in text, words
    assert not re.search(
        r"\d[eE][-+]\d", text.partition("Settings")[0]
    )  # quantities have units that keep them short


@pytest.mark.slow
def test_a_fault_late_in_a_long_log_is_drawn_sample_by_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """Starts of healthy moves once took all the room that was kept for samples, and the page opened on nothing."""
    monkeypatch.setattr(
        "observer_fi.verdict.diagnosis.CHUNK_ROWS", 8192
    )  # as many chunks as a longer log has
    moves = tuple(Move(0.3 + 3.0 * k, 410.0 * (-1) ** k, 2.0) for k in range(22))
    log, _ = synthesise(Scenario(moves, 67.0, fault=Fault("coupling_loss", 55.5), seed=5), RIG, "long")
    outcome = diagnose_log(log, RIG, Settings())
    near = outcome.overview.t[np.abs(outcome.overview.t - 55.5) < 0.03]
    assert np.diff(near).max() < 1e-3
    begun = outcome.overview.t[np.abs(outcome.overview.t - 0.35) < 0.05]  # the start of the first move, too
    assert np.diff(begun).max() < 1e-3
    views = figures.draw(outcome)["log"].views
    assert 1 <= len(views) < len(figures.views(outcome.isolation)) + 1 and views[0].low < 55.5 < views[0].high
    for view in views:
        inside = (outcome.overview.t >= view.low) & (outcome.overview.t <= view.high)
        assert np.count_nonzero(inside) >= figures.FEWEST


def test_an_outcome_that_no_logger_was_measured_for_still_makes_a_page(overload: Outcome) -> None:
    outcome = replace(overload, acquisition=None)
    assert report.report_dict(outcome)["acquisition"] == {}
    assert "measured from this log" not in visible_text(report.files(outcome, RIG)["report.html"])


def test_nan_and_infinity_become_null() -> None:
    text = report.json_text(
        {"a": math.nan, "b": [math.inf, np.float64(1.5)], "c": np.arange(2), "d": (None, True)}
    )
    assert json.loads(text) == {"a": None, "b": [None, 1.5], "c": [0, 1], "d": [None, True]}


def test_an_unknown_consistency_is_null_and_still_makes_a_page(overload: Outcome) -> None:
    nothing = Consistency(math.nan, 3.0, math.nan)
    outcome = replace(overload, isolation=replace(overload.isolation, consistency=nothing))
    assert report.report_dict(outcome)["consistency"]["nis_mean"] is None
    assert "nan" not in visible_text(report.files(outcome, RIG)["report.html"])


class _Text(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.hidden = 0
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.hidden += tag in ("style", "script")
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        self.hidden -= tag in ("style", "script")

    def handle_data(self, data: str) -> None:
        if not self.hidden:
            self.words.append(data)


def visible_text(html: str) -> str:
    parser = _Text()
    parser.feed(html)
    return " ".join(" ".join(parser.words).split())


def test_the_page_opens_with_the_verdict_and_needs_no_network(outcome: Outcome) -> None:
    html = report.files(outcome, RIG)["report.html"]
    text = visible_text(html)
    names = {"nominal": "No fault", "overload": "Overload", "coupling_loss": "Coupling loss", "sensor_fault": "Sensor fault",
             "unknown": "Unknown fault", "slip": "Slip", "jam": "Jam"}  # fmt: skip
    headline = text[: text.index(outcome.explanation)]
    assert [name for name in names.values() if name in headline] == [names[outcome.isolation.verdict.label]]
    assert text.index(outcome.explanation) < text.index("What was measured, and what told")
    parser = _Text()
    parser.feed(html)
    assert parser.links == []
    assert "url(http" not in html
    assert "@import" not in html and "fetch(" not in html
    for words in ("How sure", "Mean normalised innovation squared", "Settings", "SHA-256", "observer-fi"):
        assert words in text


@pytest.mark.slow
def test_the_same_inputs_give_the_same_bytes() -> None:
    assert report.files(diagnosed("overload"), RIG) == report.files(diagnosed("overload"), RIG)


def test_what_the_log_says_cannot_break_the_page(overload: Outcome) -> None:
    evil = "<script>alert('1')</script> <!-- & "
    log = replace(overload.log, path=evil, metadata=(evil,), notes=(evil,))
    html = report.files(replace(overload, log=log, name=evil), RIG)["report.html"]
    assert "<script>alert" not in html and "<!--" not in html
    whole = report.files(overload, RIG)["report.html"]
    assert html.count("<script") == whole.count("<script") == whole.count("</script>")


def lines_of(outcome: Outcome, title: str) -> dict[str, np.ndarray]:
    """The lines of a panel as the page holds them, by name, and its times."""
    charts = figures.draw(outcome)["log"]
    told = json.loads(charts.json)
    k = next(k for k, panel in enumerate(charts.panels) if panel.title.startswith(title))
    panel = told["panels"][k]
    return {s["name"]: unpacked(s["y"]) for s in panel["series"]} | {"t": unpacked(told["x"][panel["x"]])}


def test_every_panel_says_what_it_shows_and_holds_numbers(outcome: Outcome) -> None:
    drawn = figures.draw(outcome)
    assert "log" in drawn and set(drawn) <= set(figures.captions(outcome))
    for charts in drawn.values():
        for panel, told in zip(charts.panels, json.loads(charts.json)["panels"], strict=True):
            assert panel.about.endswith(".") and len(panel.about) > 30 and told["series"]
            for series in told["series"]:
                y = unpacked(series["y"])
                assert y.size == panel.x.size and (np.isfinite(y).any() or panel.title.startswith("Evidence"))


def test_posterior_verdict_and_picture_agree(outcome: Outcome) -> None:
    """In the window of each move the last probability of the picture is that of the verdict's label."""
    lines = lines_of(outcome, "Probability")
    for event in outcome.isolation.events:
        last = np.flatnonzero(lines["t"] <= event.end_s)[-1]
        at_end = {name: y[last] for name, y in lines.items() if name != "t" and "whole move" not in name}
        named = report.NAMES[event.label].lower() + (f" ({event.channel})" if event.channel else "")
        assert max(at_end, key=at_end.get) == named
        assert at_end[named] == pytest.approx(event.posterior[event.label], abs=1e-4) or at_end[named] > 0.95
        afterwards = f"{named}, by the whole move"
        told_late = event.isolated_s is None and event.label != "nominal"
        assert (afterwards in lines) == told_late
        if told_late:
            since = lines["t"] >= event.onset_s
            assert lines[afterwards][since & (lines["t"] <= event.end_s)] == pytest.approx(
                event.probability, abs=1e-4
            )


def test_evidence_speaks_for_the_verdict_when_it_is_isolated(outcome: Outcome) -> None:
    verdict = outcome.isolation.verdict
    if verdict.label == "nominal" or verdict.isolated_s is None:
        return
    lines = lines_of(outcome, "Evidence for")
    at = np.searchsorted(lines["t"], verdict.isolated_s)
    rivals = {name: y[at] for name, y in lines.items() if name != "t"}
    assert len(rivals) == len(outcome.modes) - 1
    assert min(rivals.values()) > 0.0 and rivals["against no fault"] > 1.0


def test_the_channel_that_told_stands_out(overload: Outcome) -> None:
    """An obstacle half way shows in the position: the mass stays behind the motor."""
    verdict = overload.isolation.verdict
    lines = lines_of(overload, "Which channel tells overload")
    at = np.searchsorted(lines["t"], verdict.isolated_s)
    told = {name: y[at] for name, y in lines.items() if name != "t"}
    assert max(told, key=told.get) == "position" and told["position"] > 1.0


def test_each_fault_has_a_view_of_single_samples_that_reaches_past_its_isolation(outcome: Outcome) -> None:
    verdict, t = outcome.isolation.verdict, outcome.overview.t
    views = figures.views(outcome.isolation)
    assert len(views) >= 1 and all(view.low < view.high for view in views)
    if verdict.label == "nominal":
        return
    first = views[0]
    known = verdict.end_s if verdict.isolated_s is None else verdict.isolated_s
    assert first.low < verdict.onset_s < known < first.high
    for moment in (verdict.onset_s, known, verdict.end_s):
        near = t[(t >= moment - 0.05) & (t <= moment + 0.05)]
        assert np.diff(near).max() < 1.01 / 1600.0


def test_a_log_with_missing_samples_is_drawn(overload: Outcome) -> None:
    whole = overload.overview
    z, norm = whole.z.copy(), whole.norm.copy()
    z[10:60], norm[10:60] = np.nan, np.nan
    z[:, 0] = np.nan
    holes = replace(overload, overview=replace(whole, z=z, norm=norm, w=np.full(whole.w.size, np.nan)))
    assert not np.isfinite(lines_of(holes, "Current")["measured"][10:60]).any()
    assert set(lines_of(holes, "Speed")) == {"t", "commanded"}
    assert "Voltage" not in {panel.title for panel in figures.draw(holes)["log"].panels}
    against = {name for name in lines_of(holes, "Evidence for overload since the onset")}
    assert not any("voltage sensor" in name for name in against) and any(
        "current sensor" in name for name in against
    )
    json.loads(figures.draw(holes)["log"].json, parse_constant=pytest.fail)  # no NaN


def test_a_verdict_of_a_sensor_without_a_name_is_drawn(overload: Outcome) -> None:
    verdict = overload.isolation.verdict._replace(label="sensor_fault", channel=None, isolated_s=None)
    alike = replace(overload, isolation=replace(overload.isolation, verdict=verdict, events=(verdict,)))
    assert "sensor fault, by the whole move" in lines_of(alike, "Probability")


def test_what_is_said_of_a_verdict_of_the_whole_move_is_what_the_curves_show(overload: Outcome) -> None:
    verdict, whole = overload.isolation.verdict._replace(isolated_s=None), overload.overview
    own, since = overload.modes.index("overload"), (whole.t >= verdict.onset_s) & (whole.t <= verdict.end_s)
    shares = {
        "came to hold it for certain": np.ones(whole.t.size),
        "for a time and then let go": np.where(np.cumsum(since) < 50, 1.0, 0.2),
        "no hypothesis of the bank said so": np.full(whole.t.size, 0.2),
    }
    for words, share in shares.items():
        probability = whole.probability.copy()
        probability[since, own] = share[since]
        told = replace(
            overload, isolation=replace(overload.isolation, verdict=verdict),
            overview=replace(whole, probability=probability),
        )  # fmt: skip
        assert [other for other in shares if other in " ".join(report.doubts(told))] == [words]


@pytest.mark.parametrize("kind", ["winding", "friction"])
def test_what_no_hypothesis_of_the_bank_holds_agrees_too(kind: str) -> None:
    test_posterior_verdict_and_picture_agree(diagnosed(kind))


def test_an_outcome_without_a_verdict_is_refused() -> None:
    with pytest.raises(ValueError, match="no verdict"):
        report.report_dict(Outcome("x", None, error="empty"))


def test_doubts_name_the_runner_up_and_a_disagreeing_mixture(overload: Outcome) -> None:
    posterior = {"overload": 0.9, "sensor_fault": 0.07, "unknown": 0.03, "nominal": 0.0}
    close = replace(
        overload.isolation, verdict=overload.isolation.verdict._replace(posterior=posterior, probability=0.9)
    )
    first = report.doubts(replace(overload, isolation=close))[0]
    assert first == "Next best explanation: sensor fault, with 7.0 %."
    clear = overload.isolation.verdict._replace(posterior={"overload": 1.0, "coupling_loss": 1e-9})
    first = report.doubts(replace(overload, isolation=replace(overload.isolation, verdict=clear)))[0]
    assert first.endswith("one part in a million; the next is coupling loss.")
    assert "mixture says" not in " ".join(report.doubts(overload))
    other = overload.open_loop.verdict._replace(label="nominal")
    disagreeing = replace(overload, open_loop=replace(overload.open_loop, verdict=other))
    assert "mixture says no fault" in " ".join(report.doubts(disagreeing))


@pytest.mark.parametrize(
    ("p", "text"), [(1.0, "> 99.99 %"), (0.9995, "99.95 %"), (0.8, "80.0 %"), (1e-9, "< 0.01 %")]
)
def test_probabilities_never_round_to_certainty(p: float, text: str) -> None:
    assert report.percent(p) == text


def test_labels_that_are_as_good_stand_in_the_headline(overload: Outcome) -> None:
    verdict = overload.isolation.verdict._replace(alike=("slip",), probability=0.6)
    told = replace(overload, isolation=replace(overload.isolation, verdict=verdict, events=(verdict,)))
    assert report.headline(told).startswith("overload, or slip since ")
    assert "<h1>Overload, or slip since " in report.page(told, load_rig())
    health = verdict._replace(label="nominal", onset_s=None, onset_interval_s=(None, None), probability=0.5)
    text = explanation(replace(told.isolation, verdict=health, events=(health,)), load_rig(), told.log)
    assert "what may be a fault: slip" in text and "no action" not in text
