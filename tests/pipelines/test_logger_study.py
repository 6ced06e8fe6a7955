"""The study of loggers: what counts as found and as right, and its recipe on one move."""

from pathlib import Path

import pandas as pd
import pytest
from hidden import TRAITS, Logger
from hidden.acquisition import ideal, true_sizes

from observer_fi.records import Acquisition, ChannelTraits, Clock, Line
from pipelines import logger_study
from pipelines.logger_study_found import found

NO_SPIKES = {"voltage": 0, "current": 0, "position": 0}
PLAIN = Acquisition(*(ChannelTraits(std, std) for std in (10e-3, 0.3e-3, 10e-6)), Clock(0.0, None, 1 / 1600))


def sizes(name: str) -> dict:
    return true_sizes(TRAITS[name].apply(ideal(Logger()), 7), NO_SPIKES)


def changed(channel: str, **fields: object) -> Acquisition:
    return PLAIN._replace(**{channel: getattr(PLAIN, channel)._replace(**fields)})


def test_nothing_is_missed_of_an_ideal_logger() -> None:
    assert found(sizes("ideal"), PLAIN) == ""


@pytest.mark.parametrize(
    ("name", "missed"),
    [
        ("noise_3", "voltage noise; current noise; position noise"),
        ("steps_current", "current resolution"),
        ("position_60hz", "position update rate"),
        ("hum_50hz", "voltage lines; current lines"),
        ("coloured", "voltage colour; current colour; position colour"),
        ("position_averaged", "position noise; position averaging; position colour"),
        ("milliseconds", "clock resolution"),
        ("jitter", "jitter"),
    ],
)
def test_what_is_not_told_is_missed(name: str, missed: str) -> None:
    assert found(sizes(name), PLAIN) == missed


def test_what_is_not_there_is_not_to_be_told() -> None:
    assert found(sizes("ideal"), changed("current", resolution=3e-4)) == "current resolution"
    assert found(sizes("ideal"), changed("position", update_hz=100.0)) == "position update rate"
    assert found(sizes("ideal"), changed("voltage", lines=(Line(50.0, 0.04),))) == "voltage lines"


def test_a_line_counts_with_its_size_and_place() -> None:
    told = sizes("pwm_line")
    ((hz, amplitude),) = told["current_a"]["lines"]
    assert found(told, changed("current", lines=(Line(hz + 0.1, 1.1 * amplitude),))) == ""
    assert found(told, changed("current", lines=(Line(hz + 0.3, amplitude),))) == "current lines"
    assert found(told, changed("current", lines=(Line(hz, 1.2 * amplitude),))) == "current lines"


def test_tables_count_what_was_said() -> None:
    row = {"trait": "noise_3", "label": "nominal", "kind": "", "channel": "", "said": "unknown", "said_channel": "",
           "probability": 0.99, "named": False, "right": False, "delay_ms": None, "missed": "current noise; jitter"}  # fmt: skip
    right = {**row, "label": "overload", "said": "overload", "right": True, "delay_ms": 12.0, "missed": ""}
    table = logger_study.by_trait(pd.DataFrame([row, right])).loc["noise_3"]
    assert (table["moves"], table["right"], table["false alarms"], table["confident and wrong"]) == (
        2,
        1,
        "1 of 1",
        1,
    )
    assert (table["delay median ms"], table["said otherwise"]) == (12.0, "unknown 1")
    assert table["logger found"] == "1 of 2; not: current noise 1, jitter 1"
    failing = {
        **row,
        "label": "sensor_fault",
        "kind": "drift",
        "channel": "position",
        "said": "coupling_loss",
    }
    assert (
        logger_study.by_failure(pd.DataFrame([failing])).iloc[0]["actuator blamed with more than 0.95"] == 1
    )


