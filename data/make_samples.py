"""Writes the sample logs of this folder, and samples.json with what is true about them. The same bytes every time."""

import sys
from pathlib import Path

from observer_fi.physics import Fault, Move, Scenario, csv_bytes, load_rig, synthesise
from observer_fi.report import json_text, write_file

HERE = Path(__file__).resolve().parent
START = 0.3

# Each log is one rig of the paper's spread. The false alarms are healthy rigs at which a threshold would call:
# friction a fifth above the rig file in steady state, inertia a twentieth above it in the start transient.
SAMPLES = {
    "overload_steady": Scenario(
        (Move(START, 410.0, 2.7),), 3.4, pitch_deg=3.0, fault=Fault("overload", 1.6), spread=True, seed=11
    ),
    "overload_transient": Scenario(
        (Move(START, 410.0, 2.7),), 3.4, fault=Fault("overload", 0.36), spread=True, seed=12
    ),
    "coupling_loss_steady": Scenario(
        (Move(START, 410.0, 2.7),), 3.4, pitch_deg=-4.0, fault=Fault("coupling_loss", 1.9), seed=13
    ),
    "coupling_loss_transient": Scenario(
        (Move(START, -330.0, 2.7),), 3.4, fault=Fault("coupling_loss", 0.33), spread=True, seed=14
    ),
    "false_alarm_steady": Scenario(
        (Move(START, 300.0, 2.7),), 3.4, pitch_deg=6.0, effects={"A": 5.5e-4}, spread=True, seed=15
    ),
    "false_alarm_transient": Scenario(
        (Move(START, 410.0, 2.7),), 3.4, effects={"J": 4.94e-7}, spread=True, seed=16
    ),
}


def main(folder: Path = HERE) -> None:
    """All samples into `folder`."""
    rig = load_rig()
    truths = {}
    for name, scenario in SAMPLES.items():
        log, truth = synthesise(scenario, rig, name)
        write_file(folder / f"{name}.csv.gz", csv_bytes(log, compress=True))
        truths[name] = {"label": truth.label, "onset_s": truth.onset_s}
    write_file(folder / "samples.json", json_text(truths))


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:]))
