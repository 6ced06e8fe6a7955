"""The two rigs of docs/new-rig.md: their truth, and their logs as their loggers write them.

PYTHONPATH=tests python tests/documented_rigs.py FOLDER
"""

import sys
from dataclasses import replace
from pathlib import Path

import hidden
import numpy as np
import pandas as pd

_RPM = np.pi / 30.0


def slide() -> hidden.Actuator:
    """24 V on a ball screw of 4 mm, 6 kg, half a metre: voltage, current and position at 1 kHz through 12 bits."""
    Km, D, rotor = 1.0 / (184.0 * _RPM) * 1.02, 4e-3 / (2.0 * np.pi), 5.2e-5
    rig = hidden.Rig(
        Rm=2.3, Rs=0.07, Km=Km, D=D, Vmax=24.0, accel=2400.0, J=1.1 * rotor + 6.0 * D**2, A=0.02, B=0.0, C=0.02 / 9e-6,
        E=0.4, A_loose=0.011, J_loose=1.1 * rotor, Kp=0.12, Ki=4.0, stop_low_m=-1.0, stop_high_m=1.0,
    )  # fmt: skip
    logger = hidden.Logger(1000.0, 8e-3, 2e-3, 1e-5)
    return hidden.Actuator(
        1, "voltage", rig, 60.0, rotor, 1.0, 4e-3, 6.0, 0.5, 250.0, 2.0, logger, (0.0122, 0.0024, 1e-5), 0.0
    )


def lift() -> hidden.Actuator:
    """A gear motor of 14:1 on a screw of 1 mm: current and position, 500 times a second."""
    Km, D, rotor = 0.0175 * 0.97, 1e-3 / (2.0 * np.pi * 14.0), 2.6e-7
    rig = hidden.Rig(
        Rm=8.1, Rs=0.3, Km=Km, D=D, Vmax=18.0, accel=5000.0, J=1.2 * rotor, A=6e-4, B=0.0, C=6e-4 / 2.5e-6, E=0.5,
        A_loose=4e-4, J_loose=1.1 * rotor, Kp=3e-3, Ki=0.25, stop_low_m=-1.0, stop_high_m=1.0,
    )  # fmt: skip
    logger = hidden.Logger(500.0, 8e-3, 1e-3, 4e-6)
    return hidden.Actuator(
        2, "current", rig, 4.0, rotor, 14.0, 1e-3, 2.0, 0.02, 400.0, 0.3, logger, (0.01, 1e-3, 5e-6), 0.0
    )


def write(folder: Path) -> None:
    """The logs that the page speaks of."""
    for name, label in (("healthy", ""), ("monday", "overload"), ("tuesday", "nominal")):
        _comma(_frame(slide(), label)).to_csv(folder / f"slide_{name}.csv", sep=";", index=False)
    for name, label in (("healthy", ""), ("monday", "coupling_loss")):
        _micro(_frame(lift(), label)).to_csv(folder / f"lift_{name}.csv", index=False)


def _frame(actuator: hidden.Actuator, label: str) -> pd.DataFrame:
    spec = hidden.fault_spec(actuator, label, 1) if label else hidden.healthy_spec(actuator)
    return hidden.actuator_log(replace(actuator), spec, 5)[0]


def _comma(frame: pd.DataFrame) -> pd.DataFrame:
    """A German export in ms and mm."""
    values = {
        "Zeit [ms]": 1e3 * frame["time_s"], "U [V]": frame["voltage_v"], "I [A]": frame["current_a"],
        "Weg [mm]": 1e3 * frame["position_m"],
    }  # fmt: skip
    return pd.DataFrame(
        {name: [f"{v:.4f}".replace(".", ",") for v in column] for name, column in values.items()}
    )


def _micro(frame: pd.DataFrame) -> pd.DataFrame:
    """A drive's own trace in whole numbers."""
    values = {
        "t_us": 1e6 * frame["time_s"],
        "i_mA": 1e3 * frame["current_a"],
        "pos_um": 1e6 * frame["position_m"],
    }
    return pd.DataFrame({name: np.round(column).astype(int) for name, column in values.items()})


if __name__ == "__main__":
    write(Path(sys.argv[1]))
