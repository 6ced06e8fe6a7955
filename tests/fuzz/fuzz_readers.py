"""A mutation loop over every reader: bytes of right files cut, flipped, repeated and mixed, until one breaks a promise.

    python tests/fuzz/fuzz_readers.py csv --count 200000 --seed 1

What may come of an input: a log in which every row is a sample or listed, or one line of refusal. Anything else (another
exception, text on the terminal, more than 5 s, a peak above 1 GB) is a find: its bytes are written to `--finds`.
"""

import argparse
import gzip
import io
import resource
import sys
import tempfile
import time
import tomllib
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from hostile_logs import LVM, LVM_MAP, TDMS_MAP, parquet, tdms  # noqa: E402
from hostile_tables import MAPS, RIG, RIGS, SETTINGS  # noqa: E402
from scenarios import COLUMNS, csv_text, healthy_rows  # noqa: E402

from observer_fi.errors import InvalidLogError, UsageError  # noqa: E402
from observer_fi.logs.columns import PLAIN, ColumnMap, columns_from_table, load_columns  # noqa: E402
from observer_fi.logs.ingest import open_log  # noqa: E402
from observer_fi.logs.inspection.inspection import inspect_log  # noqa: E402
from observer_fi.logs.line_parser import BrokenLineError, Clock, Parser, lines_of  # noqa: E402
from observer_fi.physics.rigs import load_rig  # noqa: E402
from observer_fi.report.inspection import inspection_text  # noqa: E402
from observer_fi.settings import load_settings  # noqa: E402

SLOWEST_S, MOST_KB = 5.0, 1 << 20
TOKENS = (
    b'"',
    b'""',
    b"\n",
    b"\r",
    b"\r\n",
    b",",
    b";",
    b"\t",
    b"#",
    b"\x00",
    b"\xff",
    b"\xc2\x85",
    b"\xe2\x80\xa8",
    b"\x0c",
    b"nan",
    b"inf",
    b"1e308",
    b"-1e308",
    b"5e-324",
    b"1e400",
    b"9" * 400,
    b"[" * 50,
    b"{" * 50,
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\x00\x00\x00\x00",
    b"-1",
    b"0",
    b"true",
    b"''",
    b"time_s",
    b"PAR1",
    b"TDSm",
    b"\x1b[31m",
    b"=",
    b" ",
)


def mutated(seeds: list[bytes], rng: np.random.Generator) -> bytes:
    """One of the seeds after one to eight changes."""
    data = bytearray(seeds[rng.integers(len(seeds))])
    for _ in range(min(int(rng.geometric(0.4)), 8)):
        CHANGES[rng.integers(len(CHANGES))](data, seeds, rng)
    return bytes(data[: 1 << 20])


def _place(data: bytearray, rng: np.random.Generator) -> int:
    return int(rng.integers(len(data) + 1))


def _flip(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    if data:
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))


