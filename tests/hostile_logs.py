"""Logs as a careless logger or a hostile hand writes them, in every format: each with its one line, or its listed repair.

They go on where `scenarios.py` ends: those run through the whole pipeline, these through every reader.
"""

import datetime
import gzip
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scenarios import (
    COLUMNS,
    MAPS,
    RATE_HZ,
    Rows,
    Scenario,
    _file,
    _spoilt,
    csv_text,
    healthy_move,
    healthy_rows,
)

ESCAPES = "\x1b[31mred\x1b[0m\x07\r\u202e"
WITH_REMARK = (*COLUMNS, "remark")


def remarked(change: Callable[[Rows], Any], name: str = "log.csv") -> Callable[[Path], Path]:
    """The healthy move with a seventh column that no one reads, after `change` has had its rows."""

    def content() -> str:
        rows = [[*row, "ok"] for row in healthy_rows()]
        change(rows)
        return csv_text(rows, WITH_REMARK)

    return _file(name, content)


def put(row: int, column: int, text: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[row - 1][column] = text

    return change


def put_all(*changes: Callable[[Rows], Any]) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for one in changes:
            one(rows)

    return change


def every(column: int, how: Callable[[str], str], step: int = 1) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows[::step]:
            row[column] = how(row[column])

    return change


def extra(step: int) -> Callable[[Rows], None]:
    return lambda rows: [row.append("7") for row in rows[::step]]


def text(before: str = "", behind: str = "", end: str = "\n") -> Callable[[Path], Path]:
    return _file("log.csv", lambda: before + csv_text(healthy_rows(), end=end) + behind)


def encoded(encoding: str) -> Callable[[Path], Path]:
    return _file("log.csv", lambda: csv_text(healthy_rows()).encode(encoding))


def packed(
    change: Callable[[bytes], bytes], content: Callable[[], str] | None = None
) -> Callable[[Path], Path]:
    def made() -> bytes:
        plain = content() if content else csv_text(healthy_rows())
        return change(gzip.compress(plain.encode(), mtime=0))

    return _file("log.csv.gz", made)


def clock(of: Callable[[int], str]) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for k, row in enumerate(rows):
            row[0] = of(k)

    return change


# --- quotes, ends of lines, fields ---------------------------------------------------------------

QUOTES = (
    Scenario("stray quote", _spoilt(put(3, 2, '"0.1')), rejected=1, samples=1599),
    Scenario("stray quote in an unused column", remarked(put(3, 6, '"ok')), rejected=1, samples=1599),
    Scenario(
        "two stray quotes", remarked(put_all(put(3, 6, '"ok'), put(900, 6, '"ok'))), rejected=2, samples=1598
    ),
    Scenario("stray quote in the last row", remarked(put(1600, 6, '"ok')), rejected=1, samples=1599),
    Scenario(
        "stray quote in every row", remarked(every(6, lambda t: '"' + t)), error="a quote is not closed"
    ),
    Scenario("quote within a field", remarked(put(3, 6, '5" pipe')), samples=1600),
    Scenario("quote within a number", _spoilt(put(3, 2, '0"1')), error=r"row 3 .*current_a: '0\"1' is not"),
    Scenario(
        "quotes within every field of a column", remarked(every(6, lambda t: '5" by 6" pipe')), samples=1600
    ),
    Scenario(
        "quotes within fields beside fields in quotes",
        remarked(put_all(every(6, lambda t: '5" pipe'), every(6, lambda t: '"a, b"', 3), put(2, 6, '"ok'))),
        rejected=1,
        samples=1599,
    ),
    Scenario(
        "blank lines and comments between rows with inches",
        remarked(
            put_all(every(6, lambda t: '5"'), put(3, 0, '# 5" pipe'), lambda rows: rows.insert(9, [""]))
        ),
        rejected=1,
        samples=1599,
    ),
    Scenario("text behind a quote", remarked(put(3, 6, '"ok"x')), rejected=1, samples=1599),
    Scenario(
        "all in quotes",
        _spoilt(lambda rows: [row.__setitem__(slice(None), [f'"{t}"' for t in row]) for row in rows]),
        samples=1600,
    ),
    Scenario("separators in quotes", remarked(every(6, lambda t: '"a, b, c"')), samples=1600),
    Scenario("quotes in quotes", remarked(put(3, 6, '"say ""ok"" twice"')), samples=1600),
    Scenario("end of line in quotes", remarked(put(3, 6, '"one\ntwo"')), rejected=2, samples=1599),
    Scenario(
        "decimal comma in quotes", _spoilt(put(3, 2, '"0,1"')), error=r"'0,1' is not a number.*decimal_comma"
    ),
    Scenario(
        "stray quote in the header",
        _file("log.csv", lambda: csv_text(healthy_rows(), ('"time_s', *COLUMNS[1:]))),
        error="time_s is missing",
    ),
    Scenario("stray quote in a comment before the header", text('# 5" pipe, "open\n'), samples=1600),
)

ENDS = (
    *(
        Scenario(f"{ord(end):#06x} in a comment", text(f"# one{end}two\n"), samples=1600)
        for end in "\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"
    ),
    *(
        Scenario(f"{ord(end):#06x} in a remark", remarked(put(3, 6, f"one{end}two")), samples=1600)
        for end in "\x0b\x0c\x1c\x85\u2028"
    ),
    Scenario("a zero byte in a remark", remarked(put(3, 6, "one\x00two")), error="binary"),
    Scenario(
        "0x85 of Windows in a comment",
        _file("log.csv", lambda: b"# and so on\x85\n" + csv_text(healthy_rows()).encode()),
        notes=("cp1252",),
        samples=1600,
    ),
    Scenario("carriage returns alone", text(end="\r"), samples=1600),
    Scenario(
        "mixed ends of lines",
        _file("log.csv", lambda: csv_text(healthy_rows()).replace("5\n", "5\r\n").replace("4\n", "4\r")),
        samples=1600,
    ),
    Scenario("a form feed between rows", remarked(lambda rows: rows.insert(5, ["\x0c"])), samples=1600),
    Scenario("spaces on a line", _spoilt(lambda rows: rows.insert(5, ["   "])), samples=1600),
    Scenario("blank lines in between", _spoilt(lambda rows: rows.insert(5, ["\n\n\n"])), samples=1600),
    Scenario("a million blank lines and more", text(behind="\n" * 1_100_000), error="lines are blank"),
    Scenario("blank lines first", text(before="\n" * 300_000), error="no header line"),
    Scenario(
        "blank lines behind the header",
        _file("log.csv", lambda: ",".join(COLUMNS) + "\n" * 300_000),
        error="no samples",
    ),
    Scenario("a line without an end", text(behind="1" * 400_000), error="more than 256 KB"),
)

FIELDS = (
    Scenario(
        "a row of other bytes with too few fields",
        _file("log.csv", lambda: csv_text(healthy_rows()).encode() + b"1.0,\xff\xfe,2\n"),
        rejected=1,
        samples=1600,
    ),
    Scenario(
        "a header of characters that do not exist",
        _file("log.csv", lambda: csv_text(healthy_rows(), ("\uf57ftime_s", *COLUMNS[1:]))),
        error=r"time_s is missing.*\\uf57ftime_s",
    ),
    Scenario(
        "one field too many in every row",
        _spoilt(extra(1)),
        error="7 fields where the header has 6, and 1600 rows",
    ),
    Scenario(
        "one field too many in every third row", _spoilt(extra(3)), error="7 fields where the header has 6"
    ),
    Scenario("one field too many in every twentieth row", _spoilt(extra(20)), rejected=80, samples=1520),
    Scenario(
        "one field too few in every row",
        _spoilt(lambda rows: [row.pop() for row in rows]),
        error="5 fields where the header has 6",
    ),
    Scenario(
        "a separator at every end",
        _spoilt(lambda rows: [row.append("") for row in rows]),
        samples=1600,
    ),
    Scenario(
        "rows of separators",
        _spoilt(lambda rows: [rows.insert(9, [""] * 6) for _ in range(3)]),
        rejected=3,
        samples=1600,
    ),
    Scenario(
        "a comment with separators",
        _spoilt(lambda rows: rows.insert(9, ["# a", "b", "c", "d", "e", "f"])),
        rejected=1,
        samples=1600,
    ),
    Scenario(
        "comments everywhere",
        _spoilt(lambda rows: rows.__setitem__(slice(None), [r for row in rows for r in (["# x"], row)])),
        error="a comment, and",
    ),
    Scenario(
        "the header again",
        _spoilt(lambda rows: rows.insert(700, list(COLUMNS))),
        rejected=1,
        samples=1600,
    ),
    Scenario(
        "a header of 200 KB",
        _file("log.csv", lambda: csv_text(healthy_rows(), (*COLUMNS, "x" * 200_000))),
        error="too many for a header",
    ),
    Scenario(
        "a header of 3000 columns",
        _file("log.csv", lambda: csv_text(healthy_rows(), (*COLUMNS, *map(str, range(3000))))),
        error="more than 2000",
    ),
    Scenario(
        "a header of 300 KB",
        _file("log.csv", lambda: "x" * 300_000),
        error="(too many for a header|no samples)",
    ),
    Scenario("metadata of 300 KB", text("# and so on\n" * 30_000), error="no header line"),
    Scenario("metadata of 5000 lines", text("# k\n" * 5000), samples=1600),
    Scenario("escapes in metadata", text(f"# {ESCAPES[:-2]}\n"), samples=1600),
    Scenario(
        "escapes in a header",
        _file("log.csv", lambda: csv_text(healthy_rows(), (ESCAPES[:-2], *COLUMNS[1:]))),
        error=r"time_s is missing.*\\x1b",
    ),
    Scenario(
        "one column twice through the case",
        _file("log.csv", lambda: csv_text([[*r, r[1]] for r in healthy_rows()], (*COLUMNS, "TIME_S"))),
        samples=1600,
    ),
    Scenario(
        "one header for two columns",
        _spoilt(lambda rows: None),
        columns='columns.current_a = "voltage_v"',
        error="stands for (voltage_v|current_a) and for",
    ),
)

# --- numbers, clocks -----------------------------------------------------------------------------

NUMBERS = (
    *(
        Scenario(f"{wrong!r} for a number", _spoilt(put(3, 2, wrong)), error="row 3 .*is not a number")
        for wrong in (
            "0x10",
            "1_0",
            "\u0661\u0662",
            "--5",
            "1e",
            "1.2.3",
            "+",
            "0.1A",
            "TRUE",
            "=1/3",
        )
    ),
    Scenario("a thousand in groups", _spoilt(put(3, 2, "1 000")), samples=1600),
    Scenario("Fortran's exponent", _spoilt(put(3, 2, "1d5")), rejected=1, samples=1600),
    Scenario("1e400", _spoilt(put(3, 2, "1e400")), rejected=1, samples=1600),
    Scenario("400 digits", _spoilt(put(3, 2, "1" * 400)), rejected=1, samples=1600),
    Scenario("-Infinity", _spoilt(put(3, 2, "-Infinity")), rejected=1, samples=1600),
    Scenario("1e-400", _spoilt(put(3, 2, "1e-400")), samples=1600),
    Scenario("the last time is 1e308", _spoilt(put(1600, 0, "1e308")), rejected=1, samples=1600),
    Scenario("the last time is -1e308", _spoilt(put(1600, 0, "-1e308")), rejected=1, samples=1600),
    Scenario("the last time is 1e9", _spoilt(put(1600, 0, "1e9")), gaps=1, notes=("1 gaps",), samples=1600),
    Scenario("all times are 1e308", _spoilt(every(0, lambda t: "1e308")), error="column time_s"),
    Scenario(
        "a clock of 1.6 MHz",
        _spoilt(clock(lambda k: f"{k / 1.6e6:.9f}")),
        error="more than any actuator needs",
    ),
    Scenario(
        "a clock of 2 GHz",
        _spoilt(clock(lambda k: f"{k * 5e-10:.12f}")),
        error="more than any actuator needs",
    ),
    Scenario(
        "denormal steps", _spoilt(clock(lambda k: repr(k * 5e-324))), error="more than any actuator needs"
    ),
    Scenario("a clock that stands still", _spoilt(clock(lambda k: "5.0")), error="column time_s"),
    Scenario("times before zero", _spoilt(clock(lambda k: f"{k / RATE_HZ - 100:.6f}")), samples=1600),
    Scenario("times since 1970", _spoilt(clock(lambda k: f"{1.7e9 + k / RATE_HZ:.6f}")), samples=1600),
    Scenario("times since 1904", _spoilt(clock(lambda k: f"{3.8e9 + k / RATE_HZ:.6f}")), samples=1600),
    Scenario(
        "times in ns since 1970",
        _spoilt(clock(lambda k: f"{1.7e18 + 625000 * k:.0f}")),
        error="column time_s",
    ),
    Scenario("a gap after every sample", _spoilt(clock(lambda k: f"{k * 20.0:.1f}")), error="too slow"),
    Scenario(
        "six bursts",
        _spoilt(clock(lambda k: f"{k / RATE_HZ + 1e5 * (k // 250):.6f}")),
        gaps=6,
        notes=("6 gaps",),
        samples=1600,
    ),
)

# --- encodings, packed files, names --------------------------------------------------------------


def _fifo(folder: Path) -> Path:
    os.mkfifo(folder / "log.csv")
    return folder / "log.csv"


def _link(target: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "log.csv").symlink_to(target)
        return folder / "log.csv"

    return write


ENCODINGS = (
    Scenario("UTF-16 without a mark", encoded("utf-16-le"), samples=1600),
    Scenario(
        "UTF-16 without a mark, named", encoded("utf-16-le"), columns='encoding = "utf-16-le"', samples=1600
    ),
    Scenario(
        "UTF-16 with a byte too many",
        _file("log.csv", lambda: csv_text(healthy_rows()).encode("utf-16") + b"\x00"),
        rejected=1,
    ),
    Scenario("UTF-32, named", encoded("utf-32"), columns='encoding = "utf-32"', samples=1600),
    Scenario("EBCDIC, named", encoded("cp037"), columns='encoding = "cp037"', samples=1600),
    Scenario(
        "GBK, named",
        _file("log.csv", lambda: ("# \u6d4b\u8bd5\n" + csv_text(healthy_rows())).encode("gbk")),
        columns='encoding = "gbk"',
        samples=1600,
    ),
    Scenario("UTF-7, named", encoded("utf-7"), columns='encoding = "utf-7"', samples=1600),
    Scenario(
        "no UTF-8 in a remark",
        _file(
            "log.csv",
            lambda: csv_text([[*row, "\u00e9"] for row in healthy_rows()], WITH_REMARK).encode("latin-1"),
        ),
        notes=("cp1252",),
        samples=1600,
    ),
    Scenario("UTF-8 named as UTF-32", encoded("utf-8"), columns='encoding = "utf-32"', error=r"log\.csv: "),
    Scenario("packed twice", packed(gzip.compress), error="binary"),
    Scenario("packed in two members", packed(lambda b: b[:0] + b + gzip.compress(b"")), samples=1600),
    Scenario("packed, with junk behind", packed(lambda b: b + b"junk" * 9), error="breaks off"),
    Scenario(
        "packed, with a wrong check sum", packed(lambda b: b[:-8] + bytes(4) + b[-4:]), error="breaks off"
    ),
    Scenario(
        "packed, damaged in the middle",
        packed(lambda b: b[:9000] + bytes(99) + b[9099:]),
        error=r"log\.csv\.gz: ",
    ),
    Scenario("packed, its first bytes alone", packed(lambda b: b[:5]), error="breaks off"),
    Scenario(
        "packed blank lines",
        packed(lambda b: b, lambda: csv_text(healthy_rows()) + "\n" * 5_000_000),
        error="lines are blank",
    ),
    Scenario(
        "packed, one endless line",
        packed(lambda b: b, lambda: csv_text(healthy_rows()) + "1" * 5_000_000),
        error="more than 256 KB",
    ),
    Scenario("packed, nothing inside", packed(lambda b: b, lambda: ""), error="no header line"),
    Scenario(
        "not packed under the name of a packed one",
        _file("log.csv.gz", lambda: csv_text(healthy_rows())),
        samples=1600,
    ),
    Scenario(
        "packed under a plain name",
        _file("log.csv", lambda: gzip.compress(csv_text(healthy_rows()).encode())),
        samples=1600,
    ),
    Scenario("a named pipe", _fifo, error="named pipe"),
    Scenario("a link to a device", _link("/dev/zero"), error="is a device"),
    Scenario("a link to nothing", _link("nowhere"), error="no such file"),
    Scenario("a link to itself", _link("log.csv"), error="cannot read the log"),
    Scenario(
        "escapes in a name",
        _file("a\x1b[31m\nb.csv", lambda: csv_text(healthy_rows()[:5])),
        error=r"a\\x1b\[31m\\nb.csv: 5 samples",
    ),
    Scenario(
        "a name that is no UTF-8",
        _file("a\udce9b.csv", lambda: csv_text(healthy_rows()[:5])),
        error=r"a\\udce9b.csv: 5 samples",
    ),
    Scenario(
        "a name of 250 characters", _file("n" * 246 + ".csv", lambda: csv_text(healthy_rows())), samples=1600
    ),
)

# --- Parquet -------------------------------------------------------------------------------------


def parquet(
    change: Callable[[dict[str, Any]], Any], damage: Callable[[bytes], bytes] | None = None, **how: Any
) -> Callable[[Path], Path]:
    """The healthy move as Parquet, with columns of arrow that `change` has had, and the bytes that `damage` has had."""

    def write(folder: Path) -> Path:
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns: dict[str, Any] = dict(zip(COLUMNS, healthy_move().T, strict=True))
        change(columns)
        meta = how.get("metadata")
        table = pa.table(list(columns.values()), names=[n.strip("2") for n in columns])
        path = folder / "log.parquet"
        pq.write_table(table.replace_schema_metadata(meta), path, row_group_size=how.get("group", 500))
        if damage:
            path.write_bytes(damage(path.read_bytes()))
        return path

    return write


def as_type(
    kind: tuple[int, int], values: Callable[[np.ndarray], Any] = lambda v: v
) -> Callable[[dict[str, Any]], None]:
    def change(columns: dict[str, Any]) -> None:
        import pyarrow as pa

        columns["current_a"] = pa.array(values(columns["current_a"])).cast(pa.decimal128(*kind))

    return change


def replaced(values: Callable[[np.ndarray], Any]) -> Callable[[dict[str, Any]], None]:
    def change(columns: dict[str, Any]) -> None:
        import pyarrow as pa

        made = values(columns["current_a"])
        columns["current_a"] = made if isinstance(made, pa.Array) else pa.array(made)

    return change


def signalling(values: np.ndarray, kind: str = "f8") -> np.ndarray:
    """The values, but every hundredth is a NaN of the kind that warns at every operation."""
    made = values.astype(kind)
    bits = {"f8": np.uint64(0x7FF0000000000001), "f4": np.uint32(0x7F800001)}[kind]
    made.view(bits.dtype)[::100] = bits
    return made


def _dictionary(values: np.ndarray) -> Any:
    import pyarrow as pa

    return pa.array([f"{v:.6f}" for v in values]).dictionary_encode()


def _no_rows(columns: dict[str, Any]) -> None:
    for name in columns:
        columns[name] = columns[name][:0]


def _nan_tail(columns: dict[str, Any]) -> None:
    for name in columns:
        columns[name] = np.append(columns[name], [np.nan] * 5)


def flipped(at: int, count: int = 40) -> Callable[[bytes], bytes]:
    def change(raw: bytes) -> bytes:
        start = at % len(raw)
        return raw[:start] + bytes(b ^ 0xFF for b in raw[start : start + count]) + raw[start + count :]

    return change


PARQUET = (
    Scenario(
        "Parquet: a column twice",
        parquet(lambda c: c.update(current_a2=c["current_a"])),
        error="stands 2 times",
    ),
    Scenario(
        "Parquet: lists",
        parquet(replaced(lambda v: [[x] for x in v.tolist()])),
        error="current_a is of type list",
    ),
    Scenario(
        "Parquet: structures",
        parquet(replaced(lambda v: [{"x": x} for x in v.tolist()])),
        error="current_a is of type struct",
    ),
    Scenario("Parquet: truth values", parquet(replaced(lambda v: v > 0)), error="current_a is of type bool"),
    Scenario(
        "Parquet: times of day",
        parquet(replaced(lambda v: np.arange(v.size).astype("datetime64[s]"))),
        error="current_a is of type timestamp",
    ),
    Scenario(
        "Parquet: bytes", parquet(replaced(lambda v: [b"1"] * v.size)), error="current_a is of type binary"
    ),
    Scenario("Parquet: texts of numbers", parquet(replaced(lambda v: [f"{x:.6f}" for x in v])), samples=1600),
    Scenario(
        "Parquet: texts",
        parquet(replaced(lambda v: ["x"] * v.size)),
        error="row 1, column current_a: 'x' is not a number",
    ),
    Scenario("Parquet: dictionary of texts", parquet(replaced(_dictionary)), samples=1600),
    Scenario("Parquet: decimals", parquet(as_type((20, 9), lambda v: np.round(v, 6))), samples=1600),
    Scenario("Parquet: signalling NaN", parquet(replaced(signalling)), rejected=16, samples=1600),
    Scenario(
        "Parquet: signalling NaN in single precision",
        parquet(replaced(lambda v: signalling(v, "f4"))),
        rejected=16,
        samples=1600,
    ),
    Scenario("Parquet: half precision", parquet(replaced(lambda v: v.astype(np.float16))), samples=1600),
    Scenario(
        "Parquet: whole numbers",
        parquet(replaced(lambda v: np.full(v.size, 2**64 - 1, dtype=np.uint64))),
        error="map its unit",
    ),
    Scenario(
        "Parquet: nothing but nulls", parquet(replaced(lambda v: [None] * v.size)), error="no usable value"
    ),
    Scenario("Parquet: no rows", parquet(_no_rows), error="0 samples are too few"),
    Scenario("Parquet: rows without a value", parquet(_nan_tail), rejected=5, samples=1600),
    Scenario("Parquet: one row group a row", parquet(lambda c: None, group=1), samples=1600),
    Scenario(
        "Parquet: escapes in metadata", parquet(lambda c: None, metadata={"rig": ESCAPES}), samples=1600
    ),
    Scenario(
        "Parquet: a metadata of 1 MB",
        parquet(lambda c: None, metadata={"rig": "x" * 1_000_000}),
        samples=1600,
    ),
    Scenario(
        "Parquet: cut", parquet(lambda c: None, lambda raw: raw[:-20]), error="not a whole Parquet file"
    ),
    Scenario("Parquet: damaged footer", parquet(lambda c: None, flipped(-300)), error=r"log\.parquet: "),
    Scenario("Parquet: damaged pages", parquet(lambda c: None, flipped(4, 400)), error=r"log\.parquet: "),
    Scenario(
        "Parquet: encrypted",
        parquet(lambda c: None, lambda raw: b"PARE" + raw[4:-4] + b"PARE"),
        error="not a whole Parquet",
    ),
    Scenario("Parquet: four bytes", _file("log.parquet", lambda: b"PAR1"), error="not a whole Parquet"),
    Scenario(
        "Parquet under .csv.gz",
        lambda folder: parquet(lambda c: None)(folder).rename(folder / "log.csv.gz"),
        error="rename it",
    ),
)

# --- TDMS ----------------------------------------------------------------------------------------

WAVE = {"wf_start_offset": 0.0, "wf_increment": 1.0 / RATE_HZ}
TDMS_MAP = (MAPS / "waveform.toml").read_text(encoding="utf-8")
NOON = np.datetime64("2024-05-17T12:00:00.000000", "us")


def tdms(
    change: Callable[[dict[str, Any]], Any] = lambda channels: None,
    damage: Callable[[bytes], bytes] | None = None,
    root: dict[str, Any] | None = None,
    columns: tuple[str, ...] = ("Voltage", "Current", "Position", "Command"),
) -> Callable[[Path], Path]:
    """The healthy move as waveforms {name: (values, properties)} that `change` has had."""

    def write(folder: Path) -> Path:
        from nptdms import ChannelObject, RootObject, TdmsWriter

        t, V, i, x, _, w = healthy_move().T
        values = {"Voltage": V, "Current": 1e3 * i, "Position": 1e3 * x, "Command": w, "time_s": t}
        channels = {name: (values[name], dict(WAVE)) for name in columns}
        change(channels)
        path = folder / "log.tdms"
        with TdmsWriter(str(path)) as writer:
            made = [ChannelObject("Move", name, *given) for name, given in channels.items()]
            writer.write_segment([RootObject(root or {"operator": "A. B."}), *made])
        if damage:
            path.write_bytes(damage(path.read_bytes()))
        return path

    return write


def wave(name: str, **properties: Any) -> Callable[[dict[str, Any]], None]:
    def change(channels: dict[str, Any]) -> None:
        values, before = channels[name]
        given = {k: v for k, v in (before | properties).items() if v is not None}
        channels[name] = (values, given)

    return change


def all_waves(**properties: Any) -> Callable[[dict[str, Any]], None]:
    return lambda channels: [wave(name, **properties)(channels) for name in list(channels)]


def both(*changes: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], None]:
    return lambda channels: [change(channels) for change in changes]


