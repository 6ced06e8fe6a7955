"""What `import observer_fi` offers: nothing at once, everything when asked, and results that show themselves."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import observer_fi
from observer_fi import (
    CAUSES,
    FAULTS,
    InvalidLogError,
    Log,
    Move,
    Scenario,
    UsageError,
    diagnose,
    identify,
    load_rig,
    log_from_frame,
    read_log,
    simulate,
    write_report,
)

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


def test_the_room_does_not_take_the_place_of_the_function() -> None:
    code = "import observer_fi.improve.improvement, observer_fi; print(type(observer_fi.improve).__name__)"
    assert python(code).strip() == "function"


@pytest.mark.parametrize("label", ["overload", "coupling_loss"])
def test_path_frame_and_log_give_one_verdict_with_or_without_the_command(label: str) -> None:
    path = DATA / f"{label}_steady.csv.gz"
    log = read_log(path)
    results = [
        diagnose(given) for given in (path, str(path), log, frame_of(log), frame_of(log, command=False))
    ]
    assert [result.verdict.label for result in results] == [label] * 5
    assert results[3].verdict == results[2].verdict


def test_a_diagnosis_shows_itself() -> None:
    result = diagnose(DATA / "overload_steady.csv.gz")
    frame = result.to_frame()
    mode = [name for name in frame if name.startswith("p_overload")]
    assert frame[mode].sum(axis=1).iloc[-1] > 0.99 or frame[mode].to_numpy().max() > 0.99
    assert frame.filter(like="p_").sum(axis=1).to_numpy() == pytest.approx(1.0, abs=1e-9)
    assert "Overload" in result._repr_html_() or "overload" in result._repr_html_()
    assert result.to_dict()["verdict"]["label"] == "overload"


def test_a_plot_has_the_signals_the_posterior_and_the_onset() -> None:
    result = diagnose(DATA / "overload_steady.csv.gz")
    *signals, posterior = result.plot().axes
    labels = ["voltage [V]", "current [mA]", "position [mm]", "speed [rad/s]"]
    assert [ax.get_ylabel() for ax in signals] == labels
    assert len(posterior.get_lines()) >= len(result.outcome.modes)
    upright = [
        line.get_xdata()[0]
        for ax in (*signals, posterior)
        for line in ax.get_lines()
        if len(line.get_xdata()) == 2
    ]
    assert any(x == pytest.approx(result.verdict.onset_s) for x in upright)


def test_identify_takes_what_diagnose_takes() -> None:
    healthy = [DATA / "false_alarm_steady.csv.gz", frame_of(read_log(DATA / "false_alarm_transient.csv.gz"))]
    result = identify(healthy)
    frame = result.to_frame()
    assert (
        len(frame) >= 5 and (frame["low"] <= frame["value"]).all() and (frame["value"] <= frame["high"]).all()
    )
    assert f"{len(frame)} parameters learned" in result.verdict
    assert result.verdict in result._repr_html_() and "Km" in result._repr_html_()
    assert result.rig.model["Km"] == pytest.approx(frame.loc["Km", "value"])
    assert len(result.plot().axes) == 1


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
