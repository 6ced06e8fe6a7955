"""Whole processes: a short log, an hour, ten hours, and the other commands. Wall clock, processor time, peak memory."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from results import Process, command_line, process, record
from sample_logs import csv_log, foreign_csv, healthy_csv, parquet_log

COLUMNS = ("command", "wall clock [s]", "processor time [s]", "peak memory [MB]")
NOTES = (
    "Warm caches. The hour has 1200 moves at 1600 samples/s (5.76 million samples); a coupling is lost half-way, so half of its "
    "moves are faulty. Ten hours is that hour ten times, with the clock running on."
)


def made_apart(make: Callable[..., Path], *arguments: float) -> str:
    """A log made in a process of its own: a child's peak of memory begins with what its parent has resident."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
        return str(apart.submit(make, *arguments).result())


def main() -> int:
    """Each command once or a few times, as processes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--skip-long", action="store_true", help="leave the ten hours out")
    args = parser.parse_args()
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory() as out:

        def measure(name: str, *command: str, runs: int = 1) -> None:
            try:
                found: Process | None = process(*command, runs=runs)
            except RuntimeError as error:
                rows.append((name, str(error).splitlines()[0][-60:], "", ""))
                return
            rows.append((name, *(f"{value:.3g}" for value in found)))

        def run(name: str, *arguments: str, runs: int = 1) -> None:
            measure(name, *command_line(*arguments, "--out", out), runs=runs)

        short, healthy = made_apart(csv_log), made_apart(healthy_csv)
        for command, log in (("diagnose", short), ("identify", short), ("improve", healthy)):
            run("", command, log)  # compiles where nothing is cached
        rows.clear()
        measure("python -c pass", sys.executable, "-c", "pass", runs=5)
        measure("observer-fi --version", *command_line("--version"), runs=5)
        run("diagnose, 10 s CSV, with report", "diagnose", short, runs=5)
        run("diagnose, 10 s CSV, UKF", "diagnose", short, "--filter", "ukf", runs=3)
        run(
            "diagnose, 10 s CSV, a ripple that the rig file lacks",
            "diagnose",
            made_apart(foreign_csv),
            runs=3,
        )
        run("identify, 60 s CSV", "identify", healthy)
        run("improve, 60 s CSV", "improve", healthy)
        run("diagnose, an hour of Parquet", "diagnose", made_apart(parquet_log, 1.0))
        if not args.skip_long:
            run("diagnose, ten hours of Parquet", "diagnose", made_apart(parquet_log, 1.0, 10))
    record("2 process", "Whole processes", COLUMNS, rows, NOTES)
    return 0


if __name__ == "__main__":
    sys.exit(main())