def values_of(name: str, how: Callable[[np.ndarray], np.ndarray], **properties: Any) -> Any:
    def change(channels: dict[str, Any]) -> None:
        values, before = channels[name]
        channels[name] = (how(values), before | properties)

    return change


def _t(name: str, *args: Any, error: str = "", **rest: Any) -> Scenario:
    write = tdms(*args, **{k: rest.pop(k) for k in ("damage", "root", "columns_of") if k in rest})
    return Scenario(f"TDMS: {name}", write, error=error, columns=TDMS_MAP, **rest)


TDMS = (
    _t("waveforms", samples=1600, notes=("waveform",)),
    _t(
        "a slower channel",
        values_of("Position", lambda v: v[::4], wf_increment=4.0 / RATE_HZ),
        rejected=1200,
        notes=("position_m has 400 samples a second on a clock of 1600",),
        samples=1600,
    ),
    _t(
        "a channel that starts later",
        values_of("Position", lambda v: v[160:], wf_start_offset=0.1),
        rejected=160,
        notes=("waveform",),
        samples=1600,
    ),
    _t(
        "a channel that starts earlier",
        values_of("Position", lambda v: np.append([0.0] * 160, v), wf_start_offset=-0.1),
        rejected=3 * 160,
        samples=1760,
        notes=("waveform",),
    ),
    _t(
        "clocks that have nothing in common",
        wave("Position", wf_increment=1.0 / 1000),
        error="'Voltage' .1600 Hz .* and 'Position' .1000 Hz .* different clocks",
    ),
    _t(
        "a rate off by a tenth of a per cent",
        wave("Position", wf_increment=1.001 / RATE_HZ),
        error="different clocks",
    ),
    _t(
        "a start between two samples",
        wave("Position", wf_start_offset=0.4 / RATE_HZ),
        error="different clocks",
    ),
    _t(
        "start times an hour apart",
        both(all_waves(wf_start_time=NOON), wave("Position", wf_start_time=NOON + np.timedelta64(1, "h"))),
        error="different clocks",
    ),
    _t(
        "start times ten samples apart",
        both(
            all_waves(wf_start_time=NOON),
            values_of("Position", lambda v: v[10:], wf_start_time=NOON + np.timedelta64(6250, "us")),
        ),
        rejected=10,
        samples=1600,
        notes=("waveform",),
    ),
    _t(
        "one start time missing, the others alike",
        both(all_waves(wf_start_time=NOON), wave("Position", wf_start_time=None)),
        samples=1600,
        notes=("waveform",),
    ),
    _t(
        "one start time missing, the others differ",
        both(
            all_waves(wf_start_time=NOON),
            wave("Voltage", wf_start_time=NOON + np.timedelta64(1, "s")),
            wave("Position", wf_start_time=None),
        ),
        error="has no wf_start_time",
    ),
    _t(
        "one channel without a clock",
        wave("Position", wf_increment=None),
        error="'Position' has no wf_increment",
    ),
    _t("no channel with a clock", all_waves(wf_increment=None), error="time_s is missing"),
    _t(
        "complex numbers",
        values_of("Current", lambda v: v.astype(np.complex128)),
        error="current_a is of type complex128",
    ),
    _t("truth values", values_of("Current", lambda v: v > 0), error="current_a is of type bool"),
    _t(
        "times",
        values_of("Current", lambda v: np.arange(v.size).astype("datetime64[us]")),
        error="current_a is of type datetime64",
    ),
    _t("texts", values_of("Current", lambda v: v.astype(str)), error="current_a is of type object"),
    _t(
        "an increment that is a text",
        wave("Voltage", wf_increment="fast"),
        error="wf_increment of channel 'Voltage' is 'fast', not a number",
    ),
    _t(
        "an offset that is a text",
        wave("Voltage", wf_start_offset="late"),
        error="wf_start_offset of channel 'Voltage'",
    ),
    _t(
        "an increment that is a time",
        wave("Voltage", wf_increment=datetime.datetime(2024, 1, 1)),
        error="wf_increment of channel",
    ),
    *(
        _t(f"increments of {step}", all_waves(wf_increment=step), error=error)
        for step, error in (
            (0.0, "no clock"),
            (-0.000625, "no clock"),
            (float("nan"), "no clock"),
            (float("inf"), "no clock"),
            (5e-324, "more than any|too fine"),
            (1e-9, "more than any"),
            (60.0, "too slow"),
        )
    ),
    _t("an infinite start", all_waves(wf_start_offset=float("inf")), error="no clock"),
    _t("a start in the year 30000 000", all_waves(wf_start_offset=1e15), error="no clock"),
    _t("a start that leaves no digits", all_waves(wf_start_offset=9e10, wf_increment=1e-5), error="too fine"),
    _t(
        "a shorter channel",
        values_of("Position", lambda v: v[:-5]),
        rejected=5,
        samples=1600,
        notes=("waveform",),
    ),
    _t("signalling NaN", values_of("Current", signalling), rejected=16, samples=1600, notes=("waveform",)),
    _t(
        "signalling NaN in single precision",
        values_of("Current", lambda v: signalling(v, "f4")),
        rejected=16,
        samples=1600,
    ),
    _t("an empty channel", values_of("Position", lambda v: v[:0]), error="position_m holds no usable value"),
    _t("escapes in properties", root={"operator": ESCAPES}, samples=1600, notes=("waveform",)),
    _t("no channels", lambda channels: channels.clear(), error="holds no channels"),
    _t("cut", damage=lambda raw: raw[:-5000], error=r"log\.tdms: "),
    _t("its first bytes alone", damage=lambda raw: raw[:20], error="not a whole TDMS"),
    _t("a damaged lead", damage=flipped(4, 20), error="not a whole TDMS"),
    _t("damaged names", damage=flipped(40, 60), error=r"log\.tdms: "),
    Scenario(
        "TDMS: a time channel beside one clock",
        tdms(columns=("time_s", "Voltage", "Current", "Position", "Command")),
        columns=TDMS_MAP,
        samples=1600,
    ),
    Scenario(
        "TDMS: a time channel beside two clocks",
        tdms(
            wave("Position", wf_increment=1e-3),
            columns=("time_s", "Voltage", "Current", "Position", "Command"),
        ),
        columns=TDMS_MAP,
        error="different clocks",
    ),
    Scenario(
        "TDMS: a time channel beside a slower clock",
        tdms(
            wave("Position", wf_increment=4.0 / RATE_HZ),
            columns=("time_s", "Voltage", "Current", "Position", "Command"),
        ),
        columns=TDMS_MAP,
        error="a clock of its own",
    ),
)

