"""`fleet`: a folder of short logs with one and with two local workers, and a second run over it."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from results import record

from observer_fi.physics import csv_bytes, drawn_scenario, load_rig, synthesise
from observer_fi.serve import fleet
from observer_fi.settings import Settings

LOGS = 120
LABELS = ("nominal", "overload", "coupling_loss")


def main() -> int:
    """Two workers against one, start-up and first log of each worker left out."""
    rig = load_rig()
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        logs = Path(folder) / "logs"
        logs.mkdir()
        for k in range(LOGS):
            scenario = drawn_scenario(np.random.default_rng(k), LABELS[k % 3], k % 2 == 0, k)
            (logs / f"log{k:03}.csv").write_bytes(csv_bytes(synthesise(scenario, rig)[0]))
        rates = {}
        for workers in (1, 2):
            job = fleet.Job(logs, Path(folder) / f"out{workers}", rig, Settings())
            names = fleet.find_logs(job)
            ends = []
            found = []
            for row in fleet.run(job, names, workers):
                ends.append(time.perf_counter())
                found.append(row)
            first = 2 * workers
            rates[workers] = (len(ends) - first) / (ends[-1] - ends[first - 1])
            rows.append(
                (
                    f"{workers} worker{'s' * (workers > 1)}",
                    f"{rates[workers]:.2f}",
                    f"{rates[workers] / rates[1]:.2f}",
                )
            )
            fleet.write_summary(job, found)
        begin = time.perf_counter()
        fleet.split(job, names)
        again = LOGS / (time.perf_counter() - begin)
        rows.append(("second run, nothing to do", f"{again:.0f}", ""))
    notes = f"{LOGS} simulated moves as CSV, each with its whole report. Rates after the first two logs of each worker."
    record("5 fleet", "Fleets", ("run", "logs a second", "times one worker"), rows, notes)
    return 0


if __name__ == "__main__":
    sys.exit(main())
