"""`watch`: from a line in to a line out, at 1600 lines a second; lines a second fed fast; memory of a long stream."""

import io
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
from results import command_line, record
from sample_logs import csv_log

from observer_fi.models import load_rig
from observer_fi.settings import Settings
from observer_fi.watch import Options, Watch

RATE_HZ = 1600.0
PACED = 9600
TURNS = 40


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
        sizes.append(int(Path(f"/proc/{child.pid}/statm").read_text().split()[1]) * 4096 / 1e6)
    child.stdin.close()
    _, _, usage = os.wait4(child.pid, 0)
    child.returncode = 0
    each = (usage.ru_utime + usage.ru_stime) / (TURNS * len(rows))
    return each, sizes[TURNS // 10], sizes[-1]


def main() -> int:
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
    return 0


if __name__ == "__main__":
    sys.exit(main())
