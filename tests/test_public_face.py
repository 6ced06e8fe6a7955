"""What `import observer_fi` offers: nothing at once, everything when asked, and results that show themselves."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from trend_logs import cycle_frame

import observer_fi
from observer_fi import (
    CAUSES,
    FAULTS,
    Diagnosis,
    InvalidLogError,
    Log,
    Move,
    Scenario,
    UsageError,
    compare,
    diagnose,
    identify,
    inspect,
    load_columns,
    load_rig,
    log_from_frame,
    plan,
    read_log,
    simulate,
    trend,
    write_report,
)
from observer_fi.logs import columns_of

DATA = Path(__file__).parents[1] / "data"
HEAVY = ("numpy", "pandas", "numba", "scipy", "matplotlib")


def frame_of(log: Log, command: bool = True) -> pd.DataFrame:
    columns = {
        "time_s": log.t, "voltage_v": log.z[:, 0], "current_a": log.z[:, 1], "position_m": log.z[:, 2],
        "pitch_deg": log.pitch,
    }  # fmt: skip
    return pd.DataFrame(columns | ({"speed_cmd_rad_s": log.w_cmd} if command else {}))


def python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_nothing_heavy_is_imported_before_it_is_asked_for() -> None:
    loaded = python(f"import sys, observer_fi; print([m for m in {HEAVY} if m in sys.modules])")
    assert loaded.strip() == "[]"


@pytest.mark.slow
def test_a_diagnosis_with_its_page_imports_only_what_it_needs(tmp_path: Path) -> None:
    log = DATA / "overload_steady.csv.gz"
    words = ["diagnose", str(log), "--quiet", "--out", str(tmp_path)]
    slow = ("pandas", "matplotlib", "scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate")
    run = f"import sys; from observer_fi.cli import main; main({words!r})"
    assert python(f"{run}; print([m for m in {slow} if m in sys.modules])").strip() == "[]"


@pytest.mark.slow
def test_a_log_that_is_added_to_a_life_imports_only_what_it_needs(tmp_path: Path) -> None:
    words = ["trend", str(DATA / "false_alarm_steady.csv.gz"), "--quiet", "--out", str(tmp_path)]
    slow = ("pandas", "matplotlib", "scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate")
    run = f"import sys; from observer_fi.cli import main; main({words!r})"
    later = (*slow, "observer_fi.learn")  # what it told is kept
    assert python(f"{run}; print([m for m in {slow} if m in sys.modules])").strip() == "[]"
    assert python(f"{run}; print([m for m in {later} if m in sys.modules])").strip() == "[]"


def test_the_start_takes_less_than_a_tenth_of_a_second_of_work() -> None:
    code = (
        "import time; before = time.process_time(); import observer_fi; print(time.process_time() - before)"
    )
    assert min(float(python(code)) for _ in range(3)) < 0.1


@pytest.mark.parametrize("name", observer_fi.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(observer_fi, name) is not None
    assert name in dir(observer_fi)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        observer_fi.diagnos  # noqa: B018


@pytest.mark.slow
def test_the_room_does_not_take_the_place_of_the_function() -> None:
    code = "import observer_fi.improve.improvement, observer_fi; print(type(observer_fi.improve).__name__)"
    assert python(code).strip() == "function"


@pytest.mark.slow
@pytest.mark.parametrize("label", ["overload", "coupling_loss"])
@pytest.mark.first(1)
def test_path_frame_and_log_give_one_verdict_with_or_without_the_command(label: str) -> None:
    path = DATA / f"{label}_steady.csv.gz"
    log = read_log(path)
    results = [
        diagnose(given) for given in (path, str(path), log, frame_of(log), frame_of(log, command=False))
    ]
    assert [result.verdict.label for result in results] == [label] * 5
    assert results[3].verdict == results[2].verdict


FIVE_LINES = """
from observer_fi import diagnose
found = diagnose(frame, rig="mass_shifter")
print(found)
figure = found.plot()
figure.savefig("verdict.png")
"""


@cache
def found() -> Diagnosis:
    return diagnose(DATA / "overload_steady.csv.gz")


@pytest.mark.slow
def test_five_lines_from_a_frame_to_a_verdict_and_a_plot(tmp_path: Path) -> None:
    log = DATA / "overload_steady.csv.gz"
    before = f"import os, sys, pandas; frame = pandas.read_csv({str(log)!r}, comment='#'); os.chdir({str(tmp_path)!r})"
    early = "import observer_fi; observer_fi.diagnose; assert 'matplotlib' not in sys.modules"
    said = python("\n".join([before, early, FIVE_LINES, "assert 'matplotlib.pyplot' not in sys.modules"]))
    assert said.startswith("overload since 1.600 s, probability > 99.99 %\n")
    assert all(len(line) <= 100 for line in said.splitlines())
    assert (tmp_path / "verdict.png").read_bytes().startswith(b"\x89PNG")


def test_the_readme_shows_these_five_lines() -> None:
    readme = (DATA.parent / "README.md").read_text(encoding="utf-8")
    shown = [line.split("  #")[0] for line in readme.splitlines()]
    assert all(line in shown for line in FIVE_LINES.split("\n"))


def test_a_diagnosis_shows_itself() -> None:
    result = found()
    frame = result.to_frame()
    assert frame["p_overload"].max() > 0.99
    assert frame.filter(like="p_").sum(axis=1).to_numpy() == pytest.approx(1.0, abs=1e-9)
    assert result.to_dict()["verdict"]["label"] == "overload"
    assert result.explanation in " ".join(str(result).split())
    assert repr(result) == "<Diagnosis: overload since 1.600 s, probability > 99.99 %>"
    shown = result._repr_html_()
    assert "overload since 1.600 s, probability &gt; 99.99 %" in shown and "<table" in shown
    assert result.posterior["overload"] > 0.99


def test_warnings_stand_above_the_verdict_and_are_escaped() -> None:
    outcome = replace(found().outcome, warnings=("<b> looks like mA",))
    result = Diagnosis(outcome, found().rig)
    assert str(result).startswith("warning: <b> looks like mA\noverload since")
    shown = result._repr_html_()
    assert shown.index("&lt;b&gt; looks like mA") < shown.index("overload since") and "<b> looks" not in shown


def test_a_plot_has_the_signals_the_posterior_and_the_onset() -> None:
    figure = found().plot()
    *signals, posterior = figure.axes
    labels = ["voltage [V]", "current [mA]", "position [mm]", "speed [rad/s]"]
    assert [ax.get_ylabel() for ax in signals[:4]] == labels
    assert "overload" in [line.get_label() for line in posterior.get_lines()]
    upright = [
        line.get_xdata()[0]
        for ax in (*signals, posterior)
        for line in ax.get_lines()
        if len(line.get_xdata()) == 2
    ]
    assert any(x == pytest.approx(found().verdict.onset_s) for x in upright)
    assert figure._repr_png_().startswith(b"\x89PNG")  # what a notebook asks for


FOREIGN = {"time_s": "t", "current_a": {"header": "I [mA]", "unit": "mA"}, "position_m": "x"}


@pytest.mark.parametrize("kind", ["dict", "file", "map"])
@pytest.mark.first(1)
def test_columns_of_a_frame_map_as_those_of_a_file_do(kind: str, tmp_path: Path) -> None:
    log = read_log(DATA / "overload_steady.csv.gz")
    names = {"time_s": "t", "current_a": "I [mA]", "position_m": "x"}
    frame = frame_of(log).rename(columns=names)
    frame["I [mA]"] *= 1e3
    path = tmp_path / "map.toml"
    path.write_text(
        '[columns]\ntime_s = "t"\ncurrent_a = {header = "I [mA]", unit = "mA"}\nposition_m = "x"\n'
    )
    given = {"dict": FOREIGN, "file": path, "map": load_columns(path)}[kind]
    mapped = diagnose(frame, columns=given)
    assert mapped.verdict.label == "overload"
    assert mapped.verdict.onset_s == pytest.approx(found().verdict.onset_s, abs=1e-3)


def test_a_map_can_call_texts_of_a_frame_time_stamps() -> None:
    log = read_log(DATA / "overload_steady.csv.gz")
    frame = frame_of(log)
    stamps = pd.Timestamp("2026-01-31T10:15") + pd.to_timedelta(log.t, unit="s")
    frame["time_s"] = stamps.strftime("%Y-%m-%dT%H:%M:%S.%f")
    read = log_from_frame(frame, column_map=columns_of({"time_s": {"header": "time_s", "unit": "datetime"}}))
    assert read.t == pytest.approx(log.t - log.t[0], abs=2e-6)


GOOD = pd.DataFrame({"time_s": [0.0, 0.1, 0.2], "current_a": 1.0, "position_m": 0.0})
BAD = [
    ((GOOD.drop(columns="time_s"),), "column time_s is missing"),
    ((GOOD.assign(current_a="x"),), "row 1, column current_a: 'x' is not a number"),
    ((GOOD.iloc[:0],), "frame"),
    ((GOOD.iloc[::-1],), "time runs backward"),
    ((pd.concat([GOOD, GOOD], axis=1),), "stands 2 times"),
    ((GOOD, None, None, {"curent_a": "I"}), "current_a"),
    ((GOOD, None, None, {"current_a": "I"}), "mapped to header 'I'"),
    ((GOOD, None, None, {"time_s": {"unit": "datetime", "time_of_day": "clock"}}), "pandas.to_datetime"),
    ((GOOD, "mass_shiter"), "mass_shifter"),
    ((3,), "a path, a DataFrame or a Log, not int"),
]


@pytest.mark.parametrize(("given", "said"), BAD, ids=[said for _, said in BAD])
def test_what_is_wrong_with_a_frame_is_one_line(given: tuple[Any, ...], said: str) -> None:
    with pytest.raises((InvalidLogError, UsageError)) as error:
        diagnose(*given)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.slow
def test_identify_takes_what_diagnose_takes() -> None:
    healthy = [DATA / "false_alarm_steady.csv.gz", frame_of(read_log(DATA / "false_alarm_transient.csv.gz"))]
    result = identify(healthy)
    frame = result.to_frame()
    assert (
        len(frame) >= 5 and (frame["low"] <= frame["value"]).all() and (frame["value"] <= frame["high"]).all()
    )
    assert f"{len(frame)} parameters learned" in result.verdict
    assert result.verdict in result._repr_html_() and "Km" in result._repr_html_()
    assert "Km = 21.2" in str(result) and "Cannot be told from these logs:" in str(result)
    assert result.to_dict()["parameters"]["Km"]["unit"] == "N m/A"
    assert result.rig.model["Km"] == pytest.approx(frame.loc["Km", "value"])
    assert list(result.figures()) == ["parameters", "correlation"] and len(result.plot().axes) == 1


@pytest.mark.slow
def test_a_life_of_frames(tmp_path: Path) -> None:
    frames = [cycle_frame(k, 0.9 if k < 12 else 1.4) for k in range(20)]
    result = trend(frames)
    assert "since frame_13" in result.headline and "friction" in result.headline
    table = result.to_frame()
    assert (table["verdict"] == "changed").sum() >= 8 and table["path"].iloc[12] == "frame_13"
    assert result.headline in str(result) and "the first 8 logs" in str(result)
    assert result.headline.split(" (")[0] in unescape(result._repr_html_())
    again = trend([*frames, tmp_path / "none.csv"])
    assert again.headline == result.headline and "none.csv" in again.warnings[0]
    page = write_report(result, tmp_path / "life", figures="png")
    assert page.is_file() and (tmp_path / "life" / "trend.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(UsageError, match="no log could be read"):
        trend([tmp_path / "none.csv"])


def test_a_file_is_inspected(tmp_path: Path) -> None:
    log = tmp_path / "own.csv"
    frame_of(read_log(DATA / "overload_steady.csv.gz")).rename(columns={"current_a": "I [mA]"}).to_csv(
        log, index=False
    )
    found = inspect(log)
    assert "CSV" in found.headline and "column map" in str(found)
    assert list(found.to_frame()["header"])[2] == "I [mA]" and "<pre>" in found._repr_html_()
    written = write_report(found, tmp_path / "own")
    assert written.name == "columns.toml" and "I [mA]" in written.read_text(encoding="utf-8")
    with pytest.raises(ValueError, match="nothing to draw"):
        found.plot()


def test_moves_are_planned(tmp_path: Path) -> None:
    found = plan(constants=["A"], seconds=3.0)
    assert found.headline.startswith("A: ") and "to and fro" in str(found)
    corners = found.to_frame()
    assert corners["time_s"].is_monotonic_increasing and corners["time_s"].iloc[-1] <= 3.0
    assert found.plot().axes[0].get_ylabel() == "speed [rad/s]"
    page = write_report(found, tmp_path / "next", figures="svg")
    assert "These moves" in page.read_text(encoding="utf-8") and (page.parent / "command.svg").is_file()
    assert (page.parent / "moves.csv").read_text(encoding="utf-8") == found.moves
    with pytest.raises(UsageError, match="give one of"):
        plan("backlash", faults="slip")


@pytest.mark.slow
def test_a_comparison(tmp_path: Path) -> None:
    result = compare(3)
    assert "right on 3 logs" in str(result) and "Observer bank" in result._repr_html_()
    assert len(result.to_frame()) == 3 and "bank.verdict" in result.to_frame()
    assert write_report(result, tmp_path / "compare", figures="svg").is_file()
    assert (tmp_path / "compare" / "delays.svg").is_file()
    with pytest.raises(UsageError, match="png, svg, pdf"):
        write_report(result, tmp_path / "compare", figures="gif")


def test_simulate_and_write_report(tmp_path: Path) -> None:
    log, truth = simulate(Scenario((Move(0.3, 410.0, 1.0),), 1.7))
    result = diagnose(log)
    assert result.verdict.label == truth.label == "nominal"
    assert write_report(result, tmp_path / "log").is_file()
    assert (tmp_path / "log" / "report.json").is_file()


def test_tables_and_errors(tmp_path: Path) -> None:
    assert "viscous_friction" in {getattr(cause, "name", cause) for cause in CAUSES}
    assert "overload" in FAULTS
    assert load_rig().name == load_rig("mass_shifter").name
    with pytest.raises(InvalidLogError):
        diagnose(tmp_path / "none.csv")
    with pytest.raises(UsageError):
        diagnose(DATA / "overload_steady.csv.gz", rig=tmp_path / "none.toml")
    assert log_from_frame(frame_of(read_log(DATA / "overload_steady.csv.gz"))).t.size > 1000