# --- LVM -----------------------------------------------------------------------------------------

LVM = (MAPS / "labview.lvm").read_text(encoding="utf-8").replace("\r\n", "\n")
LVM_MAP = (MAPS / "labview.toml").read_text(encoding="utf-8")


def lvm(
    change: Callable[[list[str]], Any] = lambda rows: None, *heads: tuple[str, str]
) -> Callable[[Path], Path]:
    """The example of an LVM file after its rows were changed and texts of its header exchanged."""

    def content() -> str:
        head, body = LVM.split("Comment\n", 1)
        for old, new in heads:
            assert old in head
            head = head.replace(old, new)
        rows = body.splitlines()
        change(rows)
        return head + "Comment\n" + "\n".join(rows) + "\n"

    return _file("log.lvm", content)


def each_row(how: Callable[[str], str], step: int = 1) -> Callable[[list[str]], None]:
    return lambda rows: rows.__setitem__(slice(None, None, step), [how(row) for row in rows[::step]])


def _two_x(row: str, late: str = "") -> str:
    """A row with an X column before the third channel."""
    fields = row.split("\t")
    return "\t".join([*fields[:3], late or fields[0], *fields[3:]])


TWO_X = (("Current\tPosition", "Current\tX_Value\tPosition"), ("X_Columns\tOne", "X_Columns\tMulti"))
NO_X = ("X_Columns\tOne", "X_Columns\tNo")


