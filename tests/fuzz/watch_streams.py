"""Mutated streams into watch, by hand: `python tests/fuzz/watch_streams.py --inputs 200000 --seed 0`.

Every input ends in a last line or in one line of refusal, all samples are taken or counted as left out, none takes 5 s or
makes the process grow to 1 GB. What breaks that is written to --finds.
"""

import argparse
import io
import json
import random
import resource
import sys
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.logs import PLAIN, ColumnMap
from observer_fi.physics import Scenario, csv_bytes, load_rig, synthesise
from observer_fi.physics.scenario import Move
from observer_fi.records import Event
from observer_fi.serve import Options, Watch
from observer_fi.serve.watch import warm_up
from observer_fi.settings import Settings
from observer_fi.verdict import log_verdict

SLOWEST_S, MOST_BYTES = 5.0, 1 << 30
TOKENS = (
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"9" * 400, b"", b",", b",,", b"\n", b"\r", b"\n\n", b'"', b"#",
    b"\x00", b"\xff\xfe", b"\xe2\x80\xa8", b"\x85", b"\x0c", b"{", b"}", b"[" * 200, b'{"time_s":', b"null", b"true", b"0x1f",
    b"1_0", b"-", b"+", b"e", b";", b"\t", b"|", b"0.5", b"-1", b"time_s", b"1e9", b"2,5", b"NaN", b"1" * 70000,
    b"()", b"\\u0000",
)  # fmt: skip


def seeds() -> list[list[bytes]]:
    """Streams that are right, as lines: CSV of a move's beginning, of a steady part, and JSON."""
    log = synthesise(Scenario((Move(0.02, 410.0, 0.1),), 0.2, seed=1), load_rig())[0]
    lines = csv_bytes(log).splitlines(keepends=True)
    header, rows = lines[1], lines[2:]
    names = header.decode().strip().split(",")
    objects = [
        json.dumps(dict(zip(names, map(float, row.split(b",")), strict=True))).encode() + b"\n"
        for row in rows[:80]
    ]
    return [
        [header, *rows[20:90]], [header, *rows[100:160]], objects, [header, *rows[:200]],
        [line.replace(b",", b";").replace(b".", b",") for line in (header, *rows[20:60])],
    ]  # fmt: skip


def mutated(lines: list[bytes], rng: random.Random) -> bytes:
    """A stream with a few things wrong."""
    lines = list(lines)
    for _ in range(rng.randint(1, 6)):
        k = rng.randrange(len(lines)) if lines else 0
        what = rng.randrange(9)
        if not lines:
            break
        if what == 0:
            del lines[k]
        elif what == 1:
            lines.insert(k, lines[rng.randrange(len(lines))])
        elif what == 2:
            a, b = sorted((k, rng.randrange(len(lines))))
            lines[a:b] = lines[a:b][::-1]
        elif what == 3:
            fields = lines[k].split(b",")
            fields[rng.randrange(len(fields))] = rng.choice(TOKENS)
            lines[k] = b",".join(fields)
        elif what == 4:
            at = rng.randrange(len(lines[k]) + 1)
            lines[k] = lines[k][:at] + rng.choice(TOKENS) + lines[k][at:]
        elif what == 5:
            at = rng.randrange(len(lines[k]) + 1)
            lines[k] = lines[k][:at]
        elif what == 6:
            line = bytearray(lines[k])
            for _ in range(rng.randint(1, 4)):
                if line:
                    line[rng.randrange(len(line))] = rng.randrange(256)
            lines[k] = bytes(line)
        elif what == 7:
            column, token = rng.randrange(6), rng.choice(TOKENS)
            for j in range(k, len(lines)):
                fields = lines[j].split(b",")
                if column < len(fields):
                    fields[column] = token
                lines[j] = b",".join(fields)
        else:
            lines += lines[: rng.randrange(len(lines))]
    return b"".join(lines)


