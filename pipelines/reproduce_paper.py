"""Figures 1 to 7 of Kemp and Martin (2018) from the models of this project with Table 1:
reports/reproduce_paper.

python -m pipelines.reproduce_paper [--out reports/reproduce_paper]

The paper's recordings are not public. "Measured" is a synthetic log with the noise of the paper's sensors,
of a rig whose friction is drawn from the paper's 10 % spread; "modelled" is Table 1, run open loop.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from observer_fi.physics import Fault, Move, Rig, Scenario, load_rig, synthesise
from observer_fi.physics import paper_residuals as residuals
from observer_fi.records import Array, Estimate, Log
from observer_fi.report import (
    COLOURS,
    MEASURED,
    MIXTURE,
    WORDS,
    Figure,
    environment,
    padded,
    versions,
    write_folder,
)
from observer_fi.settings import Settings
from observer_fi.verdict import make_bank, open_loop_estimate

MODEL = "#d55e00"
START, DETECTED, SECONDS = 0.05, 3.0, 6.0
MOVE = (Move(START, 410.0, SECONDS - 0.2 - START),)


def main(argv: Sequence[str] | None = None) -> int:
    """All seven figures and the page that shows them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("reports/reproduce_paper"))
    args = parser.parse_args(argv)

    rig = load_rig()
    measured = synthesise(Scenario(MOVE, 1.0, effects={"A": 4.83e-4}, seed=1), rig, "nominal")[0]
    modelled = synthesise(Scenario(MOVE, 1.0, noise=0.0), rig, "model")[0]
    figures = {f"figure_{k + 1}": nominal_figure(k, measured, modelled, rig) for k in range(3)} | {
        "figure_4": overload_figure(rig)
    }
    verdicts = {}
    for number, fault in ((5, "overload"), (6, "coupling_loss"), (7, "none")):
        log, truth = synthesise(
            Scenario(MOVE, SECONDS, fault=Fault(fault, DETECTED), spread=True, seed=number), rig, fault
        )
        estimate = open_loop_estimate(log, make_bank(rig, Settings()).advance(log), rig, DETECTED)
        figures[f"figure_{number}"] = residual_figure(number, estimate)
        verdicts[number] = (truth.label, MIXTURE[int(estimate.probability[-1].argmax())])
    text = (
        environment()
        .get_template("paper.html")
        .render(
            figures=figures, phases=phases(modelled, rig), verdicts=verdicts, words=WORDS, versions=versions()
        )
    )
    write_folder(args.out, {"index.html": text, **{f"{name}.svg": svg for name, svg in figures.items()}})
    print(args.out / "index.html")
    return 0 if all(truth == verdict for truth, verdict in verdicts.values()) else 1


def nominal_figure(number: int, measured: Log, modelled: Log, rig: Rig) -> str:
    """Figures 1 to 3: voltage, current and speed of a nominal start, measured and modelled."""
    name, unit = (("Motor voltage", "V"), ("Motor current", "A"), ("Motor speed", "rad/s"))[number]
    p = rig.model.vector
    y, model = (
        residuals.speed(log.z, p) if number == 2 else log.z[:, number] for log in (measured, modelled)
    )
    figure = Figure(
        f"f{number + 1}", 720.0, 330.0, f"Figure {number + 1}: {name} against time, nominal operation"
    )
    panel = figure.panel(60.0, 40.0, 550.0, 230.0, (0.0, 0.45), padded(y, model)).frame(
        "time [s]", f"{name} [{unit}]"
    )
    since = measured.t - START
    shown = (since >= 0.0) & (since <= 0.45)
    panel.line(since[shown], y[shown], COLOURS["nominal"], 3.0, opacity=0.55)
    panel.line(since[shown], model[shown], MODEL, 1.2)
    last = float(model[shown][-1])
    panel.end_labels([(last, "measured", COLOURS["nominal"]), (last, "modelled", MODEL)])
    return figure.svg()


def overload_figure(rig: Rig) -> str:
    """Figure 4: motor current against the distance after contact."""
    seconds = 14.0
    moves = (Move(START, 410.0, seconds - 0.2),)
    contact = 1.0
    logs = [
        synthesise(Scenario(moves, seconds, fault=Fault("overload", contact), noise=noise, seed=4), rig)[0]
        for noise in (1.0, 0.0)
    ]
    figure = Figure("f4", 720.0, 330.0, "Figure 4: motor current against distance after contact, overload")
    distance, current = [], []
    for log in logs:
        pressed = (log.t >= contact) & (log.t < seconds - 0.4)
        first = logs[1].z[np.searchsorted(log.t, contact), 2]
        distance.append(1e3 * (log.z[pressed, 2] - first))
        current.append(1e3 * log.z[pressed, 1])
    panel = figure.panel(60.0, 40.0, 550.0, 230.0, (0.0, float(distance[1].max())), padded(*current))
    panel.frame("distance after contact [mm]", "Motor current [mA]")
    every = slice(None, None, 40)
    panel.points(distance[0][every], current[0][every], COLOURS["nominal"], 4.0, 0.6)
    panel.line(distance[1], current[1], MODEL, 1.6)
    panel.end_labels(
        [(float(current[1][-1]), "modelled", MODEL), (float(current[0][-1]), "measured", COLOURS["nominal"])]
    )
    return figure.svg()


def residual_figure(number: int, estimate: Estimate) -> str:
    """Figures 5 to 7: the error residual of each model from the detection on."""
    titles = {5: "an overload", 6: "a coupling loss", 7: "no fault (a false alarm)"}
    figure = Figure(
        f"f{number}", 720.0, 330.0, f"Figure {number}: error residual of each model, {titles[number]}"
    )
    norm = np.sqrt(estimate.nis)[estimate.active]
    t = estimate.t[estimate.active]
    panel = figure.panel(60.0, 40.0, 520.0, 230.0, (DETECTED - 0.2, float(t[-1])), (0.5, 300.0), log=True)
    panel.frame("time [s]", "error residual")
    panel.moment(DETECTED, "detected", MEASURED, "2 2")
    for j, mode in enumerate(MIXTURE):
        panel.line(t, norm[:, j], COLOURS[mode], 1.6)
    panel.end_labels(
        [(float(np.median(norm[-40:, j])), WORDS[mode], COLOURS[mode]) for j, mode in enumerate(MIXTURE)]
    )
    return figure.svg()


def phases(log: Log, rig: Rig) -> list[tuple[str, str, str]]:
    """What section 3 says of a nominal start, and what the model does: (quantity, paper, here)."""
    since, z = log.t - START, log.z
    source = z[:, 0] + rig.model["Rs"] * z[:, 1]
    full = since[source > rig.model["Vmax"] * (1.0 - 1e-6)]
    w = residuals.speed(z, rig.model.vector)
    ring = w[since > 0.25] - w[-1]
    return [
        ("voltage saturates", "from 7 to 50 ms", f"from {1e3 * full[0]:.0f} to {1e3 * full[-1]:.0f} ms"),
        ("settled", "after 250 ms", f"within {_percent(ring, w[-1])} of the speed after 250 ms"),
        ("largest speed", "–", f"{w.max():.0f} rad/s"),
        ("largest current", "–", f"{1e3 * z[:, 1].max():.0f} mA"),
        ("steady current", "–", f"{1e3 * z[-1, 1]:.1f} mA"),
        ("steady voltage", "–", f"{z[-1, 0]:.2f} V"),
    ]


def _percent(y: Array, of: float) -> str:
    return f"{100.0 * float(np.abs(y).max()) / abs(of):.1f} %"


if __name__ == "__main__":
    sys.exit(main())