@pytest.mark.study
@pytest.mark.slow
def test_the_recipe_writes_its_report(tmp_path: Path) -> None:
    given = ["--moves", "2", "--traits", "noise_3", "--failing", "0", "--campaigns", "1", "--combined", "1"]
    given += ["--crossed", "3", "--first", "7000", "--rows", str(tmp_path / "rows.csv")]
    assert logger_study.main([*given, "--out", str(tmp_path / "loggers.md")]) == 0
    assert len(pd.read_csv(tmp_path / "rows.csv")) == 7
    text = (tmp_path / "loggers.md").read_text()
    assert "| noise_3 | noise three times the rig file's | 2 |" in text
    assert "seeds from 7000 on" in text and "1 of 1 right, 0 confident and wrong." in text
    assert "0 of 1 campaigns of 18 moves each are called anything but nominal." in text
    for crossed in logger_study.CROSSED:
        assert f"- {crossed}: 1 of 1 right, 0 confident and wrong." in text


def test_a_campaign_that_is_called_faulty_is_told_with_its_logger() -> None:
    """Loggers take turns, and what was said of each campaign stands in the report."""
    first, second = logger_study.campaign_jobs(2, 7000)
    assert first.trait != second.trait and {first.kind, second.kind} == {logger_study.CAMPAIGN}
    rows = pd.DataFrame([
        {**first._asdict(), "said": "nominal", "probability": 0.9}, {**second._asdict(), "said": "jam", "probability": 1.0}
    ])  # fmt: skip
    text = logger_study.of_campaigns(rows)
    assert text.startswith("1 of 2 campaigns") and text.endswith(f"{second.trait}: jam 1")


def test_loggers_are_drawn_with_several_traits_and_enough_columns() -> None:
    jobs = logger_study.combined_jobs(200, 7000)
    assert jobs == logger_study.combined_jobs(200, 7000) and len({job.trait for job in jobs}) > 180
    for job in jobs:
        parts = job.trait.split("+")
        assert 1 <= len(parts) == len(set(parts)) < 5 and not {"no_voltage", "no_command"} <= set(parts)
        assert all(TRAITS[part].keeps for part in parts)
    assert {len(job.trait.split("+")) for job in jobs} >= {2, 3, 4}


def test_what_was_said_through_drawn_loggers_is_counted() -> None:
    jobs = logger_study.combined_jobs(3, 7000)
    said = [("nominal", 0.99, True), ("jam", 0.99, False), ("no verdict", 0.0, False)]
    rows = [
        {**job._asdict(), "said": label, "probability": p, "right": right}
        for job, (label, p, right) in zip(jobs, said, strict=True)
    ]
    text = logger_study.of_combined(pd.DataFrame(rows))
    assert text.startswith("1 of 3 right, 1 confident and wrong.")
    assert f"{jobs[1].trait} {jobs[1].label} 7001: jam 0.99" in text


def test_days_sizes_and_failing_sensors_are_crossed_with_loggers() -> None:
    jobs = logger_study.crossed_jobs(120, 7000)
    assert jobs == logger_study.crossed_jobs(120, 7000) and all(TRAITS[job.trait].keeps for job in jobs)
    assert [sum(job.crossed == name for job in jobs) for name in logger_study.CROSSED] == [40, 40, 40]
    assert len({job.trait for job in jobs}) > 20 and len({job.kind for job in jobs}) > 20
    assert all(bool(job.channel) == (job.label == "sensor_fault") for job in jobs)
    assert not any(job.trait == "no_voltage" and job.channel == "voltage" for job in jobs)
    rows = [
        {**job._asdict(), "said": "jam", "probability": 0.99, "right": job.label == "jam"} for job in jobs
    ]
    text = logger_study.of_crossed(pd.DataFrame(rows))
    assert text.count("of 40 right") == 3 and "on another day: 0 of 40 right, 40 confident and wrong." in text


def test_every_way_to_fail_gets_its_moves() -> None:
    jobs = logger_study.failing_jobs(2, 3.0, 7000)
    assert len(jobs) == 2 * 3 * 9
    assert {job.trait for job in jobs} == {"ideal"}