def _v(name: str, *args: Any, **rest: Any) -> Scenario:
    return Scenario(f"LVM: {name}", lvm(*args), columns=LVM_MAP, **rest)


LVMS = (
    _v("as it is", samples=1600),
    _v("a field too many", lambda rows: rows.__setitem__(5, rows[5] + "\t1\t2"), rejected=1, samples=1599),
    _v(
        "two fields too many in every row",
        each_row(lambda row: row + "\t1\t2"),
        error="fields where the header has 5",
    ),
    _v("a comment in every row", each_row(lambda row: row.removesuffix("\tfirst") + "\tok"), samples=1600),
    _v(
        "a field too few",
        lambda rows: rows.__setitem__(5, rows[5].rsplit("\t", 1)[0]),
        rejected=1,
        samples=1599,
    ),
    _v("a stray quote", lambda rows: rows.__setitem__(5, '"' + rows[5]), rejected=1, samples=1599),
    _v(
        "a stray quote in a comment",
        lambda rows: rows.__setitem__(5, rows[5] + '\t"ok'),
        rejected=1,
        samples=1599,
    ),
    _v(
        "the header again",
        lambda rows: rows.insert(500, "X_Value\tVoltage\tCurrent\tPosition\tCommand"),
        error="'X_Value' is not a number",
    ),
    _v(
        "an end of header in the middle",
        lambda rows: rows.insert(500, "***End_of_Header***"),
        rejected=1,
        samples=1600,
    ),
    _v("U+2028 in a comment", lambda rows: rows.__setitem__(5, rows[5] + "\tone\u2028two"), samples=1600),
    _v("a time a channel, all alike", each_row(_two_x), *TWO_X, samples=1600),
    _v(
        "a time a channel, one behind",
        each_row(lambda row: _two_x(row, "0.5")),
        *TWO_X,
        error="position_m has times of its own",
    ),
    _v(
        "no times",
        each_row(lambda row: "\t" + row.split("\t", 1)[1]),
        NO_X,
        samples=1600,
        notes=("X0 and Delta_X",),
    ),
    _v(
        "one channel starts later",
        lambda rows: None,
        NO_X,
        ("X0\t0.0E+0", "X0\t0.5"),
        error="'Voltage' .X0 0.5 s.* different clocks|different clocks",
    ),
    _v(
        "one channel is faster",
        lambda rows: None,
        NO_X,
        ("Delta_X\t0.000625", "Delta_X\t0.001"),
        error="different clocks",
    ),
    *(
        _v(f"a step of {step}", lambda rows: None, NO_X, ("0.000625", step), error=error)
        for step, error in (
            ("0", "no clock"),
            ("-1", "no clock"),
            ("nan", "no clock"),
            ("inf", "no clock"),
            ("1e-320", "too fine|more than any"),
            ("1e-9", "more than any"),
            ("fast", "Delta_X of the header is 'fast'"),
        )
    ),
    _v("no steps at all", lambda rows: None, NO_X, ("Delta_X", "Delta"), error="Delta_X of the header is ''"),
    _v("an infinite start", lambda rows: None, NO_X, ("0.0E+0", "inf"), error="no clock"),
    _v(
        "a strange decimal separator",
        lambda rows: None,
        ("Decimal_Separator\t.", "Decimal_Separator\t;"),
        error="Decimal_Separator",
    ),
    _v(
        "no end of the header",
        lambda rows: None,
        ("***End_of_Header***", "***"),
        error="not a LabVIEW measurement file",
    ),
    _v(
        "an empty line of column names",
        lambda rows: None,
        ("X_Value\tVoltage\tCurrent\tPosition\tCommand\t", "\n"),
        error="missing|X0|not a|no samples",
    ),
    _v("no rows", lambda rows: rows.clear(), error="no samples"),
    _v(
        "escapes in the header",
        lambda rows: None,
        ("Operator\tA. B.", f"Operator\t{ESCAPES[:-2]}"),
        samples=1600,
    ),
    _v("a channel twice", lambda rows: None, ("\tPosition", "\tCurrent"), error="position_m .*missing"),
    Scenario("LVM: an encoding that is another", lvm(), columns=LVM_MAP + "\n", samples=1600),
)

HOSTILE: tuple[Scenario, ...] = (*QUOTES, *ENDS, *FIELDS, *NUMBERS, *ENCODINGS, *PARQUET, *TDMS, *LVMS)
