"""Small logs with known answers: every reader, and the whole pipeline, runs on all of them.

`python tests/scenarios.py data/columns` writes the examples of foreign layouts anew.
"""

import gzip
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = ("time_s", "voltage_v", "current_a", "position_m", "pitch_deg", "speed_cmd_rad_s")
DIGITS = (6, 4, 6, 8, 3, 6)
RATE_HZ = 1600
START_S, STOP_S, END_S, SPEED = 0.2, 0.7, 1.0, 410.0
MAPS = Path(__file__).parent.parent / "data" / "columns"

Rows = list[list[str]]


@dataclass(frozen=True)
class Scenario:
    """A log and what has to come of it.

    write: puts the file into a folder, returns its path. error: what the one line of the refusal says, ""
    where the log can be used. rejected: how many values are listed. notes: what the notes say. columns: the
    TOML of a column map. label: the verdict, None where more than one is right.
    """

    name: str
    write: Callable[[Path], Path]
    error: str = ""
    rejected: int = 0
    notes: tuple[str, ...] = ()
    gaps: int = 0
    columns: str | None = None
    samples: int | None = None
    label: str | None = "nominal"

    def column_map(self, folder: Path) -> Path | None:
        """The column map as a file, or None."""
        if self.columns is None:
            return None
        path = folder / "map.toml"
        path.write_text(self.columns, encoding="utf-8")
        return path


# --- one healthy move ----------------------------------------------------------------------------


def trapezoid(t: float, speed: float = SPEED, accel: float = 6e4) -> float:
    """Command of the one move at time t [rad/s]."""
    rise, fall = accel * (t - START_S), accel * (STOP_S - t) + speed
    return min(max(min(rise, fall), 0.0), speed)


@cache
def plant_states(rate_hz: int) -> tuple[tuple[float, float, float], ...]:
    """(V, i, x) of a healthy move at zero pitch, in the textbook's letters: Heun steps, real stick."""
    Rm, Km, D, Vmax, Kp, Ki, J, A, Rs = 20.2, 0.0212, 1.9e-6, 15.1, 1.1e-3, 0.45, 4.7e-7, 4.6e-4, 0.8
    R, steps = Rm + Rs, 32000 // rate_hz
    h = 1.0 / (rate_hz * steps)

    def current(w: float, I: float, t: float) -> float:
        i_cmd = Kp * (trapezoid(t) - w) + Ki * I
        return min(max(i_cmd, (-Vmax - Km * w) / R), (Vmax - Km * w) / R)

    def rates(w: float, I: float, t: float) -> tuple[float, float]:
        push = Km * current(w, I, t)
        drag = math.copysign(A, w) if w else max(min(push, A), -A)
        return (push - drag) / J, trapezoid(t) - w

    w = I = x = 0.0
    states = []
    for n in range(round(END_S * rate_hz) * steps):
        t = n * h
        if n % steps == 0:
            i = current(w, I, t)
            states.append((Rm * i + Km * w, i, x))
        dw, dI = rates(w, I, t)
        dw2, dI2 = rates(w + h * dw, I + h * dI, t + h)
        new = w + 0.5 * h * (dw + dw2)
        new = 0.0 if new * w < 0.0 else new
        x += 0.5 * h * D * (w + new)
        w, I = new, I + 0.5 * h * (dI + dI2)
    return tuple(states)


@cache
def healthy_move(rate_hz: int = RATE_HZ) -> np.ndarray:
    """(n, 6) the columns of the contract, with the noise of the paper's rig; read only."""
    states = np.array(plant_states(rate_hz))
    rng = np.random.default_rng(7)
    table = np.zeros((len(states), 6))
    table[:, 0] = np.arange(len(states)) / rate_hz
    table[:, 1:4] = states + rng.normal(size=states.shape) * (0.01, 3e-4, 1e-5)
    table[:, 5] = [trapezoid(t) for t in table[:, 0]]
    table = np.column_stack([np.round(column, d) for column, d in zip(table.T, DIGITS, strict=True)])
    table.flags.writeable = False
    return table


