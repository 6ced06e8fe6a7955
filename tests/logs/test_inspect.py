"""What inspect makes of loggers of every style: the map it proposes reads the log that was written, or says what is open."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from hypothesis import given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from scenarios import healthy_move
from scipy.io import savemat

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import columns_from_table
from observer_fi.logs.ingest import read_log
from observer_fi.logs.inspection.inspection import Inspection, inspect_log
from observer_fi.logs.inspection.motion import motions, moving
from observer_fi.logs.inspection.text_table import text_table
from observer_fi.logs.inspection.vocabulary import understood, unit_of
from observer_fi.physics.rigs import load_rig
from observer_fi.report.inspection import inspection_json, inspection_text

TABLE = healthy_move()
T, V, I, X, PITCH, W = (TABLE[:, k] for k in range(6))
RPM = 30.0 / np.pi
RIG = load_rig()


class Style(NamedTuple):
    """One logger: its headers, the columns it writes, how it writes them, and lines before the first row."""

    headers: tuple[str, ...]
    columns: tuple[np.ndarray, ...]
    separator: str = ","
    comma: bool = False
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    end: str = ""
    digits: str = "{:.7g}"


STYLES = {
    "german": Style(("Zeit [ms]", "Spannung [V]", "Strom [mA]", "Weg [µm]", "Solldrehzahl [1/min]"),
                    (T * 1e3, V, I * 1e3, X * 1e6, W * RPM), ";", True),
    "french": Style(("Temps (s)", "Tension moteur (V)", "Courant moteur (A)", "Déplacement (mm)", "Vitesse consigne (tr/min)"),
                    (T, V, I, X * 1e3, W * RPM), ";", True, ("Banc n° 4", "Opérateur: X")),
    "italian": Style(("Tempo [ms]", "Tensione [mV]", "Corrente [mA]", "Posizione [mm]", "Inclinazione [°]"),
                     (T * 1e3, V * 1e3, I * 1e3, X * 1e3, PITCH), "\t"),
    "spanish": Style(("tiempo_s", "voltaje_V", "corriente_mA", "posicion_mm"), (T, V, I * 1e3, X * 1e3)),
    "english, slashes": Style(("Time / us", "U / V", "I / A", "s / um", "n_ref / rpm"), (T * 1e6, V, I, X * 1e6, W * RPM), "|"),
    "units row": Style(("t", "U_mot", "I_mot", "pos", "omega_soll"), (T * 1e3, V, I * 1e3, X * 1e3, W), ";", False,
                       ("Logger 3.1", ""), ("ms;V;mA;mm;rad/s",)),
    "units row in brackets": Style(("Time", "Voltage", "Current", "Position"), (T, V, I, X * 1e3), ",", False, (),
                                   ("[s],[V],[A],[mm]",)),
    "camel case": Style(("timestampMs", "motorVoltage_mV", "motorCurrent_mA", "actualPosition_um", "commandedSpeed_rad_s"),
                        (T * 1e3, V * 1e3, I * 1e3, X * 1e6, W)),
    "more than is needed": Style(("Index", "Zeit [s]", "Temperatur [°C]", "U [V]", "I [A]", "Istposition [mm]", "Status"),
                                 (np.arange(T.size), T, 20.0 + T, V, I, X * 1e3, np.ones(T.size)), ";", True),
    "rows that end with a separator": Style(("t_ms", "u_V", "i_mA", "x_mm"), (T * 1e3, V, I * 1e3, X * 1e3), ";", end=";"),
    "a comment as header": Style(("# time [s]", "voltage [V]", "current [A]", "position [mm]"), (T, V, I, X * 1e3), ","),
    "blanks": Style(("t_s", "u_V", "i_A", "x_mm"), (T, V, I, X * 1e3), " "),
    "inches and kilovolts": Style(("Time [s]", "Voltage [kV]", "Current [A]", "Position [in]"), (T, V / 1e3, I, X / 0.0254),
                                  ",", digits="{:.9g}"),
    "an unnamed load": Style(("t [s]", "U [V]", "I [A]", "x [mm]", "Last [kN]"), (T, V, I, X * 1e3, 0.01 + T / 1e3), ";"),
    "encoder": Style(("t [s]", "U [V]", "I [A]", "x [mm]", "phi [rad]"), (T, V, I, X * 1e3, X / 1.9e-6), ","),
}  # fmt: skip


def write(style: Style, path: Path) -> Path:
    rows = [
        style.separator.join(style.digits.format(v) for v in row)
        for row in np.column_stack(style.columns).tolist()
    ]
    if style.comma:
        rows = [row.replace(".", ",") for row in rows]
    head = [*style.before, style.separator.join(style.headers), *style.after]
    path.write_text("\n".join([*head, *(row + style.end for row in rows)]) + "\n", encoding="utf-8")
    return path


def read_with(found: Inspection) -> Any:
    return read_log(found.contents.path, columns_from_table(tomllib.loads(found.column_map)))


def _has_command(name: str) -> bool:
    words = ("soll", "onsigne", "ref", "command")
    return any(word in header.lower() for header in STYLES[name].headers for word in words)


@pytest.mark.parametrize("name", STYLES)
def test_the_map_of_a_logger_reads_what_was_logged(name: str, tmp_path: Path) -> None:
    found = inspect_log(str(write(STYLES[name], tmp_path / "log.csv")))
    assert not found.refused, found.refused
    log = read_with(found)
    assert np.allclose(log.t, T, atol=1e-6) and np.allclose(log.z[:, 0], V, atol=2e-4)
    assert np.allclose(log.z[:, 1], I, atol=1e-6) and np.allclose(log.z[:, 2], X, atol=2e-9, rtol=1e-6)
    if _has_command(name):
        assert np.allclose(log.w_cmd, W, rtol=1e-5, atol=1e-3)
        assert found.commanded and found.guesses["speed_cmd_rad_s"].sure == "sure"
    else:
        assert "speed_cmd_rad_s" not in found.guesses
    assert {g.sure for g in found.guesses.values()} <= {"sure", "likely"}, found.guesses
    assert found.clock is not None and found.clock.rate_hz == pytest.approx(1600.0, rel=1e-4)
    assert len(found.moves) == 1 and found.moves[0].start_s == pytest.approx(0.2, abs=0.03)
    assert next(need for need in found.needs if need.drive == "pi_servo").missing == ()


def test_a_load_and_an_encoder_come_through(tmp_path: Path) -> None:
    loaded = read_with(inspect_log(str(write(STYLES["an unnamed load"], tmp_path / "load.csv"))))
    assert loaded.load is not None and np.allclose(loaded.load, 10.0 + T, rtol=1e-5)
    turned = read_with(inspect_log(str(write(STYLES["encoder"], tmp_path / "phi.csv"))))
    assert turned.encoder is not None and np.allclose(turned.encoder, X / 1.9e-6, rtol=1e-5, atol=1e-3)


def test_the_map_that_is_written_diagnoses_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from observer_fi.cli import main

    path = write(STYLES["german"], tmp_path / "run 7.csv")
    out = str(tmp_path / "out")
    assert main(["inspect", str(path), "--write", "--out", out]) == 0
    column_map = tmp_path / "out" / "run 7" / "columns.toml"
    assert f"written: {column_map}" in capsys.readouterr().out
    assert main(["diagnose", str(path), "--columns", str(column_map), "--out", out, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"]["label"] == "nominal"
    assert (tmp_path / "out" / "run 7" / "report.json").exists() and column_map.exists()


def test_a_map_that_somebody_changed_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from observer_fi.cli import main

    path, out = write(STYLES["german"], tmp_path / "run.csv"), tmp_path / "out"
    arguments = ["inspect", str(path), "--write", "--out", str(out), "--quiet"]
    assert main(arguments) == 0 and main(arguments) == 0
    assert sorted(f.name for f in out.iterdir()) == ["run"]
    mine = out / "run" / "columns.toml"
    mine.write_text("# mine\n")
    assert main(arguments) == 0
    assert mine.read_text() == "# mine\n" and (out / "run_2" / "columns.toml").exists()
    assert "the name run is taken" in capsys.readouterr().err


# --- other formats -------------------------------------------------------------------------------

FOREIGN = {"Zeit_ms": T * 1e3, "Spannung_V": V, "Strom_mA": I * 1e3, "Weg_mm": X * 1e3}


def _mdf(path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.arange(9.0), np.arange(9.0), name="oil", unit="degC")])
        units = {"U": ("V", V), "I": ("mA", I * 1e3), "Position": ("mm", X * 1e3)}
        file.append([Signal(v, T, name=n, unit=u) for n, (u, v) in units.items()])
        file.save(path, overwrite=True)


def _tdms(path: Path) -> None:
    clock = {"wf_increment": 1.0 / 1600.0, "wf_start_offset": 0.0}
    units = {"U": ("V", V), "I": ("mA", I * 1e3), "Position": ("mm", X * 1e3)}
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [ChannelObject("g", n, v, {**clock, "unit_string": u}) for n, (u, v) in units.items()]
        )


FORMATS: dict[str, Callable[[Path], None]] = {
    "log.parquet": lambda path: pq.write_table(pa.table(FOREIGN), path),
    "log.mat": lambda path: savemat(path, {"run": FOREIGN, "Rm": 20.2}),
    "log.mf4": _mdf,
    "log.tdms": _tdms,
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_has_a_map(name: str, tmp_path: Path) -> None:
    FORMATS[name](tmp_path / name)
    found = inspect_log(str(tmp_path / name))
    assert (
        not found.refused
        and found.clock is not None
        and found.clock.rate_hz == pytest.approx(1600.0, rel=1e-4)
    )
    log = read_with(found)
    assert np.allclose(log.t, T, atol=1e-9) and np.allclose(log.z, TABLE[:, 1:4], atol=1e-12)


@pytest.mark.parametrize("stamp", ["%Y-%m-%dT%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S,%f", "%H:%M:%S.%f"])
def test_time_stamps_have_a_map(stamp: str, tmp_path: Path) -> None:
    begin = np.datetime64("2026-03-02T08:00:00", "us")
    stamps = [(begin + np.timedelta64(round(1e6 * t), "us")).item().strftime(stamp) for t in T]
    rows = [
        ";".join((s, f"{v:.4f}", f"{i:.6f}", f"{1e3 * x:.6f}"))
        for s, v, i, x in zip(stamps, V, I, X, strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text("Zeitstempel;U [V];I [A];Weg [mm]\n" + "\n".join(rows) + "\n")
    found = inspect_log(str(path))
    assert (
        found.guesses["time_s"].unit == "datetime"
        and found.clock is not None
        and "8:00:00" in found.clock.start
    )
    assert np.allclose(read_with(found).t, T - T[0], atol=1e-6)


def test_a_date_and_a_time_of_day_are_one_clock(tmp_path: Path) -> None:
    stamps = [
        (np.datetime64("2026-03-02T08:00:00", "us") + np.timedelta64(round(1e6 * t), "us")).item() for t in T
    ]
    rows = [
        f"{s:%d.%m.%Y};{s:%H:%M:%S.%f};{v:.4f};{i:.6f};{1e3 * x:.6f}"
        for s, v, i, x in zip(stamps, V, I, X, strict=True)
    ]
    path = tmp_path / "log.csv"
    path.write_text("Datum;Uhrzeit;U [V];I [A];Weg [mm]\n" + "\n".join(rows) + "\n")
    found = inspect_log(str(path))
    assert (found.guesses["time_s"].header, found.guesses["time_s"].time_of_day) == ("Datum", "Uhrzeit")
    assert found.clock is not None and found.clock.rate_hz == pytest.approx(1.0 / (T[1] - T[0]), rel=1e-3)
    assert found.clock.start == "02.03.2026 08:00:00.000000"
    assert np.allclose(read_with(found).t, T - T[0], atol=1e-6)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
def test_an_epoch_is_told(unit: str, factor: float, tmp_path: Path) -> None:
    style = Style(
        ("timestamp", "U [V]", "I [A]", "x [mm]"), ((1.77e9 + T) * factor, V, I, X * 1e3), digits="{:.17g}"
    )
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert (
        found.guesses["time_s"].unit == f"epoch {unit}"
        and found.clock is not None
        and "2026-02" in found.clock.start
    )
    assert np.allclose(read_with(found).t, T - T[0], atol=2e-6)


# --- what the header does not say ----------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_the_unit_of_a_clock_follows_from_rates_that_loggers_have(
    unit: str, factor: float, tmp_path: Path
) -> None:
    style = Style(("t", "U [V]", "I [A]", "x [mm]"), (T * factor, V, I, X * 1e3), digits="{:.12g}")
    assert inspect_log(str(write(style, tmp_path / "log.csv"))).guesses["time_s"].unit == unit


def test_a_unit_that_is_too_large_to_be_true_is_a_doubt(tmp_path: Path) -> None:
    style = Style(("time_s", "voltage_v", "current_a", "position_m"), (T, V, I * 1e3, X * 1e3))
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert [doubt.split(" ")[0] for doubt in found.doubts if "really in" in doubt] == [
        "current_a",
        "position_m",
    ]
    right = Style(style.headers, (T, V, I, X))
    assert inspect_log(str(write(right, tmp_path / "right.csv"))).doubts == ()


def test_noise_that_no_sensor_has_says_the_unit_of_a_position(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal(T.size)
    for scale, units in ((1e-2, {"mm"}), (1e-5, {"m", "mm"})):
        style = Style(("t [s]", "I [A]", "x"), (T, I, np.interp(T, [0.2, 0.7], [0.0, 0.8]) + scale * noise))
        guess = inspect_log(str(write(style, tmp_path / "log.csv"))).guesses["position_m"]
        assert {guess.unit, *(text.removeprefix("or ") for text in guess.also)} == units


def test_a_clock_of_two_possible_units_says_both(tmp_path: Path) -> None:
    style = Style(("t", "U [V]", "I [A]", "x [mm]"), (np.arange(T.size) * 0.04, V, I, X * 1e3))
    guess = inspect_log(str(write(style, tmp_path / "log.csv"))).guesses["time_s"]
    assert {guess.unit, *(text.split()[1] for text in guess.also)} == {"s", "ms"}


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("mm", 1e3), ("um", 1e6)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_with_a_rig_the_motor_says_unit_and_sign_of_the_position(
    unit: str, factor: float, sign: float, tmp_path: Path
) -> None:
    style = Style(("t", "u", "i", "x", "soll"), (T, V, I, sign * factor * X, W * RPM), digits="{:.9g}")
    found = inspect_log(str(write(style, tmp_path / "log.csv")), None, RIG)
    assert (found.guesses["position_m"].unit, found.guesses["position_m"].factor) == (unit, sign)
    assert found.guesses["speed_cmd_rad_s"].unit == "rpm"
    log = read_with(found)
    assert np.allclose(log.z[:, 2], X, atol=1e-9) and np.allclose(log.w_cmd, W, atol=1e-3)


@pytest.mark.parametrize(("unit", "factor"), [("A", 1.0), ("mA", 1e3)])
def test_the_winding_says_the_unit_of_the_current(unit: str, factor: float, tmp_path: Path) -> None:
    style = Style(("t", "U [V]", "i", "x [mm]"), (T, V, I * factor, X * 1e3))
    assert inspect_log(str(write(style, tmp_path / "log.csv"))).guesses["current_a"].unit == unit


def test_a_unit_in_the_header_that_the_rig_contradicts_is_a_doubt_and_stays(tmp_path: Path) -> None:
    style = Style(("t [s]", "U [V]", "I [A]", "x [m]"), (T, V, I, X * 1e3))
    found = inspect_log(str(write(style, tmp_path / "log.csv")), None, RIG)
    assert found.guesses["position_m"].unit == "m"
    assert any("position_m is 1" in doubt and "is its unit mm?" in doubt for doubt in found.doubts), (
        found.doubts
    )


def test_columns_without_names_are_told_by_the_motor(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    rows = ["\t".join(f"{v:.9g}" for v in row) for row in np.column_stack((T, PITCH, X * 1e3, I, V)).tolist()]
    path.write_text("\n".join(rows) + "\n")
    found = inspect_log(str(path))
    assert found.contents.table is not None and found.contents.table.header_line == 0
    assert {c: g.header for c, g in found.guesses.items()} == {
        "time_s": "1", "position_m": "3", "current_a": "4", "voltage_v": "5",
    }  # fmt: skip
    assert {g.sure for c, g in found.guesses.items() if c != "time_s"} == {"a guess"}
    assert np.array_equal(read_with(found).z[:, 0], np.array([float(row.split("\t")[4]) for row in rows]))


@pytest.mark.parametrize("turned", ["voltage_v", "current_a", "position_m", "speed_cmd_rad_s"])
def test_a_sign_that_is_the_other_way_round_is_turned_back(turned: str, tmp_path: Path) -> None:
    columns = {"voltage_v": V, "current_a": I, "position_m": X * 1e3, "speed_cmd_rad_s": W}
    columns[turned] = -columns[turned]
    style = Style(
        ("t [s]", "U [V]", "I [A]", "x [mm]", "n_soll [rad/s]"), (T, *columns.values()), digits="{:.9g}"
    )
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert {c: g.factor for c, g in found.guesses.items() if g.factor != 1.0} == {turned: -1.0}
    assert np.allclose(read_with(found).z, TABLE[:, 1:4], atol=1e-6)


def test_signs_without_a_voltage(tmp_path: Path) -> None:
    style = Style(("t [s]", "I [A]", "x [mm]", "n_soll [rad/s]"), (T, I, -X * 1e3, W))
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert found.guesses["position_m"].factor == -1.0


@pytest.mark.parametrize(("unit", "factor"), [("rad", 1.0), ("deg", 180.0 / np.pi), ("rev", 0.5 / np.pi)])
@pytest.mark.parametrize("rig", [None, RIG], ids=["alone", "rig"])
def test_the_unit_of_an_encoder(unit: str, factor: float, rig: Any, tmp_path: Path) -> None:
    angle = np.cumsum(W) / 1600.0 * factor
    style = Style(
        ("t [s]", "U [V]", "I [A]", "x [mm]", "encoder", "n_soll [rad/s]"), (T, V, I, X * 1e3, angle, W)
    )
    assert inspect_log(str(write(style, tmp_path / "log.csv")), None, rig).guesses["encoder_rad"].unit == unit


def test_days_of_a_spreadsheet_are_a_clock(tmp_path: Path) -> None:
    style = Style(
        ("Date", "U [V]", "I [A]", "x [mm]"), (46_000.25 + T * 10 / 86_400.0, V, I, X * 1e3), digits="{:.17g}"
    )
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert found.clock is not None and found.clock.rate_hz == pytest.approx(160.0, rel=1e-3)
    assert np.allclose(np.diff(read_with(found).t), 10 / 1600.0, atol=2e-6)


def test_a_position_and_its_command_are_told_apart(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    goal = np.interp(T, [0.0, 0.2, 0.7, 1.0], [0.0, 0.0, 0.4, 0.4])
    reading = np.interp(T - 0.004, T, goal) + 1e-4 * rng.standard_normal(T.size)
    for first, second in ((goal, reading), (reading, goal)):
        style = Style(("t [s]", "a", "b", "I [A]"), (T, first, second, I))
        found = inspect_log(str(write(style, tmp_path / "log.csv")))
        names = ("a", "b") if first is goal else ("b", "a")
        assert (found.guesses["position_cmd_m"].header, found.guesses["position_m"].header) == names


def test_what_a_map_cannot_do_is_said(tmp_path: Path) -> None:
    goal = 1e3 * np.interp(T, [0.0, 0.2, 0.7, 1.0], [0.0, 0.0, 0.4, 0.1])
    style = Style(
        ("sample", "set_point", "position_error", "current", "load"),
        (np.arange(T.size), goal, goal * 0.01, np.abs(I), 0 * T + 20),
    )
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    said = " ".join(found.doubts)
    assert "'set_point' less 'position_error'" in said and "no column is a clock (sample only count" in said
    assert "current_a is never negative" in said and "or kg, then factor 9.81" in found.guesses["load_n"].also
    assert all(need.missing for need in found.needs) and found.moves == ()


def test_spaces_within_numbers_are_plain(tmp_path: Path) -> None:
    """Those of powers of ten are none that a terminal breaks lines at, and were shown as \\xa0."""
    style = Style(("t [us]", "U [V]", "I [A]", "x [mm]"), (T * 1e6 + 1e9, V, I, X * 1e3))
    said = inspection_text(inspect_log(str(write(style, tmp_path / "log.csv"))))
    assert " × 10" in said and "\\x" not in said


def test_a_measured_speed_is_no_command(tmp_path: Path) -> None:
    noisy = W + np.random.default_rng(1).standard_normal(T.size)
    style = Style(("t [s]", "I [A]", "x [mm]", "n [1/min]"), (T, I, X * 1e3, noisy))
    found = inspect_log(str(write(style, tmp_path / "log.csv")))
    assert "speed_cmd_rad_s" not in found.guesses and "a measured speed" in inspection_text(found)


# --- words and layouts ---------------------------------------------------------------------------

HEADERS = {
    "Motorstrom in A": ("current", "A"), "I_mot (mA)": ("current", "mA"), "Weg/mm": ("position", "mm"),
    "course [mm]": ("position", "mm"), "corsa mm": ("position", "mm"), "Klemmenspannung [V]": ("voltage", "V"),
    "Nick­winkel [°]": ("pitch", "deg"), "φ [rad]": ("angle", "rad"), "Ist-Drehzahl (min⁻¹)": ("speed", "rpm"),
    "position.um": ("position", "um"), "t_us": ("time", "us"), "Kraft_kN": ("force", "kN"), "courant(A)": ("current", "A"),
    "UM": ("voltage", ""), "current_position_mm": ("position", "mm"), "load current": ("current", ""),
    "Motor position [rad]": ("position", "rad"),
    "velocidad_rad_s": ("speed", "rad/s"), "zeit": ("time", ""), "Temps,ms": ("time", "ms"),
}  # fmt: skip


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_says_its_quantity_and_its_unit(header: str) -> None:
    found = understood(header.replace("\u00ad", ""))
    assert HEADERS[header] == (
        max(found.quantities, key=lambda q: found.quantities[q]),
        found.unit.unit if found.unit else "",
    )


def test_words_that_only_look_alike_say_nothing() -> None:
    for header in ("CH1", "AI0", "lista", "existing", "foo_baz", ""):
        assert not understood(header).quantities and understood(header).unit is None
    for header in ("Supply voltage [V]", "U_bus", "Versorgungsspannung", "V_bat", "Acceleration [m/s]"):
        assert not {"voltage", "speed"} & set(understood(header).quantities)
    assert understood("Sollposition").commanded and not understood("Istposition").commanded
    assert (
        unit_of("S") is None and unit_of("x") is None and unit_of("[mm]") == unit_of("(mm)") == unit_of("mm")
    )


def test_a_layout_is_found_without_help() -> None:
    lines = [
        "Report of 3.4.2026",
        "a;b;c",
        "",
        "Name;Wert",
        "t;U;I",
        "s;V;mA",
        "0,1;2,5;3",
        "0,2;2,6;4",
        "0,3;2,7;5",
        "0,4;2,8;",
    ]
    found = text_table(lines)
    assert found is not None
    assert (found.separator, found.decimal, found.header_line, found.data_line) == (";", ",", 5, 7)
    assert found.units == ["s", "V", "mA"]


# --- files that are none, and any file -----------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.csv", b""), ("a.csv", b"hello\nworld\n"), ("a.csv", b"\x00\x01\x02" * 400), ("a.xlsx", b"PK\x03\x04"),
        ("a.mat", b"MATLAB"), ("a.mf4", b"MDF     4.10"), ("a.parquet", b"PAR1xxxx"), ("a.tdms", b"TDSm"),
        ("a.lvm", b"LabVIEW"), ("a.csv.gz", b"\x1f\x8bxx"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_one_line_and_exit_code_2(
    name: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from observer_fi.cli import main

    path = tmp_path / name
    path.write_bytes(content)
    assert main(["inspect", str(path), "--write", "--out", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith(f"observer-fi: {path}: ") and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_bad_file_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from observer_fi.cli import main

    good, bad = write(STYLES["german"], tmp_path / "good.csv"), tmp_path / "bad.csv"
    bad.write_text("nothing")
    assert main(["inspect", str(bad), str(good), "--json"]) == 2
    first, second = json.loads(capsys.readouterr().out)
    assert "error" in first and second["drives"]["pi_servo"]["missing"] == []
    assert second["schema"] == "observer-fi/inspect/1" and second["columns"][2]["guess"]["unit"] == "mA"


FIELDS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(str),
    st.integers(-(10**20), 10**20).map(str),
    st.sampled_from(
        [
            "",
            "nan",
            "2026-01-02T03:04:05",
            "12:00",
            "1,5",
            "RUN",
            '"',
            "#",
            "-",
            "1e999",
            "µ",
            "Zeit [ms]",
            "0x1",
        ]
    ),
    st.text(max_size=6),
)
TEXTS = st.builds(
    lambda separator, rows, end: end.join(separator.join(row) for row in rows),
    st.sampled_from([",", ";", "\t", "|", " "]),
    st.lists(st.lists(FIELDS, min_size=1, max_size=6), max_size=40),
    st.sampled_from(["\n", "\r\n", "\r"]),
)
HEADS = st.lists(
    st.sampled_from(
        ["t", "Zeit [ms]", "U [V]", "i", "x", "pos_um", "n_soll", "Last", "a", "Datum", "", "time_s"]
    ),
    min_size=2,
    max_size=6,
)
TABLES = st.builds(
    lambda head, rows: "\n".join(
        [";".join(head), *(";".join(f"{v:.6g}" for v in row[: len(head)]) for row in rows)]
    ),
    HEADS,
    st.lists(st.lists(st.floats(-1e20, 1e20), min_size=6, max_size=6), min_size=1, max_size=60),
)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(text=st.one_of(TEXTS, TABLES))
def test_no_table_makes_inspect_fail(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "random.csv"
    path.write_bytes(text.encode("utf-8", "replace"))
    try:
        found = inspect_log(str(path), None, RIG)
    except InvalidLogError as error:
        assert "\n" not in str(error)
        return
    columns_from_table(tomllib.loads(found.column_map))
    assert all(line.isprintable() for line in inspection_text(found).split("\n"))
    assert json.dumps(inspection_json(found), default=str)


# --- motion --------------------------------------------------------------------------------------


def test_moves_are_found_in_a_position_alone() -> None:
    t = np.arange(0.0, 6.0, 1e-3)
    x = np.interp(t, [0.0, 1.0, 2.0, 3.0, 4.0, 6.0], [0.0, 0.0, 0.1, 0.1, 0.0, 0.0])
    x = x + 2e-5 * np.random.default_rng(0).standard_normal(t.size)
    for reading in (x, np.round(x / 1e-4) * 1e-4, np.where(np.arange(t.size) % 50, x, np.nan)):
        found = motions(t, reading, moving(t, reading))
        assert len(found) == 2
        assert [m.start_s for m in found] == pytest.approx([1.0, 3.0], abs=0.05)
        assert [m.travel for m in found] == pytest.approx([0.1, -0.1], abs=5e-3)
    rest = 1e-5 * np.random.default_rng(0).standard_normal(t.size)
    assert motions(t, rest, moving(t, rest)) == () and not moving(t, np.zeros(t.size)).any()