def _token(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    at, token = _place(data, rng), TOKENS[rng.integers(len(TOKENS))]
    data[at : at + int(rng.integers(0, 2)) * len(token)] = token


def _cut(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    at = _place(data, rng)
    del data[at : at + int(rng.integers(1, 200))]


def _end(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    if rng.random() < 0.2:
        del data[_place(data, rng) :]


def _repeat(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    at = _place(data, rng)
    piece = bytes(data[at : at + int(rng.integers(1, 100))])
    data[at:at] = piece * int(rng.integers(1, 20))


def _mix(data: bytearray, seeds: list[bytes], rng: np.random.Generator) -> None:
    other = seeds[rng.integers(len(seeds))]
    at, size = int(rng.integers(len(other) + 1)), int(rng.integers(1, 300))
    to = _place(data, rng)
    data[to : to + size] = other[at : at + size]


CHANGES = (_flip, _flip, _token, _token, _cut, _end, _repeat, _mix)


# --- what is fed ---------------------------------------------------------------------------------


def read_as(name: str, column_map: ColumnMap, packed: bool = False) -> Callable[[bytes, Path], str]:
    """A reader's target: the outcome in a word."""

    def run(data: bytes, folder: Path) -> str:
        path = folder / name
        path.write_bytes(gzip.compress(data, 1) if packed else data)
        try:
            file = open_log(path, column_map)
            logs = list(file.chunks(500))
        except InvalidLogError as error:
            _check_line(str(error))
            return "refused"
        samples = sum(log.t.size for log in logs)
        assert samples == file.summary.samples and all((np.diff(log.t) > 0.0).all() for log in logs)
        assert all(text.isprintable() for text in (*file.metadata, *file.summary.notes)), file.metadata
        return "listed" if file.summary.rejected_count else "read"

    return run


def load_with(load: Callable[[Path], object]) -> Callable[[bytes, Path], str]:
    def run(data: bytes, folder: Path) -> str:
        path = folder / "given.toml"
        path.write_bytes(data)
        try:
            load(path)
        except UsageError as error:
            _check_line(str(error))
            return "refused"
        return "read"

    return run


def parse_lines(data: bytes, folder: Path) -> str:
    """The lines of a stream, one by one and on one clock."""
    parser, clock, said = Parser("stream", PLAIN), Clock(), Counter[str]()
    rows = 0
    try:
        for line in lines_of(data + b"\n"):
            try:
                row = parser.row(line)
            except BrokenLineError:
                said["skipped"] += 1
                continue
            if row is not None:
                rows += sum(
                    ready is not None for ready in clock.take(row, lambda what, _=1: said.update([what]))
                )
        rows += len(list(clock.finish(lambda what, _=1: said.update([what]))))
    except InvalidLogError as error:
        _check_line(str(error))
        return "refused"
    return "listed" if said else "read"


def _check_line(message: str) -> None:
    assert message.isprintable() and len(message) <= 2000, message[:300]


def _bytes_of(write: Callable[[Path], Path]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return write(Path(folder)).read_bytes()


def _map(text: str) -> ColumnMap:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "map.toml").write_text(text, encoding="utf-8")
        return load_columns(Path(folder) / "map.toml")


def small_rows(count: int = 60) -> list[list[str]]:
    return healthy_rows()[300 : 300 + count]


def text_seeds() -> list[bytes]:
    rows = small_rows()
    remarks = [[*row, f'"a, {k}"'] for k, row in enumerate(rows)]
    german = [[t.replace(".", ",") for t in row] for row in rows]
    return [
        csv_text(rows).encode(),
        b"# a\n# b\n" + csv_text(rows, end="\r\n").encode(),
        csv_text(rows).encode("utf-16"),
        csv_text(remarks, (*COLUMNS, "remark")).encode(),
        csv_text(german, separator=";").encode(),
        b"\xef\xbb\xbf" + csv_text(rows, separator="\t").encode(),
    ]


def lvm_seeds() -> list[bytes]:
    head, body = LVM.split("Comment\n", 1)
    text = head + "Comment\n" + "\n".join(body.splitlines()[:60]) + "\n"
    return [
        text.encode(),
        text.replace("X_Columns\tOne", "X_Columns\tNo").encode(),
        text.replace("\n", "\r\n").encode(),
    ]


def parquet_seeds() -> list[bytes]:
    def short(columns: dict) -> None:
        for name in columns:
            columns[name] = columns[name][300:360]

    def texts(columns: dict) -> None:
        short(columns)
        columns["current_a"] = [f"{x:.6f}" for x in columns["current_a"]]

    return [
        _bytes_of(parquet(short, group=20)),
        _bytes_of(parquet(texts)),
        _bytes_of(parquet(short, metadata={"rig": "3"})),
    ]


def tdms_seeds() -> list[bytes]:
    def short(channels: dict) -> None:
        for name, (values, properties) in channels.items():
            channels[name] = (values[300:360], properties)

    def slower(channels: dict) -> None:
        short(channels)
        values, properties = channels["Position"]
        channels["Position"] = (values[::4], properties | {"wf_increment": 4 / 1600})

    return [_bytes_of(tdms(short)), _bytes_of(tdms(slower))]


def mat_seeds() -> list[bytes]:
    from scipy.io import savemat

    channels = {name: [float(row[k]) for row in small_rows()] for k, name in enumerate(COLUMNS)}

    def of_version_5(packed: bool) -> Callable[[Path], Path]:
        def write(folder: Path) -> Path:
            savemat(folder / "run.mat", {**channels, "Rm": 20.2}, do_compression=packed)
            return folder / "run.mat"

        return write

    def of_version_7(folder: Path) -> Path:
        import h5py

        with h5py.File(folder / "run.mat", "w") as file:
            for name, values in channels.items():
                file[name] = np.atleast_2d(values)
        return folder / "run.mat"

    return [_bytes_of(of_version_5(False)), _bytes_of(of_version_5(True)), _bytes_of(of_version_7)]


def stamp_seeds() -> list[bytes]:
    rows = [[f"2026-03-02T08:00:00.{k:03d}", *row[1:]] for k, row in enumerate(small_rows())]
    german = [[f"02.03.2026 08:00:00,{k:03d}", *row[1:]] for k, row in enumerate(small_rows())]
    return [csv_text(rows).encode(), csv_text(german, separator=";").encode()]


def inspect_it(data: bytes, folder: Path) -> str:
    path = folder / "log.csv"
    path.write_bytes(data)
    try:
        found = inspect_log(str(path))
    except InvalidLogError as error:
        _check_line(str(error))
        return "refused"
    columns_from_table(tomllib.loads(found.column_map))
    assert all(line.isprintable() for line in inspection_text(found).splitlines())
    return "listed" if found.refused or found.doubts else "read"


def table_seeds(*texts: str) -> list[bytes]:
    return [text.encode("utf-8", "replace") for text in texts if len(text) < 10_000]


JSON = b"".join(
    b'{"time_s": %s, "voltage_v": %s, "current_a": %s, "position_m": %s, "pitch_deg": %s, "speed_cmd_rad_s": %s}\n'
    % tuple(text.encode() for text in row)
    for row in healthy_rows()[300:340]
)
TARGETS: dict[str, Callable[[], tuple[list[bytes], Callable[[bytes, Path], str]]]] = {
    "csv": lambda: (text_seeds(), read_as("log.csv", PLAIN)),
    "gz": lambda: ([gzip.compress(seed) for seed in text_seeds()], read_as("log.csv.gz", PLAIN)),
    "lvm": lambda: (lvm_seeds(), read_as("log.lvm", _map(LVM_MAP))),
    "parquet": lambda: (parquet_seeds(), read_as("log.parquet", PLAIN)),
    "tdms": lambda: (tdms_seeds(), read_as("log.tdms", _map(TDMS_MAP))),
    "mat": lambda: (mat_seeds(), read_as("log.mat", PLAIN)),
    "stamps": lambda: (stamp_seeds(), read_as("log.csv", PLAIN)),
    "inspect": lambda: ([*text_seeds(), *stamp_seeds()], inspect_it),
    "rig": lambda: (table_seeds(*[RIG] * len(RIGS), *RIGS), load_with(load_rig)),
    "settings": lambda: (table_seeds(*SETTINGS), load_with(load_settings)),
    "map": lambda: (table_seeds(LVM_MAP, TDMS_MAP, *MAPS), load_with(load_columns)),
    "lines": lambda: ([*text_seeds(), JSON], parse_lines),
}


def fuzz(
    target: str, count: int, seed: int, finds: Path | None = None, seconds: float = float("inf")
) -> Counter[str]:
    """Outcomes of `count` mutated inputs, or of those that `seconds` are enough for."""
    seeds, run = TARGETS[target]()
    rng, outcomes = np.random.default_rng(seed), Counter[str]()
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as name:
        for k in range(count):
            if time.monotonic() > end:
                break
            data = mutated(seeds, rng)
            outcome = _watched(run, data, Path(name))
            outcomes[outcome] += 1
            if outcome.startswith("FIND") and finds is not None:
                finds.mkdir(parents=True, exist_ok=True)
                (finds / f"{target}_{seed}_{k}.bin").write_bytes(data)
    return outcomes


def _watched(run: Callable[[bytes, Path], str], data: bytes, folder: Path) -> str:
    before, peak, out = time.perf_counter(), _peak_kb(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(out):
            outcome = run(data, folder)
    except Exception as error:  # what a reader must never leak
        return f"FIND {type(error).__name__}: {str(error)[:80]!r}"
    if out.getvalue():
        return f"FIND text on the terminal: {out.getvalue()[:80]!r}"
    if time.perf_counter() - before > SLOWEST_S:
        return f"FIND {time.perf_counter() - before:.1f} s"
    if _peak_kb() - peak > MOST_KB:  # what ran before in this process has a peak of its own
        return "FIND more than 1 GB"
    return outcome


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("target", choices=[*TARGETS, "all"])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="of each target, at most")
    parser.add_argument("--finds", type=Path, default=Path("finds"))
    given = parser.parse_args()
    warnings.simplefilter("error")  # shown once a place by default: all but the first would be missed
    found = 0
    for target in TARGETS if given.target == "all" else [given.target]:
        outcomes = fuzz(target, given.count, given.seed, given.finds, given.seconds)
        found += sum(count for outcome, count in outcomes.items() if outcome.startswith("FIND"))
        print(target, outcomes.total(), dict(outcomes.most_common(12)), flush=True)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
