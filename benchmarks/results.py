"""Figures of the benchmarks: each script records its table, and reports/benchmarks.md is written anew from all tables."""

import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "reports" / "benchmarks.json"
PAGE = ROOT / "reports" / "benchmarks.md"
PACKAGES = (
    "observer-fi",
    "numpy",
    "numba",
    "filterpy",
    "pyarrow",
    "dask",
    "stonesoup",
    "progpy",
    "dynamax",
    "jax",
)


class Cost(NamedTuple):
    """Seconds of wall clock and of processor time, medians of several runs."""

    wall: float
    cpu: float


def timed(call: Callable[[], object], runs: int = 5, warm: bool = False) -> Cost:
    """Median cost of a call, after one that warms up unless it is warm."""
    if not warm:
        call()
    walls, cpus = [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return Cost(statistics.median(walls), statistics.median(cpus))


def timed_against(
    call: Callable[[], object], yardstick: Callable[[], object], runs: int
) -> tuple[Cost, float]:
    """Median cost of a call, and the median of processor time of a yardstick over its own, one after the other each run.

    A machine that changes its pace between two measurements changes both of a pair.
    """
    call()
    pairs = [(timed(yardstick, 1, warm=True), timed(call, 1, warm=True)) for _ in range(runs)]
    cost = Cost(*(statistics.median(values) for values in zip(*(own for _, own in pairs), strict=True)))
    return cost, statistics.median(other.cpu / own.cpu for other, own in pairs)


class Process(NamedTuple):
    """What a process cost: seconds of wall clock and of processor time, resident memory at its peak [MB]."""

    wall: float
    cpu: float
    peak_mb: float


def process(*command: str, runs: int = 1) -> Process:
    """Median cost of whole processes. Raises RuntimeError where one fails."""
    found = []
    for _ in range(runs):
        start = time.perf_counter()
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}")
        wall = time.perf_counter() - start
        found.append(Process(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0))
    return Process(*(statistics.median(values) for values in zip(*found, strict=True)))


def command_line(*arguments: str) -> tuple[str, ...]:
    """The command observer-fi in this interpreter."""
    return (sys.executable, "-m", "observer_fi", *arguments)


def record(
    section: str, heading: str, columns: tuple[str, ...], rows: list[tuple[object, ...]], notes: str
) -> None:
    """Keep one table, and write the page."""
    tables = json.loads(STORE.read_text()) if STORE.exists() else {}
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    tables[section] = {
        "heading": heading, "columns": columns, "rows": [[str(cell) for cell in row] for row in rows], "notes": notes,
        "machine": machine(), "versions": versions(), "load": round(load, 1),
    }  # fmt: skip
    STORE.parent.mkdir(exist_ok=True)
    STORE.write_text(json.dumps(tables, indent=1, sort_keys=True) + "\n")
    PAGE.write_text(page(tables))
    for row in rows:
        print("  ", " | ".join(str(cell) for cell in row))


def page(tables: dict[str, dict]) -> str:
    """All tables as Markdown."""
    lines = [
        "# Benchmarks", "",
        "Written by `make bench`; medians of several runs in one process unless it says otherwise. Wall clock counts for people, "
        "processor time where other programs share the machine: the load is that of the machine when a table was made.", "",
    ]  # fmt: skip
    for _, table in sorted(tables.items()):
        lines += [f"## {table['heading']}", ""]
        lines += ["| " + " | ".join(table["columns"]) + " |", "|" + "---|" * len(table["columns"])]
        lines += ["| " + " | ".join(row) + " |" for row in table["rows"]]
        lines += ["", table["notes"], ""] if table["notes"] else [""]
        lines += [f"{table['machine']}; load {table['load']}; {table['versions']}.", ""]
    return "\n".join(lines)


def machine() -> str:
    """Processor, cores and Python."""
    model = platform.processor() or platform.machine()
    known = Path("/proc/cpuinfo")
    if known.exists():
        names = [
            line.split(":")[1].strip()
            for line in known.read_text().splitlines()
            if line.startswith("model name")
        ]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def versions() -> str:
    """Versions of what takes part."""
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def micro(seconds: float) -> str:
    """Microseconds, three digits."""
    return f"{1e6 * seconds:.3g}"
