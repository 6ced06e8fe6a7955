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

from observer_fi.physics import OPEN_LOOP, Fault, Move, Rig, Scenario, load_rig, synthesise, words_of
from observer_fi.physics import paper_residuals as residuals
from observer_fi.records import Array, Log
from observer_fi.report import environment, still_figures, versions, write_folder
from observer_fi.settings import Settings
from observer_fi.verdict import make_bank, open_loop_estimate

START, DETECTED, SECONDS = 0.05, 3.0, 6.0
MOVE = (Move(START, 410.0, SECONDS - 0.2 - START),)
SHOWN_S = 0.45  # of a start
EVERY = 4  # samples of figures 5 to 7: the noise of one looks like that of the next
TITLES = {
    5: ("overload", "an overload"),
    6: ("coupling_loss", "a coupling loss"),
    7: ("none", "no fault, a false alarm"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """All seven figures and the page that shows them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("reports/reproduce_paper"))
    args = parser.parse_args(argv)

    rig = load_rig()
    measured = synthesise(Scenario(MOVE, 1.0, effects={"A": 4.83e-4}, seed=1), rig, "nominal")[0]
    modelled = synthesise(Scenario(MOVE, 1.0, noise=0.0), rig, "model")[0]
    figures = start_figures(measured, modelled, rig) | {4: still_figures.contact_figure(*pressed(rig))}
    verdicts = {}
    for number, (fault, words) in TITLES.items():
        log, truth = synthesise(
            Scenario(MOVE, SECONDS, fault=Fault(fault, DETECTED), spread=True, seed=number), rig, fault
        )
        e = open_loop_estimate(log, make_bank(rig, Settings()).advance(log), rig, DETECTED)
        title = f"Figure {number}: error residual of each model, {words}"
        shown = np.flatnonzero(e.active)[::EVERY]
        figures[number] = still_figures.residual_norm_figure(
            title, e.t[shown], np.sqrt(e.nis[shown]), DETECTED
        )
        verdicts[number] = (truth.label, OPEN_LOOP[int(e.probability[-1].argmax())])
    template = environment().get_template("paper.html")
    page = template.render(
        phases=phases(modelled, rig),
        verdicts=verdicts,
        words={mode: words_of(mode) for mode in OPEN_LOOP},
        versions=versions(),
    )
    drawn = {f"figure_{number}.svg": still_figures.svg(figure) for number, figure in figures.items()}
    write_folder(args.out, {"index.html": page, **drawn})
    print(args.out / "index.html")
    return 0 if all(truth == verdict for truth, verdict in verdicts.values()) else 1


def start_figures(measured: Log, modelled: Log, rig: Rig) -> dict[int, still_figures.Figure]:
    """Figures 1 to 3: voltage, current and speed of a nominal start."""
    since = measured.t - START
    shown = (since >= 0.0) & (since <= SHOWN_S)
    pairs = [(measured.z[shown, c], modelled.z[shown, c]) for c in range(2)]
    p = rig.model.vector
    pairs.append((residuals.speed(measured.z[shown], p), residuals.speed(modelled.z[shown], p)))
    return {k + 1: still_figures.start_figure(k, since[shown], *pair) for k, pair in enumerate(pairs)}


def pressed(rig: Rig) -> list[tuple[Array, Array]]:
    """Distance [m] and current [A] after contact, with noise and without: what figure 4 shows."""
    seconds, contact = 14.0, 1.0
    moves = (Move(START, 410.0, seconds - 0.2),)
    fault = Fault("overload", contact)
    logs = [
        synthesise(Scenario(moves, seconds, fault=fault, noise=noise, seed=4), rig)[0] for noise in (1.0, 0.0)
    ]
    here = (logs[1].t >= contact) & (logs[1].t < seconds - 0.4)
    first = logs[1].z[np.searchsorted(logs[1].t, contact), 2]
    return [
        (log.z[here, 2][::step] - first, log.z[here, 1][::step])
        for log, step in zip(logs, (40, 1), strict=True)
    ]


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