class Order:
    """In place of the bank, which costs twenty times as much as the lines: looks whether samples come as a bank needs them."""

    def __init__(self) -> None:
        self.samples = self.moves = self.faulty = 0
        self.last = -np.inf

    def add(self, table: np.ndarray) -> Iterator[tuple]:
        assert table.shape[1] == 6 and np.isfinite(table[:, [0, 4, 5]]).all()
        assert not np.isinf(table).any() and (np.diff(table[:, 0], prepend=self.last) > 0.0).all()
        self.samples, self.last = self.samples + len(table), float(table[-1, 0])
        return iter(())

    def finish(self) -> Iterator[tuple]:
        return iter(())

    def verdict(self) -> Event:
        return log_verdict([])


class Lines(Watch):
    """watch without its bank."""

    def _new_live(self) -> Order:  # type: ignore[override]
        return Order()


def one(data: bytes, options: Options, rng: random.Random, kind: type[Watch]) -> str:
    """What became of a stream, in pieces of any size."""
    out, said = io.StringIO(), []
    flow = kind(options, "stream", out, said.append)
    try:
        at = 0
        while at < len(data):
            size = rng.choice((1, 61, 4099, 1 << 16)) if len(data) - at < 20_000 else 1 << 16
            flow.take(data[at : at + size])
            at += size
        flow.finish("the stream ended")
    except InvalidLogError as error:
        assert "\n" not in str(error), "a refusal of more than one line"
        return "refused"
    lines = [json.loads(line) for line in out.getvalue().splitlines()]
    assert lines[-1]["event"] == "end"
    assert all("\n" not in line for line in said)
    for line in lines:
        p = line.get("probability")
        assert p is None or 0.0 <= p <= 1.0 + 1e-9
    return str(lines[-1]["label"])


def run(inputs: int, seed: int, banks: float, finds: Path, seconds: float = 1e9) -> tuple[Counter, float]:
    """What became of so many inputs, counted, and the longest time of one [s]; what broke something is kept in `finds`."""
    rng, rig, counts, slowest = random.Random(seed), load_rig(), Counter(), 0.0
    maps = (PLAIN, ColumnMap(missing=("-999",)), ColumnMap(data_line=5))
    right = seeds()
    warm_up(
        Options(rig, Settings())
    )  # compiles where nothing is compiled yet, as the command does before its first line
    begin = time.monotonic()
    for k in range(inputs):
        data = mutated(rng.choice(right), rng)
        options = Options(
            rig, Settings(), rng.choice(maps), every=rng.choice((0, 0, 7)), quiet=rng.random() < 0.5
        )
        kind = Watch if rng.random() < banks else Lines
        before = time.monotonic()
        try:
            what = one(data, options, rng, kind)
        except Exception as error:
            what = f"FOUND {type(error).__name__}: {str(error)[:80]}"
        took = time.monotonic() - before
        what = "FOUND slow" if took > SLOWEST_S else what
        counts[f"{kind.__name__} {what}"] += 1
        if "FOUND" in what:
            finds.mkdir(parents=True, exist_ok=True)
            (finds / f"{seed}_{k}").write_bytes(data)
        slowest = max(slowest, took)
        if time.monotonic() - begin > seconds:
            break
    return counts, slowest


def main() -> int:
    """Run, print counts; 1 if anything was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument(
        "--banks", type=float, default=0.03, help="share of the inputs that go through the bank"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--finds", type=Path, default=Path("finds"))
    args = parser.parse_args()
    warnings.simplefilter("error")  # shown once a place by default: all but the first would be missed
    counts, slowest = run(args.inputs, args.seed, args.banks, args.finds, args.seconds)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"{sum(counts.values())} inputs, slowest {slowest:.2f} s, peak {peak / 1e6:.0f} MB")
    for what, number in counts.most_common():
        print(f"{number:8} {what}")
    return int(any("FOUND" in what for what in counts) or peak > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
