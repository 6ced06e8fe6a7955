"""EMPS: a Maxon DC motor with a high-precision ball screw, measured at ONERA, as logs of this project.

Janot, Gautier, Brunot, "Data set and reference models of EMPS", Workshop on Nonlinear System Identification Benchmarks
2019. The data carry no licence text, so none of them is in this project: download DATA_EMPS.mat and
DATA_EMPS_PULSES.mat from nonlinearbenchmark.org into a folder, and name it here or in OBSERVER_FI_DATA.
"""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.records import Array, Log
from observer_fi.report import write_file

FILES = {
    "DATA_EMPS.mat": "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
    "DATA_EMPS_PULSES.mat": "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
}
LEARN, PULSES = FILES
_BOTH = " and ".join(FILES)
WHERE = "nonlinearbenchmark.org (EMPS)"
VARIABLE = "OBSERVER_FI_DATA"
SOURCE = "Janot, Gautier, Brunot 2019, measured at ONERA"
# What the controller does, from the authors' description; it reproduces the logged command to 4 mV rms.
LIMIT_V = 10.0
COUNT_M = 5e-8  # 50 000 counts per motor turn of 2.5 mm
PULSE_V = 5.0695  # measured height of a pulse: `pulses_N` says 5


@dataclass(frozen=True)
class Run:
    """One file. t s; position, reference m; command V; pulse V (part of the command); gain N/V, kp 1/s, kv V s/m."""

    name: str
    sha256: str
    t: Array
    position: Array
    reference: Array
    command: Array
    pulse: Array
    gain: float
    kp: float
    kv: float


def find_folder(folder: str | Path | None = None) -> Path:
    """The folder that holds the files: the one named or OBSERVER_FI_DATA, or `emps` or `data/emps` in it. Raises UsageError."""
    named = folder or os.environ.get(VARIABLE)
    if not named:
        raise UsageError(
            f"no folder of EMPS data: download {_BOTH} from {WHERE} and name their folder, or set {VARIABLE}"
        )
    for place in (Path(named), Path(named) / "emps", Path(named) / "data" / "emps"):
        if any((place / name).exists() for name in FILES):
            return place
    raise UsageError(f"{named}: holds no {LEARN}; download {_BOTH} from {WHERE} into it")


def load(name: str, folder: str | Path | None = None) -> Run:
    """One file of the benchmark, checked. Raises UsageError if it is missing, InvalidLogError if it was altered."""
    if name not in FILES:
        raise UsageError(f"there is no EMPS file {name!r} (known: {', '.join(FILES)})")
    path = find_folder(folder) / name
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise UsageError(
            f"{path}: cannot read it ({error.strerror or error}); download it from {WHERE}"
        ) from error
    if digest != FILES[name]:
        raise InvalidLogError(
            f"{path}: the file is not the published one (sha256 {digest[:12]}..., expected {FILES[name][:12]}...); "
            f"download it again from {WHERE}"
        )
    raw = {
        key: np.asarray(value, dtype=np.float64).ravel()
        for key, value in loadmat(path).items()
        if key[0] != "_"
    }
    pulse = raw["pulses_N"] / 5.0 * PULSE_V if "pulses_N" in raw else np.zeros_like(raw["t"])
    scalars = (float(raw[key][0]) for key in ("gtau", "kp", "kv"))
    return Run(name, digest, raw["t"], raw["qm"], raw["qg"], raw["vir"], pulse, *scalars)


def to_log(run: Run) -> Log:
    """A run as a log of a rig driven by force: the commanded force is gain times command [N]."""
    n = run.t.size
    z = np.full((n, 3), np.nan)
    z[:, 2] = run.position
    return Log(
        path=run.name,
        t=run.t,
        z=z,
        w_cmd=np.full(n, np.nan),
        pitch=np.zeros(n),
        force=run.gain * run.command,
        sha256=run.sha256,
        metadata=(f"source: {SOURCE}", f"file: {run.name}", f"sha256: {run.sha256}"),
        notes=("current_a is absent: the drive is taken from force_cmd_n",),
    )


def convert(folder: str | Path | None, out: str | Path) -> list[Path]:
    """Writes both runs as CSV with the columns of the contract into `out`; returns the files."""
    written = []
    for name in FILES:
        log = to_log(load(name, folder))
        target = Path(out) / f"{Path(name).stem.lower()}.csv"
        rows = zip(log.t.tolist(), log.z[:, 2].tolist(), np.asarray(log.force).tolist(), strict=True)
        head = [*(f"# {line}" for line in log.metadata), "time_s,position_m,force_cmd_n"]
        write_file(target, "\n".join([*head, *(f"{t!r},{x!r},{f!r}" for t, x, f in rows)]) + "\n")
        written.append(target)
    return written