def rows_of(table: np.ndarray) -> Rows:
    """The numbers as the texts of a CSV file."""
    return [[f"{value:.{d}f}" for value, d in zip(row, DIGITS, strict=True)] for row in table]


@cache
def _healthy_rows() -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(row) for row in rows_of(healthy_move()))


def healthy_rows() -> Rows:
    """The healthy move as texts, fresh to be spoilt."""
    return [list(row) for row in _healthy_rows()]


def csv_text(rows: Rows, header: tuple[str, ...] = COLUMNS, separator: str = ",", end: str = "\n") -> str:
    """A table as the text of a file."""
    return end.join([separator.join(header), *(separator.join(row) for row in rows)]) + end


# --- spoilt ones ---------------------------------------------------------------------------------


def _file(name: str, content: Callable[[], str | bytes]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        made = content()
        path = folder / name
        path.write_bytes(made if isinstance(made, bytes) else made.encode("utf-8"))
        return path

    return write


def _spoilt(change: Callable[[Rows], Any]) -> Callable[[Path], Path]:
    """The healthy move as log.csv after `change` has had its rows."""

    def content() -> str:
        rows = healthy_rows()
        change(rows)
        return csv_text(rows)

    return _file("log.csv", content)


def _set(row: int, column: int, text: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[row - 1][column] = text

    return change


def _set_many(column: int, texts: dict[int, str]) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row, text in texts.items():
            rows[row - 1][column] = text

    return change


def _without(*names: str) -> Callable[[Path], Path]:
    keep = [k for k, name in enumerate(COLUMNS) if name not in names]

    def content() -> str:
        header = tuple(COLUMNS[k] for k in keep)
        return csv_text([[row[k] for k in keep] for row in healthy_rows()], header)

    return _file("log.csv", content)


def _jitter(rows: Rows) -> None:
    shift = np.random.default_rng(3).uniform(-0.2, 0.2, len(rows)) / RATE_HZ
    for row, dt in zip(rows, shift, strict=True):
        row[0] = f"{float(row[0]) + dt:.7f}"


def _stuck_position(rows: Rows) -> None:
    for row in rows[800:]:
        row[3] = rows[800][3]


def _restart(rows: Rows) -> None:
    for row in rows[1000:]:
        row[0] = f"{float(row[0]) - 0.625:.6f}"


def _scaled(column: int, factor: float) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows:
            row[column] = f"{float(row[column]) * factor:.6f}"

    return change


def _repeat(*at: int) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in sorted(at, reverse=True):
            rows.insert(row, list(rows[row - 1]))

    return change


def _headed(text: str) -> Callable[[], str]:
    return lambda: text + csv_text(healthy_rows())


def _truncated_gzip(folder: Path) -> Path:
    path = folder / "log.csv.gz"
    whole = gzip.compress(csv_text(healthy_rows()).encode())
    path.write_bytes(whole[: len(whole) // 2])
    return path


def _missing_file(folder: Path) -> Path:
    return folder / "nowhere.csv"


def _a_folder(folder: Path) -> Path:
    path = folder / "folder.csv"
    path.mkdir()
    return path


def _noise_bytes() -> bytes:
    return np.random.default_rng(1).integers(0, 256, 5000, dtype=np.uint8).tobytes()


def _extra_columns() -> str:
    rows = [[row[0], f"note {k}, \u00b5" if k % 2 else "", *row[1:]] for k, row in enumerate(healthy_rows())]
    return csv_text([[a, f'"{b}"', *rest] for a, b, *rest in rows], (COLUMNS[0], "remark", *COLUMNS[1:]))


def _slow_log() -> str:
    return csv_text(rows_of(healthy_move(400)))


def _latin_metadata() -> bytes:
    return ("# Pr\u00fcfstand 3, 20 \u00b0C\n" + csv_text(healthy_rows())).encode("cp1252")


def _coarse_clock(rows: Rows) -> None:
    for row in rows:
        row[0] = f"{math.floor(float(row[0]) * 1000) / 1000:.3f}"


def _decimal_comma() -> str:
    return csv_text([[text.replace(".", ",") for text in row] for row in healthy_rows()], separator=";")


def _all_missing(column: int) -> Callable[[Rows], None]:
    return lambda rows: [row.__setitem__(column, "") for row in rows]


NAN_VALUES = {5: "nan", 6: "NaN", 7: "", 300: "NA", 301: "null"}

SCENARIOS: tuple[Scenario, ...] = (
    Scenario("healthy", _spoilt(lambda rows: None), samples=1600),
    Scenario("healthy gzip", lambda f: _gzip(f / "log.csv.gz", csv_text(healthy_rows())), samples=1600),
    Scenario("400 Hz", _file("log.csv", _slow_log), samples=400),
    Scenario(
        "byte order mark", _file("log.csv", lambda: b"\xef\xbb\xbf" + csv_text(healthy_rows()).encode())
    ),
    Scenario(
        "Windows line ends", _file("log.csv", lambda: csv_text(healthy_rows(), end="\r\n")), samples=1600
    ),
    Scenario(
        "doubled line ends", _file("log.csv", lambda: csv_text(healthy_rows(), end="\r\n\n")), samples=1600
    ),
    Scenario("UTF-16", _file("log.csv", lambda: csv_text(healthy_rows()).encode("utf-16")), samples=1600),
    Scenario("metadata", _file("log.csv", _headed("# rig 3\n#\n# operator: A. B.\n\n")), samples=1600),
    Scenario("mixed encoding", _file("log.csv", _latin_metadata), notes=("cp1252",)),
    Scenario("extra columns", _file("log.csv", _extra_columns), samples=1600),
    Scenario("semicolons", _file("log.csv", lambda: csv_text(healthy_rows(), separator=";")), samples=1600),
    Scenario("tabs", _file("log.txt", lambda: csv_text(healthy_rows(), separator="\t")), samples=1600),
    Scenario("decimal comma", _file("log.csv", _decimal_comma), notes=("decimal comma",), samples=1600),
    Scenario("no last line end", _file("log.csv", lambda: csv_text(healthy_rows()).rstrip()), samples=1600),
    Scenario(
        "comment inside", _spoilt(lambda rows: rows.insert(500, ["# paused"])), rejected=1, samples=1600
    ),
    Scenario("half a last line", _spoilt(lambda rows: rows.append(["1.000000", "0.0"])), rejected=1),
    Scenario("no pitch", _without("pitch_deg"), notes=("pitch_deg is absent: taken as 0",)),
    Scenario("no command", _without("speed_cmd_rad_s"), notes=("speed_cmd_rad_s is absent",)),
    Scenario("no voltage", _without("voltage_v"), notes=("voltage_v is absent",), label=None),
    Scenario(
        "empty voltage", _spoilt(_all_missing(1)), rejected=1600, notes=("voltage_v holds no",), label=None
    ),
    Scenario("gap", _spoilt(lambda rows: rows.__delitem__(slice(800, 840))), gaps=1, notes=("1 gaps",)),
    Scenario("no values", _spoilt(_set_many(2, NAN_VALUES)), rejected=5),
    Scenario("infinite value", _spoilt(_set(700, 3, "-inf")), rejected=1),
    Scenario("wild values", _spoilt(_set_many(1, {9: "1e9", 900: "-99999"})), rejected=2),
    Scenario("holes in pitch", _spoilt(_set_many(4, {1: "", 800: "", 1600: "nan"})), rejected=3),
    Scenario("holes in command", _spoilt(_set_many(5, {1: "", 800: "", 1600: ""})), rejected=3),
    Scenario("no times", _spoilt(_set_many(0, {1: "", 2: "nan", 700: "inf", 1600: ""})), rejected=4),
    Scenario("repeated row", _spoilt(_repeat(1, 800, 1600)), rejected=3, samples=1603),
    Scenario("coarse clock", _spoilt(_coarse_clock), notes=("several at a time",), label=None),
    Scenario("jitter", _spoilt(_jitter), notes=("off by more than",), label=None),
    Scenario("stuck sensor", _spoilt(_stuck_position), label=None),
    Scenario("current in mA under A", _spoilt(_scaled(2, 1e3)), label="not_tested"),
    Scenario("voltage in mV under V", _spoilt(_scaled(1, 1e3)), error="map its unit"),
    Scenario("time in ms under s", _spoilt(_scaled(0, 1e3)), error="not in seconds"),
    Scenario("missing file", _missing_file, error="no such file"),
    Scenario("a folder", _a_folder, error="is a directory"),
    Scenario("empty file", _file("log.csv", str), error="the file is empty"),
    Scenario("blank file", _file("log.csv", lambda: "\n\n \n"), error="no header line"),
    Scenario("header only", _file("log.csv", lambda: csv_text([])), error="no samples"),
    Scenario(
        "no header",
        _file("log.csv", lambda: csv_text(healthy_rows()[1:], ("0", "0", "0", "0", "0", "0"))),
        error="holds numbers, not column names",
    ),
    Scenario(
        "one sample", _spoilt(lambda rows: rows.__delitem__(slice(1, None))), error="1 samples are too few"
    ),
    Scenario(
        "three samples", _spoilt(lambda rows: rows.__delitem__(slice(3, None))), error="3 samples are too few"
    ),
    Scenario(
        "nine samples", _spoilt(lambda rows: rows.__delitem__(slice(9, None))), error="9 samples are too few"
    ),
    Scenario(
        "text", _spoilt(_set(3, 2, "abc")), error=r"row 3 \(line 4\), column current_a: 'abc' is not a number"
    ),
    Scenario(
        "late text", _spoilt(_set(1599, 4, "12 V")), error=r"row 1599 \(line 1600\), column pitch_deg: '12 V'"
    ),
    Scenario(
        "no current",
        _without("current_a"),
        error="column current_a is missing; the columns are: time_s, volt",
    ),
    Scenario(
        "twice the same header",
        _file(
            "log.csv", lambda: csv_text([[*row, row[1]] for row in healthy_rows()], (*COLUMNS, "voltage_v"))
        ),
        error="stands 2 times",
    ),
    Scenario(
        "time backward",
        _spoilt(_set(500, 0, "0.1")),
        error=r"row 500 \(line 501\), column time_s: time runs backward \(0.31125 -> 0.1\)",
    ),
    Scenario(
        "clock restart", _spoilt(_restart), error=r"row 1001 \(line 1002\), column time_s: time runs backward"
    ),
    Scenario("no usable time", _spoilt(_all_missing(0)), error="column time_s"),
    Scenario("empty current", _spoilt(_all_missing(2)), error="column current_a holds no usable value"),
    Scenario(
        "wrong separator", _file("log.csv", lambda: csv_text(healthy_rows(), separator=":")), error="missing"
    ),
    Scenario("binary junk", _file("log.csv", _noise_bytes), error="binary"),
    Scenario("junk as Parquet", _file("log.parquet", _noise_bytes), error="not a whole Parquet file"),
    Scenario("junk as TDMS", _file("log.tdms", _noise_bytes), error="not a whole TDMS file"),
    Scenario("junk as LVM", _file("log.lvm", _noise_bytes), error="not a LabVIEW measurement file"),
    Scenario("no spreadsheet", _file("log.xlsx", _noise_bytes), error="not a whole spreadsheet"),
    Scenario("unknown kind", _file("log.doc", _noise_bytes), error="unknown kind of file"),
    Scenario("cut gzip", _truncated_gzip, error="(breaks off|cannot be (read|decoded))"),
)


def _gzip(path: Path, text: str) -> Path:
    path.write_bytes(gzip.compress(text.encode(), mtime=0))
    return path


# --- foreign layouts: data/columns ---------------------------------------------------------------


def write_semicolon(path: Path) -> None:
    """Semicolons, decimal commas, ms, mA, mm, turns a minute."""
    table = healthy_move()
    header = "Zeit [ms];Spannung [V];Strom [mA];Weg [mm];Neigung [\u00b0];Solldrehzahl [1/min]"
    lines = ["# Pr\u00fcfstand 3", header]
    for t, V, i, x, pitch, w in table:
        row = f"{1e3 * t:.3f};{V:.4f};{1e3 * i:.3f};{1e3 * x:.5f};{pitch:.1f};{w * 30 / math.pi:.5f}"
        lines.append(row.replace(".", ","))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_units_row(path: Path) -> None:
    """Tabs, a line of free text first, the header in line 3 and the units in line 4."""
    lines = ["Logger export 2.1", "", "t\tU\tI\tx\ttilt\tn_cmd", "us\tmV\tmA\tum\trad\tdeg/s"]
    for t, V, i, x, pitch, w in healthy_move():
        numbers = f"{1e6 * t:.0f}\t{1e3 * V:.1f}\t{1e3 * i:.3f}\t{1e6 * x:.2f}"
        lines.append(f"{numbers}\t{math.radians(pitch):.5f}\t{math.degrees(w):.4f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_parquet(path: Path) -> None:
    """Other names, the clock in whole microseconds, a pair of metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    t, V, i, x, pitch, w = healthy_move().T
    table = pa.table(
        {"clock_us": np.round(1e6 * t).astype(np.int64), "u": V, "i": 1e3 * i, "x": 1e3 * x, "n": w}
    )
    pq.write_table(table.replace_schema_metadata({"rig": "3"}), path, row_group_size=500)


def write_tdms(path: Path, segments: int = 2) -> None:
    """Channels of one group, the clock in their waveform properties, in several segments."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    t, V, i, x, pitch, w = healthy_move().T
    waveform = {"wf_start_offset": 0.0, "wf_increment": 1.0 / RATE_HZ}
    with TdmsWriter(str(path)) as writer:
        for part in np.array_split(np.arange(t.size), segments):
            channels = {"Voltage": V, "Current": 1e3 * i, "Position": 1e3 * x, "Command": w}
            writer.write_segment([
                RootObject({"operator": "A. B."}),
                GroupObject("Move"),
                *(ChannelObject("Move", name, v[part], waveform) for name, v in channels.items()),
            ])  # fmt: skip


def write_lvm(path: Path) -> None:
    """A LabVIEW measurement file: two headers, tabs, a comment in the first row only."""
    lines = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t.", "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative",
        "Operator\tA. B.", "Date\t2024/05/17", "Time\t10:11:12", "***End_of_Header***\t", "\t",
        "Channels\t4\t\t\t\t", f"Samples\t{END_S * RATE_HZ:.0f}" + f"\t{END_S * RATE_HZ:.0f}" * 3,
        "Y_Unit_Label\tV\tmA\tmm\trad/s", "X0" + "\t0.0E+0" * 4, "Delta_X" + "\t0.000625" * 4,
        "***End_of_Header***\t\t\t\t\t", "X_Value\tVoltage\tCurrent\tPosition\tCommand\tComment",
    ]  # fmt: skip
    for k, (t, V, i, x, _, w) in enumerate(healthy_move()):
        lines.append(
            f"{t:.6f}\t{V:.4f}\t{1e3 * i:.3f}\t{1e3 * x:.5f}\t{w:.6f}" + ("\tfirst" if k == 0 else "")
        )
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode())


EXAMPLES: dict[str, Callable[[Path], None]] = {
    "semicolon.csv": write_semicolon,
    "units_row.txt": write_units_row,
    "renamed.parquet": write_parquet,
    "waveform.tdms": write_tdms,
    "labview.lvm": write_lvm,
}

if __name__ == "__main__":
    for file_name, writer in EXAMPLES.items():
        writer(Path(sys.argv[1]) / file_name)
