"""Simulated logs of any length for the benchmarks, kept in a folder outside the checkout."""

import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from observer_fi.physics import Fault, Move, Rig, Scenario, csv_bytes, load_rig, synthesise, with_values
from observer_fi.records import Log

FOLDER = Path(tempfile.gettempdir()) / "observer_fi_bench"
COLUMNS = ("time_s", "voltage_v", "current_a", "position_m", "pitch_deg", "speed_cmd_rad_s")
HEALTHY = Fault()
BEAT_S = 3.0  # a move of two seconds and a rest of one
RIPPLE = 4e-3  # N m, with the turns of the screw: of a machine that its rig file does not describe


def moves_log(seconds: float, fault: Fault = HEALTHY, seed: int = 1, rig: Rig | None = None) -> Log:
    """Moves forth and back, 1600 samples a second."""
    count = int((seconds - 0.3) // BEAT_S)
    moves = tuple(Move(0.3 + BEAT_S * k, 410.0 * (-1) ** k, 2.0) for k in range(count))
    return synthesise(Scenario(moves, seconds, fault=fault, seed=seed), rig or load_rig())[0]


def csv_log() -> Path:
    """A CSV file of 10 s: three moves, and a coupling lost in the last."""
    return _csv("broken_10s.csv", 10.0, Fault("coupling_loss", 7.0))


def healthy_csv() -> Path:
    """A CSV file of 60 s: twenty moves."""
    return _csv("healthy_60s.csv", 60.0, HEALTHY)


def foreign_csv() -> Path:
    """A CSV file of 10 s: three moves of a machine with a ripple that its rig file does not have, each in doubt."""
    return _csv("ripple_10s.csv", 10.0, HEALTHY, with_values(load_rig(), {"screw_ripple_sin": RIPPLE}))


def _csv(name: str, seconds: float, fault: Fault, rig: Rig | None = None) -> Path:
    path = FOLDER / name
    if not path.exists():
        FOLDER.mkdir(exist_ok=True)
        path.write_bytes(csv_bytes(moves_log(seconds, fault, rig=rig)))
    return path


def parquet_log(hours: float, times: int = 1) -> Path:
    """A Parquet file of `hours`, repeated `times` with the clock running on; a coupling lost half-way."""
    path = FOLDER / f"moves_{hours:g}h_{times}.parquet"
    if path.exists():
        return path
    FOLDER.mkdir(exist_ok=True)
    seconds = 3600.0 * hours
    log = moves_log(seconds, Fault("coupling_loss", 0.5 * seconds + 1.0))
    table = np.column_stack((log.t, log.z, log.pitch, log.w_cmd))
    schema = pa.schema([(name, pa.float64()) for name in COLUMNS])
    with pq.ParquetWriter(path.with_suffix(".part"), schema) as writer:
        for k in range(times):
            for first in range(0, len(table), 1 << 20):
                part = table[first : first + (1 << 20)]
                shifted = [part[:, 0] + k * seconds, *part[:, 1:].T]
                writer.write_table(pa.table([pa.array(column) for column in shifted], schema=schema))
    path.with_suffix(".part").rename(path)
    return path
