"""`watch`: from a line in to a line out, at 1600 lines a second; lines a second fed fast; memory of a long stream.

With `--day` a day of samples is fed instead, 138 240 000 lines (minutes; `--day 0.01` feeds a hundredth of it).
"""

import argparse
import io
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from results import command_line, record
from sample_logs import csv_log

from observer_fi.physics import Fault, Move, Scenario, csv_bytes, load_rig, synthesise
from observer_fi.serve import Options, Watch
from observer_fi.settings import Settings

RATE_HZ = 1600.0
PACED = 9600
TURNS = 40

MINUTES = 1440  # a day
MOVES = tuple(Move(0.3 + 3.0 * k, 410.0 * (-1) ** k, 2.0) for k in range(20))  # forth and back in a minute
FAULTS = (Fault("coupling_loss", 31.0), Fault("overload", 31.0), Fault("sensor_frozen", 31.0, "current"))
FAULTY = 60  # one minute in so many has a fault
SHARES = (0.01, 0.1, 0.5, 1.0)


def start(*arguments: str) -> subprocess.Popen[bytes]:
    """The command with pipes."""
    return subprocess.Popen(
        command_line("watch", *arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )  # fmt: skip


def paced(lines: list[bytes]) -> np.ndarray:
    """Seconds from each line in to its line out, sample by sample (--every 1)."""
    child = start("--every", "1")
    assert child.stdin is not None and child.stdout is not None
    sent, came = [], []

    def collect() -> None:
        for line in child.stdout or ():
            if b'"sample"' in line:
                came.append(time.perf_counter())

    reader = threading.Thread(target=collect)
    reader.start()
    write = child.stdin.fileno()
    os.write(write, lines[0])
    time.sleep(4.0)  # the kernels are loaded
    begin = time.perf_counter()
    for k, line in enumerate(lines[1:]):
        while time.perf_counter() < begin + k / RATE_HZ:
            time.sleep(1e-4)
        sent.append(time.perf_counter())
        os.write(write, line)
    child.stdin.close()
    reader.join()
    child.wait()
    held = 64  # the first samples wait for each other
    n = min(len(sent), len(came))
    return np.array(came[held:n]) - np.array(sent[held:n])


def alone(lines: list[bytes]) -> np.ndarray:
    """Seconds of processor time from each line to its output, in this process."""
    flow = Watch(Options(load_rig(), Settings(), every=1), "stream", io.StringIO(), print)
    flow.take(b"".join(lines[:80]))
    found = []
    for line in lines[80:]:
        begin = time.thread_time()
        flow.take(line)
        found.append(time.thread_time() - begin)
    return np.array(found)


def fast(lines: list[bytes]) -> tuple[float, float, float]:
    """Microseconds of processor time a line, resident MB after a tenth of the stream and at its end."""
    child = start()
    assert child.stdin is not None
    child.stdin.write(lines[0])
    rows = [[float(v) for v in line.split(b",")] for line in lines[1:]]
    sizes = []
    for turn in range(TURNS):
        text = "".join(
            f"{r[0] + 10.0 * turn:.6f}," + ",".join(f"{v:.7g}" for v in r[1:]) + "\n" for r in rows
        )
        child.stdin.write(text.encode())
        child.stdin.flush()
        sizes.append(resident_mb(child.pid))
    child.stdin.close()
    _, _, usage = os.wait4(child.pid, 0)
    child.returncode = 0
    each = (usage.ru_utime + usage.ru_stime) / (TURNS * len(rows))
    return each, sizes[TURNS // 10], sizes[-1]


def resident_mb(process: int) -> float:
    """Resident memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Minute:
    """The text of a minute of samples, of which only the seconds are written anew: the producer must not be what is measured."""

    def __init__(self, fault: Fault, seed: int) -> None:
        log, _ = synthesise(Scenario(MOVES, 60.0, fault=fault, seed=seed), load_rig())
        rows = [line.split(",", 1)[1] for line in csv_bytes(log).decode().splitlines()[-log.t.size :]]
        lines = [f"{k % RATE_HZ / RATE_HZ:012.6f},{row}\n" for k, row in enumerate(rows)]
        starts = np.cumsum([0, *(len(line) for line in lines[:-1])])
        self.text = np.frombuffer("".join(lines).encode(), dtype=np.uint8).copy()
        self.digits = starts + np.arange(5)[:, None]

    def at(self, minute: int) -> bytes:
        """The text with the clock of that minute of the day."""
        seconds = np.repeat(60 * minute + np.arange(60), int(RATE_HZ))
        for place, at in zip((10_000, 1000, 100, 10, 1), self.digits, strict=True):
            self.text[at] = ord("0") + seconds // place % 10
        return self.text.tobytes()


class Day(NamedTuple):
    """What a day cost: seconds of processor time, of wall clock, MB by share of the day, the last line, verdicts by label."""

    cpu: float
    wall: float
    memory: dict[float, float]
    end: dict
    verdicts: Counter[str]


def day(minutes: int) -> Day:
    """Feed the command so many minutes of samples, as fast as it takes them."""
    healthy, faulty = [Minute(Fault(), seed) for seed in (1, 2, 3)], [Minute(fault, 4) for fault in FAULTS]
    child = start()
    assert child.stdin is not None and child.stdout is not None
    verdicts: Counter[str] = Counter()
    end: dict = {}

    def collect() -> None:
        for line in child.stdout or ():
            end.update(json.loads(line))
            verdicts[end["label"]] += end["event"] == "verdict"

    reader = threading.Thread(target=collect)
    reader.start()
    begin, memory = time.perf_counter(), {}
    child.stdin.write(csv_header())
    for k in range(minutes):
        kind = faulty[k // FAULTY % len(faulty)] if k % FAULTY == FAULTY // 2 else healthy[k % len(healthy)]
        child.stdin.write(kind.at(k))
        child.stdin.flush()
        memory |= {
            share: resident_mb(child.pid) for share in SHARES if k + 1 == max(1, round(share * minutes))
        }
    child.stdin.close()
    reader.join()
    _, _, usage = os.wait4(child.pid, 0)
    child.returncode = 0
    return Day(usage.ru_utime + usage.ru_stime, time.perf_counter() - begin, memory, end, verdicts)


def csv_header() -> bytes:
    """The line with the column names."""
    return next(
        line for line in csv_log().read_bytes().splitlines(keepends=True) if not line.startswith(b"#")
    )


def record_day(days: float) -> None:
    """The table of a day."""
    found = day(round(MINUTES * days))
    lines = found.end["samples"]
    told = ", ".join(f"{label} {count}" for label, count in sorted(found.verdicts.items()))
    rows = [
        ("lines", f"{lines}"),
        ("lines skipped", f"{found.end['skipped']}"),
        ("moves", f"{found.end['move']}"),
        ("verdicts that changed, by label", told),
        ("processor time of the command [s]", f"{found.cpu:.0f}"),
        ("processor time a line [us]", f"{1e6 * found.cpu / lines:.2f}"),
        ("wall clock [s]", f"{found.wall:.0f}"),
        *((f"memory after {100 * share:g} % of the lines [MB]", f"{mb:.1f}") for share, mb in found.memory.items()),
    ]  # fmt: skip
    notes = (
        f"{days:g} day of samples at {RATE_HZ:g} Hz through standard input, 20 moves a minute; one minute in {FAULTY} has a "
        "fault from its middle on (a lost coupling, an overload, a frozen current sensor), and the next one none again. Written "
        "by `bench_watch.py --day`."
    )
    record("4 watch a day", "Live streams: a day", ("figure", "value"), rows, notes)


def record_short() -> None:
    """Latency, then speed and memory."""
    lines = [line + b"\n" for line in csv_log().read_bytes().splitlines() if not line.startswith(b"#")]
    delay = 1e3 * paced(lines[: PACED + 1])
    each, early, late = fast(lines)
    inside = 1e3 * alone(lines[: PACED + 1])
    rows = [
        ("processor time from a line to its output, median [ms]", f"{np.percentile(inside, 50):.3f}"),
        ("its 99th percentile [ms]", f"{np.percentile(inside, 99):.3f}"),
        ("wall clock from a line in to a line out, median [ms]", f"{np.percentile(delay, 50):.3f}"),
        ("its 90th percentile [ms]", f"{np.percentile(delay, 90):.3f}"),
        ("its 99th percentile [ms]", f"{np.percentile(delay, 99):.3f}"),
        ("fed fast: processor time a line, start-up included [us]", f"{1e6 * each:.1f}"),
        (f"memory after {TURNS * (len(lines) - 1) // 10} lines [MB]", f"{early:.1f}"),
        (f"memory after {TURNS * (len(lines) - 1)} lines [MB]", f"{late:.1f}"),
    ]
    notes = (
        "The delay is measured from outside, through two pipes and the reader's own thread, with `--every 1`."
    )
    record("4 watch", "Live streams", ("figure", "value"), rows, notes)


def main() -> int:
    """The short figures, or those of a day."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--day", type=float, nargs="?", const=1.0, default=0.0, help="feed that many days")
    days = parser.parse_args().day
    if days:
        record_day(days)
    else:
        record_short()
    return 0


if __name__ == "__main__":
    sys.exit(main())
